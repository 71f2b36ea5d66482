"""Mission items as the mission protocol carries them (MISSION_ITEM_INT)."""

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item; its sequence number is its place in the mission.

    ``x``, ``y`` are latitude and longitude in 1e-7 degrees for position items; ``z`` is an altitude
    in metres as the frame says.
    """

    command: int
    frame: int
    x: int
    y: int
    z: float
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    autocontinue: int = 1


def _at(lat_deg: float, lon_deg: float) -> tuple[int, int]:
    return round(lat_deg * 1e7), round(lon_deg * 1e7)


def waypoint(
    lat_deg: float, lon_deg: float, altitude_amsl_m: float, acceptance_radius_m: float = 0.0
) -> MissionItem:
    """MAV_CMD_NAV_WAYPOINT at an altitude above mean sea level."""
    x, y = _at(lat_deg, lon_deg)
    return MissionItem(
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_FRAME_GLOBAL,
        x,
        y,
        altitude_amsl_m,
        param2=acceptance_radius_m,
    )


def loiter_unlimited(
    lat_deg: float, lon_deg: float, altitude_amsl_m: float, radius_m: float
) -> MissionItem:
    """MAV_CMD_NAV_LOITER_UNLIM; a negative radius is flown anticlockwise."""
    x, y = _at(lat_deg, lon_deg)
    return MissionItem(
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_FRAME_GLOBAL,
        x,
        y,
        altitude_amsl_m,
        param3=radius_m,
    )


def takeoff(
    lat_deg: float, lon_deg: float, altitude_amsl_m: float, pitch_deg: float = 12.0
) -> MissionItem:
    """MAV_CMD_NAV_TAKEOFF up to an altitude above mean sea level."""
    x, y = _at(lat_deg, lon_deg)
    return MissionItem(
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_FRAME_GLOBAL,
        x,
        y,
        altitude_amsl_m,
        param1=pitch_deg,
    )
