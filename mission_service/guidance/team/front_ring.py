"""The front as a ring, and the interface of team rules.

A ring is a closed, clockwise sequence of cells. In Bent's experiments, the cells are those of a
simulated fire; in flight, the cells are the 360 bearings of an on-board map.
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
    """The front at a given time; each array has a value per cell (n), clockwise."""

    step_m: Floats  # distance from each cell to the next one, and from the last to the first
    spread_rate_m_s: Floats  # outward speed of the front
    visited_at_s: Floats  # time of the last view


@dataclass(frozen=True, slots=True)
class ActiveFleet:
    """The vehicles now flying; arrays have one value per vehicle (k), sorted by ``member``."""

    member: Integers  # constant number of the vehicle in the team
    cell: Integers  # the vehicle's cell on the ring
    clockwise: Booleans
    speed_m_s: Floats


class TeamRule(Protocol):
    """A team rule, which decides the direction of every vehicle along the ring."""

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Return whether the vehicle with index ``which`` in the fleet flies clockwise next."""

    def on_ring_changed(self, place_of: Integers) -> None:
        """Move the rule's state to a new ring, where ``place_of[i]`` is the new cell of old cell i.

        The order around the ring does not change. Several old cells may have the same new cell.
        """
