"""The planner flies over a fire that it observes only by its camera; ideal motion, no MAVLink."""

from dataclasses import replace

import numpy as np
import pytest

from mission_service.events import Observed
from mission_service.guidance.front.front_path import PathSettings
from mission_service.guidance.front.islam_hu_planner import PerimeterPlanner, PerimeterSettings

SIZE = 161
CENTRE = (80.0, 80.0)
SETTINGS = PerimeterSettings(
    rule="islam_hu_damped",
    alpha=1.0,
    clockwise_first=True,
    ignition_known=True,
    baseline_s=300.0,
    smoothing_deg=10,
    reversal_margin=0.1,
    min_gain_cells=0.3,
    dwell_s=120.0,
    speed_cells_s=0.4,
    path=PathSettings(horizon_cells=80.0, lookahead_cells=3.0),
)
ROWS, COLS = np.indices((SIZE, SIZE)).astype(float)


class Ellipse:
    """A fire that spreads as an ellipse, with its ignition in the rear focus, to the south."""

    def __init__(self, head_cells_s: float, eccentricity: float) -> None:
        self.head_cells_s = head_cells_s
        self.eccentricity = eccentricity
        south, east = ROWS - CENTRE[0], COLS - CENTRE[1]
        distance = np.hypot(south, east)
        cosine = np.divide(south, distance, out=np.ones_like(south), where=distance > 0)
        rate = head_cells_s * (1 - eccentricity) / (1 - eccentricity * cosine)
        self.arrival_s = distance / rate

    def look(self, row: float, col: float, at_s: float, radius: float = 6.0) -> Observed:
        top, left = int(row) - 7, int(col) - 7
        window = np.s_[top : top + 15, left : left + 15]
        codes = np.where(self.arrival_s[window] <= at_s, "b", "u")
        far = np.hypot(ROWS[window] - row, COLS[window] - col) > radius
        codes[far] = "."
        cells = tuple("".join(line) for line in codes)
        return Observed(round(at_s * 1e6), "hawk", top, left, cells)


def fly(
    fire: Ellipse, settings: PerimeterSettings, from_s: float, to_s: float
) -> tuple[PerimeterPlanner, list[float], list[float]]:
    """Fly the planner's paths; return planner, times of reversals, distances to the front."""
    planner = PerimeterPlanner(settings, (SIZE, SIZE), CENTRE, ignited_at_s=0.0)
    row, col = CENTRE[0] - 30.0, CENTRE[1] + 3.0
    reversals, off_front = [], []
    at_s = from_s
    while at_s < to_s:
        planner.observe(fire.look(row, col, at_s))
        decision = planner.at(row, col, at_s)
        if decision is not None and decision.reversed:
            reversals.append(at_s)
        if planner.phase == "approach":
            goal = np.array(CENTRE)
        else:
            path = planner.path(row, col)
            goal = path[0] if len(path) else np.array(CENTRE)
        if planner.phase == "monitor":
            burned = fire.arrival_s <= at_s
            off_front.append(
                float(np.hypot(ROWS - row, COLS - col)[burned].min())
                if not burned[round(row), round(col)]
                else float(np.hypot(ROWS - row, COLS - col)[~burned].min())
            )
        step = goal - (row, col)
        step *= settings.speed_cells_s * 2.0 / max(np.hypot(*step), 1e-9)
        row, col, at_s = row + step[0], col + step[1], at_s + 2.0
    return planner, reversals, off_front


FAST = Ellipse(head_cells_s=0.008, eccentricity=0.85)
EVEN = Ellipse(head_cells_s=0.003, eccentricity=0.1)


def test_it_finds_the_front_circles_once_and_then_monitors() -> None:
    planner, _, off_front = fly(EVEN, SETTINGS, 3600.0, 9000.0)
    assert planner.phase == "monitor"
    assert planner.map.complete
    assert max(off_front) < 5.0


def test_it_stays_on_the_front_of_a_long_fast_fire() -> None:
    _, _, off_front = fly(FAST, SETTINGS, 3600.0, 9000.0)
    assert np.mean(off_front) < 2.0
    assert max(off_front) < 8.0


def test_an_even_fire_is_circled() -> None:
    _, reversals, _ = fly(EVEN, SETTINGS, 3600.0, 9000.0)
    assert reversals == []


def test_alpha_zero_never_turns_back() -> None:
    _, reversals, _ = fly(FAST, replace(SETTINGS, alpha=0.0), 3600.0, 9000.0)
    assert reversals == []


def test_a_large_alpha_turns_back_again_and_again() -> None:
    _, reversals, _ = fly(FAST, replace(SETTINGS, alpha=5.0), 3600.0, 9000.0)
    assert 2 <= len(reversals) < 5400 / SETTINGS.dwell_s


def test_circling_never_turns_back() -> None:
    settings = replace(SETTINGS, rule="circling", alpha=5.0)
    assert fly(FAST, settings, 3600.0, 9000.0)[1] == []


def test_the_literal_rule_turns_more_often_than_the_damped_one() -> None:
    settings = replace(SETTINGS, alpha=5.0)
    damped = fly(FAST, settings, 3600.0, 7200.0)[1]
    literal = fly(FAST, replace(settings, rule="islam_hu"), 3600.0, 7200.0)[1]
    assert len(literal) > 2 * len(damped)


def test_turns_keep_their_distance_in_time() -> None:
    reversals = fly(FAST, replace(SETTINGS, alpha=5.0), 3600.0, 9000.0)[1]
    assert min(np.diff(reversals)) >= SETTINGS.dwell_s


def test_where_the_ignition_is_unknown_the_centre_of_the_fire_takes_its_place() -> None:
    settings = replace(SETTINGS, ignition_known=False)
    planner, _, _ = fly(FAST, settings, 3600.0, 7200.0)
    assert planner.phase == "monitor"
    # The centre of the ellipse is south of the ignition.
    assert planner.map.centre_row > CENTRE[0] + 5.0
    assert planner.map.centre_col == pytest.approx(CENTRE[1], abs=2.5)
