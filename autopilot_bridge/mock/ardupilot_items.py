"""Decides which items ArduPilot accepts, and checks a fence as ArduPilot does."""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.missions.read_back import takes_position
from autopilot_bridge.mock.mission_server import ACCEPTED, CIRCLES, FENCE, MISSION, RALLY, VERTICES
from autopilot_bridge.stacks.item_treatment import FENCE_COMMANDS, RALLY_POINT, rules_of
from autopilot_bridge.stacks.stacks import Stack


def judge(item: MissionItem, mission_type: int, stack: Stack) -> int:
    """Return ArduPilot's MAV_MISSION_RESULT for an item."""
    rules = rules_of(stack)
    accepted = {
        MISSION: rules.position.keys() | rules.bare.keys(),
        FENCE: FENCE_COMMANDS,
        RALLY: {RALLY_POINT},
    }[mission_type]
    if item.command not in accepted:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    may_be_open = (rules.nan_ok or {}).get(item.command, ())
    params = (item.param1, item.param2, item.param3, item.param4)
    for number, value in enumerate(params, start=1):
        if math.isnan(value) and number not in may_be_open:
            return int(mavlink.MAV_MISSION_INVALID_PARAM1) + number - 1
    if item.frame not in (*rules.frames, mavlink.MAV_FRAME_MISSION):
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if mission_type == MISSION and not takes_position(item, rules):
        return ACCEPTED
    for wrong, code in (
        (abs(item.x) > 900_000_000, mavlink.MAV_MISSION_INVALID_PARAM5_X),
        (abs(item.y) > 1_800_000_000, mavlink.MAV_MISSION_INVALID_PARAM6_Y),
        (math.isnan(item.z), mavlink.MAV_MISSION_INVALID_PARAM7),
    ):
        if wrong:
            return int(code)
    return ACCEPTED


def fence_fault(items: list[MissionItem]) -> tuple[int, str] | None:
    """Return the severity and the text of a fence's fault; None if the fence has no fault."""
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
