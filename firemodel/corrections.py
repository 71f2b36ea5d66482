"""A fire simulation set right by marks, as Beachly et al. do it (section IV).

Each mark gives an error: how much later than simulated fire came there (``marks.errors_s``). It is
carried to other places by a squared exponential k of the distance. Where marks are many their
errors are averaged, and far from all of them nothing is corrected: Σ k e / max(1, Σ k). All marks
count alike, whenever they were made: of two at one place the mean holds.
"""

import numpy as np
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.marks import BURNING, UNBURNED, Simulation, errors_s

Floats = NDArray[np.float64]


class PaperCorrected:
    """A fire with marks (n, 4) x, y, at_s, state that reach about ``length_m`` around them.

    A burned or unburned mark that the fire agrees with corrects nothing and does not count. Where
    fire never comes by the simulation a shift of time cannot help: there a place burns from the
    earliest time at which a mark within ``length_m`` says so.
    """

    def __init__(self, fire: Simulation, marks: Floats, length_m: float) -> None:
        """Raises FireModelError for marks of another shape or no length."""
        self.fire, self.length_m = fire, length_m
        self.marks = np.asarray(marks, dtype=np.float64).reshape(-1, 4)
        if not 0.0 < length_m < np.inf:
            raise FireModelError(f"corrections: length_m = {length_m} must be more than 0")
        error_s = errors_s(fire, self.marks)
        never = ~np.isfinite(error_s)
        counts = ~never & ((error_s != 0.0) | (self.marks[:, 3] == BURNING))
        self._places, self._error_s = self.marks[counts, :2], error_s[counts]
        self._anyway = self.marks[never & (self.marks[:, 3] != UNBURNED), :3]

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """When fire comes to each point: (n, 2) x, y in metres to (n,); infinity for never."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        return self.corrected_s(points, self.fire.ignition_time_s(points))

    def corrected_s(self, points_m: Floats, simulated_s: Floats) -> Floats:
        """As ``ignition_time_s``, where the simulation's own times of these points are known."""
        found = simulated_s + self.shift_s(points_m)
        never = np.flatnonzero(np.isinf(simulated_s))
        for x, y, at_s in self._anyway:
            near = np.hypot(*(points_m[never] - (x, y)).T) <= self.length_m
            found[never[near]] = np.minimum(found[never[near]], at_s)
        return found

    def shift_s(self, points_m: Floats) -> Floats:
        """How much later than simulated fire is expected at each point (n, 2): (n,)."""
        total, weight = np.zeros(len(points_m)), np.zeros(len(points_m))
        for place, error_s in zip(self._places, self._error_s, strict=True):
            near = np.exp(-0.5 * np.square((points_m - place) / self.length_m).sum(axis=1))
            total += near * error_s
            weight += near
        return total / np.maximum(weight, 1.0)
