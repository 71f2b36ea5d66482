"""The input of Bent's planners (a vehicle's region) and the result (the vehicle's course)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from mission_service.guidance.team.front_ring import FrontRing


@dataclass(frozen=True, slots=True)
class Region:
    """One vehicle's part of the ring: ``range(begin, end)``, unwrapped indices (see ``regions``).

    ``own_cell`` is the vehicle's cell, in ``range(begin, begin + n)`` for a ring of n cells. If
    ``own_cell`` is ``end`` or more, the vehicle is outside the region.
    """

    ring: FrontRing
    begin: int
    end: int
    own_cell: int
    at_s: float
    speed_m_s: float
    exponential: bool


class Course(NamedTuple):
    """A vehicle's direction, and the unwrapped index of the target cell (None without a target)."""

    clockwise: bool = True
    target: int | None = None


# Returns a vehicle's new course in its region from the course so far.
CourseRule = Callable[[Region, Course], Course]


def lifted(cell: int, begin: int, cells: int) -> int:
    """Return a cell's unwrapped index, in ``range(begin, begin + cells)``."""
    return begin + (cell - begin) % cells


def course_to(region: Region, target: int) -> Course:
    """Return the course to a target inside the region."""
    return Course(target > region.own_cell, target)


def is_finished(region: Region, course: Course) -> bool:
    """Return whether a course has no target, or a target that is passed or outside the region.

    A vehicle can pass its target without visiting it if the ring has grown, or if the vehicle has
    skipped cells in flight.
    """
    target = course.target
    if target is None or not region.begin <= target < region.end:
        return True
    return region.own_cell >= target if course.clockwise else region.own_cell <= target


def course_back(region: Region) -> Course:
    """Return the course that takes a vehicle outside its region back over the fewest cells."""
    cells = region.ring.step_m.size
    clockwise = region.begin + cells - region.own_cell < region.own_cell - (region.end - 1)
    return Course(clockwise)
