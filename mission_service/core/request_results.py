"""Handles the results of uploads and commands: acceptances, refusals and failures."""

from mission_service import events
from mission_service.commands import AnyCommand, Hold
from mission_service.core.landings import Landings
from mission_service.core.mission_starts import MissionStarts
from mission_service.guidance.protocol import Guidance
from mission_service.vehicles.missions_sent import RETRY_S
from mission_service.vehicles.vehicle_state import MissionPhase, Pending, Vehicle, announce

START_AGAIN_S = 10.0
# These commands are sent often, so that only their refusals are announced.
UNANNOUNCED = ("orbit", "change speed")
HOLDS = ("hold", "hold at another height")


class RequestResults:
    """Applies the results of uploads and commands to their vehicles."""

    def __init__(self, guidance: Guidance, starts: MissionStarts, landings: Landings) -> None:
        self.guidance = guidance
        self._landings = landings
        self._starts = starts

    def upload_finished(self, vehicle: Vehicle, event: events.UploadFinished) -> list[AnyCommand]:
        """Apply the outcome of an upload; after a failure another upload follows."""
        if vehicle.pending is None or vehicle.pending.mission_id != event.mission_id:
            return []
        vehicle.upload_ended_at_s = event.at_us / 1e6
        pending, accepted = vehicle.pending, event.outcome == "accepted"
        vehicle.enter(MissionPhase.ACCEPTED if accepted else MissionPhase.FAILED)
        if accepted:
            started = self.accepted(vehicle, pending, event.at_us / 1e6)
            return self._landings.uploaded(vehicle, event) if pending.lands else started
        vehicle.flown_line = None
        if pending.lands:
            return self._landings.uploaded(vehicle, event)
        vehicle.not_before_s = event.at_us / 1e6 + RETRY_S
        if vehicle.ordered and pending.evades:  # the hold that the evasion had replaced
            vehicle.hold_again_at_s = vehicle.not_before_s
        failure = f"mission {event.mission_id} {event.outcome}: {event.reason}"
        if event.outcome == "cancelled" and vehicle.availability.recalled:
            return [announce(vehicle, f"mission {event.mission_id} cancelled: the vehicle returns")]
        words = f"{failure}; trying again in {RETRY_S:.0f} s"
        commands: list[AnyCommand] = [announce(vehicle, words, warning=True)]
        in_mission = vehicle.availability.flies and self.guidance.in_mission(vehicle.name)
        if in_mission and vehicle.started:
            # PX4 loiters after an infeasible mission. ArduPilot may have parts of both the old and
            # the new mission on board.
            vehicle.holding = True
            if not vehicle.atomic_upload:
                commands.append(Hold(vehicle.name))
        return commands

    def accepted(self, vehicle: Vehicle, pending: Pending, at_s: float) -> list[AnyCommand]:
        """Record that a mission is on board; return the command to start it if a start is due.

        A mission that lands is not a planner's path; only a landing starts it.
        """
        vehicle.flown_line = None if pending.lands else pending.line
        vehicle.accepted, vehicle.takes_off = pending, pending.takes_off
        if pending.lands:
            return []
        if vehicle.landing_state.active:  # the landing was ordered during the upload
            return []
        if vehicle.ordered and not pending.evades:  # the hold was ordered during the upload
            vehicle.hold_again_at_s = at_s
            return []
        if not vehicle.started and vehicle.section.autostart and not vehicle.availability.recalled:
            vehicle.started = True
            return self._starts.start_mission(vehicle, at_s)
        if vehicle.holding:
            vehicle.holding = False
            return self._starts.start_mission(vehicle, at_s)
        return []

    def command_finished(self, vehicle: Vehicle, event: events.CommandFinished) -> list[AnyCommand]:
        """Handle the result of a command; a refused start or return is repeated later."""
        was_starting = event.command == "start mission" and vehicle.start_under_way
        if event.command == "start mission":
            vehicle.start_under_way = False
            vehicle.start_again_at_s = None
        if event.command in HOLDS and not _is_replaced(vehicle, event):
            vehicle.hold_under_way_s = None
            if vehicle.ordered == "hold" and event.accepted:
                vehicle.hold_again_at_s = None
        if event.command == "return" and event.accepted:
            vehicle.return_again_at_s = None
        if event.command in ("fly landing", "go around") and vehicle.landing_state.active:
            handled = self._landings.command_finished(vehicle, event)
            if handled:
                return handled
        if event.accepted:
            unannounced = event.command in UNANNOUNCED or self._starts.was_announced(vehicle, event)
            return [] if unannounced else [announce(vehicle, f"{event.command}: accepted")]
        vehicle.start_confirmed = False
        words = f"{event.command}{'' if event.replaced else ' refused'}: {event.reason}"
        again_at_s = event.at_us / 1e6 + START_AGAIN_S
        if event.command == "return" and vehicle.availability.recalled:
            vehicle.return_again_at_s = again_at_s
        elif was_starting and self._starts.may_repeat(vehicle):
            vehicle.start_again_at_s = again_at_s
        else:
            return [announce(vehicle, words, warning=not event.replaced)]
        words += f"; trying again in {START_AGAIN_S:.0f} s"
        return [announce(vehicle, words, warning=not event.replaced)]


def _is_replaced(vehicle: Vehicle, event: events.CommandFinished) -> bool:
    """Return whether a hold ended because another hold was sent at that moment."""
    return not event.accepted and vehicle.hold_under_way_s == event.at_us / 1e6
