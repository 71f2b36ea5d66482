"""The front as a ring, and what the rules of a team decide on it.

A ring is a closed, clockwise row of cells. Where it comes from does not matter to a rule: from a
fire that is known (Bent's experiments) or from an on-board map in flight, where the cells are its
360 bearings.
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

    member: Integers  # who; stays the same as long as the vehicle is in the team
    cell: Integers  # where on the ring
    clockwise: Booleans
    speed_m_s: Floats


class TeamRule(Protocol):
    """Decides for every vehicle of a team which way it flies along the ring."""

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Vehicle ``which`` (place in the fleet) has come to a new cell: clockwise from here?"""

    def on_ring_changed(self, place_of: Integers) -> None:
        """The ring has changed: ``place_of[i]`` is the new place of what was cell i.

        It keeps the order around the ring; several old cells may share a new one.
        """
