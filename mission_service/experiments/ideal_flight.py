"""One vehicle flown ideally over a fire that is already burned: no autopilot, no wind, no MAVLink.

As in Islam & Hu it goes from cell to cell of the front at a steady speed, turns on the spot, and
sees the cells around it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_service.events import Observed
from mission_service.experiments.distance_error import TrueShape, hull_of
from mission_service.experiments.fires import Burn
from mission_service.planners.protocol import Planner

Floats = NDArray[np.float64]

VIEW_CELLS = 3.0
VEHICLE = "uas"


@dataclass(frozen=True)
class Flight:
    """What a flight leaves.

    ``track`` (n, 3) holds time in s, row and column of all steps, ``reversals`` (k, 3) those of
    turns. The errors, in cells, are taken at each step (m) from the end of the first lap on.
    """

    track: Floats
    reversals: Floats
    at_s: Floats
    max_error: Floats
    mean_error: Floats


def look(burn: Burn, row: float, col: float, at_s: float) -> Observed:
    """What the vehicle's camera sees: the cells within ``VIEW_CELLS``."""
    rows, cols = burn.arrival_s.shape
    reach = int(VIEW_CELLS) + 1
    top, left = max(round(row) - reach, 0), max(round(col) - reach, 0)
    window = np.s_[top : min(top + 2 * reach + 1, rows), left : min(left + 2 * reach + 1, cols)]
    codes = np.where(burn.arrival_s[window] <= at_s, ord("b"), ord("u")).astype(np.uint8)
    here_row, here_col = np.ogrid[window]
    codes[np.hypot(here_row - row, here_col - col) > VIEW_CELLS] = ord(".")
    lines = tuple(line.tobytes().decode("ascii") for line in codes)
    return Observed(round(at_s * 1e6), VEHICLE, top, left, lines)


def fly(burn: Burn, planner: Planner, *, hull: bool = True) -> Flight:
    """Fly a planner from deployment to the end; the error is taken at each new cell.

    ``hull``: the fire is reconstructed as in the paper, by the convex hull of what the planner
    believes; otherwise it is what the planner believes.
    """
    truth = TrueShape(burn.arrival_s, burn.ignition)
    step_s = burn.landscape.cell_size_m / burn.speed_m_s
    row, col = _entry(burn)
    track, reversals, errors = [], [], []
    for at_s in np.arange(burn.deploy_s, burn.end_s, step_s):
        planner.observe(look(burn, row, col, float(at_s)))
        decision = planner.at(row, col, float(at_s))
        track.append((at_s, row, col))
        if decision is not None and decision.reversed:
            reversals.append((at_s, row, col))
        if planner.phase == "monitor":
            believed = planner.shape(row, col)
            error = np.abs((hull_of(believed) if hull else believed) - truth.at(float(at_s)))
            errors.append((at_s, error.max(), error.mean()))
        row, col = _one_cell_on(planner.path(row, col), row, col)
    at, most, mean = np.array(errors).reshape(-1, 3).T
    return Flight(np.array(track), np.array(reversals).reshape(-1, 3), at, most, mean)


def _entry(burn: Burn) -> tuple[float, float]:
    """The northernmost burned cell when the vehicle is deployed."""
    rows, cols = np.nonzero(burn.burned(burn.deploy_s))
    return float(rows[0]), float(cols[0])


def _one_cell_on(path: Floats, row: float, col: float) -> tuple[float, float]:
    """One cell further towards the first point of a path that is at least that far."""
    if not len(path):
        return row, col
    away = np.hypot(path[:, 0] - row, path[:, 1] - col)
    goal = int(np.argmax(away >= 1.0)) if away.max() >= 1.0 else len(path) - 1
    share = min(1.0 / max(float(away[goal]), 1e-9), 1.0)
    return (
        row + share * float(path[goal, 0] - row),
        col + share * float(path[goal, 1] - col),
    )
