"""Arrival times at any angle: each cell keeps the cell from which fire came to it in one line.

A burning cell offers its neighbours two ways: straight from its own parent, or from itself. The
time along a line is added up over the cells it crosses, each with its own ellipse, through every
change of weather on the way: nothing already covered is lost. Cells are taken in order of time
(Dijkstra 1959; the parents as in Nash et al. 2007, "Theta*"). Where the conditions are the same
all around, lines may be of any length and arrival times are those of the exact ellipse.

The way over a vector v takes A |v| - B v on a plane in the slope, with A = 1/(R (1 - e)) and
B = e A along the direction of fastest spread R.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.heap import drop_first, push
from firemodel.landscape import Landscape
from firemodel.local_spread import Tables, Terrain, head_of, tables_of, terrain_of
from firemodel.weather import WeatherStream

LONGEST_LINE_CELLS = 16  # over changing ground
ZERO, ONE = np.zeros(1, dtype=np.int32), np.ones(1)
STEP_ROW = np.array([-1, -1, 0, 1, 1, 1, 0, -1])
STEP_COL = np.array([0, 1, 1, 1, 0, -1, -1, -1])


class _State(NamedTuple):
    arrival_s: NDArray[np.float64]  # (n) infinity until it burns
    best_s: NDArray[np.float64]  # (n) earliest arrival found so far
    parent: NDArray[np.int32]  # (n) where the line to it begins
    reach: NDArray[np.int16]  # (n) cells around that have the same conditions
    # What is known of a cell's ellipse in two entries of the weather, even and odd.
    ellipse: NDArray[np.float64]  # (n, 2, 3): A, B towards north and east in s/m
    entry: NDArray[np.int32]  # (n, 2) the entry it is known for, -1 for none


class AnyAngleFire:
    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        ignitions: Sequence[tuple[int, int, float]],
    ) -> None:
        self.landscape = landscape
        self.weather = weather
        self.time_s = 0.0
        n = landscape.fuel_model.size
        self._terrain = terrain_of(landscape)
        self._tables = tables_of(landscape, weather.entries)
        slots = min(len(weather.entries), 2)
        self._state = _State(
            np.full(n, np.inf),
            np.full(n, np.inf),
            np.empty(n, dtype=np.int32),
            _reach(landscape, self._terrain),
            np.empty((n, slots, 3)),
            np.full((n, slots), -1, dtype=np.int32),
        )
        self.arrival_time_s = self._state.arrival_s.reshape(landscape.shape)
        self._heap = (np.empty(0), np.empty(0, dtype=np.int64), 0)
        for row, col, time_s in ignitions:
            cell = row * landscape.shape[1] + col
            self._state.best_s[cell] = time_s
            self._state.parent[cell] = cell
            self._heap = push(*self._heap, float(time_s), cell)
        self._lines = lines(LONGEST_LINE_CELLS, landscape.shape[1])
        self.advance(0.0)

    def advance(self, to_time_s: float) -> None:
        if not self.time_s <= to_time_s < np.inf:
            raise FireModelError("time")
        self._heap = _burn(
            to_time_s,
            *self._heap,
            self._state,
            self._terrain,
            self._tables,
            self.landscape.shape[1],
            self.landscape.cell_size_m,
            LONGEST_LINE_CELLS,
            *self._lines,
        )
        self.time_s = float(to_time_s)


def _reach(landscape: Landscape, terrain: Terrain) -> NDArray[np.int16]:
    from scipy.ndimage import distance_transform_cdt

    rows, cols = landscape.shape
    changes = np.zeros((rows, cols), dtype=bool)
    for layer in (terrain.fuel, *terrain.gradient, terrain.midflame):
        values = layer.reshape(rows, cols)
        for a, b in (
            ((slice(1, None), slice(None)), (slice(None, -1), slice(None))),
            ((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
            ((slice(1, None), slice(1, None)), (slice(None, -1), slice(None, -1))),
            ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))),
        ):
            differs = values[a] != values[b]
            changes[a] |= differs
            changes[b] |= differs
    if not changes.any():
        return np.full(rows * cols, 32767, dtype=np.int16)
    return distance_transform_cdt(~changes, "chessboard").ravel().astype(np.int16)


@njit(cache=True)
def _learn(cell, entry, slot, ellipse, known, terrain, tables):
    """Work out a cell's ellipse for an entry of the weather."""
    known[cell, slot] = entry
    a, north, east = np.inf, 0.0, 0.0
    if terrain.fuel[cell] >= 0:
        rate, to_north, to_east, e = head_of(cell, entry, terrain, tables)
        if rate > 0.0:
            rise_north, rise_east = terrain.gradient[0, cell], terrain.gradient[1, cell]
            a = 1.0 / (rate * (1.0 - e))
            up = rise_north * to_north + rise_east * to_east
            b = e * a / np.sqrt(1.0 + up * up)
            north = b * (to_north + up * rise_north)
            east = b * (to_east + up * rise_east)
    ellipse[cell, slot, 0], ellipse[cell, slot, 1], ellipse[cell, slot, 2] = a, north, east


@njit(cache=True, inline="always")
def _time_over(cell, entry, north, east, length2, state, terrain, tables):
    """Time to cover a horizontal vector (m) within one cell's conditions."""
    slot = entry % state.ellipse.shape[1]
    if state.entry[cell, slot] != entry:
        _learn(cell, entry, slot, state.ellipse, state.entry, terrain, tables)
    rise = terrain.gradient[0, cell] * north + terrain.gradient[1, cell] * east
    return (
        state.ellipse[cell, slot, 0] * math.sqrt(length2 + rise * rise)
        - state.ellipse[cell, slot, 1] * north
        - state.ellipse[cell, slot, 2] * east
    )


@njit(cache=True)
def _slow_line(now, entry, source, first, last, north, east, state, terrain, tables, offset, share):
    """As the loop in _line, through changes of weather."""
    length2 = north * north + east * east
    for k in range(first, last):
        left = share[k]
        cell = source + offset[k]
        while True:
            whole = _time_over(cell, entry, north, east, length2, state, terrain, tables)
            until = tables.until_s[entry]
            if now + left * whole <= until:
                now += left * whole
                break
            left -= (until - now) / whole
            now = until
            entry += 1
    return now


@njit(cache=True, inline="always")
def _line(now, entry, source, first, last, north, east, state, terrain, tables, offset, share):
    length2 = north * north + east * east
    found = now
    for k in range(first, last):
        found += share[k] * _time_over(
            source + offset[k], entry, north, east, length2, state, terrain, tables
        )
    if found > tables.until_s[entry]:
        found = _slow_line(
            now, entry, source, first, last, north, east, state, terrain, tables, offset, share
        )
    return found


@njit(cache=True)
def lines(limit, cols):
    """Cells that a line from a cell's centre crosses and its share in each, for all short lines."""
    width = 2 * limit + 1
    start = np.zeros(width * width + 1, dtype=np.int32)
    offset = np.zeros(width * width * (2 * limit + 1), dtype=np.int32)
    share = np.zeros(offset.size)
    size = 0
    for down in range(-limit, limit + 1):
        for right in range(-limit, limit + 1):
            rows, cols_ = abs(down), abs(right)
            step_row = cols if down > 0 else -cols
            step_col = 1 if right > 0 else -1
            i = j = 0
            cell = 0
            done = 0.0
            while True:
                by_row = (2 * i + 1) * cols_ if i < rows else 1 << 30
                by_col = (2 * j + 1) * rows if j < cols_ else 1 << 30
                if i < rows and cols_ == 0: by_row = 0
                if j < cols_ and rows == 0: by_col = 0
                upto = 1.0
                step = 0
                if by_row <= by_col and i < rows:
                    upto = (2 * i + 1) / (2 * rows)
                    step += step_row
                if by_col <= by_row and j < cols_:
                    upto = (2 * j + 1) / (2 * cols_)
                    step += step_col
                if by_row <= by_col and i < rows: 
                    tie = by_row == by_col and j < cols_
                    i += 1
                    if tie: j += 1
                elif j < cols_:
                    j += 1
                offset[size], share[size] = cell, upto - done
                size += 1
                cell += step
                done = upto
                if step == 0:
                    break
            start[(down + limit) * width + right + limit + 1] = size
    return start, offset[:size].copy(), share[:size].copy()


@njit(cache=True)
def _burn(to_time_s, times, keys, size, state, terrain, tables, cols, cell_m, limit, start, offset, share):
    rows = state.arrival_s.size // cols
    width = 2 * limit + 1
    origin = limit * width + limit
    entry = 0
    while size > 0 and times[0] <= to_time_s:
        now, cell = times[0], keys[0]
        size = drop_first(times, keys, size)
        if state.arrival_s[cell] < np.inf:
            continue
        state.arrival_s[cell] = now
        while tables.until_s[entry] <= now:
            entry += 1
        parent = state.parent[cell]
        parent_s = state.arrival_s[parent]
        parent_entry = entry
        while parent_entry > 0 and tables.until_s[parent_entry - 1] > parent_s:
            parent_entry -= 1
        row, col = cell // cols, cell % cols
        parent_row, parent_col = parent // cols, parent % cols
        for side in range(8):
            to_row, to_col = row + STEP_ROW[side], col + STEP_COL[side]
            if not (0 <= to_row < rows and 0 <= to_col < cols):
                continue
            target = to_row * cols + to_col
            if terrain.fuel[target] < 0 or state.arrival_s[target] < np.inf:
                continue
            found, via = np.inf, parent
            down, right = to_row - parent_row, to_col - parent_col
            far = max(abs(down), abs(right))
            alike = far <= state.reach[parent]
            if alike:
                found = _line(parent_s, parent_entry, parent, 0, 1, -down * cell_m, right * cell_m, state, terrain, tables, ZERO, ONE)
            else:
                if far <= limit and parent != cell:
                    place = origin + down * width + right
                    found = _line(parent_s, parent_entry, parent, start[place], start[place + 1], -down * cell_m, right * cell_m, state, terrain, tables, offset, share)
                if STEP_ROW[side] == 0 or STEP_COL[side] == 0 or terrain.fuel[cell + STEP_ROW[side] * cols] >= 0 or terrain.fuel[cell + STEP_COL[side]] >= 0:
                    place = origin + STEP_ROW[side] * width + STEP_COL[side]
                    direct = _line(now, entry, cell, start[place], start[place + 1], -STEP_ROW[side] * cell_m, STEP_COL[side] * cell_m, state, terrain, tables, offset, share)
                    if direct < found:
                        found, via = direct, cell
            found = max(found, now)
            if found < state.best_s[target]:
                state.best_s[target] = found
                state.parent[target] = via
                times, keys, size = push(times, keys, size, found, target)
    return times, keys, size
