"""The experiment of Islam & Hu: the flight along the front, the error, the form of its results."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from firemodel.spread.schemes import SchemeName
from mission_service.cli.main import main
from mission_service.experiments.boundary_following import AROUND, BoundaryFollower, enclosed_s
from mission_service.experiments.fires import CELLS, Burn
from mission_service.experiments.islam_hu import run as islam_hu
from mission_service.experiments.islam_hu import scenarios
from mission_service.experiments.islam_hu.ideal_flight import Flight, fly, look
from mission_service.experiments.islam_hu.scenarios import COMPARED, ISLAM_HU, islam_hu_burn
from mission_service.experiments.islam_hu.without_aircraft import (
    front_errors,
    modelled,
    persistent,
)
from mission_service.guidance.fire_map import EAST, NORTH
from mission_service.guidance.front.front_shape import hull_of
from mission_service.guidance.front.islam_hu_planner import Rule
from mission_service.replay.distance_error import TrueShape

CENTRE = (30, 30)
ROWS, COLS = np.indices((61, 61)).astype(float)
DISC_S = np.hypot(ROWS - CENTRE[0], COLS - CENTRE[1]) * 100.0  # one cell every 100 s


def flown(name: str, scheme: SchemeName, rule: Rule, alpha: float = 1.0) -> Flight:
    burn = islam_hu_burn(name, scheme)
    return fly(burn, scenarios.islam_hu_planner(burn, rule, alpha))


# The flight along the front


@pytest.mark.parametrize("clockwise", [True, False])
def test_the_walk_goes_round_a_fire_that_stands_still_and_leaves_out_no_cell(
    clockwise: bool,
) -> None:
    walk = BoundaryFollower(DISC_S, 1000.0)
    visited = [walk.cell]
    while len(visited) == 1 or walk.cell != visited[0]:
        walk.onwards(clockwise, 1000.0)
        visited.append(walk.cell)
    burned = DISC_S <= 1000.0
    for row, col in np.argwhere(burned):
        neighbours = [burned[row + step[0], col + step[1]] for step in AROUND[::2]]
        assert ((row, col) in visited) == (not all(neighbours))
    first_east = visited[1][1] > visited[0][1]
    assert first_east == clockwise  # it begins in the north


def test_the_walk_stays_on_a_front_that_grows() -> None:
    walk = BoundaryFollower(DISC_S, 500.0)
    for at_s in np.arange(500.0, 2500.0, 20.0):
        walk.onwards(True, at_s)
        radius = np.hypot(walk.cell[0] - CENTRE[0], walk.cell[1] - CENTRE[1])
        assert at_s / 100.0 - 1.5 <= radius <= at_s / 100.0


def test_an_unburned_island_belongs_to_the_filled_fire_once_it_is_cut_off() -> None:
    arrival_s = np.full((9, 9), np.inf)
    arrival_s[2, 2:7] = arrival_s[6, 2:7] = arrival_s[2:7, 2] = 10.0
    arrival_s[2:7, 6] = 50.0  # closes the ring
    filled = enclosed_s(arrival_s)
    assert (filled[3:6, 3:6] == 50.0).all()
    assert filled[4, 2] == 10.0
    assert np.isinf(filled[0, 0])


# The error


def test_the_true_shape_of_a_disc_is_its_radius() -> None:
    shape = TrueShape(DISC_S, CENTRE)
    assert shape.distances_at(1500.0) == pytest.approx(np.full(360, 15.0), abs=1.0)


def test_the_hull_bridges_a_dent_by_a_straight_line() -> None:
    """A square with corners (±10, ±10) has a dent in its northern side."""
    square = 10.0 / np.maximum(np.abs(NORTH), np.abs(EAST))
    dented = square.copy()
    dented[:44] = dented[317:] = 4.0
    assert hull_of(square) == pytest.approx(square)
    hull = hull_of(dented)
    assert hull[0] == pytest.approx(10.0, abs=0.25)  # from bearing 316° to 44°
    assert hull[44:317] == pytest.approx(square[44:317])


def test_the_error_is_what_a_part_of_the_front_has_grown_since_it_was_seen() -> None:
    """A disc grows by 0.01 cells a second, and the vehicle flies around it at 0.5 cells a second.

    The vehicle observes a width of three cells, so that the age of the estimated front is at most
    the time of a lap: 2 π 24 / 0.5 s, which is 3 cells of growth.
    """
    burn = islam_hu_burn("slow-even", "anyangle")
    disc = Burn(
        "disc", "anyangle", burn.landscape, burn.weather, CENTRE, 1500.0, 2700.0, 15.0, DISC_S
    )
    flight = fly(disc, scenarios.islam_hu_planner(disc, "circling"))
    assert flight.max_error[-200:].mean() == pytest.approx(3.0, abs=1.2)
    assert (flight.mean_error < flight.max_error).all()


def test_without_aircraft_the_front_stays_or_is_the_model_with_the_first_wind() -> None:
    even = islam_hu_burn("slow-even", "anyangle")
    disc = Burn(
        "disc", "anyangle", even.landscape, even.weather, CENTRE, 1500.0, 2700.0, 15.0, DISC_S
    )
    errors = front_errors(persistent(disc), disc, np.array([1500.0, 2500.0]))
    assert errors.shape == (2, 360)
    assert (errors[0] == 0.0).all()
    assert errors[1] == pytest.approx(np.full(360, 10.0), abs=1.0)
    burn = islam_hu_burn("slow-then-fast", "anyangle")
    before_s, after_s = scenarios.changes_s(burn), burn.end_s
    errors = front_errors(modelled(burn), burn, np.array([before_s, after_s]))
    assert errors[0].max() == 0.0
    assert errors[1].max() > 10.0


def test_the_camera_sees_a_disc_of_cells_and_stops_at_the_edge() -> None:
    burn = islam_hu_burn("fast", "devs8")
    seen = look(burn, 0, CELLS - 1, 0.0)
    assert (seen.row, seen.col) == (0, CELLS - 5)
    assert seen.cells == (".uuuu", "..uuu", "..uuu", "....u", ".....")


# The fires and the rules that are flown


@pytest.mark.parametrize("scheme", COMPARED)
@pytest.mark.parametrize("name", list(ISLAM_HU))
def test_the_fires_are_large_and_reach_no_edge(name: str, scheme: SchemeName) -> None:
    burned = islam_hu_burn(name, scheme).burned(6 * 3600.0)
    assert burned[1:-1, 1:-1].sum() == burned.sum()
    rows, cols = np.nonzero(burned)
    assert max(np.ptp(rows), np.ptp(cols)) >= 0.45 * CELLS


def test_reversals_rise_with_alpha() -> None:
    counts = [
        len(flown("slow-then-fast", "devs8", "islam_hu_damped", alpha).reversals)
        for alpha in (0.0, 1.0, 5.0)
    ]
    assert counts[0] == 0
    assert counts == sorted(set(counts))
    assert 20 <= counts[-1] < 100


def test_a_slow_even_fire_is_circled() -> None:
    flight = flown("slow-even", "devs8", "islam_hu_damped")
    assert len(flight.reversals) == 0
    assert 7.0 <= flight.max_error.mean() <= 16.0


def test_attention_goes_south_with_the_wind() -> None:
    burn = islam_hu_burn("wind-turns", "devs8")
    flight = fly(burn, scenarios.islam_hu_planner(burn, "islam_hu_damped"))
    found = islam_hu.attention(burn, flight)
    assert found["time_north_before"] > 0.8
    assert found["time_north_after"] < 0.45
    circled = islam_hu.attention(burn, fly(burn, scenarios.islam_hu_planner(burn, "circling")))
    assert found["time_north_after"] < circled["time_north_after"]


@pytest.mark.parametrize(
    ("name", "turns_when"),
    [("brush-grass", "reversals_after"), ("brush-litter", "reversals_before")],
)
def test_it_goes_back_and_forth_in_the_fast_fuel_only(name: str, turns_when: str) -> None:
    burn = islam_hu_burn(name, "anyangle")
    found = islam_hu.attention(burn, fly(burn, scenarios.islam_hu_planner(burn, "islam_hu_damped")))
    turns = {key: found[key] for key in ("reversals_before", "reversals_after")}
    assert turns.pop(turns_when) > 0
    assert list(turns.values()) == [0]


def test_the_damped_rule_is_as_far_below_circling_as_the_papers() -> None:
    damped = flown("slow-then-fast", "anyangle", "islam_hu_damped").max_error.mean()
    circling = flown("slow-then-fast", "anyangle", "circling").max_error.mean()
    assert damped <= (1.0 - 0.14) * circling


# The command


@pytest.mark.long
def test_the_command_prints_json_with_figures_and_the_same_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(islam_hu, "ALPHAS", (0.0, 1.0))
    monkeypatch.setattr(scenarios, "ISLAM_HU_END_S", 2.5 * 3600.0)
    found = islam_hu.on_one_fire("fast", "devs8", tmp_path)
    assert {path.name.split("-")[0] for path in tmp_path.glob("*-fast-devs8.png")} == {
        "trajectory",
        "error",
        "importance",
    }
    assert [(row["alpha"], row["scenario"]) for row in found["alpha_sweep"]] == [
        (0.0, "fast"),
        (1.0, "fast"),
    ]
    assert {row["planner"] for row in found["distance_error"]} >= {
        "circling",
        "islam_hu",
        "islam_hu_damped",
        "persistence",
        "model",
    }
    assert json.loads(json.dumps(found)) == islam_hu.on_one_fire("fast", "devs8", None)


@pytest.mark.parametrize("as_json", [True, False])
def test_the_command_prints_tables_or_json(as_json: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    row = {"scenario": "fast", "scheme": "anyangle"}
    found = {
        "alpha_sweep": [{**row, "alpha": alpha, "reversals": 7} for alpha in scenarios.ALPHAS],
        "distance_error": [
            {**row, "planner": planner, "mean_max_cells": cells, "mean_mean_cells": 1.0}
            for planner, cells in (("circling", 10.0), ("islam_hu_damped", 8.5))
        ],
        "attention": [
            {
                **row,
                "changes_h": 3.0,
                "reversals_before": 1,
                "reversals_after": 2,
                "time_north_before": 0.5,
                "time_north_after": 0.25,
            }
        ],
    }
    monkeypatch.setattr(islam_hu, "run", lambda out, progress: found)
    result = CliRunner().invoke(
        main, ["experiment", "islam-hu", *(["--json"] if as_json else [])], catch_exceptions=False
    )
    if as_json:
        assert json.loads(result.output) == found
    else:
        assert "8.5 (-15 %)" in result.output
        assert "12.2 (-23 %)" in result.output  # the fire of the paper
        assert "1 → 2    50% → 25%" in result.output
