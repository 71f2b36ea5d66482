"""Operators' requests: the resulting events, refusals, and the control socket."""

import asyncio
import json
import os
import random
import socket
import stat
import struct
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_service.core.request_events import REQUESTS, RequestScope, event_of
from mission_service.errors import ControlError, MissionServiceError, RequestError
from mission_service.events import (
    Aborted,
    AirspaceClosed,
    AirspaceOpened,
    AlarmAcknowledged,
    AnyEvent,
    AnyOperatorEvent,
    Approved,
    BurnUnitSet,
    ChecklistAnswered,
    ClearingCancelled,
    ClearingOrdered,
    Corrected,
    Erased,
    FireObserved,
    IgnitionReported,
    MissionAccepted,
    MissionRefused,
    MissionRequested,
    NoteAdded,
    OperatorHeartbeat,
    OrderGiven,
    PersonReported,
    PlanRequested,
    RasterObserved,
    Redone,
    Rejected,
    SettingsChanged,
    Undone,
    WindSet,
)
from mission_service.interfaces.control import control_server as control
from mission_service.interfaces.control.control_client import NAME, ControlClient
from mission_service.interfaces.control.control_server import claimed, serve_control
from mission_service.interfaces.cot.received_events import MAX_TEXT
from mission_service.runtime.request_handler import RequestHandler
from tests.patience import PATIENCE_S, until

STATIONS, ITEMS = ("alpha", "bravo"), ("weather", "payload")
SCOPE = RequestScope(STATIONS, ITEMS)
OPERATOR_FIELDS = {"by": "ann", "station": "alpha"}
AT_US = 100_000_000
EVENT = (AT_US, "ann", "alpha")
HASH = "0123456789abcdef" * 4
CORNERS = [[36.0, -84.0], [36.0, -83.99], [36.01, -83.99]]
PLACES = ((36.0, -84.0), (36.0, -83.99), (36.01, -83.99))

# One valid request of each kind, and its event.
SQUARE = ((36.0, -84.0), (36.1, -84.0), (36.1, -84.1))
GOOD: list[tuple[dict[str, Any], AnyOperatorEvent]] = [
    ({"do": "plan"}, PlanRequested(*EVENT)),
    ({"do": "plan", "line_spacing_m": 30, "drop_spacing_m": 6.5}, PlanRequested(*EVENT, 30.0, 6.5)),
    ({"do": "approve", "hash": HASH}, Approved(*EVENT, HASH)),
    ({"do": "reject", "hash": HASH}, Rejected(*EVENT, HASH)),
    ({"do": "abort"}, Aborted(*EVENT)),
    (
        {"do": "close", "name": "TFR", "corners": SQUARE, "ceiling_amsl_m": 900, "for_s": 60},
        AirspaceClosed(*EVENT, "TFR", SQUARE, ceiling_amsl_m=900.0, for_s=60.0),
    ),
    ({"do": "open", "name": "TFR"}, AirspaceOpened(*EVENT, "TFR")),
    ({"do": "clear"}, ClearingOrdered(*EVENT)),
    (
        {"do": "clear", "volume": "TFR", "corners": SQUARE, "floor_amsl_m": 300},
        ClearingOrdered(*EVENT, "TFR", SQUARE, 300.0),
    ),
    ({"do": "cancel-clearing"}, ClearingCancelled(*EVENT)),
    ({"do": "go", "item": "weather"}, ChecklistAnswered(*EVENT, "weather", True)),
    ({"do": "no-go", "item": "payload"}, ChecklistAnswered(*EVENT, "payload", False)),
    (
        {"do": "correct", "state": "burned", "shape": "point", "points": [[36, -84]], "in_s": -9},
        Corrected(*EVENT, "burned", "point", ((36.0, -84.0),), 91_000_000),
    ),
    (
        {
            "do": "raster",
            "south_deg": 36,
            "west_deg": -84,
            "north_deg": 36.01,
            "east_deg": -83.99,
            "rows": ["bu", "u."],
            "age_s": 9,
        },
        RasterObserved(
            *(*EVENT, 36.0, -84.0, 36.01, -83.99, ("bu", "u."), 91_000_000, 10.0, 0.0, ""),
        ),
    ),
    (
        {
            "do": "observe",
            "state": "burned",
            "shape": "points",
            "points": [[36, -84]],
            "age_s": 9,
            "position_sd_m": 375,
            "false_alarms_pct": 10,
            "source": "satellite",
        },
        FireObserved(
            *(*EVENT, "burned", "points", ((36.0, -84.0),), 91_000_000, 375.0, 0.1),
            "satellite",
        ),
    ),
    (
        {"do": "correct", "state": "unburned", "shape": "polygon", "points": CORNERS},
        Corrected(*EVENT, "unburned", "polygon", PLACES, AT_US),
    ),
    (
        {"do": "lit", "points": [[36, -84], [36, -83.99]], "ago_s": 2.5},
        IgnitionReported(*EVENT, PLACES[:2], 97_500_000),
    ),
    (
        {"do": "erase", "lat_deg": 36, "lon_deg": -84, "radius_m": 5},
        Erased(*EVENT, 36.0, -84.0, 5.0),
    ),
    (
        {"do": "takeoff", "vehicle": "hawk", "override": " calibrating "},
        OrderGiven(*EVENT, "hawk", "takeoff", override="calibrating"),
    ),
    (
        {"do": "note", "text": " gate locked ", "lat_deg": 36, "lon_deg": -84},
        NoteAdded(*EVENT, "gate locked", 36.0, -84.0),
    ),
    (
        {"do": "note", "text": "gate", "lat_deg": 36, "lon_deg": -84, "photo": f"{'0a' * 32}.jpg"},
        NoteAdded(*EVENT, "gate", 36.0, -84.0, f"{'0a' * 32}.jpg"),
    ),
    ({"do": "acknowledge", "alarm": "link/hawk"}, AlarmAcknowledged(*EVENT, "link/hawk")),
    ({"do": "undo"}, Undone(*EVENT)),
    ({"do": "redo"}, Redone(*EVENT)),
    ({"do": "wind", "speed_m_s": 4, "from_deg": 270}, WindSet(*EVENT, 4.0, 270.0)),
    (
        {"do": "person", "name": "cy", "lat_deg": 36, "lon_deg": -84, "radius_m": 0},
        PersonReported(*EVENT, "cy", 36.0, -84.0, 0.0),
    ),
    ({"do": "unit", "points": CORNERS}, BurnUnitSet(*EVENT, PLACES)),
    ({"do": "present"}, OperatorHeartbeat(*EVENT)),
    ({"do": "hold", "vehicle": "hawk"}, OrderGiven(*EVENT, "hawk", "hold")),
    ({"do": "resume"}, OrderGiven(*EVENT, "", "resume")),
    ({"do": "return"}, OrderGiven(*EVENT, "", "return")),
    ({"do": "start"}, OrderGiven(*EVENT, "", "start")),
    ({"do": "land", "vehicle": "hawk"}, OrderGiven(*EVENT, "hawk", "land")),
    ({"do": "go-around"}, OrderGiven(*EVENT, "", "go-around")),
    ({"do": "renew", "vehicle": "hawk"}, MissionRequested(*EVENT, "hawk")),
    ({"do": "accept", "vehicle": "hawk", "hash": HASH}, MissionAccepted(*EVENT, "hawk", HASH)),
    ({"do": "refuse", "vehicle": "hawk", "hash": HASH}, MissionRefused(*EVENT, "hawk", HASH)),
    ({"do": "settings", "alpha": 2}, SettingsChanged(*EVENT, 2.0)),
]


@pytest.mark.parametrize(("request_", "event"), GOOD)
def test_a_request_becomes_its_event(request_: dict[str, Any], event: AnyOperatorEvent) -> None:
    for may_approve in (None, False, True):
        made = event_of({**request_, **OPERATOR_FIELDS}, AT_US, SCOPE, may_approve)
        needs_approver = REQUESTS[request_["do"]].role == "approve"
        approver = needs_approver if may_approve is None else may_approve
        if request_["do"] != "abort":  # accepted from any user
            assert made == msgspec.structs.replace(event, may_approve=approver)
        else:
            assert made == event
        assert msgspec.json.decode(msgspec.json.encode(made), type=AnyEvent) == made


def test_there_is_a_good_example_of_each_request() -> None:
    assert {request["do"] for request, _ in GOOD} == set(REQUESTS)


NAN = float("nan")


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"do": "fire"}, "unknown request 'fire'"),
        ({"do": 7}, "unknown request (no name)"),
        ({}, "unknown request (no name)"),
        ({"do": "settings"}, "settings: specify alpha"),
        ({"do": "hold", "vehicle": "../x"}, "hold: "),
        ({"do": "hold", "vehicle": "hawk\n"}, "hold: "),
        ({"do": "approve", "hash": HASH + "\n"}, "approve: "),
        ({"do": "status"}, "status is a query"),
        ({"do": "approve", "hash": HASH[:12]}, "approve: "),
        ({"do": "approve", "hash": HASH.upper()}, "approve: "),
        ({"do": "approve"}, "approve: hash: is missing; specify all 64 digits"),
        ({"do": "present", "extra": 1}, "extra: unknown key; the keys are by, station"),
        ({"do": "present", "station": "nowhere"}, "unknown station 'nowhere'; the stations are al"),
        ({"do": "present", "by": ""}, "present: "),
        ({"do": "present", "by": " "}, "present: "),
        ({"do": "present", "by": "x" * 81}, "present: "),
        ({"do": "present", "by": "a\nb"}, "present: "),
        ({"do": "present", "by": "\x1b[2J"}, "present: "),
        ({"do": "present", "by": "service"}, "is reserved for the service; enter your name"),
        ({"do": "resume", "by": " Service"}, "is reserved for the service; enter your name"),
        (
            {"do": "present", "by": 3},
            "present: by: must be a non-blank line of printable characters",
        ),
        (
            {"do": "go", "item": "all"},
            "no item 'all' on the GO/NO-GO checklist; the items are: weather; payload",
        ),
        (
            {"do": "go", "item": True},
            "go: item: must be a string of 1 to 200 characters (got True)",
        ),
        (
            {"do": "wind", "speed_m_s": NAN, "from_deg": 0},
            "wind: speed_m_s: must be a number from 0",
        ),
        (
            {"do": "wind", "speed_m_s": 1, "from_deg": NAN},
            "wind: from_deg: must be a number from 0 to 360",
        ),
        ({"do": "wind", "speed_m_s": float("inf"), "from_deg": 0}, "wind: "),
        ({"do": "wind", "speed_m_s": -1, "from_deg": 0}, "wind: "),
        (
            {"do": "wind", "speed_m_s": "4", "from_deg": 0},
            "wind: speed_m_s: must be a number from 0",
        ),
        ({"do": "wind", "speed_m_s": 10**400, "from_deg": 0}, "wind: "),
        ({"do": "erase", "lat_deg": 91, "lon_deg": 0, "radius_m": 5}, "erase: "),
        ({"do": "erase", "lat_deg": 0, "lon_deg": 181, "radius_m": 5}, "erase: "),
        ({"do": "erase", "lat_deg": 0, "lon_deg": NAN, "radius_m": 5}, "erase: lon_deg: must be "),
        ({"do": "erase", "lat_deg": 0, "lon_deg": 0, "radius_m": 0}, "must be greater than 0"),
        ({"do": "lit", "points": []}, "lit: "),
        ({"do": "lit", "points": [[0, NAN]]}, "lit: points.0.1: must be a number from -180 to 180"),
        ({"do": "lit", "points": [[0, 0]] * 1001}, "lit: "),
        ({"do": "lit", "points": [[0, 0]], "ago_s": -1}, "lit: "),
        ({"do": "unit", "points": CORNERS[:2]}, "unit: 2 corners, but a polygon requires 3"),
        ({"do": "unit", "points": [[0, 0], [0.01, 0.01], [0, 0.02], [0.02, 0]]}, "the sides cross"),
        (
            {"do": "unit", "points": [[0, 0], [0.01, 0.01], [0.02, 0.02]]},
            "unit: these corners do not form a polygon",
        ),
        (
            {"do": "correct", "state": "burned", "shape": "line", "points": [[0, 0]]},
            "correct: 1 points, but a line requires 2",
        ),
        (
            {"do": "correct", "state": "burned", "shape": "point", "points": CORNERS},
            "correct: 3 points, but a point requires 1",
        ),
        (
            {"do": "correct", "state": "charred", "shape": "point", "points": [[0, 0]]},
            "correct: state: must be one of burned, burning, unburned (got 'charred')",
        ),
    ],
)
def test_what_is_not_right_is_refused_in_one_line(request_: dict[str, Any], words: str) -> None:
    with pytest.raises(RequestError) as caught:
        event_of({**OPERATOR_FIELDS, **request_}, AT_US, SCOPE)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_places_off_the_map_and_impossible_lines_are_not_submitted() -> None:
    far = [[36, -84], [60, -84]]
    for request in (
        {"do": "lit", "points": [[60, -84]]},
        {"do": "person", "name": "cy", "lat_deg": 60, "lon_deg": -84, "radius_m": 5},
        {"do": "erase", "lat_deg": 60, "lon_deg": -84, "radius_m": 5},
        {"do": "correct", "state": "burned", "shape": "point", "points": [[60, -84]]},
    ):
        with pytest.raises(RequestError, match="60, -84 is outside the landscape"):
            event_of({**request, **OPERATOR_FIELDS}, AT_US, RequestScope(STATIONS, ITEMS, on_map))
        event_of({**request, **OPERATOR_FIELDS}, AT_US, SCOPE)
    for request in (
        {"do": "lit", "points": far},
        {"do": "unit", "points": [*far, [60, -83]]},
        {"do": "correct", "state": "burned", "shape": "line", "points": far},
    ):
        with pytest.raises(RequestError, match="km exceeds the limit"):
            event_of({**request, **OPERATOR_FIELDS}, AT_US, SCOPE)


def test_only_an_alarm_of_the_run_is_acknowledged() -> None:
    scope = RequestScope(STATIONS, ITEMS, alarms=lambda: {"link/hawk"})
    request = {"do": "acknowledge", "alarm": "link/hawk", **OPERATOR_FIELDS}
    assert event_of(request, AT_US, scope) == AlarmAcknowledged(*EVENT, "link/hawk")
    with pytest.raises(RequestError, match="no alarm 'link'; the alarms: link/hawk"):
        event_of({**request, "alarm": "link"}, AT_US, scope)


def test_the_alarm_of_a_person_with_the_longest_identifier_can_be_acknowledged() -> None:
    key = f"fire_arrival/person/{'x' * MAX_TEXT}"
    request = {"do": "acknowledge", "alarm": key, **OPERATOR_FIELDS}
    assert event_of(request, AT_US, SCOPE) == AlarmAcknowledged(*EVENT, key)


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"by": "a\nb"},
        {"by": 3, "station": None},
        {"by": "", "extra": [1]},
        {"station": "nowhere"},
    ],
)
def test_an_abort_is_accepted_from_any_user(more: dict[str, Any]) -> None:
    assert isinstance(event_of({"do": "abort", **more}, AT_US, SCOPE), Aborted)


def test_an_abort_in_the_name_of_the_service_has_an_unknown_operator() -> None:
    made = event_of({"do": "abort", "by": "service", "station": "x"}, AT_US, RequestScope(STATIONS))
    assert made == Aborted(AT_US, "unknown", "x")


def scrambled(chance: random.Random) -> Any:
    """Return a valid request with a part exchanged, added or removed."""
    request = {**chance.choice(GOOD)[0], **OPERATOR_FIELDS}
    odd: list[Any] = [
        None,
        True,
        NAN,
        -1,
        1e300,
        "",
        "x" * 300,
        [],
        [[]],
        {},
        [[NAN, 0]],
        [[[0, 0]]],
        HASH,
    ]
    for _ in range(chance.randrange(3)):
        key = chance.choice([*request, "extra", "points", "hash"])
        if chance.random() < 0.3:
            request.pop(key, None)
        else:
            request[key] = chance.choice(odd)
    return request


@settings(max_examples=100)
@given(st.integers(0, 2**32))
def test_any_request_is_an_event_that_can_be_journalled_or_is_refused(seed: int) -> None:
    chance = random.Random(seed)
    for _ in range(10):
        request = scrambled(chance)
        try:
            event = event_of(request, AT_US, SCOPE)
        except RequestError:
            continue
        assert msgspec.json.decode(msgspec.json.encode(event), type=AnyEvent) == event
        assert isinstance(event, Aborted) or event.station in STATIONS


# The socket -----------------------------------------------------------------------------------


def on_map(lat_deg: float, lon_deg: float) -> bool:
    return 30.0 < lat_deg < 40.0


class Daemon:
    """A replacement of a daemon that accepts events."""

    def __init__(self) -> None:
        self.events: list[AnyOperatorEvent] = []
        scope = RequestScope(STATIONS, ITEMS, on_map)
        self.request_handler = RequestHandler(
            self.submit, lambda: {"phase": "planning"}, lambda: AT_US, scope
        )

    def submit(self, event: AnyOperatorEvent) -> list[str]:
        self.events.append(event)
        if isinstance(event, BurnUnitSet):
            raise MissionServiceError("the unit is on the moon")
        if isinstance(event, Redone):
            raise AssertionError("a defect")
        return [f"{type(event).__name__} by {event.by}"]


def served(out: Path, client: Callable[[Daemon], Awaitable[None]]) -> Daemon:
    """Serve while a client's coroutine runs."""
    daemon = Daemon()

    async def both() -> None:
        with claimed(out / NAME) as listening:
            serving = asyncio.create_task(serve_control(listening, daemon.request_handler))
            doing = asyncio.ensure_future(client(daemon))
            done, _ = await asyncio.wait(
                {serving, doing}, timeout=2 * PATIENCE_S, return_when=asyncio.FIRST_COMPLETED
            )
            for task in (serving, doing):
                if task not in done:
                    task.cancel()
                    await asyncio.wait({task})
            for task in done:
                task.result()

    asyncio.run(both())
    return daemon


async def lines(out: Path, sent: bytes) -> list[dict[str, Any]]:
    """Return all replies to some bytes, until the server closes."""
    reader, writer = await asyncio.open_unix_connection(out / NAME)
    try:
        writer.write(sent)
        writer.write_eof()
        answers = await reader.read()
    finally:
        writer.close()
        await writer.wait_closed()
    return [json.loads(line) for line in answers.splitlines()]


def test_requests_are_answered_line_by_line(tmp_path: Path) -> None:
    async def client(daemon: Daemon) -> None:
        request = json.dumps({"do": "present", **OPERATOR_FIELDS}).encode() + b"\n"
        answers = await lines(tmp_path, request + b'{"do":"status"}\n' + request)
        assert answers[0] == {
            "ok": True,
            "at_s": 100.0,
            "event": "OperatorHeartbeat",
            "messages": ["OperatorHeartbeat by ann"],
        }
        assert answers[1] == {"ok": True, "status": {"phase": "planning"}}
        assert len(answers) == 3

    assert served(tmp_path, client).events == [OperatorHeartbeat(*EVENT, may_approve=True)] * 2


def test_any_request_is_answered_and_harms_no_other_client(tmp_path: Path) -> None:
    unit = json.dumps({"do": "unit", "points": CORNERS, **OPERATOR_FIELDS}).encode()
    wrong = [
        (b"\n", "not a line of JSON"),
        (b"hello\n", "not a line of JSON"),
        (b'{"do":"wind","speed_m_s":NaN}\n', "not a line of JSON"),
        (b"\xff\xfe\n", "not a line of JSON"),
        (b"[" * 30_000 + b"\n", "not a line of JSON"),
        (b"[" * 900 + b"]" * 900 + b"\n", "a request must be a JSON object"),
        (b"7\n", "a request must be a JSON object"),
        (b'{"do":"present","by":' + b"[" * 900 + b"]" * 900 + b"}\n", "present: "),
        (unit, "the unit is on the moon"),
        (b"x" * 100_000 + b"\n", "the line has more than 65536 bytes"),
    ]

    async def client(daemon: Daemon) -> None:
        for sent, words in wrong:
            (answer,) = await lines(tmp_path, sent)
            assert answer["ok"] is False
            assert words in answer["error"]
            assert "\n" not in answer["error"]
        half = await asyncio.open_unix_connection(tmp_path / NAME)
        half[1].write(b'{"do":"st')
        closed = await asyncio.open_unix_connection(tmp_path / NAME)
        closed[1].write(b'{"do":"status"}\n' * 1000)
        closed[1].transport.abort()
        (answer,) = await lines(tmp_path, b'{"do":"status"}\n')
        assert answer["ok"]
        half[1].close()
        await half[1].wait_closed()

    served(tmp_path, client)


def test_an_abort_finds_a_place_when_all_are_taken(tmp_path: Path) -> None:
    async def client(daemon: Daemon) -> None:
        others = [
            await asyncio.open_unix_connection(tmp_path / NAME) for _ in range(control.MAX_CLIENTS)
        ]
        (answer,) = await lines(tmp_path, b'{"do":"status"}\n')
        assert answer["error"].startswith("16 clients are connected")
        (answer,) = await lines(tmp_path, b'{"do":"abort"}')
        assert answer["ok"]
        for _, writer in others:
            writer.close()
        async with asyncio.timeout(PATIENCE_S):
            while not (answer := (await lines(tmp_path, b'{"do":"status"}\n'))[0])["ok"]:
                assert answer["error"].startswith("16 clients are connected")

    assert served(tmp_path, client).events == [Aborted(AT_US, "unknown", "unknown")]


TIMES = 30


def leave(there: socket.socket, with_reset: bool) -> None:
    """Close the connection; with unread replies the other side receives a reset."""
    if with_reset:
        there.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    there.close()


@pytest.mark.parametrize("with_reset", [False, True])
@pytest.mark.parametrize(
    ("sent", "each"),
    [
        (b'{"do":"abort"}\n', 1),
        (b'{"do":"abort"}', 1),  # half of a line
        (b'{"do":"status"}\n' * 20 + b'{"do":"abort"}\n', 1),  # 20 unread replies
        (b'{"do":"undo","by":"ann","station":"alpha"}\n' * 3, 3),
    ],
)
def test_a_complete_request_is_done_though_the_client_has_disconnected(
    tmp_path: Path, sent: bytes, each: int, with_reset: bool
) -> None:
    async def client(daemon: Daemon) -> None:
        for number in range(TIMES):
            with socket.socket(socket.AF_UNIX) as there:
                there.connect(str(tmp_path / NAME))
                # The server accepts the connection before the request is sent.
                for _ in range(number % 4):
                    await asyncio.sleep(0)
                there.sendall(sent)
                for _ in range(number % 3):
                    await asyncio.sleep(0)
                leave(there, with_reset)
        await until(lambda: len(daemon.events) >= each * TIMES)

    assert len(served(tmp_path, client).events) == each * TIMES


def test_an_abort_needs_no_end_of_its_line(tmp_path: Path) -> None:
    async def client(daemon: Daemon) -> None:
        reader, writer = await asyncio.open_unix_connection(tmp_path / NAME)
        writer.write(b'{"do":"abort"}')
        assert json.loads(await reader.readline())["event"] == "Aborted"
        writer.write(b'\n{"do":"status"}\n')
        assert json.loads(await reader.readline())["status"] == {"phase": "planning"}
        writer.close()
        await writer.wait_closed()

    assert served(tmp_path, client).events == [Aborted(AT_US, "unknown", "unknown")]


@pytest.mark.parametrize("error", [msgspec.DecodeError, UnicodeDecodeError])
def test_bytes_that_are_not_utf_8_neither_end_the_run_nor_prevent_an_abort(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[ValueError]
) -> None:
    """Until version 0.22, msgspec raises UnicodeDecodeError instead of DecodeError."""
    decode = msgspec.json.decode

    def decoded(line: bytes) -> Any:
        try:
            line.decode()
        except UnicodeDecodeError as wrong:
            raise wrong if error is UnicodeDecodeError else error(str(wrong)) from None
        return decode(line)

    monkeypatch.setattr(msgspec.json, "decode", decoded)

    async def client(daemon: Daemon) -> None:
        (answer,) = await lines(tmp_path, b'{"do":"undo","by":"J\xfcrgen"}\n')
        assert "not a line of JSON" in answer["error"]
        (answer,) = await lines(tmp_path, b'{"do":"abort","by":"J\xfcrgen"}\n')
        assert answer["ok"]

    assert served(tmp_path, client).events == [Aborted(AT_US, "J\ufffdrgen", "unknown")]


def test_an_abort_is_done_before_the_lines_that_wait(tmp_path: Path) -> None:
    undo = b'{"do":"undo","by":"ann","station":"alpha"}\n'

    async def client(daemon: Daemon) -> None:
        answers = await lines(tmp_path, undo * 5 + b'{"do":"abort"}\n' + undo)
        assert [each["event"] for each in answers] == ["Undone"] * 5 + ["Aborted", "Undone"]

    kinds = [type(event) for event in served(tmp_path, client).events]
    assert kinds == [Aborted] + [Undone] * 6


def test_an_abort_finds_a_place_among_any_number_of_clients(tmp_path: Path) -> None:
    async def client(daemon: Daemon) -> None:
        others = []
        for _ in range(3 * control.MAX_WAITING):
            there = socket.socket(socket.AF_UNIX)
            there.connect(str(tmp_path / NAME))
            there.send(b'{"do":')
            others.append(there)
            await asyncio.sleep(0)
        (answer,) = await lines(tmp_path, b'{"do":"abort"}')
        assert answer["ok"]
        for there in others:
            there.close()

    assert served(tmp_path, client).events == [Aborted(AT_US, "unknown", "unknown")]


def test_a_client_that_sends_nothing_is_disconnected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control, "IDLE_S", 0.05)

    async def client(daemon: Daemon) -> None:
        reader, writer = await asyncio.open_unix_connection(tmp_path / NAME)
        assert await asyncio.wait_for(reader.read(), PATIENCE_S) == b""
        writer.close()
        await writer.wait_closed()

    served(tmp_path, client)


def test_a_defect_is_not_hidden(tmp_path: Path) -> None:
    async def client(daemon: Daemon) -> None:
        await lines(tmp_path, json.dumps({"do": "redo", **OPERATOR_FIELDS}).encode())
        await asyncio.sleep(PATIENCE_S)

    with pytest.raises(AssertionError, match="a defect"):
        served(tmp_path, client)


def test_the_client_reports_what_is_wrong(tmp_path: Path) -> None:
    async def client(daemon: Daemon) -> None:
        def ask_wrongly() -> None:
            with ControlClient(tmp_path) as there:
                assert there.ask(do="undo", **OPERATOR_FIELDS)["messages"] == ["Undone by ann"]
                with pytest.raises(RequestError, match="unknown station"):
                    there.ask(do="undo", by="ann", station="x")
                assert there.ask(do="status")["status"] == {"phase": "planning"}

        await asyncio.to_thread(ask_wrongly)

    with pytest.raises(ControlError, match="no run uses this folder"):
        ControlClient(tmp_path)
    served(tmp_path, client)


def test_the_socket_is_its_owners_and_goes_with_the_run(tmp_path: Path) -> None:
    path = tmp_path / NAME
    with claimed(path):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        with pytest.raises(ControlError, match="another run uses this socket"), claimed(path):
            pass
        assert path.exists()
    assert not path.exists()


def test_what_a_killed_run_has_left_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / NAME
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(path))
    with pytest.raises(ControlError, match="was killed; start it again"):
        ControlClient(tmp_path)
    with claimed(path):
        assert path.exists()


def test_what_is_no_socket_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / NAME
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(ControlError, match="is not a socket"), claimed(path):
        pass
    assert path.read_text(encoding="utf-8") == "mine"


def test_a_path_that_is_too_long_is_reported(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 100)
    deep.mkdir()
    path = deep / NAME
    words = f"has {len(os.fsencode(path))} bytes; the limit is 107"
    with pytest.raises(ControlError, match=words), claimed(path):
        pass
