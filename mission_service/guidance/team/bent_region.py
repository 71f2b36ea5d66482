"""Input and result of Bent's planners: a vehicle's region of the ring, and its course."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from mission_service.guidance.team.front_ring import FrontRing


@dataclass(frozen=True, slots=True)
class Region:
    """One vehicle's part of the ring, [begin, end) in lifted cells (see ``regions``).

    ``own_cell`` is the vehicle's cell in ``range(begin, begin + n)``; from ``end`` on it is outside
    the region.
    """

    ring: FrontRing
    begin: int
    end: int
    own_cell: int
    at_s: float
    speed_m_s: float
    exponential: bool


class Course(NamedTuple):
    """A vehicle's direction, and its target, if any, as a lifted cell."""

    clockwise: bool = True
    target: int | None = None


# The new course of a vehicle that is in its region, from the course so far.
CourseRule = Callable[[Region, Course], Course]


def lifted(cell: int, begin: int, cells: int) -> int:
    """Return a cell of the ring (0 to ``cells`` - 1) as one of ``range(begin, begin + cells)``."""
    return begin + (cell - begin) % cells


def course_to(region: Region, target: int) -> Course:
    """Return the course to a target in the region."""
    return Course(target > region.own_cell, target)


def is_finished(region: Region, course: Course) -> bool:
    """Return whether a course has no target, its target is passed, or it is outside the region.

    A target can be passed by growth of the ring, and in flight by cells that a vehicle skips.
    """
    target = course.target
    if target is None or not region.begin <= target < region.end:
        return True
    return region.own_cell >= target if course.clockwise else region.own_cell <= target


def course_back(region: Region) -> Course:
    """Return the shorter course, in cells, into the region of a vehicle that is outside of it."""
    cells = region.ring.step_m.size
    clockwise = region.begin + cells - region.own_cell < region.own_cell - (region.end - 1)
    return Course(clockwise)
