"""Wind and true airspeed follow from flight on several headings, and determine the time home."""

import math
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from autopilot_bridge.stacks.return_flight import true_airspeed_factor
from autopilot_bridge.vehicle.client_events import Position, Speed
from mission_service.config.scenario import load_scenario
from mission_service.events import AirDataMeasured, WindMeasured
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import SegmentReader
from mission_service.runtime.air_data import AirData
from mission_service.simulation import sim
from tests.service.landing_core import CRUISE_M, Vehicles

AIRSPEED_M_S, FACTOR, ALTITUDE_M = 20.0, 1.06, 600.0
WIND_M_S, FROM_DEG = 9.0, 240.0


def measured(heading_deg_at: Callable[[int], float], until_s: int = 200) -> list[AirDataMeasured]:
    """Return the reports of a flight with these headings, in gusts of 0.5 m/s."""
    air_data, rng, found = AirData(), Random(1), []
    toward_rad = math.radians(FROM_DEG + 180.0)
    for at_s in range(until_s):
        at_us, heading_rad = at_s * 1_000_000, math.radians(heading_deg_at(at_s))
        true_m_s = FACTOR * AIRSPEED_M_S
        north_m_s = true_m_s * math.cos(heading_rad) + WIND_M_S * math.cos(toward_rad)
        east_m_s = true_m_s * math.sin(heading_rad) + WIND_M_S * math.sin(toward_rad)
        gusts = [rng.gauss(0.0, 0.5) for _ in range(2)]
        over_ground = (north_m_s + gusts[0], east_m_s + gusts[1], 0.0)
        air_data.over_ground(Position(at_us, at_us, 0.0, 0.0, ALTITUDE_M, 100.0, *over_ground, 0.0))
        report = air_data.new_report(Speed(at_us, AIRSPEED_M_S, 0.0, 0.0, 50), "hawk", at_us)
        found += [] if report is None else [report]
    return found


@pytest.mark.parametrize("turn_deg_s", [2.0, -6.0])
def test_a_turning_plane_measures_the_wind_and_its_true_airspeed(turn_deg_s: float) -> None:
    last = measured(lambda at_s: turn_deg_s * at_s)[-1]
    assert last.true_airspeed_factor == pytest.approx(FACTOR, abs=0.01)
    assert last.wind_speed_m_s == pytest.approx(WIND_M_S, abs=0.3)
    assert last.wind_from_deg == pytest.approx(FROM_DEG, abs=3.0)


def test_a_straight_flight_measures_neither() -> None:
    assert not measured(lambda _: 30.0)


def test_after_a_turn_a_straight_flight_keeps_them() -> None:
    last = measured(lambda at_s: min(4.0 * at_s, 360.0), until_s=300)[-1]
    assert last.true_airspeed_factor == pytest.approx(FACTOR, abs=0.012)
    assert last.wind_speed_m_s == pytest.approx(WIND_M_S, abs=0.4)


def test_a_plane_without_an_airspeed_sensor_and_a_hover_measure_nothing() -> None:
    air_data = AirData()
    air_data.over_ground(Position(0, 0, 0.0, 0.0, ALTITUDE_M, 100.0, 20.0, 0.0, 0.0, 0.0))
    for airspeed_m_s in (None, 3.0):
        for at_s in range(100):
            speed = Speed(at_s * 1_000_000, airspeed_m_s, 20.0, 0.0, 50)
            assert air_data.new_report(speed, "hawk", at_s * 1_000_000) is None


def test_the_time_home_follows_from_the_measured_air() -> None:
    """The autopilot's estimate of the wind is replaced, for two minutes."""
    limits = ("vehicles.0.endurance_s=3600", "vehicles.0.turn_radius_m=1")
    vehicles = Vehicles(landscape_of(load_scenario("demo")), *limits)
    hawk = vehicles.core.vehicles["hawk"]

    def time_home_s(*events: WindMeasured | AirDataMeasured) -> float:
        for event in events:
            vehicles.handle(event)
        vehicles.at(CRUISE_M, later_s=2.0)
        assert hawk.energy.estimate is not None
        return hawk.energy.estimate.time_home_s

    fix = hawk.availability.fix
    assert fix is not None
    standard = true_airspeed_factor(fix.altitude_m)
    calm_s = time_home_s(WindMeasured(vehicles.at_us, "hawk", 0.0, 0.0))
    away_s = time_home_s(WindMeasured(vehicles.at_us, "hawk", 5.0, 270.0))
    assert away_s != pytest.approx(calm_s, rel=0.05)
    fast = AirDataMeasured(vehicles.at_us, "hawk", round(1.25 * standard, 4), 0.0, 0.0)
    assert time_home_s(fast) == pytest.approx(calm_s / 1.25, rel=0.02)
    vehicles.at(CRUISE_M, later_s=130.0)
    later_s = time_home_s(WindMeasured(vehicles.at_us, "hawk", 5.0, 270.0))
    assert later_s != pytest.approx(calm_s / 1.25, rel=0.05)


def test_the_air_is_measured_in_a_flight_along_a_front(tmp_path: Path) -> None:
    short = ("start_s=3500", "duration_s=4700", "vehicles.0.airspeed_m_s=15")
    scenario = load_scenario("default", short)
    path = tmp_path / "j.jsonl"
    sim.simulate(scenario, path, "")
    contents = [entry.content for entry in SegmentReader(path)]
    last = [each for each in contents if isinstance(each, AirDataMeasured)][-1]
    wind = [each for each in contents if isinstance(each, WindMeasured)][-1]
    assert last.wind_speed_m_s == pytest.approx(wind.speed_m_s, abs=0.5)
    assert 0.99 < last.true_airspeed_factor < 1.06
