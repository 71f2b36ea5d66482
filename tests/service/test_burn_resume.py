"""A burn resumes after a kill from a journal truncated anywhere, or reports a clear error."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.commands import Announce, AnyCommand, Command, ProposePlan
from mission_service.config.scenario import Scenario
from mission_service.errors import JournalError
from mission_service.events import (
    AnyEvent,
    Approved,
    OperatorHeartbeat,
    Resumed,
    Telemetry,
)
from mission_service.guidance.burn.interlock import Interlock
from mission_service.journal.journal_file import Journal, SegmentReader, header_of
from mission_service.journal.recovery import InterruptedRun, rename_old, resumed
from mission_service.journal.recovery import unfinished as unfinished_by
from mission_service.journal.snapshot import Known
from tests.service.burn_history import (
    AT_US,
    CORNERS,
    GOOD,
    HASH,
    LAT,
    LON,
    NAME,
    PLAN,
    Sent,
    burn,
    drop,
    fix,
)

DIGEST = "0" * 64
Handle = Callable[[AnyEvent], list[AnyCommand]]


def scenario(**changes: object) -> Scenario:
    table = {
        "name": "burned",
        "duration_s": 3600.0,
        "weather": [{"at_s": 0.0, "wind_speed_m_s": 3.0, "wind_from_deg": 270.0}],
        "burn": {
            "unit": CORNERS,
            "stations": [{"name": "alpha", "lat_deg": LAT, "lon_deg": LON}],
        },
        "planner": {"rule": "burn"},
        "vehicles": [
            {
                "name": NAME,
                "stack": "ardupilot",
                "kind": "copter",
                "home_lat_deg": LAT,
                "home_lon_deg": LON,
            },
        ],
        **changes,
    }
    return Scenario.model_validate(table)


SCENARIO = scenario()
LAND = Landscape(
    "EPSG:32616", 0.0, 0.0, 1.0, np.ones((1, 1), np.int16), np.zeros((1, 1), np.float32)
)


def unfinished(path: Path, begun: Scenario, digest: str) -> InterruptedRun | None:
    shared = Known(begun, LAND)
    shared.landscape = digest
    return unfinished_by(path, shared, begun)


def a_core() -> Handle:
    """A core that proposes when the list is complete, then drops once at each position."""
    seen: list[AnyEvent] = []

    def handle(event: AnyEvent) -> list[AnyCommand]:
        seen.append(event)
        announced = Announce(NAME, f"{len(seen)}: {type(event).__name__} at {event.at_us}")
        if len(seen) == 5:
            return [announced, ProposePlan(NAME, PLAN, HASH), announced]
        if isinstance(event, Telemetry):
            number = sum(isinstance(each, Telemetry) for each in seen) - 1
            return [announced, drop(number)] if number < 3 else []
        return [announced] if isinstance(event, Approved | Resumed) else []

    return handle


EVENTS: tuple[AnyEvent, ...] = (
    *(thing for thing in GOOD if not isinstance(thing, Sent)),
    fix(AT_US),
    OperatorHeartbeat(AT_US, "ann", "alpha"),
    fix(AT_US + 500_000, 5.0),
    fix(AT_US + 600_000, 6.0),
)


def turn(journal: Journal, handle: Handle, event: AnyEvent) -> list[AnyCommand]:
    journal.write_event(event)
    commands = handle(event)
    journal.write_commands(commands)
    return commands


def written(path: Path, live: bool = True, end: bool = False) -> bytes:
    journal = Journal(path, header_of(SCENARIO, DIGEST, "now"), durable=live)
    handle = a_core()
    for event in EVENTS:
        turn(journal, handle, event)
    if end:
        journal.end()
    journal.close()
    return path.read_bytes()


def verified(path: Path) -> list[AnyEvent]:
    """Return all events of a journal; its commands must equal those of a new core, bit for bit."""
    handle = a_core()
    expected: list[AnyCommand] = []
    events: list[AnyEvent] = []
    reader = SegmentReader(path)
    for entry in reader:
        assert entry.intact
        if isinstance(entry.content, Command):
            assert entry.content == expected.pop(0)
        else:
            assert not expected
            events.append(entry.content)
            expected += handle(entry.content)
    assert not expected
    assert reader.cut_at_line is None
    return events


def went_on(path: Path, down_s: float = 7.0) -> tuple[list[AnyEvent], Interlock]:
    """Resume as the daemon does; return the events before, and the interlock afterwards."""
    cut_off = unfinished(path, SCENARIO, DIGEST)
    assert cut_off is not None
    lock, handle, before = Interlock(burn()), a_core(), []
    journal = Journal(path, {}, durable=True, rest=cut_off.rest())
    for event, commands in cut_off.turns(handle):
        before.append(event)
        lock.apply(event)
        lock.on_commands(commands)
    journal.write_commands(list(cut_off.missing))
    announcements = resumed(cut_off.last_us, down_s)
    lock.apply(announcements)
    lock.on_commands(turn(journal, handle, announcements))
    journal.close()
    return before, lock


def test_a_journal_cut_anywhere_is_continued(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    whole = written(path)
    header = whole.index(b"\n") + 1
    lines = [place + 1 for place, byte in enumerate(whole) if byte == ord("\n")]
    # Every byte of the most important lines, and the surroundings of each line's end.
    places = {*range(lines[-6], len(whole) + 1, 5)} | {
        end + d for end in lines for d in (-2, -1, 0, 1)
    }
    for cut in sorted(place for place in places if header <= place <= len(whole)):
        path.write_bytes(whole[:cut])
        before, lock = went_on(path)
        events_before = [
            line for line in whole[header:cut].split(b"\n")[:-1] if line.startswith(b'{"ev')
        ]
        assert before == list(EVENTS[: len(events_before)])
        last_us = max((event.at_us for event in before), default=0)
        after = Resumed(last_us + 7_000_000, "service", "", 7.0)
        assert verified(path) == [*before, after]
        assert path.read_bytes()[:cut].startswith(whole[: max(end for end in lines if end <= cut)])
        ordered = [number for number in range(3) if _ordered(before) > number]
        for plan in lock.status()["plans"]:
            assert plan["approved"] is None
            assert plan["ordered"] == ordered
        assert len(lock.open_items) == 2


def _ordered(events: list[AnyEvent]) -> int:
    return sum(isinstance(event, Telemetry) for event in events)


def test_it_can_be_killed_again(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    whole = written(path)
    path.write_bytes(whole[:-10])
    first, _ = went_on(path)
    path.write_bytes(path.read_bytes()[:-10])
    second, lock = went_on(path, down_s=3.0)
    assert [type(event) for event in second[len(first) :]] == [Resumed]
    events = verified(path)
    assert [event.at_us for event in events[-2:]] == [AT_US + 7_500_000, AT_US + 10_500_000]
    assert "was restarted" in str(lock.refuses(drop(2), AT_US + 10_500_000))


def test_mission_time_never_goes_back() -> None:
    assert resumed(5_000_000, -60.0) == Resumed(5_000_000, "service", "", 0.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace(b'"percent":90.0', b'"percent":91.0'), "line 5 was altered"),
        (lambda text: text.replace(b'"event":{"type":"Gps', b'"evant":{"type":"Gps'), "line 4"),
        (lambda text: text.replace(b'"burned"', b'"berned"'), r"line 1 \(header\) was altered"),
        (lambda text: b"\x00" * 100 + b"\n" + text, "not a journal"),
    ],
)
def test_a_damaged_journal_is_not_continued(
    tmp_path: Path, change: Callable[[bytes], bytes], words: str
) -> None:
    path = tmp_path / "journal.jsonl"
    damaged = change(written(path))
    path.write_bytes(damaged)
    with pytest.raises(JournalError, match=words) as caught:
        went_on(path)
    assert "; to begin a new run, start with --fresh (the journal is then" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == damaged


def test_a_journal_that_another_version_would_not_write_is_not_continued(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    written(path)
    cut_off = unfinished(path, SCENARIO, DIGEST)
    assert cut_off is not None
    with pytest.raises(JournalError, match=r"does not issue .*; another version may have"):
        list(cut_off.turns(lambda event: []))


def test_only_an_interrupted_live_burn_of_the_same_scenario_is_continued(
    tmp_path: Path,
) -> None:
    path = tmp_path / "journal.jsonl"
    assert unfinished(path, SCENARIO, DIGEST) is None
    whole = written(path)
    assert unfinished(path, SCENARIO, DIGEST) is not None
    assert unfinished(path, SCENARIO, "1" * 64) is None
    assert unfinished(path, scenario(seed=1), DIGEST) is None
    path.write_bytes(whole[: whole.index(b"\n")])
    assert unfinished(path, SCENARIO, DIGEST) is None
    path.write_bytes(b"")
    assert unfinished(path, SCENARIO, DIGEST) is None
    written(path, live=False)
    assert unfinished(path, SCENARIO, DIGEST) is None
    written(path, end=True)
    assert unfinished(path, SCENARIO, DIGEST) is None
    path.write_bytes(path.read_bytes()[:-1])  # killed while it wrote that it has ended
    assert unfinished(path, SCENARIO, DIGEST) is not None
    assert len(went_on(path)[0]) == len(EVENTS)


def test_the_end_stands_in_the_journal_and_nothing_after_it(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    whole = written(path, end=True)
    reader = SegmentReader(path)
    assert sum(entry.is_event for entry in reader) == len(EVENTS)
    assert reader.ended
    path.write_bytes(whole + whole.splitlines(keepends=True)[-1])
    with pytest.raises(JournalError, match="follows the end of the run"):
        list(SegmentReader(path))


def test_journals_are_kept_and_what_holds_nothing_is_not(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    assert rename_old(path) is None
    for number in (1, 2):
        whole = written(path, end=True)
        kept = rename_old(path)
        assert kept == tmp_path / f"journal-{number}.jsonl"
        assert kept.read_bytes() == whole
        assert not path.exists()
    path.write_bytes(b"")
    assert rename_old(path) is None
    path.write_bytes(whole[:40])  # killed while it wrote its header
    assert rename_old(path) is None
    path.write_bytes(b"notes")
    assert rename_old(path) == tmp_path / "journal-3.jsonl"
