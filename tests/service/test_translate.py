"""From a path to items that a vehicle can fly and that end in a loiter."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firemodel.landscape.landscape import Landscape
from mission_service.config.sections import VehicleSection
from mission_service.missions.from_path import flyable, leg_altitudes_m, mission_along

NAV_WAYPOINT, NAV_LOITER_UNLIM, NAV_TAKEOFF, DO_CHANGE_SPEED = 16, 17, 22, 178
DO_MOUNT_CONTROL, DO_SET_CAM_TRIGG_DIST = 205, 206


def hills(rows: int = 60, cols: int = 60) -> Landscape:
    row, col = np.indices((rows, cols))
    height = 300.0 + 80.0 * np.sin(row / 7.0) * np.cos(col / 9.0)
    return Landscape(
        "EPSG:32616",
        740000.0,
        4040000.0,
        30.0,
        np.ones((rows, cols), dtype=np.int16),
        height.astype(np.float32),
    )


LAND = hills()
VEHICLE = VehicleSection(name="hawk", home_lat_deg=36.47, home_lon_deg=-84.31)


def a_path() -> np.ndarray:
    turn = np.linspace(0.0, 3.0, 40)
    x_m, y_m = LAND.xy_of(30.0 - 20.0 * np.sin(turn), 30.0 + 20.0 * np.cos(turn))
    return np.column_stack([x_m, y_m])


@pytest.mark.parametrize(("clockwise", "radius_m"), [(True, 90.0), (False, -90.0)])
def test_every_mission_ends_in_a_loiter_without_end(clockwise: bool, radius_m: float) -> None:
    items = mission_along(a_path(), clockwise, VEHICLE, LAND, from_ground=False)
    first, *waypoints, _ = [item.command for item in items]
    assert (first, items[0].param1, items[0].param2) == (DO_CHANGE_SPEED, 0.0, 18.0)
    assert waypoints == [NAV_WAYPOINT] * (len(items) - 2)
    assert items[-1].command == NAV_LOITER_UNLIM
    assert items[-1].param3 == radius_m
    assert not any(math.isnan(value) for item in items for value in (item.z, item.param3))


def test_a_vehicle_on_the_ground_takes_off_first() -> None:
    items = mission_along(a_path(), True, VEHICLE, LAND, from_ground=True)
    assert [item.command for item in items[:2]] == [NAV_TAKEOFF, DO_CHANGE_SPEED]
    assert (items[0].x, items[0].y) == (364700000, -843100000)


def test_a_camera_is_triggered_along_the_path_only_if_the_scenario_asks_for_it() -> None:
    plain = mission_along(a_path(), True, VEHICLE, LAND, from_ground=True)
    triggers = VEHICLE.model_copy(update={"camera_trigger_m": 40.0, "gimbal_pitch_deg": -90.0})
    items = mission_along(a_path(), True, triggers, LAND, from_ground=True)
    commands = [item.command for item in items]
    assert commands[:4] == [NAV_TAKEOFF, DO_CHANGE_SPEED, DO_MOUNT_CONTROL, DO_SET_CAM_TRIGG_DIST]
    assert commands[-2:] == [DO_SET_CAM_TRIGG_DIST, NAV_LOITER_UNLIM]
    assert (items[2].param1, items[3].param1, items[-2].param1) == (-90.0, 40.0, 0.0)
    others = tuple(item for item in items if item.command not in (205, 206))
    on_last_leg = others[-2]
    assert (*others[:-2], others[-1]) == plain
    before, end = (np.array([item.x, item.y * 0.8]) for item in (plain[-2], plain[-1]))
    place = np.array([on_last_leg.x, on_last_leg.y * 0.8])
    share = np.hypot(*(place - before)) / np.hypot(*(end - before))
    assert before + share * (end - before) == pytest.approx(place, abs=30)
    left_m = np.hypot(*(end - place)) * 1e-7 * 111_320.0
    assert left_m == pytest.approx(VEHICLE.loiter_radius_m, rel=0.02)


def test_each_leg_clears_the_terrain_under_it() -> None:
    points = a_path()[::8]
    altitudes = leg_altitudes_m(points, LAND, 150.0, around_last_m=100.0)
    share = np.linspace(0.0, 1.0, 200)[:, None]
    for index in range(len(points) - 1):
        ground = points[index] + share * (points[index + 1] - points[index])
        flown_m = altitudes[index] + share[:, 0] * (altitudes[index + 1] - altitudes[index])
        clearance_m = flown_m - LAND.elevation_at(ground[:, 0], ground[:, 1])
        assert clearance_m.min() >= 149.0


def test_legs_are_no_shorter_than_the_least_leg() -> None:
    points = flyable(a_path(), 60.0, 90.0, 15.0)
    assert np.hypot(*np.diff(points, axis=0).T).min() >= 90.0
    assert points[0] == pytest.approx(a_path()[0])
    assert points[-1] == pytest.approx(a_path()[-1])


coordinates = st.floats(-2000.0, 2000.0)


@given(st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=60))
@example([(0.0, 0.0), (0.0, 0.0), (0.0, 1.3e-174)])
@example([(0.0, 0.0), (5.0, 0.0), (0.0, 1.3e-174)])
def test_any_path_stays_a_path_between_its_ends(points: list[tuple[float, float]]) -> None:
    path = np.array(points)
    found = flyable(path, 60.0, 90.0, 15.0)
    assert 2 <= len(found) <= len(path)
    assert (found[0] == path[0]).all()
    assert (found[-1] == path[-1]).all()


def test_the_way_to_the_first_point_clears_a_narrow_ridge() -> None:
    elevation_m = np.full((60, 60), 300.0, dtype=np.float32)
    elevation_m[:, 29:31] = 500.0
    land = Landscape("EPSG:32616", 740000.0, 4040000.0, 30.0, LAND.fuel_model, elevation_m)
    start_m, *path = (land.xy_of(30.0, col) for col in (5.0, 52.0, 58.0))
    items = mission_along(
        np.array(path), True, VEHICLE, land, from_ground=False, start_m=(start_m[0], start_m[1])
    )
    first = next(item for item in items if item.command == NAV_WAYPOINT)
    assert first.z >= 500.0 + VEHICLE.altitude_agl_m
