"""PX4's gripper by command: acted on at once, told as in progress, ended a second later.

Seen on PX4 1.17 and read (payload_deliverer.cpp).
"""

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

TAKES_US = 1_000_000  # PD_GRIPPER_TO, as set in simulation
ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
IN_PROGRESS = int(mavlink.MAV_RESULT_IN_PROGRESS)
REJECTED = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
DENIED = int(mavlink.MAV_RESULT_DENIED)
CANCELLED = 6
GRAB, RELEASE = int(mavlink.GRIPPER_ACTION_GRAB), int(mavlink.GRIPPER_ACTION_RELEASE)

Asker = tuple[int, int]
Answer = tuple[Asker, int]


class Px4Gripper:
    """``move`` is told the action and when. It stands closed at first."""

    def __init__(self, move: Callable[[int, int], None]) -> None:
        self._move = move
        self._stands: int | None = GRAB  # None: it moves
        self._under_way: tuple[int, Asker, int] | None = None  # action, who asked, its end

    def obey(self, action: int, asker: Asker, now_us: int) -> list[Answer]:
        """What is answered to whom."""
        answers: list[Answer] = []
        if self._under_way is not None:
            before, who, _ = self._under_way
            if before == action:
                return [(asker, REJECTED)]
            answers.append((who, CANCELLED))
        if action not in (GRAB, RELEASE):
            return [*answers, (asker, DENIED)]
        if self._stands == action:
            return [*answers, (asker, ACCEPTED)]
        self._move(action, now_us)
        self._stands, self._under_way = None, (action, asker, now_us + TAKES_US)
        return [*answers, (asker, IN_PROGRESS)]

    def ended(self, now_us: int) -> list[Answer]:
        """What has come to its end by now."""
        if self._under_way is None or now_us < self._under_way[2]:
            return []
        action, asker, _ = self._under_way
        self._stands, self._under_way = action, None
        return [(asker, ACCEPTED)]
