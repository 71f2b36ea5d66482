"""Lists the flight modes of the stacks, with their ``custom_mode`` values.

Equivalent modes of two stacks have the same name.

Sources: ``mode.h`` of ArduPlane and ArduCopter 4.6.2, ``px4_custom_mode.h`` of PX4 1.17. If two
modes have the same number, ``Stack.mode_name`` returns the name of the first.
"""

Modes = tuple[tuple[str, int], ...]


def _numbered(first: int, *names: str) -> Modes:
    """Return modes with consecutive numbers, starting at ``first``."""
    return tuple((name, number) for number, name in enumerate(names, first))


ARDUPLANE: Modes = (
    *_numbered(0, "manual", "circle", "stabilised", "training", "acro"),
    *_numbered(5, "fly by wire a", "fly by wire b", "cruise", "autotune"),
    *_numbered(10, "mission", "return", "hold", "takeoff", "avoid adsb", "guided", "initialising"),
    *_numbered(17, "qstabilize", "qhover", "qloiter", "qland", "qrtl", "qautotune", "qacro"),
    *_numbered(24, "thermal", "loiter to qland"),
)

# In "loiter" the pilot's sticks control the vehicle; without a pilot the vehicle sinks at 2.5 m/s.
ARDUCOPTER: Modes = (
    *_numbered(0, "stabilised", "acro", "altitude", "mission", "guided", "loiter", "return"),
    *(("circle", 7), ("land", 9), ("drift", 11)),
    *_numbered(13, "sport", "flip", "autotune", "position", "hold"),
    *_numbered(17, "brake", "throw", "avoid adsb", "guided without gps", "smart return"),
    *_numbered(22, "flowhold", "follow", "zigzag", "system identification", "autorotate"),
    *_numbered(27, "return by mission", "turtle"),
)


def _px4(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


PX4: Modes = (
    ("manual", _px4(1)),
    ("altitude", _px4(2)),
    ("position", _px4(3)),
    ("orbit", _px4(3, 1)),
    ("position slow", _px4(3, 2)),
    ("ready", _px4(4, 1)),
    ("takeoff", _px4(4, 2)),
    ("hold", _px4(4, 3)),
    ("guided", _px4(4, 3)),  # PX4 executes a DO_REPOSITION in its hold mode
    ("mission", _px4(4, 4)),
    ("return", _px4(4, 5)),
    ("land", _px4(4, 6)),
    ("follow", _px4(4, 8)),
    ("precision landing", _px4(4, 9)),
    ("vtol takeoff", _px4(4, 10)),
    *((f"external {number}", _px4(4, 10 + number)) for number in range(1, 9)),
    ("acro", _px4(5)),
    ("offboard", _px4(6)),
    ("stabilised", _px4(7)),
    ("termination", _px4(10)),
    ("altitude cruise", _px4(11)),
)
