"""Predictive planning that flies each path to its end (Bent 6.1, an idea for later)."""

from mission_service.guidance.team.bent_predictive import predictive
from mission_service.guidance.team.bent_region import Course, Region, is_finished


def predictive_kept(region: Region, course: Course) -> Course:
    """On along the path; at its end the next one."""
    return predictive(region, course) if is_finished(region, course) else course
