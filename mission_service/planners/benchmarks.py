"""Bent's two benchmark rules (4.3): they look neither at importance nor at who serves what."""

from mission_service.planners.ring import Fleet, Integers, Ring


class Circling:
    """All fly clockwise, one behind the other."""

    def decide(self, ring: Ring, fleet: Fleet, which: int, at_s: float) -> bool:
        """Clockwise."""
        return True

    def regrown(self, place_of: Integers) -> None:
        """Nothing is kept."""


class Bumper:
    """Each starts in the direction opposite to its neighbour's; two that meet both turn back.

    Seats follow each other clockwise and never pass: growth may put two into one cell, or one
    just behind the other, so the cells between neighbours are counted on through that.
    """

    def __init__(self) -> None:
        # By seat, and not as they fly now: of two that meet the other turns at its next cell.
        self._clockwise: dict[int, bool] = {}
        self._cells_between: dict[tuple[int, int], int] = {}  # by seat and the next one clockwise

    def decide(self, ring: Ring, fleet: Fleet, which: int, at_s: float) -> bool:
        """As before, unless the neighbour ahead comes the other way and is one cell on."""
        seat, count = int(fleet.seat[which]), len(fleet.seat)
        clockwise = self._clockwise.setdefault(seat, which % 2 == 0)
        if count == 1:
            return clockwise
        behind = self._gap(ring, fleet, (which - 1) % count)
        before = self._gap(ring, fleet, which)
        met = int(fleet.seat[(which + 1 if clockwise else which - 1) % count])
        near = (before if clockwise else behind) <= 1
        if near and self._clockwise.get(met) is (not clockwise):
            self._clockwise[met] = clockwise
            self._clockwise[seat] = not clockwise
        return self._clockwise[seat]

    def _gap(self, ring: Ring, fleet: Fleet, rear: int) -> int:
        """Cells from one vehicle on to the next; the count nearest to the last one."""
        front, around = (rear + 1) % len(fleet.seat), ring.step_m.size
        pair = int(fleet.seat[rear]), int(fleet.seat[front])
        gap = int(fleet.cell[front] - fleet.cell[rear]) % around
        gap += around * round((self._cells_between.get(pair, gap) - gap) / around)
        self._cells_between[pair] = gap
        return gap

    def regrown(self, place_of: Integers) -> None:
        """Cells between neighbours are counted anew at the next decision."""
