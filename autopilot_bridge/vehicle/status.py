"""The failure states that an autopilot reports, as events: pure functions of a message.

Which flags of the position estimate count, by their use in the stacks (read: ArduPilot 4.6.2
``AP_NavEKF3_Control.cpp`` ``updateFilterStatus``, PX4 1.17 ``ekf_helper.cpp``
``get_ekf_soln_status``):

- attitude, horizontal velocity and absolute horizontal position: valid or not, on both;
- constant position mode: ArduPilot without any aiding; PX4 sets it also while standing still, so
  there it is ignored;
- a glitch of the satellites' position: one sample is enough for either, so it counts only when two
  messages in a row have it;
- PX4 without the prediction of the absolute position: satellites are not fused (any more), the
  position is dead reckoned, and stays "valid" for some seconds. ArduPilot sets that flag together
  with the position itself.
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
# Flags that are set while all is well, and what it is called when they are not.
NEEDED = (
    (mavlink.ESTIMATOR_ATTITUDE, "attitude not valid"),
    (mavlink.ESTIMATOR_VELOCITY_HORIZ, "velocity not valid"),
    (mavlink.ESTIMATOR_POS_HORIZ_ABS, "position lost"),
)
FOUND_AFTER = {GLITCH: 2}  # messages in a row that have a problem; 1 for the others
GONE_AFTER = 5  # messages in a row without it


def system_state(message: Message, at_us: int) -> SystemState:
    """HEARTBEAT: the autopilot's MAV_STATE."""
    return SystemState(at_us, _word(SYSTEM_STATES, message.system_status))


def landed_state(message: Message, at_us: int) -> LandedState:
    """EXTENDED_SYS_STATE."""
    return LandedState(at_us, _word(LANDED_STATES, message.landed_state))


def _word(words: tuple[str, ...], number: int) -> str:
    return words[number] if number < len(words) else f"state {number}"


def fence_status(message: Message, at_us: int) -> FenceStatus:
    """FENCE_STATUS."""
    breached = bool(message.breach_status)
    return FenceStatus(at_us, breached, BREACHES.get(message.breach_type, "") if breached else "")


def estimator_problems(message: Message) -> tuple[str, ...]:
    """Problems of the position estimate, by EKF_STATUS_REPORT or ESTIMATOR_STATUS."""
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
    """Problems of the position estimate: from ``FOUND_AFTER`` until ``GONE_AFTER`` messages."""

    def __init__(self) -> None:
        self._seen: dict[str, int] = {}  # messages in a row that had it; of what does not count yet
        self._gone: dict[str, int] = {}  # messages in a row without it; of what counts

    def receive(self, message: Message, at_us: int) -> EstimatorStatus:
        """Return the status after this message."""
        now = estimator_problems(message)
        self._gone = {
            words: 0 if words in now else absent + 1
            for words, absent in self._gone.items()
            if words in now or absent + 1 < GONE_AFTER
        }
        self._seen = {
            words: self._seen.get(words, 0) + 1 for words in now if words not in self._gone
        }
        for words, times in self._seen.items():
            if times >= FOUND_AFTER.get(words, 1):
                self._gone[words] = 0
        problems = tuple(sorted(self._gone))
        return EstimatorStatus(at_us, not problems, problems)
