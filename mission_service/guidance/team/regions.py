"""Contiguous regions of the ring, one for each vehicle, and a protocol that moves their borders.

Each border has a vehicle on the left (anticlockwise) and a vehicle on the right. Both vehicles
store a state of the border, called a side, which consists of a place and a version. A vehicle moves
a border only by giving cells away, and only on its turn: the left vehicle after even versions, the
right vehicle after odd versions. A vehicle that offers version v + 1 continues to serve the offered
cells until a message with version v + 1 or a later version arrives from the other vehicle. The
other vehicle owns the cells as soon as the offer arrives, and has the next turn.

A message consists of a place and a version. Messages may be lost, duplicated or late, so a receiver
applies only newer versions, and no version number is used twice. The served cells always cover the
ring. Each cell has exactly one owner according to the newer side of every border (``ledger``).

A place is an *unwrapped* cell index: it continues to rise or fall beyond one lap of the ring, and a
place modulo the number of cells is a cell. A region is therefore ``range(begin, end)``, and may be
empty or the whole ring.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mission_service.guidance.team.front_ring import Integers


class Side(NamedTuple):
    """The state of a border, as stored by the vehicle on one side of the border.

    ``place`` is the first cell to the right of the border.
    """

    place: int
    version: int = 0
    offered: int | None = None  # the place in version + 1, which is offered but not confirmed


class Border(NamedTuple):
    """A border: the states stored by the vehicle on the left and by the vehicle on the right."""

    left: Side
    right: Side

    def with_side(self, side: Side, *, left: bool) -> "Border":
        """Return the border with one side replaced."""
        return self._replace(left=side) if left else self._replace(right=side)


class BorderMessage(NamedTuple):
    """A message about a border between its two vehicles, valid in one epoch only."""

    epoch: int
    place: int
    version: int


@dataclass(frozen=True, slots=True)
class Regions:
    """The regions of a team, clockwise; the region of ``members[i]`` begins at ``borders[i]``.

    Places ascend from border to border, by at most ``cells`` in one lap. ``epoch`` counts how often
    the ring has grown or the team has changed; all vehicles receive these events.
    """

    members: tuple[int, ...]
    borders: tuple[Border, ...]
    cells: int
    epoch: int = 0


def equal_regions(members: Sequence[int], cells_of: Sequence[int], cells: int) -> Regions:
    """Return regions of equal size, in the vehicles' order along the ring.

    Bent's method starts with such regions (section 4.2). The first region begins at the cell of the
    first vehicle. The positions of the other vehicles determine only the order of the regions.
    """
    order = sorted(range(len(members)), key=lambda which: (cells_of[which], members[which]))
    begins = [cells_of[order[0]] + number * cells // len(order) for number in range(len(order))]
    return Regions(
        tuple(members[which] for which in order), tuple(_agreed(begin) for begin in begins), cells
    )


def served(regions: Regions, index: int) -> tuple[int, int]:
    """Return the start and the end of the cells that a vehicle serves.

    Start and end are unwrapped cell indices; the end is excluded. The indices follow from the
    states that the vehicle stores for the two borders of its region.
    """
    after = (index + 1) % len(regions.borders)
    end = regions.borders[after].left.place + (0 if after else regions.cells)
    return regions.borders[index].right.place, end


def retained(regions: Regions, index: int) -> tuple[int, int]:
    """Return the start and the end of the cells that a vehicle serves and has not offered.

    Start and end are unwrapped cell indices; the end is excluded.
    """
    after = (index + 1) % len(regions.borders)
    begin, end = regions.borders[index].right, regions.borders[after].left
    end_place = end.place if end.offered is None else end.offered
    return (
        begin.place if begin.offered is None else begin.offered,
        end_place + (0 if after else regions.cells),
    )


def ledger(regions: Regions) -> tuple[int, ...]:
    """Return the unwrapped start of each region, using the newer side of its first border."""
    return tuple(
        (right if right.version > left.version else left).place for left, right in regions.borders
    )


def owners(regions: Regions) -> Integers:
    """Return the index of the vehicle that owns each cell (n)."""
    begins = ledger(regions)
    owner = np.full(regions.cells, -1, np.int64)
    for index, (begin, end) in enumerate(pairwise((*begins, begins[0] + regions.cells))):
        owner[np.arange(begin, end) % regions.cells] = index
    return owner


def has_turn(border: Border, *, left: bool) -> bool:
    """Return whether the left or the right vehicle of a border may offer cells now."""
    side = border.left if left else border.right
    return side.offered is None and (side.version % 2 == 0) == left


def offering(border: Border, place: int, *, left: bool) -> Border:
    """Return a border after the left or the right vehicle has offered to move it to ``place``.

    Raises ValueError if the vehicle may not offer cells now, or if the vehicle would gain cells.
    """
    side = border.left if left else border.right
    if not has_turn(border, left=left) or (place > side.place if left else place < side.place):
        raise ValueError(f"a border at {side.place} cannot be offered at {place} now")
    return border.with_side(side._replace(offered=place), left=left)


def message_of(regions: Regions, index: int, *, left: bool) -> BorderMessage:
    """Return the message from the left or the right vehicle of a border: an offer or a state."""
    side = regions.borders[index].left if left else regions.borders[index].right
    if side.offered is not None:
        return BorderMessage(regions.epoch, side.offered, side.version + 1)
    return BorderMessage(regions.epoch, side.place, side.version)


def with_message(regions: Regions, index: int, message: BorderMessage, *, left: bool) -> Regions:
    """Return the regions after the left or the right vehicle of a border has received a message."""
    border = regions.borders[index]
    side = border.left if left else border.right
    if message.epoch != regions.epoch or message.version <= side.version:
        return regions
    received = border.with_side(Side(message.place, message.version), left=left)
    return with_border(regions, index, received)


def with_border(regions: Regions, index: int, border: Border) -> Regions:
    """Return the regions with one border replaced."""
    borders = (*regions.borders[:index], border, *regions.borders[index + 1 :])
    return replace(regions, borders=borders)


def with_border_moved(regions: Regions, index: int, place: int, *, left: bool) -> Regions:
    """Return the regions after one vehicle has moved a border and all messages have arrived."""
    if not has_turn(regions.borders[index], left=left):
        other = regions.borders[index].right if left else regions.borders[index].left
        regions = _given(regions, index, other.place, left=not left)
    return _given(regions, index, place, left=left)


def _given(regions: Regions, index: int, place: int, *, left: bool) -> Regions:
    border = offering(regions.borders[index], place, left=left)
    regions = with_border(regions, index, border)
    regions = with_message(regions, index, message_of(regions, index, left=left), left=not left)
    return with_message(regions, index, message_of(regions, index, left=not left), left=left)


def on_new_ring(regions: Regions, place_of: Integers, cells: int) -> Regions:
    """Return the regions on a new ring of ``cells`` cells; borders move with their cells."""
    first, before = int(place_of[0]), place_of.size

    def new(place: int | None) -> int | None:
        if place is None:
            return None
        laps, cell = divmod(place, before)
        return laps * cells + first + (int(place_of[cell]) - first) % cells

    def side(old: Side) -> Side:
        return Side(new(old.place) or 0, old.version, new(old.offered))

    borders = tuple(Border(side(left), side(right)) for left, right in regions.borders)
    return Regions(regions.members, borders, cells, regions.epoch + 1)


def without_member(regions: Regions, member: int) -> Regions:
    """Return the regions after a vehicle has left and its neighbours have shared its region.

    All offers are cancelled. Raises ValueError for the last vehicle.
    """
    index, count = regions.members.index(member), len(regions.members)
    if count == 1:
        raise ValueError("the last vehicle of a team cannot leave")
    begins = list(ledger(regions))
    begin = begins[index]
    end = begins[index + 1] if index + 1 < count else begins[0] + regions.cells
    middle = (begin + end) // 2
    if index + 1 < count:
        begins[index + 1] = middle
    else:
        begins[0] = middle - regions.cells
    del begins[index]
    return _settled(regions, regions.members[:index] + regions.members[index + 1 :], begins)


def with_member(regions: Regions, member: int, cells_of: Sequence[int], cell: int) -> Regions:
    """Return the regions after a vehicle has joined, and the region at ``cell`` has been halved.

    ``cells_of`` holds the cells of the other vehicles, clockwise. The owner of the halved region
    keeps the half that contains the owner's cell, and the new vehicle receives the other half. All
    offers are cancelled.
    """
    begins = list(ledger(regions))
    host = int(owners(regions)[cell])
    begin = begins[host]
    end = begins[host + 1] if host + 1 < len(begins) else begins[0] + regions.cells
    middle = (begin + end) // 2
    first_half = begin + (cells_of[host] - begin) % regions.cells < middle
    begins.insert(host + 1, middle)
    after = host + 1 if first_half else host
    return _settled(regions, (*regions.members[:after], member, *regions.members[after:]), begins)


def _settled(regions: Regions, members: tuple[int, ...], begins: Sequence[int]) -> Regions:
    borders = tuple(_agreed(begin) for begin in begins)
    return Regions(members, borders, regions.cells, regions.epoch + 1)


def _agreed(place: int) -> Border:
    return Border(Side(place), Side(place))
