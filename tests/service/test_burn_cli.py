"""``mission-service burn`` with a request handler instead of a run."""

import asyncio
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from click.testing import CliRunner, Result

from mission_service.cli.main import main
from mission_service.core.request_events import REQUESTS, RequestScope
from mission_service.events import (
    Aborted,
    AnyOperatorEvent,
    Approved,
    BurnUnitSet,
    ChecklistAnswered,
    Corrected,
    Erased,
    IgnitionReported,
    OperatorHeartbeat,
    PersonReported,
    PlanRequested,
    Redone,
    Rejected,
    Undone,
    WindSet,
)
from mission_service.guidance.burn.interlock import Interlock
from mission_service.interfaces.control.control_client import NAME
from mission_service.interfaces.control.control_server import claimed, serve_control
from mission_service.runtime.request_handler import RequestHandler
from tests.service.burn_history import GOOD, HASH, Sent, burn

AT_US = 100_000_000
SECTION = burn()
STATIONS = ("alpha", "bravo")
OPERATOR_FIELDS = ("--by", "ann", "--station", "alpha")
EVENT = (AT_US, "ann", "alpha")


class Run:
    """A request handler on a socket, in a thread, with its lock and the submitted events."""

    def __init__(self, out: Path, stations: tuple[str, ...]) -> None:
        self.out = out
        self.submitted: list[AnyOperatorEvent] = []
        self.lock = Interlock(SECTION)
        self.stations = stations

    def submit(self, event: AnyOperatorEvent) -> list[str]:
        self.submitted.append(event)
        return [f"{type(event).__name__} accepted"]

    def status(self) -> dict[str, Any]:
        status_fields: dict[str, Any] = {
            "scenario": "square",
            "at_s": 100.0,
            "stations": self.stations,
        }
        status_fields["guidance"] = {"phase": "flying"}
        return {**status_fields, "items": SECTION.go_items, **self.lock.status()}

    def call(self, *arguments: str, text: str | None = None) -> Result:
        return CliRunner().invoke(main, ["burn", *arguments, "--out", str(self.out)], input=text)


@pytest.fixture
def stations() -> tuple[str, ...]:
    return STATIONS


@pytest.fixture
def run(tmp_path: Path, stations: tuple[str, ...]) -> Iterator[Run]:
    made = Run(tmp_path, stations)
    for thing in GOOD:
        if isinstance(thing, Sent):
            made.lock.on_commands(thing.commands)
        else:
            made.lock.apply(thing)
    scope = RequestScope(stations, SECTION.go_items)
    request_handler = RequestHandler(made.submit, lambda: made.status(), lambda: AT_US, scope)
    loop = asyncio.new_event_loop()
    with claimed(tmp_path / NAME) as listening:
        task = loop.create_task(serve_control(listening, request_handler))

        def serve() -> None:
            with pytest.raises(asyncio.CancelledError):
                loop.run_until_complete(task)

        thread = threading.Thread(target=serve)
        thread.start()
        yield made
        loop.call_soon_threadsafe(task.cancel)
        thread.join(10)
    loop.close()


@pytest.mark.parametrize(
    ("arguments", "event"),
    [
        (("plan", "--drop-spacing", "20"), PlanRequested(*EVENT, None, 20.0)),
        (("approve", HASH[:8], "--yes"), Approved(*EVENT, HASH)),
        (("reject", HASH[:12]), Rejected(*EVENT, HASH)),
        (("abort",), Aborted(*EVENT)),
        (("go", "weather"), ChecklistAnswered(*EVENT, "weather", True)),
        (("go", "2"), ChecklistAnswered(*EVENT, "payload", True)),
        (("no-go", "pay"), ChecklistAnswered(*EVENT, "payload", False)),
        (
            ("correct", "burned", "-36.5,-84", "--in", "-60"),
            Corrected(*EVENT, "burned", "point", ((-36.5, -84.0),), 40_000_000),
        ),
        (
            ("correct", "burning", "36.5,-84", "36.5,-83.99"),
            Corrected(*EVENT, "burning", "line", ((36.5, -84.0), (36.5, -83.99)), AT_US),
        ),
        (
            ("light", "36.5,-84", "--ago", "30"),
            IgnitionReported(*EVENT, ((36.5, -84.0),), 70_000_000),
        ),
        (("erase", "36.5,-84", "--radius", "9"), Erased(*EVENT, 36.5, -84.0, 9.0)),
        (("undo",), Undone(*EVENT)),
        (("redo",), Redone(*EVENT)),
        (("wind", "4.5", "270"), WindSet(*EVENT, 4.5, 270.0)),
        (
            ("person", "cy", "36.5,-84", "--radius", "30"),
            PersonReported(*EVENT, "cy", 36.5, -84.0, 30),
        ),
        (("person", "cy", "36.5,-84", "--gone"), PersonReported(*EVENT, "cy", 36.5, -84.0, 0.0)),
        (
            ("unit", "0,0", "0,0.01", "0.01,0"),
            BurnUnitSet(*EVENT, ((0.0, 0.0), (0.0, 0.01), (0.01, 0.0))),
        ),
    ],
)
def test_a_command_becomes_an_event(
    run: Run, arguments: tuple[str, ...], event: AnyOperatorEvent
) -> None:
    result = run.call(*arguments, *OPERATOR_FIELDS)
    assert result.exit_code == 0, result.output
    name = {"light": "lit"}.get(arguments[0], arguments[0])
    may_approve = REQUESTS[name].role == "approve"  # the socket does not check names
    assert run.submitted == [msgspec.structs.replace(event, may_approve=may_approve)]
    assert f"{type(event).__name__} accepted" in result.output
    as_json = run.call(*arguments, *OPERATOR_FIELDS, "--json")
    assert json.loads(as_json.stdout)["event"] == type(event).__name__


def test_go_all_answers_item_by_item(run: Run) -> None:
    assert run.call("go", "all", *OPERATOR_FIELDS).exit_code == 0
    assert run.submitted == [
        ChecklistAnswered(*EVENT, item, True, may_approve=True) for item in SECTION.go_items
    ]


def test_approving_shows_the_plan_and_asks(run: Run) -> None:
    no = run.call("approve", HASH[:8], *OPERATOR_FIELDS, text="n\n")
    assert (no.exit_code, run.submitted) == (1, [])
    for words in (
        f"plan      {HASH}",
        "line      1, ignis: 3 drops",
        "15 m (49 ft) above the ground, 5 m/s (11 mph)",
        "315 to 315 m (1033 to 1033 ft) MSL; safe height 60 m (197 ft)",
        "wind      3.0 m/s (7 mph) from 270°",
        "fire at least 90 s away (required 60 s and 10 m, 33 ft)",
        "spheres   100 left after the line",
        "Approve this plan as ann at alpha?",
    ):
        assert words in no.output
    yes = run.call("approve", HASH[:8], *OPERATOR_FIELDS, text="y\n")
    assert (yes.exit_code, run.submitted) == (0, [Approved(*EVENT, HASH, may_approve=True)])


def test_an_open_list_comes_before_an_approval(run: Run) -> None:
    run.lock.apply(ChecklistAnswered(AT_US, "bob", "bravo", "weather", False))
    result = run.call("approve", HASH[:8], *OPERATOR_FIELDS, "--yes")
    assert (result.exit_code, run.submitted) == (1, [])
    assert "the GO/NO-GO checklist must be complete first; open: weather" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("approve", HASH[:7], "--yes"), "specify at least the first 8 digits"),
        (("approve", "ffffffff", "--yes"), f"with these first digits; proposed: {HASH[:12]}"),
        (("go", "nothing"), "does not select one item of the list: 1 weather; 2 payload"),
        (("wind", "nan", "0"), "wind: speed_m_s = nan: must be a finite number"),
        (("correct", "burned", "nan,-84"), "correct: points = ((nan, -84.0),): must be a finite"),
        (("plan", "--drop-spacing", "inf"), "plan: drop_spacing_m = inf: must be a finite number"),
        (("erase", "91,0", "--radius", "5"), "erase: lat_deg: must be a number from -90 to 90"),
        (("unit", "0,0", "0.01,0.01", "0,0.02", "0.02,0"), "the sides cross"),
    ],
)
def test_what_is_wrong_gets_one_line_and_exit_code_1(
    run: Run, arguments: tuple[str, ...], words: str
) -> None:
    result = run.call(*arguments, *OPERATOR_FIELDS)
    assert result.exit_code == 1
    assert words in result.stderr
    assert result.stderr.count("\n") == 1
    assert run.submitted == []


def test_a_forged_plan_is_not_approved(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = run.status()
    honest["plans"][0]["plan"]["valid_until_us"] += 1
    monkeypatch.setattr(run, "status", lambda: honest)
    result = run.call("approve", HASH[:8], *OPERATOR_FIELDS, "--yes")
    assert (result.exit_code, run.submitted) == (1, [])
    assert "the plan does not match its hash" in result.stderr


def test_the_station_must_be_given_if_there_are_several(run: Run) -> None:
    result = run.call("undo", "--by", "ann")
    assert result.exit_code == 1
    assert "specify your station with --station: alpha, bravo" in result.stderr
    assert run.call("abort", "--by", "ann").exit_code == 0
    assert run.submitted == [Aborted(AT_US, "ann", "unknown")]


@pytest.mark.parametrize("stations", [("alpha",)])
def test_the_only_station_need_not_be_given(run: Run) -> None:
    assert run.call("undo", "--by", "ann").exit_code == 0
    assert run.submitted == [Undone(*EVENT)]


def test_the_state_in_words_and_as_json(run: Run) -> None:
    output = run.call("status").output
    for words in (
        "square  mission time 0:01:40, flying",
        "GO list   all 2 GO",
        "ignis     link, armed in mode mission, 15 m (49 ft) above home, fix, battery 90 %, 450 s",
        f"plan      {HASH[:12]}  line 1, 3 drops; approved by ann at alpha",
    ):
        assert words in output
    run.lock.apply(Aborted(AT_US, "bob", "bravo"))
    later = run.call("status").output
    assert "GO list   2 open" in later
    assert "not approved: the burn was aborted by bob" in later
    assert json.loads(run.call("status", "--json").stdout)["at_s"] == 100.0


def test_watching_reports_that_an_operator_is_present(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def soon(wait_s: float) -> None:
        if len(run.submitted) == 3:
            raise KeyboardInterrupt

    time = SimpleNamespace(sleep=soon)  # not ``time.sleep`` itself, which other threads call
    monkeypatch.setattr("mission_service.cli.burn_commands.time", time)
    result = run.call("watch", *OPERATOR_FIELDS)
    assert result.exit_code == 0
    assert run.submitted == [OperatorHeartbeat(*EVENT, may_approve=True)] * 3
    assert "ann at alpha is present" in result.output


def test_without_a_run_there_is_one_clear_line(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["burn", "abort", "--out", str(tmp_path)])
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert "start mission-service run with this --out" in result.stderr
