"""Bent's two baseline rules (4.3), without importance and without regions."""

import numpy as np

from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing, Integers


class Circling:
    """All vehicles fly clockwise."""

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Return True: all vehicles fly clockwise."""
        return True

    def on_ring_changed(self, place_of: Integers) -> None:
        """Do nothing: the rule has no state."""


class Bumper:
    """Neighbours start in opposite directions, and two vehicles that meet both turn back.

    Vehicles never pass each other. Growth of the ring may put two into one cell, or exchange their
    order by a cell, so the numbers of cells between neighbours may be 0 or negative.
    """

    def __init__(self) -> None:
        # Decided directions: of two that meet, the other vehicle turns at its next cell.
        self._clockwise: dict[int, bool] = {}
        self._around: list[int] = []  # members in their constant order around the ring
        self._cells_on: dict[int, int] = {}  # from each member to the next one clockwise

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Keep the direction, unless the neighbour ahead is one cell away and flies towards it."""
        members = fleet.member.tolist()
        if sorted(self._around) != sorted(members):
            self._around = [members[place] for place in np.argsort(fleet.cell, kind="stable")]
            self._cells_on.clear()
            for place, member in enumerate(self._around):
                self._clockwise.setdefault(member, place % 2 == 0)
        cell_of = dict(zip(members, fleet.cell.tolist(), strict=True))
        member = members[which]
        clockwise, place = self._clockwise[member], self._around.index(member)
        behind, after = self._around[place - 1], self._around[(place + 1) % len(members)]
        # Both counts are updated in either direction, so that no lap is lost.
        since, until = (self._gap(rear, cell_of, ring.step_m.size) for rear in (behind, member))
        met, gap = (after, until) if clockwise else (behind, since)
        if gap <= 1 and self._clockwise[met] is not clockwise:
            self._clockwise[met] = clockwise
            self._clockwise[member] = not clockwise
        return self._clockwise[member]

    def _gap(self, rear: int, cell_of: dict[int, int], around: int) -> int:
        """Return the cells from one vehicle to the next; the count nearest to the last one."""
        front = self._around[(self._around.index(rear) + 1) % len(self._around)]
        gap = (cell_of[front] - cell_of[rear]) % around
        gap += around * round((self._cells_on.get(rear, gap) - gap) / around)
        self._cells_on[rear] = gap
        return gap

    def on_ring_changed(self, place_of: Integers) -> None:
        """Do nothing: cells between neighbours are counted again at the next decision."""
