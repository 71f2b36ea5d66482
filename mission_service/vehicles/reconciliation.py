"""What is known of a vehicle after the service was down, and what its read-back says of it."""

from typing import Literal

from mission_service.events import MissionHeld
from mission_service.vehicles.state import Doubt, Vehicle


def doubt(vehicle: Vehicle) -> None:
    """The service was down: nothing that was under way is trusted until its mission is read back.

    What people have ordered holds.
    """
    was = vehicle.doubt  # down again before it was heard
    pending = vehicle.pending or (was.pending if was else None)
    sent_home = vehicle.presence.recalled and vehicle.sent_home
    recalled = sent_home or bool(was and was.recalled)
    starting = vehicle.start_under_way or bool(was and was.starting)
    vehicle.doubt = Doubt(pending, recalled, starting, bool(was and was.resumed))
    vehicle.presence.online = vehicle.start_under_way = False
    vehicle.pending = vehicle.flown_line = vehicle.hold_under_way_s = None


def recognised(
    vehicle: Vehicle, was: Doubt, event: MissionHeld
) -> Literal["same", "new", "unknown"]:
    """Which mission it has: the one before, the one that was on its way, or any other.

    The one before is flown on, unless a new one was wanted.
    """
    pending, accepted = was.pending, vehicle.accepted
    if pending is not None and event.mission_id == pending.mission_id:
        return "new"
    if accepted is not None and event.mission_id == accepted.mission_id:
        vehicle.flown_line = None if vehicle.holding else accepted.line
        return "same"
    vehicle.accepted = None
    return "unknown"


def in_words(event: MissionHeld) -> str:
    """For the operator."""
    if event.items is None:
        return "its mission could not be read back: it is sent another"
    if event.mission_id:
        return f"read back: it has mission {event.mission_id} on board"
    return f"read back: {event.items} items on board that are none of its missions"
