"""Compiles the planners' kernels before flight; the first compilation takes many seconds."""

import math

import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.events import EstimatedFront, FrontsEstimated, Observed
from mission_service.fire.scenario_fire import fire_position
from mission_service.guidance.front.way import Planners
from mission_service.guidance.protocol import ReadsFronts
from mission_service.missions.separation import Track, heights_below

FIRE_CELLS, OFF_CELLS, VIEW_CELLS = 6, 8, 6
LAP_STEPS, LAPS = 48, 1.6
STEP_S = 20.0
FRONTS_EVERY = 8  # steps between new fronts
ENOUGH = 2  # number of vehicles with which every kernel is called


def warm_up(planners_of: Planners, scenario: Scenario, landscape: Landscape) -> None:
    """Run temporary planners for more than one lap around a circular fire.

    The circular fire is at the position of the scenario's fire. Each kernel of the rule is called
    at least once, which compiles the kernel or loads it from the disk cache.
    """
    heights_below(np.zeros((1, 2)), [Track(np.zeros((1, 2)), np.zeros(1), np.zeros(1))])
    few = scenario.model_copy(update={"vehicles": scenario.vehicles[:ENOUGH]})
    planners = planners_of(few, landscape)
    rows, cols = landscape.shape
    middle = landscape.row_col_of(*fire_position(scenario, landscape))
    middle_row, middle_col = (round(float(value)) for value in middle)
    for step in range(round(LAPS * LAP_STEPS)):
        at_s = scenario.start_s + step * STEP_S
        reach = FIRE_CELLS + step // 16
        for number, (name, planner) in enumerate(planners.items()):
            turned = math.tau * (step / LAP_STEPS + number / len(planners))
            row = middle_row - (reach + OFF_CELLS - FIRE_CELLS) * math.cos(turned)
            col = middle_col + (reach + OFF_CELLS - FIRE_CELLS) * math.sin(turned)
            top, left = max(round(row) - VIEW_CELLS, 0), max(round(col) - VIEW_CELLS, 0)
            seen_rows, seen_cols = np.mgrid[
                top : min(top + 2 * VIEW_CELLS + 1, rows),
                left : min(left + 2 * VIEW_CELLS + 1, cols),
            ]
            burns = np.hypot(seen_rows - middle_row, seen_cols - middle_col) <= reach
            cells = tuple("".join(line) for line in np.where(burns, "b", "u"))
            planner.wind(4.0, 45.0, at_s)
            if isinstance(planner, ReadsFronts) and step % FRONTS_EVERY == 0:
                planner.on_fronts(_two_fronts(name, at_s, middle_row, middle_col, reach))
            planner.observe(Observed(round(at_s * 1e6), name, top, left, cells))
            if step == 0:  # a window of one cell, for which Numba compiles kernels again
                planner.observe(Observed(round(at_s * 1e6), name, top, left, (cells[0][0],)))
                planner.correct(Observed(round(at_s * 1e6), name, top, left, cells))
            planner.at(row, col, at_s)
            planner.shape(row, col)
            planner.path(row, col)


def _two_fronts(name: str, at_s: float, row: int, col: int, radius: int) -> FrontsEstimated:
    """Return an event with a circular front and, beside it, another of half the size."""
    fronts = []
    for centre, size in ((col, float(radius)), (col + 4 * radius, radius / 2.0)):
        angle = np.linspace(0.0, math.tau, round(math.tau * size), endpoint=False)
        rows, cols = row - size * np.cos(angle), centre + size * np.sin(angle)
        speeds = (0.1,) * angle.size
        listed = tuple(rows.tolist()), tuple(cols.tolist()), speeds, speeds, (900.0,) * angle.size
        fronts.append(EstimatedFront(False, *listed))
    return FrontsEstimated(round(at_s * 1e6), name, tuple(fronts))
