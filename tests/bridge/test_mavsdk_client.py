"""Behaviour of the MAVSDK client only: its verdicts, and unsupported requests."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.mavsdk import MavsdkClient
from autopilot_bridge.clients.mavsdk_commands import MavsdkCommands
from autopilot_bridge.clients.mavsdk_library import upload_result
from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle import client_events as events
from autopilot_bridge.vehicle.monitor import VehicleMonitor
from tests.bridge.mock_process import free_port, mock_process, short_mission
from tests.bridge.test_client_contract import clock_us, read_back, run, station
from tests.bridge.transport_helpers import udp_socket

UPLOADS_TRIED = 5
PROGRESS = events.MissionProgress


async def transfers_over_tcp() -> None:
    port, mission = free_port(), short_mission(legs=100)
    async with station("mavsdk", port, "tcpin") as client:
        # In real time: a fast mock repeats requests so quickly that MAVSDK ends the transfer.
        with mock_process(port, "ardupilot", speedup=1.0, link="tcp"):
            await client.next(events.Connected)
            for _ in range(UPLOADS_TRIED):
                sent = client.vehicle.upload(mission, clock_us(), begin=2)
                if (reason := (await client.transfer(sent)).reason) == "accepted":
                    break
                # MAVSDK's result for a request that arrived twice.
                assert "INVALID_SEQUENCE" in reason
            assert reason == "accepted"
            numbers = [event.current_seq for event in client.seen if isinstance(event, PROGRESS)]
            assert numbers[-1] == 2
            read = await client.transfer(client.vehicle.download(clock_us()))
            assert read.items == read_back(mission, "ardupilot")


def test_frames_may_come_several_at_once() -> None:
    run(transfers_over_tcp())


@pytest.mark.parametrize(
    ("name", "result_name", "read", "outcome", "holds"),
    [
        ("px4", "SUCCESS", "sent", "accepted", "the new one"),
        ("px4", "TIMEOUT", "sent", "accepted", "the new one"),  # only the last reply was lost
        ("px4", "TIMEOUT", "other", "failed", "the old one"),
        ("px4", "UNSUPPORTED", "other", "rejected", "the old one"),
        ("px4", "SUCCESS", None, "unknown", "one of both"),
        ("ardupilot", "SUCCESS", "sent", "accepted", "the new one"),
        ("ardupilot", "SUCCESS", "other", "failed", "a mixture"),
        ("ardupilot", "UNSUPPORTED", "other", "rejected", "a mixture"),
        ("ardupilot", "UNSUPPORTED", None, "rejected", "not known"),
    ],
)
def test_results_of_mavsdk_are_judged_by_what_is_read_back(
    name: str, result_name: str, read: str | None, outcome: str, holds: str
) -> None:
    stack = stack_named(name, "plane")
    hidden = 1 if stack.item_0_is_home else 0
    mission = short_mission()
    sent = (*mission[:hidden], *mission)
    moved: tuple[MissionItem, ...] = (*sent[:-1], replace(sent[-1], x=sent[-1].x + 100))
    held = {"sent": sent, "other": moved, None: None}[read]
    shown = None if held is None else tuple(as_read_back(item, stack) for item in held)
    result = upload_result(stack, hidden, sent, result_name, shown)
    assert (result.outcome, result.holds) == (outcome, holds)


def test_orbits_and_speeds_are_refused_in_words() -> None:
    vehicle = MavsdkClient("udpin:127.0.0.1:14999", 1, clock_us)
    vehicle.command("orbit", 5, 36.0, -84.0, 500.0, 100.0)
    vehicle.command("change speed", 6, 12.0)
    for command in ("orbit", "change speed"):
        finished = vehicle.next_event()
        assert isinstance(finished, events.CommandFinished)
        assert (finished.name, finished.accepted) == (command, False)
        assert 'use backend = "native"' in finished.reason


async def starts_without_a_mission() -> None:
    port = free_port()
    async with station("mavsdk", port) as client:
        with mock_process(port, "px4", speedup=1.0):
            await client.next(events.Connected)
            client.vehicle.command("start mission", clock_us())
            finished = await client.next(events.CommandFinished)
            assert (finished.accepted, finished.reason) == (False, "command 176 denied")
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(
                    client.next(events.ModeChanged, lambda event: event.armed), 2.5
                )


def test_px4_is_not_armed_after_it_has_refused_the_mission_mode() -> None:
    # PX4 acknowledges the receipt of the mode change first, then refuses it.
    run(starts_without_a_mission())


class AckedSystem:
    """A system in which each command is acknowledged on receipt, and no time passes."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.waits_s: list[float] = []
        self.direct = SimpleNamespace(send_command=self.sent.append)

    async def call(self, sent: None) -> Any:
        return SimpleNamespace(fields_json='{"result": 0}')

    async def until(self, condition: Callable[[], bool], within_s: float) -> bool:
        self.waits_s.append(within_s)
        return condition()


def test_px4_is_not_armed_if_no_heartbeat_reports_the_mission_mode() -> None:
    stack, system = stack_named("px4", "plane"), AckedSystem()
    parts: Any = (system, VehicleMonitor(3_000_000, None), (1, 1), clock_us)
    outcome = asyncio.run(MavsdkCommands(*parts).send_steps(stack.start, stack))
    assert outcome == (False, "no HEARTBEAT reported the new mode")
    assert len(system.sent) == 1


def test_without_a_heartbeat_the_last_mode_change_delays_no_other_order() -> None:
    stack, system = stack_named("px4", "plane"), AckedSystem()
    parts: Any = (system, VehicleMonitor(3_000_000, None), (1, 1), clock_us)
    steps = (stack.set_mode(stack.rtl_mode),)
    assert asyncio.run(MavsdkCommands(*parts).send_steps(steps, stack)) == (True, "accepted")
    assert system.waits_s == [0.5]


async def ignores_frames_from_another_remote() -> None:
    port = free_port()
    where = ("127.0.0.1", port)
    async with station("mavsdk", port) as client:
        with udp_socket() as vehicle, udp_socket() as impostor:
            impostor.setblocking(False)
            vehicle.sendto(autopilot_heartbeat(armed=True), where)
            await client.next(events.Connected)
            impostor.sendto(autopilot_heartbeat(armed=False), where)
            impostor.sendto(autopilot_position(), where)
            vehicle.sendto(autopilot_heartbeat(armed=True), where)
            alarm = await client.next(events.SameSystemId)
            addresses = ["{}:{}".format(*sock.getsockname()) for sock in (vehicle, impostor)]
            assert [alarm.kept, alarm.left_out] == addresses
            client.vehicle.read_parameter("NAV_DLL_ACT", clock_us())
            client.link.flush()
            assert await asyncio.to_thread(vehicle.recv, 300)
            with pytest.raises(BlockingIOError):
                impostor.recv(300)
    modes = [event.armed for event in client.seen if isinstance(event, events.ModeChanged)]
    assert False not in modes
    assert not any(isinstance(event, events.Position) for event in client.seen)


def test_the_vehicle_is_bound_to_its_remote() -> None:
    run(ignores_frames_from_another_remote())


def autopilot_heartbeat(armed: bool) -> bytes:
    px4 = mavlink.MAV_AUTOPILOT_PX4
    mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
    return Codec(1, 1).encode(
        mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FIXED_WING, px4, 1 | mode, 0, 4, 3)
    )


def autopilot_position() -> bytes:
    where = (363_000_000, -842_000_000, 400_000, 100_000)
    return Codec(1, 1).encode(mavlink.MAVLink_global_position_int_message(5000, *where, 0, 0, 0, 0))
