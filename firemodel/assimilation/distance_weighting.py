"""Correct a simulated fire with observations, as in section IV of Beachly et al.

The error e of an observation is the delay of the observed fire relative to the simulated fire
(``point_observations.errors_s``). At another position, this error has a weight k, which is a
squared exponential of the distance. The correction at a position is Σ k e / max(1, Σ k). Close to
many observations, the correction is the weighted mean of their errors; far from all observations
the correction is 0. The weight does not depend on the time of an observation, so two observations
at the same position are averaged.
"""

import math

import numpy as np

from firemodel.arrays import Floats
from firemodel.compiled import kernel
from firemodel.ellipses.point_observations import BURNING, UNBURNED, Simulation, errors_s
from firemodel.ellipses.tiles import first_of, tiles_of
from firemodel.errors import FireModelError

POINTS_A_TILE = 512
NEGLIGIBLE = 1e-9  # a smaller squared exponential counts as 0
MAX_EXPONENT = -math.log(NEGLIGIBLE)
# exp(-y) = exp(-y / 64)**64: a nine-term series about the middle of the range of y / 64.
PARTS, MIDDLE = 64.0, MAX_EXPONENT / 128.0
# In a square with sides of ``SMOOTH`` lengths that contains many points, the sums are computed at
# NODES x NODES Chebyshev nodes and interpolated by a polynomial, with an error of less than
# NEGLIGIBLE times an observation's error.
NODES, SMOOTH = 10, 1.0
PLACES = -np.cos((np.arange(NODES) + 0.5) * math.pi / NODES)
TO_POWERS = np.linalg.inv(np.vander(PLACES, increasing=True))
SERIES = tuple(math.exp(-MIDDLE) * (-1.0) ** k / math.factorial(k) for k in range(9))


class PaperCorrected:
    """A fire corrected with observations (n, 4), with weights that depend on distance.

    The columns of the observations are x, y, at_s and state. An observation has an effect within
    about ``length_m``.

    A burned or unburned observation that agrees with the simulation has no weight. A place that the
    simulated fire never reaches has no arrival time to correct. Such a place burns from the time of
    the earliest burned or burning observation within ``length_m``, if the simulated fire never
    reaches the position of that observation either.
    """

    def __init__(self, fire: Simulation, observations: Floats, length_m: float) -> None:
        """Raise FireModelError if the observations or the length cannot be used."""
        self.fire, self.length_m = fire, length_m
        self.observations = np.asarray(observations, dtype=np.float64)
        if self.observations.ndim != 2 or self.observations.shape[1] != 4:
            raise FireModelError(
                f"corrections: observations have the shape {self.observations.shape}, but must "
                "have (count, 4): x, y, at_s, state"
            )
        if not 0.0 < length_m < np.inf:
            raise FireModelError(f"corrections: length_m = {length_m} must be more than 0 m")
        error_s = errors_s(fire, self.observations)
        never = ~np.isfinite(error_s)
        counts = ~never & ((error_s != 0.0) | (self.observations[:, 3] == BURNING))
        self._places, self._error_s = self.observations[counts, :2], error_s[counts]
        self._ignitions = self.observations[never & (self.observations[:, 3] != UNBURNED), :3]

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """Return the arrival times (n,) in s at points (n, 2) in metres; infinity if unburned."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        return self.corrected_s(points, self.fire.ignition_time_s(points))

    def corrected_s(self, points_m: Floats, simulated_s: Floats) -> Floats:
        """Return ``ignition_time_s`` for points whose simulated arrival times (n,) are given."""
        found = simulated_s + self.shift_s(points_m)
        never = np.flatnonzero(np.isinf(simulated_s))
        for x, y, at_s in self._ignitions:
            near = np.hypot(*(points_m[never] - (x, y)).T) <= self.length_m
            found[never[near]] = np.minimum(found[never[near]], at_s)
        return found

    def shift_s(self, points_m: Floats) -> Floats:
        """Return the expected delay (n,) in s of the real fire at points (n, 2)."""
        tiles = tiles_of(points_m, POINTS_A_TILE, SMOOTH * self.length_m)
        total, weight = np.zeros((2, len(tiles.x)))
        room = np.empty((5, NODES * NODES))
        _shifts(self._places, self._error_s, self.length_m, tiles, room, total, weight)
        found = np.empty(len(total))
        found[tiles.order] = total / np.maximum(weight, 1.0)
        return found


@kernel
def _squared_exponential(y):  # type: ignore[no-untyped-def]
    """Compute exp(-y) with a relative error of 1e-10; a result below ``NEGLIGIBLE`` becomes 0.

    Unlike exp, this function has no branch and no call, so that the compiler can vectorise loops
    that call the function.
    """
    z = min(y, MAX_EXPONENT) / PARTS - MIDDLE
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
    return found if y < MAX_EXPONENT else 0.0


@kernel
def _add_up(box, places, error_s, part, xs, ys, total, weight):  # type: ignore[no-untyped-def]
    """Add Σ k e to ``total`` and Σ k to ``weight`` at each x, y in a box.

    Observations whose k is 0 in the whole box are skipped.
    """
    for observation in range(places.shape[0]):
        x, y, error = places[observation, 0], places[observation, 1], error_s[observation]
        off_x, off_y = max(box[0] - x, x - box[1], 0.0), max(box[2] - y, y - box[3], 0.0)
        if part * (off_x * off_x + off_y * off_y) >= MAX_EXPONENT:
            continue
        for k in range(xs.size):
            dx, dy = xs[k] - x, ys[k] - y
            near = _squared_exponential(part * (dx * dx + dy * dy))
            total[k] += near * error
            weight[k] += near


@kernel
def _powers(values, between):  # type: ignore[no-untyped-def]
    """Convert values at the nodes into coefficients of powers of x and y, in place."""
    for _ in range(2):
        for i in range(NODES):
            for j in range(NODES):
                found = 0.0
                for k in range(NODES):
                    found += TO_POWERS[j, k] * values[i * NODES + k]
                between[j * NODES + i] = found  # transposed: the second pass is over the other axis
        for k in range(values.size):
            values[k] = between[k]


@kernel
def _polynomial(c, xs, ys, middle_x, middle_y, per_x, per_y, found):  # type: ignore[no-untyped-def]
    """Write Σ c[i, j] y^i x^j at each position into ``found``.

    Here x and y are scaled to the range from -1 to 1.
    """
    for i in range(NODES - 1, -1, -1):
        row = c[i * NODES : (i + 1) * NODES]
        c0, c1, c2, c3 = row[0], row[1], row[2], row[3]
        c4, c5, c6, c7, c8, c9 = row[4], row[5], row[6], row[7], row[8], row[9]
        for k in range(xs.size):
            x, y = (xs[k] - middle_x) * per_x, (ys[k] - middle_y) * per_y
            along = c5 + x * (c6 + x * (c7 + x * (c8 + x * c9)))
            along = c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * along))))
            found[k] = found[k] * y + along


@kernel
def _shifts(places, error_s, length_m, tiles, room, total, weight):  # type: ignore[no-untyped-def]
    """Write Σ k e into ``total`` and Σ k into ``weight`` for each point, in the order of the tiles.

    ``total`` and ``weight`` are 0 on entry.
    """
    part = 0.5 / (length_m * length_m)
    tile_boxes = tiles.boxes[first_of(tiles.levels) :]
    node_x, node_y, node_total, node_weight, between = room[0], room[1], room[2], room[3], room[4]
    for tile in range(tile_boxes.shape[0]):
        begin, end = tiles.begin[tile], tiles.begin[tile + 1]
        if begin == end:
            continue
        box = tile_boxes[tile]
        # Slices, so that indices begin at 0 and the loop can be vectorised.
        xs, ys = tiles.x[begin:end], tiles.y[begin:end]
        totals, weights = total[begin:end], weight[begin:end]
        half_x, half_y = 0.5 * (box[1] - box[0]), 0.5 * (box[3] - box[2])
        if 2.0 * max(half_x, half_y) > SMOOTH * length_m or end - begin < 2 * NODES * NODES:
            _add_up(box, places, error_s, part, xs, ys, totals, weights)
            continue
        middle_x, middle_y = 0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])
        for i in range(NODES):
            for j in range(NODES):
                node_x[i * NODES + j] = middle_x + half_x * PLACES[j]
                node_y[i * NODES + j] = middle_y + half_y * PLACES[i]
        node_total[:] = 0.0
        node_weight[:] = 0.0
        _add_up(box, places, error_s, part, node_x, node_y, node_total, node_weight)
        per_x = 1.0 / half_x if half_x > 0.0 else 0.0
        per_y = 1.0 / half_y if half_y > 0.0 else 0.0
        _powers(node_total, between)
        _powers(node_weight, between)
        _polynomial(node_total, xs, ys, middle_x, middle_y, per_x, per_y, totals)
        _polynomial(node_weight, xs, ys, middle_x, middle_y, per_x, per_y, weights)
