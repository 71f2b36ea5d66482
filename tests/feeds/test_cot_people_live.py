"""Positions of people from a TAK server, and the fire's arrival at them."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from mission_service.config.service_section import (
    CotPeopleSection,
    CotSection,
    FireArrivalSection,
)
from mission_service.interfaces.cot.people_positions import person_in
from mission_service.interfaces.cot.received_events import parse_event
from mission_service.live.fire_arrival_watch import values_of, watch_fire_arrival
from mission_service.runtime.clocks import wall_us
from tests.api.worlds import World, world_in
from tests.feeds.tak_events import NOW_US, event_text, user
from tests.feeds.test_cot_reports_live import SCENARIO, TakServer, near_fire, running
from tests.fire_arrival.test_places import written
from tests.patience import until

PEOPLE = CotPeopleSection(groups=("cyan",), roles=("TEAM MEMBER", "Team Lead"))


def position(place: tuple[object, object], uid: str = "A", group: str = "Cyan") -> bytes:
    detail = f"<contact callsign='Engine {uid}'/><__group role='Team Lead' name='{group}'/>"
    return event_text(uid, "a-f-G-U-C", place, detail, wall_us())


def test_only_positions_of_accepted_people_are_used() -> None:
    def found(data: bytes) -> object:
        event = parse_event(data)
        assert event is not None
        return person_in(event, PEOPLE, NOW_US + 1)

    hope = found(user())
    assert hope is not None
    assert hope.name == "HOPE"  # type: ignore[attr-defined]
    assert found(user(group="Blue")) is None
    assert found(user(role="K9")) is None
    assert found(position((0.0, 0.0))) is None  # a device without a fix
    ahead = found(user(at_us=NOW_US + 90_000_000))
    assert ahead is not None
    assert ahead.at_unix_us == NOW_US + 1  # type: ignore[attr-defined]


@pytest.fixture
def world(tmp_path: Path) -> Iterator[World]:
    found = world_in(tmp_path, SCENARIO)
    found.fly(1500.0)
    yield found
    found.context.close()
    found.simulation.service.recording.journal.close()


def test_an_alarm_is_raised_for_a_person_near_the_fire(world: World) -> None:
    near, far = near_fire(world, 4.0), near_fire(world, 900.0)
    view = world.context.state_view
    section = FireArrivalSection(every_s=5.0)
    settings = CotSection(url="tcp://127.0.0.1:1", every_s=0.1, people=PEOPLE)

    async def look() -> None:
        tak = TakServer()
        server = await asyncio.start_server(tak.serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        url = f"tcp://127.0.0.1:{port}"
        async with server, running(world, url, settings):
            await until(lambda: tak.clients)
            await tak.send(position(near, "A"), position(far, "B"), position(near, "C", "Red"))
            await until(lambda: len(world.context.people.current(wall_us())) == 2)
            watch = asyncio.create_task(watch_fire_arrival(world.context, section, []))
            await until(lambda: world.context.arrivals)
            await until(lambda: b"ALARM Engine A" in tak.received)
            await until(lambda: b"forecast.30" in tak.received)
            watch.cancel()
            await asyncio.wait([watch])

    asyncio.run(look())
    (arrival,) = world.context.arrivals  # the other person is off the landscape
    assert (arrival.name, arrival.kind) == ("Engine A", "person")
    assert arrival.early_at_us is not None
    assert arrival.early_at_us < arrival.at_us + 3600e6
    alarm = view.alarms["fire_arrival/person/A"]
    assert alarm.text.startswith("Engine A: ")
    assert view.changed["fire_arrivals"] > 0


def test_values_at_risk_are_watched_without_tak(world: World, tmp_path: Path) -> None:
    land = world.context.landscape
    row, col = land.row_col_of(*land.xy_of_lat_lon(*near_fire(world, 5.0)))
    path = written(
        tmp_path / "roads.geojson",
        ("Mill Road", "LineString", [(float(row), float(col) - 3), (float(row), float(col) + 3)]),
        land=land,
    )
    section = FireArrivalSection(values=(path,), every_s=5.0)

    async def look() -> None:
        values = values_of(section, land)
        watch = asyncio.create_task(watch_fire_arrival(world.context, section, values))
        await until(lambda: world.context.arrivals)
        watch.cancel()
        await asyncio.wait([watch])

    asyncio.run(look())
    assert [each.name for each in world.context.arrivals] == ["Mill Road"]
    assert "fire_arrival/value/roads/1" in world.context.state_view.alarms
