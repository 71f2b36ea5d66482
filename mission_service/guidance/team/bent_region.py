"""What a planner of Bent's sees and keeps: its own region of the ring, and where it is going."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from mission_service.guidance.team.ring import FrontRing


@dataclass(frozen=True, slots=True)
class Region:
    """One vehicle's part of the ring, [begin, end) in lifted cells (see ``regions``).

    ``here`` is the vehicle's cell in ``range(begin, begin + n)``: outside of the region from
    ``end`` on.
    """

    ring: FrontRing
    begin: int
    end: int
    here: int
    at_s: float
    speed_m_s: float
    exponential: bool


class Course(NamedTuple):
    """Where a vehicle is going; the target lifted like its region, if it has one."""

    clockwise: bool = True
    target: int | None = None


# Decides in a region in which the vehicle is, from the course it was on.
CourseRule = Callable[[Region, Course], Course]


def lifted(cell: int, begin: int, cells: int) -> int:
    """A cell of the ring (0 to ``cells`` - 1) as one of ``range(begin, begin + cells)``."""
    return begin + (cell - begin) % cells


def course_to(region: Region, target: int) -> Course:
    """On to a target in the region."""
    return Course(target > region.here, target)


def is_finished(region: Region, course: Course) -> bool:
    """Whether a course is over: no target, at or past it, or it is the region's no longer.

    Past it, because growth, and in flight the cells that a vehicle skips, carry it on.
    """
    target = course.target
    if target is None or not region.begin <= target < region.end:
        return True
    return region.here >= target if course.clockwise else region.here <= target


def course_back(region: Region) -> Course:
    """The shorter way, in cells, into a region in which the vehicle is not."""
    cells = region.ring.step_m.size
    clockwise = region.begin + cells - region.here < region.here - (region.end - 1)
    return Course(clockwise)
