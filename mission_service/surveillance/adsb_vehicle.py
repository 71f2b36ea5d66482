"""Applies reports from ADS-B receivers on board vehicles (MAVLink ADSB_VEHICLE). Pure."""

from autopilot_bridge.vehicle.aircraft_seen import AircraftSeen
from mission_service.surveillance.aircraft_table import (
    AircraftTable,
    callsign_of,
    set_climb,
    set_course,
)


def apply_seen(table: AircraftTable, vehicle: str, seen: AircraftSeen, at_us: int) -> None:
    """Update a table with an aircraft from a vehicle's receiver; ``at_us``: mission time.

    The altitude in a report is either above mean sea level or a pressure altitude.
    """
    altitude_m = seen.altitude_m + (table.pressure_offset_m if seen.pressure_altitude else 0.0)
    place = (seen.lat_deg, seen.lon_deg, altitude_m)
    measured_us = at_us - round(1e6 * seen.age_s)
    track = table.place(f"{seen.icao_address:06x}", f"mavlink {vehicle}", measured_us, place)
    if track is None:
        return
    if seen.ground_speed_m_s is not None and seen.track_deg is not None:
        set_course(track, seen.ground_speed_m_s, seen.track_deg)
    if seen.climb_m_s is not None:
        set_climb(track, seen.climb_m_s)
    track.callsign = callsign_of(seen.callsign)
