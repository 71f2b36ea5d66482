"""A client and a mock autopilot, connected by two memory links in virtual time."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.items import MissionItem, loiter_unlimited, takeoff, waypoint
from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.missions.transfer import TransferResult
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.local_frame import LocalFrame
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.client_events import ClientEvent, TransferFinished

HOME = (36.3, -84.2, 300.0)
SECOND = 1_000_000


def mock_of(stack: Stack, landing_required: int = 0, **more: Any) -> MockAutopilot:
    """Return a mock that, as a PX4 plane, requires no landing (these missions have none)."""
    mock = MockAutopilot(
        stack,
        LocalFrame(HOME[0], HOME[1], HOME[2]),
        **more,
    )
    if stack.name == "px4":
        mock.parameters.change("MIS_TKO_LAND_REQ", landing_required)
    return mock


def line_of(count: int, first: int = 0) -> tuple[MissionItem, ...]:
    """Return waypoints to the north-east and a final loiter; ``first`` makes missions differ."""
    points = [
        waypoint(36.302 + 0.001 * index, -84.2 + 0.001 * (index + first), 400.0 + first)
        for index in range(count - 1)
    ]
    return (*points, loiter_unlimited(36.31, -84.19, 420.0 + first, -90.0))


def flight_of() -> tuple[MissionItem, ...]:
    return (takeoff(*HOME[:2], 360.0), *line_of(4))


class Noting(MemoryLink):
    """A link that records all sent messages, including lost ones, and can be cut."""

    def __init__(self, **more: Any) -> None:
        super().__init__(**more)
        self.cut = False
        self.sent: list[Message] = []
        self._decoder = Codec(1, 1)

    def send(self, datagram: bytes, now_us: int) -> None:
        self.sent += self._decoder.decode(datagram)
        if not self.cut:
            super().send(datagram, now_us)

    def asked_to_begin(self) -> list[Message]:
        command = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
        return [
            message
            for message in self.sent
            if message.get_type() == "MISSION_SET_CURRENT"
            or (message.get_type() == "COMMAND_LONG" and message.command == command)
        ]


class ReceivedEvents(ABC):
    """The events that a client has reported so far, and the wait for the end of a transfer."""

    events: list[ClientEvent]
    now_us: int

    @abstractmethod
    def run_for(self, seconds: float) -> None: ...

    def result_of(self, transfer_id: int, within_s: float = 300.0) -> TransferResult:
        """Run until a transfer has ended; fail the test if it does not end in time."""
        end_us = self.now_us + round(within_s * SECOND)
        while self.now_us < end_us:
            for event in self.events:
                if isinstance(event, TransferFinished) and event.transfer_id == transfer_id:
                    return event.result
            self.run_for(0.05)
        raise AssertionError(f"transfer {transfer_id} did not end within {within_s} s")

    def of(self, kind: type) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]


@dataclass
class Pair(ReceivedEvents):
    """A client and a mock; ``drop`` decides for each frame whether it is lost."""

    mock: MockAutopilot
    up: MemoryLink = field(default_factory=MemoryLink)
    down: MemoryLink = field(default_factory=MemoryLink)
    client: NativeClient = field(default_factory=NativeClient)
    events: list[ClientEvent] = field(default_factory=list)
    now_us: int = 0
    mock_alive: bool = True

    def run(self, until_us: int) -> None:
        """Advance the time."""
        while True:
            timers = [self.client.next_timer(), self.up.next_timer(), self.down.next_timer()]
            if self.mock_alive:
                timers.append(self.mock.next_timer())
            due = max(min(timer for timer in timers if timer is not None), self.now_us)
            if due > until_us:
                self.now_us = until_us
                return
            self.now_us = due
            self.exchange()

    def exchange(self) -> None:
        """Deliver messages in transit, and messages that were just requested."""
        now_us = self.now_us
        for datagram in self.up.receive(now_us):
            if self.mock_alive:
                self.mock.receive_data(datagram, now_us)
        if self.mock_alive:
            self.mock.handle_timer(now_us)
            for datagram in self.mock.data_to_send():
                self.down.send(datagram, now_us)
        for datagram in self.down.receive(now_us):
            self.client.receive_data(datagram, now_us)
        self.client.handle_timer(now_us)
        while (event := self.client.next_event()) is not None:
            self.events.append(event)
        for datagram in self.client.data_to_send():
            self.up.send(datagram, now_us)
        self.client.validate_state()

    def run_for(self, seconds: float) -> None:
        self.run(self.now_us + round(seconds * SECOND))
