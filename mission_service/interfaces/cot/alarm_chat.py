"""Selects the alarms to send as chat messages. Pure."""

import hashlib
from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple

from mission_service.interfaces.cot.cot_events import chat_event
from mission_service.runtime.published_states import Alarm

MAX_A_ROUND = 10
UNSURE_US = 15_000_000  # a message sent within this time before a connection loss is sent again
REPEAT_US = 60_000_000  # after a loss, other clients of the server may take this long to reconnect

Level = Literal["none", "severe", "all"]
Stage = Literal["active", "warning", "ended"]  # "warning": was severe, and no longer is
PREFIXES: dict[Stage, str] = {
    "active": "ALARM",
    "warning": "Now a warning:",
    "ended": "Alarm cleared:",
}


class _Message(NamedTuple):
    """The latest message about an alarm."""

    alarm: Alarm
    number: int = 0  # index among the messages about the alarm; 0 for its beginning
    stage: Stage = "active"
    sent_us: int = 0  # monotonic; 0 before sending
    is_lost: bool = False  # some clients may not have received the message

    @property
    def line(self) -> str:
        """The text of the message."""
        return f"{PREFIXES[self.stage]} {self.alarm.text}"


class AlarmChat:
    """The chat messages of one run: one at the start, at each change and at the end of an alarm.

    An alarm that becomes a warning, which is not sent, has one more message before that of its end.
    A repeated message has the same identifier as before, so that clients show one message.
    """

    def __init__(self, level: Level, site: str) -> None:
        """Set which alarms are sent: none, severe ones, or all."""
        self._level, self._site = level, site
        self._latest: dict[str, _Message] = {}  # by key of the alarm
        self._pending: dict[bytes, _Message] = {}
        self._repeat_since_us: int | None = None  # later messages are repeated
        self._repeat_at_us: int | None = None

    def messages(self, alarms: Iterable[Alarm], unix_us: int) -> list[bytes]:
        """Return the events to send now, at most ``MAX_A_ROUND``; call ``mark_sent`` for each."""
        self._pending.clear()
        for each in self._changes(alarms):
            if len(self._pending) == MAX_A_ROUND:
                break
            about = f"{each.alarm.alarm} {each.alarm.at_us} {each.number} {each.line}"
            message_id = hashlib.sha256(about.encode()).hexdigest()[:16]
            self._pending[chat_event(each.line, self._site, message_id, unix_us)] = each
        return list(self._pending)

    def mark_sent(self, message: bytes, now_us: int) -> None:
        """Mark a message as sent; ``now_us`` is a monotonic clock."""
        sent = self._pending[message]
        self._latest[sent.alarm.alarm] = sent._replace(sent_us=now_us, is_lost=False)

    def connection_lost(self, alive_us: int) -> None:
        """Mark as lost all messages sent later than ``UNSURE_US`` before ``alive_us``.

        ``alive_us`` (monotonic) is the last time at which the connection worked. The messages are
        sent on the next connection, and once more ``REPEAT_US`` after it.
        """
        since_us = alive_us - UNSURE_US
        self._mark_lost(since_us)
        if self._repeat_since_us is None:
            self._repeat_since_us = since_us
        self._repeat_at_us = None

    def connected(self, now_us: int) -> None:
        """Plan the repetition of messages, because other clients may reconnect later."""
        if self._repeat_since_us is not None:
            self._repeat_at_us = now_us + REPEAT_US

    def handle_timer(self, now_us: int) -> None:
        """Mark messages as lost when their repetition is due; delete old messages on ended alarms.

        ``now_us`` is monotonic.
        """
        if self._repeat_since_us is None:
            old_us = now_us - UNSURE_US
            for key, each in list(self._latest.items()):
                if each.stage == "ended" and not each.is_lost and each.sent_us < old_us:
                    del self._latest[key]
        elif self._repeat_at_us is not None and now_us >= self._repeat_at_us:
            self._mark_lost(self._repeat_since_us)
            self._repeat_since_us = self._repeat_at_us = None

    def _mark_lost(self, since_us: int) -> None:
        for key, each in self._latest.items():
            if each.sent_us > since_us:
                self._latest[key] = each._replace(is_lost=True)

    def _changes(self, alarms: Iterable[Alarm]) -> Iterator[_Message]:
        """Yield the next message about each alarm that has changed or whose message was lost."""
        active = {each.alarm: each for each in alarms}
        for key in dict.fromkeys((*active, *self._latest)):
            message = self._next(self._latest.get(key), active.get(key))
            if message is not None:
                yield message

    def _next(self, before: _Message | None, alarm: Alarm | None) -> _Message | None:
        """Return the next message about an alarm, of which ``alarm`` is None unless it is active.

        ``before`` is the latest message about an alarm with the same key.
        """
        is_same = before is not None and alarm is not None and before.alarm.at_us == alarm.at_us
        if alarm is not None and self._is_sent(alarm):
            if before is None or not is_same:
                return _Message(alarm)
            if before.stage != "active" or before.alarm.text != alarm.text:
                return _Message(alarm, before.number + 1)
        elif before is not None and before.stage != "ended":
            if alarm is None or not is_same:
                return before._replace(number=before.number + 1, stage="ended")
            if before.stage == "active":
                return _Message(alarm, before.number + 1, "warning")
        return before if before is not None and before.is_lost else None

    def _is_sent(self, alarm: Alarm) -> bool:
        return self._level == "all" or (self._level == "severe" and alarm.severity == "severe")
