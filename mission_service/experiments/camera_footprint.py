"""The cells of a map that a camera looking straight down has in view: their centres are in it.

The footprint is a rectangle around the vehicle, ``half_along_m`` ahead and astern and
``half_across_m`` to either side of its course (radians anticlockwise from east). It is scanned row
by row, each from the first to the last column within both pairs of edges.
"""

import math

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from mission_service.guidance.formation.map_grid import MapGrid

Cells = NDArray[np.int64]
Floats = NDArray[np.float64]
Footprint = tuple[float, float, float, float, float]
# x_m, y_m, course_rad, half_across_m, half_along_m; for kernels row, col and half sides in cells

EDGE = 1e-9  # cells; a centre on an edge is in view


def changed_cells(
    grid: MapGrid, footprint: Footprint, arrival_s: Floats, at_s: float, fire: NDArray[np.bool_]
) -> tuple[Cells, Cells]:
    """Cells in view whose state on a map is wrong: those that burn, and those that do not.

    Args:
        grid: the map's grid.
        footprint: of the camera, in metres.
        arrival_s: (y, x) the true fire's arrival times, infinity for never; burned is burning.
        at_s: now.
        fire: (y, x) true where the map has fire.

    Returns:
        Two arrays of cell numbers ``row * cols + col``, rising.
    """
    view = in_cells(grid, footprint)
    burning, unburned = np.empty((2, _max_cells(view)), dtype=np.int64)
    count, cleared = fill_changed_cells(view, arrival_s, at_s, fire, burning, unburned)
    return burning[:count], unburned[:cleared]


def mark_seen(grid: MapGrid, footprint: Footprint, seen_s: Floats, at_s: float) -> None:
    """Set ``seen_s`` (y, x), when cells were last in view, to ``at_s`` for those in view."""
    fill_seen(in_cells(grid, footprint), seen_s, at_s)


def cells_in_view(grid: MapGrid, footprint: Footprint) -> Cells:
    """Numbers of the cells in view, rising."""
    view = in_cells(grid, footprint)
    cells = np.empty(_max_cells(view), dtype=np.int64)
    return cells[: fill_cells_in_view(view, grid.shape, cells)]


def in_cells(grid: MapGrid, footprint: Footprint) -> Footprint:
    """A footprint in cells: row, column, course_rad, half sides across and along."""
    x_m, y_m, course_rad, half_across_m, half_along_m = footprint
    row, col = grid.row_col_of(x_m, y_m)
    return row, col, course_rad, half_across_m / grid.cell_m, half_along_m / grid.cell_m


def _max_cells(view: Footprint) -> int:
    """At least as many as there can be cells in a footprint."""
    return int((2.0 * (view[3] + view[4]) + 2.0) ** 2)


@kernel
def first_row_and_end(view, rows):  # type: ignore[no-untyped-def]
    """Rows of the map that a view can touch; lengths in cells."""
    row, _, course_rad, across, along = view
    high = abs(along * math.sin(course_rad)) + abs(across * math.cos(course_rad)) + EDGE
    # Clipped as floats: a view may be far off the map.
    first = math.ceil(min(max(row - high, 0.0), rows + 0.0))
    return first, math.floor(min(max(row + high, -1.0), rows - 1.0)) + 1


@kernel
def first_col_and_end(r, view, cols):  # type: ignore[no-untyped-def]
    """Columns of row ``r`` of the map that are in view; lengths in cells."""
    row, col, course_rad, across, along = view
    cos, sin = math.cos(course_rad), math.sin(course_rad)
    north = row - r
    low, high = -col, cols - 1.0 - col  # of columns from the vehicle's
    low, high = _within(low, high, cos, north * sin, along)
    low, high = _within(low, high, -sin, north * cos, across)
    if low > high:
        return 0, 0
    return math.ceil(col + low - EDGE), math.floor(col + high + EDGE) + 1


@kernel
def _within(low, high, slope, off, max_off):  # type: ignore[no-untyped-def]
    """The part of low <= c <= high where ``|slope c + off| <= most``."""
    if abs(slope) < EDGE:
        return (low, high) if abs(off) <= max_off + EDGE else (1.0, 0.0)
    one, other = (-max_off - off) / slope, (max_off - off) / slope
    return max(low, min(one, other)), min(high, max(one, other))


@kernel
def fill_changed_cells(view, arrival_s, at_s, fire, burning, unburned):  # type: ignore[no-untyped-def]
    """``changed_cells`` in cells: fills ``burning``, ``unburned``; returns how many of each."""
    rows, cols = fire.shape
    count, cleared = 0, 0
    first, end = first_row_and_end(view, rows)
    for r in range(first, end):
        left, right = first_col_and_end(r, view, cols)
        for c in range(left, right):
            burns = arrival_s[r, c] <= at_s
            if burns != fire[r, c]:
                if burns:
                    burning[count] = r * cols + c
                    count += 1
                else:
                    unburned[cleared] = r * cols + c
                    cleared += 1
    return count, cleared


@kernel
def fill_seen(view, seen_s, at_s):  # type: ignore[no-untyped-def]
    """``mark_seen`` in cells."""
    rows, cols = seen_s.shape
    first, end = first_row_and_end(view, rows)
    for r in range(first, end):
        left, right = first_col_and_end(r, view, cols)
        for c in range(left, right):
            seen_s[r, c] = at_s


@kernel
def fill_cells_in_view(view, shape, cells):  # type: ignore[no-untyped-def]
    """``cells_in_view`` in cells: fills ``cells``; returns how many."""
    rows, cols = shape
    count = 0
    first, end = first_row_and_end(view, rows)
    for r in range(first, end):
        left, right = first_col_and_end(r, view, cols)
        for c in range(left, right):
            cells[count] = r * cols + c
            count += 1
    return count
