"""The estimated time home follows the parameters by which the autopilot returns."""

import math
import pickle

import pytest

from autopilot_bridge.stacks.return_flight import MULTIROTOR_BEGIN_S, true_airspeed_factor
from firemodel.landscape.landscape import Landscape
from mission_service.commands import Announce, AnyCommand
from mission_service.config.scenario import load_scenario
from mission_service.events import ParametersReported
from mission_service.fire.scenario_fire import landscape_of
from tests.service.test_recall import LONG, Flight

AWAY_M, FROM_AMSL_M = 1200.0, 550.0  # of the flight's positions; its home is at 400 m AMSL
CALM = (*LONG, "vehicles.0.landing=false")


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


def read(flight: Flight, **values: float) -> list[AnyCommand]:
    """Report these parameters."""
    section = flight.home
    stack = f"{section.stack} {section.kind}"
    return flight.handle(ParametersReported(flight.at_us, "hawk", stack, 255, values))


def time_home_s(flight: Flight) -> float:
    flight.at(150.0)
    found = flight.core.vehicles["hawk"].energy.estimate
    assert found is not None
    return found.time_home_s


def announced(commands: list[AnyCommand]) -> list[str]:
    lines = [each.text for each in commands if isinstance(each, Announce)]
    return [line for line in lines if line.startswith("its parameters set its return")]


def test_a_plane_returns_at_the_airspeed_of_its_parameters(land: Landscape) -> None:
    flight = Flight(land, *CALM, "vehicles.0.stack=ardupilot", "vehicles.0.airspeed_m_s=15")
    before_s = time_home_s(flight)
    lines = announced(read(flight, AIRSPEED_CRUISE=22.0, RTL_ALTITUDE=100.0))
    assert lines == ["its parameters set its return: 22 m/s (airspeed_m_s = 15 in the scenario)"]
    assert time_home_s(flight) == pytest.approx(before_s * 15.0 / 22.0, abs=0.5)
    expected_s = AWAY_M / (22.0 * true_airspeed_factor(FROM_AMSL_M))
    assert time_home_s(flight) == pytest.approx(expected_s, rel=0.02)
    assert announced(read(flight, AIRSPEED_CRUISE=22.0, RTL_ALTITUDE=100.0)) == []


def test_a_px4_plane_returns_to_the_landing_of_its_mission(land: Landscape) -> None:
    flight = Flight(land, *LONG)
    values = {"FW_AIRSPD_TRIM": 18.0, "FW_T_CLMB_R_SP": 3.0, "FW_R_LIM": 50.0}
    vehicle = flight.core.vehicles["hawk"]
    times_s = []
    for kind in (0.0, 1.0):
        read(flight, **values, RTL_RETURN_ALT=100.0, RTL_TYPE=kind)
        times_s.append(time_home_s(flight))
    fix = vehicle.availability.fix
    start_m = vehicle.landing.start_at(flight.at_s)
    assert fix is not None
    assert start_m is not None
    speed_m_s = 18.0 * true_airspeed_factor(FROM_AMSL_M)
    # Turns of 29 m radius take at most half a circle.
    for goal_m, found_s in zip((vehicle.home_m, start_m), times_s, strict=True):
        least_s = math.dist((fix.x_m, fix.y_m), goal_m) / speed_m_s
        assert least_s <= found_s <= least_s + math.pi * 29.0 / speed_m_s
    assert abs(times_s[0] - times_s[1]) > 5.0
    without = Flight(land, *CALM)
    read(without, **values, RTL_RETURN_ALT=100.0, RTL_TYPE=1.0)
    assert time_home_s(without) == pytest.approx(times_s[0], abs=1.0)


@pytest.mark.parametrize(
    ("stack", "values", "speed_m_s", "climb_m_s", "acceleration_m_s2"),
    [
        (
            "px4",
            {"MPC_XY_CRUISE": 5.0, "MPC_Z_V_AUTO_UP": 2.0, "MPC_ACC_HOR": 3.0},
            *(5.0, 2.0, 3.0),
        ),
        (
            "ardupilot",
            {"RTL_SPEED": 0.0, "WPNAV_SPEED": 480.0, "WPNAV_SPEED_UP": 250.0, "WPNAV_ACCEL": 250.0},
            *(4.8, 2.5, 2.5),
        ),
    ],
)
def test_a_copter_stops_climbs_and_returns_by_its_parameters(
    land: Landscape,
    stack: str,
    values: dict[str, float],
    speed_m_s: float,
    climb_m_s: float,
    acceleration_m_s2: float,
) -> None:
    flight = Flight(land, *CALM, f"vehicles.0.stack={stack}", "vehicles.0.kind=copter")
    height = {"RTL_RETURN_ALT": 180.0} if stack == "px4" else {"RTL_ALT": 18_000.0}
    read(flight, **values, **height)
    fix, home_m = flight.core.vehicles["hawk"].availability.fix, flight.core.vehicles["hawk"].home_m
    assert fix is not None
    stop_s = math.hypot(fix.east_m_s, fix.north_m_s) / acceleration_m_s2
    stop_m = (fix.x_m + fix.east_m_s * stop_s / 2.0, fix.y_m + fix.north_m_s * stop_s / 2.0)
    expected_s = stop_s + MULTIROTOR_BEGIN_S[stack] + 30.0 / climb_m_s
    expected_s += math.dist(stop_m, home_m) / speed_m_s + speed_m_s / acceleration_m_s2
    assert time_home_s(flight) == pytest.approx(expected_s, abs=1.0)


def test_keys_of_the_scenario_replace_only_parameters_without_a_reply(land: Landscape) -> None:
    keys = ("vehicles.0.return_speed_m_s=12", "vehicles.0.return_height_m=90")
    flight = Flight(land, *CALM, *keys)
    with_keys_s = time_home_s(flight)
    assert announced(read(flight, RTL_TYPE=0.0)) == []
    assert time_home_s(flight) == pytest.approx(with_keys_s, abs=0.1)
    (line,) = announced(read(flight, FW_AIRSPD_TRIM=15.0, RTL_RETURN_ALT=60.0))
    assert line == (
        "its parameters set its return: 15 m/s (return_speed_m_s = 12 in the scenario), "
        "60 m above home (return_height_m = 90)"
    )
    assert time_home_s(flight) == pytest.approx(with_keys_s * 12.0 / 15.0, rel=0.02)


def test_the_parameters_are_part_of_the_state(land: Landscape) -> None:
    flight = Flight(land, *CALM)
    read(flight, FW_AIRSPD_TRIM=15.0, RTL_RETURN_ALT=60.0)
    flight.core = pickle.loads(pickle.dumps(flight.core))
    assert flight.core.vehicles["hawk"].return_flight.speed_m_s == 15.0
