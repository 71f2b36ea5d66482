"""The front as a ring, and the interface of team rules.

A ring is a closed, clockwise sequence of cells of a simulated fire (Bent's experiments), or of the
360 bearings of an on-board map in flight.
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
    """The front at one time, clockwise; arrays (n)."""

    step_m: Floats  # from each cell to the next one, the last to the first
    spread_rate_m_s: Floats  # of the front, outwards
    visited_at_s: Floats  # time of the last view


@dataclass(frozen=True, slots=True)
class ActiveFleet:
    """The vehicles that fly now; arrays (k), in ascending order of member."""

    member: Integers  # constant number of the vehicle in the team
    cell: Integers  # of the ring
    clockwise: Booleans
    speed_m_s: Floats


class TeamRule(Protocol):
    """Decides the direction of every vehicle of a team along the ring."""

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Return whether vehicle ``which`` (index in the fleet) flies clockwise from here on."""

    def on_ring_changed(self, place_of: Integers) -> None:
        """Move all state to a new ring: ``place_of[i]`` is the new cell of the old cell i.

        The order around the ring does not change; several old cells may have the same new cell.
        """
