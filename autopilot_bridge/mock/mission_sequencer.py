"""Determines the sequence of a mission's items, and interprets their params."""

from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.stacks.stacks import Stack

DEFAULT_RADIUS_M = 80.0  # WP_LOITER_RAD is 60, NAV_LOITER_RAD 80
MAX_JUMPS = 255  # consecutive jumps without a NAV item, as in ArduPilot
LOITERS = (
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_NAV_LOITER_TURNS,
    mavlink.MAV_CMD_NAV_LOITER_TIME,
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
)
WAYPOINTS = (mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT)
# NAV items. Those that the flight model does not implement are completed at once.
NAVIGATION = frozenset(range(16, 96)) - {80}


def next_of(
    items: Sequence[MissionItem], seq: int, jumps: dict[int, int]
) -> tuple[list[int], int | None]:
    """Return the DO items from ``seq`` on, and the NAV item after them (None at the end).

    DO_JUMPs are followed; ``jumps`` contains the number of jumps from each DO_JUMP. A negative
    repeat count means unlimited repetition.
    """
    do_items: list[int] = []
    taken = 0
    while 0 <= seq < len(items) and taken < MAX_JUMPS:
        item = items[seq]
        if item.command == mavlink.MAV_CMD_DO_JUMP:
            if item.param2 < 0 or jumps.get(seq, 0) < item.param2:
                jumps[seq] = jumps.get(seq, 0) + 1
                taken += 1
                seq = int(item.param1)
                continue
        elif item.command in NAVIGATION:
            return do_items, seq
        else:
            do_items.append(seq)
        seq += 1
    return do_items, None


def loiter_radius_m(item: MissionItem, stack: Stack) -> float:
    """Return the radius of a loiter item, or the default; a negative radius means anticlockwise.

    ArduPilot stores only the sign of a LOITER_TIME's radius.
    """
    if item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT:
        return item.param2 or DEFAULT_RADIUS_M
    if item.command == mavlink.MAV_CMD_NAV_LOITER_TIME and stack.name == "ardupilot":
        return -DEFAULT_RADIUS_M if item.param3 < 0.0 else DEFAULT_RADIUS_M
    return item.param3 or DEFAULT_RADIUS_M


def acceptance_m(item: MissionItem, stack: Stack, own_m: float) -> float:
    """Return the acceptance radius of a waypoint in metres; ``own_m`` is the default.

    PX4 uses the item's radius on multirotors, ArduPilot on planes (from the source code of both).
    """
    used = (stack.name == "px4") == (stack.vehicle == "copter")
    return max(item.param2, own_m) if used else own_m
