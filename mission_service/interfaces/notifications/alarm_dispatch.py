"""Selects the alarms that are due for a receiver: first message, repetition, end, retry. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from mission_service.config.service_section import AlarmReceiverSection
from mission_service.runtime.published_states import Alarm

FIRST_RETRY_S, LAST_RETRY_S = (
    10.0,
    300.0,
)  # interval after a failure, doubled up to the second value
OWN_KIND = "notification"  # alarms about messages that were not delivered


class AlarmMessage(NamedTuple):
    """A message with all alarms that are due; ``begun`` and ``ended`` are keys of alarms."""

    title: str
    body: str
    begun: tuple[str, ...]
    ended: tuple[str, ...]


@dataclass
class _Active:
    """An alarm that concerns the receiver; ``sent_s`` is None before its first message."""

    alarm: Alarm
    since_s: float
    sent_s: float | None = None


class AlarmDispatch:
    """The alarms of one receiver. Times are those of a monotonic clock, in seconds."""

    def __init__(self, receiver: AlarmReceiverSection, site: str) -> None:
        """Send alarms of the run ``site`` to ``receiver``."""
        self._receiver, self._site = receiver, site
        self._active: dict[str, _Active] = {}
        self._ended: dict[str, str] = {}  # texts of alarms that were sent and have ended
        self._failures = 0
        self._not_before_s = 0.0

    def next_message(self, alarms: Iterable[Alarm], now_s: float) -> AlarmMessage | None:
        """Return the message to send now, or None; call ``delivered`` or ``failed`` afterwards."""
        self._follow({each.alarm: each for each in alarms if self._concerns(each)}, now_s)
        if now_s < self._not_before_s:
            return None
        begun = [each.alarm for each in self._active.values() if self._is_due(each, now_s)]
        if not begun and not self._ended:
            return None
        begun.sort(key=lambda each: (each.severity != "severe", each.at_us))
        lines = [f"{_word(each)}: {each.text}" for each in begun]
        lines += [f"Ended: {text}" for text in self._ended.values()]
        count = len(begun)
        what = f"{count} alarm{'s' if count > 1 else ''}" if count else "End of alarms"
        keys = tuple(each.alarm for each in begun)
        return AlarmMessage(f"{self._site}: {what}", "\n".join(lines), keys, tuple(self._ended))

    def delivered(self, message: AlarmMessage, now_s: float) -> None:
        """Mark the alarms of a message as sent."""
        self._failures, self._not_before_s = 0, now_s
        for key in message.begun:
            if key in self._active:
                self._active[key].sent_s = now_s
        for key in message.ended:
            self._ended.pop(key, None)

    def failed(self, now_s: float) -> None:
        """Try again later: after 10 s, and after twice as long with each further failure."""
        wait_s = min(FIRST_RETRY_S * 2.0**self._failures, LAST_RETRY_S)
        self._failures, self._not_before_s = self._failures + 1, now_s + wait_s

    def _concerns(self, alarm: Alarm) -> bool:
        kind = alarm.alarm.partition("/")[0]
        kinds = self._receiver.kinds
        if kind == OWN_KIND or (kinds and not alarm.alarm.startswith(kinds)):
            return False
        return alarm.severity == "severe" or self._receiver.min_severity == "warning"

    def _follow(self, alarms: dict[str, Alarm], now_s: float) -> None:
        """Add new alarms, and remove those that have ended."""
        for key in [key for key in self._active if key not in alarms]:
            gone = self._active.pop(key)
            if gone.sent_s is not None:
                self._ended[key] = gone.alarm.text
        for key, alarm in alarms.items():
            self._ended.pop(key, None)
            before = self._active.get(key)
            if before is None:
                self._active[key] = _Active(alarm, now_s)
                continue
            if alarm.severity == "severe" != before.alarm.severity:
                before.sent_s = None  # it was sent as a warning
            before.alarm = alarm

    def _is_due(self, active: _Active, now_s: float) -> bool:
        if active.alarm.acknowledged_by:
            return False
        if active.sent_s is None:
            return now_s - active.since_s >= self._receiver.after_s
        repeat_s = self._receiver.repeat_s
        return repeat_s is not None and now_s - active.sent_s >= repeat_s


def _word(alarm: Alarm) -> str:
    return "ALARM" if alarm.severity == "severe" else "Warning"
