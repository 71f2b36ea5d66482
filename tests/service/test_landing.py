"""The landing behind a PX4 plane's missions."""

import math

import numpy as np
import pytest

from autopilot_bridge.check import check
from autopilot_bridge.stacks import stack_named
from firemodel.landscape import Landscape
from mission_service.config_sections import VehicleSection
from mission_service.errors import ScenarioError
from mission_service.landing import APPROACH_HEIGHTS_M, landing_of, needs_landing

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


def course_deg(landscape: Landscape, plane: VehicleSection, wind_from_deg: float) -> float:
    """Of the tangent from the loiter to the touchdown."""
    _, loiter, touchdown = landing_of(plane, landscape, wind_from_deg)
    (x0, y0), (x1, y1) = (
        landscape.xy_of_lat_lon(item.x / 1e7, item.y / 1e7) for item in (loiter, touchdown)
    )
    bearing = math.degrees(math.atan2(x1 - x0, y1 - y0))
    # The centre of a clockwise loiter lies to the right of the line it is left along.
    return (bearing + math.degrees(math.asin(90.0 / math.hypot(x1 - x0, y1 - y0)))) % 360.0


@pytest.mark.parametrize("wind_from_deg", [1.0, 45.0, 200.0, 330.0])
def test_on_even_ground_it_lands_into_the_wind(wind_from_deg: float) -> None:
    assert course_deg(FLAT, section(), wind_from_deg) == pytest.approx(wind_from_deg, abs=0.1)


def test_px4_takes_every_item_and_the_glide() -> None:
    items = landing_of(section(), FLAT, 270.0)
    assert check(items, stack_named("px4", "plane")) == []
    _, loiter, touchdown = items
    centre, home = (FLAT.xy_of_lat_lon(i.x / 1e7, i.y / 1e7) for i in (loiter, touchdown))
    distance_m = math.dist(centre, home)
    glide_m = math.sqrt(distance_m**2 - loiter.param2**2)
    assert 0.0 < (loiter.z - touchdown.z) / glide_m < math.tan(math.radians(FW_LND_ANG_DEG))


def test_a_hill_on_the_approach_turns_it_aside() -> None:
    # A ridge to the west, 200 m high from 500 m on: an approach with course 90 comes over it.
    ridge = land(np.where(HOME_M[0] - 500.0 > X, 500.0, 300.0))
    course = course_deg(ridge, section(), 90.0)
    assert abs((course - 90.0 + 180.0) % 360.0 - 180.0) > 20.0
    _, loiter, _ = landing_of(section(), ridge, 90.0)
    x_m, y_m = ridge.xy_of_lat_lon(loiter.x / 1e7, loiter.y / 1e7)
    turns = np.linspace(0.0, math.tau, 180)
    around = ridge.elevation_at(x_m + 90 * np.cos(turns), y_m + 90 * np.sin(turns))
    assert float(around.max()) <= 300.0 + loiter.z - 30.0


def test_low_hills_need_a_higher_approach() -> None:
    hills = land(np.where(np.hypot(X - HOME_M[0], Y - HOME_M[1]) > 700.0, 322.0, 300.0))
    _, loiter, _ = landing_of(section(), hills, 90.0)
    assert loiter.z > APPROACH_HEIGHTS_M[0]


def test_a_bowl_has_no_approach() -> None:
    bowl = land(np.where(np.hypot(X - HOME_M[0], Y - HOME_M[1]) > 450.0, 600.0, 300.0))
    with pytest.raises(ScenarioError, match="no landing approach to home in any direction"):
        landing_of(section(), bowl, 90.0)


def test_a_given_course_is_kept_or_refused() -> None:
    plane = section(landing_course_deg=10.0)
    assert course_deg(FLAT, plane, 90.0) == pytest.approx(10.0, abs=0.1)
    wall = land(np.where(HOME_M[1] - 500.0 > Y, 500.0, 300.0))
    with pytest.raises(ScenarioError, match="landing_course_deg = 10"):
        landing_of(plane, wall, 90.0)


def test_only_px4_planes_need_one() -> None:
    assert needs_landing(section())
    assert not needs_landing(section(landing=False))
    assert not needs_landing(section(kind="copter"))
    assert not needs_landing(section(stack="ardupilot"))
