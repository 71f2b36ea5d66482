"""A vehicle flown through MAVSDK, against mock processes of both stacks."""

import asyncio
import sys
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any, TypeVar

import pytest

from autopilot_bridge.clients.mavsdk import MavsdkClient
from autopilot_bridge.clients.mavsdk_library import judged, library
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import Items, MissionItem
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.missions.transfer import TransferResult
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle import client_events as events
from tests.bridge.mock_process import free_port, mock_process, short_mission
from tests.patience import PATIENCE_S

STACKS = ("px4", "ardupilot")
SPEEDUP = 10.0
UPLOADS_TRIED = 5
PROGRESS = events.MissionProgress
Event = TypeVar("Event")


def clock_us() -> int:
    return time.monotonic_ns() // 1000


class Seat:
    """Where one vehicle's events are waited for."""

    def __init__(self, vehicle: MavsdkClient) -> None:
        self.vehicle = vehicle
        self.seen: list[events.ClientEvent] = []
        self._looked_at = 0

    async def next(
        self, kind: type[Event], what: Callable[[Event], bool] = lambda event: True
    ) -> Event:
        """The next event of a kind, after the last one that was waited for."""
        async with asyncio.timeout(PATIENCE_S):
            while True:
                while (event := self.vehicle.next_event()) is not None:
                    self.seen.append(event)
                while self._looked_at < len(self.seen):
                    found = self.seen[self._looked_at]
                    self._looked_at += 1
                    if isinstance(found, kind) and what(found):
                        return found
                await self.vehicle.wait()
                self.vehicle.flush()

    async def transfer(self, transfer_id: int) -> TransferResult:
        ended = await self.next(
            events.TransferFinished, lambda event: event.transfer_id == transfer_id
        )
        return ended.result

    async def at_item(self, seq: int) -> None:
        await self.next(events.MissionProgress, lambda event: event.current_seq == seq)


@asynccontextmanager
async def seat(port: int, link: str = "udpin") -> AsyncIterator[Seat]:
    async with MavsdkClient(f"{link}:127.0.0.1:{port}", 1, clock_us) as vehicle:
        yield Seat(vehicle)


def run(test: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(test, 60.0))


def read_back(items: Items, name: str) -> Items:
    return tuple(as_read_back(item, stack_named(name, "plane")) for item in items)


async def flies_and_is_sent_elsewhere(name: str) -> None:
    port = free_port()
    with mock_process(port, name, speedup=SPEEDUP):
        async with seat(port) as here:
            vehicle = here.vehicle
            with pytest.raises(BridgeError, match="no autopilot was heard"):
                vehicle.command("start mission", clock_us())
            connected = await here.next(events.Connected)
            assert (connected.stack.name, connected.stack.vehicle) == (name, "plane")
            first, second = short_mission(), short_mission(legs=5)
            assert (await here.transfer(vehicle.upload(first, clock_us()))).reason == "accepted"
            read = await here.transfer(vehicle.download(clock_us()))
            assert read.items == read_back(first, name)
            vehicle.command("start mission", clock_us())
            assert (await here.next(events.CommandFinished)).accepted
            await here.at_item(2)
            assert vehicle.in_mission
            assert (await here.next(events.Position)).altitude_relative_m > 10.0

            newest = vehicle.upload(second, clock_us(), begin="keep", holds_first=True)
            result = await here.transfer(newest)
            assert (result.outcome, result.holds, result.items) == (
                "accepted",
                "the new one",
                second,
            )
            assert (vehicle.stack, vehicle.in_mission) == (connected.stack, True)
            await here.at_item(len(second) - 1)
            reached = [event.seq for event in here.seen if isinstance(event, events.ItemReached)]
            assert {1, 4} <= set(reached)
            assert len(reached) == len(set(reached))

            refused = replace(second[1], command=34)  # DO_ORBIT is no mission item
            result = await here.transfer(vehicle.upload((*second, refused), clock_us()))
            assert (result.outcome, result.seq, result.holds) == ("rejected", 7, "the old one")
            if name == "ardupilot":  # the list would be empty and the vehicle fly on
                result = await here.transfer(vehicle.clear(clock_us()))
                assert (result.outcome, result.holds) == ("rejected", "the old one")
            read = await here.transfer(vehicle.download(clock_us()))
            assert read.items == read_back(second, name)
            vehicle.command("return", clock_us())
            assert (await here.next(events.CommandFinished)).accepted
            assert (await here.transfer(vehicle.clear(clock_us()))).reason == "accepted"
            assert (await here.transfer(vehicle.download(clock_us()))).items == ()
    modes = [event.custom_mode for event in here.seen if isinstance(event, events.ModeChanged)]
    assert connected.stack.mission_mode in modes
    assert (connected.stack.hold_mode in modes) == (name == "ardupilot")  # held for the upload
    times = [event.at_us for event in here.seen]
    assert times == sorted(times)


def test_two_vehicles_fly_at_once_and_are_sent_elsewhere_in_flight() -> None:
    async def both() -> None:
        await asyncio.gather(*(flies_and_is_sent_elsewhere(name) for name in STACKS))

    run(both())


async def loses_its_link_and_gets_it_back() -> None:
    port, mission = free_port(), short_mission()
    began = 0.0
    async with seat(port) as here:
        vehicle = here.vehicle
        with mock_process(port, "px4", speedup=SPEEDUP):
            await here.next(events.Connected)
            waiting = [vehicle.upload(mission[:length], clock_us()) for length in (2, 3, 4)]
            ended = [(await here.transfer(number)).outcome for number in waiting[1:]]
            assert ended == ["superseded", "accepted"] or ended == ["accepted"] * 2
        number = vehicle.upload(mission, clock_us())
        lost = await here.next(events.LinkLost)
        assert lost.silent_us >= 3_000_000
        result = await here.transfer(number)
        assert (result.outcome, result.holds) == ("unknown", "one of both")
        assert "TIMEOUT" in result.reason
        with mock_process(port, "px4", speedup=SPEEDUP):
            await here.next(events.LinkRestored)
            assert (await here.transfer(vehicle.upload(mission, clock_us()))).holds == "the new one"
        vehicle.upload(mission, clock_us())
        await asyncio.sleep(0.2)
        began = time.monotonic()
    assert time.monotonic() - began < PATIENCE_S  # a call that is under way is waited for


def test_a_lost_link_is_told_and_taken_up_again() -> None:
    run(loses_its_link_and_gets_it_back())


async def talks_over_tcp() -> None:
    port, mission = free_port(), short_mission(legs=100)
    async with seat(port, "tcpin") as here:
        # In real time: a fast mock repeats requests so soon that a busy MAVSDK ends the transfer.
        with mock_process(port, "ardupilot", speedup=1.0, link="tcp"):
            await here.next(events.Connected)
            for _ in range(UPLOADS_TRIED):
                sent = here.vehicle.upload(mission, clock_us(), begin=2)
                if (reason := (await here.transfer(sent)).reason) == "accepted":
                    break
                assert "INVALID_SEQUENCE" in reason  # MAVSDK's word for a request that came twice
            assert reason == "accepted"
            numbers = [event.current_seq for event in here.seen if isinstance(event, PROGRESS)]
            assert numbers[-1] == 2
            read = await here.transfer(here.vehicle.download(clock_us()))
            assert read.items == read_back(mission, "ardupilot")


def test_frames_may_come_several_at_once() -> None:
    run(talks_over_tcp())


def test_a_port_in_use_is_told() -> None:
    async def twice() -> None:
        port = free_port()
        async with seat(port), seat(port):
            pass

    with pytest.raises(BridgeError, match="in use"):
        asyncio.run(twice())


@pytest.mark.parametrize(
    ("name", "said", "read", "outcome", "holds"),
    [
        ("px4", "SUCCESS", "sent", "accepted", "the new one"),
        ("px4", "TIMEOUT", "sent", "accepted", "the new one"),  # only the last answer was lost
        ("px4", "TIMEOUT", "other", "failed", "the old one"),
        ("px4", "UNSUPPORTED", "other", "rejected", "the old one"),
        ("px4", "SUCCESS", None, "unknown", "one of both"),
        ("ardupilot", "SUCCESS", "sent", "accepted", "the new one"),
        ("ardupilot", "SUCCESS", "other", "failed", "a mixture"),
        ("ardupilot", "UNSUPPORTED", "other", "rejected", "a mixture"),
        ("ardupilot", "UNSUPPORTED", None, "rejected", "not known"),
    ],
)
def test_what_mavsdk_says_is_judged_by_what_is_read_back(
    name: str, said: str, read: str | None, outcome: str, holds: str
) -> None:
    stack = stack_named(name, "plane")
    hidden = 1 if stack.item_0_is_home else 0
    mission = short_mission()
    sent = (*mission[:hidden], *mission)
    moved: tuple[MissionItem, ...] = (*sent[:-1], replace(sent[-1], x=sent[-1].x + 100))
    held = {"sent": sent, "other": moved, None: None}[read]
    shown = None if held is None else tuple(as_read_back(item, stack) for item in held)
    result = judged(stack, hidden, sent, said, shown)
    assert (result.outcome, result.holds) == (outcome, holds)


def test_a_missing_package_is_told_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mavsdk", None)
    with pytest.raises(BridgeError, match=r"pip install 'mission-service\[mavsdk\]'"):
        library.__wrapped__()


def test_orbits_and_speeds_are_refused_in_words() -> None:
    vehicle = MavsdkClient("udpin:127.0.0.1:14999", 1, clock_us)
    vehicle.command("orbit", 5, 36.0, -84.0, 500.0, 100.0)
    vehicle.command("change speed", 6, 12.0)
    for command in ("orbit", "change speed"):
        told = vehicle.next_event()
        assert isinstance(told, events.CommandFinished)
        assert (told.name, told.accepted) == (command, False)
        assert "use backend native" in told.reason
