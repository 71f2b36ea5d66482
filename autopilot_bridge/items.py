"""Defines mission items as the mission protocol transmits them (MISSION_ITEM_INT)."""

import math
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

NO_POSITION = 2**31 - 1  # means that x or y is undefined, like NaN in a float field
WITH_YAW = (
    mavlink.MAV_CMD_NAV_WAYPOINT,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_NAV_TAKEOFF,
)
TAKEOFFS = (mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_TAKEOFF)
LANDINGS = (mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND)
AMSL_FRAMES = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
RELATIVE_FRAMES = (
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
)
LOCAL_FRAMES = (1, 4, 7, 8, 9, 12, 20, 21)


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item of a mission; the sequence number of an item is its index in the mission.

    Args:
        command: MAV_CMD.
        frame: MAV_FRAME.
        x: Latitude in 1e-7 degrees, for items with a position.
        y: Longitude in 1e-7 degrees, for items with a position.
        z: Altitude in metres above the reference of ``frame`` (sea level, home or terrain).
        param1: Parameter 1 as the MAV_CMD defines it; likewise ``param2`` to ``param4``.
        autocontinue: 1 to continue with the next item.

    Source: MAVLink common.xml, MISSION_ITEM_INT.
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


Items = tuple[MissionItem, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """The contents of a plan file, as items of the mission protocol.

    Args:
        mission: Items; the target of a DO_JUMP is an index in ``mission``, from 0.
        fence: MAV_CMD_NAV_FENCE_* items.
        rally: MAV_CMD_NAV_RALLY_POINT items.
        home: (lat_deg, lon_deg, altitude_amsl_m) in degrees and metres, or None.
    """

    mission: Items
    fence: Items = ()
    rally: Items = ()
    home: tuple[float, float, float] | None = None


def jumps_moved(items: Sequence[MissionItem], by: int) -> Items:
    """Return the items with ``by`` added to all DO_JUMP targets, e.g. 1 if home comes first."""
    return tuple(
        replace(item, param1=item.param1 + by) if item.command == mavlink.MAV_CMD_DO_JUMP else item
        for item in items
    )


def yaw_left_open(items: Sequence[MissionItem]) -> Items:
    """Return the items with each yaw (param4) set to NaN, for items from JSON, which has no NaN."""
    return tuple(
        replace(item, param4=math.nan) if item.command in WITH_YAW else item for item in items
    )


def has_position(command: int) -> bool:
    """Return whether the command has a latitude and longitude; True for an unknown command."""
    entry = mavlink.enums["MAV_CMD"].get(command)
    return entry is None or bool(entry.has_location)


def at_altitudes(
    items: Items, frames: Container[int], altitude_of: Callable[[float], float]
) -> Items:
    """Return items with other altitudes.

    Args:
        items: The items of a mission.
        frames: The MAV_FRAMEs of the items that are changed; items without a position are not.
        altitude_of: Returns the new altitude in metres for the present one.
    """
    return tuple(
        replace(item, z=altitude_of(item.z))
        if item.frame in frames and has_position(item.command)
        else item
        for item in items
    )


def has_degrees(item: "MissionItem") -> bool:
    """Return whether x and y are a latitude and a longitude."""
    frames = (*LOCAL_FRAMES, mavlink.MAV_FRAME_MISSION)
    return item.frame not in frames and has_position(item.command)


def place_of(item: "MissionItem") -> tuple[float, float] | None:
    """Return an item's latitude and longitude in degrees; None if it has none or both are 0."""
    if not has_degrees(item) or NO_POSITION in (item.x, item.y) or item.x == item.y == 0:
        return None
    return item.x / 1e7, item.y / 1e7


def command_name(command: int) -> str:
    """Return a command's name without the prefix MAV_CMD_, or its number if it has no name."""
    entry = mavlink.enums["MAV_CMD"].get(command)
    return str(command) if entry is None else str(entry.name).removeprefix("MAV_CMD_")


def _xy_unit(command: int, frame: int) -> float:
    """Return the divisor of ``x`` and ``y``: 1e7 (degrees), 1e4 (metres), or 1 (no position)."""
    if frame in LOCAL_FRAMES:
        return 1e4
    return 1e7 if frame != mavlink.MAV_FRAME_MISSION and has_position(command) else 1.0


def params_of(item: MissionItem) -> tuple[float, ...]:
    """Return params 1 to 7 as in files: the position in degrees (or metres), NaN if undefined."""
    unit = _xy_unit(item.command, item.frame)
    x, y = (math.nan if value == NO_POSITION else value / unit for value in (item.x, item.y))
    return item.param1, item.param2, item.param3, item.param4, x, y, item.z


def item_of_params(
    command: int, frame: int, params: Sequence[float], autocontinue: int
) -> MissionItem:
    """Return the item for params 1 to 7 of a file. Raises ValueError if x or y is out of range."""
    param1, param2, param3, param4, *position, z = params
    unit = _xy_unit(command, frame)
    x, y = (NO_POSITION if math.isnan(value) else round(value * unit) for value in position)
    for name, value in (("param 5", x), ("param 6", y)):
        if not -(2**31) <= value < 2**31:
            raise ValueError(f"{name} ({value / unit:g}) is out of range for a mission item")
    return MissionItem(command, frame, x, y, z, param1, param2, param3, param4, autocontinue)


def _at(lat_deg: float, lon_deg: float, amsl_m: float) -> tuple[int, int, int, float]:
    """Return the frame, x, y and z of a position."""
    return mavlink.MAV_FRAME_GLOBAL, round(lat_deg * 1e7), round(lon_deg * 1e7), amsl_m


def waypoint(
    lat_deg: float, lon_deg: float, altitude_amsl_m: float, acceptance_radius_m: float = 0.0
) -> MissionItem:
    """Return a MAV_CMD_NAV_WAYPOINT at an altitude above mean sea level.

    Args:
        lat_deg: Latitude in degrees (WGS84).
        lon_deg: Longitude in degrees.
        altitude_amsl_m: Altitude above mean sea level in metres.
        acceptance_radius_m: Acceptance radius in metres; 0 means the radius set in the autopilot.

    Returns:
        The item.
    """
    place = _at(lat_deg, lon_deg, altitude_amsl_m)
    return MissionItem(mavlink.MAV_CMD_NAV_WAYPOINT, *place, param2=acceptance_radius_m)


def loiter_unlimited(
    lat_deg: float, lon_deg: float, altitude_amsl_m: float, radius_m: float
) -> MissionItem:
    """Return a MAV_CMD_NAV_LOITER_UNLIM: the vehicle circles until it gets another command.

    Args:
        lat_deg: Latitude of the centre in degrees (WGS84).
        lon_deg: Longitude of the centre in degrees.
        altitude_amsl_m: Altitude above mean sea level in metres.
        radius_m: Radius in metres; negative if anticlockwise.

    Returns:
        The item.
    """
    place = _at(lat_deg, lon_deg, altitude_amsl_m)
    return MissionItem(mavlink.MAV_CMD_NAV_LOITER_UNLIM, *place, param3=radius_m)


def speed_type(vehicle_kind: str) -> int:
    """Return the SPEED_TYPE for speed commands to a ``plane``, ``vtol`` or ``copter``."""
    copter = vehicle_kind == "copter"
    return int(mavlink.SPEED_TYPE_GROUNDSPEED if copter else mavlink.SPEED_TYPE_AIRSPEED)


def change_speed(kind: int, speed_m_s: float) -> MissionItem:
    """Return a MAV_CMD_DO_CHANGE_SPEED that keeps the throttle; ``kind`` is a SPEED_TYPE."""
    return MissionItem(
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_FRAME_MISSION,  # PX4 rejects other frames
        x=0,
        y=0,
        z=0.0,
        param1=float(kind),
        param2=speed_m_s,
        param3=-1.0,
    )


def camera_trigger(distance_m: float) -> MissionItem:
    """Return a MAV_CMD_DO_SET_CAM_TRIGG_DIST: an image every ``distance_m``; 0 means no images."""
    return MissionItem(
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        mavlink.MAV_FRAME_MISSION,
        x=0,
        y=0,
        z=0.0,
        param1=distance_m,
    )


def gimbal_pitch(pitch_deg: float) -> MissionItem:
    """Return a MAV_CMD_DO_MOUNT_CONTROL that tilts the gimbal; -90 is straight down.

    In missions PX4 1.17 denies DO_GIMBAL_MANAGER_PITCHYAW unless a mission item has taken control
    of the gimbal before; both stacks accept DO_MOUNT_CONTROL without such an item.
    """
    return MissionItem(
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_FRAME_MISSION,
        x=0,
        y=0,
        z=float(mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING),
        param1=pitch_deg,
    )


def takeoff(
    lat_deg: float, lon_deg: float, altitude_amsl_m: float, pitch_deg: float = 12.0
) -> MissionItem:
    """Return a MAV_CMD_NAV_TAKEOFF.

    Args:
        lat_deg: Latitude in degrees (WGS84).
        lon_deg: Longitude in degrees.
        altitude_amsl_m: Altitude at the end of the climb, in metres above mean sea level.
        pitch_deg: Pitch of a plane during the climb, in degrees.

    Returns:
        The item.
    """
    place = _at(lat_deg, lon_deg, altitude_amsl_m)
    return MissionItem(mavlink.MAV_CMD_NAV_TAKEOFF, *place, param1=pitch_deg)


def vtol_takeoff(lat_deg: float, lon_deg: float, height_m: float) -> MissionItem:
    """Return a MAV_CMD_NAV_VTOL_TAKEOFF, with a height instead of an altitude.

    ArduPlane 4.6.2 climbs to this height above its position on the ground, in every frame.

    Args:
        lat_deg: Latitude in degrees (WGS84) of the position that PX4 flies to as a plane after the
            climb; ArduPlane ignores it.
        lon_deg: Longitude in degrees, likewise.
        height_m: Height in metres above home up to which the vehicle climbs vertically.

    Returns:
        The item.
    """
    place = (round(lat_deg * 1e7), round(lon_deg * 1e7), height_m)
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    return MissionItem(mavlink.MAV_CMD_NAV_VTOL_TAKEOFF, frame, *place)


def fly_as_plane() -> MissionItem:
    """Return a MAV_CMD_DO_VTOL_TRANSITION to forward flight; no effect in forward flight."""
    return MissionItem(
        mavlink.MAV_CMD_DO_VTOL_TRANSITION,
        mavlink.MAV_FRAME_MISSION,
        x=0,
        y=0,
        z=0.0,
        param1=float(mavlink.MAV_VTOL_STATE_FW),
    )
