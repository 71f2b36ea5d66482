"""Highest importance target, dynamic (Bent 4.1.2): chosen anew at every cell."""

from mission_service.guidance.team.bent_kernels import highest
from mission_service.guidance.team.bent_region import Course, Region, course_to


def highest_dynamic(region: Region, course: Course) -> Course:
    """Towards the cell that is most important now."""
    ring = region.ring
    target = highest(
        ring.spread_rate_m_s,
        ring.visited_at_s,
        region.begin,
        region.end,
        region.here,
        region.at_s,
        region.exponential,
    )
    return course_to(region, int(target))
