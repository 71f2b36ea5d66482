"""Stores the message rates of the mock: the defaults of the stack until others are requested.

Without a request, in SITL, ArduPlane sends all messages at 1 Hz, ArduCopter sends only HEARTBEAT
and texts, and PX4 sends the messages in the profile of its link.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.mock.kinematics import STEP_US
from autopilot_bridge.stacks.stacks import Stack

POSITION = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
VFR_HUD = mavlink.MAVLINK_MSG_ID_VFR_HUD
SYS_STATUS = mavlink.MAVLINK_MSG_ID_SYS_STATUS
BATTERY_STATUS = mavlink.MAVLINK_MSG_ID_BATTERY_STATUS
GPS = mavlink.MAVLINK_MSG_ID_GPS_RAW_INT
WIND = mavlink.MAVLINK_MSG_ID_WIND
WIND_COV = mavlink.MAVLINK_MSG_ID_WIND_COV
SERVOS = mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
LANDED = mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
FENCE = mavlink.MAVLINK_MSG_ID_FENCE_STATUS
EKF = mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT
ESTIMATOR = mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS
GIMBAL = mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS

_PLANE = dict.fromkeys(
    (POSITION, ATTITUDE, VFR_HUD, SYS_STATUS, BATTERY_STATUS, GPS, WIND, SERVOS, FENCE, EKF), 1.0
)
_PLANE[LANDED] = _PLANE[GIMBAL] = 0.0  # only on request
_PX4 = {
    **dict.fromkeys((POSITION, ATTITUDE, VFR_HUD), 4.0),
    **dict.fromkeys((SYS_STATUS, BATTERY_STATUS, GPS, WIND_COV, SERVOS, LANDED, ESTIMATOR), 1.0),
    GIMBAL: 0.0,
}
CYCLE_STEPS = 80  # a multiple of the usual intervals, after which the due messages repeat
_COPTER_MESSAGES = tuple(_PLANE)


class Intervals:
    """The message intervals of one mock, in whole time steps."""

    def __init__(self, stack: Stack) -> None:
        self._every: dict[int, int] = {}
        self._due: dict[int, list[int]] = {}  # by step, within one cycle of all intervals
        if stack.name == "px4":
            hz = _PX4
        else:
            hz = _PLANE if stack.vehicle == "plane" else dict.fromkeys(_COPTER_MESSAGES, 0.0)
        for message_id, rate_hz in hz.items():
            self.set(message_id, 1e6 / rate_hz if rate_hz else -1.0)
        self._default = dict(self._every)

    def set(self, message_id: int, interval_us: float) -> None:
        """Set the interval of a message: 0 is the default rate, -1 switches the message off."""
        self._due.clear()
        if interval_us == 0.0:
            self._every[message_id] = self._default.get(message_id, 0)
        elif interval_us < 0.0:
            self._every[message_id] = 0
        else:
            self._every[message_id] = max(round(interval_us / STEP_US), 1)

    def only(self, *message_ids: int) -> None:
        """Switch off all other messages, even after a restart, to save computing time."""
        self._default = {key: n for key, n in self._default.items() if key in message_ids}
        self.reset()

    def reset(self) -> None:
        """Restore the default rates, as a restart does."""
        self._every = dict(self._default)
        self._due.clear()

    def has_message(self, message_id: int) -> bool:
        """Return whether the mock has this message."""
        return message_id in self._every

    def due_in(self, step: int) -> list[int]:
        """Return the ids of the messages that are due in a step."""
        due = self._due.get(step % CYCLE_STEPS)
        if due is None:
            due = [key for key, every in self._every.items() if every and not step % every]
            if all(CYCLE_STEPS % every == 0 for every in self._every.values() if every):
                self._due[step % CYCLE_STEPS] = due
        return due
