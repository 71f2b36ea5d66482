"""Computes the cells that a vehicle gives to its neighbours in a negotiation (Bent, 4.2, 6.1)."""

from collections.abc import Callable
from dataclasses import dataclass

from mission_service.guidance.team.bent_kernels import chunk, max_centred, total
from mission_service.guidance.team.bent_region import lifted
from mission_service.guidance.team.front_ring import FrontRing


@dataclass(frozen=True, slots=True)
class Party:
    """A vehicle in a negotiation; cells are unwrapped indices (see ``regions``).

    A vehicle keeps its current cell, next cell and target if they are in its region. ``reserved``
    holds the first and the last of these cells.
    """

    begin: int
    end: int
    own_cell: int
    reserved: tuple[int, int]

    @property
    def max_first(self) -> int:
        """The number of cells that the vehicle may give at the beginning of its region."""
        return max(self.reserved[0] - self.begin, 0)

    @property
    def max_last(self) -> int:
        """The number of cells that the vehicle may give at the end of its region."""
        return max(self.end - 1 - self.reserved[1], 0)


# The arguments are the ring, the left neighbour, the vehicle, the right neighbour, the time in s,
# and whether importance is exponential. The result holds the numbers of cells that the vehicle
# gives away at the beginning and at the end of its region. In a team of two, both neighbours are
# the same vehicle.
Negotiation = Callable[[FrontRing, Party, Party, Party, float, bool], tuple[int, int]]


def reserved_cells(begin: int, end: int, cells: tuple[int, ...]) -> tuple[int, int]:
    """Return the first and the last of ``cells`` in a region, or the middle cell twice if none."""
    inside = [cell for cell in cells if begin <= cell < end] or [(begin + end) // 2]
    return min(inside), max(inside)


def offers(own: float, left: float, right: float, alone: bool) -> tuple[float, float]:
    """Return the importance offered to the left and to the right neighbour.

    ``alone`` means that both neighbours are the same vehicle. The vehicle then offers the
    importance that makes both regions equal, half at each border, because the thesis does not
    define the border at which two vehicles trade.
    """
    more_left, more_right = max(own - left, 0.0), max(own - right, 0.0)
    if alone:
        return more_left / 4.0, more_right / 4.0
    if more_left == 0.0 or more_right == 0.0:
        return more_left / 2.0, more_right / 2.0
    # Afterwards this vehicle and the neighbour that now has more importance have equal importance.
    less, more = sorted((more_left, more_right))
    scale = less / (2.0 * less + more)
    return scale * more_left, scale * more_right


def on_importance(
    ring: FrontRing, left: Party, own: Party, right: Party, at_s: float, exponential: bool
) -> tuple[int, int]:
    """Return how many cells at each end have a total importance within the offer (4.2.1)."""
    rate, visited = ring.spread_rate_m_s, ring.visited_at_s

    def worth(part: Party) -> float:
        return float(total(rate, visited, part.begin, part.end, at_s, exponential))

    alone = left is right
    to_left, to_right = offers(worth(own), worth(left), worth(right), alone)
    first = chunk(rate, visited, own.begin, 1, own.max_first, to_left, at_s, exponential)
    last = chunk(rate, visited, own.end - 1, -1, own.max_last, to_right, at_s, exponential)
    # Without an offer, cells of importance 0 are not given either.
    return int(first) if to_left else 0, int(last) if to_right else 0


def on_centre(
    ring: FrontRing, left: Party, own: Party, right: Party, at_s: float, exponential: bool
) -> tuple[int, int]:
    """Return how many cells to give, within the offers, to best centre the remaining cells (4.2.2).

    The pseudocode is inconsistent with the text of the thesis. For the offered cells at the two
    ends (the chunks), the pseudocode compares signed differences, never refills an emptied chunk,
    and tries the first chunk alone only if there is no second chunk. This function follows the
    text: it tries every combination of numbers of cells, and chooses the combination with the
    smallest distance between the centre of importance and the middle of the region.
    """
    first, last = on_importance(ring, left, own, right, at_s, exponential)
    if not first and not last:
        return 0, 0
    found = max_centred(
        ring.spread_rate_m_s, ring.visited_at_s, own.begin, own.end, first, last, at_s, exponential
    )
    return int(found[0]), int(found[1])


def on_arrival(
    ring: FrontRing, left: Party, own: Party, right: Party, at_s: float, exponential: bool
) -> tuple[int, int]:
    """Return how many cells each neighbour would reach before this vehicle (6.1; Ahmadi & Stone).

    Each neighbour is assumed to fly to these cells at once. All vehicles have the same speed, so
    the nearer vehicle arrives first. Distances are in cells, because steps are nearly equal.
    """
    cells = ring.step_m.size
    behind = lifted(left.own_cell, own.own_cell - cells, cells)
    ahead = lifted(right.own_cell, own.own_cell + 1, cells)
    # A cell at equal distance is not given away.
    first = (behind + own.own_cell + 1) // 2 - own.begin
    last = own.end - 1 - (ahead + own.own_cell) // 2
    return min(max(first, 0), own.max_first), min(max(last, 0), own.max_last)
