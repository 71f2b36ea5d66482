"""Bent's planners, which decide a vehicle's direction within its region (thesis, 4.1 and 6.1).

Each function receives the region and the course so far, and returns the new course.
"""

from mission_service.guidance.team.bent_kernels import best_path, highest
from mission_service.guidance.team.bent_region import Course, Region, course_to, is_finished


def back_and_forth(region: Region, course: Course) -> Course:
    """Return the course from one end of the region to the other and back (4.1.1)."""
    if region.own_cell == region.end - 1:
        return Course(clockwise=False)
    if region.own_cell == region.begin:
        return Course(clockwise=True)
    return Course(course.clockwise)


def highest_dynamic(region: Region, course: Course) -> Course:
    """Return the course to the most important cell, chosen again at each decision (4.1.2)."""
    ring, cells = region.ring, (region.begin, region.end, region.own_cell)
    target = highest(
        ring.spread_rate_m_s, ring.visited_at_s, *cells, region.at_s, region.exponential
    )
    return course_to(region, int(target))


def highest_static(region: Region, course: Course) -> Course:
    """Return the course to the most important cell, kept until arrival (4.1.3)."""
    return highest_dynamic(region, course) if is_finished(region, course) else course


def predictive(region: Region, course: Course) -> Course:
    """Return the course along the path whose cells have the highest mean importance (4.1.4).

    The importance of a cell is computed for the time of the visit. Here this time follows from the
    flight time to the cell; the thesis assumes one time step for each cell ("+ 1, + 2"). As in the
    pseudocode, the previous target is kept unless another path is better.
    """
    ring, cells = region.ring, (region.begin, region.end, region.own_cell)
    target = best_path(
        *(ring.spread_rate_m_s, ring.visited_at_s, ring.step_m, *cells),
        region.own_cell if course.target is None else course.target,
        *(region.at_s, region.speed_m_s, region.exponential),
    )
    return course_to(region, int(target))


def predictive_kept(region: Region, course: Course) -> Course:
    """Return the course of ``predictive``, but keep each path to its end (6.1, future work)."""
    return predictive(region, course) if is_finished(region, course) else course
