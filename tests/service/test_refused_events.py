"""Events that cannot be journalled or processed have no effect; unreadable lines are skipped."""

import math
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest

from benchmarks.folds import difference
from mission_service.commands import AnyCommand, Hold, UploadMission
from mission_service.config.scenario import Scenario, flying, load_scenario
from mission_service.core.core import Core
from mission_service.errors import JournalError, RefusedEventError
from mission_service.events import (
    Aborted,
    LinesSkipped,
    MissionRefused,
    Observed,
    OperatorHeartbeat,
    OrderGiven,
    Resumed,
    Telemetry,
    WindMeasured,
)
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import landscape_of
from mission_service.fire.simulated_cameras import cameras_of
from mission_service.journal.journal_file import Journal, SegmentReader, event_body, header_of
from mission_service.journal.recovery import resumed, unfinished
from mission_service.journal.segments import newest_state
from mission_service.journal.snapshot import Frozen, Known, copied, write
from mission_service.live.daemon import replay
from mission_service.live.interface_setup import request_handler_of
from mission_service.replay.flights.batch import analysis_of
from mission_service.replay.flights.flight_logs import flight_of
from mission_service.replay.verification import in_text, verify
from mission_service.runtime.engine import TRIED, Engine
from mission_service.runtime.gateway import Gateway
from mission_service.runtime.state_view import StateView
from mission_service.simulation.sim import Simulation

FROM_S = 590.0
NAN = float("nan")


def scenario_flown() -> Scenario:
    return flying(load_scenario("default", (f"start_s={FROM_S}", "deploy_at_s=600")))


def flight(path: Path, seconds: float) -> Simulation:
    """Return a run with a durable journal."""
    scenario = scenario_flown()
    landscape = landscape_of(scenario)
    journal = Journal(path, header_of(scenario, landscape.digest(), ""), durable=True)
    simulation = Simulation(scenario, journal, landscape)
    simulation.run_until(FROM_S + seconds)
    return simulation


def folds(service: Engine) -> dict[str, Any]:
    """Return a copy of all states that a restart would restore."""
    return copied(service.snapshot_fields(), service.shared_references)


def without_alarms(service: Engine) -> dict[str, Any]:
    """Return the same without the effects of an alarm and its announcement."""
    kept = folds(service)
    view = kept["state_view"]
    view.alarms.clear()
    view.statistics.alarms.clear()
    view.announcements.clear()
    view.records.clear()
    view.changed.clear()
    view.version = view.announcement_id = view.announcement_count = 0
    return kept


def fix(simulation: Simulation, **changes: Any) -> Telemetry:
    """Return the next position of the vehicle, with changes."""
    last = simulation.service.state_view.telemetry["hawk"]
    report = Telemetry(
        simulation.clock.now_us + 250_000,
        "hawk",
        last.lat_deg,
        last.lon_deg,
        last.altitude_amsl_m,
        last.altitude_relative_m,
        1.0,
        1.0,
        90.0,
    )
    return msgspec.structs.replace(report, **changes)


@pytest.mark.parametrize(
    ("event", "field"),
    [
        (WindMeasured(1, "hawk", NAN, 0.0), "speed_m_s"),
        (WindMeasured(1, "hawk", 1e38, 0.0), "speed_m_s"),
        (WindMeasured(1, "hawk", 3.0, math.inf), "from_deg"),
        (WindMeasured(10**16, "hawk", 3.0, 0.0), "at_us"),
        (WindMeasured(1, "", 3.0, 0.0), "vehicle"),
        (MissionRefused(1, "ann", "", "", "0" * 64), "vehicle"),
    ],
)
def test_what_could_not_be_read_again_is_not_written(
    tmp_path: Path, event: Any, field: str
) -> None:
    with pytest.raises(RefusedEventError, match=rf"{type(event).__name__} refused: .*{field}"):
        event_body(event)
    journal = Journal(tmp_path / "journal.jsonl", {}, durable=True)
    with pytest.raises(RefusedEventError):
        journal.write_event(event)
    journal.write_event(OperatorHeartbeat(1, "ann", ""))
    journal.close()
    assert journal.path.read_bytes().count(b"\n") == 2


@pytest.mark.parametrize(
    "changes",
    [
        {"lat_deg": NAN},
        {"lon_deg": 1e38},
        {"altitude_amsl_m": -math.inf},
        {"velocity_east_m_s": 1e9},
        {"at_us": 10**17},
    ],
)
def test_an_absurd_position_leaves_no_trace_but_an_alarm(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    path = tmp_path / "journal.jsonl"
    simulation = flight(path, 60.0)
    service = simulation.service
    state_view = service.state_view
    before, written = without_alarms(service), path.read_bytes()
    lines = len(state_view.announcements)
    absurd = fix(simulation, **changes)
    service.handle_events([absurd], simulation.link_us)
    assert list(state_view.alarms) == ["refused/hawk/Telemetry"]
    assert len(state_view.announcements) == lines + 1
    assert path.read_bytes() == written
    assert difference(without_alarms(service), before) == ""
    service.handle_events([absurd] * 5, simulation.link_us)  # not announced again
    assert len(state_view.announcements) == lines + 1
    simulation.run_until(FROM_S + 62.0)
    assert verify(path).difference is None


def test_the_alarm_of_a_refused_event_ends_with_a_good_one(tmp_path: Path) -> None:
    simulation = flight(tmp_path / "journal.jsonl", 15.0)
    service, at_us = simulation.service, simulation.clock.now_us
    service.handle_events([WindMeasured(at_us, "hawk", NAN, 0.0)], simulation.link_us)
    assert list(service.state_view.alarms) == ["refused/hawk/WindMeasured"]
    service.handle_events([WindMeasured(at_us, "hawk", 4.0, 0.0)], simulation.link_us)
    assert list(service.state_view.alarms) == []


FOLDS: dict[str, Callable[[Engine], object]] = {
    "core": lambda service: service.core,
    "state_view": lambda service: service.state_view,
    "_missions": lambda service: service._missions,
}


def defective(monkeypatch: pytest.MonkeyPatch, fold: object, kind: type) -> None:
    """Let a fold raise at one kind of event, after it has processed half of the event."""
    name = "handle" if isinstance(fold, Core) else "apply"
    works = getattr(type(fold), name)

    def fails(self: Any, event: Any, *more: Any) -> Any:
        found = works(self, event, *more)
        if isinstance(event, kind):
            raise ZeroDivisionError("by nothing")
        return found

    monkeypatch.setattr(type(fold), name, fails)


@pytest.mark.parametrize("name", FOLDS)
def test_a_request_that_a_fold_cannot_handle_is_refused_without_a_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    assert set(FOLDS) < set(TRIED)
    path = tmp_path / "journal.jsonl"
    simulation = flight(path, 60.0)
    service, now_us = simulation.service, simulation.clock.now_us
    before, written = folds(service), path.read_bytes()
    done: list[Any] = []
    gateway = simulation.rigs[0].gateway
    with monkeypatch.context() as patch:
        patch.setattr(gateway, "execute", lambda command, now_us: done.append(command))
        defective(patch, FOLDS[name](service), OrderGiven)
        request_handler = request_handler_of(
            simulation.service._scenario, service, simulation.clock, {}
        )
        for _ in range(2):
            answer = request_handler.ask(
                {"do": "hold", "vehicle": "hawk", "by": "ann", "station": "desk"}
            )
            assert not answer["ok"]
            assert "cannot be handled" in answer["error"]
            assert "\n" not in answer["error"]
        defective(patch, FOLDS[name](service), Aborted)
        assert not request_handler.ask({"do": "abort", "by": "ann", "station": "desk"})["ok"]
        assert done == [Hold("hawk")]  # nevertheless
    assert path.read_bytes() == written
    assert difference(folds(service), before) == ""
    service.submit(OrderGiven(now_us, "ann", "", "hawk", "hold"), simulation.link_us)
    simulation.run_until(FROM_S + 65.0)
    assert verify(path).difference is None


@pytest.mark.parametrize("name", FOLDS)
def test_a_defect_at_a_vehicles_event_ends_the_run_and_not_the_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    path = tmp_path / "journal.jsonl"
    simulation = flight(path, 60.0)
    service = simulation.service
    written = path.read_bytes()
    with monkeypatch.context() as patch:
        defective(patch, FOLDS[name](service), WindMeasured)
        wind = WindMeasured(simulation.clock.now_us, "hawk", 4.0, 0.0)
        with pytest.raises(RefusedEventError, match="this is a defect"):
            service.handle_events([wind], simulation.link_us)
        assert path.read_bytes() == written
        # No further event changes a state that differs from the journal's.
        with pytest.raises(RefusedEventError, match="this is a defect"):
            service.handle_events([fix(simulation)], simulation.link_us)
        assert path.read_bytes() == written
    service.recording.journal.close()
    assert len(continued(path)[0]) == 0
    assert verify(path).difference is None


# Lines that cannot be read or handled --------------------------------------------------------


class Silent:
    """The gateway of a vehicle that sends nothing."""

    def execute(self, command: AnyCommand, now_us: int) -> None:
        """Send to no vehicle."""

    def read_back(self, recognise: object, now_us: int) -> None:
        """Report no vehicle."""


def continued(path: Path, skip: bool = False) -> tuple[tuple[str, ...], Engine]:
    """Restart from a journal; return the reasons for newly skipped lines, and the service."""
    scenario = scenario_flown()
    landscape = landscape_of(scenario)
    cut_off = unfinished(path, Known(scenario, landscape), scenario, skip)
    assert cut_off is not None
    journal = Journal(path, header_of(scenario, landscape.digest(), ""), True, cut_off.rest())
    start_us = round(FROM_S * 1e6)
    service = Engine(
        scenario,
        Core(scenario, landscape),
        cameras_of(scenario, landscape),
        RunEstimate(scenario, landscape),
        journal,
        StateView(scenario, landscape, start_us),
        {"hawk": cast(Gateway, Silent())},
    )
    if cut_off.objects is not None:
        service.restore(cut_off.objects)
    try:
        replay(cut_off, service)
        last_us = max(cut_off.last_us, service.statistics.at_us)
        service.resume(cut_off.missing, resumed(last_us, 5.0), 0, cut_off.skips(last_us))
    finally:
        journal.close()
    return tuple(cut_off.newly_skipped.values()), service


def with_line(path: Path, number: int, body: Callable[[bytes], bytes]) -> None:
    """Change the body of a line as a defect would have written it; all checksums are valid."""
    lines = path.read_bytes().splitlines(keepends=True)
    crc, out = 0, lines[:1]
    for at, line in enumerate(lines[1:], start=2):
        text = line.rpartition(b',"crc":"')[0]
        text = body(text) if at == number else text
        crc = zlib.crc32(text, crc)
        out.append(b'%b,"crc":"%08x"}\n' % (text, crc))
    path.write_bytes(b"".join(out))


def line_of(path: Path, kind: type, after: int = 20) -> int:
    """Return the number of the line with this text."""
    for entry in SegmentReader(path):
        if entry.line > after and isinstance(entry.content, kind):
            return entry.line
    raise AssertionError


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Return the journal of a flight."""
    simulation = flight(tmp_path_factory.mktemp("whole") / "journal.jsonl", 150.0)
    journal = simulation.service.recording.journal
    journal.close()
    return journal.path.read_bytes()


def damaged_byte(path: Path, number: int) -> None:
    lines = path.read_bytes().splitlines(keepends=True)
    lines[number - 1] = lines[number - 1][:30] + b"\x00" + lines[number - 1][31:]
    path.write_bytes(b"".join(lines))


def as_null(path: Path, number: int) -> None:
    def nan(text: bytes) -> bytes:
        at = text.index(b'"heading_deg":') + len(b'"heading_deg":')
        return text[:at] + b"null}"

    with_line(path, number, nan)


def without_name(path: Path, number: int) -> None:
    poison = (
        b'{"event":{"type":"MissionReadBack","at_us":1,"vehicle":"nobody","mission_id":0,"items":1}'
    )
    with_line(path, number, lambda text: poison)


@pytest.mark.parametrize(
    ("damage", "kind"),
    [
        (damaged_byte, Telemetry),
        (as_null, Telemetry),
        (without_name, Telemetry),
        (damaged_byte, UploadMission),
    ],
)
def test_a_line_that_cannot_be_used_is_named_and_skipped_on_request(
    tmp_path: Path, whole: bytes, damage: Callable[[Path, int], None], kind: type
) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(whole)
    number = line_of(path, kind)
    damage(path, number)
    broken = path.read_bytes()
    with pytest.raises(JournalError, match=rf"line {number} .*--skip-unreadable resumes") as caught:
        continued(path)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == broken
    assert verify(path).difference is not None

    skipped, service = continued(path, skip=True)
    assert len(skipped) == 1
    assert f"line {number} " in skipped[0]
    assert path.read_bytes().startswith(broken)
    recorded = [entry.content for entry in SegmentReader(path).trusted(SegmentReader(path).begin)
            if not hasattr(entry, "why")][-8:]  # fmt: skip
    assert any(isinstance(each, LinesSkipped) for each in recorded)
    assert any(isinstance(each, Resumed) for each in recorded)
    assert service.core.vehicles["hawk"].unconfirmed is not None
    # Later restarts and replays skip the same lines.
    assert continued(path)[0] == ()
    found = verify(path)
    assert found.difference is None
    assert found.stage("file").counts["skipped"] == 1
    assert f"line {number} " in in_text(found)
    assert found.stage("core").counts["events"] > 100


def test_a_line_whose_checksum_depends_on_a_lost_one_is_skipped_and_reported(
    tmp_path: Path, whole: bytes
) -> None:
    path = tmp_path / "journal.jsonl"
    lines = whole.splitlines(keepends=True)
    path.write_bytes(whole)
    number = line_of(path, Observed)
    lines[number - 1] = b"damaged\n"  # its checksum is also lost
    path.write_bytes(b"".join(lines))
    both = (
        rf"line {number} was altered.*; --skip-unreadable resumes without that line and 1 more "
        rf"\(.*line {number + 1} was altered or cannot be checked: "
        rf"its checksum depends on line {number}\)"
    )
    with pytest.raises(JournalError, match=both) as caught:
        continued(path)
    assert "\n" not in str(caught.value)
    skipped, _ = continued(path, skip=True)
    assert len(skipped) == 2
    found = verify(path)
    assert found.difference is None
    text = in_text(found)
    assert "observations after a skipped line were not compared" in text
    assert "without a position" not in text


def test_a_line_is_named_by_its_number_behind_a_state_too(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    simulation = flight(path, 100.0)
    service = simulation.service
    write(
        newest_state(path),
        Frozen(service.snapshot_fields(), service.shared_references),
        service.recording.journal.rest,
    )
    behind = path.read_bytes().count(b"\n")
    simulation.run_until(FROM_S + 150.0)
    service.recording.journal.close()
    damaged_byte(path, 20)
    assert continued(path)[0] == ()  # before the snapshot, so nothing is lost
    number = behind + 7
    damaged_byte(path, number)
    with pytest.raises(JournalError, match=rf"line {number} "):
        continued(path)
    assert len(continued(path, skip=True)[0]) == 1


def test_an_event_whose_handling_was_cut_off_is_skipped_without_a_request(
    tmp_path: Path, whole: bytes
) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(whole)
    lines = path.read_bytes().count(b"\n")
    last = path.read_bytes().splitlines(keepends=True)[-1]
    path.write_bytes(path.read_bytes() + last)
    without_name(path, lines + 1)
    skipped, _ = continued(path)
    assert len(skipped) == 1
    assert f"line {lines + 1} cannot be handled" in skipped[0]
    (damage,) = analysis_of("run", flight_of([str(path)])).damage
    assert damage.endswith(f"journal.jsonl, line {lines + 1}: was skipped by a restart")
    assert verify(path).difference is None
