"""What PX4 takes as an item, and its checksum of a plan."""

import binascii
import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Message
from autopilot_bridge.mock.mission_server import ACCEPTED, ERROR, FENCE, MISSION, VERTICES
from autopilot_bridge.stacks.rules import FENCE_COMMANDS, RALLY_POINT, rules_of
from autopilot_bridge.stacks.stacks import Stack

FRAME_MISSION = int(mavlink.MAV_FRAME_MISSION)
FLOAT_FRAMES = {5: 0, 6: 3}


def judge(item: MissionItem, mission_type: int, stack: Stack) -> int:
    """Whether PX4 takes an item: a MAV_MISSION_RESULT."""
    rules = rules_of(stack)
    if item.frame not in (*rules.frames, FRAME_MISSION):
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    places = rules.position.keys() | FENCE_COMMANDS | {RALLY_POINT}
    if item.command not in (rules.bare if item.frame == FRAME_MISSION else places):
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    if mission_type == MISSION and item.command in FENCE_COMMANDS | {RALLY_POINT}:
        return ERROR
    if mission_type == FENCE and item.command in VERTICES and item.param1 < 3:
        return ERROR
    return ACCEPTED


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
