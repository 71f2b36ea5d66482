"""Simulate an ideal flight of one vehicle over a fire, without autopilot, wind or MAVLink.

As in Islam & Hu, the vehicle flies from cell to cell of the true front at constant speed, in the
direction that the planner decides. The vehicle turns on the spot and observes the cells around it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_service.events import Observed
from mission_service.experiments.boundary_following import BoundaryFollower
from mission_service.experiments.fires import Burn
from mission_service.experiments.islam_hu.measured_wind import MeasuredWind
from mission_service.fire.observed_window import in_letters
from mission_service.guidance.front.front_shape import hull_of
from mission_service.guidance.protocol import Planner
from mission_service.replay.distance_error import TrueShape

Floats = NDArray[np.float64]

VIEW_CELLS = 3.0
REACH = int(VIEW_CELLS) + 1
IN_VIEW = np.hypot(*np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1]) <= VIEW_CELLS
VEHICLE = "uas"


@dataclass(frozen=True)
class Flight:
    """The results of a flight.

    ``track`` (n, 3) contains the time in s, the row and the column of each step, and ``reversals``
    (k, 3) contains the time, the row and the column of each reversal. ``windows`` (d, 3) contains
    the time of each decision, and the importance behind and ahead. The errors, in cells, are
    evaluated at each step after the end of the first lap; ``at_s`` has the times of these steps.
    """

    track: Floats
    reversals: Floats
    windows: Floats
    at_s: Floats
    max_error: Floats
    mean_error: Floats


def look(burn: Burn, row: int, col: int, at_s: float) -> Observed:
    """Return the cells that the vehicle's camera observes, all within ``VIEW_CELLS``."""
    rows, cols = burn.arrival_s.shape
    top, left = max(row - REACH, 0), max(col - REACH, 0)
    bottom, right = min(row + REACH + 1, rows), min(col + REACH + 1, cols)
    codes = np.where(burn.arrival_s[top:bottom, left:right] <= at_s, b"b", b"u")
    disc = IN_VIEW[
        top - row + REACH : bottom - row + REACH, left - col + REACH : right - col + REACH
    ]
    codes[~disc] = b"."
    return Observed(round(at_s * 1e6), VEHICLE, top, left, in_letters(codes.view(np.uint8)))


def fly(
    burn: Burn,
    planner: Planner,
    *,
    hull: bool = True,
    measured: MeasuredWind | None = None,
    before: Callable[[float, int, int], None] | None = None,
) -> Flight:
    """Simulate a flight from deployment to the fire's end; evaluate the error at each new cell.

    If ``hull`` is True, the error of the estimate's convex hull is evaluated, as in the paper;
    otherwise the error of the estimate itself is evaluated. The planner receives the wind from
    ``measured`` at each step; with None it receives no wind. ``before`` is called at each step
    before the decision, with the time, the row and the column.
    """
    truth = TrueShape(burn.arrival_s, burn.ignition)
    cell_s = burn.landscape.cell_size_m / burn.speed_m_s
    at_s = burn.deploy_s
    walk = BoundaryFollower(burn.enclosed_s, at_s)
    row, col = walk.cell
    track, reversals, windows, errors = [], [], [], []
    while at_s < burn.end_s:
        if measured is not None:
            planner.wind(*measured.wind_at(at_s), at_s)
        planner.observe(look(burn, row, col, at_s))
        if before is not None:
            before(at_s, row, col)
        decision = planner.at(row, col, at_s)
        track.append((at_s, row, col))
        if decision is not None:
            windows.append((at_s, decision.importance_back, decision.importance_front))
            if decision.reversed:
                reversals.append((at_s, row, col))
        if planner.phase == "monitor":
            estimated = planner.shape(row, col)
            error = np.abs((hull_of(estimated) if hull else estimated) - truth.distances_at(at_s))
            errors.append((at_s, error.max(), error.mean()))
        walk.onwards(planner.clockwise, at_s)
        new_row, new_col = walk.cell
        at_s += cell_s * max(math.hypot(new_row - row, new_col - col), 1.0)
        row, col = new_row, new_col
    triples = (np.array(rows).reshape(-1, 3) for rows in (track, reversals, windows))
    return Flight(*triples, *np.array(errors).reshape(-1, 3).T)
