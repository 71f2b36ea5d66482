"""Returns in closed airspace: PX4's to the landing in its mission, and those of multirotors."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from autopilot_bridge.stacks.return_flight import ReturnFlight
from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import landing_places
from mission_service.commands import AnyCommand, Return, UploadMission
from mission_service.config.scenario import load_scenario
from mission_service.events import AirspaceClosed, AirspaceOpened
from mission_service.fire.scenario_fire import landscape_of
from mission_service.missions.landing import approach_of
from tests.service.landing_core import CRUISE_M, Vehicles, every

AROUND, HALF_M = "fly home clear of closed airspace and terrain", 100.0


@pytest.fixture(scope="module")
def hills() -> Landscape:
    """Return a landscape in which only approaches on two courses are clear of the terrain."""
    return landscape_of(load_scenario("demo"))


@pytest.fixture(scope="module")
def land(hills: Landscape) -> Landscape:
    """Return flat land."""
    return replace(hills, elevation_m=np.full(hills.fuel_model.shape, 300.0, np.float32))


def in_flight(land: Landscape, to_landing: bool) -> Vehicles:
    """Return a PX4 plane in its mission, which returns to its landing or to home."""
    flight = Vehicles(land)
    vehicle = flight.core.vehicles["hawk"]
    vehicle.return_flight = ReturnFlight(to_landing=to_landing)
    for _ in range(3):
        flight.at(CRUISE_M)
        flight.answer_uploads()
    assert vehicle.pending is None
    return flight


def loiter_of(flight: Vehicles) -> tuple[float, float]:
    """Return the centre of the loiter of the landing, in metres."""
    centre = flight.core.vehicles["hawk"].landing.start_at(flight.at_s)
    assert centre is not None
    return centre


def close_square(flight: Vehicles, x_m: float, y_m: float, half_m: float) -> shapely.Polygon:
    """Close a square volume around a place; return its area."""
    area = shapely.box(x_m - half_m, y_m - half_m, x_m + half_m, y_m + half_m)
    places = [flight.land.lat_lon_of(*point) for point in shapely.get_coordinates(area)[:-1]]
    corners = tuple((float(lat_deg), float(lon_deg)) for lat_deg, lon_deg in places)
    flight.handle(AirspaceClosed(flight.at_us, "ann", "", "copter", corners))
    return area


def close_over_loiter(flight: Vehicles) -> shapely.Polygon:
    """Close a volume over the loiter of the landing in the mission on board."""
    return close_square(flight, *loiter_of(flight), HALF_M)


def starts(flight: Vehicles) -> list[AnyCommand]:
    """Let the vehicle accept the mission that was sent, and fly it."""
    commands = flight.answer_uploads()
    flight.mode("mission")
    return commands + flight.answer("start mission")


def test_a_return_to_a_closed_landing_leads_to_another_one(land: Landscape) -> None:
    flight = in_flight(land, to_landing=True)
    area = close_over_loiter(flight)
    flight.at(CRUISE_M)
    commands = flight.order("return")
    assert not every(commands, Return)
    (upload,) = every(commands, UploadMission)
    assert upload.why == AROUND
    places = landing_places(upload.items, land, flight.home_amsl_m())
    assert len(places) == 4, "a loiter, two waypoints on the glide and a landing"
    for place in places:
        clear_m = shapely.distance(area, shapely.Point(place.position[:2])) - place.radius_m
        assert clear_m > 60.0
    commands = starts(flight)
    commands += [each for _ in range(20) for each in flight.at(CRUISE_M)]
    assert every(commands, Return), "the way to the new landing is free"


def test_without_another_landing_it_stays_above_home_until_the_volume_opens(
    hills: Landscape,
) -> None:
    flight = in_flight(hills, to_landing=True)
    close_over_loiter(flight)
    flight.at(CRUISE_M)
    commands = flight.order("return")
    assert [each.why for each in every(commands, UploadMission)] == [AROUND]
    commands += starts(flight)
    at_home = [each for _ in range(60) for each in flight.at(CRUISE_M, away_deg=0.001)]
    assert not every(commands + at_home, Return)
    flight.handle(AirspaceOpened(flight.at_us, "ann", "", "copter"))
    assert every([each for _ in range(20) for each in flight.at(CRUISE_M)], Return)


def test_a_return_to_home_does_not_depend_on_the_landing(land: Landscape) -> None:
    flight = in_flight(land, to_landing=False)
    if math.dist(loiter_of(flight), flight.core.vehicles["hawk"].home_m) < 300.0 + HALF_M:
        pytest.fail("the landing is too near home for this test")
    close_over_loiter(flight)
    flight.at(CRUISE_M)
    assert every(flight.order("return"), Return)


def test_the_landing_is_planned_again_when_a_volume_closes_or_opens(land: Landscape) -> None:
    flight = in_flight(land, to_landing=True)
    before_m = loiter_of(flight)
    close_over_loiter(flight)
    flight.at(CRUISE_M)
    assert math.dist(before_m, loiter_of(flight)) > HALF_M
    flight.handle(AirspaceOpened(flight.at_us, "ann", "", "copter"))
    flight.at(CRUISE_M)
    assert loiter_of(flight) == before_m


def test_without_a_free_approach_the_nearest_to_the_wind_remains(land: Landscape) -> None:
    section = load_scenario("demo").vehicles[0]
    free = approach_of(section, land, (4.0, 240.0))
    home_m = land.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    closed = shapely.Point(home_m).buffer(50.0)
    all_closed = approach_of(section, land, (4.0, 240.0), closed)
    assert all_closed.course_deg == free.course_deg
    assert all_closed.height_m == free.height_m


@pytest.mark.parametrize(
    ("place_m", "half_m"),
    [
        ((-165.0, 0.0), 40.0),  # near the place where the multirotor hovers above home
        ((-400.0, 0.0), 60.0),
        ((-600.0, 30.0), 60.0),
    ],
)
def test_a_copter_is_led_home_around_a_small_volume(
    land: Landscape, place_m: tuple[float, float], half_m: float
) -> None:
    flight = Vehicles(land, 'vehicles.0.kind="copter"')
    flight.at(CRUISE_M)
    flight.answer_uploads()
    home_m = flight.core.vehicles["hawk"].home_m
    close_square(flight, home_m[0] + place_m[0], home_m[1] + place_m[1], half_m)
    flight.at(CRUISE_M)
    uploads = every(flight.order("return"), UploadMission)
    assert [each.why for each in uploads] == [AROUND]
