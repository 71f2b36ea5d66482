"""Operators' orders, corrections and approvals, flown in virtual time."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from firemodel.assimilation import corrected_cells
from firemodel.errors import FireModelError
from firemodel.landscape.rasterise import cells_of
from mission_service.commands import (
    Announce,
    AnyCommand,
    Hold,
    ProposeMission,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.events import (
    Aborted,
    AnyEvent,
    Corrected,
    Erased,
    MissionAccepted,
    MissionRefused,
    MissionRequested,
    Observed,
    OrderGiven,
    Place,
    Redone,
    SettingsChanged,
    Undone,
    WindSet,
)
from mission_service.fire.corrected_fire import MAX_OBSERVATIONS, thinned
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.front.islam_hu_planner import PerimeterPlanner
from tests.service.people_flights import ANN, Flight, Fly, flights_in


@pytest.fixture
def fly(tmp_path: Path) -> Iterator[Fly]:
    yield from flights_in(tmp_path)


def commands(entries: list[AnyEvent | AnyCommand], kind: type[AnyCommand]) -> list[AnyCommand]:
    return [each for each in entries if isinstance(each, kind)]


def around(flight: Flight, row: float, col: float, half_m: float) -> tuple[Place, ...]:
    x_m, y_m = (float(value) for value in flight.landscape.xy_of(row, col))
    corners = ((-1, -1), (-1, 1), (1, 1), (1, -1))
    places = [(x_m + dx * half_m, y_m + dy * half_m) for dx, dy in corners]
    return tuple(tuple(map(float, flight.landscape.lat_lon_of(*place))) for place in places)  # type: ignore[misc]


def test_hold_resume_return_and_abort_are_obeyed_and_replay(fly: Fly) -> None:
    flight = fly()
    flight.run(400.0)
    assert flight.mode == "mission"
    assert flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", "hold")) == ["hold ordered by ann"]
    uploads = flight.state_view.vehicles["hawk"].uploads_accepted
    flight.run(120.0)
    assert flight.mode == "hold"
    assert flight.state_view.vehicles["hawk"].order == "hold"
    assert flight.state_view.vehicles["hawk"].uploads_accepted <= uploads + 1
    flight.submit(OrderGiven(flight.now_us, *ANN, "", "resume"))
    flight.run(60.0)
    assert flight.mode == "mission"
    assert flight.state_view.vehicles["hawk"].order == ""
    flight.submit(Aborted(flight.now_us, "", ""))
    flight.run(30.0)
    assert flight.mode == "hold"
    assert flight.state_view.alarms["abort"].severity == "severe"
    flight.submit(OrderGiven(flight.now_us, *ANN, "", "resume"))
    assert "abort" not in flight.state_view.alarms
    flight.run(60.0)
    assert flight.mode == "mission"
    flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", "return"))
    flight.run(60.0)
    assert flight.mode == "return"
    flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", "resume"))
    flight.run(60.0)
    assert flight.mode == "mission"
    flight.over()


def test_a_hold_is_sent_again_until_the_autopilot_accepts(fly: Fly) -> None:
    flight = fly("link.loss=0.4")
    flight.run(400.0)
    flight.submit(Aborted(flight.now_us, "", ""))
    flight.run(60.0)
    assert flight.mode == "hold"
    flight.over()


@pytest.mark.parametrize(
    "rule",
    [
        "predictive",
        pytest.param("islam_hu_damped", marks=pytest.mark.long),
        pytest.param("team.balanced", marks=pytest.mark.long),
    ],
)
def test_a_correction_moves_fire_and_mission_and_an_undo_takes_it_back(fly: Fly, rule: str) -> None:
    flight = fly(rule=rule)
    flight.run(900.0)
    before = flight.sim.estimate.fire.burned().copy()
    assert flight.sim.cameras is not None
    true = flight.sim.cameras.fire.fire.burned()
    row, col = np.argwhere(true).max(axis=0).tolist()  # the south-east end
    places = around(flight, row + 4.0, col + 4.0, 150.0)
    drawn = Corrected(flight.now_us, *ANN, "burned", "polygon", places, flight.now_us)
    flight.submit(drawn)
    after = flight.sim.estimate.fire.burned()
    assert after[row + 4, col + 4]
    assert not before[row + 4, col + 4]
    drawn_cells = after[row : row + 9, col : col + 9]
    assert drawn_cells.all(), "all that was drawn, without holes"
    flight.run(5.0)
    planner = flight.sim.core.decision_engine.planners["hawk"]
    assert isinstance(planner, PerimeterPlanner) or rule != "islam_hu_damped"
    shape = planner.shape(row, col)  # type: ignore[attr-defined]
    assert flight.sim.estimate.corrections()[0]["by"] == "ann"
    mission_view = flight.state_view.missions["hawk"]
    mission = mission_view.sending or mission_view.on_board
    assert mission is not None
    assert mission.at_us >= drawn.at_us, "the mission was renewed at once"
    flight.submit(Undone(flight.now_us, *ANN))
    assert not flight.sim.estimate.fire.burned()[row + 4, col + 4]
    assert not flight.sim.estimate.corrections()
    back = planner.shape(row, col)  # type: ignore[attr-defined]
    assert (shape - back).max() > 3.0, "the planner has it as it was"
    undone_us = flight.now_us
    flight.submit(Redone(undone_us, *ANN))
    assert flight.sim.estimate.fire.burned()[row + 4, col + 4]
    flight.run(60.0)
    seen = [each for each in flight.over() if isinstance(each, Observed) and each.corrects]
    reports = [each for each in seen if each.at_us in (drawn.at_us, undone_us)]
    assert len(reports) == 3 * len(flight.scenario.vehicles)
    # Later images remove areas that they contradict, because the simulated fire does not burn
    # there.
    assert all(each.at_us > undone_us for each in seen if each not in reports)


@pytest.mark.long
def test_ground_reported_unburned_and_erasures_and_wind(fly: Fly) -> None:
    flight = fly()
    flight.run(400.0)
    flight.sim.estimate._end_period(flight.now_us)  # a report would end it, too
    flight.sim.estimate._fold_all()
    flight.sim.estimate.advance(flight.now_us)
    burned = np.argwhere(flight.sim.estimate.fire.burned())
    row, col = burned.max(axis=0).tolist()
    north = int(burned[:, 0].min())
    places = around(flight, (row + north) / 2, col, 120.0)
    now = flight.now_us
    flight.submit(Corrected(now, *ANN, "unburned", "polygon", places, now))
    assert not flight.sim.estimate.fire.burned()[round((row + north) / 2), col]
    lat, lon = flight.landscape.lat_lon_of(*flight.landscape.xy_of((row + north) / 2, float(col)))
    flight.submit(Erased(now, *ANN, float(lat), float(lon), 400.0))
    assert np.array_equal(np.argwhere(flight.sim.estimate.fire.burned()), burned)
    flight.submit(WindSet(now, *ANN, 12.0, 270.0))
    weather = flight.sim.estimate.fire.weather.weather_at(flight.now_s)
    assert (weather.wind_speed_m_s, weather.wind_from_deg) == (12.0, 270.0)
    # The wind does not affect the simulated fire, so images would stop the growth of the estimate.
    without_images = flight.sim.estimate.fire.copy()
    without_images.advance(flight.now_s + 900.0)
    grown = np.argwhere(without_images.burned()).max(axis=0)
    assert grown[1] > col + 10, "it runs east before the wind"
    flight.run(900.0)
    bow_tie = (places[0], places[2], places[1], places[3])
    crossed = Corrected(now, *ANN, "burned", "polygon", bow_tie, now)
    with pytest.raises(FireModelError, match="crosses itself"):
        flight.submit(crossed)
    flight.over()


def test_missions_wait_for_approval_where_configured(fly: Fly) -> None:
    flight = fly('mission.approval="each"')
    flight.run(30.0)
    first = flight.state_view.missions["hawk"].proposed
    assert first is not None
    assert flight.state_view.missions["hawk"].on_board is None
    wrong = MissionAccepted(flight.now_us, *ANN, "hawk", "0" * 64)
    assert flight.submit(wrong) == [
        "rejected: this mission is no longer proposed; reload the proposal"
    ]
    accept = MissionAccepted(flight.now_us, *ANN, "hawk", first.mission_hash)
    assert "accepted by ann" in flight.submit(accept)[0]
    flight.run(60.0)
    assert (
        flight.state_view.missions["hawk"].on_board == flight.state_view.missions["hawk"].on_board
    )
    on_board = flight.state_view.missions["hawk"].on_board
    assert on_board is not None
    assert on_board.mission_hash == first.mission_hash
    assert flight.mode == "mission"
    flight.submit(MissionRequested(flight.now_us, *ANN, "hawk"))
    flight.run(5.0)
    second = flight.state_view.missions["hawk"].proposed
    assert second is not None
    flight.submit(MissionRefused(flight.now_us, *ANN, "hawk", second.mission_hash))
    assert flight.state_view.missions["hawk"].proposed is None
    refused_hash = second.mission_hash
    flight.run(20.0)  # in the meantime it reaches the front, so another mission is due
    third = flight.state_view.missions["hawk"].proposed
    assert third is None or third.mission_hash != refused_hash
    assert third is None or "different from the mission that ann refused" in third.why
    flight.run(300.0)
    lapsed = flight.state_view.missions["hawk"].proposed
    assert lapsed is not None
    entries = flight.over()
    assert len(commands(entries, UploadMission)) == 1
    proposed = commands(entries, ProposeMission)
    assert len(proposed) > 3, "what waits too long is proposed again"
    announced = [each.text for each in commands(entries, Announce)]
    waits = [text for text in announced if "waits for approval" in text]
    # The first, the requested one, and those after a refusal; none that replaces another.
    assert waits[0] == "mission 1 waits for approval: fly to the fire"
    assert 3 <= len(waits) < len(proposed)
    assert len(commands(entries, StartMission)) == 1


def test_settings_are_passed_to_planners_that_have_them(fly: Fly) -> None:
    flight = fly()
    messages = flight.submit(SettingsChanged(flight.now_us, *ANN, alpha=2.5, dwell_s=50.0))
    assert messages == ["settings by ann: alpha = 2.5, dwell_s = 50"]
    planner = flight.sim.core.decision_engine.planners["hawk"]
    assert isinstance(planner, PerimeterPlanner)
    assert (planner.settings.alpha, planner.settings.dwell_s) == (2.5, 50.0)
    flight.over()
    team = fly(rule="team.balanced")
    assert "none was changed" in team.submit(SettingsChanged(team.now_us, *ANN, alpha=2.5))[0]


def test_an_abort_before_it_was_found_keeps_a_vehicle_on_the_ground(fly: Fly) -> None:
    flight = fly()
    flight.submit(Aborted(flight.now_us, "", ""))
    flight.run(60.0)
    entries = flight.over()
    for kind in (Hold, StartMission, UploadMission):
        assert not commands(entries, kind), "it stands: there is nothing to hold"
    texts = [each.text for each in entries if isinstance(each, Announce)]
    assert "aborted by unknown" not in texts


def test_a_stroke_costs_the_same_however_many_places_it_has() -> None:
    marks = np.column_stack([np.arange(45_000.0)] * 4)
    few = thinned(marks)
    assert len(few) == MAX_OBSERVATIONS
    assert (few[0] == marks[0]).all()
    assert (few[-1] == marks[-1]).all()
    assert (np.diff(few[:, 0]) > 0.0).all()
    assert len(thinned(marks[:7])) == 7


def test_a_drawn_area_is_as_drawn_though_few_of_its_marks_are_fitted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The time of a fit of all marks would grow with the cube of their number."""
    scenario = load_scenario("demo")
    landscape = landscape_of(scenario)
    world = RunEstimate(scenario, landscape)
    world.advance(round(scenario.start_s * 1e6))
    fitted: list[int] = []

    whole = corrected_cells.corrected_arrival

    def counted(arrival_s: Any, land: Any, marks: Any) -> Any:
        fitted.append(len(marks))
        return whole(arrival_s, land, marks)

    monkeypatch.setattr(corrected_cells, "corrected_arrival", counted)
    rows, cols = landscape.shape
    corners = [(rows * 0.4, cols * 0.4), (rows * 0.4, cols * 0.7), (rows * 0.7, cols * 0.6)]
    points = tuple(
        (float(lat), float(lon))
        for lat, lon in (landscape.lat_lon_of(*landscape.xy_of(*each)) for each in corners)
    )
    at_us = round(scenario.start_s * 1e6)
    world.apply_report(Corrected(at_us, "ann", "", "burned", "polygon", points, at_us))
    assert fitted == [MAX_OBSERVATIONS]
    burned = np.isfinite(world.fire.arrival_time_s)
    inside = cells_of([shapely.Polygon(landscape.xy_of_places(points))], landscape)
    assert len(inside) > 500
    assert burned[tuple(inside.T)].all()
