"""A failed engine, detected in VFR_HUD."""

from collections.abc import Iterable

from autopilot_bridge.vehicle.client_events import Speed
from mission_service.runtime.thrust_loss import ThrustMonitor

EVERY_US = 500_000
Flown = tuple[float | None, float, int]  # airspeed, climb, throttle


def thrust(flown: Iterable[Flown]) -> list[tuple[float, bool]]:
    monitor, found = ThrustMonitor(), []
    for number, (airspeed_m_s, climb_m_s, throttle) in enumerate(flown):
        at_us = number * EVERY_US
        speed = Speed(at_us, airspeed_m_s, 15.0, climb_m_s, throttle)
        if (change := monitor.new_report(speed, "hawk", at_us)) is not None:
            found.append((change.at_us / 1e6, change.sufficient))
    return found


CRUISE: list[Flown] = [(18.0, 0.0, 45)] * 40  # twenty seconds


def test_a_plane_that_sinks_at_full_throttle_and_loses_airspeed_is_reported_and_its_end() -> None:
    fails: list[Flown] = [(18.0 - 1.5 * n, -2.5, 100) for n in range(6)]
    glides: list[Flown] = [(11.0, -2.5, 100)] * 40
    assert thrust([*CRUISE, *fails, *glides]) == [(21.5, False)]
    assert thrust([*CRUISE, *fails, *glides, *CRUISE]) == [(21.5, False), (53.0, True)]


def test_a_slow_loss_of_airspeed_in_uneven_air_is_reported() -> None:
    """On ArduPlane 4.6.2 with SIM_ENGINE_FAIL the mean of 10 s fell with the airspeed."""
    cruise: list[Flown] = [(14.9, 0.0, 23)] * 40
    fails: list[Flown] = [
        *((14.3, -0.9, 33), (13.4, -2.0, 40), (12.7, -1.1, 50), (12.1, -1.9, 59)),
        *((11.7, -1.9, 65), (11.3, -1.3, 70), (11.1, -2.4, 76), (10.9, -0.4, 82)),
        *((10.2, -1.6, 86), (10.1, -1.1, 92), (9.7, 0.0, 97), (9.1, -1.6, 100)),
        *((9.0, -0.8, 100), (8.6, -0.2, 100), (8.3, -3.9, 100), (9.5, -4.7, 100)),
        *((10.4, -1.7, 100), (10.3, -1.7, 100), (10.3, -2.5, 100), (10.3, -1.1, 100)),
    ]
    glides: list[Flown] = [(9.4, -1.6, 100)] * 30
    assert thrust([*cruise, *fails, *glides]) == [(24.0, False)]


def test_a_vehicle_without_a_measured_airspeed_is_reported_too() -> None:
    assert thrust([(None, 0.0, 40)] * 4 + [(None, -3.0, 95)] * 4) == [(3.5, False)]


def test_a_plane_that_levels_off_or_dives_is_not_reported() -> None:
    levels_off: list[Flown] = [(11.0 + 0.3 * n, -1.3, 86) for n in range(10)]
    assert thrust([*[(11.0, 3.0, 100)] * 40, *levels_off]) == []
    assert thrust([*CRUISE, *[(19.0, -2.3, 100)] * 60]) == []  # a descent, as flown by PX4
    assert thrust([*CRUISE, *[(15.0, -3.0, 0)] * 20]) == []  # a glide that was ordered
    assert thrust([*CRUISE, (15.0, -3.0, 100), *CRUISE]) == []  # a single gust
