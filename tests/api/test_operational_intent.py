"""Operational intents: the fields of ASTM F3548-21, and flights inside their own volumes.

The checker was written from the standard's OpenAPI description (``OperationalIntentDetails``).
"""

import asyncio
import math
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import shapely

from mission_service.events import Order, OrderGiven
from tests.api.worlds import World, client, scenario_of, served, world_in
from tests.patience import PATIENCE_S

GEOID_M = -32.5
MAX_VERTICES = 10_000  # of an operational intent: OiMaxVertices
M_PER_DEG = 111_132.0  # of latitude, near 36 degrees within 0.3 %
CHANGES = ("planner.rule=circling", "vehicles.0.endurance_s=1800", "vehicles.1.autostart=false")


@pytest.fixture
def flying(tmp_path: Path) -> World:
    """Hawk flies its circles; kite has a mission and waits for an order."""
    scenario = scenario_of("demo", CHANGES)
    world = world_in(tmp_path, scenario)
    world.fly(scenario.deploy_at_s + 200.0)
    return world


def ask(world: World, status: int = 200, **params: Any) -> Any:
    """Return the response of the route."""
    service = served(world)

    async def go() -> Any:
        async with client(service.app, headers=service.headers(), timeout=PATIENCE_S) as http:
            answer = await http.get("/api/v1/airspace/intents", params=params)
        service.app.api.context.close()
        assert answer.status_code == status, answer.text
        return answer.json()

    return asyncio.run(go())


def assert_f3548(details: dict[str, Any]) -> None:
    """Check names, types, units, ranges and orders of ``OperationalIntentDetails``."""
    assert set(details) == {"volumes", "off_nominal_volumes", "priority"}
    assert type(details["priority"]) is int
    assert details["volumes"], "an accepted intent has a volume"
    assert details["off_nominal_volumes"] == []
    vertices = 0
    for each in details["volumes"]:
        assert set(each) == {"volume", "time_start", "time_end"}
        start, end = (instant(each[name]) for name in ("time_start", "time_end"))
        assert start < end
        extent = dict(each["volume"])
        lower, upper = (height(extent.pop(f"altitude_{name}")) for name in ("lower", "upper"))
        assert lower < upper
        (kind,) = extent  # exactly one outline
        if kind == "outline_circle":
            circle = extent[kind]
            assert set(circle) == {"center", "radius"}
            place(circle["center"])
            assert set(circle["radius"]) == {"value", "units"}
            assert circle["radius"]["units"] == "M"
            assert circle["radius"]["value"] > 0.0
            vertices += 1
        else:
            assert kind == "outline_polygon"
            assert set(extent[kind]) == {"vertices"}
            corners = [place(corner) for corner in extent[kind]["vertices"]]
            assert len(corners) >= 3
            assert corners[0] != corners[-1], "the ring is closed without a repeated vertex"
            assert shapely.Polygon(corners).is_valid, "sides do not cross"
            vertices += len(corners)
    assert vertices <= MAX_VERTICES


def instant(time: dict[str, str]) -> datetime:
    assert set(time) == {"value", "format"}
    assert time["format"] == "RFC3339"
    assert time["value"].endswith("Z")
    return datetime.fromisoformat(time["value"])


def height(altitude: dict[str, Any]) -> float:
    assert set(altitude) == {"value", "reference", "units"}
    assert (altitude["reference"], altitude["units"]) == ("W84", "M")
    assert -8000 <= altitude["value"] <= 100_000
    return float(altitude["value"])


def place(point: dict[str, float]) -> tuple[float, float]:
    assert set(point) == {"lat", "lng"}
    assert -90 <= point["lat"] <= 90
    assert -180 <= point["lng"] <= 180
    return point["lng"], point["lat"]


def contains(details: dict[str, Any], world: World, name: str, spare_m: float = 0.0) -> bool:
    """Return whether a vehicle is in a volume, at least ``spare_m`` from its outline."""
    fix = world.simulation.service.state_view.telemetry[name]
    scale = M_PER_DEG * math.cos(math.radians(fix.lat_deg))

    def xy(point: dict[str, float]) -> tuple[float, float]:
        lng, lat = place(point)
        return (lng - fix.lon_deg) * scale, (lat - fix.lat_deg) * M_PER_DEG

    up_m = fix.altitude_amsl_m + GEOID_M
    for each in details["volumes"]:
        extent = each["volume"]
        inside = height(extent["altitude_lower"]) <= up_m <= height(extent["altitude_upper"])
        if "outline_circle" in extent:
            circle = extent["outline_circle"]
            away_m = math.hypot(*xy(circle["center"])) - circle["radius"]["value"]
        else:
            area = shapely.Polygon([xy(corner) for corner in extent["outline_polygon"]["vertices"]])
            at = shapely.Point(0.0, 0.0)
            away_m = -area.exterior.distance(at) if area.contains(at) else math.inf
        if inside and away_m <= -spare_m:
            return True
    return False


def order(world: World, order: Order) -> None:
    at_us = world.simulation.clock.now_us
    event = OrderGiven(at_us, "ann", "", "hawk", order)
    world.simulation.service.submit(event, world.simulation.link_us)


def test_the_volumes_have_the_fields_of_the_standard_and_state_margins_and_times(
    flying: World,
) -> None:
    before = datetime.now(UTC)
    found = ask(flying, geoid_height_m=GEOID_M, for_s=1200)
    assert found["schema"] == "operational_intents/1"
    section = flying.simulation.core.scenario.airspace
    assert found["geoid_height_m"] == GEOID_M
    assert found["margin_m"] == section.margin_m
    assert found["vertical_margin_m"] == section.vertical_margin_m
    assert [each["vehicle"] for each in found["intents"]] == ["hawk", "kite"]
    for each in found["intents"]:
        assert_f3548(each["details"])
        assert len(each["purposes"]) == len(each["details"]["volumes"])
        assert each["purposes"][-1] == "return and landing"
        assert "loiter" in each["purposes"]
    hawk, kite = (each["details"]["volumes"] for each in found["intents"])
    must_us = flying.simulation.service.state_view.vehicles["hawk"].must_land_at_us
    assert must_us is not None
    left_s = must_us / 1e6 - flying.now_s
    for volumes, flight_s in ((hawk, left_s), (kite, 1200.0)):
        for volume in volumes:
            begin, end = instant(volume["time_start"]), instant(volume["time_end"])
            assert abs((begin - before).total_seconds()) < PATIENCE_S
            expected = begin + timedelta(seconds=flight_s + section.lead_s)
            assert abs((end - expected).total_seconds()) < 0.1


def test_heights_are_moved_by_the_height_of_the_geoid(flying: World) -> None:
    def heights(geoid_m: float) -> list[tuple[float, float]]:
        details = ask(flying, geoid_height_m=geoid_m)["intents"][0]["details"]
        return [
            (height(volume["altitude_lower"]), height(volume["altitude_upper"]))
            for volume in (each["volume"] for each in details["volumes"])
        ]

    low, high = heights(-30.0), heights(10.0)
    assert low != high
    for (lower_m, upper_m), (other_lower_m, other_upper_m) in zip(low, high, strict=True):
        assert other_lower_m - lower_m == pytest.approx(40.0, abs=0.11)
        assert other_upper_m - upper_m == pytest.approx(40.0, abs=0.11)


def test_without_the_height_of_the_geoid_there_is_no_answer(flying: World) -> None:
    refused = ask(flying, 422)
    assert "geoid_height_m" in refused["error"]
    assert "geoid_height_m" in ask(flying, 422, geoid_height_m=900)["error"]


def test_a_flight_with_a_hold_a_return_and_a_landing_stays_in_its_volumes(flying: World) -> None:
    found = ask(flying, geoid_height_m=GEOID_M)["intents"][0]
    assert found["vehicle"] == "hawk"
    details = found["details"]
    assert contains(details, flying, "hawk", flying.simulation.core.scenario.airspace.margin_m)
    outside = []

    def fly(seconds: int) -> None:
        for _ in range(seconds):
            flying.fly(flying.now_s + 1.0)
            if not contains(details, flying, "hawk"):
                outside.append(flying.now_s)

    order(flying, "hold")
    fly(90)
    order(flying, "land")
    state_view = flying.simulation.service.state_view
    for _ in range(120):
        fly(10)
        if not state_view.vehicles["hawk"].armed:
            break
    assert not state_view.vehicles["hawk"].armed, "it has landed"
    assert outside == []


def test_a_vehicle_on_the_ground_without_a_mission_has_no_intent(tmp_path: Path) -> None:
    scenario = scenario_of("demo", CHANGES)
    world = world_in(tmp_path, scenario)
    assert ask(world, geoid_height_m=GEOID_M)["intents"] == []
