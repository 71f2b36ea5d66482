"""One contract for both vehicle clients, tested with mocks of both stacks over UDP."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any, TypeVar

import pytest

from autopilot_bridge.clients.client_protocol import VehicleClient
from autopilot_bridge.clients.mavsdk import MavsdkClient
from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import Items
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.missions.transfer import TransferResult
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle import client_events as events
from tests.bridge.mock_process import free_port, mock_process, short_mission
from tests.patience import PATIENCE_S

STACKS = ("px4", "ardupilot")
BACKENDS = ("native", "mavsdk")
SPEEDUP = 10.0
PARAMETERS = {"px4": ("COM_DL_LOSS_T", 10.0), "ardupilot": ("SYSID_MYGCS", 255.0)}
Event = TypeVar("Event")


def clock_us() -> int:
    return time.monotonic_ns() // 1000


class Station:
    """The client of one vehicle on its link, with a function that waits for events."""

    def __init__(self, vehicle: VehicleClient, link: Connection | MavsdkClient) -> None:
        self.vehicle = vehicle
        self.link = link
        self.seen: list[events.ClientEvent] = []
        self._looked_at = 0

    async def next(
        self, kind: type[Event], what: Callable[[Event], bool] = lambda event: True
    ) -> Event:
        """Return the next event of a type, after the last one that was returned."""
        self.link.flush()
        async with asyncio.timeout(PATIENCE_S):
            while True:
                while (event := self.vehicle.next_event()) is not None:
                    self.seen.append(event)
                while self._looked_at < len(self.seen):
                    found = self.seen[self._looked_at]
                    self._looked_at += 1
                    if isinstance(found, kind) and what(found):
                        return found
                await self.link.wait()
                self.link.flush()

    async def transfer(self, transfer_id: int) -> TransferResult:
        ended = await self.next(
            events.TransferFinished, lambda event: event.transfer_id == transfer_id
        )
        return ended.result

    async def command(self, name: str) -> None:
        command_id = self.vehicle.command(name, clock_us())
        ended = await self.next(events.CommandFinished)
        assert (ended.name, ended.accepted, ended.command_id) == (name, True, command_id), ended

    async def in_mode(self, mode: int) -> None:
        modes = [event for event in self.seen if isinstance(event, events.ModeChanged)]
        if not modes or modes[-1].custom_mode != mode:
            await self.next(events.ModeChanged, lambda event: event.custom_mode == mode)

    async def at_item(self, seq: int) -> None:
        await self.next(events.MissionProgress, lambda event: event.current_seq == seq)


@asynccontextmanager
async def station(backend: str, port: int, link: str = "udpin") -> AsyncIterator[Station]:
    line = f"{link}:127.0.0.1:{port}"
    if backend == "mavsdk":
        async with MavsdkClient(line, 1, clock_us) as vehicle:
            yield Station(vehicle, vehicle)
    else:
        client = NativeClient()
        async with Connection(line, client, clock_us) as connection:
            yield Station(client, connection)


def run(test: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(test, 60.0))


def read_back(items: Items, name: str) -> Items:
    return tuple(as_read_back(item, stack_named(name, "plane")) for item in items)


async def flies_and_is_sent_elsewhere(backend: str, name: str) -> None:
    port = free_port()
    with mock_process(port, name, speedup=SPEEDUP):
        async with station(backend, port) as client:
            vehicle = client.vehicle
            with pytest.raises(BridgeError, match="no autopilot is connected"):
                vehicle.command("start mission", clock_us())
            with pytest.raises(BridgeError, match="unknown vehicle command"):
                vehicle.command("loop", clock_us())
            connected = await client.next(events.Connected)
            assert (connected.stack.name, connected.stack.vehicle) == (name, "plane")
            asked, value = PARAMETERS[name]
            number = vehicle.read_parameter(asked, clock_us())
            found = await client.next(events.ParametersFinished)
            assert found.request_id == number
            assert [(each.name, each.value) for each in found.result.parameters] == [(asked, value)]
            first, second = short_mission(), short_mission(legs=5)
            assert (await client.transfer(vehicle.upload(first, clock_us()))).reason == "accepted"
            read = await client.transfer(vehicle.download(clock_us()))
            assert read.items == read_back(first, name)
            await client.command("start mission")
            await client.at_item(2)
            assert (await client.next(events.Position)).altitude_relative_m > 10.0

            newest = vehicle.upload(second, clock_us(), begin="keep", holds_first=True)
            result = await client.transfer(newest)
            assert (result.outcome, result.holds) == ("accepted", "the new one")
            assert result.items == second
            assert vehicle.stack == connected.stack
            await client.in_mode(connected.stack.mission_mode)
            await client.at_item(len(second) - 1)
            reached = [event.seq for event in client.seen if isinstance(event, events.ItemReached)]
            assert {1, 4} <= set(reached)
            assert len(reached) == len(set(reached))

            refused = replace(second[1], command=34)  # DO_ORBIT is not a mission item
            result = await client.transfer(vehicle.upload((*second, refused), clock_us()))
            assert result.outcome == "rejected"
            if name == "px4" or backend == "mavsdk":  # it first checks the mission
                assert (result.seq, result.holds) == (7, "the old one")
                read = await client.transfer(vehicle.download(clock_us()))
                assert read.items == read_back(second, name)
            if name == "ardupilot" and backend == "mavsdk":  # the list would be empty
                result = await client.transfer(vehicle.clear(clock_us()))
                assert (result.outcome, result.holds) == ("rejected", "the old one")
            await client.command("hold")
            await client.in_mode(connected.stack.hold_mode)
            await client.command("return")
            await client.in_mode(connected.stack.rtl_mode)
            assert (await client.transfer(vehicle.clear(clock_us()))).outcome == "accepted"
            assert (await client.transfer(vehicle.download(clock_us()))).items == ()
    times = [event.at_us for event in client.seen]
    assert times == sorted(times)


@pytest.mark.parametrize("backend", BACKENDS)
def test_two_vehicles_fly_at_once_and_are_sent_elsewhere_in_flight(backend: str) -> None:
    async def both() -> None:
        await asyncio.gather(*(flies_and_is_sent_elsewhere(backend, name) for name in STACKS))

    run(both())


async def loses_its_link_and_gets_it_back(backend: str) -> None:
    port, mission = free_port(), short_mission()
    began = 0.0
    async with station(backend, port) as client:
        vehicle = client.vehicle
        with mock_process(port, "px4", speedup=SPEEDUP):
            await client.next(events.Connected)
            waiting = [vehicle.upload(mission[:length], clock_us()) for length in (2, 3, 4)]
            ended = [(await client.transfer(number)).outcome for number in waiting[1:]]
            assert ended == ["superseded", "accepted"] or ended == ["accepted"] * 2
        number = vehicle.upload(mission, clock_us())
        lost = await client.next(events.LinkLost)
        assert lost.silent_us >= 3_000_000
        result = await client.transfer(number)
        expected = {"native": ("failed", "not reply"), "mavsdk": ("unknown", "TIMEOUT")}
        outcome, words = expected[backend]
        assert result.outcome == outcome
        assert words in result.reason
        with mock_process(port, "px4", speedup=SPEEDUP):
            await client.next(events.LinkRestored)
            assert (
                await client.transfer(vehicle.upload(mission, clock_us()))
            ).holds == "the new one"
        vehicle.upload(mission, clock_us())
        await asyncio.sleep(0.2)
        began = time.monotonic()
    assert time.monotonic() - began < PATIENCE_S  # waits for the call in progress


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_lost_link_is_reported_and_taken_up_again(backend: str) -> None:
    run(loses_its_link_and_gets_it_back(backend))


async def has_a_remote_id_module(backend: str) -> None:
    port, found = free_port(), []
    async with station(backend, port) as client:
        with mock_process(port, "px4", speedup=SPEEDUP, faults=("remote-id-error@60",)):
            found = [await client.next(events.RemoteIdStatus) for _ in range(2)]
        found.append(await client.next(events.RemoteIdStatus))
    assert [each.state for each in found] == ["ready", "fails", "lost"]


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_state_and_the_loss_of_a_remote_id_module_are_reported(backend: str) -> None:
    run(has_a_remote_id_module(backend))


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_port_in_use_is_reported(backend: str) -> None:
    async def twice() -> None:
        port = free_port()
        async with station(backend, port), station(backend, port):
            pass

    with pytest.raises(BridgeError, match="in use"):
        asyncio.run(twice())
