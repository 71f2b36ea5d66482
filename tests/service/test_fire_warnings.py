"""Warnings about the scenario and the edge, in commands, journal, state, restart and report."""

import json
from pathlib import Path

import pytest

from mission_service.events import SERVICE, FireReachedEdge
from mission_service.journal.journal_file import SegmentReader
from mission_service.journal.reader import JournalReader
from mission_service.replay.flights.batch import analysis_of
from mission_service.replay.flights.flight_logs import flight_of
from mission_service.replay.flights.report_page import write_report
from mission_service.replay.flights.run_figures import figures_of, in_text
from mission_service.replay.verification import verify
from mission_service.replay.what_if import past_run
from mission_service.runtime.state_view import OF_FIRE
from tests.service.test_cli import call
from tests.service.test_refused_events import with_line

SCENARIO = """\
name = "small"
duration_s = 500
start_s = 200
[landscape]
source = "flat"
rows = 30
cols = 30
lat_deg = 36.35
lon_deg = -84.16
[[weather]]
at_s = 0
wind_speed_m_s = 3
wind_from_deg = 180
dead_1h_pct = {dead_1h_pct}
[[ignition]]
lat_deg = {lat_deg}
lon_deg = -84.16
[planner]
rule = "circling"
[[vehicles]]
name = "hawk"
stack = "ardupilot"
home_lat_deg = 36.35
home_lon_deg = -84.16
autostart = true
landing = false
"""
FRACTION = "weather entry 0: dead_1h_pct = 0.06 %: probably a fraction; specify it in percent (6)"
NORTH = "the fire reached the edge of the landscape at 0:"


def scenario(folder: Path, dead_1h_pct: float = 6.0, lat_deg: float = 36.353) -> Path:
    path = folder / "small.toml"
    path.write_text(SCENARIO.format(dead_1h_pct=dead_1h_pct, lat_deg=lat_deg))
    return path


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return the folder and announcements of a flight in which the fire reaches the edge."""
    folder = tmp_path_factory.mktemp("edge")
    found = call("sim", str(scenario(folder, dead_1h_pct=0.06)), "--out", str(folder), "--json")
    assert found.exit_code == 0, found.output
    return folder, found.stderr


def reports(journal: Path) -> list[FireReachedEdge]:
    entries = [entry.content for entry in SegmentReader(journal)]
    return [each for each in entries if isinstance(each, FireReachedEdge)]


def test_a_simulation_announces_each_warning_once(flown: tuple[Path, str]) -> None:
    folder, progress = flown
    assert progress.count(FRACTION) == 1
    assert progress.count(NORTH) == 1
    assert json.loads((folder / "summary.json").read_text())["alarms"] == {"edge": 1, "input": 1}


def test_the_journal_has_the_first_time_at_which_the_edge_burns(flown: tuple[Path, str]) -> None:
    journal = flown[0] / "journal.jsonl"
    (event,) = reports(journal)
    assert (event.by, event.station, event.may_approve) == (SERVICE, "", False)
    assert event.at_us - 61_100_000 <= event.arrived_at_us <= event.at_us  # one check a minute
    past = past_run(JournalReader(journal))
    fire, landscape = past.estimate.fire, past.estimate.landscape
    row, _ = landscape.cell_of_lat_lon(event.lat_deg, event.lon_deg)
    assert row == 0
    # Later images may have set an earlier time.
    assert event.arrived_at_us >= round(float(fire.arrival_time_s[0].min()) * 1e6)
    assert past.state_view.alarms["edge"].at_us == event.at_us
    assert past.state_view.alarms["edge"].text.startswith(NORTH)
    assert past.requests == []
    assert not past.record.requests


def test_a_replay_verifies_the_arrival_at_the_edge(flown: tuple[Path, str], tmp_path: Path) -> None:
    journal = flown[0] / "journal.jsonl"
    assert verify(journal).difference is None
    changed = tmp_path / "journal.jsonl"
    changed.write_bytes(journal.read_bytes())
    line = next(e.line for e in SegmentReader(changed) if isinstance(e.content, FireReachedEdge))
    with_line(changed, line, lambda text: text.replace(b'"arrived_at_us":', b'"arrived_at_us":1'))
    found = verify(changed)
    assert found.differing == ["fire"]
    assert "the recorded estimate reaches the edge at 1" in str(found.difference)


def test_the_report_lists_the_warnings(flown: tuple[Path, str], tmp_path: Path) -> None:
    analysis = analysis_of("run", flight_of([str(flown[0])]))
    write_report(tmp_path, [analysis])
    page = (tmp_path / "report.html").read_text()
    assert f"Warning: {FRACTION}" in page
    assert f"Warning: {NORTH}" in page
    assert f"<td>fire</td><td>{NORTH}" in page
    figures = figures_of(analysis)
    assert [line[:10] for line in figures["fire"]["warnings"]] == [FRACTION[:10], NORTH[:10]]
    assert f"Warning: {FRACTION}" in in_text([figures])


def test_config_check_reports_warnings_and_succeeds(tmp_path: Path) -> None:
    path = str(scenario(tmp_path, dead_1h_pct=0.06))
    found = call("config", "check", path)
    assert (found.exit_code, found.stderr) == (0, f"Warning: {FRACTION}\n")
    assert "warnings:" not in found.stdout
    found = call("config", "check", path, "--json")
    assert json.loads(found.stdout)["warnings"] == [FRACTION]
    found = call("config", "check", str(scenario(tmp_path)))
    assert (found.exit_code, found.stderr) == (0, "")


def test_fire_run_reports_warnings_and_keeps_them_in_its_summary(tmp_path: Path) -> None:
    path = str(scenario(tmp_path, dead_1h_pct=0.06))
    found = call("fire", "run", path, "-o", str(tmp_path / "out"))
    assert found.exit_code == 0, found.output
    first, second = found.stderr.splitlines()
    assert first == f"Warning: {FRACTION}"
    assert second.startswith(f"Warning: {NORTH}")
    assert "warnings:" not in found.stdout
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["reached_edge"]
    assert [line[:10] for line in summary["warnings"]] == [FRACTION[:10], NORTH[:10]]


def test_a_restart_keeps_the_alarms_about_the_fire(flown: tuple[Path, str]) -> None:
    view = past_run(JournalReader(flown[0] / "journal.jsonl")).state_view
    view.alarm("broker", "no broker")
    view.alarm("input/1", FRACTION)
    view.clear_all_but("abort", *OF_FIRE)
    assert set(view.alarms) == {"edge", "input/1"}
