"""Arrival times at any angle: fire comes to a cell in a straight line from a source.

A source is the centre of a burned cell, or a point where the front stood when the weather changed.
A cell that burns offers its neighbours two ways: straight from its own source, or from itself. The
time along a line is added up over the cells it crosses, each with its own ellipse. Cells are taken
in order of time (Dijkstra 1959; the parents as in Nash et al. 2007, "Theta*"). Where conditions are
the same all around, lines may be of any length, and arrival times are those of the exact ellipse.

When the weather changes, each line under way is cut where the fire is on it, and that point becomes
the source of the rest: what has not burned is rated anew, and no way already covered is lost.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from firemodel.compiled import kernel
from firemodel.errors import FireModelError
from firemodel.heap import drop_first, push
from firemodel.landscape import Landscape
from firemodel.local_spread import Tables, Terrain, slowness_of, tables_of, terrain_of
from firemodel.weather import WeatherStream

LONGEST_LINE_CELLS = 16  # over changing ground
TOUCH = 1e-9  # share of a line in a cell that it only touches at a corner
STEP_ROW = np.array([-1, -1, 0, 1, 1, 1, 0, -1])
STEP_COL = np.array([0, 1, 1, 1, 0, -1, -1, -1])
SAME = 1e-12

Floats = NDArray[np.float64]


class Ground(NamedTuple):
    """What lines are reckoned with; cells in one row (n)."""

    cols: int
    cell_m: float
    terrain: Terrain
    tables: Tables
    reach: NDArray[np.int16]  # (n) how many cells around, to all sides, are like it
    # One record of 32 bytes per cell, so that one look into memory gives all: A, B north, B east
    # in float64 (places 0 to 2; A is NaN if not yet worked out, 0 if nothing spreads), and the
    # rise towards north and east in float32 (places 6 and 7).
    slowness: Floats  # (n, 4)
    rise: NDArray[np.float32]  # (n, 8), the same memory
    learned: NDArray[np.int32]  # (n + 1) how many cells are worked out, then which


class Labels(NamedTuple):
    """What is known of when and whence fire comes; cells in one row (n)."""

    arrival_s: Floats  # (n) infinity until it burns
    best_s: Floats  # (n) earliest arrival found so far; minus infinity where nothing burns
    source: NDArray[np.int32]  # (n) a cell, or n + place among the points; -1 if fire is not near


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
        terrain = terrain_of(landscape)
        slowness = np.full((n, 4), np.nan)
        self._ground = Ground(
            landscape.shape[1],
            landscape.cell_size_m,
            terrain,
            tables_of(landscape, weather.entries),
            _reach(terrain, landscape.shape[1]),
            slowness,
            slowness.view(np.float32),
            np.zeros(n + 1, dtype=np.int32),
        )
        self._changes_s = [*weather.change_times(), math.inf]
        self._entry = weather.index_at(0.0)
        self._since_s = 0.0
        self._labels = Labels(
            np.full(n, np.inf),
            np.where(terrain.fuel < 0, -np.inf, np.inf),
            np.full(n, -1, dtype=np.int32),
        )
        self.arrival_time_s = self._labels.arrival_s.reshape(landscape.shape)
        self._heap = [np.empty(1024), np.empty(1024, dtype=np.int32), 0]
        self._points = np.empty((0, 3))  # row, column, time of sources between centres of cells
        self._way = (np.empty(0, dtype=np.int64), np.empty((0, 2)))
        for row, col, time_s in ignitions:
            cell = row * landscape.shape[1] + col
            self._labels.best_s[cell] = time_s
            self._labels.source[cell] = cell
            self._heap[2] = push(*self._heap, float(time_s), cell)
        self.advance(0.0)

    def advance(self, to_time_s: float) -> None:
        if not self.time_s <= to_time_s < np.inf:
            raise FireModelError("time")
        while self._changes_s[self._entry] < to_time_s:
            self._burn(self._changes_s[self._entry])
            self._change_weather()
        self._burn(to_time_s)
        self.time_s = float(to_time_s)

    def _burn(self, to_time_s):
        while True:
            times, keys, size = self._heap
            size = _burn(to_time_s, times, keys, size, self._points, self._labels, self._ground, self._entry)
            self._heap[2] = size
            if size == 0 or times[0] > to_time_s:
                return
            self._heap = [np.resize(times, 2*times.size), np.resize(keys, 2*times.size), size]

    def _change_weather(self):
        at_s = self._changes_s[self._entry]
        self._way = _under_way(at_s, self._since_s, *self._heap, *self._way, self._points, self._labels, self._ground, self._entry)
        _forget(self._ground.slowness, self._ground.learned)
        self._entry += 1
        self._since_s = at_s
        heap, self._points = _set_out(at_s, *self._way, self._points, self._labels, self._ground, self._entry)
        self._heap = list(heap)


@njit(cache=True)
def _reach(terrain, cols):  # type: ignore[no-untyped-def]
    """(n) how many cells around each one, to all sides, are like it."""
    fuel, gradient, midflame = terrain
    n = fuel.size
    rows = n // cols
    reach = np.empty(n, dtype=np.int16)
    for cell in range(n):
        row, col = cell // cols, cell % cols
        reach[cell] = 32767
        for side in range(8):
            r, c = row + STEP_ROW[side], col + STEP_COL[side]
            if 0 <= r < rows and 0 <= c < cols:
                other = r * cols + c
                if (
                    fuel[other] != fuel[cell]
                    or gradient[0, other] != gradient[0, cell]
                    or gradient[1, other] != gradient[1, cell]
                    or midflame[other] != midflame[cell]
                ):
                    reach[cell] = 0
                    break
    # The chessboard distance to such an edge, in two passes (Rosenfeld & Pfaltz 1966).
    for cell in range(n):
        row, col = cell // cols, cell % cols
        least = reach[cell]
        if col > 0:
            least = min(least, reach[cell - 1] + 1)
        if row > 0:
            least = min(least, reach[cell - cols] + 1)
            if col > 0:
                least = min(least, reach[cell - cols - 1] + 1)
            if col < cols - 1:
                least = min(least, reach[cell - cols + 1] + 1)
        reach[cell] = least
    for cell in range(n - 1, -1, -1):
        row, col = cell // cols, cell % cols
        least = reach[cell]
        if col < cols - 1:
            least = min(least, reach[cell + 1] + 1)
        if row < rows - 1:
            least = min(least, reach[cell + cols] + 1)
            if col < cols - 1:
                least = min(least, reach[cell + cols + 1] + 1)
            if col > 0:
                least = min(least, reach[cell + cols - 1] + 1)
        reach[cell] = least
    return reach


@kernel
def _learn(cell, ground, entry):  # type: ignore[no-untyped-def]
    a, north, east = slowness_of(cell, entry, ground.terrain, ground.tables)
    ground.slowness[cell, 0], ground.slowness[cell, 1], ground.slowness[cell, 2] = a, north, east
    ground.rise[cell, 6] = ground.terrain.gradient[0, cell]
    ground.rise[cell, 7] = ground.terrain.gradient[1, cell]
    ground.learned[0] += 1
    ground.learned[ground.learned[0]] = cell


@kernel
def _forget(slowness, learned):  # type: ignore[no-untyped-def]
    for k in range(1, learned[0] + 1):
        slowness[learned[k], 0] = np.nan
    learned[0] = 0


@kernel
def _crossing_s(cell, north, east, length2, ground, entry):  # type: ignore[no-untyped-def]
    """Time over a horizontal vector (m) as if all of it lay in one cell; 0 if nothing spreads."""
    slowness, rise = ground.slowness, ground.rise
    if slowness[cell, 0] != slowness[cell, 0]:
        _learn(cell, ground, entry)
    up = rise[cell, 6] * north + rise[cell, 7] * east
    return (
        slowness[cell, 0] * math.sqrt(length2 + up * up)
        - slowness[cell, 1] * north
        - slowness[cell, 2] * east
    )


@kernel
def _travel(row, col, to_row, to_col, limit_s, ground, entry):  # type: ignore[no-untyped-def]
    """Follow a line (rows, columns) for limit_s at most: (time it takes, part of it covered)."""
    cols = ground.cols
    down, right = to_row - row, to_col - col
    north, east = -down * ground.cell_m, right * ground.cell_m
    length2 = north * north + east * east
    at_row, at_col = math.floor(row + 0.5), math.floor(col + 0.5)
    crossings_row, crossings_col = abs(to_row - at_row), abs(to_col - at_col)
    cell = int(at_row) * cols + int(at_col)
    if max(crossings_row, crossings_col) <= ground.reach[cell]:
        crossings_row = crossings_col = 0.0
    # Where the line next leaves a row and a column of cells, as shares of its length.
    row_step, next_row, each_row = 0, 2.0, 0.0
    if crossings_row > 0.0:
        row_step = cols if down > 0.0 else -cols
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
        whole = _crossing_s(cell, north, east, length2, ground, entry)
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
def _place_of(source, points, labels, cols):  # type: ignore[no-untyped-def]
    """Row, column and time of a source."""
    n = labels.source.size
    if source < n:
        return float(source // cols), float(source % cols), labels.arrival_s[source]
    return points[source - n, 0], points[source - n, 1], points[source - n, 2]


@kernel
def _burn(to_time_s, times, keys, size, points, labels, ground, entry):  # type: ignore[no-untyped-def]
    arrival_s, best_s, sources = labels
    cols = ground.cols
    rows = arrival_s.size // cols
    while size > 0 and times[0] <= to_time_s and size + 8 <= times.size:
        now, cell = times[0], np.int64(keys[0])
        size = drop_first(times, keys, size)
        if arrival_s[cell] < np.inf:
            continue
        arrival_s[cell] = now
        row, col = cell // cols, cell % cols
        source = sources[cell]
        source_row, source_col, source_s = _place_of(source, points, labels, cols)
        near = ground.reach[int(math.floor(source_row + 0.5)) * cols + int(math.floor(source_col + 0.5))]
        for side in range(8):
            to_row, to_col = row + STEP_ROW[side], col + STEP_COL[side]
            if not (0 <= to_row < rows and 0 <= to_col < cols):
                continue
            target = to_row * cols + to_col
            best = best_s[target]
            if best <= now:
                continue
            if side & 1 and best_s[row * cols + to_col] == -np.inf and best_s[to_row * cols + col] == -np.inf:
                continue
            via = sources[target]
            if via == source:
                continue
            far = max(abs(to_row - source_row), abs(to_col - source_col))
            if source != cell and far <= max(near, LONGEST_LINE_CELLS):
                limit = best - source_s
                found, _ = _travel(source_row, source_col, float(to_row), float(to_col), limit, ground, entry)
                if found < limit:
                    best, via = max(source_s + found, now), source
            if via < 0 or source == cell or far > near - 0.5:
                north, east = -STEP_ROW[side] * ground.cell_m, STEP_COL[side] * ground.cell_m
                length2 = north * north + east * east
                half = 0.5 * _crossing_s(cell, north, east, length2, ground, entry)
                if half > 0.0 and now + half < best:
                    rest = 0.5 * _crossing_s(target, north, east, length2, ground, entry)
                    if rest > 0.0 and now + half + rest < best * (1.0 - SAME):
                        best, via = now + half + rest, cell
            if best < best_s[target] or sources[target] < 0:
                best_s[target] = best
                sources[target] = via if via >= 0 else cell
                size = push(times, keys, size, best, target)
    return size


@njit(cache=True)
def _under_way(at_s, since_s, times, keys, size, way_to, way_from, points, labels, ground, entry):  # type: ignore[no-untyped-def]
    """Every line on which fire is under way: (cell it leads to), (row, column) where the fire is."""
    arrival_s, best_s, sources = labels
    cols = ground.cols
    n = arrival_s.size
    rows = n // cols
    to, at = np.empty(max(way_to.size + 4 * size, 64), dtype=np.int64), np.empty((max(way_to.size + 4 * size, 64), 2))
    count = 0
    seen = np.empty(16, dtype=np.int64)
    for k in range(way_to.size):
        target = way_to[k]
        if arrival_s[target] < np.inf:
            continue
        to_row, to_col = float(target // cols), float(target % cols)
        row, col = way_from[k, 0], way_from[k, 1]
        _, part = _travel(row, col, to_row, to_col, at_s - since_s, ground, entry)
        to[count] = target
        at[count, 0], at[count, 1] = row + part * (to_row - row), col + part * (to_col - col)
        count += 1
    for k in range(size):
        target = np.int64(keys[k])
        if arrival_s[target] < np.inf or best_s[target] != times[k]:
            continue
        to_row, to_col = target // cols, target % cols
        many = 0
        for side in range(8):
            row, col = to_row + STEP_ROW[side], to_col + STEP_COL[side]
            if not (0 <= row < rows and 0 <= col < cols):
                continue
            cell = row * cols + col
            if not since_s <= arrival_s[cell] < np.inf:
                continue
            if side & 1 and best_s[row * cols + to_col] == -np.inf and best_s[to_row * cols + col] == -np.inf:
                continue
            for source in (np.int64(cell), np.int64(sources[cell])):
                known = False
                for i in range(many):
                    known = known or seen[i] == source
                if known:
                    continue
                seen[many] = source
                many += 1
                source_row, source_col, source_s = _place_of(source, points, labels, cols)
                if source_s < since_s:
                    continue
                _, part = _travel(source_row, source_col, float(to_row), float(to_col), at_s - source_s, ground, entry)
                if count == to.size:
                    more_to, more_at = np.empty(2 * count, dtype=np.int64), np.empty((2 * count, 2))
                    more_to[:count], more_at[:count] = to, at
                    to, at = more_to, more_at
                to[count] = target
                at[count, 0] = source_row + part * (to_row - source_row)
                at[count, 1] = source_col + part * (to_col - source_col)
                count += 1
    return to[:count].copy(), at[:count].copy()


@njit(cache=True)
def _set_out(at_s, way_to, way_from, points, labels, ground, entry):  # type: ignore[no-untyped-def]
    """Rate the lines anew: a fresh heap, and the points that became sources."""
    arrival_s, best_s, sources = labels
    cols = ground.cols
    n = arrival_s.size
    for k in range(way_to.size):
        best_s[way_to[k]] = np.inf
        sources[way_to[k]] = -1
    for k in range(way_to.size):
        target = way_to[k]
        limit = best_s[target] - at_s
        found, _ = _travel(way_from[k, 0], way_from[k, 1], float(target // cols), float(target % cols), limit, ground, entry)
        if found < limit or sources[target] < 0:
            best_s[target] = at_s + found
            sources[target] = n + points.shape[0] + k
    every = np.empty((points.shape[0] + way_to.size, 3))
    every[: points.shape[0]] = points
    times, keys, size = np.empty(way_to.size+64), np.empty(way_to.size+64, dtype=np.int32), 0
    used = points.shape[0]
    for k in range(way_to.size):
        target = way_to[k]
        if sources[target] == n + points.shape[0] + k:
            sources[target] = n + used
            every[used, 0], every[used, 1], every[used, 2] = way_from[k, 0], way_from[k, 1], at_s
            used += 1
            size = push(times, keys, size, best_s[target], target)
    return (times, keys, size), every[:used].copy()
