"""The front as a ring, and the interface of a team's rules.

A ring is a closed, clockwise sequence of cells: of a simulated fire (Bent's experiments), or of an
on-board map in flight, where the cells are its 360 bearings.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class FrontRing:
    """The front at one moment, clockwise; arrays (n)."""

    step_m: Floats  # from each cell to the next one, the last to the first
    spread_rate_m_s: Floats  # of the front there, outwards
    visited_at_s: Floats  # when a vehicle last saw it


@dataclass(frozen=True, slots=True)
class ActiveFleet:
    """The vehicles that fly now; arrays (k), in rising order of seat."""

    member: Integers  # number of the vehicle in the team, which stays the same
    cell: Integers  # of the ring
    clockwise: Booleans
    speed_m_s: Floats


class TeamRule(Protocol):
    """Decides the direction of every vehicle of a team along the ring."""

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Return whether vehicle ``which`` (index in the fleet) flies clockwise from here on."""

    def on_ring_changed(self, place_of: Integers) -> None:
        """Move all state to a new ring: ``place_of[i]`` is the new cell of the old cell i.

        The order around the ring is the same; several old cells may share a new one.
        """
