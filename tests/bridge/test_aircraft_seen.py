"""Reports of other aircraft from an on-board ADS-B receiver."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.vehicle.aircraft_seen import aircraft_seen

VALID = (
    mavlink.ADSB_FLAGS_VALID_COORDS
    | mavlink.ADSB_FLAGS_VALID_ALTITUDE
    | mavlink.ADSB_FLAGS_VALID_HEADING
    | mavlink.ADSB_FLAGS_VALID_VELOCITY
    | mavlink.ADSB_FLAGS_VALID_CALLSIGN
)


def report(**changed: Any) -> mavlink.MAVLink_adsb_vehicle_message:
    values: dict[str, Any] = {
        "ICAO_address": 0xA00001,
        "lat": 363000000,
        "lon": -841000000,
        "altitude_type": mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC,
        "altitude": 500_000,
        "heading": 9000,
        "hor_velocity": 5000,
        "ver_velocity": -200,
        "callsign": b"N123",
        "emitter_type": mavlink.ADSB_EMITTER_TYPE_LIGHT,
        "tslc": 2,
        "flags": VALID,
        "squawk": 0,
    }
    return mavlink.MAVLink_adsb_vehicle_message(**{**values, **changed})


def test_a_report_is_decoded() -> None:
    seen = aircraft_seen(report(), 7)
    assert seen is not None
    assert (seen.icao_address, seen.lat_deg, seen.lon_deg) == (0xA00001, 36.3, -84.1)
    assert (seen.altitude_m, seen.pressure_altitude, seen.age_s) == (500.0, False, 2.0)
    assert (seen.track_deg, seen.ground_speed_m_s, seen.climb_m_s) == (90.0, 50.0, -2.0)
    assert (seen.at_us, seen.callsign) == (7, "N123")


def test_what_is_not_valid_is_unknown() -> None:
    seen = aircraft_seen(report(flags=VALID & 3), 0)
    assert seen is not None
    assert (seen.track_deg, seen.ground_speed_m_s, seen.climb_m_s) == (None, None, None)
    assert seen.callsign == ""


@pytest.mark.parametrize(
    "changed",
    [
        {"flags": VALID & ~mavlink.ADSB_FLAGS_VALID_COORDS},
        {"flags": VALID & ~mavlink.ADSB_FLAGS_VALID_ALTITUDE},
        {"flags": VALID | mavlink.ADSB_FLAGS_SIMULATED},
        {"emitter_type": mavlink.ADSB_EMITTER_TYPE_SERVICE_SURFACE},
        {"emitter_type": mavlink.ADSB_EMITTER_TYPE_EMERGENCY_SURFACE},
        {"emitter_type": mavlink.ADSB_EMITTER_TYPE_POINT_OBSTACLE},
        {"lat": 910000000},
    ],
)
def test_a_report_that_cannot_be_a_flying_aircraft_is_not_used(changed: dict[str, int]) -> None:
    assert aircraft_seen(report(**changed), 0) is None
