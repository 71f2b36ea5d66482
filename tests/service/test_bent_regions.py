"""Regions of a team: each cell has exactly one owner, despite lost messages, losses and growth."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_service.guidance.team.front_ring import Integers
from mission_service.guidance.team.regions import (
    BorderMessage,
    Regions,
    equal_regions,
    has_turn,
    ledger,
    message_of,
    offering,
    on_new_ring,
    owners,
    retained,
    served,
    with_border,
    with_border_moved,
    with_member,
    with_message,
    without_member,
)

Draw = Callable[[int], int]  # a whole number from 0 to below this number


def spans(regions: Regions) -> list[tuple[int, int]]:
    begins = ledger(regions)
    return list(zip(begins, [*begins[1:], begins[0] + regions.cells], strict=True))


def check(regions: Regions) -> None:
    """Check that the vehicles together observe the whole perimeter."""
    count_of = np.zeros(regions.cells, int)
    for index, (begin, end) in enumerate(spans(regions)):
        assert 0 <= end - begin <= regions.cells
        count_of[np.arange(begin, end) % regions.cells] += 1
        own_begin, own_end = served(regions, index)
        # A vehicle owns only cells that it observes, and at least the cells that it never offered.
        assert own_begin <= begin <= end <= own_end
        kept_begin, kept_end = retained(regions, index)
        assert kept_begin <= kept_end
        assert begin <= kept_begin
        assert kept_end <= end
    assert (count_of == 1).all()
    owner = owners(regions)
    changes = np.count_nonzero(owner != np.roll(owner, 1))
    assert changes <= len(regions.members)  # each region is connected
    assert changes == (np.unique(owner).size if np.unique(owner).size > 1 else 0)


def random_growth(cells: int, draw: Draw) -> tuple[Integers, int]:
    """Return a new ring; each cell moves on by some cells, or onto the previous cell."""
    first = draw(cells)
    steps = np.array([draw(4) for _ in range(cells - 1)])
    places = np.concatenate([[0], np.cumsum(steps)])
    now = int(places[-1]) + 1 + draw(3)
    return (first + places) % now, now


class Air:
    """A link that stores all messages, and delivers any of them at any time."""

    def __init__(self) -> None:
        self.messages: list[tuple[tuple[int, int], bool, BorderMessage]] = []

    def send(self, regions: Regions, index: int, *, left: bool) -> None:
        self.messages.append((ends(regions, index), left, message_of(regions, index, left=left)))

    def bring(self, regions: Regions, which: int) -> Regions:
        between, left, message = self.messages[which]
        for index in range(len(regions.members)):
            if ends(regions, index) == between:
                return with_message(regions, index, message, left=not left)
        return regions


def ends(regions: Regions, index: int) -> tuple[int, int]:
    """Return the members to the left and to the right of a border."""
    return regions.members[index - 1], regions.members[index]


def offer_some(regions: Regions, index: int, left: bool, draw: Draw) -> Regions:
    if len(regions.members) == 1 or not has_turn(regions.borders[index], left=left):
        return regions
    giver = (index - 1) % len(regions.members) if left else index
    begin, end = retained(regions, giver)
    amount = draw(end - begin + 1)
    border = regions.borders[index]
    place = border.left.place - amount if left else border.right.place + amount
    return with_border(regions, index, offering(border, place, left=left))


def act(regions: Regions, air: Air, member: int, draw: Draw) -> Regions:
    """Execute a random action; ``member`` is a vehicle that was never in the team."""
    index, left, count = draw(len(regions.members)), bool(draw(2)), len(regions.members)
    what = draw(12)
    if what < 3:
        regions = offer_some(regions, index, left, draw)
        air.send(regions, index, left=left)
    elif what < 5:
        air.send(regions, index, left=left)
    elif what < 9 and air.messages:
        # Most actions are announcements.
        regions = air.bring(
            regions, len(air.messages) - 1 - min(draw(4) * draw(8), len(air.messages) - 1)
        )
    elif what == 9:
        regions = on_new_ring(regions, *random_growth(regions.cells, draw))
    elif what == 10 and count > 1:
        regions = without_member(regions, regions.members[index])
    elif what == 11 and count < 6:
        cells_of = [draw(regions.cells) for _ in regions.members]
        # A name may be used again.
        regions = with_member(
            regions, member if left else max(regions.members) + 1, cells_of, draw(regions.cells)
        )
    return regions


@settings(max_examples=80)
@given(st.randoms(use_true_random=False), st.integers(1, 6), st.integers(6, 60))
def test_every_cell_has_one_owner_whatever_happens(random, uavs: int, cells: int) -> None:  # type: ignore[no-untyped-def]
    def draw(below: int) -> int:
        return int(random.randrange(below))

    regions = equal_regions(range(uavs), [draw(cells) for _ in range(uavs)], cells)
    air = Air()
    for number in range(60):
        regions = act(regions, air, 100 + number, draw)
        if regions.cells > 400:
            regions = on_new_ring(regions, np.arange(regions.cells) * 50 // regions.cells, 50)
        check(regions)


@settings(max_examples=30)
@given(st.randoms(use_true_random=False))
def test_two_sides_agree_once_messages_arrive_again(random) -> None:  # type: ignore[no-untyped-def]
    def draw(below: int) -> int:
        return int(random.randrange(below))

    regions, air = equal_regions([0, 1, 2], [0, 10, 20], 30), Air()
    for _ in range(40):
        index, left = draw(3), bool(draw(2))
        regions = offer_some(regions, index, left, draw)
        if draw(3) == 0:
            air.send(regions, index, left=left)
            regions = air.bring(regions, len(air.messages) - 1)
    for _ in range(2):
        for index in range(3):
            for left in (True, False):
                air.send(regions, index, left=left)
                regions = air.bring(regions, len(air.messages) - 1)
    for border in regions.borders:
        assert border.left.place == border.right.place
        assert border.left.version == border.right.version
        assert border.left.offered is None
        assert border.right.offered is None
        # A vehicle may move on.
        assert has_turn(border, left=True) != has_turn(border, left=False)


def test_regions_begin_with_as_many_cells_wherever_the_vehicles_are() -> None:
    regions = equal_regions([5, 6, 7], [12, 3, 12], 20)
    assert regions.members == (6, 5, 7)
    assert spans(regions) == [(3, 9), (9, 16), (16, 23)]


def test_giver_serves_until_it_receives_a_reply() -> None:
    regions = equal_regions([0, 1], [0, 10], 20)
    regions = with_border(regions, 1, offering(regions.borders[1], 6, left=True))
    offer = message_of(regions, 1, left=True)
    assert (served(regions, 0), ledger(regions)) == ((0, 10), (0, 10))
    taken = with_message(regions, 1, offer, left=False)
    # The reply is lost: both observe cells 6 to 9, which belong to the vehicle that accepted.
    assert served(taken, 0) == (0, 10)
    assert served(taken, 1) == (6, 20)
    assert ledger(taken) == (0, 6)
    again = with_message(taken, 1, message_of(taken, 1, left=True), left=False)
    assert again == taken
    done = with_message(again, 1, message_of(again, 1, left=False), left=True)
    assert served(done, 0) == (0, 6)


def test_moving_needs_no_turn_of_ones_own() -> None:
    regions = equal_regions([3, 7], [0, 10], 20)
    for place, left in ((8, True), (5, True), (9, False), (9, True), (12, False)):
        regions = with_border_moved(regions, 1, place, left=left)
        assert ledger(regions) == (0, place)
        assert served(regions, 0) == (0, place)
        assert served(regions, 1) == (place, 20)
    with pytest.raises(ValueError, match="cannot be offered"):
        with_border_moved(regions, 1, 13, left=True)


def test_leaving_and_joining() -> None:
    regions = equal_regions([0, 1, 2], [0, 10, 20], 30)
    assert ledger(without_member(regions, 1)) == (0, 15)
    lost_first = without_member(regions, 0)
    assert lost_first.members == (1, 2)
    assert spans(lost_first) == [(5, 20), (20, 35)]
    # Vehicle 1 is in the second half of its region and keeps this half.
    both = with_member(regions, 9, [3, 16, 25], 11)
    assert both.members == (0, 9, 1, 2)
    assert ledger(both) == (0, 10, 15, 20)
    assert with_member(regions, 9, [3, 14, 25], 11).members == (0, 1, 9, 2)
    alone = without_member(lost_first, 2)
    assert spans(alone) == [(-3, 27)]
    assert spans(with_member(alone, 4, [6], 6)) == [(-3, 12), (12, 27)]
    with pytest.raises(ValueError, match="last"):
        without_member(alone, 1)


def test_growth_moves_borders_with_their_cells() -> None:
    regions = equal_regions([0, 1], [1, 4], 6)
    after = on_new_ring(regions, np.array([8, 0, 2, 3, 4, 7]), 9)
    assert [begin % 9 for begin in ledger(after)] == [0, 4]
    assert spans(after)[1][1] - spans(after)[0][0] == 9
