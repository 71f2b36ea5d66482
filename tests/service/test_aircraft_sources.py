"""The sources of other aircraft in a live run, over sockets on loopback."""

import asyncio
import contextlib
import random
import socket
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from mission_service.config.scenario import Scenario, load_scenario
from mission_service.config.surveillance_section import AircraftSource, SurveillanceSection
from mission_service.errors import ScenarioError
from mission_service.interfaces.cot.cot_events import zulu
from mission_service.live import aircraft_sources
from mission_service.live.aircraft_sources import MAX_BUFFER, receive_aircraft
from mission_service.runtime.run_context import RunContext
from tests.api.worlds import SMALL, World, world_in
from tests.patience import until
from tests.service.aircraft_messages import Aircraft, cot_event, gdl90_report, sbs_lines

CRAFT = Aircraft(0xA4C2F1, 36.37, -84.13, 900.0, 40.0, -30.0)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    made = world_in(tmp_path_factory.mktemp("run"), surveyed())
    made.fly(made.context.scenario.start_s + 30.0)
    yield made
    made.context.service.recording.journal.close()


@pytest.fixture
def context(world: World, monkeypatch: pytest.MonkeyPatch) -> RunContext:
    monkeypatch.setattr(aircraft_sources, "CONNECT_S", 0.2)
    monkeypatch.setattr(aircraft_sources, "MIN_WAIT_S", 0.1)
    world.context.service.aircraft.table.tracks.clear()
    return world.context


def surveyed() -> Scenario:
    return load_scenario("demo", (*SMALL, 'surveillance.resolution="none"'))


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def section_of(form: str, port: int, silent_s: float = 30.0) -> SurveillanceSection:
    source = AircraftSource.model_validate({"format": form, "address": f"127.0.0.1:{port}"})
    return SurveillanceSection(sources=(source,), silent_s=silent_s)


@contextlib.asynccontextmanager
async def receiving(context: RunContext, section: SurveillanceSection) -> AsyncIterator[None]:
    task = asyncio.create_task(receive_aircraft(context, section))
    try:
        yield
        assert not task.done(), task.exception()
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


def alarms(context: RunContext) -> dict[str, str]:
    return {
        key: each.text
        for key, each in context.state_view.alarms.items()
        if key.startswith("surveillance/")
    }


async def serve_sbs(port: int, connected: list[asyncio.StreamWriter]) -> asyncio.Server:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connected.append(writer)
        writer.write(sbs_lines(CRAFT))

    return await asyncio.start_server(serve, "127.0.0.1", port)


def test_a_tcp_source_is_connected_again_and_alarms_end(context: RunContext) -> None:
    async def run() -> None:
        port, clients = free_port(socket.SOCK_STREAM), list[asyncio.StreamWriter]()
        async with receiving(context, section_of("sbs", port)):
            await until(lambda: alarms(context))
            (text,) = alarms(context).values()
            assert text.startswith(f"no aircraft from sbs 127.0.0.1:{port}: ")
            server = await serve_sbs(port, clients)
            table = context.service.aircraft.table
            await until(lambda: "a4c2f1" in table.tracks)
            await until(lambda: not alarms(context))
            server.close()
            clients[0].close()
            await until(lambda: alarms(context))
            server = await serve_sbs(port, clients)
            await until(lambda: not alarms(context))
            server.close()
            for client in clients:
                client.close()

    asyncio.run(run())


def test_datagrams_are_received_and_garbage_changes_nothing(context: RunContext) -> None:
    async def run() -> None:
        port, rng = free_port(socket.SOCK_DGRAM), random.Random(5)
        table = context.service.aircraft.table
        async with receiving(context, section_of("gdl90", port)):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

                def send(data: bytes) -> None:
                    sender.sendto(data, ("127.0.0.1", port))

                await asyncio.sleep(0.3)
                for _ in range(200):
                    send(rng.randbytes(rng.randint(0, 300)))
                await asyncio.sleep(0.6)
                assert not table.tracks
                send(gdl90_report(CRAFT))
                send(gdl90_report(replace(CRAFT, address=0xA00001)))
                await until(lambda: len(table.tracks) == 2)
                assert context.gauges["aircraft_tracked"]() == 2.0
                damaged = bytearray(gdl90_report(CRAFT))
                damaged[8] ^= 1
                before = context.gauges["aircraft_rejected_total"]()
                send(bytes(damaged))
                rejected = context.gauges["aircraft_rejected_total"]
                await until(lambda: rejected() == before + 1)
        assert not alarms(context)

    asyncio.run(run())


def test_stale_events_are_rejected_with_an_alarm(context: RunContext) -> None:
    async def run() -> None:
        port, table = free_port(socket.SOCK_DGRAM), context.service.aircraft.table
        async with receiving(context, section_of("cot", port)):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                await asyncio.sleep(0.3)
                now_us, old = time.time_ns() // 1000, cot_event(replace(CRAFT, address=1))
                new = cot_event(CRAFT).decode().replace("2026-08-01T12:00:00.000Z", zulu(now_us))
                new = new.replace("2026-08-01T12:00:30.000Z", zulu(now_us + 30_000_000))
                sender.sendto(old.replace(b"2026-08", b"2020-08"), ("127.0.0.1", port))
                await until(lambda: alarms(context))
                assert "s old and are not used; compare the clocks" in next(
                    iter(alarms(context).values())
                )
                sender.sendto(new.encode(), ("127.0.0.1", port))
                await until(lambda: table.tracks and not alarms(context))
                assert list(table.tracks) == ["a4c2f1"]
                assert context.gauges["aircraft_rejected_total"]() == 1.0

    asyncio.run(run())


def test_a_silent_source_raises_an_alarm(context: RunContext) -> None:
    async def run() -> None:
        port = free_port(socket.SOCK_DGRAM)
        async with receiving(context, section_of("cot", port, silent_s=0.5)):
            await until(lambda: alarms(context))
            assert list(alarms(context).values()) == [f"no data from cot 127.0.0.1:{port} for 0 s"]
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.sendto(b"<event/>", ("127.0.0.1", port))
            await until(lambda: not alarms(context))

    asyncio.run(run())


def test_too_much_data_is_discarded_with_an_alarm(context: RunContext) -> None:
    async def run() -> None:
        port = free_port(socket.SOCK_STREAM)

        async def flood(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            with contextlib.suppress(OSError):
                while True:
                    writer.write(bytes(MAX_BUFFER))
                    await writer.drain()

        server = await asyncio.start_server(flood, "127.0.0.1", port)
        async with receiving(context, section_of("beast", port)):
            await until(lambda: alarms(context))
            assert "sends more than 1024 kB/s" in next(iter(alarms(context).values()))
        server.close()

    asyncio.run(run())


def test_faulty_settings_are_refused_with_the_key(tmp_path: Path) -> None:
    for change, words in (
        ('surveillance.sources=[{format="sbs", address="127.0.0.1"}]', "write it as HOST:PORT"),
        ('surveillance.sources=[{format="sbs", address="127.0.0.1:70000"}]', "HOST:PORT"),
        ('surveillance.sources=[{format="asterix", address="127.0.0.1:1"}]', "format"),
        ('surveillance.alerts="tcas"', "surveillance.alerts"),
        ("surveillance.range_m=10", "surveillance.range_m"),
        ('surveillance.ignored=["abc"]', "surveillance.ignored"),
    ):
        with pytest.raises(ScenarioError, match=words):
            load_scenario("demo", (change,))
