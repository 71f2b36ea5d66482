"""Wind and true airspeed follow from flight on several headings, and determine the time home."""

import math
from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np
import pytest
from numpy.typing import NDArray

from autopilot_bridge.stacks.return_flight import true_airspeed_factor
from autopilot_bridge.vehicle.client_events import Position, Speed
from mission_service.config.scenario import load_scenario
from mission_service.events import AirDataMeasured, WindMeasured
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import SegmentReader
from mission_service.runtime.air_data import AirData, fitted_air
from mission_service.simulation import sim
from tests.service.landing_core import CRUISE_M, Vehicles

Floats = NDArray[np.float64]
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


def samples_of(headings_deg: list[float], wind_m_s: tuple[float, float], seed: int) -> Floats:
    """Return one sample a second on these headings at a true airspeed of 22 m/s."""
    rng = np.random.default_rng(seed)
    heading_rad = np.radians(headings_deg)
    gusts = rng.normal(0.0, 0.5, (2, len(headings_deg)))
    north_m_s = 22.0 * np.cos(heading_rad) + wind_m_s[0] + gusts[0]
    east_m_s = 22.0 * np.sin(heading_rad) + wind_m_s[1] + gusts[1]
    airspeed_m_s = np.full(len(headings_deg), 22.0 / FACTOR)
    return np.column_stack([np.arange(len(headings_deg)), north_m_s, east_m_s, airspeed_m_s])


def legs_of(seed: int) -> tuple[list[float], tuple[float, float]]:
    """Return headings on six random legs, one a second, and a random wind of 14 m/s."""
    rng = Random(seed)
    toward_rad, headings_deg = rng.uniform(0.0, math.tau), []
    heading_deg = rng.uniform(0.0, 360.0)
    for _ in range(6):
        headings_deg += [heading_deg] * rng.randrange(20, 60)
        heading_deg += rng.choice((-1.0, 1.0)) * rng.uniform(20.0, 170.0)
    return headings_deg, (14.0 * math.cos(toward_rad), 14.0 * math.sin(toward_rad))


def test_a_strong_wind_is_measured_without_a_false_value_before() -> None:
    """Every value that is reported is right, from the first one."""
    known = 0
    for seed in range(30):
        headings_deg, wind_m_s = legs_of(seed)
        samples, found = samples_of(headings_deg, wind_m_s, seed), None
        for count in range(10, len(samples), 10):
            found = fitted_air(samples[:count], 1.0, found)
            if found is not None:
                assert found[:2] == pytest.approx(wind_m_s, abs=1.5)
                assert found[2] == pytest.approx(FACTOR, abs=0.04)
        known += found is not None
    assert known >= 24


def test_two_headings_agree_with_two_winds() -> None:
    samples = samples_of([0.0] * 60 + [120.0] * 60, (5.0, 0.0), 1)
    assert fitted_air(samples, FACTOR) is None


def test_outliers_have_little_weight() -> None:
    samples = samples_of([3.0 * number for number in range(200)], (5.0, 0.0), 1)
    samples[::10, 1] += 30.0
    found = fitted_air(samples, FACTOR)
    assert found is not None
    assert found[:2] == pytest.approx((5.0, 0.0), abs=0.5)
