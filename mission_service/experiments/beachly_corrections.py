"""Section VII of Beachly et al.: how much corrections by people mend a simulated fire."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.corrections import PaperCorrected
from firemodel.gaussian import GaussianCorrected
from firemodel.landscape import Landscape
from firemodel.marks import Simulation
from mission_service.experiments.beachly_participants import (
    Watching,
    front_error_m,
    front_points,
)

Floats = NDArray[np.float64]
Method = Callable[[Simulation, Floats], Simulation]

WATCHING = Watching((12 * 60.0, 26 * 60.0, 40 * 60.0, 54 * 60.0, 68 * 60.0), 180.0)
FEWEST, MOST = 77, 175  # corrections of a participant in the paper
PAPER_LENGTH_M = 30.0
BEYOND_M = 150.0  # around the unit, where simulated fronts still count
METHODS: dict[str, Method] = {
    "paper": lambda fire, marks: PaperCorrected(fire, marks, PAPER_LENGTH_M),
    "gaussian": GaussianCorrected,
}


class Seen(NamedTuple):
    """What is compared in every case: minutes, true fronts there, and where the model is asked."""

    at_s: Floats
    fronts: list[Floats]
    grid: Landscape
    points: Floats  # (n, 2) the grid's cells
    most_m: float


def errors_m(seen: Seen, fire: Simulation, marks: Floats, method: Method | None) -> Floats:
    """Front error at each minute, by what was marked until then."""
    found = np.empty(seen.at_s.size)
    used, arrival_s = -1, np.empty(0)
    for number, at_s in enumerate(seen.at_s):
        known = int(np.count_nonzero(marks[:, 2] <= at_s)) if method else 0
        if known != used:
            corrected = method(fire, marks[:known]) if method else fire
            arrival_s = corrected.ignition_time_s(seen.points).reshape(seen.grid.shape)
            used = known
        front = front_points(arrival_s, float(at_s), seen.grid)
        found[number] = front_error_m(seen.fronts[number], front, seen.most_m)
    return found
