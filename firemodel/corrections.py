"""A fire simulation set right by marks, as Beachly et al. do it (section IV).

Each mark gives an error: how much later than simulated fire came there (``marks.errors_s``). It is
carried to other places by a squared exponential k of the distance. Where marks are many their
errors are averaged, and far from all of them nothing is corrected: Σ k e / max(1, Σ k). All marks
count alike, whenever they were made: of two at one place the mean holds.
"""

import math

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from firemodel.errors import FireModelError
from firemodel.marks import BURNING, UNBURNED, Simulation, errors_s
from firemodel.tiles import first_of, tiles_of

POINTS_A_TILE = 128
LEAST = 1e-9  # a squared exponential that is less is none
LARGEST = -math.log(LEAST)
# exp(-y) = exp(-y / 64)**64: a series of nine terms about the middle of what y / 64 can be.
PARTS, MIDDLE = 64.0, LARGEST / 128.0
SERIES = tuple(math.exp(-MIDDLE) * (-1.0) ** k / math.factorial(k) for k in range(9))

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
        tiles = tiles_of(points_m, POINTS_A_TILE)
        total, weight = np.zeros((2, len(tiles.x)))
        _add_up(self._places, self._error_s, self.length_m, tiles, total, weight)
        found = np.empty(len(total))
        found[tiles.order] = total / np.maximum(weight, 1.0)
        return found


@kernel
def _squared_exponential(y):  # type: ignore[no-untyped-def]
    """exp(-y) to 1e-10 of it, 0 where it is less than ``LEAST``; without a branch or a call.

    So that several places are reckoned at once, which exp is not.
    """
    z = min(y, LARGEST) / PARTS - MIDDLE
    found = SERIES[8]
    found = found * z + SERIES[7]
    found = found * z + SERIES[6]
    found = found * z + SERIES[5]
    found = found * z + SERIES[4]
    found = found * z + SERIES[3]
    found = found * z + SERIES[2]
    found = found * z + SERIES[1]
    found = found * z + SERIES[0]
    found *= found
    found *= found
    found *= found
    found *= found
    found *= found
    found *= found
    return found if y < LARGEST else 0.0


@kernel
def _add_up(places, error_s, length_m, tiles, total, weight):  # type: ignore[no-untyped-def]
    """Σ k e and Σ k of each point (sorted), of the marks whose k is not 0 all over its tile."""
    part = 0.5 / (length_m * length_m)
    tile_boxes = tiles.boxes[first_of(tiles.levels) :]
    for tile in range(tile_boxes.shape[0]):
        begin, end = tiles.begin[tile], tiles.begin[tile + 1]
        box = tile_boxes[tile]
        # Of their own, so that places count from 0 and several can be reckoned at once.
        xs, ys, totals, weights = (
            tiles.x[begin:end],
            tiles.y[begin:end],
            total[begin:end],
            weight[begin:end],
        )
        for mark in range(places.shape[0] if begin < end else 0):
            x, y, error = places[mark, 0], places[mark, 1], error_s[mark]
            off_x, off_y = max(box[0] - x, x - box[1], 0.0), max(box[2] - y, y - box[3], 0.0)
            if part * (off_x * off_x + off_y * off_y) >= LARGEST:
                continue
            for k in range(xs.size):
                dx, dy = xs[k] - x, ys[k] - y
                near = _squared_exponential(part * (dx * dx + dy * dy))
                totals[k] += near * error
                weights[k] += near
