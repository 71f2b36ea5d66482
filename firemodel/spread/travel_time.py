"""Compute the travel time of fire along a line over cells with different spread ellipses."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.compiled import compiled, kernel
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather
from firemodel.spread.local_spread import Tables, Terrain, slowness_of, tables_of, terrain_of

MAX_SEGMENT_CELLS = 2.0
TOUCH = 1e-9  # share of a line in a cell that it only touches at a corner
# North, north-east, east, ... as steps of (row, col); odd ones are diagonal.
STEP_ROW = np.array([-1, -1, 0, 1, 1, 1, 0, -1])
STEP_COL = np.array([0, 1, 1, 1, 0, -1, -1, -1])


class Ground(NamedTuple):
    """The inputs of travel times; cells are flattened (n)."""

    cols: int
    cell_m: float
    terrain: Terrain
    tables: Tables
    reach: NDArray[np.int16]  # (n) distance in cells within which all cells are like this one
    # One record of 32 bytes for each cell, read in one memory access: A, B north, B east in float64
    # (indices 0 to 2; A is NaN if not yet computed, 0 if fire does not spread), and the rise
    # towards north and east in float32 (indices 6 and 7).
    slowness: Floats  # (n, 4)
    rise: NDArray[np.float32]  # (n, 8), the same memory
    computed: NDArray[np.int32]  # (n + 1) number of the computed cells, then their indices


def ground_of(landscape: Landscape, entries: Sequence[Weather], wind_limit: bool) -> Ground:
    """Return the ``Ground`` of a landscape; slownesses are computed later, when needed."""
    terrain = terrain_of(landscape)
    n, cols = terrain.fuel.size, landscape.shape[1]
    slowness = np.full((n, 4), np.nan)
    return Ground(
        cols,
        landscape.cell_size_m,
        terrain,
        tables_of(landscape, entries, wind_limit),
        _reach(terrain, cols),
        slowness,
        slowness.view(np.float32),
        np.zeros(n + 1, dtype=np.int32),
    )


@compiled
def _reach(terrain, cols):  # type: ignore[no-untyped-def]
    """Return the chessboard distance from each cell to the nearest cell with an unlike neighbour.

    The algorithm is the two-pass algorithm of Rosenfeld & Pfaltz 1966.
    """
    fuel, gradient, midflame = terrain
    n = fuel.size
    rows = n // cols
    reach = np.full(n, 32767, dtype=np.int16)
    for cell in range(n):
        row, col = cell // cols, cell % cols
        for side in range(8):
            to_row, to_col = row + STEP_ROW[side], col + STEP_COL[side]
            if 0 <= to_row < rows and 0 <= to_col < cols:
                other = to_row * cols + to_col
                if (
                    fuel[other] != fuel[cell]
                    or gradient[0, other] != gradient[0, cell]
                    or gradient[1, other] != gradient[1, cell]
                    or midflame[other] != midflame[cell]
                ):
                    reach[cell] = 0
                    break
    # Two passes: downwards with the four neighbours already visited, upwards with the other four.
    for sides, cells in (((7, 0, 1, 6), range(n)), ((5, 4, 3, 2), range(n - 1, -1, -1))):
        for cell in cells:
            row, col = cell // cols, cell % cols
            for side in sides:
                to_row, to_col = row + STEP_ROW[side], col + STEP_COL[side]
                if 0 <= to_row < rows and 0 <= to_col < cols:
                    reach[cell] = min(reach[cell], reach[to_row * cols + to_col] + 1)
    return reach


@kernel
def _compute_slowness(cell, ground, entry):  # type: ignore[no-untyped-def]
    a, north, east = slowness_of(cell, entry, ground.terrain, ground.tables)
    ground.slowness[cell, 0], ground.slowness[cell, 1], ground.slowness[cell, 2] = a, north, east
    ground.rise[cell, 6] = ground.terrain.gradient[0, cell]
    ground.rise[cell, 7] = ground.terrain.gradient[1, cell]
    ground.computed[0] += 1
    ground.computed[ground.computed[0]] = cell


@kernel
def clear_slowness(ground):  # type: ignore[no-untyped-def]
    """Clear the computed slownesses; required before another weather entry is used."""
    for place in range(1, ground.computed[0] + 1):
        ground.slowness[ground.computed[place], 0] = np.nan
    ground.computed[0] = 0


@kernel
def crossing_s(cell, north, east, length2, ground, entry):  # type: ignore[no-untyped-def]
    """Return the time in s along a horizontal vector in metres, at the slowness of one cell.

    ``length2`` is the squared length of the vector. The result is 0 if fire does not spread in the
    cell.
    """
    slowness, rise = ground.slowness, ground.rise
    if slowness[cell, 0] != slowness[cell, 0]:
        _compute_slowness(cell, ground, entry)
    up = rise[cell, 6] * north + rise[cell, 7] * east
    return (
        slowness[cell, 0] * math.sqrt(length2 + up * up)
        - slowness[cell, 1] * north
        - slowness[cell, 2] * east
    )


@kernel
def cell_at(row, col, cols):  # type: ignore[no-untyped-def]
    """Return the cell in which a float position lies."""
    return math.floor(row + 0.5) * cols + math.floor(col + 0.5)


@kernel
def travel(row, col, to_row, to_col, limit_s, ground, entry):  # type: ignore[no-untyped-def]
    """Follow a line to the centre of a cell for at most ``limit_s``.

    Positions are float rows and columns. Returns the time and the fraction of the line that is
    covered. The time is ``limit_s`` if the line is not completed by then, or if it crosses a cell
    that does not burn.
    """
    down, right = to_row - row, to_col - col
    north, east = -down * ground.cell_m, right * ground.cell_m
    length2 = north * north + east * east
    at_row, at_col = math.floor(row + 0.5), math.floor(col + 0.5)
    crossings_row, crossings_col = abs(to_row - at_row), abs(to_col - at_col)
    cell = int(at_row) * ground.cols + int(at_col)
    if max(crossings_row, crossings_col) <= ground.reach[cell]:
        crossings_row = crossings_col = 0.0  # all its cells are like the first one
    # Positions at which the line next leaves a row and a column, as fractions of its length.
    row_step, next_row, each_row = 0, 2.0, 0.0
    if crossings_row > 0.0:
        row_step = ground.cols if down > 0.0 else -ground.cols
        each_row = 1.0 / abs(down)
        next_row = ((at_row - row if down > 0.0 else row - at_row) + 0.5) * each_row
    col_step, next_col, each_col = 0, 2.0, 0.0
    if crossings_col > 0.0:
        col_step = 1 if right > 0.0 else -1
        each_col = 1.0 / abs(right)
        next_col = ((at_col - col if right > 0.0 else col - at_col) + 0.5) * each_col
    time_s, done = 0.0, 0.0
    for _ in range(int(crossings_row + crossings_col) + 1):
        leaves_row = next_row < next_col
        upto = min(next_row if leaves_row else next_col, 1.0)
        share = upto - done
        whole = crossing_s(cell, north, east, length2, ground, entry)
        stuck = whole == 0.0 and share > TOUCH
        if stuck or time_s + share * whole > limit_s:
            done += 0.0 if stuck else (limit_s - time_s) / whole
            time_s = limit_s
            break
        time_s += share * whole
        done = upto
        next_row += each_row if leaves_row else 0.0
        next_col += 0.0 if leaves_row else each_col
        cell += row_step if leaves_row else col_step
    return time_s, done


@kernel
def from_segment(row, col, other_row, other_col, target, ground, entry):  # type: ignore[no-untyped-def]
    """Return the point on a straight piece of the front from which fire first reaches a cell.

    The result is the time, the row and the column.

    The slowness of the target cell is used for the whole path. Let d be the vector along the piece,
    w the vector from its start to the cell, and s the fraction of d. The time A |w - s d| - B (w -
    s d) has its minimum where its derivative by s is 0. Its unit is s/m times cells. The time is
    infinite if the ends are too far apart, or if fire does not spread in the cell.
    """
    d_north, d_east = row - other_row, other_col - col
    d2 = d_north * d_north + d_east * d_east
    crossing_s(target, 0.0, 0.0, 0.0, ground, entry)  # computes the slowness of the cell
    a = ground.slowness[target, 0]
    if not 0.0 < d2 <= MAX_SEGMENT_CELLS * MAX_SEGMENT_CELLS or a == 0.0:
        return np.inf, row, col
    b_north, b_east = ground.slowness[target, 1], ground.slowness[target, 2]
    g_north, g_east = ground.rise[target, 6], ground.rise[target, 7]
    w_north, w_east = row - target // ground.cols, target % ground.cols - col
    d_up, w_up = g_north * d_north + g_east * d_east, g_north * w_north + g_east * w_east
    dd = d2 + d_up * d_up
    dw = d_north * w_north + d_east * w_east + d_up * w_up
    ww = w_north * w_north + w_east * w_east + w_up * w_up
    k = (b_north * d_north + b_east * d_east) / (a * math.sqrt(dd))
    perpendicular = math.sqrt(max(ww - dw * dw / dd, 0.0))
    share = (dw - k * perpendicular * math.sqrt(dd) / math.sqrt(1.0 - k * k)) / dd
    share = min(max(share, 0.0), 1.0)
    time = a * math.sqrt(max(ww - 2.0 * share * dw + share * share * dd, 0.0))
    time -= b_north * (w_north - share * d_north) + b_east * (w_east - share * d_east)
    return time, row - share * d_north, col + share * d_east
