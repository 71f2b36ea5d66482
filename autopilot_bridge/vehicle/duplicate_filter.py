"""Discards duplicates of a vehicle's messages that arrive over several links. Pure.

An autopilot sends telemetry, texts and heartbeats on each of its telemetry ports, with separate
sequence numbers, at slightly different times, and with slightly different content. It sends replies
only on the port of the request. A router sends identical frames over several links.

*Events* (texts, acknowledgements, item requests, parameters): messages with the same content are
counted on each link. The n-th of them is used once, from the link on which it arrives first. A
message that the autopilot repeats is thus used again; a frame that arrives again with the same
sequence number is not.

*States* (positions, heartbeats and other periodic messages) are used from the link in use. If this
link has lost a message, the copy from another link is used, but only if it is newer: a late
heartbeat with an old mode would otherwise look like a mode change. A message without a time field
is given the last time since boot that was received on its link.
"""

from collections import deque
from itertools import pairwise

from autopilot_bridge.links.codec import Message
from autopilot_bridge.links.framing import payload_of
from autopilot_bridge.vehicle.telemetry import MESSAGES, boot_time_us

STATES = MESSAGES | {
    *("HEARTBEAT", "MISSION_CURRENT", "HOME_POSITION", "SYSTEM_TIME", "SERVO_OUTPUT_RAW"),
    *("GIMBAL_DEVICE_ATTITUDE_STATUS", "CAMERA_FOV_STATUS", "CAMERA_INFORMATION"),
    "CAMERA_THERMAL_RANGE",
}
DUPLICATE_WITHIN_US = 3_000_000  # identical messages within this time may be duplicates
MAX_KEYS = 512
INTERVALS = 8  # number of intervals from which the usual interval is computed
LATE_INTERVALS = 1.5  # a message is missing after this multiple of the usual interval
UNKNOWN_INTERVAL_US = 1_000_000
MIN_INTERVAL_US, MAX_INTERVAL_US = 100_000, 5_000_000
# After a switch, states are discarded for this time if they are older than those already used.
SETTLING_US = 10_000_000

EventKey = tuple[int, str, bytes]


class _Occurrences:
    """Messages with the same content."""

    def __init__(self) -> None:
        self.at_us = 0
        self.used = 0
        self.of_link: dict[int, int] = {}
        self.seq_of_link: dict[int, int] = {}  # sequence number of the last one on each link


class _Periodic:
    """The messages of one kind that have been used."""

    def __init__(self) -> None:
        self.age_us: int | None = None  # the autopilot's time of the last used message
        self.times_us: deque[int] = deque(maxlen=INTERVALS + 1)

    def interval_us(self) -> float:
        intervals = sorted(late - early for early, late in pairwise(self.times_us))
        usual_us = intervals[1] if len(intervals) > 2 else UNKNOWN_INTERVAL_US
        return min(max(usual_us, MIN_INTERVAL_US), MAX_INTERVAL_US)


class DuplicateFilter:
    """The messages of one vehicle that were received over its links."""

    def __init__(self) -> None:
        self._events: dict[EventKey, _Occurrences] = {}  # in the order of their last messages
        self._states: dict[tuple[int, str], _Periodic] = {}
        self._boot_us: dict[int, int] = {}  # by link: the last time since boot
        self._switched_us: int | None = None

    def link_switched(self, now_us: int) -> None:
        """Use the next item requests from any link, because a transfer begins again."""
        self._events = {
            key: same for key, same in self._events.items() if not key[1].startswith("MISSION_")
        }
        self._switched_us = now_us

    def is_usable(self, message: Message, link: int, in_use: int, now_us: int) -> bool:
        """Return whether to use a message that arrived over ``link``."""
        boot_us = boot_time_us(message)
        if boot_us is not None:
            self._boot_us[link] = boot_us
        if message.get_type() not in STATES:
            return self._is_new_event(message, link, now_us)
        key = (message.get_srcComponent(), message.get_type())
        state = self._states.setdefault(key, _Periodic())
        if link != in_use and self._boot_us and link not in self._boot_us:
            return False
        age_us = self._boot_us.get(link, 0 if self._boot_us else now_us)
        if state.age_us is not None:
            newer_us = age_us - state.age_us
            if link != in_use and newer_us < LATE_INTERVALS * state.interval_us():
                return False
            settles = self._switched_us is not None and now_us - self._switched_us < SETTLING_US
            if link == in_use and settles and -SETTLING_US < newer_us < 0:
                return False
        if link == in_use:
            if state.times_us and age_us < state.times_us[-1]:  # a restart, or another link
                state.times_us.clear()
            state.times_us.append(age_us)
        state.age_us = age_us
        return True

    def _is_new_event(self, message: Message, link: int, now_us: int) -> bool:
        key = _event_key(message)
        same = self._events.pop(key, None)
        if same is None or now_us - same.at_us >= DUPLICATE_WITHIN_US:
            same = _Occurrences()
        self._events[key] = same
        if len(self._events) > MAX_KEYS:
            del self._events[next(iter(self._events))]
        same.at_us = now_us
        if same.seq_of_link.get(link) == message.get_seq():  # the link has duplicated the frame
            return False
        same.seq_of_link[link] = message.get_seq()
        same.of_link[link] = same.of_link.get(link, 0) + 1
        if same.of_link[link] <= same.used:
            return False
        same.used += 1
        return True


def _event_key(message: Message) -> EventKey:
    kind = message.get_type()
    if kind == "STATUSTEXT":  # PX4 numbers the long texts of each port separately
        return message.get_srcComponent(), kind, f"{message.severity} {message.text}".encode()
    return message.get_srcComponent(), kind, payload_of(bytes(message.get_msgbuf()))
