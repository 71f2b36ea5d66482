"""Lists the differences between the mission servers of the two stacks, as data.

The values were observed on simulated ArduPilot 4.6.2 and PX4 1.17.0, unless a comment names another
source.
"""

from dataclasses import dataclass

from autopilot_bridge.stacks.stacks import Stack


@dataclass(frozen=True, slots=True)
class StackConstants:
    """The constants of one stack on one kind of vehicle."""

    tick_us: int  # period of the main loop; a message waits for the next tick
    rerequest_us: int  # an unanswered request is repeated after this time
    gives_up_us: int  # timeout of an upload, counted from the last item
    most: tuple[int, int, int]  # maximum numbers of items: mission, fence, rally points
    mission_names: dict[int, str]  # command names in texts like "Mission: 2 WP"; empty if none


_NAMES = {
    16: "WP",
    17: "LoitUnlim",
    18: "LoitTurns",
    19: "LoitTime",
    20: "RTL",
    21: "Land",
    22: "Takeoff",
    31: "LoitAltitude",
    82: "SplineWP",
    84: "VTOLTakeoff",
    85: "VTOLLand",
    93: "Delay",
    112: "CondDelay",
    114: "CondDist",
    178: "ChangeSpeed",
    181: "SetRelay",
    183: "SetServo",
    189: "LandStart",
    201: "SetROI",
    211: "Gripper",
    216: "Sprayer",
    42600: "Winch",
}

# PX4 stores up to 64 fence points and 32 safe points (from its source code).
_PX4 = StackConstants(0, 262_000, 5_000_000, (5000, 64, 32), {})
_CONSTANTS = {
    ("px4", "plane"): _PX4,
    ("px4", "copter"): _PX4,
    ("ardupilot", "plane"): StackConstants(20_000, 1_020_000, 8_020_000, (655, 84, 50), _NAMES),
    ("ardupilot", "copter"): StackConstants(6_000, 1_006_000, 8_006_000, (650, 84, 50), _NAMES),
}


def stack_constants_of(stack: Stack) -> StackConstants:
    """Return the constants of a stack."""
    return _CONSTANTS[stack.name, stack.vehicle]
