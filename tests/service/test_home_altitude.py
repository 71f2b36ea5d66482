"""Landings of PX4 planes after the autopilot has set home at a wrong altitude."""

import numpy as np
import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import load_scenario
from mission_service.events import Telemetry
from mission_service.fire.scenario_fire import landscape_of
from mission_service.vehicles.ground_altitude import GroundAltitude
from mission_service.vehicles.home_altitude import home_error_m, landing_items
from tests.service.landing_core import AWAY_DEG, CRUISE_M, Vehicles, landing_uploads

NOISE_M = np.random.default_rng(7).normal(0.0, 0.2, 90)
NAV_LAND, LOITER_TO_ALT = 21, 31


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("demo"))


def report(
    flight: Vehicles,
    amsl_m: float,
    home_amsl_m: float,
    speed_m_s: float,
    away_deg: float = 0.0,
) -> None:
    """Report a position at home, or west of home in flight, and the altitude of home in use."""
    flight.at_s += 1.0
    home = flight.core.vehicles["hawk"].section
    away_deg = AWAY_DEG if speed_m_s else away_deg
    place = (home.home_lat_deg, home.home_lon_deg - away_deg)
    heights = (amsl_m, amsl_m - home_amsl_m)
    flight.handle(Telemetry(flight.at_us, "hawk", *place, *heights, 0.0, speed_m_s, 0.0))


def landing_heights(
    land: Landscape,
    error_m: float,
    *overrides: str,
    stands_s: int = 90,
    away_deg: float = 0.0,
) -> tuple[float, float]:
    """Return the heights above home of the approach and of NAV_LAND in a landing mission.

    The vehicle stands on the ground with a noisy altitude, and takes off with the altitude of home
    wrong by ``error_m``.
    """
    flight = Vehicles(land, *overrides)
    ground_m = flight.home_amsl_m()
    flight.mode("hold", armed=False)
    flight.at(0.0)
    for noise_m in NOISE_M[:stands_s]:
        report(flight, ground_m + noise_m, ground_m + noise_m, 0.0, away_deg)
    flight.mode("mission")
    for _ in range(3):
        report(flight, ground_m + CRUISE_M, ground_m + error_m, 12.0)
        flight.answer_uploads()
    flight.order("land")
    report(flight, ground_m + CRUISE_M, ground_m + error_m, 12.0)
    upload = landing_uploads(flight.sent)[-1]
    (loiter,) = (item for item in upload.items if item.command == LOITER_TO_ALT)
    (touchdown,) = (item for item in upload.items if item.command == NAV_LAND)
    return loiter.z, touchdown.z


@pytest.mark.parametrize("error_m", [-1.8, 1.8, 2.5])
def test_a_landing_ends_at_the_mean_altitude_of_the_ground(land: Landscape, error_m: float) -> None:
    usual_m, _ = landing_heights(land, 0.0)
    loiter_m, touchdown_m = landing_heights(land, error_m)
    assert touchdown_m == pytest.approx(-error_m, abs=0.4)
    assert loiter_m - usual_m == pytest.approx(touchdown_m)


@pytest.mark.parametrize("error_m", [0.0, 20.0])
def test_no_error_or_a_home_at_another_height_changes_nothing(
    land: Landscape, error_m: float
) -> None:
    assert landing_heights(land, error_m)[1] == 0.0


@pytest.mark.parametrize("stands_s", [0, 1, 50])
def test_a_vehicle_that_was_hardly_seen_on_the_ground_lands_at_its_home(
    land: Landscape, stands_s: int
) -> None:
    assert landing_heights(land, 1.8, stands_s=stands_s)[1] == 0.0


def test_a_vehicle_that_stood_elsewhere_lands_at_its_home(land: Landscape) -> None:
    assert landing_heights(land, 1.8, away_deg=0.0005)[1] == 0.0


def test_the_landing_of_a_mission_planned_on_the_ground_is_not_corrected(land: Landscape) -> None:
    flight = Vehicles(land)
    ground_m = flight.home_amsl_m()
    flight.mode("hold", armed=False)
    for _ in range(70):
        report(flight, ground_m, ground_m + 1.5, 0.0)
    assert home_error_m(flight.core.vehicles["hawk"]) == 0.0


def test_arduplane_lands_at_its_home(land: Landscape) -> None:
    assert landing_heights(land, 1.8, 'vehicles.0.stack="ardupilot"')[1] == 0.0


def test_the_landing_at_the_end_of_a_mission_is_corrected(land: Landscape) -> None:
    flight = Vehicles(land)
    ground_m = flight.home_amsl_m()
    flight.mode("hold", armed=False)
    for _ in range(70):
        report(flight, ground_m, ground_m, 0.0)
    flight.mode("mission")
    report(flight, ground_m + CRUISE_M, ground_m - 1.5, 12.0)
    vehicle = flight.core.vehicles["hawk"]
    *_, touchdown = landing_items(vehicle, flight.at_s)
    assert (touchdown.command, touchdown.z) == (NAV_LAND, 1.5)
    fix = vehicle.availability.fix
    assert fix is not None
    path_m = np.array([(fix.x_m, fix.y_m), (fix.x_m + 900.0, fix.y_m)])
    assert flight.core.guidance.items(vehicle, path_m, fix)[-1] == touchdown


PLACE_M = (100.0, 200.0)


def test_old_altitudes_lose_their_weight() -> None:
    ground = GroundAltitude()
    for at_s in range(300):
        ground.include(PLACE_M, 300.0, float(at_s))
    for at_s in range(300, 600):
        ground.include(PLACE_M, 301.0, float(at_s))
    assert ground.settled_m == pytest.approx(301.0, abs=0.1)


@pytest.mark.parametrize(
    ("place_m", "amsl_m", "gap_s"),
    [
        ((105.0, 200.0), 300.0, 1.0),  # it was moved
        (PLACE_M, 302.0, 1.0),  # the estimate was corrected
        (PLACE_M, 300.0, 60.0),  # nothing was received
    ],
)
def test_the_mean_begins_again(place_m: tuple[float, float], amsl_m: float, gap_s: float) -> None:
    ground = GroundAltitude()
    for at_s in range(100):
        ground.include(PLACE_M, 300.0, float(at_s))
    assert ground.settled_m == 300.0
    ground.include(place_m, amsl_m, 99.0 + gap_s)
    assert ground.settled_m is None
    assert (ground.place_m, ground.mean_m) == (place_m, amsl_m)


def test_an_estimate_that_settles_slowly_is_not_used_before_it_has_settled() -> None:
    ground = GroundAltitude()
    for at_s in range(120):
        ground.include(PLACE_M, 300.0 + 10.0 * 0.9**at_s, float(at_s))
        assert ground.settled_m is None or abs(ground.settled_m - 300.0) < 0.5
    assert ground.settled_m == pytest.approx(300.0, abs=0.4)
