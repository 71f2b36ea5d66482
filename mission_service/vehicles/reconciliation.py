"""Handles vehicle state that is unconfirmed after a restart, until the mission is read back."""

from typing import Literal

from mission_service.events import MissionReadBack
from mission_service.vehicles.vehicle_state import UnconfirmedState, Vehicle


def unconfirmed(vehicle: Vehicle) -> None:
    """Mark commands and uploads under way as unconfirmed until the mission is read back.

    Operators' orders remain valid.
    """
    was = vehicle.unconfirmed  # the service was restarted again before the read-back
    pending = vehicle.pending or (was.pending if was else None)
    sent_home = vehicle.availability.recalled and vehicle.sent_home
    recalled = sent_home or bool(was and was.recalled)
    starting = vehicle.start_under_way or bool(was and was.starting)
    vehicle.unconfirmed = UnconfirmedState(pending, recalled, starting, bool(was and was.resumed))
    vehicle.start_under_way = False
    vehicle.drop_upload()
    vehicle.flown_line = vehicle.hold_under_way_s = None


def recognised(
    vehicle: Vehicle, was: UnconfirmedState, event: MissionReadBack
) -> Literal["same", "new", "unknown"]:
    """Return which mission is on board: "same" (as accepted), "new" (being sent) or "unknown".

    The vehicle continues the accepted mission, unless a new mission is due.
    """
    pending, accepted = was.pending, vehicle.accepted
    if pending is not None and event.mission_id == pending.mission_id:
        return "new"
    if accepted is not None and event.mission_id == accepted.mission_id:
        vehicle.flown_line = None if vehicle.holding or accepted.lands else accepted.line
        return "same"
    vehicle.accepted = None
    return "unknown"


def in_words(event: MissionReadBack) -> str:
    """Return the result of a read-back in one line for the operator."""
    if event.items is None:
        return "its mission could not be read back: a new mission is sent"
    if event.mission_id:
        return f"read back: mission {event.mission_id} is on board"
    return f"read back: {event.items} items on board, not a mission of the service"
