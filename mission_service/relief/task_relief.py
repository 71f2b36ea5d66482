"""Defines the roles of vehicles that take turns at a task: a state machine with a table. Pure.

stands by --takeoff is due--> relieves --the one on task leaves--> resumes
resumes --over the place where the task was left--> on task
relieves --the task has no place yet--> on task
on task, resumes, relieves --sent home, lost or taken over--> leaves --disarmed--> stands by
leaves --flies again, and no other vehicle flies the task--> resumes

At most one vehicle is on task, and at most one relieves or resumes. The place of the task is the
position of the vehicle on task or, after it has left, the position where it left. The ``holder`` is
the vehicle whose planner has the task's map: the one on task or the last one.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from autopilot_bridge.transitions import enter
from mission_service.commands import ReliefRole, Severity

HISTORY_LENGTH = 20  # number of roles listed in the error about an invalid transition


class TaskRole(Enum):
    """The roles of a vehicle in a task."""

    STANDS_BY = "stands by"  # on the ground
    RELIEVES = "relieves"  # takes off, or flies to the vehicle on task
    RESUMES = "resumes"  # flies to the place where the task was left
    ON_TASK = "on task"
    LEAVES = "leaves"  # flies home, or is lost


TASK_TRANSITIONS: dict[TaskRole, tuple[TaskRole, ...]] = {
    # A vehicle that is found in the air although the relief did not order its takeoff leaves.
    TaskRole.STANDS_BY: (TaskRole.RELIEVES, TaskRole.LEAVES),
    TaskRole.RELIEVES: (
        *(TaskRole.RESUMES, TaskRole.ON_TASK),
        *(TaskRole.LEAVES, TaskRole.STANDS_BY),
    ),
    TaskRole.RESUMES: (TaskRole.ON_TASK, TaskRole.LEAVES, TaskRole.STANDS_BY),
    TaskRole.ON_TASK: (TaskRole.LEAVES, TaskRole.STANDS_BY),
    TaskRole.LEAVES: (TaskRole.STANDS_BY, TaskRole.RESUMES),
}


class TaskPlace(NamedTuple):
    """The place (x, y on the map) of a task, and the course (unit vector) of its vehicle there."""

    x_m: float
    y_m: float
    east: float
    north: float

    def distance_m(self, x_m: float, y_m: float) -> float:
        """Return the distance to a position."""
        return math.hypot(x_m - self.x_m, y_m - self.y_m)

    def before(self, distance_m: float) -> tuple[float, float]:
        """Return the position on the course ``distance_m`` before the place."""
        return self.x_m - distance_m * self.east, self.y_m - distance_m * self.north


@dataclass
class TaskVehicle:
    """The role of one vehicle in the task."""

    name: str
    roles: deque[TaskRole] = field(
        default_factory=lambda: deque([TaskRole.STANDS_BY], HISTORY_LENGTH)
    )
    since_s: float = -math.inf  # time of the last role change
    released: bool = False  # whether it left because of its energy or its relief, not an order
    flies_by_order: bool = False  # whether an operator has ordered it to fly since it left
    full_since_s: float | None = None  # since when it has reported a full battery on the ground
    unfit_since_s: float | None = None  # time since which it has not followed its mission
    nearest_m: float = math.inf  # least distance from the place of the task while it resumes
    # The distance from this place, and the time, when the vehicle last came clearly nearer.
    approach_m: float = math.inf
    approach_s: float = -math.inf
    shown: tuple[ReliefRole, str] | None = None  # role and text as last shown

    @property
    def role(self) -> TaskRole:
        """The current role."""
        return self.roles[-1]

    def change_role(self, role: TaskRole, at_s: float) -> None:
        """Change the role. Raises InvalidTransitionError."""
        enter(self.roles, role, TASK_TRANSITIONS, f"relief by {self.name}")
        self.since_s, self.unfit_since_s = at_s, None


@dataclass
class ReliefTask:
    """The task of one group of vehicles."""

    members: dict[str, TaskVehicle]
    holder: str
    place: TaskPlace | None = None  # None until its planner has found the front
    left_at_s: float = -math.inf  # time when a vehicle last left it
    alarm: tuple[str, Severity, str] | None = None  # the vehicle, severity and text

    def one_with(self, *roles: TaskRole) -> TaskVehicle | None:
        """Return the vehicle with one of the roles, or None."""
        return next((each for each in self.members.values() if each.role in roles), None)

    def next_of(self, ready: Iterable[str]) -> str | None:
        """Return the ready vehicle that has stood by for the longest time."""
        names = list(self.members)
        standing = [name for name in ready if self.members[name].role is TaskRole.STANDS_BY]
        order = ((self.members[name].since_s, names.index(name), name) for name in standing)
        return min(order, default=(0.0, 0, None))[2]

    def validate_state(self) -> None:
        """Check the invariants between two events; raises AssertionError. For tests."""
        roles = [each.role for each in self.members.values()]
        assert roles.count(TaskRole.ON_TASK) <= 1, roles
        assert roles.count(TaskRole.RELIEVES) + roles.count(TaskRole.RESUMES) <= 1, roles
        on_task = self.one_with(TaskRole.ON_TASK)
        assert on_task is None or on_task.name == self.holder, (on_task, self.holder)


def task_of(names: Iterable[str]) -> ReliefTask:
    """Return a task that no vehicle is flying yet."""
    members = {name: TaskVehicle(name) for name in names}
    return ReliefTask(members, next(iter(members)))
