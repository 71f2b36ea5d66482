"""Requests message rates from a vehicle (MAV_CMD_SET_MESSAGE_INTERVAL).

requested --COMMAND_ACK--> next message; a request is repeated on timeout, then skipped
after all requests: absent messages are requested again a few times

Messages may stop because ArduCopter resets its message rates when it restarts, and a restart is not
visible in its heartbeat.

An acknowledgement does not contain the message id, so a request is sent only after the previous
request was acknowledged.
"""

from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import is_for
from autopilot_bridge.stacks.stacks import Stack, Step
from autopilot_bridge.vehicle.command_sequence import command_message

RatesHz = Mapping[int, float]

# All messages that a client reports. These rates are for transfers from the command line, for
# MAVSDK, and for programs without the service.
ALL_RATES_HZ: RatesHz = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 4.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 2.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
    mavlink.MAVLINK_MSG_ID_WIND: 1.0,
    mavlink.MAVLINK_MSG_ID_WIND_COV: 1.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
    mavlink.MAVLINK_MSG_ID_FENCE_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 1.0,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
}
# The messages that a run uses. Other stations may use other messages, whose rates are not changed.
RATES_HZ: RatesHz = {
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    mavlink.MAVLINK_MSG_ID_WIND: 0.2,
    mavlink.MAVLINK_MSG_ID_WIND_COV: 0.2,
    # Until its landing is reported, a hold order would make a landed vehicle take off.
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 4.0,
    # Reports of failures must arrive within two seconds.
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 2.0,
    mavlink.MAVLINK_MSG_ID_FENCE_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 1.0,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
}
# For drops along a path: at 5 m/s, one position every half metre.
DROP_RATES_HZ: RatesHz = {
    **RATES_HZ,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
}
# For sensors whose images are georeferenced from telemetry. Images are reported without a request.
CAMERA_RATES_HZ: RatesHz = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 4.0,
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 4.0,
    mavlink.MAVLINK_MSG_ID_CAMERA_FOV_STATUS: 0.2,
    mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION: 0.2,
    mavlink.MAVLINK_MSG_ID_CAMERA_THERMAL_RANGE: 1.0,
}
# ArduPilot sends one aircraft at each interval, PX4 each aircraft once.
AIRCRAFT_RATES_HZ: RatesHz = {mavlink.MAVLINK_MSG_ID_ADSB_VEHICLE: 20.0}
# Sources: PX4 1.17 streams/, ArduPilot 4.6.2 GCS_Common.cpp.
_OF_THE_OTHER_STACK = {
    "px4": (
        mavlink.MAVLINK_MSG_ID_WIND,
        mavlink.MAVLINK_MSG_ID_FENCE_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_CAMERA_FOV_STATUS,
        mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
        mavlink.MAVLINK_MSG_ID_CAMERA_THERMAL_RANGE,
    ),
    "ardupilot": (
        mavlink.MAVLINK_MSG_ID_WIND_COV,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    ),
}
SET_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
ACK_TIMEOUT_US = 1_000_000
TRIES = 3
CHECK_AFTER_US = 4_000_000  # minimum delay until the check that all messages arrive
ROUNDS = 3  # consecutive rounds of requests for the same messages


def rates_for(stack: Stack, rates_hz: RatesHz = ALL_RATES_HZ) -> dict[int, float]:
    """Return the rates in Hz of those messages that the stack sends, by message id."""
    absent = _OF_THE_OTHER_STACK[stack.name]
    return {key: hz for key, hz in rates_hz.items() if key not in absent}


def rate_requests(stack: Stack, target: tuple[int, int]) -> list[Message]:
    """Return the requests for ``ALL_RATES_HZ``; the sender need not check their results."""
    return [_request(target, key, hz, 0) for key, hz in rates_for(stack).items()]


def _request(target: tuple[int, int], message_id: int, hz: float, tries: int) -> Message:
    interval_us = 1e6 / hz if hz > 0.0 else -1.0  # -1 switches the message off
    return command_message(target, Step(SET_INTERVAL, (float(message_id), interval_us)), tries)


class MessageRates:
    """The requests that set the message rates of one vehicle."""

    def __init__(self, own: tuple[int, int], rates_hz: RatesHz) -> None:
        self._own = own
        self._rates_hz = rates_hz
        self._target = (0, 0)
        self._rates: dict[int, float] = {}
        self._waiting: list[int] = []
        self._arrived: set[int] = set()
        self._unanswered: set[int] = set()
        self._absent: set[int] = set()  # messages that were absent at the last check
        self._tries = 0
        self._rounds = 0
        self._due_us: int | None = None

    def begin(self, stack: Stack, target: tuple[int, int], now_us: int) -> list[Message]:
        """Start again and request all rates."""
        self._target = target
        self._rates = rates_for(stack, self._rates_hz)
        self._absent = set()
        self._rounds = 0
        return self._request_round(list(self._rates), now_us)

    def _request_round(self, message_ids: list[int], now_us: int) -> list[Message]:
        self._waiting = message_ids
        self._unanswered.clear()
        self._tries = 0
        return self._send_request(now_us)

    def _send_request(self, now_us: int) -> list[Message]:
        if not self._waiting:
            self._check_later(now_us)
            return []
        self._due_us = now_us + ACK_TIMEOUT_US
        message_id = self._waiting[0]
        return [_request(self._target, message_id, self._rates[message_id], self._tries)]

    def _check_later(self, now_us: int) -> None:
        self._arrived.clear()
        slowest_hz = min((hz for hz in self._rates.values() if hz > 0.0), default=1.0)
        self._due_us = now_us + max(CHECK_AFTER_US, round(3e6 / slowest_hz))

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Record a received message; after an acknowledgement, request the next rate."""
        message_id = message.get_msgId()
        if message_id in self._rates:
            self._arrived.add(message_id)
        if message_id != mavlink.MAVLINK_MSG_ID_COMMAND_ACK or message.command != SET_INTERVAL:
            return []
        return self._next(now_us) if is_for(message, self._own) and self._waiting else []

    def _next(self, now_us: int) -> list[Message]:
        self._waiting.pop(0)
        self._tries = 0
        return self._send_request(now_us)

    def next_timer(self) -> int | None:
        """Return the time of the next ``handle_timer`` call; None if no action is due."""
        return self._due_us

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat an unanswered request, or request absent messages again."""
        if self._due_us is None or now_us < self._due_us:
            return []
        if self._waiting:
            self._tries += 1
            if self._tries < TRIES:
                return self._send_request(now_us)
            self._unanswered.add(self._waiting[0])
            return self._next(now_us)
        return self._check(now_us)

    def _check(self, now_us: int) -> list[Message]:
        expected = {key for key, hz in self._rates.items() if hz > 0.0}
        absent = expected - self._arrived | self._unanswered
        self._rounds = self._rounds + 1 if absent == self._absent else 0
        self._absent = absent
        if absent and self._rounds < ROUNDS:
            return self._request_round(sorted(absent), now_us)
        self._check_later(now_us)
        return []
