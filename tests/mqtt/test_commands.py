"""Which MQTT commands reach the request handler."""

import json
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_service.core.request_events import ALL_REQUESTS, RequestScope, event_of
from mission_service.interfaces.mqtt.command_gate import (
    A_SECOND,
    AT_ONCE,
    MAX_BYTES,
    MAX_NAME,
    MAX_REMEMBERED,
    OLD_US,
    REMEMBERED_S,
    TAKEN,
    CommandGate,
)
from mission_service.interfaces.mqtt.payloads import Reply

NOW_US = 1_795_000_000_000_000


class Desk:
    """A request handler that accepts and counts all requests."""

    def __init__(self) -> None:
        self.asked: list[dict[str, Any]] = []

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        self.asked.append(request)
        return {"ok": True, "at_s": 1.0, "event": "Done", "messages": [str(len(self.asked))]}


class RunInterface:
    """A command gate with a clock."""

    def __init__(self) -> None:
        self.request_handler = Desk()
        self.keeper = CommandGate(self.request_handler.ask)
        self.now_s = 1000.0

    @property
    def unix_us(self) -> int:
        return NOW_US + round(self.now_s * 1e6)

    def takes(
        self, name: str, payload: bytes | None = None, retained: bool = False, **more: Any
    ) -> Reply | None:
        if payload is None:
            request = {"id": "1", "by": "anna", "sent_at_unix_us": self.unix_us} | more
            payload = json.dumps(
                {key: value for key, value in request.items() if value != ...}
            ).encode()
        return self.keeper.accept(name, payload, retained, 7, self.now_s, self.unix_us)

    def refuses(self, name: str, words: str, payload: bytes | None = None, **more: Any) -> Reply:
        reply = self.takes(name, payload, **more)
        assert reply is not None
        assert not reply.ok
        assert words in reply.error, reply
        assert not self.request_handler.asked
        return reply


def test_a_command_comes_to_the_desk_and_its_answer_bears_its_id() -> None:
    run_interface = RunInterface()
    reply = run_interface.takes("hold", vehicle="hawk", station="west", schema="command/1")
    assert run_interface.request_handler.asked == [
        {"do": "hold", "by": "mqtt:anna", "station": "mqtt:west", "vehicle": "hawk"}
    ]
    assert reply == Reply("1", "hold", 7, True, event="Done", messages=("1",))


@pytest.mark.parametrize("name", ["approve", "go", "present"])
def test_fire_is_never_let_fall_over_mqtt(name: str) -> None:
    reply = RunInterface().refuses(name, "never accepted over MQTT", hash="0" * 64, item="x")
    assert reply.id == "1"


def test_all_requests_there_are_were_thought_of() -> None:
    assert set(ALL_REQUESTS) - set(TAKEN) == {"approve", "go", "present"}


def test_no_operator_is_present_by_a_message() -> None:
    """An approval ends without heartbeats from its station; a broker is not a station."""
    run_interface = RunInterface()
    for station in ("firing-boss", ""):
        run_interface.takes("wind", id=f"1{station}", station=station, speed_m_s=1.0, from_deg=0.0)
    for request in run_interface.request_handler.asked:
        event = event_of(request, 0, RequestScope(["firing-boss"]))
        assert event.station in ("mqtt:firing-boss", "mqtt")


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"", "cannot be read"),
        (b"\xff{", "cannot be read"),
        (b"[" * 60_000, "cannot be read"),
        (b"[1]", "cannot be read"),
        (b"{}", "id: is missing; specify printable ASCII"),
        (
            b'{"id": 1, "by": "a", "sent_at_unix_us": 1}',
            "id: must be printable ASCII characters without spaces",
        ),
        (b'{"id": "a b", "by": "a", "sent_at_unix_us": 1}', "id: must be printable ASCII"),
        (b'{"id": "ab\\n", "by": "a", "sent_at_unix_us": 1}', "id: must be printable ASCII"),
        (
            b'{"id": "ab", "by": "a\\u001b[2J", "sent_at_unix_us": 1}',
            "by: must be one line of printable",
        ),
        (
            b'{"id": "ab", "by": "a\\n", "sent_at_unix_us": 1}',
            "by: must be one line of printable",
        ),
        (b'{"id": "ab", "by": "a", "sent_at_unix_us": 1e400}', "cannot be read"),
        (b'{"id": "ab", "by": "a", "sent_at_unix_us": ' + b"9" * 5000 + b"}", "h"),
        (b'{"id": "ab", "by": "a", "sent_at_unix_us": 1, "schema": "command/2"}', "command/2"),
        (b'{"x": "' + b"x" * MAX_BYTES + b'"}', "the limit is 65536"),
    ],
)
def test_what_cannot_be_read_is_answered_with_what_is_wrong(payload: bytes, words: str) -> None:
    RunInterface().refuses("hold", words, payload)


def test_an_id_is_answered_where_the_rest_cannot_be_read() -> None:
    reply = RunInterface().refuses("hold", "sent_at_unix_us", sent_at_unix_us=...)
    assert reply.id == "1"


def test_the_error_for_unknown_commands_lists_the_commands() -> None:
    RunInterface().refuses("fly", "the commands are abort, correct")
    RunInterface().refuses("hlod", "did you mean hold?")


def test_the_command_is_given_by_the_topic_alone() -> None:
    RunInterface().refuses("hold", 'unknown key "do"', do="abort")
    RunInterface().refuses("hold", 'unknown key "do"', do="approve")
    run_interface = RunInterface()
    reply = run_interface.takes("abort", do="hold")
    assert reply is not None
    assert reply.ok
    assert run_interface.request_handler.asked[0]["do"] == "abort"


def test_what_the_broker_keeps_is_refused() -> None:
    RunInterface().refuses("hold", "retained", retained=True)


@pytest.mark.parametrize("age_us", [OLD_US + 1, -OLD_US - 1])
def test_old_commands_and_those_of_the_future_are_refused(age_us: int) -> None:
    run_interface = RunInterface()
    run_interface.refuses(
        "hold", "check the sender's clock", sent_at_unix_us=run_interface.unix_us - age_us
    )
    at_edge = OLD_US if age_us > 0 else -OLD_US
    reply = run_interface.takes("hold", sent_at_unix_us=run_interface.unix_us - at_edge)
    assert reply is not None
    assert reply.ok


def test_nothing_is_done_twice() -> None:
    run_interface = RunInterface()
    first_us = run_interface.unix_us
    first = run_interface.takes("hold")
    run_interface.now_s += 20.0
    again = run_interface.takes("hold", sent_at_unix_us=first_us)
    assert len(run_interface.request_handler.asked) == 1
    assert first is not None
    assert again == msgspec.structs.replace(first, again=True)
    other = run_interface.takes("hold", sent_at_unix_us=first_us, vehicle="kite")
    assert other is not None
    assert "an earlier command" in other.error
    assert len(run_interface.request_handler.asked) == 1
    run_interface.takes("hold", by="ben")  # a user whose ids are separate
    run_interface.takes("return")
    assert len(run_interface.request_handler.asked) == 3


def test_answers_are_kept_for_ten_minutes_and_no_longer() -> None:
    run_interface = RunInterface()
    run_interface.takes("hold")
    for seconds, asked in ((REMEMBERED_S - 1.0, 1), (2.0, 2)):
        run_interface.now_s += seconds
        run_interface.keeper.accept(
            "hold",
            _bytes(run_interface, 1000.0),
            False,
            7,
            run_interface.now_s,
            NOW_US + 1_000_000_000,
        )
        assert len(run_interface.request_handler.asked) == asked


def _bytes(run_interface: RunInterface, sent_s: float) -> bytes:
    sent_at_us = NOW_US + round(sent_s * 1e6)
    return json.dumps({"id": "1", "by": "anna", "sent_at_unix_us": sent_at_us}).encode()


def test_too_many_commands_are_not_even_answered_and_memory_is_bounded() -> None:
    run_interface = RunInterface()
    answered = 0
    for number in range(20_000):
        run_interface.now_s += 0.04  # 25 a second
        answered += run_interface.takes("hold", id=str(number)) is not None
    assert answered == pytest.approx(800 * A_SECOND + AT_ONCE, abs=2)
    assert run_interface.keeper.unanswered == 20_000 - answered
    assert len(run_interface.keeper._answered) <= MAX_REMEMBERED
    assert len(run_interface.request_handler.asked) == answered


@pytest.mark.parametrize("retained", [False, True])
def test_a_name_longer_than_that_of_any_command_is_not_answered(retained: bool) -> None:
    run_interface = RunInterface()
    assert max(map(len, TAKEN)) <= MAX_NAME
    assert run_interface.takes("x" * (MAX_NAME + 1), retained=retained) is None
    assert run_interface.keeper.unanswered == 1
    run_interface.refuses("x" * MAX_NAME, "unknown command")


@pytest.mark.parametrize("payload", [b"", b"\xff", b"{}", b"x" * (MAX_BYTES + 1), b'{"id": "7"}'])
def test_an_abort_is_accepted_whatever_its_content(payload: bytes) -> None:
    run_interface = RunInterface()
    for _ in range(200):
        run_interface.takes("hold")  # regardless of the number of other commands
    run_interface.request_handler.asked.clear()
    reply = run_interface.takes("abort", payload)
    assert reply is not None
    assert reply.ok
    assert reply.id == ("7" if b"7" in payload else None)
    assert run_interface.request_handler.asked == [
        {"do": "abort", "by": "mqtt:unknown", "station": "mqtt"}
    ]


def test_an_abort_is_taken_again_and_however_old() -> None:
    run_interface = RunInterface()
    for asked in (1, 2):
        run_interface.takes("abort", sent_at_unix_us=5)
        assert len(run_interface.request_handler.asked) == asked
        run_interface.now_s += 0.5
    assert run_interface.request_handler.asked[0]["by"] == "mqtt:anna"
    for _ in range(100):  # many aborts count as one
        reply = run_interface.takes("abort")
        assert reply is not None
        assert reply.ok
    assert len(run_interface.request_handler.asked) == 3


def test_an_abort_that_the_broker_keeps_does_not_stop_every_start() -> None:
    RunInterface().refuses("abort", "retained", b"", retained=True)
    RunInterface().refuses("abort", "retained", retained=True, sent_at_unix_us=5)
    run_interface = RunInterface()
    run_interface.takes("abort", retained=True)
    assert len(run_interface.request_handler.asked) == 1


def test_a_defect_of_a_client_does_not_reach_the_desk_as_another_person() -> None:
    run_interface = RunInterface()
    run_interface.takes("hold", by="x" * 70)
    assert run_interface.request_handler.asked[0]["by"].startswith("mqtt:")
    event_of(run_interface.request_handler.asked[0], 0, RequestScope(["firing-boss"]))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)


@settings(max_examples=100)
@given(
    st.sampled_from([*TAKEN, "approve", "x"]),
    st.binary() | JSON.map(lambda value: json.dumps(value).encode()),
    st.booleans(),
)
def test_no_message_does_harm(name: str, payload: bytes, retained: bool) -> None:
    run_interface = RunInterface()
    reply = run_interface.takes(name, payload, retained)
    msgspec.json.encode(reply)
    assert name == "abort" or not run_interface.request_handler.asked


@settings(max_examples=100)
@given(
    st.sampled_from(TAKEN),
    st.dictionaries(st.sampled_from(["by", "station", "vehicle", "points", "hash", "x"]), JSON),
)
def test_what_the_desk_is_asked_it_can_answer(name: str, more: dict[str, Any]) -> None:
    """A request raises only errors of the class RequestError."""
    from mission_service.errors import RequestError

    run_interface = RunInterface()
    reply = run_interface.takes(name, **more)
    msgspec.json.encode(reply)
    for request in run_interface.request_handler.asked:
        try:
            event = event_of(request, 0, RequestScope(["firing-boss"], vehicles=["hawk"]))
        except RequestError as error:
            str(error).encode()
        else:
            msgspec.json.encode(event)
            assert event.by.startswith("mqtt:")
