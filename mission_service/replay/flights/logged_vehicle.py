"""Provides the client of a logged vehicle; commands cannot change the logged flight."""

from collections import deque

from autopilot_bridge.items import Items
from autopilot_bridge.logs.entries import LogEvent
from autopilot_bridge.missions.transfer import TransferResult
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle import client_events as bridge
from autopilot_bridge.vehicle.client_events import ClientEvent
from autopilot_bridge.vehicle.orders import Dropper
from autopilot_bridge.vehicle.parameters import ParametersResult
from autopilot_bridge.vehicle.transfer_states import StartItem

# The log events that the core uses as input. Mission progress is left out, because the logged
# progress refers to the mission that was flown, not to the missions that the core would have sent.
INPUT_EVENTS = (
    bridge.Connected
    | bridge.LinkLost
    | bridge.LinkRestored
    | bridge.Rebooted
    | bridge.ClockChanged
    | bridge.Position
    | bridge.Wind
    | bridge.Battery
    | bridge.GpsFix
    | bridge.ModeChanged
    | bridge.StatusEvent
)


class LoggedVehicle:
    """A client that acknowledges every command at once, so that the core can continue.

    Only drops are refused, because the logged vehicle did not make them.
    """

    def __init__(self) -> None:
        self.stack: Stack | None = None
        self._events: deque[ClientEvent] = deque()
        self._number = 0

    def apply(self, event: LogEvent) -> None:
        """Process the next event of the log."""
        if isinstance(event, bridge.Connected):
            self.stack = event.stack
        if isinstance(event, INPUT_EVENTS):
            self._events.append(event)

    def next_event(self) -> ClientEvent | None:
        """Return the oldest unread event, or None."""
        return self._events.popleft() if self._events else None

    def upload(
        self, items: Items, now_us: int, *, begin: StartItem = "restart", holds_first: bool = False
    ) -> int:
        """Accept the mission and report its start."""
        transfer_id = self._transferred("upload", items, now_us)
        self._events.append(bridge.MissionProgress(now_us, min(1, len(items) - 1)))
        return transfer_id

    def download(self, now_us: int) -> int:
        """Report a download without items: the mission on board is unknown."""
        return self._transferred("download", None, now_us)

    def clear(self, now_us: int) -> int:
        """Report the mission as cleared."""
        return self._transferred("clear", (), now_us)

    def _transferred(self, action: str, items: Items | None, now_us: int) -> int:
        self._number += 1
        result = TransferResult("failed", "a log")
        if items is not None:
            result = TransferResult("accepted", "", items=items, holds="the new one")
        self._events.append(bridge.TransferFinished(now_us, self._number, action, result))
        return self._number

    def command(self, name: str, now_us: int, *arguments: float | str) -> int:
        """Acknowledge the command."""
        self._number += 1
        self._events.append(bridge.CommandFinished(now_us, name, True, "", self._number))
        return self._number

    def read_parameter(self, name: str, now_us: int) -> int:
        """Report the parameter as not available."""
        self._number += 1
        result = ParametersResult("failed", "a log")
        self._events.append(bridge.ParametersFinished(now_us, self._number, result))
        return self._number

    def drop(self, dropper: Dropper, now_us: int) -> int:
        """Refuse the drop."""
        self._number += 1
        reason = "logged vehicles make no drops"
        self._events.append(bridge.DropFinished(now_us, self._number, "refused", reason))
        return self._number
