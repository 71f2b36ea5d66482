"""The GO/NO-GO checklist."""

import msgspec
import pytest

from mission_service.events import Aborted, AnyEvent, ChecklistAnswered, OperatorHeartbeat, Resumed
from mission_service.guidance.burn.checklist import Checklist

ITEMS = ("weather", "payload", "people")


def answer(item: str, go: bool = True) -> ChecklistAnswered:
    return ChecklistAnswered(5_000_000, "ann", "alpha", item, go)


def all_go() -> Checklist:
    checklist = Checklist(ITEMS)
    for item in ITEMS:
        checklist.apply(answer(item))
    return checklist


def test_it_is_complete_when_every_item_has_its_go() -> None:
    checklist = Checklist(ITEMS)
    assert checklist.apply(answer("people")) == (
        'GO/NO-GO checklist: GO for "people" by ann at alpha; 2 of 3 open'
    )
    assert checklist.open_items == ("weather", "payload")
    checklist.apply(answer("weather"))
    assert not checklist.complete
    assert str(checklist.apply(answer("payload"))).endswith("; complete")
    assert checklist.complete


def test_a_no_go_opens_the_list() -> None:
    checklist = all_go()
    text = checklist.apply(answer("payload", go=False))
    assert text == 'GO/NO-GO checklist: NO-GO for "payload" by ann at alpha; 1 of 3 open'
    assert checklist.open_items == ("payload",)
    checklist.apply(answer("payload"))
    assert checklist.complete


def test_an_item_that_is_not_on_the_list_changes_nothing() -> None:
    checklist = Checklist(ITEMS)
    text = checklist.apply(answer("wether"))
    assert (
        text
        == 'GO/NO-GO checklist: "wether" is not an item; the items are: weather; payload; people'
    )
    assert checklist.open_items == ITEMS


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (Aborted(6_000_000, "bob", "bravo"), "abort by bob"),
        (Resumed(6_000_000, "service", "", 4.0), "the service was restarted"),
    ],
)
def test_a_stop_opens_all(event: AnyEvent, words: str) -> None:
    checklist = all_go()
    assert words in str(checklist.apply(event))
    assert checklist.open_items == ITEMS
    assert checklist.apply(event) is None  # no item was answered since then


def test_nothing_else_matters() -> None:
    checklist = all_go()
    assert checklist.apply(OperatorHeartbeat(10**12, "ann", "alpha")) is None
    assert checklist.complete
    assert (
        str(checklist.clear("landed")) == "GO/NO-GO checklist: all 3 items are open again (landed)"
    )
    assert not checklist.complete


def test_its_status() -> None:
    checklist = Checklist(ITEMS)
    checklist.apply(answer("weather"))
    checklist.apply(answer("payload", go=False))
    status = msgspec.json.decode(msgspec.json.encode(checklist.status()))
    assert [item["answer"] for item in status["items"]] == ["go", "no-go", "open"]
    assert (status["complete"], status["open"]) == (False, 2)
    assert status["items"][0]["by"] == "ann"
