"""The journal in segments: closed, chained, verified, deleted; continued after any kill."""

import asyncio
import contextlib
import json
import os
import shutil
import stat
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario, flying, load_scenario
from mission_service.config.service_section import JournalSection
from mission_service.errors import JournalError, StateError
from mission_service.events import Telemetry
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import (
    Journal,
    Rest,
    SegmentReader,
    header_of,
    next_path,
    segment_path,
)
from mission_service.journal.reader import JournalReader
from mission_service.journal.recovery import rename_old, unfinished
from mission_service.journal.segments import (
    Chain,
    begin_state,
    closed_segments,
    complete,
    earlier_state,
    newest_state,
    trim,
)
from mission_service.journal.snapshot import Frozen, Known, read, write
from mission_service.replay.verification import verify
from mission_service.runtime.gateway import MissionClock
from mission_service.runtime.journal_retention import JournalRetention
from mission_service.simulation.sim import Simulation

Files = dict[str, bytes]


class Kept:
    """A flight of some minutes as a live service stores it: three segments, a newer snapshot."""

    def __init__(self, folder: Path) -> None:
        self.scenario: Scenario = flying(load_scenario("default", ("start_s=3590",)))
        self.landscape: Landscape = landscape_of(self.scenario)
        self.shared = Known(self.scenario, self.landscape)
        self.path = folder / "journal.jsonl"
        header = header_of(self.scenario, self.landscape.digest(), "")
        journal = Journal(self.path, header, durable=True)
        simulation = Simulation(self.scenario, journal, self.landscape)
        for seconds in (60, 120):
            simulation.run_until(self.scenario.start_s + seconds)
            frozen = Frozen(simulation.service.snapshot_fields(), self.shared)
            journal.begin_segment()
            write(begin_state(self.path, journal.rest.segment), frozen, journal.rest)
        simulation.run_until(self.scenario.start_s + 150)
        frozen = Frozen(simulation.service.snapshot_fields(), self.shared)
        write(newest_state(self.path), frozen, journal.rest)
        simulation.run_until(self.scenario.start_s + 170)
        journal.close()
        self.last: Rest = journal.rest
        self.files: Files = {each.name: each.read_bytes() for each in folder.iterdir()}

    def again(self, folder: Path) -> Path:
        """Copy the files to another folder."""
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
            (folder / name).chmod(0o600)
        return folder / "journal.jsonl"


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Kept:
    return Kept(tmp_path_factory.mktemp("kept"))


def test_all_segments_are_verified_together_and_each_from_its_state(
    kept: Kept, tmp_path: Path
) -> None:
    path = kept.again(tmp_path)
    assert sorted(kept.files) == [
        "journal-000001.jsonl",
        "journal-000002.jsonl",
        "journal-000002.state",
        "journal-000003.state",
        "journal.jsonl",
        "journal.state",
    ]
    whole = verify(path)
    assert (whole.difference, whole.cut_at_line, whole.from_segment, whole.segments) == (
        None, None, 1, 3,
    )  # fmt: skip
    parts = [verify(segment_path(path, 1)), verify(segment_path(path, 2)), verify(path, alone=True)]
    assert [part.difference for part in parts] == [None] * 3
    assert [part.from_segment for part in parts] == [1, 2, 3]
    assert sum(part.events for part in parts) == whole.events
    assert min(part.commands for part in parts) > 0
    segment_path(path, 1).unlink()
    later = verify(path)
    assert (later.difference, later.from_segment) == (None, 2)
    assert later.events == whole.events - parts[0].events
    begin_state(path, 2).unlink()
    with pytest.raises(JournalError, match=r"segment 2 cannot be replayed: .*cannot be read"):
        verify(path)


def test_a_second_command_does_not_empty_a_journal_that_is_being_written(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    writing = Journal(path, {}, durable=False)
    writing.write_lines([b'{"event":"x"'] * 10_000)
    before = path.read_bytes()
    with pytest.raises(JournalError, match="another command writes to this folder"):
        Journal(path, {}, durable=False)
    assert path.read_bytes() == before != b""
    writing.begin_segment()
    with pytest.raises(JournalError, match="another command writes to this folder"):
        Journal(path, {}, durable=False)
    writing.close()
    Journal(path, {}, durable=False).close()


def test_a_changed_byte_is_found_in_any_segment(kept: Kept, tmp_path: Path) -> None:
    for name in ("journal-000001.jsonl", "journal-000002.jsonl", "journal.jsonl"):
        path = kept.again(tmp_path)
        at = kept.files[name].index(b'"type":"Telemetry"', 3000) + 40
        changed = bytearray(kept.files[name])
        changed[at] ^= 1
        (tmp_path / name).write_bytes(bytes(changed))
        try:
            reported = str(verify(path).difference)
        except JournalError as error:
            reported = str(error)
        assert name in reported


def test_lines_that_are_missing_between_two_segments_are_found(kept: Kept, tmp_path: Path) -> None:
    path = kept.again(tmp_path)
    first = segment_path(path, 1)
    lines = first.read_bytes().splitlines(keepends=True)
    while b'"command"' in lines[-1][:12]:
        lines.pop()
    first.write_bytes(b"".join(lines[:-1]))
    found = verify(path)
    assert found.differing == ["file"]
    assert "journal-000001.jsonl: is incomplete, or journal-" in str(found.difference)
    segment_path(path, 2).unlink()
    with pytest.raises(JournalError, match=r"journal-000002\.jsonl: is missing"):
        Chain(path)


def continued(kept: Kept, path: Path) -> tuple[Any, int, list[str]]:
    """Return the core after a restart, the number of its events, and the skipped snapshots."""
    cut_off = unfinished(path, kept.shared, kept.scenario)
    assert cut_off is not None
    rest = cut_off.rest()
    from mission_service.core.core import Core

    core = Core(kept.scenario, kept.landscape)
    if cut_off.objects is not None:
        core = cut_off.objects["core"]
    event_count = sum(1 for _ in cut_off.turns(core.handle))
    assert rest == kept.last
    assert not cut_off.missing
    return core, event_count, cut_off.unusable


def test_a_restart_takes_the_newest_state_that_it_can_use(kept: Kept, tmp_path: Path) -> None:
    path = kept.again(tmp_path)
    cores, counts = [], []
    core, event_count, passed_over = continued(kept, path)
    cores, counts = [core], [event_count]
    assert passed_over == []
    half = newest_state(path).read_bytes()
    newest_state(path).write_bytes(half[: len(half) // 2])
    for words in ("sha256 does not match", "is corrupt", "with another code"):
        core, event_count, passed_over = continued(kept, path)
        assert words in " ".join(passed_over)
        cores.append(core)
        counts.append(event_count)
        if words == "sha256 does not match":
            newest_state(path).unlink()
            begin_state(path, 3).write_bytes(b"no state\n")
        else:
            for state in (begin_state(path, 3), begin_state(path, 2)):
                text = read_header(kept.files[state.name]) | {"code": "0" * 64}
                state.write_bytes(json.dumps(text).encode() + b"\nanything")
    assert counts == sorted(counts)
    assert counts[-1] == verify(path).events
    # From any snapshot: the same core, with the same commands bit for bit.
    events = [entry.content for entry in SegmentReader(path) if entry.is_event][-200:]
    commands_by_core = [[each.handle(event) for event in events] for each in cores]
    assert all(commands == commands_by_core[0] for commands in commands_by_core)
    segment_path(path, 1).unlink()
    with pytest.raises(JournalError, match="its beginning was deleted, and no state can be used"):
        continued(kept, path)


def read_header(state: bytes) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(state[: state.index(b"\n")])
    return found


def test_a_kill_between_two_segments_leaves_a_journal_that_can_be_continued(
    kept: Kept, tmp_path: Path
) -> None:
    path = kept.again(tmp_path)
    # Killed when the old file had its new name, and the new file not yet the name of the old.
    path.rename(next_path(path))
    (tmp_path / "journal-000004.state.half").write_bytes(b"half")
    complete(path)
    assert continued(kept, path)[1] > 0
    assert sorted(each.name for each in tmp_path.iterdir()) == sorted(kept.files)
    # Killed before this: the new file is not used.
    next_path(path).write_bytes(b'{"header"')
    complete(path)
    assert not next_path(path).exists()
    assert path.read_bytes() == kept.files["journal.jsonl"]
    # Killed before the snapshot of the third segment was written: an older one is used.
    begin_state(path, 3).unlink()
    newest_state(path).unlink()
    assert continued(kept, path)[2] == []


def test_the_oldest_segments_are_deleted_and_never_the_newest_two(
    kept: Kept, tmp_path: Path
) -> None:
    path = kept.again(tmp_path)
    size = sum(len(content) for content in kept.files.values())
    assert trim(path, size) == []
    assert trim(path, size - 1) == [segment_path(path, 1)]
    assert list(closed_segments(path)) == [2]
    assert trim(path, 0) == []
    assert verify(path).difference is None


def test_segments_are_deleted_only_with_a_limit(kept: Kept, tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    header = header_of(kept.scenario, kept.landscape.digest(), "")
    journal = Journal(path, header, durable=True)
    service = Simulation(kept.scenario, journal, kept.landscape).service

    def segments_after(settings: JournalSection) -> list[int]:
        asyncio.run(JournalRetention(service, kept.shared, settings).begin_segment())
        return list(closed_segments(path))

    assert JournalSection().keep_mb is None
    assert [segments_after(JournalSection()) for _ in range(3)] == [[1], [1, 2], [1, 2, 3]]
    assert segments_after(JournalSection(keep_mb=0.001)) == [4]
    journal.close()


def test_an_almost_full_disk_raises_an_alarm_until_it_has_space_again(
    kept: Kept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    header = header_of(kept.scenario, kept.landscape.digest(), "")
    journal = Journal(tmp_path / "journal.jsonl", header, durable=True)
    service = Simulation(kept.scenario, journal, kept.landscape).service
    retention = JournalRetention(service, kept.shared, JournalSection())

    def alarm_with(free_bytes: int) -> str:
        usage = SimpleNamespace(free=free_bytes)
        monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage)
        maintained = retention.maintain(MissionClock(0, wall=False))
        with contextlib.suppress(TimeoutError):
            asyncio.run(asyncio.wait_for(maintained, 0.1))
        alarm = service.state_view.alarms.get("disk")
        return alarm.text if alarm else ""

    assert alarm_with(500_000_000) == ""
    assert alarm_with(443_000_000).startswith(f"only 440 MB are free on the disk of {tmp_path}")
    assert alarm_with(7_400_000).startswith("only 7 MB are free")
    assert alarm_with(599_000_000) != ""
    assert alarm_with(600_000_000) == ""
    journal.close()


def test_a_state_is_for_its_user_alone_and_no_others_are_read(kept: Kept, tmp_path: Path) -> None:
    path = newest_state(kept.path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    ours = newest_state(kept.again(tmp_path))
    ours.chmod(0o660)
    with pytest.raises(StateError, match="other users could have written it"):
        read(ours, kept.shared)
    ours.chmod(0o600)
    other = kept.scenario.model_copy(update={"seed": 7})
    with pytest.raises(StateError, match="with another scenario"):
        read(ours, Known(other, kept.landscape))
    assert read(ours, kept.shared)["core"].landscape is kept.landscape


def test_a_state_that_cannot_be_written_leaves_the_one_before(
    kept: Kept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = newest_state(kept.again(tmp_path))
    before = state.read_bytes()

    def full(file: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write(state, Frozen({"core": None}, kept.shared), Rest(0, 0))
    assert state.read_bytes() == before
    assert not list(tmp_path.glob("*.half"))
    assert not earlier_state(state.with_suffix(".jsonl")).exists()


def test_the_files_of_a_journal_are_kept_together(kept: Kept, tmp_path: Path) -> None:
    for number in (1, 2):
        path = kept.again(tmp_path)
        to = tmp_path / f"journal-{number}.jsonl"
        assert rename_old(path) == to
        assert not any(each.name in kept.files for each in tmp_path.iterdir())
        assert verify(to).difference is None
        assert verify(segment_path(to, 2)).difference is None
    assert rename_old(path) is None
    # The last segment was moved away manually.
    path = kept.again(tmp_path)
    path.unlink()
    assert rename_old(path) == tmp_path / "journal-3.jsonl"
    assert segment_path(tmp_path / "journal-3.jsonl", 2).exists()
    path = kept.again(tmp_path)
    assert rename_old(path) == tmp_path / "journal-4.jsonl"


def test_what_is_left_of_a_journal_begins_with_a_state(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    for number in (1, 2, 3, 4, 5):  # killed before the snapshot of the third segment was written
        segment_path(path, number).write_bytes(b"x" * 100)
        if number in (2, 4, 5):
            begin_state(path, number).write_bytes(b"x" * 10)
    path.write_bytes(b"x" * 100)
    assert trim(path, 629) == [segment_path(path, 1)]
    assert trim(path, 529) == [segment_path(path, 2), segment_path(path, 3)]
    assert trim(path, 400) == []
    assert begin_state(path, 4).exists()


def test_the_state_of_the_last_segments_beginning_may_be_the_newest(
    kept: Kept, tmp_path: Path
) -> None:
    path = kept.again(tmp_path)
    newest_state(path).unlink()
    from_third = continued(kept, path)[1]
    newest_state(path).write_bytes(begin_state(path, 2).read_bytes())
    newest_state(path).chmod(0o600)
    assert continued(kept, path)[1] == from_third
    begin_state(path, 3).unlink()
    assert continued(kept, path)[1] > from_third


class PositionJournal:
    """A journal that contains one position a second."""

    def __init__(self, folder: Path) -> None:
        scenario = flying(load_scenario("default"))
        header = header_of(scenario, "", "")
        self.journal = Journal(folder / "journal.jsonl", header, durable=True)
        self.at_s = 0

    def fly(self, seconds: int) -> None:
        for _ in range(seconds):
            self.at_s += 1
            place = (36.36, -84.14, 400.0, 100.0, 0.0, 0.0, 0.0)
            self.journal.write_event(Telemetry(self.at_s * 1_000_000, "hawk", *place))


@pytest.mark.parametrize("segments", [1, 2])
def test_a_reader_of_a_running_run_reads_each_segment_that_is_closed_meanwhile(
    tmp_path: Path, segments: int
) -> None:
    run = PositionJournal(tmp_path)
    for _ in range(segments - 1):
        run.fly(5)
        run.journal.begin_segment()
    run.fly(5)
    reader = JournalReader(run.journal.path)
    run.journal.begin_segment()
    run.fly(5)
    run.journal.close()
    contents = [entry.content for _, entry in reader.intact()]
    found = [content.at_us for content in contents if isinstance(content, Telemetry)]
    assert found == [second * 1_000_000 for second in range(1, 5 * segments + 1)]


def test_a_segment_is_on_the_disk_before_it_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, synced = PositionJournal(tmp_path), list[str]()
    works = os.fsync

    def recorded(file: int) -> None:
        synced.append(Path(f"/proc/self/fd/{file}").readlink().name)
        works(file)

    run.fly(5)
    monkeypatch.setattr(os, "fsync", recorded)
    run.journal.begin_segment()
    run.journal.close()
    assert synced == ["journal.jsonl", "journal.jsonl.next"]
