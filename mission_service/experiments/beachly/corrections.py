"""Measure how participants' corrections improve a simulated fire (Beachly et al., section VII).

The front error of section VII.B is computed every minute: the mean distance from the true front
inside the unit to the closest point of the simulated front. The error at each minute uses only the
observations made by then. Participants watch the fire in several short segments. The result has two
means over time, both from the start of the first segment: one up to the end of the second segment,
as in the paper, and one over all minutes.

The error that remains after corrections hardly depends on the error of the uncorrected model. The
relative reduction therefore grows with the error of the uncorrected model. On fires 0 to 19 with a
smaller model error (17.8 m uncorrected, segments from minute 12), the reduction was 34 % with the
paper's method and 54 % with the Gaussian process. The model error was then increased to about the
paper's 24.8 m. Fires 100 to 119 were not used for that choice.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.assimilation.distance_weighting import PaperCorrected
from firemodel.assimilation.gaussian_process import GaussianCorrected
from firemodel.ellipses.point_observations import Simulation
from firemodel.landscape.landscape import Landscape
from mission_service.experiments.beachly.participants import (
    APART_M,
    FARTHEST_M,
    Watching,
    front_error_m,
    front_points,
    inside,
    random_observations,
)
from mission_service.experiments.beachly.truth import CELL_M, END_S, MINUTE_S, Burn, unit_box

Floats = NDArray[np.float64]
Method = Callable[[Any, Floats], Simulation]

FIRES = tuple(range(100, 120))  # seeds; constants were chosen on seeds 0 to 19 and 1000 upwards
PARTICIPANTS = 3  # participants per fire
MIN_CORRECTIONS, MAX_CORRECTIONS = 77, 175  # corrections per participant in the paper
WATCHING = Watching(tuple(minute * MINUTE_S for minute in (20, 33, 46, 59, 72)), 3 * MINUTE_S)
PAPER_LENGTH_M = 20.0  # kernel length chosen in advance, see benchmarks/beachly_lengths.py
BEYOND_M = 150.0  # margin around the unit in which simulated fronts are included
METHODS: dict[str, Method] = {
    "paper": lambda fire, observations: PaperCorrected(fire, observations, PAPER_LENGTH_M),
    "gaussian": GaussianCorrected,
}


class Case(NamedTuple):
    """A true fire and its model, which all participants and methods share."""

    name: str
    at_s: Floats  # times at which errors are measured
    fronts: list[Floats]  # true fronts at these times, (n, 2) each
    model: Simulation
    grid: Landscape  # the model is evaluated on this grid
    points: Floats  # (rows * cols, 2) centres of the grid's cells
    before_s: Floats  # (rows, cols) arrival time of cells burned at the beginning, else infinity
    apart_m: float = APART_M  # spacing of points on fronts
    max_m: float = FARTHEST_M  # upper limit of a front's error


class Study(NamedTuple):
    """The effect of one participant's observations."""

    case: Case
    participant: int
    observations: Floats
    uncorrected_m: Floats
    errors_m: dict[str, Floats]  # front errors by method, at each time


def study(burn: Burn, participants: int) -> list[Study]:
    """Return the studies of all participants and methods on one fire."""
    case = case_of(burn)
    uncorrected_m = errors_m(case, np.empty((0, 4)), None)
    found = []
    for participant in range(participants):
        observations = observations_of_participant(burn, participant)
        errors = {name: errors_m(case, observations, method) for name, method in METHODS.items()}
        found.append(Study(case, participant, observations, uncorrected_m, errors))
    return found


def case_of(burn: Burn) -> Case:
    """Return the case of one fire, evaluated each minute from the start of the first segment."""
    at_s = np.arange(WATCHING.begins_s[0], END_S + 1.0, MINUTE_S)
    fronts = [front_points(burn.arrival_s, float(time), burn.landscape) for time in at_s]
    fronts = [front[inside(front, unit_box())] for front in fronts]
    grid = grid_around(unit_box(), BEYOND_M, CELL_M, burn.landscape.crs)
    never = np.full(grid.shape, np.inf)
    return Case(f"random {burn.seed}", at_s, fronts, burn.model, grid, cells_of(grid), never)


def observations_of_participant(burn: Burn, participant: int) -> Floats:
    """Return the observations (n, 4) of one participant of the study on one fire.

    The same fire and participant give the same observations.
    """
    rng = np.random.default_rng((burn.seed, participant))
    count = int(rng.integers(MIN_CORRECTIONS, MAX_CORRECTIONS + 1))
    return random_observations(
        rng, count, WATCHING, burn.arrival_s, burn.model, burn.landscape, unit_box()
    )


def grid_around(
    box: tuple[float, float, float, float], beyond_m: float, cell_m: float, crs: str
) -> Landscape:
    """Return a level grid around a box, on which a simulation is evaluated."""
    west, south, east, north = box
    cols, rows = (
        int(np.ceil((size + 2.0 * beyond_m) / cell_m)) for size in (east - west, north - south)
    )
    fuel, level = np.ones((rows, cols), np.int16), np.zeros((rows, cols), np.float32)
    return Landscape(crs, west - beyond_m, north + beyond_m, cell_m, fuel, level)


def cells_of(grid: Landscape) -> Floats:
    """Return the centres (n, 2) of all cells."""
    return np.column_stack([axis.ravel() for axis in grid.xy_of(*np.indices(grid.shape))])


def arrival_s(case: Case, observations: Floats, method: Method | None) -> Floats:
    """Return the model's arrival times (rows, cols), corrected unless ``method`` is None."""
    fire = method(case.model, observations) if method else case.model
    found = fire.ignition_time_s(case.points).reshape(case.grid.shape)
    return np.minimum(found, case.before_s)


def errors_m(case: Case, observations: Floats, method: Method | None) -> Floats:
    """Return the front error in metres at each time, using the observations made by then."""
    found = np.empty(case.at_s.size)
    used, expected_s = -1, np.empty(0)
    for number, at_s in enumerate(case.at_s):
        count = int(np.count_nonzero(observations[:, 2] <= at_s))
        if count != used:
            used, expected_s = count, arrival_s(case, observations[:count], method)
        front = front_points(expected_s, float(at_s), case.grid, case.apart_m)
        found[number] = front_error_m(case.fronts[number], front, case.max_m)
    return found


def in_period(at_s: Floats) -> NDArray[np.bool_]:
    """Return the mask of the times up to the end of the second segment, as in the paper."""
    return np.asarray(at_s <= WATCHING.begins_s[1] + WATCHING.segment_s)


def rows_of(one: Study) -> list[dict[str, Any]]:
    """Return the result of a study as one row for each method."""
    period = in_period(one.case.at_s)
    return [
        {
            "truth": one.case.name,
            "method": method,
            "corrections": len(one.observations),
            "mean_error_uncorrected_m": float(np.nanmean(one.uncorrected_m[period])),
            "mean_error_m": float(np.nanmean(errors[period])),
            "mean_error_uncorrected_all_minutes_m": float(np.nanmean(one.uncorrected_m)),
            "mean_error_all_minutes_m": float(np.nanmean(errors)),
        }
        for method, errors in one.errors_m.items()
    ]
