"""Encodes and decodes ArduPilot's mission, fence and rally files (``@MISSION/mission.dat``).

A file begins with a header of five little-endian uint16: magic, mission type, options, start,
count. One MISSION_ITEM_INT payload of full length follows for each item
(AP_Filesystem_Mission.cpp).
"""

import math
import struct
from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem

MAGIC = 0x763D
HEADER = struct.Struct("<5H")
ITEM = struct.Struct("<4f2if2H6B")
PATHS = {
    mavlink.MAV_MISSION_TYPE_MISSION: "@MISSION/mission.dat",
    mavlink.MAV_MISSION_TYPE_FENCE: "@MISSION/fence.dat",
    mavlink.MAV_MISSION_TYPE_RALLY: "@MISSION/rally.dat",
}
MAX_ITEMS = 0xFFFE  # if the count is 65535, the autopilot does not check the length

# Commands that ArduPilot 4.6 accepts (AP_Mission.cpp): those with a position, then the others.
_WITH_PLACE = frozenset(
    (*(16, 17, 18, 19, 21, 22, 30, 31, 82, 84, 85, 92), *(179, 188, 189, 191, 195, 201))
)
_WITHOUT_PLACE = frozenset(
    (
        *(20, 83, 93, 112, 114, 115, 177, 178, 181, 182, 183, 184, 193, 194, 197, 202, 203, 205),
        *(206, 207, 208, 210, 211, 212, 213, 215, 216, 217, 218, 222, 223, 531, 532, 534, 600),
        *(601, 1000, 2000, 2001, 2500, 2501, 3000, 42600, 42703),
    )
)
_FRAMES = (0, 2, 3, 5, 6, 10, 11)
_YAW_MAY_BE_NAN = (16, 17, 21, 22, 84, 85)
_ALTITUDE_LIMIT_M = 83_000.0


def first_bad_item(items: Sequence[MissionItem], max_items: int) -> tuple[int, str] | None:
    """Return the index and the defect of the first item that ArduPilot would reject, or None.

    This function must be called before a file is sent. ArduPilot clears the old mission, applies
    the file item by item, and stops at a rejected item without a report.
    """
    for seq, item in enumerate(items):
        if seq >= max_items:
            return seq, f"the autopilot stores at most {max_items} items"
        if defect := _defect(item, len(items)):
            return seq, defect
    return None


def _defect(item: MissionItem, count: int) -> str | None:
    place = item.command in _WITH_PLACE
    if not place and item.command not in _WITHOUT_PLACE:
        return f"command {item.command} is not supported in mission files"
    params = (item.param1, item.param2, item.param3, item.param4)
    for number, value in enumerate(params, start=1):
        yaw = number == 4 and item.command in _YAW_MAY_BE_NAN and math.isnan(value)
        if not math.isfinite(value) and not yaw:
            return f"parameter {number} is {value}"
    if not math.isfinite(item.z):
        return f"the altitude is {item.z}"
    if item.command == mavlink.MAV_CMD_DO_JUMP and not 0 < item.param1 < count:
        return f"the jump target is item {item.param1:g}, but must be from 1 to {count - 1}"
    if not place:
        return None
    if abs(item.x) > 900_000_000 or abs(item.y) > 1_800_000_000:
        return f"{item.x / 1e7:.7f}, {item.y / 1e7:.7f} is not a latitude and longitude"
    if abs(item.z) >= _ALTITUDE_LIMIT_M:
        return f"the altitude is {item.z:g} m"
    return None if item.frame in _FRAMES else f"frame {item.frame} is not supported"


def encode_mission_file(
    items: Sequence[MissionItem], mission_type: int, target: tuple[int, int]
) -> bytes:
    """Return the file that replaces a whole list. Raises BridgeError if an item does not fit."""
    if len(items) > MAX_ITEMS:
        raise BridgeError(f"mission file: {len(items)} items; the maximum is {MAX_ITEMS}")
    parts = [HEADER.pack(MAGIC, mission_type, 0, 0, len(items))]
    for seq, item in enumerate(items):
        params = (item.param1, item.param2, item.param3, item.param4)
        numbers = (seq, item.command, *target, item.frame, 0, item.autocontinue, mission_type)
        try:
            parts.append(ITEM.pack(*params, item.x, item.y, item.z, *numbers))
        except (struct.error, OverflowError) as error:
            raise BridgeError(f"mission file: item {seq} cannot be encoded: {error}") from None
    return b"".join(parts)


def file_length(start: bytes, mission_type: int) -> int:
    """Return the length that a file's header states. Raises BridgeError for a damaged header."""
    if len(start) < HEADER.size:
        raise BridgeError(
            f"mission file: {len(start)} bytes, but the header alone has {HEADER.size}; read the "
            "file again"
        )
    magic, kind, options, first, count = HEADER.unpack_from(start)
    if magic != MAGIC:
        raise BridgeError(f"mission file: begins with {magic:#06x} instead of {MAGIC:#06x}")
    if kind != mission_type:
        raise BridgeError(f"mission file: has mission type {kind} instead of {mission_type}")
    if options or first:
        raise BridgeError(
            f"mission file: options {options} and start {first}; only complete lists can be read"
        )
    return HEADER.size + int(count) * ITEM.size


def decode_mission_file(data: bytes, mission_type: int) -> tuple[MissionItem, ...]:
    """Return the items of a whole file. Raises BridgeError if the file is damaged."""
    length = file_length(data, mission_type)
    if len(data) != length:
        raise BridgeError(
            f"mission file: {len(data)} bytes, but the header requires {length}; read the file "
            "again"
        )
    return tuple(
        _item(data, seq, mission_type) for seq in range((length - HEADER.size) // ITEM.size)
    )


def unpack_item(data: bytes, index: int) -> tuple[int, MissionItem]:
    """Return the sequence number and the content of an item in a file; the item is not checked."""
    values = ITEM.unpack_from(data, HEADER.size + index * ITEM.size)
    param1, param2, param3, param4, x, y, z, seq, command, _, _, frame, _, auto, _ = values
    return seq, MissionItem(command, frame, x, y, z, param1, param2, param3, param4, auto)


def _item(data: bytes, index: int, mission_type: int) -> MissionItem:
    seq, item = unpack_item(data, index)
    if item.command == 0:
        raise BridgeError(f"mission file: item {index} is empty; read the file again")
    # ArduPilot writes item numbers only in mission files.
    if mission_type == mavlink.MAV_MISSION_TYPE_MISSION and seq != index:
        raise BridgeError(f"mission file: item {index} has the number {seq}; read the file again")
    return item
