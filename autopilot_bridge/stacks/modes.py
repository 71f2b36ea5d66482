"""Flight modes of the stacks: one name for equivalent modes, and the ``custom_mode`` of each.

Sources: ``mode.h`` of ArduPlane and ArduCopter 4.6.2, ``px4_custom_mode.h`` of PX4 1.17. If two
names have the same number, the first is the name of that number.
"""

Modes = tuple[tuple[str, int], ...]

ARDUPLANE: Modes = (
    ("manual", 0),
    ("circle", 1),
    ("stabilised", 2),
    ("training", 3),
    ("acro", 4),
    ("fly by wire a", 5),
    ("fly by wire b", 6),
    ("cruise", 7),
    ("autotune", 8),
    ("mission", 10),
    ("return", 11),
    ("hold", 12),
    ("takeoff", 13),
    ("avoid adsb", 14),
    ("guided", 15),
    ("initialising", 16),
    ("qstabilize", 17),
    ("qhover", 18),
    ("qloiter", 19),
    ("qland", 20),
    ("qrtl", 21),
    ("qautotune", 22),
    ("qacro", 23),
    ("thermal", 24),
    ("loiter to qland", 25),
)

ARDUCOPTER: Modes = (
    ("stabilised", 0),
    ("acro", 1),
    ("altitude", 2),
    ("mission", 3),
    ("guided", 4),
    ("loiter", 5),  # controlled by the pilot's sticks: without a pilot it sinks at 2.5 m/s
    ("return", 6),
    ("circle", 7),
    ("land", 9),
    ("drift", 11),
    ("sport", 13),
    ("flip", 14),
    ("autotune", 15),
    ("position", 16),
    ("hold", 17),
    ("brake", 17),
    ("throw", 18),
    ("avoid adsb", 19),
    ("guided without gps", 20),
    ("smart return", 21),
    ("flowhold", 22),
    ("follow", 23),
    ("zigzag", 24),
    ("system identification", 25),
    ("autorotate", 26),
    ("return by mission", 27),
    ("turtle", 28),
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
    ("guided", _px4(4, 3)),  # PX4 executes DO_REPOSITION in hold mode
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
