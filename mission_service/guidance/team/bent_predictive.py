"""Predictive planning (Bent 4.1.4): the straight path that will find the highest importance."""

from mission_service.guidance.team.bent_kernels import best_path
from mission_service.guidance.team.bent_region import Course, Region, course_to


def predictive(region: Region, course: Course) -> Course:
    """Along the path of highest mean importance at the times its cells would be visited.

    The pseudocode goes on to the old target unless a path is better, and so does this. Times are
    those of the flight; the thesis's "+ 1, + 2" stand for them.
    """
    ring = region.ring
    target = best_path(
        ring.spread_rate_m_s,
        ring.visited_at_s,
        ring.step_m,
        region.begin,
        region.end,
        region.here,
        region.here if course.target is None else course.target,
        region.at_s,
        region.speed_m_s,
        region.exponential,
    )
    return course_to(region, int(target))
