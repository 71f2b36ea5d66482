"""Planes over rising ground: the climb before a mission, and the ground beside its legs."""

import math

import numpy as np
import pytest

from autopilot_bridge.items import MissionItem, loiter_unlimited, waypoint
from benchmarks.worlds.ground import Terrain, lat_lon_of, plane_m
from benchmarks.worlds.random_world import landscape_of
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import load_scenario
from mission_service.config.sections import VehicleSection
from mission_service.missions.climb import with_climb, without_climb
from mission_service.missions.from_path import mission_along

GROUND_M, SPEED_M_S, CLIMB_M_S = 300.0, 18.0, 3.0
SECTION = (
    load_scenario("demo")
    .vehicles[0]
    .model_copy(update={"altitude_agl_m": 80.0, "airspeed_m_s": SPEED_M_S, "climb_m_s": CLIMB_M_S})
)
HILL = Terrain(GROUND_M, hills=((700.0, 0.0, 200.0, 250.0),))
LOITER_TO_ALT = 31


def path_over(
    *places_m: tuple[float, float], terrain: Terrain = HILL, section: VehicleSection = SECTION
) -> tuple[MissionItem, ...]:
    """Return a mission along places (metres east and north of the middle of the landscape)."""
    land = landscape_of(terrain)
    path = np.array([land.xy_of_lat_lon(*lat_lon_of(*place)) for place in places_m])
    return mission_along(path, True, section, land, from_ground=False, start_m=tuple(path[0]))


def climbing(
    items: tuple[MissionItem, ...], at_m: tuple[float, float], altitude_m: float, terrain: Terrain
) -> tuple[MissionItem, ...]:
    land = landscape_of(terrain)
    position = (*xy_of(land, at_m), altitude_m)
    return with_climb(items, SECTION, land, position, SPEED_M_S)


def xy_of(land: Landscape, place_m: tuple[float, float]) -> tuple[float, float]:
    x_m, y_m = land.xy_of_lat_lon(*lat_lon_of(*place_m))
    return float(x_m), float(y_m)


def flown_height_m(
    items: tuple[MissionItem, ...], at_m: tuple[float, float], altitude_m: float, terrain: Terrain
) -> float:
    """Return the least height above ground of a flight that climbs by 3 m/s, in steps of 5 m."""
    (east_m, north_m), least_m = at_m, math.inf
    for item in (each for each in items if each.command in (16, 17, LOITER_TO_ALT)):
        to_m = plane_m(item.x / 1e7, item.y / 1e7)
        count = math.ceil(math.dist((east_m, north_m), to_m) / 5.0)
        begun_m, target_m = (east_m, north_m), item.z
        for step in range(1, count + 1):
            east_m = begun_m[0] + (to_m[0] - begun_m[0]) * step / count
            north_m = begun_m[1] + (to_m[1] - begun_m[1]) * step / count
            length_m = math.dist(begun_m, to_m) / count
            up_m = length_m * CLIMB_M_S / SPEED_M_S
            altitude_m = min(max(altitude_m, target_m), altitude_m + up_m)
            least_m = min(least_m, altitude_m - float(terrain.ground_m(east_m, north_m)))
        if item.command == LOITER_TO_ALT:
            turns = np.linspace(0.0, math.tau, 60)
            ring = terrain.ground_m(
                east_m + item.param2 * np.sin(turns), north_m + item.param2 * np.cos(turns)
            )
            least_m = min(least_m, altitude_m - float(np.max(ring)))
            altitude_m = item.z
    return least_m


def test_a_plane_that_can_climb_on_its_way_flies_the_mission_as_planned() -> None:
    items = path_over((-900.0, 0.0), (1200.0, 0.0))
    assert climbing(items, (-900.0, 0.0), 480.0, HILL) == items


def test_a_plane_before_a_steep_hill_climbs_in_a_loiter_first() -> None:
    items = path_over((100.0, 0.0), (1200.0, 0.0))
    low_m = GROUND_M + 60.0
    assert flown_height_m(items, (100.0, 0.0), low_m, HILL) < 0.0  # it would fly into the hill
    found = climbing(items, (100.0, 0.0), low_m, HILL)
    (climb,) = [item for item in found if item.command == LOITER_TO_ALT]
    assert without_climb(found) == items
    assert found.index(climb) == next(n for n, each in enumerate(items) if each.command == 16)
    assert flown_height_m(found, (100.0, 0.0), low_m, HILL) >= 30.0 - 4.0


def test_the_loiter_is_over_lower_ground_if_the_plane_is_beside_a_slope() -> None:
    """The circle around the plane's position would be too low."""
    items = path_over((350.0, 0.0), (1200.0, 0.0))
    low_m = float(HILL.ground_m(350.0, 0.0)) + 35.0
    found = climbing(items, (350.0, 0.0), low_m, HILL)
    (climb,) = [item for item in found if item.command == LOITER_TO_ALT]
    east_m, north_m = plane_m(climb.x / 1e7, climb.y / 1e7)
    assert float(HILL.ground_m(east_m, north_m)) < float(HILL.ground_m(350.0, 0.0)) - 40.0


def test_a_climb_first_is_never_lower_than_the_climb_on_the_way() -> None:
    random, changed = np.random.default_rng(1), 0
    for _ in range(400):
        hills = tuple(
            (*random.uniform(-1200.0, 1200.0, 2), random.uniform(50.0, 300.0), width_m)
            for width_m in random.uniform(100.0, 400.0, random.integers(1, 6))
        )
        terrain = Terrain(GROUND_M, hills=hills)
        places = random.uniform(-1000.0, 1000.0, (random.integers(1, 5), 2))
        items = path_over((0.0, 0.0), *map(tuple, places), terrain=terrain)
        low_m = float(terrain.ground_m(0.0, 0.0)) + random.uniform(20.0, 80.0)
        found = climbing(items, (0.0, 0.0), low_m, terrain)
        assert without_climb(found) == items
        if found != items:
            changed += 1
            on_the_way_m = flown_height_m(items, (0.0, 0.0), low_m, terrain)
            first_m = flown_height_m(found, (0.0, 0.0), low_m, terrain)
            assert first_m > min(on_the_way_m, 30.0) - 5.0
    assert changed > 20


def test_a_mission_without_a_climb_keeps_its_items() -> None:
    items = (waypoint(36.36, -84.14, 500.0), loiter_unlimited(36.36, -84.13, 500.0, 90.0))
    assert without_climb(items) == items
    assert without_climb(()) == ()


@pytest.mark.parametrize(("kind", "beside"), [("plane", True), ("copter", False)])
def test_a_plane_is_clear_of_the_ground_beside_its_legs(kind: str, beside: bool) -> None:
    """A steep hill 120 m beside the leg is 150 m higher than the ground under the leg."""
    hill = Terrain(GROUND_M, hills=((0.0, 120.0, 200.0, 50.0),))
    section = SECTION.model_copy(update={"kind": kind})
    items = path_over((-600.0, 0.0), (600.0, 0.0), terrain=hill, section=section)
    lowest_m = min(item.z for item in items if item.command in (16, 17))
    land = landscape_of(hill)
    top_m = float(land.elevation_at(*xy_of(land, (0.0, 120.0))))
    assert (lowest_m >= top_m + 30.0 - 15.0) is beside  # the grid does not contain the top itself
