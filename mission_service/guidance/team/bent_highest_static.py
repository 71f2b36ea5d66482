"""Highest importance target, static (Bent 4.1.3): a target is kept until it is reached."""

from mission_service.guidance.team.bent_highest_dynamic import highest_dynamic
from mission_service.guidance.team.bent_region import Course, Region, is_finished


def highest_static(region: Region, course: Course) -> Course:
    """On to the target; at its end to a new one."""
    return highest_dynamic(region, course) if is_finished(region, course) else course
