"""Behaviour of the MAVSDK client only: its verdicts, and unsupported requests."""

from dataclasses import replace

import pytest

from autopilot_bridge.clients.mavsdk import MavsdkClient
from autopilot_bridge.clients.mavsdk_library import upload_result
from autopilot_bridge.items import MissionItem
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle import client_events as events
from tests.bridge.mock_process import free_port, mock_process, short_mission
from tests.bridge.test_client_contract import clock_us, read_back, run, station

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
