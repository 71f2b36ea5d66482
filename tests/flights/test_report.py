"""The report: its content agrees with the events, on one self-contained page."""

import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from autopilot_bridge.items import MissionItem
from mission_service.commands import DirectionDecision
from mission_service.config.scenario import load_scenario
from mission_service.events import Telemetry
from mission_service.replay.flights.batch import analysis_of, analysis_with_fire
from mission_service.replay.flights.direction_of_travel import Span, differing, turns
from mission_service.replay.flights.drop_comparison import Done, Planned, compared, planned_in
from mission_service.replay.flights.fire_analysis import circles_one_front, fire_analysis
from mission_service.replay.flights.flight_logs import flight_of
from mission_service.replay.flights.journal_log import JournalLog
from mission_service.replay.flights.report_page import write_report
from mission_service.replay.flights.run_figures import figures_of, table
from mission_service.simulation.sim import simulate
from tests.bridge.log_writers import bin_flight, round_flight
from tests.flights.test_open_loop_replay import level_pairing, scenario
from tests.service.test_cli import call


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a short simulated flight around a ring of fire."""
    folder = tmp_path_factory.mktemp("run")
    flown = scenario(
        duration_s=4300.0,
        weather=[{"at_s": 0, "wind_speed_m_s": 2.0, "wind_from_deg": 200}],
        planner={"rule": "islam_hu_damped", "dwell_s": 20.0},
        vehicles=[
            {"name": "hawk", "home_lat_deg": 36.346, "home_lon_deg": -84.16, "autostart": True}
        ],
    )
    simulate(flown, folder / "journal.jsonl", "today")
    return folder


@pytest.mark.parametrize(
    ("rule", "circles"),
    [("predictive", True), ("team.balanced", True), ("informative", False)],
)
def test_only_flights_around_one_front_have_a_direction_around_the_fire(
    rule: str, circles: bool
) -> None:
    """Two fires have no common middle, and a vehicle in a bay flies both ways around it."""
    assert circles_one_front(load_scenario("team", (f"planner.rule={rule}",))) == circles


def test_the_figures_of_a_run_are_those_of_its_journal(run: Path) -> None:
    story = analysis_of("run", flight_of([str(run)]))
    figures = figures_of(story)
    contents = list(JournalLog(run / "journal.jsonl").contents())
    (hawk,) = figures["vehicles"]
    reversals = [each for each in contents if isinstance(each, DirectionDecision) and each.reversed]
    assert hawk["decided_reversals"] == len(reversals)
    assert hawk["positions"] == sum(isinstance(each, Telemetry) for each in contents)
    assert hawk["missions_sent"] == hawk["accepted"] == len(hawk["missions"]) > 3
    assert 0.0 <= hawk["mission_latency_median_s"] < 2.0
    assert 0.0 < hawk["distance_error_mean_m"] < 100.0
    assert hawk["lowest_above_terrain_m"] > 60.0
    fire = figures["fire"]
    assert 90.0 < fire["seen_pct"] <= 100.0
    assert 100.0 < fire["revisit_median_s"] < 400.0  # a lap takes at least 130 s
    assert fire["area_ha"] > 20.0


def test_estimated_and_true_front_are_compared_as_in_the_paper(run: Path) -> None:
    story = fire_analysis(JournalLog(run / "journal.jsonl"))
    ages = [each.age_worst_s for each in story.samples]
    assert max(ages) > min(ages) >= 0.0
    times = [at_us for at_us, _, _ in story.errors_m["hawk"]]
    assert times == sorted(set(times))
    assert all(0.0 <= mean <= worst for _, mean, worst in story.errors_m["hawk"])


def test_a_report_is_one_page_with_all_its_figures(run: Path, tmp_path: Path) -> None:
    log = tmp_path / "round.bin"
    log.write_bytes(round_flight())
    flown = analysis_with_fire("round", level_pairing(flight_of([str(log)])), None, "today")
    files = write_report(tmp_path, [flown])
    page = (tmp_path / "report.html").read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert "http" not in page
    assert page.count("data:image/png;base64,") == len([f for f in files if f.endswith(".png")])
    assert re.search(r"100\.\d s</td><td>round-1</td><td>turns back: anticlockwise", page)
    assert "No decision was sent to a vehicle" in page
    assert "servo 3 opens" in page
    assert "missions sent" not in page  # an open-loop replay sends none
    (figures,) = json.loads((tmp_path / "figures.json").read_text())
    assert figures["vehicles"][0]["turned_back"][0]["at_s"] == pytest.approx(100.0, abs=1.5)
    for name in files:
        assert (tmp_path / name).stat().st_size > 500


@pytest.mark.long
def test_several_runs_stand_side_by_side(run: Path, tmp_path: Path) -> None:
    stories = [analysis_of(name, flight_of([str(run)])) for name in ("one", "other")]
    files = write_report(tmp_path, stories)
    assert {"map-one.png", "map-other.png", "knowledge.png"} <= set(files)
    sections = table([figures_of(story) for story in stories])
    assert [name for name, _ in sections] == ["Flight and fire", "hawk"]
    for _, rows in sections:
        assert all(len(values) == 2 and values[0] == values[1] for _, _, values in rows)


def test_options_that_no_run_uses_are_refused(run: Path, tmp_path: Path) -> None:
    for option, value in (("--scenario", "demo"), ("--at", "3"), ("--set", "planner.alpha=2")):
        result = call("report", str(run), "--out", str(tmp_path / "out"), option, value)
        assert result.exit_code == 2
        assert f"{option} has no effect" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_path_may_contain_the_sign_that_joins_logs(tmp_path: Path) -> None:
    log = tmp_path / "hawk+kite.bin"
    log.write_bytes(bin_flight())
    result = call("report", str(log), "--out", str(tmp_path / "out"))
    assert result.exit_code == 0, result.output


@pytest.mark.long
def test_a_report_is_the_same_each_time(run: Path, tmp_path: Path) -> None:
    pages = []
    for name in ("a", "b"):
        out = tmp_path / name
        out.mkdir()
        write_report(out, [analysis_of("run", flight_of([str(run)]))])
        pages.append((out / "report.html").read_bytes())
    assert pages[0] == pages[1]


def test_text_of_logs_is_escaped_in_html(tmp_path: Path) -> None:
    log = tmp_path / "<b>x&.bin"
    log.write_bytes(round_flight(end_s=20.0))
    story = analysis_of("<script>alert(1)</script>", flight_of([str(log)]))
    write_report(tmp_path, [story])
    page = (tmp_path / "report.html").read_text()
    assert "<script" not in page
    assert "<b>" not in page


# Ways round ------------------------------------------------------------------------------------


def around(*angles_deg: float, radius_m: float = 500.0) -> tuple[np.ndarray, np.ndarray]:
    angles = np.deg2rad(np.concatenate([np.linspace(a, b, 50) for a, b in _pairs(angles_deg)]))
    return radius_m * np.sin(angles), radius_m * np.cos(angles)


def _pairs(values: tuple[float, ...]) -> list[tuple[float, float]]:
    return list(pairwise(values))


def test_turns_back_are_dated_to_the_outermost_point() -> None:
    found = turns(*around(0.0, 700.0, 400.0, 430.0), 30.0, 10.0)
    assert [(each.point, each.clockwise) for each in found][:2] == [(0, True), (49, False)]
    assert len(turns(*around(0.0, 700.0, 680.0, 900.0), 30.0, 10.0)) == 1  # the turn is too small
    assert turns(np.zeros(0), np.zeros(0), 30.0, 0.0) == []
    assert turns(*around(0.0, 20.0), 30.0, 0.0) == []


def test_cells_near_the_middle_are_inconclusive() -> None:
    east = np.linspace(-500.0, 500.0, 101)  # across the fire and back
    there = np.concatenate([east, east[::-1]])
    assert turns(there, np.full(there.size, 1.0), 60.0, 125.0) == []


def test_when_two_ways_round_differ() -> None:
    flown = [(0, True), (100, False)]
    assert differing(flown, [(0, True)], 150) == [Span(100, 150)]
    assert differing(flown, [(0, None), (120, True), (130, None)], 150) == [Span(120, 130)]
    assert differing(flown, [(20, False), (60, True)], 150) == [Span(20, 60), Span(100, 150)]
    assert differing([], [(0, True)], 150) == []


# Drops -----------------------------------------------------------------------------------------


def item(
    command: int, one: float = 0.0, two: float = 0.0, lat: float = 0.0, lon: float = 0.0
) -> MissionItem:
    return MissionItem(command, 3, round(lat * 1e7), round(lon * 1e7), 20.0, one, two)


def test_drops_belong_to_the_place_flown_to_before() -> None:
    items = (
        item(183, 9.0, 1900.0),  # before the first position
        item(16, lat=36.3, lon=-84.2),
        item(183, 9.0, 1900.0),
        item(16, lat=36.4, lon=-84.2),
        item(211, 1.0, 0.0),
        item(211, 1.0, 1.0),  # the gripper closes
    )
    planned = planned_in(items)
    assert [(each.lat_deg, each.output) for each in planned] == [(36.3, 9), (36.4, 0)]
    done = [Done(5, 36.3001, -84.2, 9, 1890.0), Done(9, 36.3, -84.2, 9, 1100.0)]
    first, second = compared(planned, done)
    assert first.done == done[0]
    assert first.off_m == pytest.approx(11.1, abs=0.1)
    assert second.done is None
    twice = compared([planned[0], planned[0]], done)
    assert [each.done is not None for each in twice] == [True, False]  # the gripper opened once
    unplanned = compared([], [Done(7, 36.4, -84.2, 0, 0.0)])
    assert unplanned[0].planned is None
    assert Planned(36.3, -84.2, 9, 1900.0) == planned[0]
