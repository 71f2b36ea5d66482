"""Alarms as chat messages: which, once, and again after a lost connection."""

from collections.abc import Iterable
from xml.etree import ElementTree

from mission_service.commands import Severity
from mission_service.interfaces.cot.alarm_chat import MAX_A_ROUND, UNSURE_US, AlarmChat, Level
from mission_service.runtime.published_states import Alarm


def alarm(key: str = "link/hawk", severity: Severity = "severe", text: str = "lost") -> Alarm:
    return Alarm(key, 0, "hawk", severity, text)


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
    assert chat.send([]) == ["End of the alarm: lost for 1 min"]
    assert chat.send([]) == []
    assert chat.send([alarm()]) == ["ALARM lost"]


def test_the_level_selects_alarms() -> None:
    both = [alarm(), alarm("battery/hawk", "warning", "low")]
    assert Chat("none").send(both) == []
    assert Chat("severe").send(both) == ["ALARM lost"]
    assert Chat("all").send(both) == ["ALARM lost", "ALARM low"]


def test_messages_of_a_lost_connection_are_sent_again_with_the_same_identifier() -> None:
    chat = Chat()
    chat.send([alarm()])
    chat.chat.connection_lost(UNSURE_US - 1)
    assert chat.send([alarm()]) == ["ALARM lost"]
    assert chat.uids[0] == chat.uids[1]
    chat.chat.connection_lost(UNSURE_US + 1)
    assert chat.send([alarm()]) == []


def test_many_alarms_are_sent_in_several_rounds() -> None:
    chat = Chat()
    many = [alarm(f"link/{number}", text=f"lost {number}") for number in range(25)]
    counts = [len(chat.send(many)) for _ in range(4)]
    assert counts == [MAX_A_ROUND, MAX_A_ROUND, 5, 0]
