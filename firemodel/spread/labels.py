"""Store the arrival times and the sources of cells in the any-angle scheme."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.compiled import kernel


class Labels(NamedTuple):
    """The arrival time and the source of fire in each cell; cells are flattened (n)."""

    arrival_s: Floats  # (n) infinity until it burns
    best_s: Floats  # (n) earliest arrival found so far; minus infinity where nothing burns
    source: NDArray[np.int32]  # (n) a cell, or n + index of a point; -1 if no fire is near


class Heap(NamedTuple):
    """The cells that fire reaches next, ordered by time (see ``heap``)."""

    times: Floats
    cells: NDArray[np.int32]
    size: int


class ActivePaths(NamedTuple):
    """The lines along which fire was moving when the weather last changed."""

    target: NDArray[np.int32]  # (k) the cell at the end of the line
    at: Floats  # (k, 2) position of the fire: row, column

    def first(self, count: int) -> "ActivePaths":
        """Return a copy of the first ``count`` paths."""
        return ActivePaths(self.target[:count].copy(), self.at[:count].copy())


def empty_paths(room: int) -> ActivePaths:
    """Return uninitialised arrays for ``room`` paths."""
    return ActivePaths(np.empty(room, dtype=np.int32), np.empty((room, 2)))


@kernel
def place_of(source, points, labels, cols):  # type: ignore[no-untyped-def]
    """Return the row, the column and the time of a source."""
    n = labels.source.size
    if source < n:
        return float(source // cols), float(source % cols), labels.arrival_s[source]
    return points[source - n, 0], points[source - n, 1], points[source - n, 2]


@kernel
def blocked_diagonal(row, col, to_row, to_col, best_s, cols):  # type: ignore[no-untyped-def]
    """Return True if a diagonal step passes between two cells that cannot burn."""
    return (
        row != to_row
        and col != to_col
        and best_s[row * cols + to_col] == -np.inf
        and best_s[to_row * cols + col] == -np.inf
    )
