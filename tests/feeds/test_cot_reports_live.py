"""Reports from TAK in a run: a TAK server, a multicast group, lost connections, and the journal."""

import asyncio
import contextlib
import socket
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
import takproto

from mission_service.config.scenario import load_scenario
from mission_service.config.service_section import CotReportsSection, CotSection
from mission_service.events import FireObserved
from mission_service.interfaces.cot import cot_sender, event_receiver
from mission_service.interfaces.cot.cot_sender import cot_interface
from mission_service.interfaces.cot.tak_connections import joined_group
from mission_service.journal.snapshot import Known, copied
from mission_service.replay.verification import verify
from mission_service.runtime.clocks import wall_us
from mission_service.runtime.observation_sources import (
    MAX_DIGESTS,
    ObservationSources,
    report_digest,
)
from tests.api.worlds import World, world_in
from tests.feeds.background import in_background
from tests.feeds.tak_events import HOPE, event_text, marker, shape, user
from tests.patience import until

SCENARIO = load_scenario("default", ("start_s=1380", "deploy_at_s=1380", "planner.rule=circling"))
REPORTS = CotReportsSection(groups=("Cyan",), roles=("Team Member",))
SETTINGS = CotSection(url="tcp://127.0.0.1:8087", every_s=0.1, reports=REPORTS)


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    """Return a flight without a simulated fire, 23 minutes after ignition."""
    scenario = SCENARIO.model_copy(update={"simulation": type(SCENARIO.simulation)()})
    found = world_in(tmp_path, scenario)
    found.fly(1385.0)
    yield found
    found.simulation.service.recording.journal.close()


class TakServer:
    """A TAK server: it sends events to its clients in small parts, and receives theirs."""

    def __init__(self) -> None:
        self.clients: list[asyncio.StreamWriter] = []
        self.received = bytearray()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.clients.append(writer)
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(65_536):
                self.received += data
        self.clients.remove(writer)
        writer.close()

    async def send(self, *events: bytes) -> None:
        data = b"".join(events)
        for start in range(0, len(data), 97):
            for client in self.clients:
                client.write(data[start : start + 97])
            await asyncio.sleep(0)

    async def disconnect(self) -> None:
        for client in self.clients:
            client.close()
        await until(lambda: not self.clients)


@asynccontextmanager
async def running(world: World, url: str, settings: CotSection = SETTINGS) -> AsyncIterator[None]:
    settings = settings.model_copy(update={"url": url})
    run_interface = cot_interface(settings, world.context.scenario.name)
    async with in_background(run_interface(world.context)):
        yield


@asynccontextmanager
async def connected(world: World) -> AsyncIterator[TakServer]:
    tak = TakServer()
    server = await asyncio.start_server(tak.serve, "127.0.0.1", 0)
    url = f"tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}"
    async with server, running(world, url):
        await until(lambda: tak.clients)
        yield tak


def lines(world: World) -> list[str]:
    return [each.text for each in world.context.state_view.announcements if each.vehicle == "cot"]


def reports(world: World) -> list[FireObserved]:
    return [each for each in world.submitted if isinstance(each, FireObserved)]


def near_fire(world: World, rows_north: float = 3.0) -> tuple[float, float]:
    """Return an unburned place north of the northernmost burned cell."""
    landscape, burned = world.simulation.estimate.landscape, world.simulation.estimate.fire.burned()
    row, col = next(zip(*burned.nonzero(), strict=True))
    lat_deg, lon_deg = landscape.lat_lon_of(*landscape.xy_of(float(row) - rows_north, float(col)))
    return round(float(lat_deg), 7), round(float(lon_deg), 7)


def area_ha(world: World) -> float:
    world.simulation.estimate.advance(world.simulation.clock.now_us)
    return float(world.simulation.estimate.fire.burned_ha)


def test_reports_of_a_tak_server_reach_the_estimate_once(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cot_sender, "MIN_WAIT_S", 0.01)
    place, before_ha = near_fire(world), area_ha(world)
    outside = marker("burned", "out", (0.0, 0.0), at_us=wall_us())
    other = user("ANDROID-2", "FAITH", "Blue", at_us=wall_us())
    of_other = marker("burned", "m2", place, "ANDROID-2", at_us=wall_us())

    def burning() -> bytes:
        return marker("Burning 1", "m1", place, at_us=wall_us())

    async def look() -> None:
        async with connected(world) as tak:
            await tak.send(b"\x00garbage", user(at_us=wall_us()), other, of_other, outside)
            for _ in range(3):
                await tak.send(burning(), of_other, outside)
            await until(lambda: reports(world) and len(lines(world)) == 2)
            assert len(tak.received) > 0  # the service still sends
            await tak.disconnect()
            await until(lambda: tak.clients)
            await tak.send(burning(), of_other, outside, user(at_us=wall_us()))
            line = shape([place, near_fire(world, 5.0)], "burned", at_us=wall_us())
            await tak.send(line)
            await until(lambda: len(reports(world)) == 2)
        assert len(lines(world)) == 2
        assert "cot" not in world.context.state_view.alarms

    asyncio.run(look())
    point, line = reports(world)
    assert (point.by, point.station, point.source) == ("cot:HOPE", f"cot:{HOPE}", "")
    assert (point.role, point.may_approve) == ("", False)
    assert (point.state, point.shape, point.points) == ("burning", "points", (place,))
    assert (point.position_sd_m, point.false_alarms, point.missed) == (25.0, 0.05, 0.05)
    assert 0 <= point.at_us - point.seen_at_us < 600_000_000
    assert (line.shape, len(line.points)) == ("line", 2)
    assert area_ha(world) > before_ha
    of_faith, outside_line = lines(world)
    assert of_faith == (
        "a TAK report is not used: burned from HOPE: its creator is in the group Blue, "
        "which is not listed in `groups`"
    )
    assert outside_line.startswith("a TAK report is not used: burned from HOPE: observe: 0, 0 is")
    (source,) = [each for each in world.context.state_view.sources() if "cot:" in each.source]
    assert (source.source, source.kind) == (f"cot:HOPE at cot:{HOPE}", "person")
    assert verify(world.context.journal_path).difference is None


def test_an_unburned_area_of_one_person_changes_nothing_until_it_is_confirmed(
    world: World,
) -> None:
    before_ha = area_ha(world)
    lat_deg, lon_deg = near_fire(world, 0.0)
    area = [
        (lat_deg + north, lon_deg + east)
        for north, east in (
            (0.01, -0.01),
            (0.01, 0.01),
            (-0.02, 0.01),
            (-0.02, -0.01),
            (0.01, -0.01),
        )
    ]

    def drawn(uid: str, creator: str) -> bytes:
        found = shape(area, "unburned", uid=uid, at_us=wall_us())
        return found.replace(HOPE.encode(), creator.encode())

    async def look() -> None:
        async with connected(world) as tak:
            await tak.send(user(at_us=wall_us()), drawn("a", HOPE))
            await until(lambda: len(reports(world)) == 1)
            assert area_ha(world) == before_ha
            await tak.send(drawn("a", HOPE))  # again: no confirmation
            await tak.send(user("ANDROID-2", "FAITH", at_us=wall_us()), drawn("b", "ANDROID-2"))
            await until(lambda: len(reports(world)) == 2)
            assert area_ha(world) < before_ha

    asyncio.run(look())


def test_a_restart_keeps_the_digests_of_reports(world: World) -> None:
    points = ((36.36, -84.15),)
    sent = FireObserved(0, "cot:HOPE", "cot:1", "burned", "points", points, 0, 25.0, 0.05, "")
    landscape = world.simulation.estimate.landscape
    sources = ObservationSources(landscape, (), 0)
    digest = report_digest("cot:1", "burned", "points", points)
    assert not sources.has_report(digest)
    sources.apply(sent)
    restored = copied({"sources": sources}, Known(SCENARIO, landscape))["sources"]
    assert restored.has_report(digest)
    for number in range(MAX_DIGESTS):
        sources.apply(msgspec.structs.replace(sent, station=f"cot:{number + 10}"))
    assert not sources.has_report(digest)
    assert restored.has_report(digest)
    assert not sources.has_report(report_digest("cot:2", "burned", "points", points))


def test_events_of_a_multicast_group_are_read_as_xml_and_as_protobuf(world: World) -> None:
    group = "239.2.3.1"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        try:
            joined_group((group, port), socket.AF_INET).close()
            client.sendto(b"", (group, port))
        except OSError as error:
            pytest.skip(f"this machine has no route to a multicast group: {error}")
        place = near_fire(world)

        async def look() -> None:
            async with running(world, f"udp://{group}:{port}"):

                def sent_and_received() -> bool:
                    for data in (
                        b"\xbf\x01\xbf\xff",
                        bytes(takproto.xml2proto(user(at_us=wall_us()))),
                        marker("burning", "m1", place, at_us=wall_us()),
                    ):
                        client.sendto(data, (group, port))
                    return bool(reports(world))

                await until(sent_and_received)

        asyncio.run(look())
    assert [each.by for each in reports(world)] == ["cot:HOPE"]
    assert [line for line in lines(world) if "TAK protocol 1" in line] == lines(world) != []


def test_a_flood_is_read_slowly_and_announced_with_few_lines(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    slept: list[float] = []

    async def no_sleep(seconds: float) -> None:
        slept.append(seconds)

    now_us = [10_000_000]
    monkeypatch.setattr(event_receiver, "clock_us", lambda: now_us[0])
    monkeypatch.setattr(event_receiver, "asyncio", SimpleNamespace(sleep=no_sleep))
    receiver = event_receiver.EventReceiver(world.context, SETTINGS, "site")

    async def flood(events: Callable[[int], bytes], count: int) -> None:
        for number in range(count):
            await receiver.receive(events(number))

    flooded = 2 * round(event_receiver.EVENTS_AT_ONCE)
    asyncio.run(flood(lambda number: user(f"u{number}", group=f"G{number}"), flooded))
    assert sum(each > 0.0 for each in slept) == flooded - event_receiver.EVENTS_AT_ONCE
    asyncio.run(flood(lambda number: marker(uid=f"m{number}", creator="u1999"), 300))
    asyncio.run(flood(lambda number: b"<event>%d" % number, 300))
    assert len(lines(world)) == event_receiver.LINES_AT_ONCE
    now_us[0] += 11_000_000
    asyncio.run(flood(lambda number: marker(uid="last", creator="u1999"), 1))
    assert lines(world)[-1].endswith("(281 more lines omitted)")
    assert reports(world) == []


def test_an_event_does_not_hold_the_event_loop(world: World) -> None:
    receiver = event_receiver.EventReceiver(world.context, SETTINGS, "site")
    largest = shape([(36.0 + number * 1e-6, -84.0) for number in range(1000)], at_us=wall_us())
    long_ = event_text("x", "a-u-G", (1, 2), "<a>" * 9_000 + "</a>" * 9_000, wall_us())

    async def look() -> None:
        for data in (user(at_us=wall_us()), largest, long_):
            started_s = time.process_time()
            await receiver.receive(data)
            assert time.process_time() - started_s < 1.0  # usually 0.02 s

    asyncio.run(look())


def test_a_burn_takes_no_reports(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    burn: Any = SimpleNamespace(name="b", burn_flown=object())
    monkeypatch.setattr(world.context, "scenario", burn)

    async def look() -> None:
        async with connected(world) as tak:
            await tak.send(user(at_us=wall_us()), marker(place=near_fire(world), at_us=wall_us()))
            await until(lambda: len(tak.received) > 1000)

    asyncio.run(look())
    assert reports(world) == []
    assert lines(world) == [
        "reports from TAK are not used: a burn uses cameras and corrections only"
    ]
