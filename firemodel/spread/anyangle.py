"""Compute arrival times along straight lines, at any angle, from sources to cells.

A source is the centre of a burned cell, or a point on the front when the weather changes. From a
burning cell, two paths to each neighbour are tried: a straight line from the source of that cell,
and a straight line from the cell itself. The time along a line is the sum of the times in the cells
that it crosses (``travel_time``). Cells are processed in order of time (Dijkstra 1959). A cell's
source is chosen like a parent in "Theta*" (Nash et al. 2007). Where conditions are uniform, lines
may have any length and arrival times are those of the exact ellipse.

When the weather changes, each line along which fire is moving is cut at the position of the fire,
and that point becomes the source of the remaining line. Only the remaining line has the new spread
rate, so that the progress of the fire is kept.
"""

import bisect
import copy
import math
from collections.abc import Sequence
from typing import Self

import numpy as np

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle_kernels import burn_until
from firemodel.spread.fire_scheme import Burning, Fire, Ignition, StartArea
from firemodel.spread.heap import push
from firemodel.spread.labels import ActivePaths, Heap, Labels, empty_paths
from firemodel.spread.local_spread import perturbed
from firemodel.spread.rerate_kernels import active_paths, paths_from, start_paths
from firemodel.spread.travel_time import clear_slowness, ground_of


class AnyAngleFire(Fire):
    """The default spread scheme, described in the module's docstring."""

    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        ignitions: Sequence[Ignition],
        burning: Burning | None = None,
        *,
        wind_limit: bool = False,
    ) -> None:
        """Raise FireModelError for an ignition on ground that cannot burn."""
        super().__init__(landscape, weather, ignitions, burning, wind_limit)
        if burning and burning.area is not None:
            self.start_area = StartArea(burning.area, burning.at_s)
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
        self._paths = empty_paths(0)
        self._changes_s = [*(entry.at_s for entry in changes[1:]), math.inf]
        self._entry = bisect.bisect_right(self._changes_s, self.time_s)
        self._since_s = self.time_s  # time at which the paths begin
        # The order is reversed, so that the next ignition is the last element.
        self._ignitions = sorted(((t, row * cols + col) for row, col, t in ignitions), reverse=True)
        if burning:
            burned = np.isfinite(burning.arrival_s.ravel())
            self._labels.arrival_s[burned] = burning.arrival_s.ravel()[burned]
            self._labels.best_s[burned] = burning.arrival_s.ravel()[burned]
            self._labels.source[burned] = burned.nonzero()[0]
            paths = paths_from(burning.front, self._labels.best_s, landscape.shape)
            targets = np.unique(paths.target)
            self._start_paths(paths, ActivePaths(targets, np.full((targets.size, 2), np.nan)))
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
            slowness=slowness, rise=slowness.view(np.float32), computed=self._ground.computed.copy()
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
        """Burn until a time under the present weather entry."""
        while True:
            size, self._used = burn_until(
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
        room = self._paths.target.size + 16 * self._heap.size
        paths, tips = empty_paths(room), empty_paths(self._heap.size)
        counts = active_paths(
            at_s,
            self._since_s,
            self._heap,
            self._paths,
            self._points,
            self._labels,
            self._ground,
            self._entry,
            paths,
            tips,
        )
        clear_slowness(self._ground)
        self._entry += 1
        self._since_s = at_s
        self._start_paths(paths.first(counts[0]), tips.first(counts[1]))

    def _start_paths(self, paths: ActivePaths, tips: ActivePaths) -> None:
        """Start the fire on these paths at ``_since_s``, and drop all other paths."""
        self._paths = paths
        count = tips.target.size
        while self._points.shape[0] < self._used + count:
            self._points = np.resize(self._points, (2 * (self._used + count), 3))
        heap = _empty_heap(count + 1024)
        self._used, size = start_paths(
            self._since_s,
            paths,
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

    def arrival_vectors(self) -> Floats:
        """Return the vector (2, y, x) from each cell's source to the cell, in m north and east.

        It is 0 where the fire was lit.
        """
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
