"""Decodes reports of other aircraft from an on-board ADS-B receiver (ADSB_VEHICLE)."""

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.links.field_limits import out_of_bounds

ADSB_VEHICLE = "ADSB_VEHICLE"
NEEDED = mavlink.ADSB_FLAGS_VALID_COORDS | mavlink.ADSB_FLAGS_VALID_ALTITUDE
ON_GROUND = (
    mavlink.ADSB_EMITTER_TYPE_EMERGENCY_SURFACE,
    mavlink.ADSB_EMITTER_TYPE_SERVICE_SURFACE,
    mavlink.ADSB_EMITTER_TYPE_POINT_OBSTACLE,
)


@dataclass(frozen=True, slots=True)
class AircraftSeen:
    """Another aircraft; speeds and track are None if unknown.

    ``altitude_m`` is above mean sea level, or the altitude in the standard atmosphere if
    ``pressure_altitude`` is set. ``age_s`` is the time since the aircraft was last received.
    """

    at_us: int
    icao_address: int
    lat_deg: float
    lon_deg: float
    altitude_m: float
    pressure_altitude: bool
    track_deg: float | None
    ground_speed_m_s: float | None
    climb_m_s: float | None
    callsign: str
    age_s: float


def aircraft_seen(message: Message, at_us: int) -> AircraftSeen | None:
    """Decode an ADSB_VEHICLE; return None for a report that is not used.

    Not used are reports without a position or an altitude, of simulated aircraft
    (``ADSB_FLAGS_SIMULATED``), and of vehicles and obstacles on the ground. ``at_us`` is the time
    of reception.
    """
    flags = message.flags
    real = not flags & mavlink.ADSB_FLAGS_SIMULATED and message.emitter_type not in ON_GROUND
    if flags & NEEDED != NEEDED or not real or out_of_bounds(message) is not None:
        return None
    motion = flags & mavlink.ADSB_FLAGS_VALID_VELOCITY
    callsign = message.callsign if flags & mavlink.ADSB_FLAGS_VALID_CALLSIGN else ""
    vertical = flags & mavlink.ADSB_FLAGS_VERTICAL_VELOCITY_VALID
    return AircraftSeen(
        at_us,
        message.ICAO_address & 0xFFFFFF,
        message.lat / 1e7,
        message.lon / 1e7,
        message.altitude / 1e3,
        message.altitude_type == mavlink.ADSB_ALTITUDE_TYPE_PRESSURE_QNH,
        message.heading / 100.0 if flags & mavlink.ADSB_FLAGS_VALID_HEADING else None,
        message.hor_velocity / 100.0 if motion else None,
        message.ver_velocity / 100.0 if vertical or motion else None,
        callsign if isinstance(callsign, str) else callsign.decode("ascii", "replace"),
        float(message.tslc),
    )
