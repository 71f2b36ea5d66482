"""A full or failing disk: no partial line, and no action without a record except an abort."""

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from mission_service.commands import ClimbAndHold, GoAround, Hold, HoldAt, UploadMission
from mission_service.config.scenario import flying, load_scenario
from mission_service.errors import NotRecordedError
from mission_service.events import (
    Aborted,
    Corrected,
    LinesSkipped,
    MissionReadBack,
    ModeChanged,
    OperatorHeartbeat,
    OrderGiven,
    Resumed,
    Telemetry,
    VehicleConnected,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import Journal, SegmentReader, header_of
from mission_service.replay.verification import verify
from mission_service.runtime.alarms.unrecorded_events import UnrecordedEvents
from mission_service.simulation.sim import Simulation

FROM_S = 3590.0
PLACE = (36.364232, -84.140907)


@contextmanager
def no_room(path: Path, more_bytes: int) -> Iterator[None]:
    """Limit all files to the size of this file plus some bytes, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + more_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def flight(path: Path, seconds: float) -> Simulation:
    scenario = flying(load_scenario("default", (f"start_s={FROM_S}",)))
    landscape = landscape_of(scenario)
    journal = Journal(path, header_of(scenario, landscape.digest(), ""), durable=True)
    simulation = Simulation(scenario, journal, landscape)
    simulation.run_until(FROM_S + seconds)
    return simulation


def on_for(simulation: Simulation, seconds: float) -> None:
    simulation.run_until(simulation.clock.now_us / 1e6 + seconds)


def entries(path: Path) -> list[Any]:
    return [entry.content for entry in SegmentReader(path)]


def test_on_a_full_disk_nothing_is_done_but_an_abort_and_then_it_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    simulation = flight(path, 90.0)
    service, clock = simulation.service, simulation.clock
    recording, state_view = service.recording, service.state_view
    (gateway,) = (rig.gateway for rig in simulation.rigs)
    done: list[Any] = []
    execute = gateway.execute
    gateway.execute = lambda command, now_us: (done.append(command), execute(command, now_us))[1]  # type: ignore[func-returns-value,method-assign]

    with no_room(path, 150):
        on_for(simulation, 20.0)
        assert recording.trouble == "disk full"
        whole = path.read_bytes()
        assert whole.endswith(b'"}\n')
        assert all(entry.intact for entry in SegmentReader(path))
        done.clear()
        on_for(simulation, 30.0)
        assert path.read_bytes() == whole
        assert done == []
        # Positions are still shown.
        assert state_view.telemetry["hawk"].at_us > clock.now_us - 1_000_000
        fire = service.estimate.fire
        for asked in (
            OperatorHeartbeat(clock.now_us, "ann", ""),
            OrderGiven(clock.now_us, "ann", "", "hawk", "hold"),
            Corrected(clock.now_us, "ann", "", "burned", "point", (PLACE,), clock.now_us),
        ):
            with pytest.raises(NotRecordedError, match=r"^not recorded: disk full; the request"):
                service.submit(asked, simulation.link_us)
        assert service.core.vehicles["hawk"].ordered == ""
        assert service.estimate.fire is fire
        service.submit(Aborted(clock.now_us, "ann", ""), simulation.link_us)
        assert done[1:] == [Hold("hawk")]
        assert not service.retry(clock.now_us, simulation.link_us)
        assert path.read_bytes() == whole
    down_us = clock.now_us
    on_for(simulation, 5.0)
    assert service.retry(clock.now_us, simulation.link_us)
    assert recording.trouble == ""
    service.submit(OrderGiven(clock.now_us, "ann", "", "hawk", "resume"), simulation.link_us)
    on_for(simulation, 60.0)
    recording.journal.close()

    recorded = entries(path)[len(whole.splitlines()) - 1 :]
    kinds = [type(each) for each in recorded]
    resumed = next(each for each in recorded if isinstance(each, Resumed))
    assert kinds.index(Aborted) < kinds.index(Resumed) < kinds.index(VehicleConnected)
    assert 50.0 <= resumed.down_s < 60.0
    held = next(each for each in recorded if isinstance(each, MissionReadBack))
    assert held.mission_id > 0
    assert kinds.index(MissionReadBack) < kinds.index(UploadMission)
    assert not any(isinstance(each, Telemetry) and each.at_us < down_us for each in recorded)
    result = verify(path)
    assert (result.difference, result.cut_at_line) == (None, None)


@pytest.mark.parametrize("broken", ["write", "fsync"])
def test_a_failing_disk_leaves_whole_lines_and_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, broken: str
) -> None:
    path = tmp_path / "journal.jsonl"
    service = flight(path, 12.0).service
    before = path.read_bytes()
    at_us = round(FROM_S * 1e6) + 13_000_000
    works = getattr(os, broken)

    def fails(file: int, *data: Any) -> int:
        if broken == "write":
            works(file, bytes(data[0])[:30])  # a part of it was written
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, broken, fails)
    with pytest.raises(NotRecordedError, match="cannot be written: Input/output error"):
        service.submit(OperatorHeartbeat(at_us, "ann", ""), 0)
    assert path.read_bytes() == before
    monkeypatch.setattr(os, broken, works)
    assert service.retry(at_us + 2_000_000, 0)
    service.submit(OperatorHeartbeat(at_us + 3_000_000, "bob", ""), 0)
    service.recording.journal.close()
    added = entries(path)[len(before.splitlines()) - 1 :]
    assert [type(each).__name__ for each in added if not hasattr(each, "vehicle")] == [
        "Resumed",
        "OperatorHeartbeat",
    ]
    assert verify(path).difference is None


def test_an_order_that_cannot_be_written_down_is_not_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.jsonl"
    simulation = flight(path, 40.0)  # higher than a plane that must climb first
    service, now_us = simulation.service, simulation.clock.now_us
    done: list[Any] = []
    monkeypatch.setattr(simulation.rigs[0].gateway, "execute", lambda *args: done.append(args[0]))
    works = os.write

    def fails(file: int, data: memoryview) -> int:
        if bytes(data[:11]) == b'{"command":':
            raise OSError(28, "No space left on device")
        return works(file, data)

    monkeypatch.setattr(os, "write", fails)
    service.submit(OrderGiven(now_us, "ann", "", "hawk", "hold"), simulation.link_us)
    assert (service.recording.trouble, done) == ("disk full", [])
    monkeypatch.setattr(os, "write", works)
    assert service.retry(now_us + 5_000_000, simulation.link_us)
    service.recording.journal.close()
    args = [type(each) for each in entries(path)]
    assert args.index(OrderGiven) < args.index(Hold) < args.index(Resumed)
    assert verify(path).difference is None


def test_operator_events_are_on_the_disk_before_they_are_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.jsonl"
    simulation = flight(path, 12.0)
    synced: list[bytes] = []
    monkeypatch.setattr(os, "fsync", lambda file: synced.append(path.read_bytes()))
    on_for(simulation, 2.0)
    assert synced == []
    simulation.service.submit(
        OperatorHeartbeat(simulation.clock.now_us, "ann", ""), simulation.link_us
    )
    assert len(synced) == 1
    assert b'"by":"ann"' in synced[0]
    assert path.read_bytes() == synced[0]


def test_a_correction_that_cannot_be_is_not_in_the_journal(tmp_path: Path) -> None:
    from firemodel.errors import FireModelError

    path = tmp_path / "journal.jsonl"
    simulation = flight(path, 12.0)
    before = path.read_bytes()
    now_us = simulation.clock.now_us
    water = Corrected(now_us, "ann", "", "burning", "point", (PLACE,), now_us - 10_000_000_000)
    simulation.service.estimate.check = _refuses  # type: ignore[method-assign]
    with pytest.raises(FireModelError):
        simulation.service.submit(water, simulation.link_us)
    assert path.read_bytes() == before
    on_for(simulation, 2.0)
    simulation.service.recording.journal.close()
    assert verify(path).difference is None


def _refuses(event: Any) -> None:
    from firemodel.errors import FireModelError

    raise FireModelError("that cannot be")


class Shown:
    """A view that stores the announcements."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def announce(self, name: str, text: str, level: str) -> None:
        self.texts.append(text)

    def alarm(self, *shown: str) -> None:
        pass


@pytest.mark.parametrize(
    ("command", "kept"),
    [
        (Hold("hawk"), True),
        (HoldAt("hawk", 36.0, -84.0, 500.0), True),
        (ClimbAndHold("hawk", 36.0, -84.0, 500.0), True),
        (GoAround("hawk", 36.0, -84.0, 500.0), True),
        (Hold("kite"), False),
    ],
)
def test_an_abort_ends_no_mode_that_was_selected_on_a_full_disk(command: Any, kept: bool) -> None:
    unrecorded, view = UnrecordedEvents(), Shown()
    unrecorded.show(ModeChanged(0, "hawk", 2, True, "manual"), view)  # type: ignore[arg-type]
    assert unrecorded.keeps_mode(command, view) == kept  # type: ignore[arg-type]
    assert view.texts == ["stays in mode manual, which was selected meanwhile"] * kept


@pytest.mark.parametrize("skipped", [None, ((1, 17, "was altered"),)])
def test_a_restart_on_a_full_disk_is_recorded_when_the_disk_has_room(
    tmp_path: Path, skipped: tuple[tuple[int, int, str], ...] | None
) -> None:
    path = tmp_path / "journal.jsonl"
    simulation = flight(path, 12.0)
    service, now_us = simulation.service, simulation.clock.now_us
    skips = None if skipped is None else LinesSkipped(now_us, "service", "", skipped)
    with no_room(path, 20):
        restart = Resumed(now_us + 3_600_000_000, "service", "", 3600.0)
        service.resume([], restart, simulation.link_us, skips)
        assert service.recording.trouble == "disk full"
        assert not service.retry(now_us + 3_605_000_000, simulation.link_us)
    assert service.retry(now_us + 3_610_000_000, simulation.link_us)
    service.recording.journal.close()
    recorded = [each for each in entries(path) if isinstance(each, LinesSkipped | Resumed)]
    assert recorded[:-1] == ([] if skips is None else [skips])
    last = recorded[-1]
    assert isinstance(last, Resumed)
    assert last.down_s == pytest.approx(3610.0, abs=1.0)
