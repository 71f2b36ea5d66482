"""Arrival times at any angle: fire comes to a cell in a straight line from a source.

A source is the centre of a burned cell, or a point where the front stood when the weather changed.
A cell that burns offers its neighbours two ways: straight from its own source, or from itself. The
time along a line is added up over the cells it crosses (``lines``). Cells are taken in order of
time (Dijkstra 1959; the parents as in Nash et al. 2007, "Theta*"). Where conditions are the same
all around, lines may be of any length, and arrival times are those of the exact ellipse.

When the weather changes, each line under way is cut where the fire is on it, and that point becomes
the source of the rest: what has not burned is rated anew, and no way already covered is lost.
"""

import bisect
import copy
import math
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread.fire import Burning, Fire, Ignition, StartArea, check_burning, check_ignitions
from firemodel.spread.heap import drop_first, push
from firemodel.spread.labels import Heap, Labels, Ways, empty_ways, place_of, squeezes
from firemodel.spread.lines import (
    STEP_COL,
    STEP_ROW,
    cell_at,
    crossing_s,
    forget,
    from_piece,
    ground_of,
    travel,
)
from firemodel.spread.local_spread import perturbed
from firemodel.spread.rerate import set_out, under_way, ways_from

LONGEST_LINE_CELLS = 32  # over changing ground
KNIGHT_ROW = np.array([-2, -1, 1, 2, 2, 1, -1, -2])
KNIGHT_COL = np.array([1, 2, 2, 1, -1, -2, -2, -1])
ROUNDING = 1e-12  # a way must be better by more than this part of the time
WORTH_A_POINT = 0.002  # part of the time by which a new source must be better

Floats = NDArray[np.float64]


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
        self.start_area = None
        if burning and burning.area is not None:
            self.start_area = StartArea(burning.area, burning.at_s)
        if burning:
            check_burning(burning, landscape)
        check_ignitions(landscape, ignitions, self.time_s)
        n, cols = landscape.fuel_model.size, landscape.shape[1]
        changes = weather.changes()
        self._ground = ground_of(landscape, changes, wind_limit)
        self._labels = Labels(
            np.full(n, np.inf),
            np.where(self._ground.terrain.fuel < 0, -np.inf, np.inf),
            np.full(n, -1, dtype=np.int32),
        )
        self.arrival_time_s = self._labels.arrival_s.reshape(landscape.shape)
        self._heap = _empty_heap(1024)
        self._points, self._used = np.empty((64, 3)), 0  # sources: row, column, time
        self._ways = empty_ways(0)
        self._changes_s = [*(entry.at_s for entry in changes[1:]), math.inf]
        self._entry = bisect.bisect_right(self._changes_s, self.time_s)
        self._since_s = self.time_s  # when the ways set out
        # The next one last.
        self._ignitions = sorted(((t, row * cols + col) for row, col, t in ignitions), reverse=True)
        if burning:
            burned = np.isfinite(burning.arrival_s.ravel())
            self._labels.arrival_s[burned] = burning.arrival_s.ravel()[burned]
            self._labels.best_s[burned] = burning.arrival_s.ravel()[burned]
            self._labels.source[burned] = burned.nonzero()[0]
            ways = ways_from(burning.front, self._labels.best_s, landscape.shape)
            targets = np.unique(ways.target)
            self._set_out(ways, Ways(targets, np.full((targets.size, 2), np.nan)))
        self.advance(self.time_s)

    def _light(self, ignition: Ignition) -> None:
        row, col, at_s = ignition
        self._ignitions.append((at_s, row * self.landscape.shape[1] + col))
        self._ignitions.sort(reverse=True)

    def copy(self) -> Self:
        found = copy.copy(self)
        arrival_s, best_s, source = self._labels
        found._labels = Labels(arrival_s.copy(), best_s.copy(), source.copy())
        found.arrival_time_s = found._labels.arrival_s.reshape(self.landscape.shape)
        slowness = self._ground.slowness.copy()
        found._ground = self._ground._replace(
            slowness=slowness,
            rise=slowness.view(np.float32),
            learned=self._ground.learned.copy(),
        )
        found._heap = Heap(self._heap.times.copy(), self._heap.cells.copy(), self._heap.size)
        found._points = self._points.copy()
        found._changes_s, found._ignitions = self._changes_s.copy(), self._ignitions.copy()
        return found

    def perturb(self, wind_factor: float, turn_deg: float, spread_factor: float) -> None:
        tables = perturbed(self._ground.tables, self._entry, wind_factor, turn_deg, spread_factor)
        self._ground = self._ground._replace(tables=tables)
        self._changes_s.insert(self._entry, self.time_s)
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
            size, self._used = _burn(
                to_time_s,
                *self._heap,
                self._points,
                self._used,
                self._labels,
                self._ground,
                self._entry,
            )
            times, cells = self._heap.times, self._heap.cells
            self._heap = Heap(times, cells, size)
            if size == 0 or times[0] > to_time_s:
                return
            if size + 16 > times.size:
                self._heap = Heap(np.resize(times, 2 * size), np.resize(cells, 2 * size), size)
            else:
                self._points = np.resize(self._points, (2 * self._used, 3))

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
        ways, tips = empty_ways(room), empty_ways(self._heap.size)
        counts = under_way(
            at_s,
            self._since_s,
            self._heap,
            self._ways,
            self._points,
            self._labels,
            self._ground,
            self._entry,
            ways,
            tips,
        )
        forget(self._ground)
        self._entry += 1
        self._since_s = at_s
        self._set_out(ways.first(counts[0]), tips.first(counts[1]))

    def _set_out(self, ways: Ways, tips: Ways) -> None:
        """On these ways, all others being given up, at the time since_s."""
        self._ways = ways
        count = tips.target.size
        while self._points.shape[0] < self._used + count:
            self._points = np.resize(self._points, (2 * (self._used + count), 3))
        heap = _empty_heap(count + 1024)
        self._used, size = set_out(
            self._since_s,
            ways,
            tips,
            np.empty((count, 3)),
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


@kernel
def _burn(to_time_s, times, cells, size, points, used, labels, ground, entry):  # type: ignore[no-untyped-def]
    """Take cells off the heap until a time, or until it has no room; returns its new size."""
    arrival_s, best_s, sources = labels
    cols = ground.cols
    n = arrival_s.size
    rows = n // cols
    while size > 0 and times[0] <= to_time_s:
        if size + 16 > times.size or used + 8 > points.shape[0]:
            break
        now, cell = times[0], np.int64(cells[0])
        size = drop_first(times, cells, size)
        if arrival_s[cell] < np.inf:
            continue
        arrival_s[cell] = now
        row, col = cell // cols, cell % cols
        source = sources[cell]
        from_row, from_col, from_s = place_of(source, points, labels, cols)
        alike = ground.reach[cell_at(from_row, from_col, cols)] - 0.5
        reachable = max(alike, LONGEST_LINE_CELLS)
        for side in range(8):
            to_row, to_col = row + STEP_ROW[side], col + STEP_COL[side]
            if not (0 <= to_row < rows and 0 <= to_col < cols):
                continue
            target = to_row * cols + to_col
            if best_s[target] <= now or squeezes(row, col, to_row, to_col, best_s, cols):
                continue
            best, via = best_s[target], sources[target]
            length = max(abs(to_row - from_row), abs(to_col - from_col))
            if source != cell and source != via and length <= reachable:
                limit_s = best - from_s
                way_s, _ = travel(
                    from_row, from_col, float(to_row), float(to_col), limit_s, ground, entry
                )
                other = via
                if way_s < limit_s:
                    best, via = max(from_s + way_s, now), source
                if other >= n and source >= n and points[other - n, 2] == from_s:
                    # Both set out from one front: perhaps better from between them.
                    time, at_row, at_col = from_piece(
                        from_row,
                        from_col,
                        points[other - n, 0],
                        points[other - n, 1],
                        target,
                        ground,
                        entry,
                    )
                    limit_s = best - from_s
                    way_s, _ = travel(
                        at_row, at_col, float(to_row), float(to_col), limit_s, ground, entry
                    )
                    if time < np.inf and way_s < limit_s - WORTH_A_POINT * (best - from_s):
                        best, via = max(from_s + way_s, now), n + used
                        points[used, 0], points[used, 1], points[used, 2] = at_row, at_col, from_s
                        used += 1
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
        # Where a cell becomes the source of most of what is ahead, also the knight's moves: with
        # eight directions alone a thin ellipse would be late between two of them.
        if source != cell and max(abs(row - from_row), abs(col - from_col)) + 1.0 <= reachable:
            continue
        for side in range(8):
            to_row, to_col = row + KNIGHT_ROW[side], col + KNIGHT_COL[side]
            if not (0 <= to_row < rows and 0 <= to_col < cols):
                continue
            target = to_row * cols + to_col
            if best_s[target] > now:
                limit_s = best_s[target] * (1.0 - ROUNDING) - now
                way_s, _ = travel(
                    float(row), float(col), float(to_row), float(to_col), limit_s, ground, entry
                )
                if way_s < limit_s:
                    best_s[target], sources[target] = now + way_s, cell
                    size = push(times, cells, size, now + way_s, target)
    return size, used
