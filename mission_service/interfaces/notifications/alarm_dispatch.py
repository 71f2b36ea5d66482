"""Selects the alarms to send to a receiver: first message, repetition, change, retry. Pure."""

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
    """A message with all alarms that are due; ``begun`` and ``changed`` are keys of alarms."""

    title: str
    body: str
    begun: tuple[str, ...]
    changed: tuple[str, ...]  # ended, or became a warning that does not concern the receiver


@dataclass
class _Active:
    """An alarm that concerns the receiver, or that was sent and has become a warning.

    ``sent_s`` is None before its first message. ``is_pending`` is true until its first message, and
    again when it has become severe.
    """

    alarm: Alarm
    since_s: float
    sent_s: float | None = None
    is_pending: bool = True


class AlarmDispatch:
    """The alarms of one receiver. Times are those of a monotonic clock, in seconds."""

    def __init__(self, receiver: AlarmReceiverSection, site: str) -> None:
        """Send alarms of the run ``site`` to ``receiver``."""
        self._receiver, self._site = receiver, site
        self._active: dict[str, _Active] = {}
        self._changed: dict[str, str] = {}  # lines to send, about alarms that were sent
        self._wait_s = 0.0  # after the last failure; 0 after a delivery
        self._not_before_s = 0.0

    def next_message(self, alarms: Iterable[Alarm], now_s: float) -> AlarmMessage | None:
        """Return the message to send now, or None; call ``delivered`` or ``failed`` afterwards."""
        self._follow({each.alarm: each for each in alarms if self._is_of_kinds(each)}, now_s)
        if now_s < self._not_before_s:
            return None
        begun = [each.alarm for each in self._active.values() if self._is_due(each, now_s)]
        if not begun and not self._changed:
            return None
        begun.sort(key=lambda each: (each.severity != "severe", each.at_us))
        lines = [f"{_word(each)}: {each.text}" for each in begun]
        keys = tuple(each.alarm for each in begun)
        # An alarm that begins again has no line about its end.
        lines += [line for key, line in self._changed.items() if key not in keys]
        what = f"{len(begun)} alarm{'s' if len(begun) > 1 else ''}"
        if not begun:
            what = "Change of alarms" if self._changed.keys() & self._active else "End of alarms"
        return AlarmMessage(f"{self._site}: {what}", "\n".join(lines), keys, tuple(self._changed))

    def delivered(self, message: AlarmMessage, now_s: float) -> None:
        """Mark the alarms of a message as sent."""
        self._wait_s, self._not_before_s = 0.0, now_s
        for key in message.begun:
            if key in self._active:
                self._active[key].sent_s, self._active[key].is_pending = now_s, False
        for key in message.changed:
            self._changed.pop(key, None)

    def failed(self, now_s: float) -> None:
        """Try again later: after 10 s, and after twice as long with each further failure."""
        wait_s = min(max(2.0 * self._wait_s, FIRST_RETRY_S), LAST_RETRY_S)
        self._wait_s, self._not_before_s = wait_s, now_s + wait_s

    def _is_of_kinds(self, alarm: Alarm) -> bool:
        kinds = self._receiver.kinds
        is_own = alarm.alarm.partition("/")[0] == OWN_KIND
        return not is_own and (not kinds or alarm.alarm.startswith(kinds))

    def _has_severity(self, alarm: Alarm) -> bool:
        return alarm.severity == "severe" or self._receiver.min_severity == "warning"

    def _follow(self, alarms: dict[str, Alarm], now_s: float) -> None:
        """Add new alarms, and remove those that have ended."""
        for key, before in list(self._active.items()):
            alarm = alarms.get(key)
            # An alarm that was cleared and raised again between two checks has another start time.
            if alarm is None or alarm.at_us != before.alarm.at_us:
                del self._active[key]
                if before.sent_s is not None:
                    self._changed[key] = f"Ended: {before.alarm.text}"
            elif before.sent_s is None and not self._has_severity(alarm):
                del self._active[key]
        for key, alarm in alarms.items():
            if key in self._active:
                self._update(self._active[key], alarm)
            elif self._has_severity(alarm):
                self._active[key] = _Active(alarm, now_s)

    def _update(self, active: _Active, alarm: Alarm) -> None:
        """Replace the state of an alarm, of which the severity may have changed."""
        if alarm.severity == "severe" != active.alarm.severity:
            active.is_pending = True  # it was sent as a warning
            self._changed.pop(alarm.alarm, None)
        elif self._has_severity(active.alarm) and not self._has_severity(alarm):
            active.is_pending = False
            self._changed[alarm.alarm] = f"Now a warning: {alarm.text}"
        active.alarm = alarm

    def _is_due(self, active: _Active, now_s: float) -> bool:
        if active.alarm.acknowledged_by or not self._has_severity(active.alarm):
            return False
        if active.is_pending or active.sent_s is None:
            return now_s - active.since_s >= self._receiver.after_s
        repeat_s = self._receiver.repeat_s
        return repeat_s is not None and now_s - active.sent_s >= repeat_s


def _word(alarm: Alarm) -> str:
    return "ALARM" if alarm.severity == "severe" else "Warning"
