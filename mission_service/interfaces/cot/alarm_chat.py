"""Selects the alarms to send as chat messages. Pure."""

import hashlib
from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple

from mission_service.interfaces.cot.cot_events import chat_event
from mission_service.runtime.published_states import Alarm

MAX_A_ROUND = 10
UNSURE_US = 15_000_000  # a message sent this soon before a loss of the connection is sent again

Level = Literal["none", "severe", "all"]


class _Sent(NamedTuple):
    text: str
    sent_us: int
    is_lost: bool = False  # the connection may have lost the message


class AlarmChat:
    """The chat messages of one run: one at the start, each change and the end of an alarm.

    A repeated message has the same identifier as before, so that clients show one message.
    """

    def __init__(self, level: Level, site: str) -> None:
        """Send the alarms of a level: no alarms, severe ones, or all."""
        self._level, self._site = level, site
        self._shown: dict[str, _Sent] = {}  # by key of the alarm
        self._pending: dict[bytes, tuple[str, str | None]] = {}

    def messages(self, alarms: Iterable[Alarm], unix_us: int) -> list[bytes]:
        """Return the events to send now, at most ``MAX_A_ROUND``; call ``mark_sent`` for each."""
        self._pending.clear()
        for key, text, line in self._changes(alarms):
            if len(self._pending) == MAX_A_ROUND:
                break
            number = hashlib.sha256(f"{key} {line}".encode()).hexdigest()[:16]
            self._pending[chat_event(line, self._site, number, unix_us)] = (key, text)
        return list(self._pending)

    def mark_sent(self, message: bytes, now_us: int) -> None:
        """Mark a message as sent; ``now_us`` is a monotonic clock."""
        key, text = self._pending[message]
        if text is None:
            del self._shown[key]
        else:
            self._shown[key] = _Sent(text, now_us)

    def connection_lost(self, now_us: int) -> None:
        """Mark the latest messages as not sent, because the connection may have lost them."""
        for key, each in list(self._shown.items()):
            if now_us - each.sent_us < UNSURE_US:
                self._shown[key] = each._replace(is_lost=True)

    def _changes(self, alarms: Iterable[Alarm]) -> Iterator[tuple[str, str | None, str]]:
        """Yield key, text (None at the end) and chat line of each alarm that has changed."""
        active = {each.alarm: each for each in alarms if self._is_sent(each)}
        for key, alarm in active.items():
            before = self._shown.get(key)
            if before is None or before.is_lost or before.text != alarm.text:
                yield key, alarm.text, f"ALARM {alarm.text}"
        for key, before in self._shown.items():
            if key not in active:
                yield key, None, f"End of the alarm: {before.text}"

    def _is_sent(self, alarm: Alarm) -> bool:
        return self._level == "all" or (self._level == "severe" and alarm.severity == "severe")
