"""Alarms as chat messages: which, once, and again after a lost connection."""

from collections.abc import Iterable
from xml.etree import ElementTree

from mission_service.commands import Severity
from mission_service.interfaces.cot.alarm_chat import (
    MAX_A_ROUND,
    REPEAT_US,
    UNSURE_US,
    AlarmChat,
    Level,
)
from mission_service.runtime.published_states import Alarm


def alarm(
    key: str = "link/hawk", severity: Severity = "severe", text: str = "lost", at_us: int = 0
) -> Alarm:
    return Alarm(key, at_us, "hawk", severity, text)


class Chat:
    """A chat, and the texts of the messages that were sent."""

    def __init__(self, level: Level = "severe") -> None:
        self.chat = AlarmChat(level, "east")
        self.now_us = 0
        self.uids: list[str] = []

    def send(self, alarms: Iterable[Alarm]) -> list[str]:
        texts = []
        for message in self.chat.messages(alarms, 1_795_304_000_000_000):
            event = ElementTree.fromstring(message)
            self.uids.append(event.get("uid", ""))
            texts.append(event.findtext("detail/remarks") or "")
            self.chat.mark_sent(message, self.now_us)
        return texts


def test_an_alarm_is_sent_when_it_begins_changes_and_ends() -> None:
    chat = Chat()
    assert chat.send([alarm()]) == ["ALARM lost"]
    assert chat.send([alarm()]) == []
    assert chat.send([alarm(text="lost for 1 min")]) == ["ALARM lost for 1 min"]
    assert chat.send([]) == ["Alarm cleared: lost for 1 min"]
    assert chat.send([]) == []
    assert chat.send([alarm()]) == ["ALARM lost"]


def test_the_level_selects_alarms() -> None:
    both = [alarm(), alarm("battery/hawk", "warning", "low")]
    assert Chat("none").send(both) == []
    assert Chat("severe").send(both) == ["ALARM lost"]
    assert Chat("all").send(both) == ["ALARM lost", "ALARM low"]


def test_an_alarm_that_begins_again_has_another_identifier() -> None:
    # TAK clients show no message with an identifier that they have shown before.
    chat = Chat()
    chat.send([alarm()])
    chat.send([alarm(text="far")])
    for again_us in range(3):
        chat.send([alarm(at_us=again_us)])
        chat.send([])
    assert len(set(chat.uids)) == len(chat.uids) == 8


def test_messages_of_a_lost_connection_are_sent_again_with_the_same_identifier() -> None:
    chat = Chat()
    chat.send([alarm()])
    chat.chat.connection_lost(UNSURE_US - 1)
    assert chat.send([alarm()]) == ["ALARM lost"]
    assert chat.uids[0] == chat.uids[1]
    chat.chat.connection_lost(UNSURE_US + 1)
    assert chat.send([alarm()]) == []


def test_ends_of_alarms_are_sent_again_too() -> None:
    chat = Chat()
    chat.send([alarm()])
    chat.send([])
    chat.chat.connection_lost(0)
    assert chat.send([]) == ["Alarm cleared: lost"]
    assert chat.uids[1] == chat.uids[2]
    chat.chat.connected(0)
    chat.chat.handle_timer(REPEAT_US)
    assert chat.send([]) == ["Alarm cleared: lost"]
    chat.chat.handle_timer(REPEAT_US + UNSURE_US)
    chat.chat.connection_lost(0)
    assert chat.send([]) == []


def test_messages_after_a_loss_are_sent_once_more_for_clients_that_reconnect_later() -> None:
    chat = Chat()
    chat.now_us = 100_000_000
    chat.chat.connection_lost(chat.now_us)
    chat.chat.connected(chat.now_us)
    assert chat.send([alarm()]) == ["ALARM lost"]
    chat.chat.handle_timer(chat.now_us + REPEAT_US - 1)
    assert chat.send([alarm()]) == []
    chat.chat.handle_timer(chat.now_us + REPEAT_US)
    assert chat.send([alarm()]) == ["ALARM lost"]
    assert chat.uids[0] == chat.uids[1]
    chat.chat.handle_timer(chat.now_us + 9 * REPEAT_US)
    assert chat.send([alarm()]) == []


def test_many_alarms_are_sent_in_several_rounds() -> None:
    chat = Chat()
    many = [alarm(f"link/{number}", text=f"lost {number}") for number in range(25)]
    counts = [len(chat.send(many)) for _ in range(4)]
    assert counts == [MAX_A_ROUND, MAX_A_ROUND, 5, 0]


def test_a_severe_alarm_that_becomes_a_warning_is_cleared_only_when_it_is_gone() -> None:
    chat = Chat()
    warning = alarm(severity="warning", text="weak")
    assert chat.send([alarm()]) == ["ALARM lost"]
    assert chat.send([warning]) == ["Now a warning: weak"]
    assert chat.send([alarm(severity="warning", text="weaker")]) == []
    chat.chat.connection_lost(0)
    assert chat.send([warning]) == ["Now a warning: weak"]
    assert chat.uids[1] == chat.uids[2]
    assert chat.send([alarm()]) == ["ALARM lost"]
    assert chat.send([warning]) == ["Now a warning: weak"]
    assert chat.send([]) == ["Alarm cleared: weak"]
    assert chat.send([warning]) == []
    assert chat.send([alarm()]) == ["ALARM lost"]
    assert chat.send([alarm(severity="warning", at_us=1)]) == ["Alarm cleared: lost"]
