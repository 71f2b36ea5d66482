"""Computes the item that an autopilot returns on a read-back.

The data are in ``stacks/item_treatment.py``.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem, has_position, params_of
from autopilot_bridge.stacks.item_treatment import SAME_AS, TWIN, Rules, rules_of
from autopilot_bridge.stacks.stacks import Stack, stack_named

MISSION, FENCE, RALLY = (
    mavlink.MAV_MISSION_TYPE_MISSION,
    mavlink.MAV_MISSION_TYPE_FENCE,
    mavlink.MAV_MISSION_TYPE_RALLY,
)
_ALTITUDE_TOLERANCE_M = 0.011
_IN_FILES = rules_of(stack_named("ardupilot", "plane"))  # only ArduPilot has mission files


def single(value: float) -> float:
    """Return a number rounded to single precision, as MAVLink transmits it."""
    if not math.isfinite(value):
        return value
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)


def _wrapped(bits: int, signed: bool) -> Callable[[float], float]:
    def cut(value: float) -> float:
        rest = math.trunc(value) % (1 << bits)
        return float(rest - (1 << bits) if signed and rest >= 1 << (bits - 1) else rest)

    return cut


def _turns(value: float) -> float:
    if 0.0 < value < 1.0:
        return math.trunc(value * 256.0) / 256.0
    return float(min(255, math.trunc(value)))


def _turn_radius(value: float) -> float:
    if abs(value) <= 255.0:
        return float(math.trunc(value))
    return math.copysign(10.0 * min(255, math.trunc(abs(value) * 0.1)), value)


KEEP: dict[str, Callable[[float], float]] = {
    "keep": single,
    "-": lambda value: 0.0,
    "hint": lambda value: 0.0,
    "hidden": lambda value: 0.0,
    "yaw": lambda value: single(value % 360.0),
    "u8": _wrapped(8, signed=False),
    "u16": _wrapped(16, signed=False),
    "i8": _wrapped(8, signed=True),
    "i16": _wrapped(16, signed=True),
    "cap8": lambda value: float(min(255, math.trunc(value))),
    "cm16": lambda value: _wrapped(16, signed=False)(value * 100.0) / 100.0,
    "radius": lambda value: math.copysign(_wrapped(16, signed=False)(abs(value)), value),
    "flag": lambda value: float(value > 0.0),
    "sign": lambda value: -1.0 if value < 0.0 else 1.0,
    "side": lambda value: -1.0 if value < 0.0 else 1.0,
    "turns": _turns,
    "turn_radius": _turn_radius,
}


def words_of(item: MissionItem, rules: Rules) -> list[str]:
    """Return the words that ``Rules`` has for params 1 to 4; "keep" for unknown commands."""
    with_position = takes_position(item, rules)
    kept = (rules.position if with_position else rules.bare).get(item.command)
    return (kept or "keep keep keep keep").split()


def takes_position(item: MissionItem, rules: Rules) -> bool:
    """Return whether the stack uses x, y and z of an item as a position."""
    if rules.bare_frame is not None and item.frame == rules.bare_frame:
        return False
    if item.command in rules.position:
        return True
    return item.command not in rules.bare and has_position(item.command)


def kept_param(word: str, value: float) -> float:
    """Return the value that is stored for a param; NaN remains NaN only with "keep" and "yaw"."""
    if not math.isfinite(value):
        return value if word in ("keep", "yaw") else 0.0
    return KEEP[word](single(value))


def as_read_back(item: MissionItem, stack: Stack, mission_type: int = MISSION) -> MissionItem:
    """Return the item that is read back after ``item`` was sent and accepted.

    The result is not valid for ArduPilot's item 0, which is always home.
    """
    rules = rules_of(stack)
    if mission_type == FENCE:
        return _fence_point(item, rules)
    if mission_type == RALLY:
        return _rally_point(item, rules)
    words = words_of(item, rules)
    values = (item.param1, item.param2, item.param3, item.param4)
    param1, param2, param3, param4 = map(kept_param, words, values)
    x, y, z, frame = item.x, item.y, single(item.z), item.frame
    if takes_position(item, rules):
        frame = rules.frames_read.get(frame, frame)
        z = _altitude(z, rules)
    elif rules.bare_frame is None:
        places = rules.bare_xyz.get(item.command, "")
        x, y = x if "x" in places else 0, y if "y" in places else 0
        z, frame = z if "z" in places else 0.0, mavlink.MAV_FRAME_GLOBAL
        if item.command == mavlink.MAV_CMD_DO_MOUNT_CONTROL:
            z = float(mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING)
    command = SAME_AS.get(item.command, item.command)
    autocontinue = item.autocontinue if rules.accepts_bad_numbers else 1
    return MissionItem(command, frame, x, y, z, param1, param2, param3, param4, autocontinue)


def with_unheld(item: MissionItem, x: int = 0, y: int = 0, z: float = 0.0) -> MissionItem:
    """Return an item of ArduPilot's mission file with x, y and z replaced where they are not used.

    In a file the unused fields contain old values from the autopilot's memory, because
    ``AP_Mission::get_item`` does not initialise the item (source: 4.6.2). For example, a
    DO_CHANGE_SPEED contained the position of home (observed).
    """
    if takes_position(item, _IN_FILES):
        return item
    held = _IN_FILES.bare_xyz.get(item.command, "")
    x, y = item.x if "x" in held else x, item.y if "y" in held else y
    return replace(item, x=x, y=y, z=item.z if "z" in held else z)


def _altitude(z: float, rules: Rules) -> float:
    if not rules.whole_cm or not math.isfinite(z):
        return z
    return single(math.trunc(single(z * 100.0)) / 100.0)


def _fence_point(item: MissionItem, rules: Rules) -> MissionItem:
    """Return a fence point as read back: the frame is not stored, the altitude only by PX4."""
    bare = replace(item, param2=0.0, param3=0.0, param4=0.0, autocontinue=0)
    circle = item.command in (5003, 5004)
    param1 = single(item.param1) if circle else kept_param("u16", item.param1)
    if item.command == mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT:
        param1 = 0.0
    frame = rules.frames_read.get(mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL)
    return replace(
        bare, param1=param1, frame=frame, z=single(item.z) if rules.accepts_bad_numbers else 0.0
    )


def _rally_point(item: MissionItem, rules: Rules) -> MissionItem:
    frame = rules.frames_read.get(item.frame, item.frame)
    z = kept_param("i16", item.z) if rules.whole_m_rally else single(item.z)
    autocontinue = 0 if rules.whole_m_rally else item.autocontinue
    return MissionItem(item.command, frame, item.x, item.y, z, autocontinue=autocontinue)


def same_as_sent(
    sent: MissionItem, read: MissionItem, stack: Stack, mission_type: int = MISSION
) -> bool:
    """Return whether an item was read back as expected after ``sent`` was sent.

    Three differences are tolerated: rounding to single precision, the equivalent INT frame, and any
    number instead of NaN.
    """
    expected = as_read_back(sent, stack, mission_type)
    frames = {TWIN.get(frame, frame) for frame in (expected.frame, read.frame)}
    if len(frames) > 1 or (expected.command, expected.x, expected.y) != (
        read.command,
        read.x,
        read.y,
    ):
        return False
    if not (math.isnan(expected.z) or abs(expected.z - read.z) <= _ALTITUDE_TOLERANCE_M):
        return False
    return all(
        math.isnan(ours) or abs(ours - theirs) <= 1e-4 * max(1.0, abs(ours))
        for ours, theirs in zip(params_of(expected)[:4], params_of(read)[:4], strict=True)
    )


def same_mission(
    sent: tuple[MissionItem, ...],
    read: tuple[MissionItem, ...],
    stack: Stack,
    mission_type: int = MISSION,
) -> bool:
    """Return whether a list was read back as expected after ``sent`` was sent.

    Both lists are as transmitted. Item 0 of ArduPilot's mission is home, which is not compared.
    """
    first = 1 if stack.item_0_is_home and mission_type == MISSION else 0
    return len(sent) == len(read) and all(
        same_as_sent(ours, theirs, stack, mission_type)
        for ours, theirs in zip(sent[first:], read[first:], strict=True)
    )
