"""A journal as a log: positions, missions and modes; damage is reported and skipped."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autopilot_bridge.logs.entries import MissionLoaded
from autopilot_bridge.vehicle.client_events import Connected, ModeChanged, Position
from mission_service.errors import JournalError
from mission_service.events import Telemetry, UploadFinished
from mission_service.replay.flights.flown_vehicle import info_of
from mission_service.replay.flights.journal_log import JournalLog, open_flight
from mission_service.simulation.sim import simulate
from tests.flights.test_open_loop_replay import scenario
from tests.service.test_cli import call


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("run")
    home = {"home_lat_deg": 36.346, "home_lon_deg": -84.16, "autostart": True}
    vehicles = [{"name": "hawk", **home}, {"name": "kite", "stack": "ardupilot", **home}]
    simulate(scenario(duration_s=3700.0, vehicles=vehicles), found / "journal.jsonl", "today")
    return found


@pytest.mark.long
def test_a_journal_gives_the_reports_of_its_vehicles(folder: Path) -> None:
    log = open_flight(folder)
    assert isinstance(log, JournalLog)
    assert log.names == {1: "hawk", 2: "kite"}
    entries = list(log.entries())
    assert log.damage == []
    contents = list(log.contents())
    for number, name in log.names.items():
        mine = [entry.event for entry in entries if entry.system_id == number]
        theirs = [t for t in contents if isinstance(t, Telemetry) and t.vehicle == name]
        flown = [event for event in mine if isinstance(event, Position)]
        assert [(e.at_us, e.lat_deg, e.altitude_amsl_m) for e in flown] == [
            (t.at_us, t.lat_deg, t.altitude_amsl_m) for t in theirs
        ]
        loaded = [event for event in mine if isinstance(event, MissionLoaded)]
        accepted = [t for t in contents if isinstance(t, UploadFinished) and t.vehicle == name]
        assert len(loaded) == len(accepted) > 0
        assert any(isinstance(event, ModeChanged) and event.armed for event in mine)
        (connected,) = [event for event in mine if isinstance(event, Connected)]
        assert connected.stack.name == {"hawk": "px4", "kite": "ardupilot"}[name]
    info = info_of(log)
    assert [each["name"] for each in info["vehicles"]] == ["hawk", "kite"]
    assert info["vehicles"][0]["max_speed_m_s"] > 10.0


@pytest.mark.long
def test_a_folder_is_the_journal_in_it(folder: Path) -> None:
    result = call("log", "info", str(folder))
    assert result.exit_code == 0
    assert "vehicle 2 (kite), ardupilot plane" in result.output


@pytest.mark.long
@settings(max_examples=40, suppress_health_check=list(HealthCheck))
@given(place=st.floats(0.0, 1.0, exclude_max=True), change=st.integers(1, 255))
def test_a_changed_byte_costs_its_line_and_is_reported(
    folder: Path, tmp_path: Path, place: float, change: int
) -> None:
    whole = (folder / "journal.jsonl").read_bytes()
    header = whole.index(b"\n") + 1
    at = header + int(place * (len(whole) - header))
    data = bytearray(whole)
    data[at] ^= change
    path = tmp_path / "journal.jsonl"
    path.write_bytes(data)
    log = JournalLog(path)
    count = sum(1 for _ in log.contents())
    lines = whole.count(b"\n")
    assert len(log.damage) >= 1
    assert log.damage[0].at_byte <= at < log.damage[0].at_byte + log.damage[0].skipped_bytes
    assert lines - 6 <= count < lines


@settings(max_examples=15, suppress_health_check=list(HealthCheck))
@given(place=st.floats(0.0, 1.0))
def test_a_journal_cut_at_any_byte_is_read_up_to_the_cut(
    folder: Path, tmp_path: Path, place: float
) -> None:
    whole = (folder / "journal.jsonl").read_bytes()
    path = tmp_path / "journal.jsonl"
    data = whole[: round(place * len(whole))]
    path.write_bytes(data)
    if b"\n" not in data:
        with pytest.raises(JournalError):
            JournalLog(path)
        return
    log = JournalLog(path)
    assert sum(1 for _ in log.contents()) == data.count(b"\n") - 1
    assert bool(log.damage) == (not data.endswith(b"\n"))
