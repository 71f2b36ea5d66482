"""Shows events that the journal refuses, or that occur while the journal cannot be written."""

from mission_service.commands import AnyCommand, UploadMission
from mission_service.errors import RefusedEventError
from mission_service.events import (
    AnyEvent,
    AutopilotText,
    ModeChanged,
    OperatorEvent,
    VehicleEvent,
)
from mission_service.journal.journal_file import event_body
from mission_service.runtime.state_view import StateView
from mission_service.vehicles.availability import LEADS_TO, MISSION, named_mode


class UnrecordedEvents:
    """Shows unrecorded events to operators, and stores the unrecorded modes."""

    def __init__(self) -> None:
        self._modes: dict[str, str] = {}  # modes selected while the journal fails
        self._refusals: set[str] = set()  # alarms about refused events

    def line_of(self, event: AnyEvent, view: StateView) -> bytes | None:
        """Return the journal line of an event, or None if the event cannot be journalled.

        In that case an alarm is raised, which remains until an event of the same type can be
        journalled.
        """
        try:
            body = event_body(event)
        except RefusedEventError as error:
            self._refuse(event, str(error), view)
            return None
        if self._refusals:
            key = _alarm_of(event)
            self._refusals.discard(key)
            view.clear_alarm(key)
        return body

    def _refuse(self, event: AnyEvent, why: str, view: StateView) -> None:
        key = _alarm_of(event)
        if key in self._refusals:
            return
        name = "service" if isinstance(event, OperatorEvent) else event.vehicle
        self._refusals.add(key)
        view.announce(name, f"event refused: {why}", "warning")
        view.alarm(key, f"{name}: {why}", "warning", name)

    def show(self, event: VehicleEvent, view: StateView) -> None:
        """Show operators an event that could not be journalled and was not handled.

        Only autopilot texts, and modes selected by the autopilot or the pilot, are shown.
        """
        name = event.vehicle
        if isinstance(event, ModeChanged):
            self._modes[name] = event.mode
            words = (
                f"{name}: {named_mode(event.mode)}, selected while the journal cannot be written"
            )
            view.alarm(f"unrecorded/{name}", words, "severe", name)
        elif isinstance(event, AutopilotText):
            view.announce(name, f"autopilot: {event.text}", "warning")

    def keeps_mode(self, command: AnyCommand, view: StateView) -> bool:
        """Return whether an abort's command is withheld because a mode was not journalled."""
        mode = self._modes.get(command.vehicle, MISSION)
        changes_mode = type(command) in LEADS_TO and not isinstance(command, UploadMission)
        if not changes_mode or mode == MISSION:
            return False
        words = f"stays in {named_mode(mode)}, which was selected meanwhile"
        view.announce(command.vehicle, words, "warning")
        return True

    def forget_modes(self, view: StateView) -> None:
        """Clear the modes and their alarms; after a restart each mode is reported again."""
        for name in self._modes:
            view.clear_alarm(f"unrecorded/{name}")
        self._modes.clear()


def _alarm_of(event: AnyEvent) -> str:
    name = "" if isinstance(event, OperatorEvent) else event.vehicle
    return f"refused/{name}/{type(event).__name__}"
