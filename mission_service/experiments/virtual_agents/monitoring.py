"""Compute the area to monitor around the true fire, and the metrics of section 6.2.

The UAVs do not receive this area. Like the agents' maps, the map of this area counts the burning
cells within reach of each cell; a cell that begins to burn adds a disc. The cells with a priority
are also stored in a list, because the metrics are computed far more often than the fire grows.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from mission_service.experiments.virtual_agents.camera_footprint import Footprint, cells_in_view
from mission_service.guidance.formation.agent_maps import check_cells, disc, no_counts, stamp
from mission_service.guidance.formation.map_grid import MapGrid

Cells = NDArray[np.int64]
Floats = NDArray[np.float64]

NEAR, FAR = 1.0, 0.2  # priorities near fire and farther away (section 3.4)
SEEN_WITHIN_S = 60.0  # a cell counts as covered for this time after a UAV has seen the cell


class MonitoringArea:
    """The priorities of all cells around a fire that only grows.

    ``priority`` (y, x) is 1 within ``near_m`` of fire and 0.2 within ``monitoring_m``; on fire and
    elsewhere it is 0. ``cells`` (n) are the cells with a priority above 0, and ``priorities`` (n)
    are their priorities.
    """

    def __init__(self, grid: MapGrid, near_m: float, monitoring_m: float) -> None:
        self.grid = grid
        self.fire: NDArray[np.bool_] = np.zeros(grid.shape, dtype=np.bool_)
        self._near, self._far = disc(near_m / grid.cell_m), disc(monitoring_m / grid.cell_m)
        self._near_fire = no_counts(grid.shape, self._near)
        self._far_fire = no_counts(grid.shape, self._far)
        self._sums = np.zeros(3, dtype=np.int64)
        self._views: NDArray[np.int64] = np.zeros(grid.shape, dtype=np.int64)
        self._view = 0
        self.priority: Floats = np.zeros(grid.shape)
        self._cells: Cells = np.empty(grid.rows * grid.cols, dtype=np.int64)
        self._priorities: Floats = np.empty(grid.rows * grid.cols)
        self.cells, self.priorities = self._cells[:0], self._priorities[:0]
        # The window of cells that can have a priority: first row, first column, end row, end
        # column.
        self._window: Cells = np.array((*grid.shape, 0, 0))

    def burn(self, arrival_s: Floats, at_s: float) -> None:
        """Add the cells that burn at ``at_s`` according to the true fire's arrival times (y, x)."""
        self.add_fire(np.flatnonzero((arrival_s <= at_s) & ~self.fire))

    def add_fire(self, cells: Cells) -> None:
        """Add cells that burn now. Raises MissionServiceError for a cell off the map."""
        if not len(cells):
            return
        check_cells(cells, self.grid.shape)
        near, far = (self._near, self._near_fire), (self._far, self._far_fire)
        stamp(cells, True, self.fire, *near, *far, self._sums)
        rows, cols = np.divmod(cells, self.grid.cols)
        k = len(self._far) // 2
        self._window[:2] = np.minimum(self._window[:2], (rows.min() - k, cols.min() - k))
        self._window[2:] = np.maximum(self._window[2:], (rows.max() + k + 1, cols.max() + k + 1))
        outputs = (self.priority, self._cells, self._priorities)
        count = _priorities(self.fire, self._near_fire, self._far_fire, self._window, *outputs)
        self.cells, self.priorities = self._cells[:count], self._priorities[:count]

    def agent_coverage(self, agents_m: Floats, coverage_m: float) -> float:
        """Return the fraction of the total priority within ``coverage_m`` of an agent (n, 2)."""
        cell_m = self.grid.cell_m
        rows = (self.grid.north_m - agents_m[:, 1]) / cell_m - 0.5
        cols = (agents_m[:, 0] - self.grid.west_m) / cell_m - 0.5
        share: float = _near_agents(
            self.cells, self.priorities, self.grid.cols, rows, cols, coverage_m / cell_m
        )
        return share

    def seen_coverage(self, seen_s: Floats, at_s: float, within_s: float = SEEN_WITHIN_S) -> float:
        """Return the fraction of the total priority in cells seen in the last ``within_s``.

        ``seen_s`` (y, x) is the time at which each cell was seen last.
        """
        share: float = _seen(self.cells, self.priorities, seen_s.ravel(), at_s - within_s)
        return share

    def efficiency(self, footprints: Sequence[Footprint]) -> float:
        """Return the efficiency of the footprints (section 6.2).

        The efficiency is the sum of the priorities in the union of the footprints, divided by the
        sum of the priorities over all footprints. In the divisor a cell in two footprints counts
        twice. The result is 1 if no footprint contains a cell with a priority.
        """
        union = total = 0.0
        self._view += 1
        priorities, views = self.priority.ravel(), self._views.ravel()
        for footprint in footprints:
            cells = cells_in_view(self.grid, footprint)
            new, all_of_it = _in_view(cells, priorities, views, self._view)
            union += new
            total += all_of_it
        return union / total if total else 1.0


def inaccuracy_cells(true_fire: NDArray[np.bool_], fires: Sequence[NDArray[np.bool_]]) -> float:
    """Return the mean number of wrong cells in the maps (y, x) of the UAVs."""
    return sum(np.count_nonzero(true_fire != fire) for fire in fires) / len(fires)


@kernel
def _priorities(  # type: ignore[no-untyped-def]
    fire, near_fire, far_fire, window, priority, cells, priorities
):
    """Set the priorities in a window, fill ``cells`` and ``priorities``, return their number."""
    rows, cols = fire.shape
    count = 0
    for r in range(max(window[0], 0), min(window[2], rows)):
        for c in range(max(window[1], 0), min(window[3], cols)):
            if fire[r, c] or far_fire[r, c] == 0:
                priority[r, c] = 0.0
                continue
            priority[r, c] = priorities[count] = NEAR if near_fire[r, c] else FAR
            cells[count] = r * cols + c
            count += 1
    return count


@kernel
def _near_agents(cells, priorities, cols, agent_rows, agent_cols, reach):  # type: ignore[no-untyped-def]
    found, total = 0.0, 0.0
    reach2 = reach * reach + 1e-9
    for i in range(cells.size):
        total += priorities[i]
        row, col = cells[i] // cols, cells[i] % cols
        for k in range(agent_rows.size):
            down, right = agent_rows[k] - row, agent_cols[k] - col
            if down * down + right * right <= reach2:
                found += priorities[i]
                break
    return found / total if total > 0.0 else 0.0


@kernel
def _seen(cells, priorities, seen_s, since_s):  # type: ignore[no-untyped-def]
    found, total = 0.0, 0.0
    for i in range(cells.size):
        total += priorities[i]
        if seen_s[cells[i]] >= since_s:
            found += priorities[i]
    return found / total if total > 0.0 else 0.0


@kernel
def _in_view(cells, priorities, views, view):  # type: ignore[no-untyped-def]
    """Return the total priority of a view's uncounted cells, and that of all cells in the view.

    A cell has been counted if ``views`` contains the number ``view`` at that cell.
    """
    new, total = 0.0, 0.0
    for cell in cells:
        total += priorities[cell]
        if views[cell] != view:
            views[cell] = view
            new += priorities[cell]
    return new, total
