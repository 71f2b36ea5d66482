"""Outputs switched by missions and commands: servos, relays, grippers and others."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.stacks.stacks import Stack

# Functions that the airframe itself has: DO_SET_SERVO leaves them alone.
_TAKEN = {"plane": 4, "copter": 4}
_NEUTRAL_US = {"plane": (1500, 1500, 1000, 1500), "copter": (1000, 1000, 1000, 1000)}
FIRST_ACTUATOR_CHANNEL = 9  # PX4's actuators 1 to 6 are the mock's outputs 9 to 14

Output = tuple[int, str, int, float]  # at_us since boot, what, its number, value


@dataclass(slots=True)
class Payload:
    """``outputs`` is all that was switched, in order; ``servos_us`` what the 16 outputs have now.

    Values: servo PWM in us; relay and sprayer 0 or 1; gripper 0 open, 1 closed; winch metres (or
    m/s by rate); actuator -1 to 1.
    """

    stack: Stack
    outputs: list[Output] = field(default_factory=list)
    servos_us: list[int] = field(default_factory=list)
    texts: list[tuple[int, str]] = field(default_factory=list)  # severity and text, to be sent

    def __post_init__(self) -> None:
        self.servos_us = [*_NEUTRAL_US[self.stack.vehicle], *(0,) * 12]

    def execute(self, command: int, params: tuple[float, ...], at_us: int) -> bool:
        """Execute a DO command (params 1 to 7); returns False if it switches no output.

        The caller decides whether the stack accepts it at all.
        """
        if command != 187:
            params = tuple(value if math.isfinite(value) else 0.0 for value in params)
        match command:
            case 183:
                return self._servo(int(params[0]), int(params[1]), at_us)
            case 181:
                self._note(at_us, "relay", int(params[0]), float(params[1] > 0.0))
            case 211:
                self._gripper(int(params[0]), int(params[1]), at_us)
            case 42600:
                rate = int(params[1]) == 2
                self._note(at_us, "winch", int(params[0]), params[3] if rate else params[2])
            case 216:
                self._note(at_us, "sprayer", 1, float(params[0] > 0.0))
            case 187:
                self._actuators(params, at_us)
            case _:
                return False
        return True

    def _note(self, at_us: int, what: str, number: int, value: float) -> None:
        self.outputs.append((at_us, what, number, value))

    def _servo(self, channel: int, pwm_us: int, at_us: int) -> bool:
        if not _TAKEN[self.stack.vehicle] < channel <= len(self.servos_us):
            if 1 <= channel <= len(self.servos_us):
                self.texts.append((6, f"ServoRelayEvent: Channel {channel} is already in use"))
            return False
        pwm_us = min(max(pwm_us, 0), 65535)
        self.servos_us[channel - 1] = pwm_us
        self._note(at_us, "servo", channel, float(pwm_us))
        return True

    def _gripper(self, number: int, action: int, at_us: int) -> None:
        if self.stack.name == "ardupilot":
            number = 1  # it has one gripper, whatever the command's number
            self.texts.append((6, "Gripper Grabbed" if action else "Gripper Released"))
        self._note(at_us, "gripper", number, float(action))

    def _actuators(self, params: tuple[float, ...], at_us: int) -> None:
        """Six at a time; NaN leaves one as it is."""
        if params[6] != 0.0:  # a set of outputs that is not there
            return
        for number, value in enumerate(params[:6], start=1):
            if not math.isnan(value):
                value = max(-1.0, min(1.0, value))
                channel = FIRST_ACTUATOR_CHANNEL + number - 1
                self.servos_us[channel - 1] = round(1500 + 500 * value)
                self._note(at_us, "actuator", number, value)


TAKES_US = 1_000_000  # PD_GRIPPER_TO, as set in simulation
ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
IN_PROGRESS = int(mavlink.MAV_RESULT_IN_PROGRESS)
REJECTED = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
DENIED = int(mavlink.MAV_RESULT_DENIED)
CANCELLED = 6
GRAB, RELEASE = int(mavlink.GRIPPER_ACTION_GRAB), int(mavlink.GRIPPER_ACTION_RELEASE)

Requester = tuple[int, int]
Answer = tuple[Requester, int]


class Px4Gripper:
    """``move`` is called with the action and the time. It is closed at first."""

    def __init__(self, move: Callable[[int, int], None]) -> None:
        self._move = move
        self._stands: int | None = GRAB  # None: it moves
        self._under_way: tuple[int, Requester, int] | None = None  # action, requester, end

    def execute(self, action: int, requester: Requester, now_us: int) -> list[Answer]:
        """Return the answers, each with the ids of its requester."""
        answers: list[Answer] = []
        if self._under_way is not None:
            before, who, _ = self._under_way
            if before == action:
                return [(requester, REJECTED)]
            answers.append((who, CANCELLED))
        if action not in (GRAB, RELEASE):
            return [*answers, (requester, DENIED)]
        if self._stands == action:
            return [*answers, (requester, ACCEPTED)]
        self._move(action, now_us)
        self._stands, self._under_way = None, (action, requester, now_us + TAKES_US)
        return [*answers, (requester, IN_PROGRESS)]

    def ended(self, now_us: int) -> list[Answer]:
        """Return the answers of actions that have ended by now."""
        if self._under_way is None or now_us < self._under_way[2]:
            return []
        action, requester, _ = self._under_way
        self._stands, self._under_way = action, None
        return [(requester, ACCEPTED)]
