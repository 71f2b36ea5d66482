"""Vehicles are detected on their links, distinguished, lost and found again."""

import asyncio
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.clients.shared_link import FleetEvent, SharedLink, VehicleKey
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.local_frame import LocalFrame
from autopilot_bridge.mock.serving import MockGroup
from autopilot_bridge.stacks.stacks import STACKS, stack_named, stack_of
from autopilot_bridge.vehicle.client_events import (
    CommandFinished,
    Connected,
    LinkLost,
    LinkRestored,
    Position,
    SameSystemId,
    TransferFinished,
)
from autopilot_bridge.vehicle.monitor import VehicleMonitor
from tests.bridge.helpers import SECOND, line_of, mock_of
from tests.bridge.transport_helpers import clock_us, free_port
from tests.patience import PATIENCE_S

PX4, PLANE = stack_named("px4", "plane"), stack_named("ardupilot", "plane")
COPTER = stack_named("ardupilot", "copter")


class Air:
    """Links with mocks in virtual time; a remote is a list of mocks with one address."""

    def __init__(self, **remotes: list[MockAutopilot]) -> None:
        """Create the links; names of remotes are ``link_remote``."""
        self.links: dict[str, SharedLink] = {}
        self.remotes: dict[tuple[str, str], tuple[MockGroup, MemoryLink, MemoryLink]] = {}
        self.events: list[FleetEvent] = []
        self.now_us = 0
        for name, mocks in remotes.items():
            link, _, remote = name.partition("_")
            self.links.setdefault(link, SharedLink(link))
            self.remotes[link, remote] = (MockGroup(mocks), MemoryLink(), MemoryLink())

    def run_for(self, seconds: float) -> None:
        end_us = self.now_us + round(seconds * SECOND)
        while self.now_us < end_us:
            self.now_us += 25_000
            for link in self.links.values():
                if link.next_timer() <= self.now_us:
                    link.handle_timer(self.now_us)
                for datagram in link.data_to_send():
                    for (name, _), (_, up, _) in self.remotes.items():
                        if name == link.name:
                            up.send(datagram, self.now_us)
            for (name, remote), (mocks, up, down) in self.remotes.items():
                for datagram in up.receive(self.now_us):
                    mocks.receive_data(datagram, self.now_us)
                mocks.handle_timer(self.now_us)
                for datagram in mocks.data_to_send():
                    down.send(datagram, self.now_us)
                for datagram in down.receive(self.now_us):
                    self.links[name].receive_frames(remote, [datagram], self.now_us)
            for link in self.links.values():
                while (event := link.next_event()) is not None:
                    self.events.append(event)

    @property
    def vehicles(self) -> dict[VehicleKey, NativeClient]:
        return {
            VehicleKey(name, system): link.clients[system]
            for name, link in self.links.items()
            for system in sorted(link.clients)
        }

    def of(self, kind: type, system_id: int | None = None, link: str | None = None) -> list[Any]:
        return [
            event
            for (name, system), event in self.events
            if isinstance(event, kind) and system_id in (None, system) and link in (None, name)
        ]


def heartbeat(system: int, component: int, autopilot: int, mav_type: int) -> bytes:
    message = mavlink.MAVLink_heartbeat_message(mav_type, autopilot, 0, 0, 4, 3)
    return Codec(system, component).encode(message)


def test_all_kinds_are_found_on_one_link() -> None:
    air = Air(a_1=[mock_of(stack, system_id=n) for n, stack in enumerate(STACKS, start=1)])
    air.run_for(4.0)
    found = {key.system_id: client.stack for key, client in air.vehicles.items()}
    assert found == dict(enumerate(STACKS, start=1))
    connected = {key.system_id: e.stack.name for key, e in air.events if isinstance(e, Connected)}
    assert connected == {number: stack.name for number, stack in found.items() if stack}
    numbers = range(1, len(STACKS) + 1)
    assert list(air.vehicles) == [VehicleKey("a", n) for n in numbers]
    assert all(len(air.of(Position, n)) > 4 for n in numbers)


@pytest.mark.parametrize(
    ("component", "autopilot", "mav_type"),
    [
        (190, mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_TYPE_GCS),
        (1, mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_TYPE_GCS),
        (100, mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_TYPE_CAMERA),
        (154, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_GIMBAL),
        (156, mavlink.MAV_AUTOPILOT_INVALID, mavlink.MAV_TYPE_ADSB),
        (191, mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_QUADROTOR),
        (1, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_ANTENNA_TRACKER),
        (1, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_GROUND_ROVER),
        (1, mavlink.MAV_AUTOPILOT_GENERIC, mavlink.MAV_TYPE_QUADROTOR),
    ],
)
def test_only_autopilots_of_aircraft_are_vehicles(
    component: int, autopilot: int, mav_type: int
) -> None:
    link = SharedLink("a")
    link.receive_data(heartbeat(9, component, autopilot, mav_type), 0)
    assert link.clients == {}
    link.receive_data(heartbeat(9, 1, mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_HEXAROTOR), 0)
    assert list(link.clients) == [9]


def test_vtols_are_planes_that_land_vertically() -> None:
    stack = stack_of(mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_VTOL_TILTROTOR)
    assert stack == stack_named("px4", "vtol")
    assert (stack.vehicle, stack.kind) == ("plane", "vtol")


def test_a_quadplane_with_the_heartbeat_of_a_plane_is_a_vtol_by_its_state() -> None:
    monitor = VehicleMonitor(3_000_000)
    plane = (mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    beat = mavlink.MAVLink_heartbeat_message(*plane, 0, 0, 0, 3)
    monitor.receive(beat, 0)
    assert monitor.stack == stack_named("ardupilot", "plane")
    hover, ground = mavlink.MAV_VTOL_STATE_MC, mavlink.MAV_LANDED_STATE_ON_GROUND
    monitor.receive(mavlink.MAVLink_extended_sys_state_message(0, ground), 1)
    assert monitor.stack == stack_named("ardupilot", "plane")
    monitor.receive(mavlink.MAVLink_extended_sys_state_message(hover, ground), 2)
    assert monitor.stack == stack_named("ardupilot", "vtol")
    assert monitor.receive(beat, 3) == []  # not a heartbeat of another vehicle
    assert monitor.stack == stack_named("ardupilot", "vtol")


def test_the_same_id_on_two_links_is_two_vehicles() -> None:
    air = Air(a_1=[mock_of(PX4)], b_1=[mock_of(COPTER)])
    air.run_for(3.0)
    assert {str(key): client.stack for key, client in air.vehicles.items()} == {
        "1 on a": PX4,
        "1 on b": COPTER,
    }
    air.vehicles[VehicleKey("b", 1)].upload(line_of(3), air.now_us, by_file=False)
    air.run_for(5.0)
    assert [e.result.outcome for e in air.of(TransferFinished, link="b")] == ["accepted"]
    assert air.of(TransferFinished, link="a") == []
    assert len(air.remotes["a", "1"][0].mocks[0].missions.items) == 0
    assert air.of(SameSystemId) == []


def test_the_same_id_twice_on_one_link_is_reported_and_not_mixed() -> None:
    first, second = mock_of(PX4), mock_of(PX4)
    second.flight.motion.north_m = 5_000.0
    first.handle_timer(0)
    second.handle_timer(-SECOND)
    second.handle_timer(0)  # its messages are more recent
    second.data_to_send()
    air = Air(a_first=[first], a_second=[second, mock_of(COPTER, system_id=2)])
    air.run_for(20.0)
    (conflict,) = air.of(SameSystemId)
    assert (conflict.kept, conflict.left_out) == ("first", "second")
    assert "second are discarded: assign it another system id or a separate link" in str(conflict)
    assert all(event.lat_deg == pytest.approx(36.3, abs=1e-4) for event in air.of(Position, 1))
    # Messages of the other vehicle behind the second remote are received.
    assert len(air.of(Connected)) == 2


def test_a_vehicle_may_come_back_from_another_address() -> None:
    mock = mock_of(PX4)
    air = Air(a_first=[mock], a_second=[])
    air.run_for(5.0)
    first, second = air.remotes["a", "first"], air.remotes["a", "second"]
    air.remotes["a", "first"] = (second[0], *first[1:])
    air.remotes["a", "second"] = (first[0], *second[1:])
    before = len(air.of(Position))
    air.run_for(8.0)
    assert air.of(SameSystemId) == []
    assert len(air.of(Position)) - before > 16
    assert len(air.of(Connected)) == 1


def test_each_vehicle_is_lost_and_received_again_separately() -> None:
    air = Air(a_1=[mock_of(PX4, system_id=1)], a_2=[mock_of(PLANE, system_id=2)])
    air.run_for(5.0)
    mocks, up, _ = air.remotes["a", "2"]
    air.remotes["a", "2"] = (mocks, up, MemoryLink(loss=1.0))
    air.run_for(10.0)
    (lost,) = air.of(LinkLost)
    assert lost.silent_us == pytest.approx(3e6, abs=0.2e6)
    assert air.of(LinkLost, 2) == [lost]
    air.remotes["a", "2"] = (mocks, up, MemoryLink())
    air.run_for(4.0)
    assert len(air.of(LinkRestored, 2)) == 1
    assert air.of(LinkRestored, 1) == []


def test_orders_go_to_the_vehicle_they_are_for() -> None:
    mocks = [mock_of(COPTER, system_id=n) for n in (1, 2, 3)]
    air = Air(a_1=mocks)
    air.run_for(4.0)
    command_id = air.vehicles[VehicleKey("a", 2)].command("takeoff", air.now_us, 25.0)
    air.run_for(20.0)
    assert [(e.command_id, e.accepted) for e in air.of(CommandFinished, 2)] == [(command_id, True)]
    assert [mock.flight.airborne for mock in mocks] == [False, True, False]


def test_one_heartbeat_a_second_for_the_whole_link() -> None:
    air = Air(a_1=[mock_of(PX4, system_id=n) for n in range(1, 6)])
    air.run_for(10.0)
    names: list[str] = []
    air.remotes["a", "1"] = (MockGroup([]), Tap(names), MemoryLink(loss=1.0))
    air.run_for(2.0)
    assert names.count("HEARTBEAT") == 2


class Tap(MemoryLink):
    def __init__(self, names: list[str]) -> None:
        super().__init__(loss=1.0)
        self._names = names

    def send(self, datagram: bytes, now_us: int) -> None:
        self._names += [message.get_type() for message in Codec(1, 1).decode(datagram)]


def test_a_timer_that_goes_back_to_where_it_was_is_handled_once() -> None:
    link = SharedLink("a")
    timers, handled = [5 * SECOND, 7 * SECOND, 5 * SECOND], []

    class Fickle(NativeClient):
        def next_timer(self) -> int:
            return timers.pop(0) if timers else 9 * SECOND

        def handle_timer(self, now_us: int) -> None:
            handled.append(now_us)

    link.handle_timer(0)
    link.clients[3] = Fickle(target_system=3, shared=link._outgoing)
    for _ in range(3):
        link.receive_data(heartbeat(3, 1, mavlink.MAV_AUTOPILOT_PX4, 2), 0)
    link.handle_timer(5 * SECOND)
    link.handle_timer(6 * SECOND)
    assert handled == [5 * SECOND]
    assert link.next_timer() == 7 * SECOND  # the heartbeat of the link itself
    link.handle_timer(9 * SECOND)
    assert handled == [5 * SECOND, 9 * SECOND]


def test_two_remotes_of_a_udp_link_are_distinguished() -> None:
    port = free_port()

    async def run() -> list[FleetEvent]:
        link = SharedLink("udp")
        events: list[FleetEvent] = []
        mocks = [mock_of(PX4), mock_of(PX4)]
        async with (
            Connection(f"udpin:127.0.0.1:{port}", link, clock_us, rate=1.0) as connection,
            Connection(f"udpout:127.0.0.1:{port}", mocks[0], clock_us),
            Connection(f"udpout:127.0.0.1:{port}", mocks[1], clock_us),
            asyncio.timeout(PATIENCE_S),
        ):
            while not any(isinstance(event, SameSystemId) for _, event in events):
                await connection.wait()
                while (event := link.next_event()) is not None:
                    events.append(event)
        return events

    reported = [event for _, event in asyncio.run(run()) if isinstance(event, SameSystemId)]
    assert reported[0].kept != reported[0].left_out
    assert reported[0].kept.startswith("127.0.0.1:")


def test_what_is_for_one_vehicle_is_sent_to_its_remote_only() -> None:
    port = free_port()
    received: dict[int, list[str]] = {1: [], 2: []}

    class Spy(MockAutopilot):
        def receive_data(self, data: bytes, now_us: int) -> None:
            kinds = [
                (m.get_type(), getattr(m, "target_system", 0)) for m in Codec(9, 9).decode(data)
            ]
            received[self.system_id] += [f"{kind} {system}" for kind, system in kinds]
            super().receive_data(data, now_us)

    def spy(system_id: int) -> Spy:
        return Spy(PX4, LocalFrame(36.3, -84.2, 300.0), system_id=system_id)

    async def run() -> None:
        link = SharedLink("udp")
        async with (
            Connection(f"udpin:127.0.0.1:{port}", link, clock_us) as connection,
            Connection(f"udpout:127.0.0.1:{port}", spy(1), clock_us),
            Connection(f"udpout:127.0.0.1:{port}", spy(2), clock_us),
            asyncio.timeout(PATIENCE_S),
        ):
            while min(len(kinds) for kinds in received.values()) < 8:
                await connection.wait()

    asyncio.run(run())
    for system, other in ((1, 2), (2, 1)):
        assert f"COMMAND_LONG {system}" in received[system]
        assert f"COMMAND_LONG {other}" not in received[system]


def test_each_of_250_vehicles_has_its_own_client_and_events() -> None:
    """The test runs ten seconds of traffic;

    ``benchmarks.streaming`` measures the share of a core.
    """
    link = SharedLink("a")
    mock = mock_of(PX4)
    traffic: list[tuple[int, Any]] = []
    for now_us in range(0, 12 * SECOND, 125_000):
        mock.handle_timer(now_us)
        for datagram in mock.data_to_send():
            traffic += [(now_us, message) for message in Codec(255, 190).decode(datagram)]
    codecs = [Codec(system, 1) for system in range(1, 251)]
    sent = [
        (now_us, [codec.encode(message) for codec in codecs])
        for now_us, message in traffic
        if now_us >= 2 * SECOND
    ]
    events = 0
    for now_us, datagrams in sent:
        for datagram in datagrams:
            link.receive_frames("", [datagram], now_us)
            link.data_to_send()
            link.next_timer()
        link.handle_timer(now_us)
        while link.next_event() is not None:
            events += 1
    assert len(link.clients) == 250
    assert events > 250 * 80
