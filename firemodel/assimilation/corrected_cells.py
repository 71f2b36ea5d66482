"""Correct the arrival times of a cellular fire with observations."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, bounds_of
from firemodel.assimilation.gaussian_process import GaussianCorrected
from firemodel.ellipses.paths import StraightPaths
from firemodel.ellipses.point_observations import BURNING, UNBURNED, Simulation
from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire_scheme import check_shape
from firemodel.spread.front import earliest_neighbour

Ints = NDArray[np.int64]


class ArrivalRaster:
    """The arrival times (y, x) of a landscape's cells, as an ``AdjustableFire``.

    The arrival time of an unburned cell is infinity.

    The ignition cell from which fire reached a cell is found by repeatedly stepping back to the
    neighbour that burned earliest, until no neighbour burned earlier. Each of the three adjustments
    (``rates``) is the logarithm of a factor that multiplies travel times. The first adjustment
    applies to all paths. The second and the third are multiplied by the east and the north
    component, respectively, of the unit vector along a path.
    """

    rates_sd = np.array([0.7, 0.4, 0.4])
    first_rates = np.array([[every, 0.0, 0.0] for every in (-1.0, -0.3, 0.3, 1.0)])

    def __init__(self, arrival_s: Floats, landscape: Landscape) -> None:
        """Raise FireModelError if the times are not on the landscape's grid."""
        check_shape(arrival_s, landscape)
        self.arrival_s, self.landscape = arrival_s, landscape
        self._origin = _origins(arrival_s)
        self._rates = np.zeros(3)

    def rated(self, rates: Floats) -> "ArrivalRaster":
        """Return a copy of this fire with ``rates`` (3,) added to its adjustments."""
        other = ArrivalRaster.__new__(ArrivalRaster)
        other.arrival_s, other.landscape = self.arrival_s, self.landscape
        other._origin, other._rates = self._origin, self._rates + rates
        return other

    def places(self) -> Floats:
        """Return the centres (n, 2) of the cells where the fire was lit, as x, y in metres."""
        cells = np.arange(self._origin.size)
        lit = (self._origin == cells) & np.isfinite(self.arrival_s.ravel())
        return self._centres(cells[lit])

    def paths(self, points_m: Floats) -> StraightPaths:
        """Return a path to each point (n, 2) from the ignition cell whose fire arrives first."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        row, col = self.landscape.row_col_of(points[:, 0], points[:, 1])
        rows, cols = self.landscape.shape
        on = (row >= -0.5) & (row < rows - 0.5) & (col >= -0.5) & (col < cols - 0.5)
        row, col = np.clip(row, 0.0, rows - 1.0), np.clip(col, 0.0, cols - 1.0)
        cell = np.round(row).astype(np.int64) * cols + np.round(col).astype(np.int64)
        origin, lit_s = self._centres(self._origin[cell]), self.arrival_s.flat[self._origin[cell]]
        time_s = np.where(on, self._between(row, col), np.inf)
        towards = points - origin
        length_m = np.hypot(*towards.T)
        unit = towards / np.maximum(length_m, 1e-9)[:, None]
        slower = np.exp(self._rates[0] + unit @ self._rates[1:])
        lit_s = np.where(np.isfinite(time_s), lit_s, 0.0)
        return StraightPaths(origin, lit_s, np.maximum(time_s - lit_s, 0.0) * slower)

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """Return the arrival times (n,) in s at points (n, 2) in metres; infinity if unburned."""
        paths = self.paths(points_m)
        return paths.lit_s + paths.takes_s

    def _centres(self, cells: Ints) -> Floats:
        row, col = np.divmod(cells, self.landscape.shape[1])
        return np.column_stack(self.landscape.xy_of(row, col)).astype(np.float64)

    def _between(self, row: Floats, col: Floats) -> Floats:
        """Interpolate arrival times bilinearly at fractional rows and columns.

        If fire does not reach all four surrounding cells, the arrival time of the nearest cell is
        returned.
        """
        rows, cols = self.landscape.shape
        top, left = (
            np.clip(np.floor(at), 0, most - 2).astype(np.int64)
            for at, most in ((row, rows), (col, cols))
        )
        down, right = row - top, col - left
        z = self.arrival_s
        nearest = z[np.round(row).astype(np.int64), np.round(col).astype(np.int64)]
        four = np.array([z[top, left], z[top, left + 1], z[top + 1, left], z[top + 1, left + 1]])
        shares = np.array(
            [(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right]
        )
        all_four = np.isfinite(four).all(axis=0)
        between = (np.where(all_four, four, 0.0) * shares).sum(axis=0)
        return np.where(all_four, between, nearest)


def _origins(arrival_s: Floats) -> Ints:
    """Return, for each cell, the index (n,) of the ignition cell from which fire reached the cell.

    For an ignition cell or a cell without fire, this is the index of the cell itself.
    """
    rows, cols = arrival_s.shape
    origin: Ints = np.arange(arrival_s.size).reshape(rows, cols)
    reached = np.isfinite(arrival_s)
    if not reached.any():
        return origin.ravel()
    window = bounds_of(reached)
    step_row, step_col = earliest_neighbour(arrival_s[window])
    before = origin[window] + (step_row * cols + step_col).astype(np.int64)
    origin[window] = np.where(reached[window], before, origin[window])
    flat = origin.ravel()
    cells = np.flatnonzero(reached)
    earlier = flat[cells]
    while True:
        earliest = flat[earlier]
        flat[cells] = earliest
        if np.array_equal(earliest, earlier):
            return flat
        earlier = earliest


def corrected_arrival(
    arrival_s: Floats,
    landscape: Landscape,
    observations: Floats,
    method: Callable[[ArrivalRaster, Floats], Simulation] = GaussianCorrected,
) -> Floats:
    """Return the arrival times (y, x) of a cellular fire, corrected with observations (n, 4).

    The columns of the observations are x, y, at_s and state.

    To use the method of Beachly et al. with a length of 30 m, pass
    ``lambda fire, observations: PaperCorrected(fire, observations, 30.0)`` as ``method``. The
    simulated fire must extend beyond the observed positions. A cell that the fire never reaches
    stays unburned unless an observation states that the cell is burned or burning. The cell then
    burns from the time of the earliest such observation.
    """
    observations = np.asarray(observations, dtype=np.float64).reshape(-1, 4)
    fire = ArrivalRaster(arrival_s, landscape)
    reached = np.isfinite(arrival_s)  # cells without fire are not corrected
    centres = np.column_stack(landscape.xy_of(*np.nonzero(reached)))
    found = np.full(arrival_s.shape, np.inf)
    found[reached] = method(fire, observations).ignition_time_s(centres)
    for x_m, y_m, at_s, state in observations:
        cell = tuple(int(np.round(at)) for at in landscape.row_col_of(x_m, y_m))
        if state != UNBURNED and landscape.contains(x_m, y_m) and np.isinf(arrival_s[cell]):
            found[cell] = min(found[cell], at_s)
    return found


def warm_up() -> None:
    """Run a small correction, to compile the kernels that corrections use."""
    from firemodel.landscape.flat import flat_landscape

    land = flat_landscape(8, 8, 30.0, 0.0, 3.0)
    row, col = np.indices(land.shape)
    arrival_s = 60.0 * np.hypot(row - 4.0, col - 4.0)
    x_m, y_m = land.xy_of(np.array([5.0, 6.0]), np.array([4.0, 4.0]))
    observations = np.column_stack([x_m, y_m, [30.0, 150.0], [BURNING, UNBURNED]])
    corrected_arrival(arrival_s, land, observations)
