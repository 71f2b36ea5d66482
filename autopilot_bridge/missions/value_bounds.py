"""Bounds of message fields: values that are not finite or not plausible are discarded. Pure.

One table covers all messages from which the bridge reads a vehicle's state. A message with any
value out of bounds is discarded as a whole. Integers that mean "unknown" are allowed by name;
floats that may be NaN for "unknown" (``UNKNOWN``) are decoded as such.

Sources: common.xml of MAVLink for units and unknowns; latitude, longitude and angles by definition;
heights from the Dead Sea (-430 m) to twice the ceiling of any aircraft here; speeds of air from
the fastest gust measured (113 m/s, Barrow Island 1996, WMO), of aircraft below half of sound's;
numbers of items from the longest list of either stack (``stacks/stacks.py``).
"""

import math
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

from autopilot_bridge.items import NO_POSITION, MissionItem, has_degrees
from autopilot_bridge.links.codec import Message

MAX_ITEMS = 5000
GUST_M_S = 115.0
SPEED_M_S = 150.0
TURN_RAD = 2.0 * math.pi
LOWEST_M, HIGHEST_M = -1000.0, 30_000.0
MAX_PARAM = 1e12  # of an item; no command has values near it


class Bound(NamedTuple):
    """Minimum and maximum of a field; ``also`` is a value beyond them that means unknown."""

    field: str
    least: float
    most: float
    also: float | None = None


BOUNDS: Final[dict[str, tuple[Bound, ...]]] = {
    "GLOBAL_POSITION_INT": (
        Bound("lat", -90e7, 90e7),
        Bound("lon", -180e7, 180e7),
        Bound("alt", LOWEST_M * 1e3, HIGHEST_M * 1e3),
        Bound("relative_alt", -HIGHEST_M * 1e3, HIGHEST_M * 1e3),
        Bound("vx", -SPEED_M_S * 1e2, SPEED_M_S * 1e2),
        Bound("vy", -SPEED_M_S * 1e2, SPEED_M_S * 1e2),
        Bound("vz", -SPEED_M_S * 1e2, SPEED_M_S * 1e2),
        Bound("hdg", 0, 36_000, 65_535),
    ),
    "ATTITUDE": (
        Bound("roll", -TURN_RAD, TURN_RAD),
        Bound("pitch", -TURN_RAD, TURN_RAD),
        Bound("yaw", -TURN_RAD, TURN_RAD),
    ),
    "VFR_HUD": (
        Bound("airspeed", -SPEED_M_S, SPEED_M_S),
        Bound("groundspeed", -SPEED_M_S, SPEED_M_S),
        Bound("climb", -SPEED_M_S, SPEED_M_S),
        Bound("throttle", 0, 200),
    ),
    "WIND": (Bound("direction", -360.0, 360.0), Bound("speed", 0.0, GUST_M_S)),
    "WIND_COV": (Bound("wind_x", -GUST_M_S, GUST_M_S), Bound("wind_y", -GUST_M_S, GUST_M_S)),
    "SYS_STATUS": (Bound("battery_remaining", -1, 100), Bound("current_battery", -32_768, 32_767)),
    "BATTERY_STATUS": (
        Bound("battery_remaining", -1, 100),
        Bound("current_battery", -32_768, 32_767),
    ),
    "MISSION_CURRENT": (Bound("seq", 0, MAX_ITEMS),),
    "MISSION_ITEM_REACHED": (Bound("seq", 0, MAX_ITEMS),),
    "MISSION_COUNT": (Bound("count", 0, MAX_ITEMS),),
    "MISSION_ITEM": (Bound("x", -MAX_PARAM, MAX_PARAM), Bound("y", -MAX_PARAM, MAX_PARAM)),
    "STATUSTEXT": (Bound("severity", 0, 7),),
}
# Fields that are NaN if unknown.
UNKNOWN: Final = {
    "VFR_HUD": ("airspeed",),  # of PX4 multirotors
    "WIND_COV": ("wind_x", "wind_y"),
}


def out_of_bounds(message: Message) -> str | None:
    """The first value of a message that is out of bounds, in words; None if there is none."""
    kind = message.get_type()
    for field, least, most, also in BOUNDS.get(kind, ()):
        value = getattr(message, field)
        if not least <= value <= most and value != also and not _unknown(kind, field, value):
            return f"{kind}.{field} is {value:g}"
    if kind in ("MISSION_ITEM_INT", "MISSION_ITEM"):
        return _absurd_item(message)
    return None


def _unknown(kind: str, field: str, value: Any) -> bool:
    return field in UNKNOWN.get(kind, ()) and math.isnan(value)


def list_out_of_bounds(items: Iterable[MissionItem]) -> str | None:
    """The first value of the items that is out of bounds, in words; None if there is none."""
    found = (f"item {n}: {words}" for n, item in enumerate(items) if (words := _absurd_item(item)))
    return next(found, None)


def _absurd_item(item: MissionItem | Message) -> str | None:
    """The first value of a wire item that is out of bounds; its parameters may be NaN."""
    for field in ("param1", "param2", "param3", "param4"):
        value = getattr(item, field)
        if not (abs(value) <= MAX_PARAM or math.isnan(value)):
            return f"MISSION_ITEM_INT.{field} is {value:g}"
    if not (abs(item.z) <= MAX_PARAM or math.isnan(item.z)):
        return f"MISSION_ITEM_INT.z is {item.z:g}"
    if has_degrees(item) and isinstance(item.x, int):
        for field, most in (("x", 90e7), ("y", 180e7)):
            value = getattr(item, field)
            if abs(value) > most and value != NO_POSITION:
                return f"MISSION_ITEM_INT.{field} is {value}"
    return None
