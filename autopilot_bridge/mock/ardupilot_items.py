"""What ArduPilot takes as an item, and what it makes of it: it packs items into few bytes."""

import math
import struct
from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.mock.mission_server import (
    ACCEPTED,
    CIRCLES,
    FENCE,
    MISSION,
    RALLY,
    VERTICES,
)

Rewrite = Callable[[float], float]

ABSOLUTE, RELATIVE, TERRAIN = 0, 3, 10
# Frames as they are read back; frame 2 goes with commands that have no place.
FRAMES = {0: ABSOLUTE, 2: ABSOLUTE, 5: ABSOLUTE, 3: RELATIVE, 6: RELATIVE, 10: 10, 11: 10}
RALLY_POINT = 5100


def _none(_: float) -> float:
    return 0.0


def _kept(value: float) -> float:
    return value


def _cut(value: float) -> float:
    return float(math.trunc(value))


def _byte(value: float) -> float:
    return float(min(max(math.trunc(value), 0), 255))


def _wrapped_radius(value: float) -> float:
    """16 bits and a sign: 70000 comes back as 4464."""
    return math.copysign(math.trunc(abs(value)) % 65536, value) if value else 0.0


def _turns_radius(value: float) -> float:
    """8 bits: metres up to 255, then tens of metres up to 2550."""
    size = math.trunc(abs(value))
    return math.copysign(size if size <= 255 else min(size // 10, 255) * 10, value)


def _direction(value: float) -> float:
    return -1.0 if value < 0.0 else 1.0


def _switch(value: float) -> float:
    return float(value > 0.0)


_PLACES: dict[int, tuple[Rewrite, Rewrite, Rewrite, Rewrite]] = {
    17: (_none, _none, _wrapped_radius, _none),
    18: (_byte, _none, _turns_radius, _switch),
    19: (_cut, _none, _direction, _switch),
    21: (_cut, _none, _none, _none),
    22: (_cut, _none, _none, _none),
    31: (_none, _wrapped_radius, _none, _switch),
    189: (_none, _none, _none, _none),
    201: (_cut, _cut, _none, _none),
}
_WAYPOINT = {
    "plane": (_none, _byte, _byte, _none),
    "copter": (_cut, _none, _none, _none),
}
_OTHERS: dict[int, tuple[Rewrite, Rewrite, Rewrite, Rewrite]] = {
    20: (_none, _none, _none, _none),
    93: (_kept, _cut, _cut, _cut),
    112: (_kept, _none, _none, _none),
    114: (_kept, _none, _none, _none),
    177: (_cut, _cut, _none, _none),
    178: (_kept, _kept, _kept, _none),
    181: (_cut, _cut, _none, _none),
    183: (_cut, _cut, _none, _none),
    206: (_kept, _none, _kept, _none),
    211: (_cut, _cut, _none, _none),
    216: (_cut, _none, _none, _none),
    42600: (_cut, _cut, _kept, _kept),
}


def judge(item: MissionItem, mission_type: int) -> int:
    """Whether ArduPilot takes an item: a MAV_MISSION_RESULT."""
    known = {
        MISSION: (16, *_PLACES, *_OTHERS),
        FENCE: (5000, *VERTICES, *CIRCLES),
        RALLY: (RALLY_POINT,),
    }[mission_type]
    if item.command not in known:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    bad = [math.isnan(value) for value in (item.param1, item.param2, item.param3, item.param4)]
    bad[3] = bad[3] and item.command > 100  # a heading may be left open
    if any(bad):
        return int(mavlink.MAV_MISSION_INVALID_PARAM1) + bad.index(True)
    if item.frame not in FRAMES:
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    for wrong, code in (
        (abs(item.x) > 900_000_000, mavlink.MAV_MISSION_INVALID_PARAM5_X),
        (abs(item.y) > 1_800_000_000, mavlink.MAV_MISSION_INVALID_PARAM6_Y),
        (math.isnan(item.z), mavlink.MAV_MISSION_INVALID_PARAM7),
    ):
        if wrong:
            return int(code)
    return ACCEPTED


def rewritten(item: MissionItem, mission_type: int, vehicle: str) -> MissionItem:
    """An item that was taken, as ArduPilot keeps it."""
    if mission_type == FENCE:
        kept = MissionItem(item.command, ABSOLUTE, item.x, item.y, 0.0, autocontinue=0)
        return replace(kept, param1=item.param1)
    frame = FRAMES[item.frame]
    if mission_type == RALLY:
        return MissionItem(item.command, frame, item.x, item.y, _cut(item.z), autocontinue=0)
    if item.command == 16 or item.command in _PLACES:
        rules = _WAYPOINT[vehicle] if item.command == 16 else _PLACES[item.command]
        x, y, z = item.x, item.y, _centimetres(item.z)
    else:
        rules = _OTHERS[item.command]
        frame, x, y, z = ABSOLUTE, 0, 0, 0.0
    given = (item.param1, item.param2, item.param3, item.param4)
    p1, p2, p3, p4 = (
        rule(0.0 if math.isnan(value) else value) for rule, value in zip(rules, given, strict=True)
    )
    return MissionItem(item.command, frame, x, y, z, p1, p2, p3, p4)


def _centimetres(altitude_m: float) -> float:
    """Cut to centimetres, in single precision as the autopilot does."""
    (single,) = struct.unpack("<f", struct.pack("<f", altitude_m))
    (scaled,) = struct.unpack("<f", struct.pack("<f", single * 100.0))
    return float(math.trunc(scaled)) / 100.0


def fence_fault(items: list[MissionItem]) -> tuple[int, str] | None:
    """What is wrong with a whole fence: severity and words of the text told."""
    left = 0
    for item in items:
        if item.command in VERTICES:
            if item.param1 < 3:
                return 4, f"Invalid vertex count ({int(item.param1)})"
            left = int(item.param1) - 1 if left == 0 else left - 1
        elif left:
            return 6, "Incorrect item count"
        elif item.command in CIRCLES and item.param1 <= 0:
            return 4, "Non-positive circle radius"
    return (6, "Incorrect item count") if left else None
