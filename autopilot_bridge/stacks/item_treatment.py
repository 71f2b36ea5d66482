"""Lists how PX4 1.17 and ArduPilot 4.6.2 treat each mission command.

Sources: transcripts of SITL runs where they exist, otherwise the source files AP_Mission.cpp,
MissionItemProtocol_*.cpp and each vehicle's start_command (ArduPilot), mavlink_mission.cpp and
FeasibilityChecker.cpp (PX4).

``position`` and ``bare`` map each accepted command to four words, one for each of params 1 to 4. A
word states how the autopilot stores the param:

- ``keep`` as sent; ``-`` not stored; ``hint`` not stored, and without effect on the flight;
  ``hidden`` used, but read back as 0; ``yaw`` an angle, read back as 0 to 360 degrees;
- ``u8 u16 i8 i16`` truncated to an integer of this type, with wrap-around; ``cap8`` truncated, at
  most 255; ``cm16`` whole centimetres in 16 bits; ``radius`` whole metres in 16 bits with the sign;
- ``flag`` 1 if positive, else 0; ``sign`` -1 or 1; ``side`` -1 or 1, the direction of a yaw;
- ``turns`` whole turns up to 255, below one turn in steps of 1/256; ``turn_radius`` steps of 1 m up
  to 255 m, of 10 m up to 2550 m.
"""

from dataclasses import dataclass, field, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.stacks.stacks import Stack

GLOBAL_FRAMES = frozenset((0, 3, 5, 6))
TERRAIN_FRAMES = frozenset((10, 11))
TWIN = {5: 0, 6: 3, 11: 10}  # deprecated INT frames and the equivalent frames
FENCE_COMMANDS = frozenset(range(5000, 5005))
RALLY_POINT = mavlink.MAV_CMD_NAV_RALLY_POINT
ENDLESS = mavlink.MAV_CMD_NAV_LOITER_UNLIM
# Jumps, and NAV items whose numbers are outside the range of the NAV commands.
OTHER_NAVIGATION = frozenset((177, 601, 213, 42702, 42703))
LAND_SEQUENCES = frozenset((188, 189))  # items at which a failsafe may enter a mission


@dataclass(frozen=True, slots=True)
class Rules:
    """The rules of one stack; commands are given by number."""

    frames: frozenset[int]  # accepted frames of items with a position
    position: dict[int, str]  # accepted commands with a position, and words for params 1 to 4
    bare: dict[int, str]  # accepted commands without a position, and words for params 1 to 4
    bare_frame: int | None  # the only accepted frame of items without a position
    bare_xyz: dict[int, str]  # which of x, y, z are stored for commands without a position
    frames_read: dict[int, int]  # the frame that is read back for each frame sent
    whole_cm: bool  # altitudes are truncated to centimetres
    max_altitude_m: float
    nan_ok: dict[int, tuple[int, ...]] | None  # params that may be NaN; None means all
    zero_is_default: dict[int, tuple[int, ...]]  # params where 0 is equivalent to NaN
    accepts_bad_numbers: bool  # the stack accepts invalid numbers; only the bridge rejects them
    zero_is_current_position: bool  # latitude = longitude = 0 is the vehicle's current position
    not_run: frozenset[int] = frozenset()  # commands that are accepted, but skipped in flight
    # Commands that are stored, but make the autopilot reject the whole mission.
    invalidates_mission: frozenset[int] = frozenset()
    one_trailing_do: bool = False  # after the last NAV item only one item is executed
    # The accepted values of param 1, by command and by whether the item has a position.
    allowed: dict[tuple[int, bool], tuple[float, ...]] = field(default_factory=dict)
    max_fence: int | None = None
    max_rally: int | None = None
    max_vertices: int | None = None
    whole_m_rally: bool = False  # rally altitudes are truncated to metres


_ARDUPILOT_POSITION = {
    **dict.fromkeys((22, 30, 85, 92, 179, 195, 201), "u16 - - -"),
    **dict.fromkeys((84, 188, 189, 191), "- - - -"),
    16: "- cap8 cap8 -",
    17: "- - radius -",
    18: "turns - turn_radius flag",
    19: "u16 - sign flag",
    21: "u16 - - side",
    31: "- radius - flag",
    94: "cm16 - - -",
}
_ARDUPILOT_BARE = {
    **dict.fromkeys((112, 114, 2500, 2501, 3000), "keep - - -"),
    **dict.fromkeys((193, 194, 197, 207, 208, 210, 212, 215, 216, 600, 2001), "u16 - - -"),
    **dict.fromkeys((205, 213, 534), "keep keep keep -"),
    **dict.fromkeys((1000, 2000, 42702, 42703), "keep keep keep keep"),
    20: "- - - -",
    83: "keep keep u8 -",
    93: "keep i8 i8 i8",
    115: "keep keep i8 u8",
    177: "u16 i16 - -",
    178: "u8 keep keep -",
    181: "u8 u8 - -",
    182: "u8 i16 keep -",
    183: "u8 u16 - -",
    184: "u8 u16 i16 keep",
    202: "u8 u16 u8 u16",
    203: "u8 u8 i8 u8",
    206: "keep hint u8 -",
    211: "u8 u8 - -",
    217: "u16 keep keep keep",
    218: "u16 u8 - -",
    222: "u16 keep keep keep",
    223: "flag flag keep keep",
    531: "keep keep - -",
    532: "keep keep - -",
    601: "u16 i16 - -",
    42600: "u8 u8 keep keep",
}
_ARDUPLANE = Rules(
    frames=GLOBAL_FRAMES | TERRAIN_FRAMES,
    position=_ARDUPILOT_POSITION,
    bare=_ARDUPILOT_BARE,
    bare_frame=None,
    bare_xyz={202: "xyz", 203: "xy", 205: "z", 1000: "xz", 42702: "xy", 42703: "x"},
    frames_read=TWIN | {2: 0},
    whole_cm=True,
    max_altitude_m=83_000.0,
    nan_ok={16: (4,), 17: (4,), 21: (4,), 22: (4,), 84: (4,), 85: (3, 4)},
    zero_is_default={
        16: (1, 2, 3),
        17: (1, 2, 3),
        18: (2, 3, 4),
        19: (2, 3, 4),
        21: (1, 2, 3),
        22: (1, 2, 3),
        31: (1, 2, 3, 4),
    },
    accepts_bad_numbers=False,
    zero_is_current_position=True,
    not_run=frozenset((92, 115, 191, 193, 194, 213, 222, 42600, 42703)),
    one_trailing_do=True,
    max_vertices=255,
    whole_m_rally=True,
)
_ARDUCOPTER = replace(
    _ARDUPLANE,
    position=_ARDUPILOT_POSITION | {16: "u16 - - -", 82: "u16 - - -"},
    not_run=frozenset((30, 83, 191, 193, 194, 210, 212, 213, 223, 3000)),
    one_trailing_do=False,
)
_AS_SENT = "keep keep keep keep"
_PX4 = Rules(
    frames=GLOBAL_FRAMES,
    position={
        16: "keep keep - yaw",
        17: "- - keep yaw",
        19: "keep flag keep flag",
        21: "- u16 - yaw",
        22: "hint - - yaw",
        31: "flag keep - flag",
        80: "hidden - - -",
        84: "hint hint hint yaw",
        85: "hint hint hint yaw",
        195: "hidden - - -",
        201: "hidden - - -",
        400: "hidden - - -",
        4501: "hidden hidden - -",
    },
    bare=dict.fromkeys(
        (
            *(20, 80, 93, 112, 114, 177, 178, 179, 187, 189, 196, 197, 200, 201, 203, 204, 205),
            *(206, 211, 214, 260, 400, 530, 532, 534, 1000, 1001, 2000, 2001, 2003, 2500, 2501),
            *(3000, 42600),
        ),
        _AS_SENT,
    ),
    bare_frame=mavlink.MAV_FRAME_MISSION,
    bare_xyz={},  # x, y and z are all stored, in the only accepted frame
    frames_read={0: 5, 3: 6},
    whole_cm=False,
    max_altitude_m=float("inf"),
    nan_ok=None,
    zero_is_default={},
    accepts_bad_numbers=True,
    zero_is_current_position=False,
    invalidates_mission=frozenset((112, 114)),
    # The accepted MAV_ROI modes of NAV_ROI (80) and DO_SET_ROI (201), with and without a position.
    allowed={
        (80, True): (0, 3),
        (201, True): (0, 3),
        (80, False): (0, 1, 2),
        (201, False): (0, 1, 2),
    },
    max_fence=64,
    max_rally=32,
)

_RULES = {
    ("px4", "plane"): _PX4,
    ("px4", "copter"): _PX4,
    ("ardupilot", "plane"): _ARDUPLANE,
    ("ardupilot", "copter"): _ARDUCOPTER,
}

SAME_AS = {80: 201}  # NAV_ROI is DO_SET_ROI's older name, with the same params

# The alternative that a stack offers to a command that it rejects.
INSTEAD: dict[tuple[str, int], str] = {
    ("px4", 18): "use NAV_LOITER_TIME, or NAV_LOITER_UNLIM at the end",
    ("px4", 82): "use NAV_WAYPOINT",
    ("px4", 112): "use NAV_DELAY",
    ("px4", 114): "add a waypoint at the location of the action",
    ("px4", 181): "use DO_GRIPPER, or DO_SET_ACTUATOR for an output configured for it",
    ("px4", 183): "use DO_GRIPPER, or DO_SET_ACTUATOR for an output configured for it",
    ("px4", 216): "use DO_SET_ACTUATOR for an output configured for it",
    ("ardupilot", 187): "use DO_GRIPPER, or DO_SET_SERVO with the servo's channel and PWM",
    ("px4", 34): "PX4 accepts it only as a command: use NAV_LOITER_UNLIM",
    ("ardupilot", 34): "use NAV_LOITER_UNLIM",
    ("ardupilot", 400): "arm by command",
}


def rules_of(stack: Stack) -> Rules:
    """Return the rules of a stack."""
    return _RULES[stack.name, stack.vehicle]
