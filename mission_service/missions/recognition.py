"""Identifies the mission on board each vehicle from the items read back after a restart."""

from collections.abc import Iterable

from autopilot_bridge.items import MissionItem, yaw_left_open
from autopilot_bridge.missions.read_back import same_as_sent
from autopilot_bridge.stacks.stacks import Stack
from mission_service.commands import AnyCommand, UploadMission
from mission_service.events import AnyEvent, MissionReadBack, UploadFinished

MAX_HELD = 4  # maximum number of stored missions per vehicle while the mission is uncertain

Items = tuple[MissionItem, ...]


def as_uploaded(items: Items, stack: Stack | None) -> Items:
    """Return a mission in the form in which it is sent to an autopilot."""
    if stack is not None and (stack.name, stack.vehicle) == ("px4", "copter"):
        return yaw_left_open(items)  # a yaw of 0 would turn the vehicle north
    return items


class MissionsHeld:
    """The missions that each vehicle may have on board, oldest first, derived from events."""

    def __init__(self) -> None:
        self._may_hold: dict[str, list[UploadMission]] = {}

    def apply(self, event: AnyEvent, commands: Iterable[AnyCommand]) -> None:
        """Process an event and its commands."""
        match event:
            case UploadFinished(outcome="accepted") | MissionReadBack():
                held = self._may_hold.get(event.vehicle, [])
                since = [sent for sent in held if sent.mission_id >= event.mission_id > 0]
                if isinstance(event, MissionReadBack):
                    since = since[:1]
                self._may_hold[event.vehicle] = since
            case _:
                pass
        for command in commands:
            if isinstance(command, UploadMission):
                held = self._may_hold.setdefault(command.vehicle, [])
                held.append(command)
                del held[1 : len(held) + 1 - MAX_HELD]  # the first one may be on board

    def recognised(self, vehicle: str, read: Items, stack: Stack) -> int:
        """Return the number of the newest sent mission that equals the mission read back, or 0."""
        for sent in reversed(self._may_hold.get(vehicle, [])):
            due = as_uploaded(sent.items, stack)
            if len(due) == len(read) and all(
                same_as_sent(ours, theirs, stack) for ours, theirs in zip(due, read, strict=True)
            ):
                return sent.mission_id
        return 0
