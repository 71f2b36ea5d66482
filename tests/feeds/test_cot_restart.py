"""Many aircraft to a TAK server that ends, stays away, falls silent, or is started again."""

import asyncio
import contextlib
import re
from collections import Counter
from functools import partial
from typing import Any

import pytest

from mission_service.config.service_section import CotSection, MqttSection
from mission_service.interfaces.cot import cot_sender, tak_connections
from mission_service.interfaces.cot.cot_sender import cot_interface
from mission_service.runtime.published_states import ItemState, Mission
from mission_service.runtime.run_context import RunContext
from mission_service.runtime.state_view import StateView
from tests.feeds.background import in_background
from tests.feeds.test_cot_reports_live import TakServer
from tests.mqtt.stage import context_of, fix, scene
from tests.patience import until

NAMES = tuple(f"uas{number}" for number in range(50))
PONG = b"<event version='2.0' uid='takPong' type='t-x-c-t-r'><point lat='0' lon='0'/></event>"


def fleet() -> RunContext:
    """Return a run with 50 vehicles that have missions on board."""
    context = context_of(MqttSection(), lambda request: {})
    scenario, landscape = scene()
    vehicles = tuple(scenario.vehicles[0].model_copy(update={"name": name}) for name in NAMES)
    scenario = scenario.model_copy(update={"vehicles": vehicles})
    context.service.state_view = view = StateView(scenario, landscape, 0)
    places = ((36.3, -84.1), (36.4, -84.1))
    items = tuple(ItemState(16, "", 3, *place, 100.0, (0.0,) * 4) for place in places)
    for state in view.missions.values():
        state.on_board = Mission(1, 0, "", "accepted", "", "", items)
    return context


def fly(context: RunContext, at_us: int) -> None:
    for name in NAMES:
        context.state_view.apply(fix(at_us, name), [])


def uids_in(data: bytes | bytearray) -> list[str]:
    return re.findall(r'<event version="2.0" uid="Fire-more\.([^"]*)"', data.decode())


def test_fifty_aircraft_and_all_else_arrive_again_after_a_restart_of_the_server(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cot_sender, "MIN_WAIT_S", 0.05)
    monkeypatch.setattr(cot_sender, "MAX_WAIT_S", 0.1)
    context = fleet()
    everything = {*NAMES, *(f"{name}.mission" for name in NAMES), "fire.1"}

    async def look() -> None:
        before, after = TakServer(), TakServer()
        server = await asyncio.start_server(before.serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        settings = CotSection(url=f"tcp://127.0.0.1:{port}", every_s=0.2)
        async with in_background(cot_interface(settings, "Fire & more")(context)):
            fly(context, 1)
            await until(lambda: everything <= set(uids_in(before.received)))
            context.state_view.alarm("link/uas1", "first", "severe")
            await until(lambda: b"ALARM first" in before.received)
            server.close()
            await before.disconnect()
            await until(lambda: "cot" in context.state_view.alarms)
            context.state_view.alarm("link/uas2", "second", "severe")
            fly(context, 2)
            async with await asyncio.start_server(after.serve, "127.0.0.1", port):
                await until(lambda: everything <= set(uids_in(after.received)))
                await until(lambda: b"forecast.30" in after.received)
        await until(lambda: not after.clients)
        # The first round contains each aircraft once, and the messages of both alarms.
        assert uids_in(after.received)[:50] == list(NAMES)
        counts = Counter(re.findall(rb"ALARM \w+", bytes(after.received)))
        assert counts == {b"ALARM first": 1, b"ALARM second": 1}
        assert "cot" not in context.state_view.alarms

    asyncio.run(look())


class PingedServer(TakServer):
    """A TAK server that answers pings, as long as ``answers`` is true."""

    answers = True

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.clients.append(writer)
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(65_536):
                self.received += data
                if self.answers and b'type="t-x-c-t"' in data:
                    writer.write(PONG)
        self.clients.remove(writer)
        writer.close()


def test_a_server_that_falls_silent_is_lost_and_its_messages_are_sent_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cot_sender, "MIN_WAIT_S", 0.05)
    monkeypatch.setattr(tak_connections, "PING_S", 0.05)
    monkeypatch.setattr(tak_connections, "SILENT_S", 2.0)
    context, tak = fleet(), PingedServer()

    async def look() -> None:
        server = await asyncio.start_server(tak.serve, "127.0.0.1", 0)
        url = f"tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        settings = CotSection(url=url, every_s=0.1)
        alarms = context.state_view.alarms
        async with server, in_background(cot_interface(settings, "east")(context)):
            await until(lambda: b"mission" in tak.received)
            await asyncio.sleep(2.5)
            assert "cot" not in alarms  # a server that answers keeps its connection
            tak.answers = False
            context.state_view.alarm("link/uas1", "lost", "severe")
            await until(lambda: b"ALARM lost" in tak.received)
            await until(lambda: "cot" in alarms)
            assert "the server has sent nothing for 2 s" in alarms["cot"].text
            await until(lambda: tak.received.count(b"ALARM lost") == 2)
            await until(lambda: "cot" not in alarms)
            await asyncio.sleep(2.5)
            assert "cot" not in alarms  # a server that never answers keeps its connection
        await until(lambda: not tak.clients)

    asyncio.run(look())


def arrived(tak: TakServer, times: int) -> bool:
    return uids_in(tak.received).count("uas49") == times


def test_positions_do_not_wait_for_the_front(monkeypatch: pytest.MonkeyPatch) -> None:
    async def never(*_: Any) -> Any:
        await asyncio.Event().wait()

    monkeypatch.setattr(cot_sender, "front_now", never)
    context = fleet()

    async def look() -> None:
        tak = TakServer()
        server = await asyncio.start_server(tak.serve, "127.0.0.1", 0)
        url = f"tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        settings = CotSection(url=url, every_s=0.1)
        async with server, in_background(cot_interface(settings, "Fire & more")(context)):
            for number in range(1, 4):
                fly(context, number)
                await until(partial(arrived, tak, number))
        await until(lambda: not tak.clients)

    asyncio.run(look())
