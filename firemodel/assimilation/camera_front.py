"""Compute observations automatically from camera and sensor images."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.ellipses.point_observations import (
    BURNED,
    BURNING,
    UNBURNED,
    PointObservation,
    Simulation,
)
from firemodel.landscape.landscape import Landscape

Bools = NDArray[np.bool_]


class CameraFront:
    """A limited number of observations, computed from a camera's images.

    The edge between a burned cell and an unburned neighbour gives a burning observation. A cell
    whose observed state differs from its simulated state gives a burned or unburned observation.
    For each state, in each square with sides of ``apart_m`` and each interval of ``every_s``, only
    the newest observation is kept. Of these observations, only the newest ``most`` are used.
    """

    def __init__(
        self, landscape: Landscape, apart_m: float = 15.0, every_s: float = 120.0, most: int = 300
    ) -> None:
        self.landscape, self.most = landscape, most
        self._apart_m, self._every_s = apart_m, every_s
        self._observations: dict[tuple[int, int, int, int], PointObservation] = {}

    def fold(self, row: int, col: int, cells: Sequence[str], at_s: float, fire: Simulation) -> None:
        """Add the cells of an image (``events.Observed``), whose north-west cell is (row, col).

        Each string of ``cells`` is one row of cells; the rows run from north to south. A ``b`` is a
        burning or burned cell and a ``u`` an unburned cell; a cell with any other character was not
        observed. ``fire`` is the simulation without these observations.
        """
        window = np.array([list(line) for line in cells])
        if window.size == 0:
            return
        burned, unburned = window == "b", window == "u"
        rows, cols = np.indices(window.shape)
        x_m, y_m = self.landscape.xy_of(row + rows, col + cols)
        for edge in (np.s_[1:, :], np.s_[:-1, :]), (np.s_[:, 1:], np.s_[:, :-1]):
            one, other = edge
            front = (burned[one] & unburned[other]) | (unburned[one] & burned[other])
            middle = [0.5 * (axis[one] + axis[other])[front] for axis in (x_m, y_m)]
            self._keep(np.column_stack(middle), at_s, BURNING)
        observed = burned | unburned
        places = np.column_stack([x_m[observed], y_m[observed]])
        simulated = fire.ignition_time_s(places) <= at_s
        self._keep(places[burned[observed] & ~simulated], at_s, BURNED)
        self._keep(places[unburned[observed] & simulated], at_s, UNBURNED)

    def observations(self) -> Floats:
        """Return the kept observations (n, 4) in chronological order: x, y, at_s and state."""
        newest = sorted(self._observations.values(), key=lambda observation: observation.at_s)[
            -self.most :
        ]
        return np.array(newest, dtype=np.float64).reshape(-1, 4)

    def _keep(self, places: Floats, at_s: float, state: int) -> None:
        for x_m, y_m in places:
            square = int(x_m // self._apart_m), int(y_m // self._apart_m)
            key = (state, *square, int(at_s // self._every_s))
            self._observations[key] = PointObservation(float(x_m), float(y_m), at_s, state)
