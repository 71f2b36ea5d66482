"""What a camera that looks straight down sees of a map: the cells whose centres are in its view.

The view is a rectangle around the vehicle, ``half_along_m`` ahead and astern and
``half_across_m`` to either side of its course (radians anticlockwise from east). It is gone through
row by row, each from the first to the last column within both pairs of edges.
"""

import math

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from mission_service.guidance.formation.map_grid import MapGrid

Cells = NDArray[np.int64]
Floats = NDArray[np.float64]
EDGE = 1e-9  # cells; a centre on an edge is in view


def changed_cells(
    grid: MapGrid,
    x_m: float,
    y_m: float,
    course_rad: float,
    half_across_m: float,
    half_along_m: float,
    arrival_s: Floats,
    at_s: float,
    fire: NDArray[np.bool_],
) -> tuple[Cells, Cells]:
    """What a sight changes: cells that burn and are not known to, and the other way round.

    ``arrival_s`` (y, x) is the true fire's, infinity where it does not come; burned is burning.
    ``fire`` (y, x) is what is known. Returns two arrays of cell numbers, rising.
    """
    row, col, across, along = in_cells(grid, x_m, y_m, half_across_m, half_along_m)
    room = _room(across, along)
    burning, unburned = np.empty((2, room), dtype=np.int64)
    count, cleared = fill_changed_cells(
        row, col, course_rad, across, along, arrival_s, at_s, fire, burning, unburned
    )
    return burning[:count], unburned[:cleared]


def mark_seen(
    grid: MapGrid,
    x_m: float,
    y_m: float,
    course_rad: float,
    half_across_m: float,
    half_along_m: float,
    seen_s: Floats,
    at_s: float,
) -> None:
    """Write into ``seen_s`` (y, x) when the cells in view were last seen: now."""
    row, col, across, along = in_cells(grid, x_m, y_m, half_across_m, half_along_m)
    fill_seen(row, col, course_rad, across, along, seen_s, at_s)


def cells_in_view(
    grid: MapGrid,
    x_m: float,
    y_m: float,
    course_rad: float,
    half_across_m: float,
    half_along_m: float,
) -> Cells:
    """Numbers of the cells in view, rising."""
    row, col, across, along = in_cells(grid, x_m, y_m, half_across_m, half_along_m)
    cells = np.empty(_room(across, along), dtype=np.int64)
    return cells[
        : fill_cells_in_view(row, col, course_rad, across, along, grid.rows, grid.cols, cells)
    ]


def in_cells(
    grid: MapGrid, x_m: float, y_m: float, half_across_m: float, half_along_m: float
) -> tuple[float, float, float, float]:
    """Where a view is, and its half sides, in cells: row, column, across, along."""
    return *grid.row_col_of(x_m, y_m), half_across_m / grid.cell_m, half_along_m / grid.cell_m


def _room(across: float, along: float) -> int:
    """At least as many as there can be cells in a rectangle of these half sides."""
    return int((2.0 * (across + along) + 2.0) ** 2)


@kernel
def first_row_and_end(row, course_rad, across, along, rows):  # type: ignore[no-untyped-def]
    """Rows of the map that a view can touch; lengths in cells."""
    high = abs(along * math.sin(course_rad)) + abs(across * math.cos(course_rad)) + EDGE
    # Clipped as floats: a view may be far off the map.
    first = math.ceil(min(max(row - high, 0.0), rows + 0.0))
    return first, math.floor(min(max(row + high, -1.0), rows - 1.0)) + 1


@kernel
def first_col_and_end(r, row, col, course_rad, across, along, cols):  # type: ignore[no-untyped-def]
    """Columns of row ``r`` of the map that are in view; lengths in cells."""
    cos, sin = math.cos(course_rad), math.sin(course_rad)
    north = row - r
    low, high = -col, cols - 1.0 - col  # of columns from the vehicle's
    low, high = _within(low, high, cos, north * sin, along)
    low, high = _within(low, high, -sin, north * cos, across)
    if low > high:
        return 0, 0
    return math.ceil(col + low - EDGE), math.floor(col + high + EDGE) + 1


@kernel
def _within(low, high, slope, off, most):  # type: ignore[no-untyped-def]
    """The part of low <= c <= high where ``|slope c + off| <= most``."""
    if abs(slope) < EDGE:
        return (low, high) if abs(off) <= most + EDGE else (1.0, 0.0)
    one, other = (-most - off) / slope, (most - off) / slope
    return max(low, min(one, other)), min(high, max(one, other))


@kernel
def fill_changed_cells(  # type: ignore[no-untyped-def]
    row, col, course_rad, across, along, arrival_s, at_s, fire, burning, unburned
):
    """``changed_cells`` in cells: fills ``burning``, ``unburned``; returns how many of each."""
    rows, cols = fire.shape
    count, cleared = 0, 0
    first, end = first_row_and_end(row, course_rad, across, along, rows)
    for r in range(first, end):
        left, right = first_col_and_end(r, row, col, course_rad, across, along, cols)
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
def fill_seen(row, col, course_rad, across, along, seen_s, at_s):  # type: ignore[no-untyped-def]
    """As ``mark_seen``, in cells."""
    rows, cols = seen_s.shape
    first, end = first_row_and_end(row, course_rad, across, along, rows)
    for r in range(first, end):
        left, right = first_col_and_end(r, row, col, course_rad, across, along, cols)
        for c in range(left, right):
            seen_s[r, c] = at_s


@kernel
def fill_cells_in_view(row, col, course_rad, across, along, rows, cols, cells):  # type: ignore[no-untyped-def]
    """As ``cells_in_view``, in cells; returns how many."""
    count = 0
    first, end = first_row_and_end(row, course_rad, across, along, rows)
    for r in range(first, end):
        left, right = first_col_and_end(r, row, col, course_rad, across, along, cols)
        for c in range(left, right):
            cells[count] = r * cols + c
            count += 1
    return count
