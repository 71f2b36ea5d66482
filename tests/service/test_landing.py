"""The landing at the end of a PX4 plane's missions."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autopilot_bridge.items import MissionItem
from autopilot_bridge.missions.check import check
from autopilot_bridge.missions.plan_file import read_any
from autopilot_bridge.stacks.stacks import stack_named
from firemodel.landscape.landscape import Landscape
from mission_service.commands import UploadMission
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError
from mission_service.events import Telemetry
from mission_service.fire.scenario_fire import landscape_of, weather_of
from mission_service.journal.journal_file import SegmentReader
from mission_service.missions.landing import (
    APPROACH_HEIGHTS_M,
    GLIDE_DEG,
    LAND_START,
    NOTHING,
    Landing,
    approach_of,
    landing_in_wind,
    needs_landing,
)
from mission_service.missions.landing_mission import landing_mission
from mission_service.simulation.demo import write_plan
from mission_service.simulation.sim import simulate

CELL_M = 30.0
SHAPE = (201, 201)
X, Y = np.meshgrid(np.arange(201) * CELL_M, np.arange(200, -1, -1) * CELL_M)
HOME_M = (3000.0, 3000.0)
FW_LND_ANG_DEG = 5.0  # PX4's default


def land(elevation_m: float | np.ndarray) -> Landscape:
    return Landscape(
        fuel_model=np.full(SHAPE, 1, np.int16),
        cell_size_m=CELL_M,
        west_m=500_000.0 - CELL_M / 2,
        north_m=4_000_000.0 + 200.5 * CELL_M,
        crs="EPSG:32616",
        elevation_m=np.broadcast_to(np.asarray(elevation_m, np.float32), SHAPE).copy(),
    )


FLAT = land(300.0)


def section(**more: object) -> VehicleSection:
    lat, lon = FLAT.lat_lon_of(500_000.0 + HOME_M[0], 4_000_000.0 + HOME_M[1])
    home = {"home_lat_deg": float(lat), "home_lon_deg": float(lon)}
    return VehicleSection.model_validate({"name": "a", **home, **more})


def xy_of_home(plane: VehicleSection, landscape: Landscape) -> tuple[float, float]:
    """Return the position (x, y) of a vehicle's home."""
    return landscape.xy_of_lat_lon(plane.home_lat_deg, plane.home_lon_deg)


def landing_of(
    plane: VehicleSection, landscape: Landscape, wind: tuple[float, float]
) -> tuple[MissionItem, ...]:
    """Return the items of a landing at the end of a mission."""
    _, items = landing_in_wind(plane, landscape, wind, NOTHING)
    return (LAND_START, *items)


def course_deg(landscape: Landscape, plane: VehicleSection, wind_from_deg: float) -> float:
    """Return the course of the tangent from the loiter to the touchdown point."""
    _, loiter, *_, touchdown = landing_of(plane, landscape, (5.0, wind_from_deg))
    (x0, y0), (x1, y1) = (
        landscape.xy_of_lat_lon(item.x / 1e7, item.y / 1e7) for item in (loiter, touchdown)
    )
    bearing = math.degrees(math.atan2(x1 - x0, y1 - y0))
    # The centre of a clockwise loiter is to the right of the tangent on which it is left.
    return (bearing + math.degrees(math.asin(90.0 / math.hypot(x1 - x0, y1 - y0)))) % 360.0


@pytest.mark.parametrize("wind_from_deg", [1.0, 45.0, 200.0, 330.0])
def test_on_even_ground_it_lands_into_the_wind(wind_from_deg: float) -> None:
    assert course_deg(FLAT, section(), wind_from_deg) == pytest.approx(wind_from_deg, abs=0.1)


def test_px4_takes_every_item_and_the_glide() -> None:
    items = landing_of(section(), FLAT, (5.0, 270.0))
    assert check(items, stack_named("px4", "plane")) == []
    _, loiter, *_, touchdown = items
    centre, home = (FLAT.xy_of_lat_lon(i.x / 1e7, i.y / 1e7) for i in (loiter, touchdown))
    distance_m = math.dist(centre, home)
    glide_m = math.sqrt(distance_m**2 - loiter.param2**2)
    assert 0.0 < (loiter.z - touchdown.z) / glide_m < math.tan(math.radians(FW_LND_ANG_DEG))


@pytest.mark.parametrize(
    ("wind_m_s", "short_m"), [(0.0, 61.0), (2.0, 52.0), (6.0, 33.5), (10.0, 13.5), (14.0, 13.5)]
)
def test_the_landing_is_short_of_home_by_the_distance_that_px4_flies_beyond_it(
    wind_m_s: float, short_m: float
) -> None:
    # PX4 lands at its minimum airspeed (10 m/s), but not slower over the ground than 5 m/s.
    wind, plane = (wind_m_s, 30.0), section(airspeed_m_s=15.0)
    *_, touchdown = landing_of(plane, FLAT, wind)
    x_m, y_m = FLAT.xy_of_lat_lon(touchdown.x / 1e7, touchdown.y / 1e7)
    home_m = FLAT.xy_of_lat_lon(section().home_lat_deg, section().home_lon_deg)
    course = math.radians(30.0)
    east_m, north_m = home_m[0] - x_m, home_m[1] - y_m
    assert east_m == pytest.approx(short_m * math.sin(course), abs=0.2)
    assert north_m == pytest.approx(short_m * math.cos(course), abs=0.2)
    only_landing = landing_mission(plane, FLAT, wind, home_m)
    assert only_landing.items[only_landing.final_seq] == touchdown


@pytest.mark.parametrize("ridge_m", range(700, 1000, 20))
def test_the_loiter_clears_the_terrain_where_it_is_flown(ridge_m: int) -> None:
    """The landing item is short of home, and the loiter as far behind the one of a glide home."""
    ridge = land(np.where(HOME_M[0] - ridge_m > X, 500.0, 300.0))
    plane = section(landing_course_deg=90.0)
    try:
        found = approach_of(plane, ridge, (0.0, 90.0))
    except ScenarioError:
        return
    turns = np.linspace(0.0, math.tau, 90)
    circle = plane.loiter_radius_m * np.column_stack([np.cos(turns), np.sin(turns)])
    around = found.centre_m + circle
    ground_m = ridge.elevation_at(around[:, 0], around[:, 1])
    assert ground_m.max() - 300.0 <= found.height_m - 30.0


def test_the_landing_planned_before_remains_if_the_wind_permits_no_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scenario = load_scenario("demo")
    vehicle, terrain = scenario.vehicles[0], landscape_of(scenario)
    landing = Landing(scenario, vehicle, terrain)
    before = landing.items_at(scenario.start_s), landing.approach_at(scenario.start_s)
    assert before[0]
    row, col = map(round, terrain.row_col_of(*xy_of_home(vehicle, terrain)))
    bowl = np.full(terrain.shape, 1000.0, np.float32)
    bowl[row - 1 : row + 2, col - 1 : col + 2] = 0.0
    monkeypatch.setattr(landing, "_landscape", replace(terrain, elevation_m=bowl))
    monkeypatch.setattr(landing, "wind_at", lambda at_s: (3.0, 90.0 + at_s))
    for at_s in (scenario.start_s + 1.0, scenario.start_s + 2.0):
        assert (landing.items_at(at_s), landing.approach_at(at_s)) == before


def test_a_faster_plane_flies_no_farther_beyond_its_landing_point() -> None:
    at_15, at_25 = (
        landing_of(section(airspeed_m_s=v), FLAT, (0.0, 30.0))[-1] for v in (15.0, 25.0)
    )
    assert (at_15.x, at_15.y) == (at_25.x, at_25.y)


def test_waypoints_on_the_glide_precede_px4s_landing_item() -> None:
    """In a return PX4 1.17 takes the setpoint before the item before the landing as its start.

    With the loiter directly before the landing this is a place far from the approach.
    """
    plane = section()
    _, loiter, first, second, touchdown = landing_of(plane, FLAT, (5.0, 30.0))
    assert (first.command, second.command) == (16, 16)
    places = [FLAT.xy_of_lat_lon(i.x / 1e7, i.y / 1e7) for i in (loiter, first, second, touchdown)]
    centre, *line = places
    slope = math.tan(math.radians(GLIDE_DEG))
    for item, place in zip((first, second), line, strict=False):
        left_m = math.dist(place, line[-1])
        assert item.z == pytest.approx(slope * left_m, abs=0.1)
        assert item.z > 30.0
        bearing = math.degrees(math.atan2(line[-1][0] - place[0], line[-1][1] - place[1]))
        assert bearing == pytest.approx(30.0, abs=0.1)
        # The plane leaves the loiter along the tangent that leads to these waypoints.
        assert math.dist(centre, place) > plane.loiter_radius_m + 1.0
    assert check(landing_of(plane, FLAT, (5.0, 30.0)), stack_named("px4", "plane")) == []


def test_a_hill_on_the_approach_turns_it_aside() -> None:
    # There is a ridge to the west, 200 m high at distances above 500 m: course 90 passes over it.
    ridge = land(np.where(HOME_M[0] - 500.0 > X, 500.0, 300.0))
    course = course_deg(ridge, section(), 90.0)
    assert abs((course - 90.0 + 180.0) % 360.0 - 180.0) > 20.0
    _, loiter, *_ = landing_of(section(), ridge, (5.0, 90.0))
    x_m, y_m = ridge.xy_of_lat_lon(loiter.x / 1e7, loiter.y / 1e7)
    turns = np.linspace(0.0, math.tau, 180)
    around = ridge.elevation_at(x_m + 90 * np.cos(turns), y_m + 90 * np.sin(turns))
    assert float(around.max()) <= 300.0 + loiter.z - 30.0


def test_low_hills_need_a_higher_approach() -> None:
    hills = land(np.where(np.hypot(X - HOME_M[0], Y - HOME_M[1]) > 700.0, 322.0, 300.0))
    _, loiter, *_ = landing_of(section(), hills, (5.0, 90.0))
    assert loiter.z > APPROACH_HEIGHTS_M[0]


def test_a_bowl_has_no_approach() -> None:
    bowl = land(np.where(np.hypot(X - HOME_M[0], Y - HOME_M[1]) > 450.0, 600.0, 300.0))
    with pytest.raises(ScenarioError, match="no landing approach to home in any direction"):
        landing_of(section(), bowl, (5.0, 90.0))


def test_a_given_course_is_kept_or_refused() -> None:
    plane = section(landing_course_deg=10.0)
    assert course_deg(FLAT, plane, 90.0) == pytest.approx(10.0, abs=0.1)
    wall = land(np.where(HOME_M[1] - 500.0 > Y, 500.0, 300.0))
    with pytest.raises(ScenarioError, match="landing_course_deg = 10"):
        landing_of(plane, wall, (5.0, 90.0))


def test_only_px4_planes_need_one() -> None:
    assert needs_landing(section())
    assert not needs_landing(section(landing=False))
    assert not needs_landing(section(kind="copter"))
    assert not needs_landing(section(stack="ardupilot"))


ENTRIES = """
[[weather]]
at_s = 0
wind_speed_m_s = 5
wind_from_deg = {first}
[[weather]]
at_s = 3600
wind_speed_m_s = 5
wind_from_deg = {later}
"""
RAWS = """RAWS_ELEVATION: 1000
RAWS_UNITS: {units}
RAWS: 2
2016 7 15 2200 30 20 0.0 10 {first} 0
2016 7 15 2300 30 20 0.0 10 {later} 0
"""
CSV = "at_s,{speed},{direction}\n0,5,{first}\n3600,5,{later}\n"
PLANE = """
name = "landing"
duration_s = 7200
{weather}
[landscape]
source = "jacksboro"
rows = 300
cols = 300
[[ignition]]
lat_deg = 36.35
lon_deg = -84.16
[[vehicles]]
name = "hawk"
home_lat_deg = 36.352
home_lon_deg = -84.157
autostart = true
"""
FIRST_DEG, LATER_DEG = 200.0, 110.0


def planned(folder: Path, kind: str) -> Scenario:
    """Return a scenario with the same two winds from any source of weather."""
    winds = {"first": FIRST_DEG, "later": LATER_DEG}
    toward = {name: (deg + 180) % 360 for name, deg in winds.items()}
    files = {
        "english.raws": RAWS.format(units="English", **winds),
        "metric.wxs": RAWS.format(units="Metric", **winds),
        "from.csv": CSV.format(speed="wind_speed_m_s", direction="wind_from_deg", **winds),
        "toward.csv": CSV.format(speed="wind_10m_kmh", direction="wind_toward_deg", **toward),
    }
    weather = ENTRIES.format(**winds)
    if kind in files:
        (folder / kind).write_text(files[kind], encoding="utf-8")
        weather = f'[weather_file]\npath = "{folder / kind}"'
    path = folder / "scenario.toml"
    path.write_text(PLANE.format(weather=weather), encoding="utf-8")
    return load_scenario(str(path))


SOURCES = ("entries", "english.raws", "metric.wxs", "from.csv", "toward.csv")


def laid_for(scenario: Scenario, items: Sequence[MissionItem]) -> float | None:
    """Return which of the two winds the landing of a mission is planned for."""
    plane, landscape = scenario.vehicles[0], landscape_of(scenario)
    speed_m_s = weather_of(scenario).weather_at(0.0).wind_speed_m_s
    places = {
        wind_from_deg: [
            (item.x, item.y) for item in landing_of(plane, landscape, (speed_m_s, wind_from_deg))
        ]
        for wind_from_deg in (0.0, FIRST_DEG, LATER_DEG)
    }
    assert len({tuple(each) for each in places.values()}) == 3
    flown = [(item.x, item.y) for item in items[-5:]]
    return next((wind for wind, landing in places.items() if landing == flown), None)


@pytest.mark.parametrize("kind", SOURCES)
def test_the_landing_of_a_plan_is_laid_for_the_weather_of_any_source(
    tmp_path: Path, kind: str
) -> None:
    scenario = planned(tmp_path, kind)
    plan = tmp_path / "first.plan"
    write_plan(str(tmp_path / "scenario.toml"), None, plan, ())
    assert laid_for(scenario, read_any(plan).mission) == FIRST_DEG
    plan.unlink()
    write_plan(str(tmp_path / "scenario.toml"), None, plan, ("deploy_at_s=3600",))
    assert laid_for(scenario, read_any(plan).mission) == LATER_DEG


@pytest.mark.long
def test_missions_in_flight_end_with_a_landing_for_the_wind_of_their_time(tmp_path: Path) -> None:
    planned(tmp_path, "from.csv")
    changes = ("start_s=3540", "deploy_at_s=3540")
    scenario = load_scenario(str(tmp_path / "scenario.toml"), changes)
    path = tmp_path / "journal.jsonl"
    simulate(scenario, path, "", until_s=4000.0)
    at_s, landings = 0.0, []
    for entry in SegmentReader(path):
        if isinstance(entry.content, Telemetry):
            at_s = entry.content.at_us / 1e6
        elif isinstance(entry.content, UploadMission):
            landings.append((at_s, laid_for(scenario, entry.content.items)))
    before = {wind for at_s, wind in landings if at_s < 3600.0}
    after = {wind for at_s, wind in landings if at_s >= 3600.0}
    assert (before, after) == ({FIRST_DEG}, {LATER_DEG})
