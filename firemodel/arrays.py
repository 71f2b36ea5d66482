"""Define array types, and compute windows of arrays and points along lines."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", bound=np.generic)
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Place = tuple[slice, slice]  # a window of rows and columns; a valid index of an array
WHOLE: Place = np.s_[:, :]


def bounds_of(mask: Mask) -> Place:
    """Return the smallest window with all true cells of a mask (y, x), or an empty window."""
    rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return np.s_[0:0, 0:0]
    return np.s_[int(rows[0]) : int(rows[-1]) + 1, int(cols[0]) : int(cols[-1]) + 1]


def window_at(top: int, left: int, shape: tuple[int, ...]) -> Place:
    """Return the window of ``shape`` (rows, columns) whose north-west cell is (top, left)."""
    return np.s_[top : top + shape[0], left : left + shape[1]]


def widened(cells: Mask, reach: int) -> Mask:
    """Return a mask (y, x) of the cells within ``reach`` rows and columns of one of ``cells``."""
    size = 2 * reach + 1
    inside = np.pad(cells, (reach + 1, reach))
    count = inside.cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32)
    above, below = count[:-size], count[size:]
    return np.asarray(below[:, size:] - below[:, :-size] - above[:, size:] + above[:, :-size] > 0)


def enlarged(array: NDArray[Number], length: int) -> NDArray[Number]:
    """Return a copy of an array with more rows, the new ones uninitialised."""
    found = np.empty((length, *array.shape[1:]), dtype=array.dtype)
    found[: len(array)] = array
    return found


def lengths_along(line: Floats) -> Floats:
    """Return the distances (n,) along a line (n, 2) from its first point to each point."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])


def evenly_along(closed: Floats, count: int) -> Floats:
    """Return ``count`` points (count, 2) at equal distances along a closed line.

    ``closed`` (n, 2) begins and ends at the same point, which the result contains once.
    """
    along = lengths_along(closed)
    places = np.linspace(0.0, along[-1], count, endpoint=False)
    return np.column_stack([np.interp(places, along, part) for part in closed.T])
