"""Bent's two baseline rules (thesis, 4.3), which use neither importance nor regions."""

import numpy as np

from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing, Integers


class Circling:
    """The rule under which all vehicles fly clockwise."""

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Return True: all vehicles fly clockwise."""
        return True

    def on_ring_changed(self, place_of: Integers) -> None:
        """Do nothing: the rule has no state."""


class Bumper:
    """The rule under which neighbours start in opposite directions and turn back when they meet.

    Vehicles never fly past each other. When the ring grows, however, two vehicles may be moved to
    the same cell, or past each other by one cell. Therefore the number of cells between two
    neighbours may be 0 or negative.
    """

    def __init__(self) -> None:
        # The most recently decided directions. When two vehicles meet, the first vehicle turns at
        # once, and the second at its own next decision.
        self._clockwise: dict[int, bool] = {}
        self._around: list[int] = []  # members in their constant order around the ring
        self._cells_on: dict[int, int] = {}  # cells from each member to the next one clockwise

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Return the current direction, or the opposite if the vehicle meets its neighbour.

        Two neighbours meet if they are at most one cell apart and fly towards each other.
        """
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
        # The gaps on both sides are updated at each decision, so that no lap is missed.
        since, until = (self._gap(rear, cell_of, ring.step_m.size) for rear in (behind, member))
        met, gap = (after, until) if clockwise else (behind, since)
        if gap <= 1 and self._clockwise[met] is not clockwise:
            self._clockwise[met] = clockwise
            self._clockwise[member] = not clockwise
        return self._clockwise[member]

    def _gap(self, rear: int, cell_of: dict[int, int], around: int) -> int:
        """Return the number of cells from ``rear`` to the next vehicle.

        The vehicles' cells determine this number only up to whole laps; the candidate nearest to
        the last result is returned.
        """
        front = self._around[(self._around.index(rear) + 1) % len(self._around)]
        gap = (cell_of[front] - cell_of[rear]) % around
        gap += around * round((self._cells_on.get(rear, gap) - gap) / around)
        self._cells_on[rear] = gap
        return gap

    def on_ring_changed(self, place_of: Integers) -> None:
        """Do nothing: cells between neighbours are counted again at the next decision."""
