"""Switches the outputs of the mock: servos, relays, grippers and others."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.mock.mock_camera import MockCamera
from autopilot_bridge.stacks.stacks import Stack

# Number of outputs that the airframe uses; DO_SET_SERVO does not change these outputs.
_TAKEN = {"plane": 4, "copter": 4}
_NEUTRAL_US = {"plane": (1500, 1500, 1000, 1500), "copter": (1000, 1000, 1000, 1000)}
FIRST_ACTUATOR_CHANNEL = 9  # PX4's actuators 1 to 6 are the mock's outputs 9 to 14

Output = tuple[int, str, int, float]  # at_us since boot, kind, number, value


@dataclass(slots=True)
class Payload:
    """The history of switched ``outputs``, and the current values of the 16 servo outputs.

    The value of a servo is its pulse width in microseconds. Relays and sprayers have the value 0 or
    1, grippers 0 (open) or 1 (closed), actuators -1 to 1. The value of a winch is in metres, or in
    m/s if its rate is commanded.
    """

    stack: Stack
    outputs: list[Output] = field(default_factory=list)
    servos_us: list[int] = field(default_factory=list)
    texts: list[tuple[int, str]] = field(default_factory=list)  # severity and text, to be sent
    camera: MockCamera | None = None

    def __post_init__(self) -> None:
        self.servos_us = [*_NEUTRAL_US[self.stack.vehicle], *(0,) * 12]

    def execute(self, command: int, params: tuple[float, ...], at_us: int) -> bool:
        """Execute a DO command with params 1 to 7; return False if no output or camera supports it.

        The caller checks whether the stack accepts the command.
        """
        if command != 187:
            params = tuple(value if math.isfinite(value) else 0.0 for value in params)
        match command:
            case 183:
                return self._servo(int(params[0]), int(params[1]), at_us)
            case 181:
                self._record(at_us, "relay", int(params[0]), float(params[1] > 0.0))
            case 211:
                self._gripper(int(params[0]), int(params[1]), at_us)
            case 42600:
                rate = int(params[1]) == 2
                self._record(at_us, "winch", int(params[0]), params[3] if rate else params[2])
            case 216:
                self._record(at_us, "sprayer", 1, float(params[0] > 0.0))
            case 187:
                self._actuators(params, at_us)
            case _:
                return self.camera is not None and self.camera.run_command(command, params, at_us)
        return True

    def _record(self, at_us: int, kind: str, number: int, value: float) -> None:
        self.outputs.append((at_us, kind, number, value))

    def _servo(self, channel: int, pwm_us: int, at_us: int) -> bool:
        if not _TAKEN[self.stack.vehicle] < channel <= len(self.servos_us):
            if 1 <= channel <= len(self.servos_us):
                self.texts.append((6, f"ServoRelayEvent: Channel {channel} is already in use"))
            return False
        pwm_us = min(max(pwm_us, 0), 65535)
        self.servos_us[channel - 1] = pwm_us
        self._record(at_us, "servo", channel, float(pwm_us))
        return True

    def _gripper(self, number: int, action: int, at_us: int) -> None:
        if self.stack.name == "ardupilot":
            number = 1  # ArduPilot has one gripper and ignores the number
            self.texts.append((6, "Gripper Grabbed" if action else "Gripper Released"))
        self._record(at_us, "gripper", number, float(action))

    def _actuators(self, params: tuple[float, ...], at_us: int) -> None:
        """Set up to six actuators; a NaN leaves its actuator unchanged."""
        if params[6] != 0.0:  # a set of outputs that does not exist
            return
        for number, value in enumerate(params[:6], start=1):
            if not math.isnan(value):
                value = max(-1.0, min(1.0, value))
                channel = FIRST_ACTUATOR_CHANNEL + number - 1
                self.servos_us[channel - 1] = round(1500 + 500 * value)
                self._record(at_us, "actuator", number, value)


TAKES_US = 1_000_000  # PD_GRIPPER_TO in simulation
ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
IN_PROGRESS = int(mavlink.MAV_RESULT_IN_PROGRESS)
REJECTED = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
DENIED = int(mavlink.MAV_RESULT_DENIED)
CANCELLED = 6
GRAB, RELEASE = int(mavlink.GRIPPER_ACTION_GRAB), int(mavlink.GRIPPER_ACTION_RELEASE)

Requester = tuple[int, int]
Answer = tuple[Requester, int]


class Px4Gripper:
    """PX4's gripper, closed at first; ``move`` is called with the action and the time."""

    def __init__(self, move: Callable[[int, int], None]) -> None:
        self._move = move
        self._state: int | None = GRAB  # None while the gripper moves
        self._active: tuple[int, Requester, int] | None = None  # action, requester, end

    def operate(self, action: int, requester: Requester, now_us: int) -> list[Answer]:
        """Execute an action, and return the results, each with the ids of its requester."""
        answers: list[Answer] = []
        if self._active is not None:
            before, other, _ = self._active
            if before == action:
                return [(requester, REJECTED)]
            answers.append((other, CANCELLED))
        if action not in (GRAB, RELEASE):
            return [*answers, (requester, DENIED)]
        if self._state == action:
            return [*answers, (requester, ACCEPTED)]
        self._move(action, now_us)
        self._state, self._active = None, (action, requester, now_us + TAKES_US)
        return [*answers, (requester, IN_PROGRESS)]

    def ended(self, now_us: int) -> list[Answer]:
        """Return the results of actions that have ended by now."""
        if self._active is None or now_us < self._active[2]:
            return []
        action, requester, _ = self._active
        self._state, self._active = action, None
        return [(requester, ACCEPTED)]
