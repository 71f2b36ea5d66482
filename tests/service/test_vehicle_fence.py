"""The fence of an autopilot from the airspace of a scenario, and the option --fence of plan."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from click.testing import CliRunner
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from shapely.geometry.base import BaseGeometry

from autopilot_bridge.items import Items
from autopilot_bridge.missions.check import check
from autopilot_bridge.missions.fence_file import fence_json
from autopilot_bridge.missions.plan_file import read_any
from autopilot_bridge.stacks.stacks import stack_named
from firemodel.landscape.landscape import Landscape
from mission_service.airspace.vehicle_fence import VehicleFence, fence_for
from mission_service.airspace.volumes import volumes_of
from mission_service.cli.main import main
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.fire.scenario_fire import landscape_of

AROUND = ((36.30, -84.25), (36.45, -84.25), (36.45, -84.05), (36.30, -84.05))
SQUARE = ((36.350, -84.170), (36.360, -84.170), (36.360, -84.160), (36.350, -84.160))
CIRCLE: dict[str, Any] = {"name": "tower", "lat_deg": 36.34, "lon_deg": -84.12, "radius_m": 400.0}
BETWEEN = {"lat_deg": 36.3665, "lon_deg": -84.1365}  # on the way to the fire
HOME = {"lat_deg": 36.370784, "lon_deg": -84.132309}
# The loiter of the landing in a wind from the southwest.
LANDING = {"lat_deg": 36.3630543, "lon_deg": -84.1370336, "radius_m": 80.0}
FROM_SOUTHWEST = "weather.0.wind_from_deg=225"
STAR = tuple(
    (36.34 + size * math.cos(i / 16), -84.18 + size * math.sin(i / 16))
    for i, size in enumerate((0.001, 0.002) * 50)
)
FENCE = mavlink.MAV_MISSION_TYPE_FENCE
RANGE: dict[str, Any] = {"name": "range", "corners": SQUARE}


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("demo"))


def toml(volume: dict[str, Any]) -> str:
    """Return an inline table."""
    written = {
        key: json.dumps([list(each) for each in value]) if key == "corners" else json.dumps(value)
        for key, value in volume.items()
    }
    return "{" + ", ".join(f"{key} = {value}" for key, value in written.items()) + "}"


def overrides(*closed: dict[str, Any], allowed: tuple[dict[str, Any], ...] = ()) -> tuple[str, ...]:
    tables = {"closed": closed, "allowed": allowed}
    return tuple(
        f"airspace.{key}=[{', '.join(map(toml, volumes))}]"
        for key, volumes in tables.items()
        if volumes
    )


def fence_of(scenario: Scenario, land: Landscape) -> VehicleFence:
    return fence_for(scenario.vehicles[0], scenario, land)


def outside_of(fence: Items, land: Landscape) -> BaseGeometry:
    """Return the area (x, y in metres) that a fence closes within ``AROUND``."""
    content = fence_json(fence)
    polygons: dict[bool, list[BaseGeometry]] = {True: [], False: []}
    for each in content["polygons"]:
        polygons[each["inclusion"]].append(shapely.Polygon(land.xy_of_places(each["polygon"])))
    for each in content["circles"]:
        centre_m = land.xy_of_lat_lon(*each["circle"]["center"])
        ring = shapely.Point(centre_m).buffer(each["circle"]["radius"])
        polygons[each["inclusion"]].append(ring)
    closed = shapely.union_all(polygons[False])
    if polygons[True]:
        around = shapely.Polygon(land.xy_of_places(AROUND))
        closed = closed.union(around.difference(shapely.union_all(polygons[True])))
    return closed


def test_the_fence_closes_what_the_service_closes(land: Landscape) -> None:
    area = {"name": "area", "corners": (*AROUND[:3], (36.33, -84.10))}
    scenario = load_scenario("demo", overrides(RANGE, CIRCLE, allowed=(area,)))
    found = fence_of(scenario, land)
    assert not found.left_out
    closed = outside_of(found.items, land)
    volumes = volumes_of(scenario.airspace, land)
    places = np.random.default_rng(4).uniform((36.31, -84.24), (36.44, -84.06), (500, 2))
    inside = 0
    for lat_deg, lon_deg in places:
        x_m, y_m = land.xy_of_lat_lon(float(lat_deg), float(lon_deg))
        if shapely.distance(closed.boundary, shapely.Point(x_m, y_m)) < 5.0:
            continue  # circles of the service are polygons around them
        is_closed = any(volume.contains(x_m, y_m, 500.0) for volume in volumes)
        assert shapely.intersects_xy(closed, x_m, y_m) == is_closed
        inside += is_closed
    assert 50 < inside < 450


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        ({"from_s": 5000.0}, "not closed for the whole run"),
        ({"until_s": 5000.0}, "not closed for the whole run"),
        ({"floor_agl_m": 100.0}, "its floor is above the ground"),
        ({"ceiling_agl_m": 50.0}, "its ceiling is below"),
        ({"floor_amsl_m": -50.0, "ceiling_amsl_m": 3000.0}, ""),
    ],
)
def test_volumes_that_the_vehicle_may_fly_in_are_left_out(
    land: Landscape, limits: dict[str, float], reason: str
) -> None:
    scenario = load_scenario("demo", overrides(CIRCLE, RANGE | limits))
    found = fence_of(scenario, land)
    assert len(found.items) == (1 if reason else 5)
    assert [line.partition(": ")[0] for line in found.left_out] == (["range"] if reason else [])
    assert reason in "".join(found.left_out)


def test_allowed_areas_that_are_apart_are_left_out(land: Landscape) -> None:
    home = {"name": "home", "corners": AROUND}
    hole = {"name": "far", "lat_deg": 36.60, "lon_deg": -84.12, "radius_m": 300.0}
    found = fence_of(load_scenario("demo", overrides(RANGE, allowed=(home, hole))), land)
    assert len(found.items) == 4
    assert found.left_out == ("allowed areas: they are not connected",)


def test_a_volume_with_a_hole_is_left_out_and_loops_are_all_closed(land: Landscape) -> None:
    (south, west), (north, east) = SQUARE[0], SQUARE[2]
    inner = ((35.9, -84.5), (36.7, -84.5), (36.7, -83.8), (35.9, -83.8))  # around the home
    outer = ((35.8, -84.6), (36.8, -84.6), (36.8, -83.7), (35.8, -83.7))
    keyhole = {"name": "ring", "corners": (*outer, outer[0], inner[0], *inner[::-1])}
    bow = {"name": "bow", "corners": ((south, west), (north, east), (north, west), (south, east))}
    found = fence_of(load_scenario("demo", overrides(keyhole, bow)), land)
    assert found.left_out == ("ring: its outline has a hole",)
    (volume,) = volumes_of(load_scenario("demo", overrides(bow)).airspace, land)
    closed = outside_of(found.items, land)
    assert shapely.area(shapely.symmetric_difference(closed, volume.area_m)) < 20.0  # of 1 km²


def test_allowed_areas_become_one_circle_or_one_polygon(land: Landscape) -> None:
    circle = {"name": "circle", "lat_deg": 36.37, "lon_deg": -84.13, "radius_m": 9000.0}
    alone = fence_of(load_scenario("demo", overrides(allowed=(circle,))), land)
    assert [item.param1 for item in alone.items] == [9000.0]
    area = {"name": "area", "corners": AROUND}
    both = fence_of(load_scenario("demo", overrides(allowed=(circle, area))), land)
    assert {item.command for item in both.items} == {
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    }


@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_a_plan_with_a_fence_is_accepted_and_its_mission_stays_inside(
    tmp_path: Path, land: Landscape, stack: str
) -> None:
    path = tmp_path / "first.plan"
    keys = (*overrides(RANGE, CIRCLE), f'vehicles.0.stack="{stack}"')
    sets = [word for key in keys for word in ("--set", key)]
    result = CliRunner().invoke(main, ["plan", "demo", "-o", str(path), "--fence", *sets])
    assert result.exit_code == 0, result.output
    assert "a fence of 5 items" in result.output
    plan = read_any(path)
    assert not check(plan.fence, stack_named(stack, "plane"), FENCE)
    closed = outside_of(plan.fence, land)
    assert plan.home is not None
    places = [plan.home[:2]]
    places += [(item.x / 1e7, item.y / 1e7) for item in plan.mission if item.x and item.y]
    assert not closed.intersects(shapely.LineString(land.xy_of_places(places)))


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ((), "the scenario closes no airspace"),
        (overrides(RANGE | {"until_s": 5000.0}), "range: it is not closed for the whole run"),
        (overrides(CIRCLE | BETWEEN), "would enter the closed volume 'tower'"),
        (overrides(CIRCLE | HOME | {"ceiling_agl_m": 60.0}), "would enter the closed volume"),
        ((*overrides(CIRCLE | LANDING), FROM_SOUTHWEST), "would enter the closed volume 'tower'"),
        (overrides({"name": "star", "corners": STAR}), "64"),
    ],
)
def test_a_plan_without_a_fence_is_refused(
    tmp_path: Path, more: tuple[str, ...], words: str
) -> None:
    path = tmp_path / "first.plan"
    sets = [word for key in more for word in ("--set", key)]
    result = CliRunner().invoke(main, ["plan", "demo", "-o", str(path), "--fence", *sets])
    assert result.exit_code != 0
    assert words in str(result.exception) + result.output
    assert not path.exists()


def test_a_plan_may_begin_within_the_margin_of_a_volume(tmp_path: Path) -> None:
    path = tmp_path / "first.plan"
    behind = {"name": "behind", "lat_deg": 36.3717, "lon_deg": -84.1312, "radius_m": 90.0}
    sets = [word for key in overrides(behind) for word in ("--set", key)]
    result = CliRunner().invoke(main, ["plan", "demo", "-o", str(path), "--fence", *sets])
    assert result.exit_code == 0, result.output
