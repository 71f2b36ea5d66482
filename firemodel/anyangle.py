"""Arrival times at any angle: fire comes to a cell in a straight line from a source.

A source is the centre of a burned cell, or a point where the front stood when the weather changed.
A cell that burns offers its neighbours two ways: straight from its own source, or from itself. The
time along a line is added up over the cells it crosses (``lines``). Cells are taken in order of
time (Dijkstra 1959; the parents as in Nash et al. 2007, "Theta*"). Where conditions are the same
all around, lines may be of any length, and arrival times are those of the exact ellipse.

When the weather changes, each line under way is cut where the fire is on it, and that point becomes
the source of the rest: what has not burned is rated anew, and no way already covered is lost.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from firemodel.fire import Burning, Fire, Ignition, check_ignitions
from firemodel.heap import drop_first, push
from firemodel.landscape import Landscape
from firemodel.lines import STEP_COL, STEP_ROW, cell_at, crossing_s, forget, ground_of, travel
from firemodel.weather import WeatherStream

LONGEST_LINE_CELLS = 16  # over changing ground
ROUNDING = 1e-12  # a way must be better by more than this part of the time
NEAR_FRONT_CELLS = 2  # which cells a front that is given sets out for

Floats = NDArray[np.float64]


class Labels(NamedTuple):
    """What is known of when and whence fire comes; cells in one row (n)."""

    arrival_s: Floats  # (n) infinity until it burns
    best_s: Floats  # (n) earliest arrival found so far; minus infinity where nothing burns
    source: NDArray[np.int32]  # (n) a cell, or n + place among the points; -1 if fire is not near


class Heap(NamedTuple):
    """Which cell fire comes to next (see ``heap``)."""

    times: Floats
    cells: NDArray[np.int32]
    size: int


class Ways(NamedTuple):
    """Every line on which fire was under way when the weather last changed."""

    target: NDArray[np.int32]  # (k) the cell it leads to
    at: Floats  # (k, 2) where the fire was: row, column


class AnyAngleFire(Fire):
    """The default scheme; see the module."""

    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        ignitions: Sequence[Ignition],
        burning: Burning | None = None,
        *,
        wind_limit: bool = False,
    ) -> None:
        """Raises FireModelError where nothing can burn."""
        self.landscape = landscape
        self.weather = weather
        self.wind_limit = wind_limit
        self.time_s = burning.at_s if burning else 0.0
        check_ignitions(landscape, ignitions, self.time_s)
        n, cols = landscape.fuel_model.size, landscape.shape[1]
        self._ground = ground_of(landscape, weather.entries, wind_limit)
        self._labels = Labels(
            np.full(n, np.inf),
            np.where(self._ground.terrain.fuel < 0, -np.inf, np.inf),
            np.full(n, -1, dtype=np.int32),
        )
        self.arrival_time_s = self._labels.arrival_s.reshape(landscape.shape)
        self._heap = _empty_heap(1024)
        self._points, self._used = np.empty((0, 3)), 0  # sources: row, column, time
        self._ways = Ways(np.empty(0, dtype=np.int32), np.empty((0, 2)))
        self._entry = weather.index_at(self.time_s)
        self._since_s = self.time_s  # when the ways set out
        self._changes_s = [*weather.change_times(), math.inf]
        self._ignitions = sorted((time_s, row * cols + col) for row, col, time_s in ignitions)
        self._ignitions.reverse()  # the next one last
        if burning:
            burned = np.isfinite(burning.arrival_s.ravel())
            self._labels.arrival_s[burned] = burning.arrival_s.ravel()[burned]
            self._labels.best_s[burned] = burning.arrival_s.ravel()[burned]
            self._labels.source[burned] = burned.nonzero()[0]
            self._set_out(_ways_from(burning.front, self._labels.best_s, landscape.shape))
        self.advance(self.time_s)

    def _burn_until(self, to_time_s: float) -> None:
        while True:
            ignition_s = self._ignitions[-1][0] if self._ignitions else math.inf
            change_s = self._changes_s[self._entry]
            self._burn(min(to_time_s, ignition_s, change_s))
            if min(ignition_s, change_s) > to_time_s:
                return
            if ignition_s <= change_s:
                self._ignite(*self._ignitions.pop())
            else:
                self._change_weather(change_s)

    def _burn(self, to_time_s: float) -> None:
        """With the weather as it is now."""
        while True:
            size = _burn(
                to_time_s, *self._heap, self._points, self._labels, self._ground, self._entry
            )
            times, cells = self._heap.times, self._heap.cells
            self._heap = Heap(times, cells, size)
            if size == 0 or times[0] > to_time_s:
                return
            self._heap = Heap(np.resize(times, 2 * size), np.resize(cells, 2 * size), size)

    def _ignite(self, at_s: float, cell: int) -> None:
        labels = self._labels
        if labels.arrival_s[cell] == np.inf:
            labels.best_s[cell], labels.source[cell] = at_s, cell
            times, cells, size = self._heap
            if size == times.size:
                times, cells = np.resize(times, 2 * size), np.resize(cells, 2 * size)
            self._heap = Heap(times, cells, push(times, cells, size, at_s, cell))

    def _change_weather(self, at_s: float) -> None:
        room = self._ways.target.size + 16 * self._heap.size
        ways = Ways(np.empty(room, dtype=np.int32), np.empty((room, 2)))
        count = _under_way(
            at_s,
            self._since_s,
            self._heap,
            self._ways,
            self._points,
            self._labels,
            self._ground,
            self._entry,
            ways,
        )
        forget(self._ground)
        self._entry += 1
        self._since_s = at_s
        self._set_out(Ways(ways.target[:count].copy(), ways.at[:count].copy()))

    def _set_out(self, ways: Ways) -> None:
        """On these ways, all others being given up, at the time since_s."""
        self._ways = ways
        count = ways.target.size
        while self._points.shape[0] < self._used + count:
            self._points = np.resize(self._points, (2 * (self._used + count), 3))
        heap = _empty_heap(count + 1024)
        best = np.full(count, -1, dtype=np.int32)
        self._used, size = _set_out(
            self._since_s,
            ways,
            best,
            heap,
            self._points,
            self._used,
            self._labels,
            self._ground,
            self._entry,
        )
        self._heap = Heap(heap.times, heap.cells, size)

    def ways(self) -> Floats:
        """Metres towards north and east (2, y, x) from each cell's source; 0 where it was lit."""
        labels, (rows, cols) = self._labels, self.landscape.shape
        n, burned = rows * cols, np.isfinite(labels.arrival_s)
        centres = np.stack(np.divmod(np.arange(n), cols)).astype(np.float64)
        source = np.where(burned, labels.source, np.arange(n))
        sources = np.concatenate([centres, self._points[: self._used, :2].T], axis=1)
        down, right = centres - sources[:, source]
        return np.stack([-down, right]).reshape(2, rows, cols) * self.landscape.cell_size_m

    def _expected_s(self) -> Floats:
        best_s = self._labels.best_s.reshape(self.landscape.shape)
        return np.where(best_s == -np.inf, np.inf, best_s)


def _empty_heap(room: int) -> Heap:
    return Heap(np.empty(room), np.empty(room, dtype=np.int32), 0)


def _ways_from(front: Floats, best_s: Floats, shape: tuple[int, int]) -> Ways:
    """From the points of a front to the unburned cells around each."""
    rows, cols = shape
    around = np.arange(-NEAR_FRONT_CELLS, NEAR_FRONT_CELLS + 1)
    cell = np.floor(front + 0.5).astype(np.int64)
    row = (cell[:, 0, None, None] + around[:, None]).repeat(around.size, axis=2)
    col = (cell[:, 1, None, None] + around).repeat(around.size, axis=1)
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    target = np.where(inside, row * cols + col, 0)
    wanted = inside & (best_s[target] == np.inf)
    point = np.nonzero(wanted)[0]
    return Ways(target[wanted].astype(np.int32), front[point])


@kernel
def _place_of(source, points, labels, cols):  # type: ignore[no-untyped-def]
    """Row, column and time of a source."""
    n = labels.source.size
    if source < n:
        return float(source // cols), float(source % cols), labels.arrival_s[source]
    return points[source - n, 0], points[source - n, 1], points[source - n, 2]


@kernel
def _squeezes(row, col, to_row, to_col, best_s, cols):  # type: ignore[no-untyped-def]
    """Whether a diagonal step leads between two cells that cannot burn."""
    return (
        row != to_row
        and col != to_col
        and best_s[row * cols + to_col] == -np.inf
        and best_s[to_row * cols + col] == -np.inf
    )


@kernel
def _burn(to_time_s, times, cells, size, points, labels, ground, entry):  # type: ignore[no-untyped-def]
    """Take cells off the heap until a time, or until it has no room; returns its new size."""
    arrival_s, best_s, sources = labels
    cols = ground.cols
    rows = arrival_s.size // cols
    while size > 0 and times[0] <= to_time_s and size + 8 <= times.size:
        now, cell = times[0], np.int64(cells[0])
        size = drop_first(times, cells, size)
        if arrival_s[cell] < np.inf:
            continue
        arrival_s[cell] = now
        row, col = cell // cols, cell % cols
        source = sources[cell]
        from_row, from_col, from_s = _place_of(source, points, labels, cols)
        alike = ground.reach[cell_at(from_row, from_col, cols)] - 0.5
        for side in range(8):
            to_row, to_col = row + STEP_ROW[side], col + STEP_COL[side]
            if not (0 <= to_row < rows and 0 <= to_col < cols):
                continue
            target = to_row * cols + to_col
            if best_s[target] <= now or _squeezes(row, col, to_row, to_col, best_s, cols):
                continue
            best, via = best_s[target], sources[target]
            length = max(abs(to_row - from_row), abs(to_col - from_col))
            if source != cell and source != via and length <= max(alike, LONGEST_LINE_CELLS):
                limit_s = best - from_s
                way_s, _ = travel(
                    from_row, from_col, float(to_row), float(to_col), limit_s, ground, entry
                )
                if way_s < limit_s:
                    best, via = max(from_s + way_s, now), source
            if source == cell or length > alike:
                north, east = -STEP_ROW[side] * ground.cell_m, STEP_COL[side] * ground.cell_m
                length2 = north * north + east * east
                half_s = 0.5 * crossing_s(cell, north, east, length2, ground, entry)
                if half_s > 0.0 and now + half_s < best:
                    rest_s = 0.5 * crossing_s(target, north, east, length2, ground, entry)
                    if rest_s > 0.0 and now + half_s + rest_s < best * (1.0 - ROUNDING):
                        best, via = now + half_s + rest_s, cell
            if best < best_s[target] or via < 0:
                best_s[target] = best
                sources[target] = via if via >= 0 else cell
                size = push(times, cells, size, best, target)
    return size


@kernel
def _under_way(at_s, since_s, heap, ways, points, labels, ground, entry, found):  # type: ignore[no-untyped-def]
    """Put into found every line on which fire is under way at a time; returns their number.

    These are the ways of the last time that have not come to their end, and those that cells
    burned since then offer to their neighbours.
    """
    arrival_s, best_s, sources = labels
    cols = ground.cols
    rows = arrival_s.size // cols
    count = 0
    for k in range(ways.target.size):
        target = ways.target[k]
        if arrival_s[target] == np.inf:
            row, col = ways.at[k, 0], ways.at[k, 1]
            to_row, to_col = float(target // cols), float(target % cols)
            _, part = travel(row, col, to_row, to_col, at_s - since_s, ground, entry)
            found.target[count] = target
            found.at[count, 0] = row + part * (to_row - row)
            found.at[count, 1] = col + part * (to_col - col)
            count += 1
    for k in range(heap.size):
        target = np.int64(heap.cells[k])
        if arrival_s[target] < np.inf or best_s[target] != heap.times[k]:
            continue  # an entry that a better one has made void
        first = count
        to_row, to_col = target // cols, target % cols
        for side in range(8):
            row, col = to_row + STEP_ROW[side], to_col + STEP_COL[side]
            if not (0 <= row < rows and 0 <= col < cols):
                continue
            cell = row * cols + col
            if not since_s <= arrival_s[cell] < np.inf:
                continue
            if _squeezes(row, col, to_row, to_col, best_s, cols):
                continue
            for own in range(2):
                source = np.int64(sources[cell]) if own == 0 else cell
                from_row, from_col, from_s = _place_of(source, points, labels, cols)
                if from_s < since_s or (own == 1 and source == sources[cell]):
                    continue
                _, part = travel(
                    from_row, from_col, float(to_row), float(to_col), at_s - from_s, ground, entry
                )
                at_row = from_row + part * (to_row - from_row)
                at_col = from_col + part * (to_col - from_col)
                known = False  # the same source by way of another neighbour
                for other in range(first, count):
                    known |= found.at[other, 0] == at_row and found.at[other, 1] == at_col
                if not known:
                    found.target[count] = target
                    found.at[count, 0], found.at[count, 1] = at_row, at_col
                    count += 1
    return count


@kernel
def _set_out(at_s, ways, best, heap, points, used, labels, ground, entry):  # type: ignore[no-untyped-def]
    """Start on ways: labels and a heap anew, the points that became sources; (points, size).

    best (k) is room to work in, filled with -1.
    """
    _, best_s, sources = labels
    cols, n = ground.cols, labels.source.size
    for k in range(ways.target.size):
        best_s[ways.target[k]] = np.inf
        sources[ways.target[k]] = -1
    # First the place of the best way to each cell, then the points of these alone.
    for k in range(ways.target.size):
        target = ways.target[k]
        limit_s = best_s[target] - at_s
        to_row, to_col = float(target // cols), float(target % cols)
        way_s, _ = travel(ways.at[k, 0], ways.at[k, 1], to_row, to_col, limit_s, ground, entry)
        if way_s < limit_s or sources[target] < 0:
            best_s[target] = at_s + way_s
            sources[target] = k
    for k in range(ways.target.size):
        best[k] = sources[ways.target[k]]
    size = 0
    for k in range(ways.target.size):
        if best[k] == k:
            target = ways.target[k]
            points[used, 0], points[used, 1], points[used, 2] = ways.at[k, 0], ways.at[k, 1], at_s
            sources[target] = n + used
            used += 1
            size = push(heap.times, heap.cells, size, best_s[target], target)
    return used, size
