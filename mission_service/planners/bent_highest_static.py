"""Highest importance target, static (Bent 4.1.3): a target is kept until it is reached."""

from mission_service.planners.bent_highest_dynamic import highest_dynamic
from mission_service.planners.bent_region import Course, Region, towards


def highest_static(region: Region, course: Course) -> Course:
    """On to the target; at it, or if it is the region's no longer, to a new one.

    The pseudocode sets the direction only with a new target; growth and borders move cells about,
    so here it is always the one to the target.
    """
    target = course.target
    if target is None or target == region.here or not region.begin <= target < region.end:
        return highest_dynamic(region, course)
    return towards(region, target)
