"""Negotiation on the centre of importance (Bent 4.2.2)."""

from mission_service.guidance.team.bent_kernels import most_centred
from mission_service.guidance.team.negotiation import Share, largest_chunks
from mission_service.guidance.team.ring import FrontRing


def on_centre(
    ring: FrontRing, left: Share, own: Share, right: Share, at_s: float, exponential: bool
) -> tuple[int, int]:
    """Of all chunks within the offers, those that leave the centre of importance most central.

    The pseudocode is garbled: it compares signed differences, never refills a chunk that it has
    emptied and tries the first chunk without the second only if there is no second. The text says
    what is meant: every combination is tried for the least distance of centre and middle.
    """
    first, last = largest_chunks(ring, left, own, right, at_s, exponential)
    if not first and not last:
        return 0, 0
    found = most_centred(
        ring.spread_rate_m_s,
        ring.visited_at_s,
        own.begin,
        own.end,
        first,
        last,
        at_s,
        exponential,
    )
    return int(found[0]), int(found[1])
