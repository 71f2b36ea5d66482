"""What PX4 takes as an item, what it makes of it, and its checksum of a plan."""

import binascii
import struct
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.codec import Message
from autopilot_bridge.items import MissionItem
from autopilot_bridge.mock.mission_server import ACCEPTED, CIRCLES, ERROR, FENCE, MISSION, VERTICES

FRAME_MISSION = int(mavlink.MAV_FRAME_MISSION)
INT_FRAMES = {0: 5, 3: 6, 5: 5, 6: 6}
FLOAT_FRAMES = {5: 0, 6: 3}
# Parameters kept of the commands with a place; the others read back as 0.
PLACES = {
    16: (1, 2, 4),
    17: (3, 4),
    19: (1, 2, 3, 4),
    21: (2, 4),
    22: (4,),
    31: (1, 2, 4),
    195: (),
    **dict.fromkeys((*VERTICES, *CIRCLES), (1,)),
    5000: (),
    5100: (),
}
# Commands without a place: all parameters are kept.
OTHERS = (20, 93, 112, 114, 177, 178, 187, 189, 197, 206, 211, 2000, 2001, 2500, 2501, 42600)


def judge(item: MissionItem, mission_type: int) -> int:
    """Whether PX4 takes an item: a MAV_MISSION_RESULT."""
    if item.frame not in (*INT_FRAMES, FRAME_MISSION):
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if item.command not in (OTHERS if item.frame == FRAME_MISSION else PLACES):
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    if mission_type == MISSION and item.command >= 5000 and item.command in PLACES:
        return ERROR
    if mission_type == FENCE and item.command in VERTICES and item.param1 < 3:
        return ERROR
    return ACCEPTED


def rewritten(item: MissionItem, mission_type: int) -> MissionItem:
    """An item that was taken, as PX4 keeps it."""
    if item.frame == FRAME_MISSION:
        return item
    kept = PLACES[item.command]
    params = (item.param1, item.param2, item.param3, item.param4)
    p1, p2, p3, p4 = (p if n in kept else 0.0 for n, p in enumerate(params, start=1))
    frame = INT_FRAMES[item.frame]
    if mission_type == FENCE:
        if item.command not in (*VERTICES, *CIRCLES):
            p1 = 0.0
        return MissionItem(item.command, 5, item.x, item.y, item.z, p1, autocontinue=0)
    return replace(item, frame=frame, param1=p1, param2=p2, param3=p3, param4=p4)


def checksum(message: Message, before: int) -> int:
    """The plan's CRC-32 (no inversions) with one more item; over the item as it came."""
    as_int = message.get_type() == "MISSION_ITEM_INT"
    values = struct.pack(
        "<BHBffff" + ("ii" if as_int else "ff") + "f",
        message.frame,
        message.command,
        message.autocontinue,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        message.x,
        message.y,
        message.z,
    )
    return binascii.crc32(values, before ^ 0xFFFFFFFF) ^ 0xFFFFFFFF
