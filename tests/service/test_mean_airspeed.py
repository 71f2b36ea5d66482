"""The mean airspeed, by VFR_HUD."""

from itertools import pairwise

from autopilot_bridge.vehicle.client_events import Speed
from mission_service.runtime.air_data import MeanAirspeed

EVERY_US = 500_000


def test_a_mean_airspeed_is_reported_when_it_has_changed() -> None:
    mean, found = MeanAirspeed(), []
    for number, airspeed_m_s in enumerate([*[18.0] * 80, *[12.0] * 80, *[12.3] * 80]):
        at_us = number * EVERY_US
        change = mean.new_report(Speed(at_us, airspeed_m_s, 15.0, 0.0, 45), "hawk", at_us)
        found += [] if change is None else [change.airspeed_m_s]
    assert (found[0], found[-1]) == (18.0, 12.0)
    assert all(abs(one - other) >= 0.5 for one, other in pairwise(found))


def test_a_vehicle_without_an_airspeed_sensor_reports_no_mean() -> None:
    mean = MeanAirspeed()
    speeds = [Speed(number * EVERY_US, None, 15.0, 0.0, 45) for number in range(80)]
    assert {mean.new_report(speed, "hawk", speed.at_us) for speed in speeds} == {None}
