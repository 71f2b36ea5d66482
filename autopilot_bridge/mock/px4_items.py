"""Decides which items PX4 accepts, checks fences, and computes the checksum of a plan."""

import binascii
import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Message
from autopilot_bridge.mock.mission_server import (
    ACCEPTED,
    CIRCLES,
    ERROR,
    FENCE,
    INCLUSIONS,
    MISSION,
    VERTICES,
)
from autopilot_bridge.stacks.item_treatment import FENCE_COMMANDS, RALLY_POINT, rules_of
from autopilot_bridge.stacks.stacks import Stack

FRAME_MISSION = int(mavlink.MAV_FRAME_MISSION)
FLOAT_FRAMES = {5: 0, 6: 3}


def judge(item: MissionItem, mission_type: int, stack: Stack) -> int:
    """Return PX4's MAV_MISSION_RESULT for an item."""
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
    """Return a plan's CRC-32 (without inversions) after one more received item."""
    as_int = message.get_type() == "MISSION_ITEM_INT"
    values = struct.pack(
        "<BHBffff" + ("ii" if as_int else "ff") + "f",
        *(message.frame, message.command, message.autocontinue),
        *(message.param1, message.param2, message.param3, message.param4),
        *(message.x, message.y, message.z),
    )
    return binascii.crc32(values, before ^ 0xFFFFFFFF) ^ 0xFFFFFFFF


LANDINGS = (21, 85, 189)
TAKEOFFS = (22, 84)
M_PER_UNIT = 0.0111195  # 1e-7 degrees of latitude

Place = tuple[int, int]
Shape = tuple[MissionItem, list[Place]]  # circle or first vertex, and all positions


def shapes_of(fence: list[MissionItem]) -> list[Shape]:
    """Return the circles and polygons of a fence; an incomplete polygon has no vertices."""
    shapes: list[Shape] = []
    index = 0
    while index < len(fence):
        item = fence[index]
        length = int(item.param1) if item.command in VERTICES else 1
        places = [(vertex.x, vertex.y) for vertex in fence[index : index + length]]
        if item.command in (*VERTICES, *CIRCLES):
            shapes.append((item, places if len(places) == length else []))
        index += max(length, 1)
    return shapes


def inside(shape: Shape, place: Place, east_scale: float) -> bool:
    """Return whether a position is inside a shape, assuming a flat earth."""
    item, places = shape
    if item.command in CIRCLES:
        north = (place[0] - item.x) * M_PER_UNIT
        east = (place[1] - item.y) * M_PER_UNIT * east_scale
        return north * north + east * east < item.param1 * item.param1
    within = False
    for (x1, y1), (x2, y2) in zip(places, places[1:] + places[:1], strict=True):
        if (x1 > place[0]) != (x2 > place[0]):
            within ^= place[1] < y1 + (y2 - y1) * (place[0] - x1) / (x2 - x1)
    return within


def usable_shapes(fence: list[MissionItem], home: Place, east_scale: float) -> list[Shape]:
    """Return the shapes that PX4 uses; PX4 ignores an inclusion that does not contain home."""
    return [
        shape
        for shape in shapes_of(fence)
        if shape[0].command not in INCLUSIONS or inside(shape, home, east_scale)
    ]


def first_outside(items: list[MissionItem], shapes: list[Shape], east_scale: float) -> int | None:
    """Return the index of the first item at a position that the fence forbids, or None."""
    inclusions = [shape for shape in shapes if shape[0].command in INCLUSIONS]
    exclusions = [shape for shape in shapes if shape[0].command not in INCLUSIONS]
    for seq, item in enumerate(items):
        if item.frame == mavlink.MAV_FRAME_MISSION:
            continue
        place = (item.x, item.y)
        if any(inside(shape, place, east_scale) for shape in exclusions):
            return seq
        if inclusions and not any(inside(shape, place, east_scale) for shape in inclusions):
            return seq
    return None


def missing_item(items: list[MissionItem], required: int) -> str | None:
    """Return a text if an item required by MIS_TKO_LAND_REQ is missing, otherwise None.

    ``required`` is 1 for a takeoff, 2 for a landing, 3 for both.
    """
    if required in (1, 3) and not any(item.command in TAKEOFFS for item in items):
        return "Takeoff waypoint required"
    if required in (2, 3) and not any(item.command in LANDINGS for item in items):
        return "Landing waypoint/pattern required"
    return None
