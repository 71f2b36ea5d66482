"""Reads lost-link, return and vehicle-kind parameters after each contact. Sans-IO."""

from autopilot_bridge.clients.client_protocol import VehicleClient
from autopilot_bridge.stacks import link_loss, return_flight
from autopilot_bridge.stacks.link_loss import missing
from autopilot_bridge.stacks.stacks import Stack, kind_parameters
from autopilot_bridge.vehicle.client_events import (
    ClientEvent,
    Connected,
    LinkLost,
    LinkRestored,
    ParametersFinished,
    Rebooted,
)
from mission_service.events import ParametersReported

RETRY_US = 10_000_000  # after a read without a reply for a parameter that is needed
RETRIES = 3
READ_AGAIN_US = 60_000_000  # while disarmed, because an operator may change parameters


class ParameterReports:
    """The reader of one vehicle's parameters; one request at a time is active.

    Times are those of the link. ``station_id`` is the system id in the client's heartbeats.
    """

    def __init__(self, name: str, client: VehicleClient, station_id: int) -> None:
        self._name = name
        self._client = client
        self._station_id = station_id
        self._request: int | None = None  # id of the active request
        self._waiting: list[str] = []
        self._requested = ""
        self._values: dict[str, float] = {}
        self._missing: list[str] = []
        self._due_us: int | None = None
        self._tries = 0
        self._last: tuple[str, dict[str, float], tuple[str, ...]] | None = None

    def report_again(self, now_us: int) -> None:
        """Read all parameters, and report them even if they have not changed."""
        self._last, self._tries = None, 0
        self._read(now_us)

    def receive(self, event: ClientEvent, at_us: int, now_us: int) -> list[ParametersReported]:
        """Process a client event; return a report at the end of a read if anything has changed.

        ``at_us`` is the mission time. While the link is lost, no parameter is requested.
        """
        match event:
            case Connected() | Rebooted():
                self.report_again(now_us)
            case LinkRestored():
                self._tries = 0
                self._read(now_us)
            case LinkLost():
                self._request = self._due_us = None
            case ParametersFinished(request_id=self._request):
                return self._finished(event, at_us, now_us)
        return []

    def continue_reading(self, armed: bool, now_us: int) -> None:
        """Read again if a read is due."""
        if self._due_us is None or now_us < self._due_us:
            return
        if armed and not self._tries:
            self._due_us = now_us + READ_AGAIN_US
        else:
            self._read(now_us)

    def _finished(
        self, event: ParametersFinished, at_us: int, now_us: int
    ) -> list[ParametersReported]:
        stack = self._client.stack
        assert stack is not None  # of the request
        if event.result.outcome == "accepted":
            self._values[self._requested] = event.result.parameters[0].value
        else:
            self._missing.append(self._requested)
        if self._waiting:
            self._request_next(now_us)
            return []
        self._request = None
        self._plan_next(stack, now_us)
        found = (f"{stack.name} {stack.kind}", self._values, tuple(self._missing))
        if found == self._last:
            return []
        self._last = found
        return [ParametersReported(at_us, self._name, found[0], self._station_id, *found[1:])]

    def _read(self, now_us: int) -> None:
        stack = self._client.stack
        if stack is None:
            return
        self._values, self._missing = {}, []
        returns = return_flight.parameters_of(stack)
        names = (*link_loss.parameters_of(stack), *returns, *kind_parameters(stack))
        self._waiting, self._due_us = list(dict.fromkeys(names)), None
        self._request_next(now_us)

    def _request_next(self, now_us: int) -> None:
        self._requested = self._waiting.pop(0)
        self._request = self._client.read_parameter(self._requested, now_us)

    def _plan_next(self, stack: Stack, now_us: int) -> None:
        if missing(stack, self._values) and self._tries < RETRIES:
            self._tries += 1
            self._due_us = now_us + RETRY_US
        else:
            self._tries = 0
            self._due_us = now_us + READ_AGAIN_US
