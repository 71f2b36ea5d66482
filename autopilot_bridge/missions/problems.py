"""Describes the problems of a mission for users."""

from dataclasses import dataclass
from typing import Literal

from autopilot_bridge.items import MissionItem, command_name

Kind = Literal["refused", "dangerous", "dropped", "changed"]


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem of a mission for one stack.

    The kind states what the autopilot does. ``refused``: it rejects the item. ``dangerous``: it
    accepts the item, but executes it differently. ``dropped``: it accepts the item, but never
    executes it. ``changed``: it stores another value. ``index`` is None for a problem of the whole
    mission.
    """

    kind: Kind
    index: int | None
    command: str
    field: str
    value: float
    reason: str
    remedy: str

    def __str__(self) -> str:
        where = "mission" if self.index is None else f"item {self.index} {self.command}"
        return f"{where}: {self.field} {self.value:g}: {self.reason}; {self.remedy}"


def problem(
    kind: Kind, index: int, item: MissionItem, field: str, reason: str, remedy: str
) -> Problem:
    """Return the problem of one field of an item."""
    value: float = getattr(item, field)
    return Problem(kind, index, command_name(item.command), field, value, reason, remedy)
