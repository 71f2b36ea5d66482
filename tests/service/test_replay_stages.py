"""A journal verified by stages: the differences that each stage finds, and any damage."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mission_service.replay.fire_stage as replay_fire
from autopilot_bridge.items import MissionItem
from mission_service.cli.main import main
from mission_service.commands import UploadMission
from mission_service.config.scenario import flying, load_scenario
from mission_service.errors import JournalError
from mission_service.events import (
    Aborted,
    Corrected,
    IgnitionReported,
    Observed,
    OrderGiven,
    SettingsChanged,
    WindSet,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.differences import compare, fields_that_differ
from mission_service.journal.journal_file import Journal, SegmentReader, header_of
from mission_service.replay.decisions import decide
from mission_service.replay.verification import as_json, in_text, verify
from mission_service.simulation.sim import Simulation

SMALL = ("start_s=3590", "planner.alpha=5", "vehicles.0.airspeed_m_s=18")
ANN = ("ann", "desk")
FIRE = (36.364232, -84.140907)

Submit = Callable[[Simulation], None]


def flown(path: Path, seconds: float, *overrides: str, submit: Submit | None = None) -> Path:
    """Fly a short flight that a live service would journal; operators submit events half-way."""
    scenario = flying(load_scenario("default", (*SMALL, *overrides)))
    landscape = landscape_of(scenario)
    journal = Journal(path, header_of(scenario, landscape.digest(), ""), durable=True)
    simulation = Simulation(scenario, journal, landscape)
    simulation.run_until(scenario.start_s + seconds / 2)
    if submit is not None:
        submit(simulation)
    simulation.run_until(scenario.start_s + seconds)
    journal.close()
    return path


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a journal of some seconds; the commands of its last event are complete."""
    return flown(tmp_path_factory.mktemp("small") / "journal.jsonl", 40.0)


@pytest.fixture(scope="module")
def longer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a journal of some minutes over the fire, with decisions."""
    return flown(tmp_path_factory.mktemp("longer") / "journal.jsonl", 260.0)


def rewritten(path: Path, to: Path, change: Callable[[int, Any], Any]) -> Path:
    """Return the journal with lines changed by a person who can compute checksums."""
    reader = SegmentReader(path)
    journal = Journal(to, reader.header, durable=False)
    for entry in reader:
        content = change(entry.line, entry.content)
        if entry.is_event:
            journal.write_event(content)
        else:
            journal.write_commands([content])
    journal.close()
    return to


def line_of(data: bytes, at: int) -> int:
    return data.count(b"\n", 0, at) + 1


def damaged(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> Path:
    path = tmp_path_factory.getbasetemp() / "damaged.jsonl"
    path.write_bytes(data)
    return path


# Damage -------------------------------------------------------------------------------------------


def with_byte(data: bytes, at: int, byte: int) -> bytes:
    return data[:at] + bytes([byte]) + data[at + 1 :]


def is_named(path: Path, data: bytes, at: int, stages: tuple[str, ...]) -> None:
    """Check that a changed byte is found, and that its line is named."""
    line = line_of(data, at)
    if line == 1:
        with pytest.raises(JournalError) as refused:
            verify(path, stages=stages)
        assert "\n" not in str(refused.value)
        return
    found = verify(path, stages=stages)
    if at == len(data) - 1:
        assert found.cut_at_line == line
    else:
        assert f"line {line}" in str(found.stage("file").difference)
        assert found.stage("file").counts["altered"] >= 1


@settings(max_examples=300)
@given(data=st.data())
def test_a_changed_byte_anywhere_is_found_and_named(
    data: st.DataObject, small: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    whole = small.read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    byte = data.draw(st.integers(0, 255).filter(lambda byte: byte != whole[at]))
    path = damaged(tmp_path_factory, with_byte(whole, at, byte))
    is_named(path, whole, at, ("file",))


@pytest.mark.long
@settings(max_examples=100)
@given(data=st.data())
def test_no_stage_breaks_on_a_changed_byte(
    data: st.DataObject, small: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    whole = small.read_bytes()
    at = data.draw(st.integers(whole.index(b"\n") + 1, len(whole) - 1))
    byte = data.draw(st.sampled_from(b'0123456789e-+.ub"x').filter(lambda one: one != whole[at]))
    path = damaged(tmp_path_factory, with_byte(whole, at, byte))
    is_named(path, whole, at, ())
    assert [each.name for each in verify(path).stages] == ["file", "fire", "planner", "core"]


@settings(max_examples=100)
@given(data=st.data())
def test_a_journal_cut_anywhere_is_verified_up_to_there(
    data: st.DataObject, small: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    whole = small.read_bytes()
    header = whole.index(b"\n")
    cut = data.draw(st.one_of(st.integers(0, len(whole)), st.integers(0, header + 300)))
    path = damaged(tmp_path_factory, whole[:cut])
    if cut < header:
        with pytest.raises(JournalError):
            verify(path)
        return
    found = verify(path)
    assert found.difference is None
    if cut > header and whole[cut - 1 : cut] != b"\n":
        assert found.cut_at_line == line_of(whole, cut)


def test_a_digit_of_a_checksum_that_means_the_same_is_altered(small: Path, tmp_path: Path) -> None:
    whole = small.read_bytes()
    for pattern, other in ((b',"crc":"0', b',"crc":"+'), (b"a", b"A")):
        start = whole.index(b"\n") + 1
        at = whole.index(pattern, whole.index(b',"crc":"0', start)) + len(pattern) - 1
        if pattern == b"a":
            at = next(
                place + 8 + number
                for place in _places(whole, b',"crc":"', start)
                for number in range(8)
                if whole[place + 8 + number : place + 9 + number] == b"a"
            )
        path = tmp_path / "altered.jsonl"
        path.write_bytes(with_byte(whole, at, other[-1]))
        found = verify(path, stages=("file",))
        assert str(found.difference).startswith(f"line {line_of(whole, at)}: altered")


def _places(data: bytes, pattern: bytes, start: int) -> list[int]:
    found = []
    while (start := data.find(pattern, start)) >= 0:
        found.append(start)
        start += 1
    return found


# Fire ---------------------------------------------------------------------------------------------


def test_a_cell_that_no_camera_saw_so_is_named(longer: Path, tmp_path: Path) -> None:
    changed: list[tuple[int, Observed]] = []

    def one_letter(line: int, content: Any) -> Any:
        if changed or not isinstance(content, Observed) or "b" not in "".join(content.cells):
            return content
        changed.append((line, content))
        middle = len(content.cells) // 2
        row = content.cells[middle]
        letters = row[: len(row) // 2] + ("u" if row[len(row) // 2] == "b" else "b")
        row = letters + row[len(letters) :]
        cells = (*content.cells[:middle], row, *content.cells[middle + 1 :])
        return msgspec.structs.replace(content, cells=cells)

    path = rewritten(longer, tmp_path / "journal.jsonl", one_letter)
    found = verify(path)
    ((line, seen),) = changed
    stage = found.stage("fire")
    assert found.stage("file").difference is None
    assert stage.counts["beyond tolerance"] == 1
    (cell,) = stage.details
    row, col = seen.row + len(seen.cells) // 2, seen.col + len(seen.cells[0]) // 2
    assert (cell["vehicle"], cell["row"], cell["col"]) == ("hawk", row, col)
    assert {cell["journal"], cell["replay"]} == {"u", "b"}
    words = f"line {line}: hawk at {seen.at_us / 1e6:.3f} s, cell row {row} col {col}: journal has"
    assert str(stage.difference).startswith(words)
    assert "fire" in found.differing
    assert as_json(found)["stages"]["fire"]["details"] == [cell]
    assert words in in_text(found)


def test_an_observation_of_another_time_than_its_position_is_named(
    longer: Path, tmp_path: Path
) -> None:
    first: list[int] = []

    def later(line: int, content: Any) -> Any:
        if isinstance(content, Observed) and not first:
            first.append(line)
            return msgspec.structs.replace(content, at_us=content.at_us + 1)
        return content

    found = verify(rewritten(longer, tmp_path / "journal.jsonl", later), stages=("fire",))
    words = f"line {first[0]}: no position of hawk with the same time follows"
    assert found.difference == words


def test_cells_on_the_edge_of_fire_or_footprint_may_differ(
    longer: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = 0

    def unseen(line: int, content: Any) -> Any:
        """Mark the outermost cell in the first row as unseen."""
        nonlocal seen
        if isinstance(content, Observed) and len(content.cells) > 3:
            row = content.cells[0]
            if not row.strip("."):
                return content
            seen += 1
            at = next(place for place, letter in enumerate(row) if letter != ".")
            row = row[:at] + "." + row[at + 1 :]
            return msgspec.structs.replace(content, cells=(row, *content.cells[1:]))
        return content

    path = rewritten(longer, tmp_path / "journal.jsonl", unseen)
    assert verify(path, stages=("fire",)).differing == ["fire"]
    monkeypatch.setattr(replay_fire, "EDGE_WITHIN_CELLS", 1.0)
    found = verify(path, stages=("fire",))
    assert found.difference is None
    assert found.stage("fire").counts["within tolerance"] == seen
    assert "another machine" in found.stage("fire").note
    monkeypatch.setattr(replay_fire, "ARRIVAL_WITHIN_S", 1e6)

    def unburned(line: int, content: Any) -> Any:
        if isinstance(content, Observed):
            cells = tuple(row.replace("b", "u") for row in content.cells)
            return msgspec.structs.replace(content, cells=cells)
        return content

    path = rewritten(longer, tmp_path / "unburned.jsonl", unburned)
    assert verify(path, stages=("fire",)).difference is None
    monkeypatch.setattr(replay_fire, "ARRIVAL_WITHIN_S", 1.0)
    assert verify(path, stages=("fire",)).differing == ["fire"]


@pytest.mark.parametrize("scheme", ["devs8", "anyangle", "probabilistic"])
def test_the_fire_is_rebuilt_to_the_last_cell_with_all_operator_events(
    tmp_path: Path, scheme: str
) -> None:
    def submit_events(simulation: Simulation) -> None:
        now_us = simulation.clock.now_us
        lat, lon = FIRE
        line = ((lat + 0.004, lon + 0.004), (lat + 0.004, lon))
        for event in (
            IgnitionReported(now_us, *ANN, line, now_us - 60_000_000),
            WindSet(now_us, *ANN, 12.0, 10.0),
            Corrected(now_us, *ANN, "burned", "point", ((lat + 0.003, lon + 0.003),), now_us),
            SettingsChanged(now_us, *ANN, alpha=0.1),
        ):
            simulation.service.submit(event, simulation.link_us)

    path = flown(tmp_path / "journal.jsonl", 300.0, f"fire.scheme={scheme}", submit=submit_events)
    found = verify(path)
    assert found.differing == []
    counts = found.stage("fire").counts
    assert (counts["within tolerance"], counts["beyond tolerance"]) == (0, 0)
    assert counts["observations"] > 200
    assert found.stage("planner").counts["decisions"] > 0


# Planner and core ---------------------------------------------------------------------------------


def test_planners_alone_receive_the_operator_events(tmp_path: Path) -> None:
    def submit_events(simulation: Simulation) -> None:
        orders = (
            *(("hold", 30.0), ("resume", 60.0), ("return", 20.0), ("resume", 20.0)),
            *(("return", 20.0), ("abort", 30.0), ("start", 20.0), ("resume", 20.0)),
            *(("return", 20.0), ("start", 0.0)),
        )
        for order, seconds in orders:
            now_us = simulation.clock.now_us
            ordered = OrderGiven(now_us, *ANN, "", order)  # type: ignore[arg-type]
            event = Aborted(now_us, *ANN) if order == "abort" else ordered
            simulation.service.submit(event, simulation.link_us)
            simulation.run_until(now_us / 1e6 + seconds)

    path = flown(tmp_path / "journal.jsonl", 500.0, submit=submit_events)
    assert verify(path).differing == []
    alone = decide(path)
    assert alone.difference is None
    assert len(alone.found) == len(alone.recorded) > 20


def test_every_field_that_differs_is_named_and_nested_ones_too() -> None:
    items = tuple(MissionItem(16, 3, number, number, 100.0) for number in range(5))
    journal = UploadMission("hawk", 1, "begin", items)
    other = (*items[:3], replace(items[3], x=7, z=90.0))
    replay = UploadMission("hawk", 2, "begin", other)
    assert [each["field"] for each in fields_that_differ(journal, replay)] == [
        "UploadMission.mission_id",
        "UploadMission.items[3].x",
        "UploadMission.items[3].z",
        "UploadMission.items[4]",
    ]
    words = compare(journal, replay)
    assert "UploadMission.items[3].x: journal has 3, replay has 7; " in words
    moved = tuple(replace(item, x=50, y=60) for item in items)
    words = compare(journal, UploadMission("hawk", 1, "begin", moved))
    assert words.endswith("; and more")
    assert words.count("journal has") == 8


def test_a_stage_alone_is_a_word_on_the_command_line(small: Path, tmp_path: Path) -> None:
    from click.testing import CliRunner

    call = CliRunner().invoke
    result = call(main, ["replay", str(small), "--verify", "--stage", "file", "--stage", "fire"])
    assert result.exit_code == 0
    assert [line.split()[:2] for line in result.stdout.splitlines()] == [
        ["file", "ok"],
        ["fire", "ok"],
        ["the", "journal"],  # has no regular end
    ]
    whole = small.read_bytes()
    at = whole.index(b'"lat_deg":36', whole.index(b"\n")) + 11
    (tmp_path / "journal.jsonl").write_bytes(with_byte(whole, at, ord("5")))
    result = call(main, ["replay", str(tmp_path / "journal.jsonl"), "--verify"])
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert f"first difference in line {line_of(whole, at)}: altered" in result.stderr
