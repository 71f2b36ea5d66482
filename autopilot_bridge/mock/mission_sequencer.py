"""The order of a mission's items, and the meaning of their numbers: pure functions."""

from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.stacks.stacks import Stack

DEFAULT_RADIUS_M = 80.0  # WP_LOITER_RAD is 60, NAV_LOITER_RAD 80
MAX_JUMPS = 255  # without a NAV item between them, as in ArduPilot
TAKEOFFS = (mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_VTOL_TAKEOFF)
LANDINGS = (mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_VTOL_LAND)
LOITERS = (
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_NAV_LOITER_TURNS,
    mavlink.MAV_CMD_NAV_LOITER_TIME,
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
)
WAYPOINTS = (mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT)
# Items that are flown; items without a model here are complete at once.
NAVIGATION = frozenset(range(16, 96)) - {80}


def next_of(
    items: Sequence[MissionItem], seq: int, jumps: dict[int, int]
) -> tuple[list[int], int | None]:
    """From item ``seq`` on: the DO items met, and the NAV item behind them (None at the end).

    DO_JUMPs are followed and counted in ``jumps`` (item: times); a negative repeat has no end.
    """
    met: list[int] = []
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
            return met, seq
        else:
            met.append(seq)
        seq += 1
    return met, None


def loiter_radius_m(item: MissionItem, stack: Stack) -> float:
    """Signed radius of a loiter item, negative anticlockwise; the default where the item has none.

    ArduPilot keeps of a LOITER_TIME's radius only the sign.
    """
    if item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT:
        return item.param2 or DEFAULT_RADIUS_M
    if item.command == mavlink.MAV_CMD_NAV_LOITER_TIME and stack.name == "ardupilot":
        return -DEFAULT_RADIUS_M if item.param3 < 0.0 else DEFAULT_RADIUS_M
    return item.param3 or DEFAULT_RADIUS_M


def acceptance_m(item: MissionItem, stack: Stack, own_m: float) -> float:
    """Return the acceptance radius of a waypoint in metres; ``own_m`` is the vehicle's default.

    PX4 heeds the item's radius on multicopters, ArduPilot on planes (read).
    """
    heeded = (stack.name == "px4") == (stack.vehicle == "copter")
    return max(item.param2, own_m) if heeded else own_m
