"""The local maps of one UAV: fire, augmented fire, area of virtual agents (sections 3.4 and 5.1).

The augmented fire ("augmentation") is the ground that is too close to fire for a virtual agent.
Each map except the fire map counts, for each cell, the fire cells within some distance. A cell that
begins to burn adds one to all counts in a disc around the cell, and a cell that ceases to burn
subtracts one. The updates are therefore incremental. Kernels test a cell by
``augmentation[row, col] > 0``.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from mission_service.errors import MissionServiceError

Cells = NDArray[np.int64]
Bools = NDArray[np.bool_]
Counts = NDArray[Any]  # uint16, or int32 if a disc has 2**16 cells or more


class AgentMaps:
    """The fire map of a UAV, and the maps derived from the fire; arrays are (y, x), row 0 north.

    ``fire`` is true for burning and burned cells. The other maps count, for each cell, the fire
    cells within a distance, measured between cell centres. This distance is ``augmentation_m`` for
    ``augmentation``, ``agent_area_m`` for ``area``, and ``monitoring_m`` for ``monitored``, which
    the rule in ``coverage`` uses. The paper's augmentation map is ``augmentation > 0``, and the
    paper's virtual agent area is ``(area > 0) & ~fire``. ``sums`` (3,) holds the number of fire
    cells, the sum of their rows, and the sum of their columns.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        cell_m: float,
        augmentation_m: float,
        agent_area_m: float,
        monitoring_m: float = 0.0,
    ) -> None:
        self.fire: Bools = np.zeros(shape, dtype=np.bool_)
        self._near, self._far = disc(augmentation_m / cell_m), disc(agent_area_m / cell_m)
        self.augmentation = no_counts(shape, self._near)
        self.area = no_counts(shape, self._far)
        self._monitoring = disc(monitoring_m / cell_m)
        self.monitored = no_counts(shape, self._monitoring)
        self.sums = np.zeros(3, dtype=np.int64)

    def set(self, cells_on: Cells, cells_off: Cells) -> None:
        """Set the cells ``cells_on`` to burning, then the cells ``cells_off`` to not burning.

        The index of a cell is ``row * cols + col``. Raises MissionServiceError for a cell off the
        map.
        """
        for cells, burns in ((cells_on, True), (cells_off, False)):
            if len(cells):
                check_cells(cells, self.fire.shape)
                unique = np.unique(cells)
                add_discs(unique, burns, self.fire, self._monitoring, self.monitored)
                near, far = (self._near, self.augmentation), (self._far, self.area)
                stamp(cells, burns, self.fire, *near, *far, self.sums)

    @property
    def centre_row_col(self) -> tuple[float, float] | None:
        """Return the fire's centre of gravity (row and column, as floats); None without fire."""
        count, rows, cols = self.sums.tolist()
        return (rows / count, cols / count) if count else None


def disc(reach_cells: float) -> Cells:
    """Return the half widths, in columns, of a disc's 2 k + 1 rows.

    The rows run from k cells above the centre to k cells below. A cell belongs to the disc if its
    centre is at most ``reach_cells`` from the centre of the central cell.
    """
    reach2 = reach_cells * reach_cells + 1e-9  # exact for a whole number of cells
    k = math.isqrt(int(reach2))
    rows = np.arange(-k, k + 1)
    half_widths: Cells = np.floor(np.sqrt(reach2 - rows * rows)).astype(np.int64)
    return half_widths


def no_counts(shape: tuple[int, int], half_widths: Cells) -> Counts:
    """Return an array (y, x) of zeros, of a type that can count all cells of a disc."""
    cells = int((2 * half_widths + 1).sum())
    return np.zeros(shape, dtype=np.uint16 if cells < 2**16 else np.int32)


def check_cells(cells: Cells, shape: tuple[int, int]) -> None:
    """Raise MissionServiceError for a cell that is not on a map of this shape."""
    min_cell, max_cell = int(cells.min()), int(cells.max())
    if min_cell < 0 or max_cell >= shape[0] * shape[1]:
        raise MissionServiceError(
            f"fire map: cell {min_cell if min_cell < 0 else max_cell} is not on a map of "
            f"{shape[0]} x {shape[1]} cells; use the same landscape for all vehicles"
        )


@kernel
def add_discs(cells, burns, fire, half_widths, counts):  # type: ignore[no-untyped-def]
    """Add to ``counts`` the discs around those unique cells that the next ``stamp`` changes.

    If the cells cease to burn, the discs are subtracted.
    """
    for i in range(cells.size):
        row, col = cells[i] // fire.shape[1], cells[i] % fire.shape[1]
        if fire[row, col] != burns:
            _add_disc(row, col, 1 if burns else -1, half_widths, counts)


@kernel
def stamp(cells, burns, fire, near, near_counts, far, far_counts, sums):  # type: ignore[no-untyped-def]
    """Set cells to burning or not; add or subtract the discs around the cells that change."""
    cols = fire.shape[1]
    sign = 1 if burns else -1
    for i in range(cells.size):
        row, col = cells[i] // cols, cells[i] % cols
        if fire[row, col] == burns:
            continue
        fire[row, col] = burns
        sums[0] += sign
        sums[1] += sign * row
        sums[2] += sign * col
        _add_disc(row, col, sign, near, near_counts)
        _add_disc(row, col, sign, far, far_counts)


@kernel
def _add_disc(row, col, sign, half_widths, counts):  # type: ignore[no-untyped-def]
    """Add ``sign`` to the counts in a disc.

    Unsigned indices need no test for negative values; they make this kernel 6 times as fast.
    """
    rows, cols = counts.shape
    k = half_widths.size // 2
    for r in range(max(row - k, 0), min(row + k + 1, rows)):
        half = half_widths[r - row + k]
        first = max(col - half, 0)
        for i in range(min(col + half + 1, cols) - first):
            counts[np.uint64(r), np.uint64(first + i)] += sign
