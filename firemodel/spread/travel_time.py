"""Compute the travel time of fire along a line over cells with different spread ellipses."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.compiled import compiled, inlined, kernel
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather
from firemodel.spread.local_spread import Tables, Terrain, slowness_of, tables_of, terrain_of
from firemodel.spread.rate_options import RateOptions

ONE, TWO, FOUR, SIX, SEVEN = (np.uint64(each) for each in (1, 2, 4, 6, 7))
TOUCH = 1e-9  # a line with a smaller fraction in a cell only touches a corner of the cell
LAST = 1.0 - TOUCH
# North, north-east, east, ... as steps of (row, col); steps with an odd index are diagonal.
STEP_ROW = np.array([-1, -1, 0, 1, 1, 1, 0, -1])
STEP_COL = np.array([0, 1, 1, 1, 0, -1, -1, -1])


class Ground(NamedTuple):
    """The inputs for travel times; cells are flattened (n)."""

    cols: int
    cell_m: float
    terrain: Terrain
    tables: Tables
    reach: NDArray[np.int16]  # (n) distance in cells within which all cells are like this one
    # One record of 32 bytes for each cell, read in one memory access: A, B north, B east in float64
    # (places 0 to 2 of 4; A is NaN if not yet computed and inf where no fire spreads), and the rise
    # towards north and east in float32 (places 6 and 7 of 8).
    slowness: Floats  # (4 n)
    rise: NDArray[np.float32]  # (8 n), the same memory
    computed: NDArray[np.int32]  # (n + 1) number of computed cells, then their indices


def ground_of(landscape: Landscape, entries: Sequence[Weather], options: RateOptions) -> Ground:
    """Return the ``Ground`` of a landscape; slownesses are computed later, when needed."""
    terrain = terrain_of(landscape, entries, options)
    n, cols = terrain.fuel.size, landscape.shape[1]
    slowness = np.full(4 * n, np.nan)
    return Ground(
        cols,
        landscape.cell_size_m,
        terrain,
        tables_of(landscape, entries, options),
        _reach(terrain, cols),
        slowness,
        slowness.view(np.float32),
        np.zeros(n + 1, dtype=np.int32),
    )


def with_slowness(ground: Ground, slowness: Floats, computed: NDArray[np.int32]) -> Ground:
    """Return a ``Ground`` with the given arrays of slownesses and computed cells."""
    return ground._replace(slowness=slowness, rise=slowness.view(np.float32), computed=computed)


def with_tables(ground: Ground, tables: Tables) -> Ground:
    """Return a ``Ground`` with new tables of the same landscape; no slowness is computed yet."""
    slowness = np.full(ground.slowness.size, np.nan)
    return with_slowness(ground, slowness, np.zeros_like(ground.computed))._replace(tables=tables)


def with_rate_factor(ground: Ground, rate_factor: NDArray[np.float32]) -> Ground:
    """Return a ``Ground`` with new rate factors (n); slownesses must have been cleared before."""
    terrain = ground.terrain._replace(rate_factor=rate_factor)
    return ground._replace(terrain=terrain, reach=_reach(terrain, ground.cols))


def with_weather_of(ground: Ground, model: Ground, tables: Tables) -> Ground:
    """Return a ``Ground`` with ``tables`` and with the wind grids of ``model``."""
    grids, terrain, reach = model.terrain.wind_grids, ground.terrain, ground.reach
    if grids is not terrain.wind_grids:
        terrain = terrain._replace(wind_grids=grids)
        reach = _reach(terrain, ground.cols)
    return ground._replace(terrain=terrain, tables=tables, reach=reach)


def with_closed(ground: Ground, cells: NDArray[np.bool_]) -> Ground:
    """Return a ``Ground`` in which the given cells (n) cannot burn; see ``with_rate_factor``."""
    fuel = np.where(cells, np.int16(-1), ground.terrain.fuel)
    reach = ground.reach.copy()
    _lower_reach(reach, np.flatnonzero(cells), ground.cols)
    return ground._replace(terrain=ground.terrain._replace(fuel=fuel), reach=reach)


@kernel
def _lower_reach(reach, changed, cols):  # type: ignore[no-untyped-def]
    """Limit ``reach`` to the distance from the cells ``changed`` and their neighbours.

    The reach of neighbouring cells differs by at most 1. If no cell of a ring around a changed cell
    is limited, none of the next ring is.
    """
    rows = reach.size // cols
    for cell in changed:
        row, col = cell // cols, cell % cols
        for ring in range(max(rows, cols)):
            limit, lowered = max(ring - 1, 0), False
            for to_row in range(max(row - ring, 0), min(row + ring + 1, rows)):
                step = 1 if abs(to_row - row) == ring else max(2 * ring, 1)
                for to_col in range(col - ring, col + ring + 1, step):
                    if 0 <= to_col < cols and reach[to_row * cols + to_col] > limit:
                        reach[to_row * cols + to_col] = limit
                        lowered = True
            if ring > 1 and not lowered:
                break


@compiled
def _reach(terrain, cols):  # type: ignore[no-untyped-def]
    """Return each cell's chessboard distance to the nearest cell with a different neighbour.

    This is the two-pass algorithm of Rosenfeld & Pfaltz 1966.
    """
    n = terrain.fuel.size
    rows = n // cols
    reach, alike = np.full(n, 32767, dtype=np.int16), np.empty(cols, dtype=np.int16)
    for down, right in ((0, 1), (1, -1), (1, 0), (1, 1)):
        for row in range(rows - down):
            one, count = row * cols + max(-right, 0), cols - abs(right)
            other = one + down * cols + right
            _compare(alike[:count], one, other, terrain)
            reach[one : one + count] &= alike[:count]
            reach[other : other + count] &= alike[:count]
    # Two passes: downwards with the neighbours to the north and west, upwards with the others.
    for row in range(rows):
        _nearer(reach, row, max(row - 1, 0), cols)
        for cell in range(row * cols + 1, (row + 1) * cols):
            reach[cell] = min(reach[cell], reach[cell - 1] + 1)
    for row in range(rows - 1, -1, -1):
        _nearer(reach, row, min(row + 1, rows - 1), cols)
        for cell in range((row + 1) * cols - 2, row * cols - 1, -1):
            reach[cell] = min(reach[cell], reach[cell + 1] + 1)
    return reach


@kernel
def _compare(alike, one, other, terrain):  # type: ignore[no-untyped-def]
    """Set ``alike`` to -1 where cells from ``one`` on equal those from ``other`` on, else to 0."""
    fuel, gradient, midflame, rate_factor, canopy, wind_grids = terrain
    north, east, size = gradient[0], gradient[1], alike.size
    fuel_1, fuel_2 = fuel[one : one + size], fuel[other : other + size]
    north_1, north_2 = north[one : one + size], north[other : other + size]
    east_1, east_2 = east[one : one + size], east[other : other + size]
    midflame_1, midflame_2 = midflame[one : one + size], midflame[other : other + size]
    for k in range(size):
        same = (fuel_1[k] == fuel_2[k]) & (midflame_1[k] == midflame_2[k])
        alike[k] = -((north_1[k] == north_2[k]) & (east_1[k] == east_2[k]) & same)
    if rate_factor.size > 1:
        for k in range(size):
            if rate_factor[one + k] != rate_factor[other + k]:
                alike[k] = 0
    critical_kw_m, density_kg_m3, _ = canopy
    if critical_kw_m.size > 1:
        for k in range(size):
            same = critical_kw_m[one + k] == critical_kw_m[other + k]
            if not (same & (density_kg_m3[one + k] == density_kg_m3[other + k])):
                alike[k] = 0
    for grid in range(wind_grids.shape[0]):
        if not alike.any():
            return
        for part in range(2):
            wind_1 = wind_grids[grid, part, one : one + size]
            wind_2 = wind_grids[grid, part, other : other + size]
            for k in range(size):
                alike[k] &= -(wind_1[k] == wind_2[k])


@kernel
def _nearer(reach, row, other, cols):  # type: ignore[no-untyped-def]
    """Lower the distances in a row to those of the neighbours in another row plus one."""
    shift = (other - row) * cols
    for cell in range(row * cols, (row + 1) * cols):
        west, east = max(cell - 1, row * cols), min(cell + 1, (row + 1) * cols - 1)
        nearest = min(reach[west + shift], reach[cell + shift], reach[east + shift])
        reach[cell] = min(reach[cell], nearest + 1)


@kernel
def _compute_slowness(cell, ground, entry):  # type: ignore[no-untyped-def]
    a, north, east = slowness_of(cell, entry, ground.terrain, ground.tables)
    at = 4 * cell
    ground.slowness[at], ground.slowness[at + 1], ground.slowness[at + 2] = a, north, east
    ground.rise[2 * at + 6] = ground.terrain.gradient[0, cell]
    ground.rise[2 * at + 7] = ground.terrain.gradient[1, cell]
    ground.computed[0] += 1
    ground.computed[ground.computed[0]] = cell


@kernel
def clear_slowness(ground):  # type: ignore[no-untyped-def]
    """Clear the computed slownesses; required before another weather entry is used."""
    for place in range(1, ground.computed[0] + 1):
        ground.slowness[4 * ground.computed[place]] = np.nan
    ground.computed[0] = 0


@kernel
def restore_slowness(ground, model):  # type: ignore[no-untyped-def]
    """Replace the computed slownesses with those of another ``Ground`` of the same landscape."""
    clear_slowness(ground)
    for number in range(1, model.computed[0] + 1):
        cell = model.computed[number]
        ground.computed[number] = cell
        for place in range(4 * cell, 4 * cell + 4):
            ground.slowness[place] = model.slowness[place]
    ground.computed[0] = model.computed[0]


@inlined
def prepare(cell, ground, entry):  # type: ignore[no-untyped-def]
    """Compute the slowness of a cell unless it is already known."""
    if ground.slowness[4 * cell] != ground.slowness[4 * cell]:
        _compute_slowness(cell, ground, entry)


@inlined
def crossing_s(cell, north, east, length2, ground):  # type: ignore[no-untyped-def]
    """Return the time in s along a horizontal vector in metres, at the slowness of one cell.

    ``length2`` is the squared length of the vector. The result is infinite if fire does not spread
    in the cell, and NaN if its slowness is not known (``prepare``).
    """
    slowness, rise = ground.slowness, ground.rise
    at = np.uint64(cell) * FOUR  # unsigned, because an index that is never negative is faster
    up = rise[at + at + SIX] * north + rise[at + at + SEVEN] * east
    return (
        slowness[at] * math.sqrt(length2 + up * up)
        - slowness[at + ONE] * north
        - slowness[at + TWO] * east
    )


@kernel
def cell_at(y, x, ground):  # type: ignore[no-untyped-def]
    """Return the cell at a position (y, x); on an edge, the cell to the south or east."""
    rows = ground.reach.size // ground.cols
    row, col = min(int(y), rows - 1), min(int(x), ground.cols - 1)
    return row * ground.cols + col


@kernel
def evenest_cell(y, x, ground):  # type: ignore[no-untyped-def]
    """Return the cell with the largest ``reach`` among the cells at a position (y, x)."""
    rows, found = ground.reach.size // ground.cols, -1
    for row in range(max(math.ceil(y) - 1, 0), min(math.floor(y) + 1, rows)):
        for col in range(max(math.ceil(x) - 1, 0), min(math.floor(x) + 1, ground.cols)):
            cell = row * ground.cols + col
            if found < 0 or ground.reach[cell] > ground.reach[found]:
                found = cell
    return found


@inlined
def _mirrored(start, end):  # type: ignore[no-untyped-def]
    """Return a line's first row (or column), the number of borders crossed, and the first border.

    The border is given as a distance from the start. All results are exact. The function has no
    branches, because the processor cannot predict the directions of successive lines.
    """
    sign = 1.0 if end >= start else -1.0
    start, end = sign * start, sign * end
    low = np.floor(start)
    borders = max(np.ceil(end) - 1.0 - low, 0.0)
    return (low if sign > 0.0 else -1.0 - low), borders, low + 1.0 - start


@inlined
def _line_s(y, x, to_y, to_x, ground):  # type: ignore[no-untyped-def]
    """Return the result of ``travel`` in the usual case: the time along a whole line.

    The result is not finite if the slowness of a cell is not known, if a cell that does not burn is
    on or beside the line, or if the line has no length or is on an edge. A line through a corner
    enters one of the two other cells for a distance of 0 or of a rounding error. The number of
    iterations of the loop is known before the loop begins, so that the processor can work on
    several cells at once.
    """
    down, right = to_y - y, to_x - x
    north, east = -down * ground.cell_m, right * ground.cell_m
    length2 = north * north + east * east
    at_row, borders_row, first_row = _mirrored(y, to_y)
    at_col, borders_col, first_col = _mirrored(x, to_x)
    if (down == 0.0 and at_row == y) or (right == 0.0 and at_col == x):
        return np.nan
    cell = int(at_row) * ground.cols + int(at_col)
    if max(borders_row, borders_col) <= ground.reach[np.uint64(cell)]:
        return crossing_s(cell, north, east, length2, ground)  # all cells are like the first one
    # Positions at which the line next leaves a row and a column, as fractions of its length.
    each_row, each_col = 1.0 / abs(down), 1.0 / abs(right)
    next_row = first_row * each_row if borders_row > 0.0 else 2.0
    next_col = first_col * each_col if borders_col > 0.0 else 2.0
    row_step = ground.cols if down > 0.0 else -ground.cols
    col_step = 1 if right > 0.0 else -1
    time_s = done = 0.0
    for _ in range(int(borders_row + borders_col)):
        by_row = next_row <= next_col
        upto = next_row if by_row else next_col
        time_s += (upto - done) * crossing_s(cell, north, east, length2, ground)
        done = upto
        # Both sums are computed before the result of the comparison is known.
        row_after, col_after = next_row + each_row, next_col + each_col
        next_row = row_after if by_row else next_row
        next_col = next_col if by_row else col_after
        cell += row_step if by_row else col_step
    return time_s + (1.0 - done) * crossing_s(cell, north, east, length2, ground)


@inlined
def travel_s(y, x, to_y, to_x, limit_s, ground, entry):  # type: ignore[no-untyped-def]
    """Return the time along a line, at most ``limit_s``.

    See ``travel``.
    """
    time_s = _line_s(y, x, to_y, to_x, ground)
    if time_s < np.inf:
        return min(time_s, limit_s)
    time_s, _ = travel(y, x, to_y, to_x, limit_s, ground, entry)
    return time_s


@kernel
def _follow(y, x, to_y, to_x, limit_s, ground):  # type: ignore[no-untyped-def]
    """Follow a line as ``travel`` does, but stop at a cell with unknown slowness.

    Returns the time, the fraction of the line that is covered, and that cell or -1.
    """
    down, right = to_y - y, to_x - x
    north, east = -down * ground.cell_m, right * ground.cell_m
    length2 = north * north + east * east
    if length2 == 0.0:
        return 0.0, 1.0, -1
    rows = ground.reach.size // ground.cols
    at_row, borders_row, first_row = _mirrored(y, to_y)
    at_col, borders_col, first_col = _mirrored(x, to_x)
    beside = 0  # offset of the other cell, for a line along an edge
    if down == 0.0 and at_row == y:
        if at_row == rows:
            at_row -= 1.0
        elif at_row > 0.0:
            beside = -ground.cols
    if right == 0.0 and at_col == x:
        if at_col == ground.cols:
            at_col -= 1.0
        elif at_col > 0.0:
            beside = -1
    cell = int(at_row) * ground.cols + int(at_col)
    if max(borders_row, borders_col) <= ground.reach[cell]:
        borders_row = borders_col = 0.0  # all its cells are like the first one
    # Positions at which the line next leaves a row and a column, as fractions of its length.
    each_row, each_col = 1.0 / abs(down), 1.0 / abs(right)
    next_row = first_row * each_row if borders_row > 0.0 else 2.0
    next_col = first_col * each_col if borders_col > 0.0 else 2.0
    row_step = ground.cols if down > 0.0 else -ground.cols
    col_step = 1 if right > 0.0 else -1
    time_s, done = 0.0, 0.0
    while True:
        upto = min(next_row, next_col)
        upto = upto if upto < LAST else 1.0
        share = upto - done
        whole = crossing_s(cell, north, east, length2, ground)
        if beside != 0:
            other = crossing_s(cell + beside, north, east, length2, ground)
            if other != other:
                return limit_s, done, cell + beside
            whole = min(whole, other)
        if whole != whole:
            return limit_s, done, cell
        if whole == np.inf or time_s + share * whole > limit_s:
            done += 0.0 if whole == np.inf else (limit_s - time_s) / whole
            return limit_s, done, -1
        time_s += share * whole
        done = upto
        if done == 1.0:
            return time_s, done, -1
        leaves_row, leaves_col = next_row <= upto + TOUCH, next_col <= upto + TOUCH
        if leaves_row and leaves_col:  # through a corner
            fuel = ground.terrain.fuel
            if fuel[cell + row_step] < 0 and fuel[cell + col_step] < 0:
                return limit_s, done, -1
        next_row += each_row if leaves_row else 0.0
        next_col += each_col if leaves_col else 0.0
        cell += (row_step if leaves_row else 0) + (col_step if leaves_col else 0)


@kernel
def travel(y, x, to_y, to_x, limit_s, ground, entry):  # type: ignore[no-untyped-def]
    """Follow a line for at most ``limit_s``.

    Positions are (y, x) in cells. A line along an edge has the time of the faster cell beside it.
    Returns the time and the fraction of the line that is covered. The time is ``limit_s`` if the
    line is not completed in this time, crosses a cell that does not burn, or passes between two
    such cells.
    """
    while True:
        time_s, done, unknown = _follow(y, x, to_y, to_x, limit_s, ground)
        if unknown < 0:
            return time_s, done
        _compute_slowness(unknown, ground, entry)


@kernel
def from_segment(y, x, other_y, other_x, to_y, to_x, most_cells, ground, entry):  # type: ignore[no-untyped-def]
    """Return the point on a straight piece of the front from which fire first reaches a target.

    The result is the time and the point (y, x).

    For the whole path, the slowness of one cell is used: the last cell on the path from the piece's
    midpoint. Let d be the vector along the piece, w the vector from the start of the piece to the
    target, and s the position along the piece as a fraction of d. The time A |w - s d| - B (w -
    s d) has its minimum where the derivative with respect to s is 0. The unit of the time is s/m
    times cells. The time is infinite if the ends are more than ``most_cells`` apart, or if fire
    does not spread in the cell.
    """
    d_north, d_east = y - other_y, other_x - x
    d2 = d_north * d_north + d_east * d_east
    if not 0.0 < d2 <= most_cells * most_cells:
        return np.inf, y, x
    middle_y, middle_x = 0.5 * (y + other_y), 0.5 * (x + other_x)
    target = cell_at(to_y + TOUCH * (middle_y - to_y), to_x + TOUCH * (middle_x - to_x), ground)
    prepare(target, ground, entry)
    a = ground.slowness[4 * target]
    if a == np.inf:
        return np.inf, y, x
    b_north, b_east = ground.slowness[4 * target + 1], ground.slowness[4 * target + 2]
    g_north, g_east = ground.rise[8 * target + 6], ground.rise[8 * target + 7]
    w_north, w_east = y - to_y, to_x - x
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
    return time, y - share * d_north, x + share * d_east
