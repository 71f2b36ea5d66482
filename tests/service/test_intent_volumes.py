"""The volumes of operational intents: outlines, margins, and the return and landing."""

import math

import pytest
import shapely

from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import LOITER_RADIUS_FACTOR, Part, disc, path_parts
from mission_service.airspace.operational_intent import (
    IntendedPart,
    IntentExtent,
    IntentFrame,
    intent_of,
)
from mission_service.config.scenario import load_scenario
from mission_service.fire.scenario_fire import landscape_of
from mission_service.missions.landing import APPROACH_HEIGHTS_M, forward_of, glide_m
from tests.service.test_preflight import WAITS, Ground

REACH_M, MARGIN_M = 100.0, 60.0
FRAME = IntentFrame(MARGIN_M, 15.0, -32.5, 1_795_304_000_123_456, 1_795_304_600_000_000)


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


@pytest.fixture(scope="module")
def middle(land: Landscape) -> tuple[float, float]:
    rows, cols = land.shape
    x_m, y_m = land.xy_of(rows / 2, cols / 2)
    return float(x_m), float(y_m)


def extent_of(land: Landscape, intended: IntendedPart) -> IntentExtent:
    (volume,) = intent_of("hawk", [intended], FRAME, land).details.volumes
    return volume.volume


def area_m(land: Landscape, extent: IntentExtent) -> shapely.Polygon:
    """Return the outline on the map, in metres."""
    assert extent.outline_polygon is not None
    corners = [land.xy_of_lat_lon(each.lat, each.lng) for each in extent.outline_polygon.vertices]
    return shapely.Polygon(corners)


def test_a_leg_is_a_polygon_that_contains_its_reach_and_margin_and_hardly_more(
    land: Landscape, middle: tuple[float, float]
) -> None:
    x_m, y_m = middle
    (part,) = path_parts([(x_m, y_m, 400.0), (x_m + 700.0, y_m - 300.0, 450.0)])
    extent = extent_of(land, IntendedPart("leg", part, REACH_M))
    assert extent.outline_circle is None
    area = area_m(land, extent)
    assert area.contains(part.shape.buffer(REACH_M + MARGIN_M, quad_segs=64))
    assert part.shape.buffer(1.02 * (REACH_M + MARGIN_M), quad_segs=64).contains(area)
    assert extent.altitude_lower.value == 400.0 - 15.0 - 32.5
    assert extent.altitude_upper.value == 450.0 + 15.0 - 32.5


def test_a_loiter_and_a_climb_are_circles(land: Landscape, middle: tuple[float, float]) -> None:
    for radius_m in (0.0, 130.0):
        part = disc(*middle, radius_m, 400.0, 400.0) if radius_m else None
        part = part or Part(shapely.Point(middle), 300.0, 400.0)
        extent = extent_of(land, IntendedPart("loiter", part, REACH_M))
        circle = extent.outline_circle
        assert circle is not None
        assert extent.outline_polygon is None
        centre_m = land.xy_of_lat_lon(circle.center.lat, circle.center.lng)
        assert math.dist(centre_m, middle) < 0.1
        needed_m = radius_m + REACH_M + MARGIN_M
        assert needed_m <= circle.radius.value <= 1.005 * needed_m + 0.1


def test_heights_are_rounded_outwards_and_times_are_utc(
    land: Landscape, middle: tuple[float, float]
) -> None:
    part = Part(shapely.Point(middle), 300.04, 400.06)
    intended = IntendedPart("climb", part)
    (volume,) = intent_of("hawk", [intended], FRAME, land).details.volumes
    assert volume.volume.altitude_lower.value == 252.5  # 252.54
    assert volume.volume.altitude_upper.value == 382.6  # 382.56
    assert volume.time_start.value == "2026-11-21T23:33:20.123Z"
    assert volume.time_end.value == "2026-11-21T23:43:20.000Z"


def test_the_way_home_from_any_place_of_the_flight_is_inside(land: Landscape) -> None:
    ground = Ground(land, WAITS)
    ground.stands()
    ground.order("takeoff")
    ground.mode("mission")
    ground.at(120.0, off_deg=0.04)  # farther from home than an approach
    flight = ground.core.airspace.intended("hawk")
    back = flight[-1]
    assert back.purpose == "return and landing"
    home = ground.vehicle.home_m
    for each in flight[:-1]:
        assert each.part.highest_m <= back.part.highest_m
        for place_m in shapely.get_coordinates(each.part.shape):
            way = shapely.LineString([place_m, home])
            assert back.part.shape.buffer(0.1).contains(way)


def test_an_approach_on_any_course_is_inside(land: Landscape) -> None:
    ground = Ground(land, WAITS)
    assert ground.core.airspace.intended("hawk") == []
    ground.stands()
    *_, back = ground.core.airspace.intended("hawk")
    area = back.part.shape.buffer(back.reach_m)
    radius_m, height_m = ground.section.loiter_radius_m, APPROACH_HEIGHTS_M[-1]
    assert height_m <= back.part.highest_m - back.part.lowest_m
    for course_deg in range(0, 360, 15):
        east, north = forward_of(course_deg)
        home_x_m, home_y_m = ground.vehicle.home_m
        # The loiter is clockwise, and is left at the top of the glide.
        x_m = home_x_m - glide_m(height_m) * east + radius_m * north
        y_m = home_y_m - glide_m(height_m) * north - radius_m * east
        loiter = shapely.Point(x_m, y_m).buffer(LOITER_RADIUS_FACTOR * radius_m)
        assert area.contains(loiter), course_deg
