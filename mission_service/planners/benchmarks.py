"""Bent's two benchmark rules (4.3): they look neither at importance nor at who serves what."""

import numpy as np

from mission_service.planners.ring import Fleet, Integers, Ring


class Circling:
    """All fly clockwise, one behind the other."""

    def decide(self, ring: Ring, fleet: Fleet, which: int, at_s: float) -> bool:
        """Clockwise."""
        return True

    def regrown(self, place_of: Integers) -> None:
        """Nothing is kept."""


class Bumper:
    """Each starts in the direction opposite to its neighbour's; two that meet both turn back."""

    def __init__(self) -> None:
        # By seat, and not as they fly now: of two that meet the other turns at its next cell.
        self._clockwise: dict[int, bool] = {}

    def decide(self, ring: Ring, fleet: Fleet, which: int, at_s: float) -> bool:
        """As before, unless a vehicle comes the other way between here and the next cell."""
        seat = int(fleet.seat[which])
        clockwise = self._clockwise.setdefault(seat, which % 2 == 0)
        ahead = (int(fleet.cell[which]) + (1 if clockwise else -1)) % ring.step_m.size
        for other in np.flatnonzero(fleet.cell == ahead):
            met = int(fleet.seat[other])
            if self._clockwise.get(met) is (not clockwise):
                self._clockwise[met] = clockwise
                self._clockwise[seat] = not clockwise
                break
        return self._clockwise[seat]

    def regrown(self, place_of: Integers) -> None:
        """Nothing is kept."""
