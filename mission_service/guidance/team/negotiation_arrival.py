"""Negotiation by who can be there first (Bent 6.1, an idea for later, after Ahmadi & Stone)."""

from mission_service.guidance.team.bent_region import lifted
from mission_service.guidance.team.negotiation import Share
from mission_service.guidance.team.ring import FrontRing


def on_arrival(
    ring: FrontRing, left: Share, own: Share, right: Share, at_s: float, exponential: bool
) -> tuple[int, int]:
    """The cells at either end that the neighbour would reach sooner, flying there at once.

    All fly at the same speed, so sooner is nearer; in cells, as steps are much alike.
    """
    cells = ring.step_m.size
    behind = lifted(left.here, own.here - cells, cells)
    ahead = lifted(right.here, own.here + 1, cells)
    # A cell just as near to both stays where it is.
    first = (behind + own.here + 1) // 2 - own.begin
    last = own.end - 1 - (ahead + own.here) // 2
    return min(max(first, 0), own.max_first), min(max(last, 0), own.max_last)
