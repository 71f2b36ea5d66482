"""Back and forth (Bent 4.1.1): from one end of the region to the other."""

from mission_service.guidance.team.bent_region import Course, Region


def back_and_forth(region: Region, course: Course) -> Course:
    """On as before; back at the last cell of the region."""
    if region.here == region.end - 1:
        return Course(clockwise=False)
    if region.here == region.begin:
        return Course(clockwise=True)
    return Course(course.clockwise)
