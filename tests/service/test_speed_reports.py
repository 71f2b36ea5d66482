"""Mean airspeed and thrust, by VFR_HUD."""

from collections.abc import Iterable
from itertools import pairwise

from autopilot_bridge.vehicle.client_events import Speed
from mission_service.events import AirspeedMeasured, ThrustStatusChanged
from mission_service.runtime.speed_reports import SpeedReports

EVERY_US = 500_000
Flown = tuple[float | None, float, int]  # airspeed, climb, throttle


def reports(flown: Iterable[Flown]) -> list[AirspeedMeasured | ThrustStatusChanged]:
    found, speeds = [], SpeedReports()
    for number, (airspeed_m_s, climb_m_s, throttle) in enumerate(flown):
        at_us = number * EVERY_US
        speed = Speed(at_us, airspeed_m_s, 15.0, climb_m_s, throttle)
        found += speeds.of(speed, "hawk", at_us)
    return found


def thrust(flown: Iterable[Flown]) -> list[tuple[float, bool]]:
    events = [each for each in reports(flown) if isinstance(each, ThrustStatusChanged)]
    return [(each.at_us / 1e6, each.sufficient) for each in events]


CRUISE: list[Flown] = [(18.0, 0.0, 45)] * 40  # twenty seconds


def test_a_plane_that_sinks_at_full_throttle_and_loses_airspeed_is_reported_and_its_end() -> None:
    fails: list[Flown] = [(18.0 - 1.5 * n, -2.5, 100) for n in range(6)]
    glides: list[Flown] = [(11.0, -2.5, 100)] * 40
    assert thrust([*CRUISE, *fails, *glides]) == [(21.5, False)]
    assert thrust([*CRUISE, *fails, *glides, *CRUISE]) == [(21.5, False), (53.0, True)]


def test_a_vehicle_without_a_measured_airspeed_is_reported_too() -> None:
    assert thrust([(None, 0.0, 40)] * 4 + [(None, -3.0, 95)] * 4) == [(3.0, False)]


def test_a_plane_that_levels_off_or_dives_is_not_reported() -> None:
    levels_off: list[Flown] = [(11.0 + 0.3 * n, -1.3, 86) for n in range(10)]
    assert thrust([*[(11.0, 3.0, 100)] * 40, *levels_off]) == []
    assert thrust([*CRUISE, *[(19.0, -2.3, 100)] * 60]) == []  # a descent, PX4 as flown
    assert thrust([*CRUISE, *[(15.0, -3.0, 0)] * 20]) == []  # a glide that was ordered
    assert thrust([*CRUISE, (15.0, -3.0, 100), *CRUISE]) == []  # one gust


def test_a_mean_airspeed_is_reported_when_it_has_changed() -> None:
    events = reports([*CRUISE, *CRUISE, *[(12.0, 0.0, 45)] * 80, *[(12.3, 0.0, 45)] * 80])
    means = [each.airspeed_m_s for each in events if isinstance(each, AirspeedMeasured)]
    assert (means[0], means[-1]) == (18.0, 12.0)
    assert all(abs(one - other) >= 0.5 for one, other in pairwise(means))
