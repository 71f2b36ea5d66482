"""Predictive planning that flies each path to its end (Bent 6.1, an idea for later)."""

from mission_service.planners.bent_predictive import predictive
from mission_service.planners.bent_region import Course, Region, towards


def predictive_kept(region: Region, course: Course) -> Course:
    """On along the path; at its end, or if that is the region's no longer, the next one."""
    target = course.target
    if target is None or target == region.here or not region.begin <= target < region.end:
        return predictive(region, course)
    return towards(region, target)
