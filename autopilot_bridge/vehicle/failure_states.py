"""Decodes an autopilot's reports of failures into events.

These flags of the position estimate are used (sources: ArduPilot 4.6.2 ``AP_NavEKF3_Control.cpp``
``updateFilterStatus``, PX4 1.17 ``ekf_helper.cpp`` ``get_ekf_soln_status``):

- attitude, horizontal velocity and absolute horizontal position: both stacks set each flag if the
  value is valid;
- constant position mode: ArduPilot sets this flag if no sensor provides position or velocity. PX4
  also sets the flag while the vehicle is stationary, so the flag is ignored for PX4;
- satellite position glitch: both stacks set this flag after a single bad sample, so a glitch is
  reported only if the flag is set in two consecutive messages;
- predicted absolute position: if PX4 clears this flag, the position is dead reckoned without
  satellites, although PX4 still reports the position as valid for some seconds. ArduPilot sets this
  flag together with the flag for the absolute horizontal position.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.vehicle.client_events import (
    EstimatorStatus,
    FenceStatus,
    LandedState,
    SystemState,
)

SYSTEM_STATES = (
    *("uninit", "boot", "calibrating", "standby", "active", "critical", "emergency"),
    *("poweroff", "flight termination"),
)
LANDED_STATES = ("undefined", "on ground", "in air", "takeoff", "landing")
BREACHES = {
    mavlink.FENCE_BREACH_MINALT: "lowest altitude",
    mavlink.FENCE_BREACH_MAXALT: "highest altitude",
    mavlink.FENCE_BREACH_BOUNDARY: "boundary",
}
GLITCH = "satellite position glitch"
# Flags that are normally set, each with the name of the problem if the flag is clear.
NEEDED = (
    (mavlink.ESTIMATOR_ATTITUDE, "attitude not valid"),
    (mavlink.ESTIMATOR_VELOCITY_HORIZ, "velocity not valid"),
    (mavlink.ESTIMATOR_POS_HORIZ_ABS, "position lost"),
)
FOUND_AFTER = {GLITCH: 2}  # number of consecutive messages with a problem; 1 for other problems
ENDED_AFTER = 5  # number of consecutive messages without the problem


def system_state(message: Message, at_us: int) -> SystemState:
    """Decode the MAV_STATE of a HEARTBEAT."""
    return SystemState(at_us, _word(SYSTEM_STATES, message.system_status))


def landed_state(message: Message, at_us: int) -> LandedState:
    """Decode an EXTENDED_SYS_STATE."""
    return LandedState(at_us, _word(LANDED_STATES, message.landed_state))


def _word(words: tuple[str, ...], number: int) -> str:
    return words[number] if number < len(words) else f"state {number}"


def fence_status(message: Message, at_us: int) -> FenceStatus:
    """Decode a FENCE_STATUS."""
    breached = bool(message.breach_status)
    return FenceStatus(at_us, breached, BREACHES.get(message.breach_type, "") if breached else "")


def estimator_problems(message: Message) -> tuple[str, ...]:
    """Return the problems that an EKF_STATUS_REPORT or an ESTIMATOR_STATUS reports."""
    flags = message.flags
    problems = [words for flag, words in NEEDED if not flags & flag]
    if message.get_type() == "EKF_STATUS_REPORT":
        if flags & mavlink.EKF_UNINITIALIZED:
            return ("not initialised",)
        if flags & mavlink.EKF_CONST_POS_MODE:
            problems.append("constant position mode")
        glitch = flags & mavlink.EKF_GPS_GLITCHING
    else:
        if not flags & mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS:
            problems.append("satellites not used")
        glitch = flags & mavlink.ESTIMATOR_GPS_GLITCH
    return (*problems, GLITCH) if glitch else tuple(problems)


class Estimator:
    """The problems of the position estimate, filtered over consecutive messages."""

    def __init__(self) -> None:
        # The number of consecutive messages with each problem not yet reported.
        self._present: dict[str, int] = {}
        # The number of consecutive messages without each reported problem.
        self._absent: dict[str, int] = {}

    def receive(self, message: Message, at_us: int) -> EstimatorStatus:
        """Return the status after this message."""
        now = estimator_problems(message)
        self._absent = {
            words: 0 if words in now else absent + 1
            for words, absent in self._absent.items()
            if words in now or absent + 1 < ENDED_AFTER
        }
        self._present = {
            words: self._present.get(words, 0) + 1 for words in now if words not in self._absent
        }
        for words, times in self._present.items():
            if times >= FOUND_AFTER.get(words, 1):
                self._absent[words] = 0
        problems = tuple(sorted(self._absent))
        return EstimatorStatus(at_us, not problems, problems)
