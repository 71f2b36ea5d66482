"""Bent's two benchmark rules (4.3): they look neither at importance nor at who serves what."""

import numpy as np

from mission_service.planners.ring import Fleet, Integers, Ring

PASSED_CELLS = 3


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
        # Not as they fly now: of two that meet the other one turns at its next cell.
        self._clockwise: dict[int, bool] = {}
        self._around: list[int] = []  # seats in their order around the ring, which stays

    def decide(self, ring: Ring, fleet: Fleet, which: int, at_s: float) -> bool:
        """As before, unless the neighbour ahead comes the other way from here or the next cell."""
        seats = fleet.seat.tolist()
        if len(seats) != len(self._around) or not set(seats) <= set(self._around):
            self._around = [seats[place] for place in np.argsort(fleet.cell, kind="stable")]
        for place, seat in enumerate(self._around):
            self._clockwise.setdefault(seat, place % 2 == 0)
        seat = seats[which]
        clockwise, step = self._clockwise[seat], 1 if self._clockwise[seat] else -1
        neighbour = self._around[(self._around.index(seat) + step) % len(seats)]
        cells = ring.step_m.size
        gap = step * int(fleet.cell[seats.index(neighbour)] - fleet.cell[which]) % cells
        # Growth may carry two into one cell, or past each other; of only two, that are neighbours
        # on either side, those in one cell have just turned.
        met = gap == 1 or (len(seats) > 2 and (gap == 0 or gap >= cells - PASSED_CELLS))
        if met and self._clockwise[neighbour] is not clockwise:
            self._clockwise[neighbour] = clockwise
            self._clockwise[seat] = not clockwise
        return self._clockwise[seat]

    def regrown(self, place_of: Integers) -> None:
        """Nothing is kept."""
