"""Checks the values of message fields against bounds, to discard messages with implausible values.

One table covers all messages from which the bridge reads a vehicle's state. If any value of a
message is not finite or is out of bounds, the whole message is discarded. ``Bound.also`` is the
integer that means "unknown" in a field. ``UNKNOWN`` contains the float fields that are NaN if
unknown.

Units and unknown values are those of MAVLink's common.xml. Heights range from the Dead Sea (-430 m)
to twice the ceiling of any supported aircraft. The limit of wind speeds is just above the fastest
measured gust (113 m/s, Barrow Island 1996, WMO), and the limit of aircraft speeds is below half of
the speed of sound. The limit of item numbers is the length of the longest list that a stack accepts
(``stacks/stacks.py``). Latitude, longitude and angles are bounded by their definitions.
"""

import math
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

from autopilot_bridge.items import NO_POSITION, MissionItem, has_degrees
from autopilot_bridge.links.codec import Message

MAX_ITEMS = 5000
GUST_M_S = 115.0
SPEED_M_S = 150.0
TURN_RAD, TURN_DEG = 2.0 * math.pi, 360.0
MAX_IMAGES = 10_000_000  # a camera at 10 Hz for eleven days
LOWEST_M, HIGHEST_M = -1000.0, 30_000.0
MAX_PARAM = 1e12  # maximum of an item's params; all valid values are far smaller


class Bound(NamedTuple):
    """The minimum and maximum of a field; ``also`` is another value, which means "unknown"."""

    field: str
    least: float
    most: float
    also: float | None = None


_LENS = ("focal_length", "sensor_size_h", "sensor_size_v")
_BATTERY = (Bound("battery_remaining", -1, 100), Bound("current_battery", -32_768, 32_767))
BOUNDS: Final[dict[str, tuple[Bound, ...]]] = {
    "GLOBAL_POSITION_INT": (
        Bound("lat", -90e7, 90e7),
        Bound("lon", -180e7, 180e7),
        Bound("alt", LOWEST_M * 1e3, HIGHEST_M * 1e3),
        Bound("relative_alt", -HIGHEST_M * 1e3, HIGHEST_M * 1e3),
        *(Bound(field, -SPEED_M_S * 1e2, SPEED_M_S * 1e2) for field in ("vx", "vy", "vz")),
        Bound("hdg", 0, 36_000, 65_535),
    ),
    "ATTITUDE": tuple(Bound(field, -TURN_RAD, TURN_RAD) for field in ("roll", "pitch", "yaw")),
    "VFR_HUD": (
        *(Bound(field, -SPEED_M_S, SPEED_M_S) for field in ("airspeed", "groundspeed", "climb")),
        Bound("throttle", 0, 200),
    ),
    "WIND": (Bound("direction", -360.0, 360.0), Bound("speed", 0.0, GUST_M_S)),
    "WIND_COV": (Bound("wind_x", -GUST_M_S, GUST_M_S), Bound("wind_y", -GUST_M_S, GUST_M_S)),
    "SYS_STATUS": _BATTERY,
    "BATTERY_STATUS": _BATTERY,
    "MISSION_CURRENT": (Bound("seq", 0, MAX_ITEMS),),
    "MISSION_ITEM_REACHED": (Bound("seq", 0, MAX_ITEMS),),
    "MISSION_COUNT": (Bound("count", 0, MAX_ITEMS),),
    "MISSION_ITEM": (Bound("x", -MAX_PARAM, MAX_PARAM), Bound("y", -MAX_PARAM, MAX_PARAM)),
    "STATUSTEXT": (Bound("severity", 0, 7),),
    "CAMERA_IMAGE_CAPTURED": (
        Bound("lat", -90e7, 90e7),
        Bound("lon", -180e7, 180e7),
        Bound("alt", LOWEST_M * 1e3, HIGHEST_M * 1e3),
        Bound("image_index", 0, MAX_IMAGES),
    ),
    "CAMERA_FEEDBACK": (
        Bound("lat", -90e7, 90e7),
        Bound("lng", -180e7, 180e7),
        Bound("alt_msl", LOWEST_M, HIGHEST_M),
        *(Bound(field, -TURN_DEG, TURN_DEG) for field in ("roll", "pitch", "yaw")),
    ),
    "MOUNT_ORIENTATION": tuple(
        Bound(field, -TURN_DEG, TURN_DEG) for field in ("roll", "pitch", "yaw", "yaw_absolute")
    ),
    "CAMERA_FOV_STATUS": tuple(Bound(field, 0.0, 360.0) for field in ("hfov", "vfov")),
    "CAMERA_INFORMATION": tuple(Bound(field, 0.0, 10_000.0) for field in _LENS),
    "CAMERA_THERMAL_RANGE": (Bound("max", -100.0, 5000.0),),
    "ADSB_VEHICLE": (
        Bound("lat", -90e7, 90e7),
        Bound("lon", -180e7, 180e7),
        Bound("altitude", LOWEST_M * 1e3, HIGHEST_M * 1e3),
        Bound("heading", 0, 36_000),
    ),
    "CAMERA_TRACKING_GEO_STATUS": (
        Bound("lat", -90e7, 90e7, 2**31 - 1),
        Bound("lon", -180e7, 180e7, 2**31 - 1),
    ),
}
# Fields that are NaN if unknown.
UNKNOWN: Final = {
    "VFR_HUD": ("airspeed",),  # NaN on PX4 multirotors
    "WIND_COV": ("wind_x", "wind_y"),
    "MOUNT_ORIENTATION": ("yaw_absolute",),
    "CAMERA_FOV_STATUS": ("hfov", "vfov"),
    "CAMERA_INFORMATION": _LENS,
    "CAMERA_THERMAL_RANGE": ("max",),
}


def out_of_bounds(message: Message) -> str | None:
    """Describe a message's first value out of bounds; None if all values are within bounds."""
    kind = message.get_type()
    for field, minimum, maximum, also in BOUNDS.get(kind, ()):
        value = getattr(message, field)
        if not minimum <= value <= maximum and value != also and not _unknown(kind, field, value):
            return f"{kind}.{field} is {value:g}"
    if kind in ("MISSION_ITEM_INT", "MISSION_ITEM"):
        return _item_out_of_bounds(message)
    return None


def _unknown(kind: str, field: str, value: Any) -> bool:
    return field in UNKNOWN.get(kind, ()) and math.isnan(value)


def list_out_of_bounds(items: Iterable[MissionItem]) -> str | None:
    """Describe the items' first value out of bounds; None if all values are within bounds."""
    found = (
        f"item {n}: {words}" for n, item in enumerate(items) if (words := _item_out_of_bounds(item))
    )
    return next(found, None)


def _item_out_of_bounds(item: MissionItem | Message) -> str | None:
    """Describe an item's first value out of bounds, or return None; NaN is valid in params."""
    for field in ("param1", "param2", "param3", "param4"):
        value = getattr(item, field)
        if not (abs(value) <= MAX_PARAM or math.isnan(value)):
            return f"MISSION_ITEM_INT.{field} is {value:g}"
    if not (abs(item.z) <= MAX_PARAM or math.isnan(item.z)):
        return f"MISSION_ITEM_INT.z is {item.z:g}"
    if has_degrees(item) and isinstance(item.x, int):
        for field, maximum in (("x", 90e7), ("y", 180e7)):
            value = getattr(item, field)
            if abs(value) > maximum and value != NO_POSITION:
                return f"MISSION_ITEM_INT.{field} is {value}"
    return None
