"""Compute arrival times along straight lines, at any angle, from sources to cell corners.

Within a cell the slowness of fire (time per distance, for each direction) is constant, so the
fastest path is a chain of straight lines that bends at cell edges. In this scheme paths bend at
cell corners and, with ``precise``, also at edge midpoints. These positions and the cell centres are
the nodes (``labels``). A source is the start of a straight line: a node that fire has reached, or a
point that is not a node (a lit point, a bend, or a point on the front when the weather changes).
When fire reaches a node, two paths to every other node of the same cells are tried: a straight line
from the node's source, and a straight line from the node itself. The time along a line is the sum
of the times in the cells that it crosses; along an edge, the time is that of the faster of the two
cells (``travel_time``). Nodes are processed in order of arrival time (Dijkstra 1959). A node's
source is chosen like a parent in "Theta*" (Nash et al. 2007); before fire spreads from the node,
the nodes beside that source are also tried as sources. Where conditions are uniform, lines may have
any length, and arrival times are those of the exact ellipse. Every arrival time is the time along a
possible path and therefore never too early.

A path from a nearby source may also bend once on an edge between the source and the node
(``bend``): on the edge at which the slowness of the two cells differs most. The bend is stored as a
point. Since its position is the best one for a single node, each other node that has the bend as
its source tries other positions on the same edge (``move_bend``).

When the weather changes, each line along which fire is moving is cut at the fire's position, and
that point becomes the source of the remaining line. The new spread rate applies only to the
remaining line, so the fire's progress is kept. The cuts on the fastest line to each node are the
tips of the front. The front between two neighbouring tips is stored as points (``front_of``), and
the source of a node may be moved along this part of the front (``slide_on_front``). Fire thus
spreads from the whole front.
"""

import bisect
import copy
import dataclasses
import math
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import WHOLE, Floats, Mask, Place, enlarged
from firemodel.landscape.landscape import Landscape
from firemodel.physics import CrownMethod
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle_kernels import (
    IGNITION_ROOM,
    ROOM,
    arrive,
    burn_until,
    expect_neighbours,
    ignite,
)
from firemodel.spread.burned_parts import burned_cells
from firemodel.spread.burning import burning_from_arrival
from firemodel.spread.fire_scheme import Burning, Fire, Ignition, StartArea, check_burning
from firemodel.spread.firebrands import STEP_S
from firemodel.spread.front import neighbours_of
from firemodel.spread.labels import (
    ActivePaths,
    Labels,
    Lattice,
    Points,
    Queue,
    Tips,
    at_centres,
    by_cells,
    empty_labels,
    empty_paths,
    empty_points,
    empty_tips,
    lattice_of,
    nodes_beside,
    paths_to_centres,
    replace_labels,
    rewind,
    settle,
    tips_with,
    without_unused,
)
from firemodel.spread.local_spread import perturbed
from firemodel.spread.rate_options import RateOptions
from firemodel.spread.rerate_kernels import (
    POINTS_PER_TIP,
    active_paths,
    front_of,
    paths_from,
    start_paths,
)
from firemodel.spread.travel_time import (
    Ground,
    clear_slowness,
    ground_of,
    restore_slowness,
    with_closed,
    with_rate_factor,
    with_slowness,
    with_tables,
    with_weather_of,
)

SOME_POINTS = 10_000


class AnyAngleFire(Fire):
    """The default spread scheme, described in the module docstring.

    With ``firebrands``, burning crowns light spot fires.
    """

    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        ignitions: Sequence[Ignition],
        burning: Burning | None = None,
        *,
        wind_limit: bool = False,
        crown: CrownMethod = "none",
        foliar_moisture_pct: float = 100.0,
        precise: bool = False,
    ) -> None:
        """Raise FireModelError for an ignition on ground that cannot burn."""
        options = RateOptions(wind_limit, crown, foliar_moisture_pct)
        super().__init__(landscape, weather, ignitions, burning, options)
        if burning and burning.area is not None:
            self.start_area = StartArea(burning.area, burning.at_s)
        changes = weather.changes()
        self._ground = ground_of(landscape, changes, options)
        self._lattice = lattice_of(landscape.shape, precise)
        self._new_rate_factor: NDArray[np.float32] | None = None  # used from the next change on
        self._changes_s = [*(entry.at_s for entry in changes[1:]), math.inf]
        self._start(burning, ignitions)

    def _start(self, burning: Burning | None, ignitions: Sequence[Ignition]) -> None:
        """Set the state at ``time_s``, and light the cells that ignite at that time."""
        shape = self.landscape.shape
        burnable = self._ground.terrain.fuel.reshape(shape) >= 0
        self._labels = empty_labels(burnable, self._lattice)
        self.arrival_time_s = np.full(shape, np.inf)
        self._queue, self._size, self._waits = _empty_queue(1024), 0, 0
        self._points, self._used = empty_points(64), 0
        self._used_before = 0  # number of points after unused points were last dropped
        self._paths = empty_paths(0)
        self._entry = bisect.bisect_right(self._changes_s, self.time_s)
        self._since_s = self.time_s  # time of the last weather change
        self._clock_s = self.time_s  # latest time at which a node was reached
        # The order is reversed, so that the next ignition is the last element.
        self._ignitions = sorted(((t, row, col) for row, col, t in ignitions), reverse=True)
        if burning:
            self.arrival_time_s[:] = burning.arrival_s
            settle(self._labels, burning.arrival_s, burnable, self._lattice)
            paths = paths_from(burning.front + 0.5, self.time_s, self._labels.best_s, self._lattice)
            targets = np.unique(paths.target)
            tips = empty_tips(targets.size)._replace(target=targets)
            self._start_paths(paths, tips, self._add_front(self.time_s, paths, tips))
        self.advance(self.time_s)

    def restarted(
        self,
        burning: Burning,
        wind_factor: float | Floats = 1.0,
        turn_deg: float | Floats = 0.0,
        spread_factor: float | Floats = 1.0,
    ) -> Self:
        """Return a fire that starts from another state, with the same landscape and weather.

        The other arguments are those of ``perturb`` and apply from the start. Data that depend only
        on landscape and weather are shared with this fire, which saves time and memory.
        """
        check_burning(burning, self.landscape)
        found = copy.copy(self)
        found.time_s = burning.at_s
        found.start_area = None
        if burning.area is not None:
            found.start_area = StartArea(burning.area, burning.at_s)
        entry = bisect.bisect_right(self._changes_s, burning.at_s)
        tables = perturbed(self._ground.tables, entry, wind_factor, turn_deg, spread_factor)
        found._ground = with_tables(self._ground, tables)
        found._changes_s = self._changes_s.copy()
        found._changes_s.insert(entry, burning.at_s)
        found._start(burning, [])
        return found

    def continued(
        self,
        model: "AnyAngleFire",
        wind_factor: float | Floats = 1.0,
        turn_deg: float | Floats = 0.0,
        spread_factor: float | Floats = 1.0,
    ) -> Self:
        """Return a copy that continues in the weather of another fire on the same landscape.

        The other arguments are those of ``perturb`` and override those of earlier calls.
        """
        found, entry = self.copy(), bisect.bisect_right(model._changes_s, self.time_s)
        tables = perturbed(model._ground.tables, entry, wind_factor, turn_deg, spread_factor)
        found.weather, found._entry = model.weather, entry
        found._ground = with_weather_of(found._ground, model._ground, tables)
        found._changes_s = model._changes_s.copy()
        found._changes_s.insert(entry, self.time_s)
        found.advance(self.time_s)
        return found

    def rewritten(self, arrival_s: Floats, changed: Mask) -> Self:
        """Return a fire in which some cells have new arrival times or are unburned.

        In all other cells the fire keeps its progress. A new fire started from arrival times would
        lose the progress within the cells next to the front.

        Args:
            arrival_s: (y, x) ``expected_s()`` with the new times; infinity in unburned cells. Times
                after ``time_s`` locate the new front between cells.
            changed: (y, x) the cells with new times.

        Raises:
            FireModelError: No cell or every cell has burned.
        """
        front_yx = burning_from_arrival(arrival_s, self.landscape, self.time_s).front + 0.5
        found, at_s, lattice = self.copy(), self.time_s, self._lattice
        paths, tips = found._active_paths(at_s)
        found.arrival_time_s[changed] = np.where(arrival_s <= at_s, arrival_s, np.inf)[changed]
        burnable = self._ground.terrain.fuel.reshape(changed.shape) >= 0
        nodes = nodes_beside(changed, lattice)
        replace_labels(found._labels, nodes, found.arrival_time_s, burnable, lattice)
        near = _widened(changed)
        kept = ~(nodes[tips.target] | _within(near, tips.at))
        dropped = tips.target[~kept & ~nodes[tips.target]]
        found._labels.best_s[dropped], found._labels.source[dropped] = np.inf, -1
        outside = ~_within(near, paths.at)
        unreached_s = np.where(found._labels.best_s > at_s, np.inf, found._labels.best_s)
        new = paths_from(front_yx[_within(_widened(near), front_yx)], at_s, unreached_s, lattice)
        outside &= unreached_s[paths.target] == np.inf
        paths = ActivePaths(
            np.concatenate([paths.target[outside], new.target]),
            np.concatenate([paths.at[outside], new.at]),
        )
        tips = tips_with(tips, kept, paths, found._labels)
        first = found._add_front(at_s, paths, tips)
        found._since_s = at_s
        found._start_paths(paths, tips, first)
        found._drop_unused_points()
        found.advance(at_s)
        return found

    def _drop_unused_points(self) -> None:
        """Drop unused points if there may be many; each weather change adds points."""
        if self._used <= 2 * self._used_before + SOME_POINTS:
            return
        points = self._points.first(self._used)
        self._points, self._labels = without_unused(points, self._labels, self._since_s)
        self._used = self._used_before = len(self._points.at)

    @property
    def _state(self) -> tuple[Points, int, Labels, Ground, Lattice, int]:
        """Return the arguments common to all kernels, in the order of the kernels' parameters."""
        return self._points, self._used, self._labels, self._ground, self._lattice, self._entry

    def _light(self, ignition: Ignition) -> None:
        row, col, at_s = ignition
        self._ignitions.append((at_s, row, col))
        self._ignitions.sort(reverse=True)

    def copy(self) -> Self:
        best_s, source, active_row = self._labels
        return self._copy_with(
            Labels(best_s.copy(), source.copy(), np.zeros_like(active_row)),
            self.arrival_time_s.copy(),
            with_slowness(self._ground, self._ground.slowness.copy(), self._ground.computed.copy()),
        )

    def copy_over(self, used: Self) -> Self:
        rewind(used._labels, used.arrival_time_s, self._labels, self.arrival_time_s, self._lattice)
        restore_slowness(used._ground, self._ground)
        ground = with_slowness(self._ground, used._ground.slowness, used._ground.computed)
        return self._copy_with(used._labels, used.arrival_time_s, ground)

    def _copy_with(self, labels: Labels, arrival_time_s: Floats, ground: Ground) -> Self:
        """Return a copy of this fire with the given arrays, which are already copies."""
        found = copy.copy(self)
        found._labels, found.arrival_time_s, found._ground = labels, arrival_time_s, ground
        times, keys, waiting = self._queue
        found._queue = Queue(times.copy(), keys.copy(), waiting.copy())
        at, beside, bend_source = self._points.first(self._used)
        found._points = Points(at.copy(), beside.copy(), bend_source.copy())
        found._changes_s, found._ignitions = self._changes_s.copy(), self._ignitions.copy()
        return found

    def perturb(
        self,
        wind_factor: float | Floats,
        turn_deg: float | Floats,
        spread_factor: float | Floats,
        rate_factor: Floats | None = None,
    ) -> None:
        """Change wind and spread rates from now on, as in ``Fire.perturb``.

        ``rate_factor`` (y, x) multiplies the spread rates of cells, and replaces the
        ``rate_factor`` of an earlier call; None changes nothing.
        """
        if rate_factor is not None:
            self._new_rate_factor = rate_factor.astype(np.float32).ravel()
        tables = perturbed(self._ground.tables, self._entry, wind_factor, turn_deg, spread_factor)
        self._ground = self._ground._replace(tables=tables)
        self._changes_s.insert(self._entry, self.time_s)
        self.advance(self.time_s)

    def draw_from(self, rng: np.random.Generator) -> None:
        if self.firebrands is not None:
            seed = int(rng.integers(2**63))
            self.firebrands = dataclasses.replace(self.firebrands, seed=seed)

    def _burn_until(self, to_time_s: float) -> None:
        if self.firebrands is not None:
            for step in range(math.floor(self.time_s / STEP_S), math.floor(to_time_s / STEP_S)):
                self._spread_until((step + 1) * STEP_S)
                self._light_spot_fires(step * STEP_S, (step + 1) * STEP_S)
        self._spread_until(to_time_s)

    def _light_spot_fires(self, begin_s: float, end_s: float) -> None:
        """Light the spot fires of the cells that burned in a step."""
        assert self.firebrands is not None
        weather, ground = self.weather.weather_at(end_s), self._ground
        spread = ground.terrain, ground.tables, self._entry
        for ignition in self.firebrands.spot_fires(
            self.landscape, weather, self.arrival_time_s, (begin_s, end_s), spread
        ):
            self._light(ignition)

    def _spread_until(self, to_time_s: float) -> None:
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
        """Burn until the given time under the current weather entry."""
        while self._is_due(to_time_s):
            self._size, self._waits, self._used, self._clock_s = burn_until(
                to_time_s,
                self._clock_s,
                self._since_s,
                self._queue,
                self._size,
                self._waits,
                *self._state,
            )
            if self._is_due(to_time_s):
                self._arrive(self._clock_s)  # keeps the number of waiting centres low
                self._make_room(ROOM)
        self._arrive(to_time_s)

    def _is_due(self, to_time_s: float) -> bool:
        """Return whether a node in the queue must be processed by the given time."""
        return bool(self._size > 0 and self._queue.times[0] <= to_time_s)

    def _arrive(self, to_time_s: float) -> None:
        """Set the arrival times of the centres that fire reached by the given time."""
        if self._waits == 0:
            return
        self._waits = arrive(
            to_time_s,
            self._queue.waiting,
            self._waits,
            self.arrival_time_s,
            self._labels,
            self._lattice,
        )

    def _make_room(self, room: int) -> None:
        """Make room for at least ``room`` more nodes, centres and points."""
        times, keys, waiting = self._queue
        if self._size + room > times.size:
            size = 2 * (self._size + room)
            times, keys = enlarged(times, size), enlarged(keys, size)
        if 2 * (self._waits + room) > waiting.size:
            waiting = enlarged(waiting, 4 * (self._waits + room))
        self._queue = Queue(times, keys, waiting)
        if self._used + room > len(self._points.at):
            size = 2 * (self._used + room)
            at, beside, bend_source = self._points
            self._points = Points(
                enlarged(at, size), enlarged(beside, size), enlarged(bend_source, size)
            )

    def _ignite(self, at_s: float, row: int, col: int) -> None:
        cell = row * self.landscape.shape[1] + col
        if self.arrival_time_s[row, col] < np.inf or self._ground.terrain.fuel[cell] < 0:
            return
        self._make_room(IGNITION_ROOM)
        paths = empty_paths(IGNITION_ROOM)
        self._size, self._waits, count = ignite(
            at_s,
            row,
            col,
            self._queue,
            self._size,
            self._waits,
            paths,
            *self._state,
        )
        self._used += 1
        self._paths = ActivePaths(
            np.concatenate([self._paths.target, paths.target[:count]]),
            np.concatenate([self._paths.at, paths.at[:count]]),
        )

    def _active_paths(self, at_s: float) -> tuple[ActivePaths, Tips]:
        """Return the lines along which fire is moving at ``at_s``, and the tips of the front."""
        targets = self._size + self._waits
        paths, tips = empty_paths(self._paths.target.size + 48 * targets), empty_tips(targets)
        self._make_room(targets)
        count, tip, self._used = active_paths(
            at_s,
            self._since_s,
            self._queue,
            self._size,
            self._waits,
            self._paths,
            *self._state,
            paths,
            tips,
        )
        paths, tips = paths.first(count), tips.first(tip)
        return paths, tips_with(tips, np.ones(tip, dtype=bool), paths, self._labels)

    def _change_weather(self, at_s: float) -> None:
        paths, tips = self._active_paths(at_s)
        first = self._add_front(at_s, paths, tips)
        clear_slowness(self._ground)
        if self._new_rate_factor is not None:
            self._ground = with_rate_factor(self._ground, self._new_rate_factor)
            self._new_rate_factor = None
        self._entry += 1
        self._since_s = at_s
        self._start_paths(paths, tips, first)

    def _close(self, cells: Mask) -> None:
        at_s, labels, lattice = self.time_s, self._labels, self._lattice
        here, nodes, part = _around(cells, lattice)  # only nodes beside the cells are blocked
        best_s = by_cells(labels.best_s, lattice)[nodes]
        can_burn = (self._ground.terrain.fuel.reshape(cells.shape) >= 0) & ~cells
        never = empty_labels(can_burn[here], part).best_s == -np.inf
        blocked = by_cells(never & nodes_beside(cells[here], part), part) & (best_s > at_s)
        near = by_cells(nodes_beside(_widened(_widened(cells[here])), part), part)
        prepared = ~np.isnan(self._ground.slowness[::4][cells.ravel()])
        if not (prepared.any() or np.isfinite(best_s[near]).any()):  # the front is not near
            best_s[blocked] = -np.inf
            labels.active_row[nodes[0]] = True
            self._ground = with_closed(self._ground, cells.ravel())
            return
        labels.active_row[:] = True
        paths, tips = self._active_paths(at_s)
        ends = np.zeros(labels.source.size, dtype=bool)
        by_cells(ends, lattice)[nodes] = blocked
        labels.best_s[ends], labels.source[ends] = -np.inf, -1
        open_paths = ~ends[paths.target]
        paths = ActivePaths(paths.target[open_paths], paths.at[open_paths])
        tips = tips_with(tips, ~ends[tips.target], paths, labels)
        first = self._add_front(at_s, paths, tips)
        clear_slowness(self._ground)
        self._ground = with_closed(self._ground, cells.ravel())
        self._since_s = at_s
        self._start_paths(paths, tips, first)

    def _add_front(self, at_s: float, paths: ActivePaths, tips: Tips) -> int:
        """Add the front between the tips to the points. Returns the index of the first tip."""
        self._make_room(POINTS_PER_TIP * tips.target.size + paths.target.size)
        first = self._used
        self._used = front_of(
            at_s,
            paths,
            tips,
            np.empty(tips.target.size),
            *self._state,
        )
        return first

    def _start_paths(self, paths: ActivePaths, tips: Tips, first: int) -> None:
        """Start the fire on these paths at ``_since_s``, and drop all other paths."""
        self._paths = paths
        count = tips.target.size
        self._queue, self._size, self._waits = _empty_queue(count + 1024), 0, 0
        self._used, self._size, self._waits = start_paths(
            self._since_s,
            paths,
            tips,
            first,
            np.empty(count),
            np.empty((count, 4), dtype=np.int32),
            self._queue,
            *self._state,
        )

    def arrival_vectors(self, here: Place = WHOLE) -> Floats:
        """Return the vector (2, y, x) from each cell's source to the cell, in m north and east.

        The result covers the window ``here``. The vector is 0 where the fire was lit.
        """
        arrival_s, cell_m = self.arrival_time_s[here], self.landscape.cell_size_m
        found, (top, _, _), (left, _, _) = (
            np.zeros((2, *arrival_s.shape)),
            here[0].indices(self._lattice.rows),
            here[1].indices(self._lattice.cols),
        )
        paths_to_centres(
            found, arrival_s, top, left, cell_m, self._points, self._labels, self._lattice
        )
        return found

    @property
    def interpolated_ha(self) -> float:
        cells = burned_cells(self.time_s, self.arrival_time_s, self._labels, self._lattice)
        return float(cells) * self.landscape.cell_size_m**2 / 1e4

    def _expected_s(self) -> Floats:
        best_s = np.asarray(at_centres(self._labels.best_s, self._lattice))
        expected_s: Floats = np.where(best_s == -np.inf, np.inf, best_s)
        expect_neighbours(
            expected_s,
            self.arrival_time_s,
            self._points,
            self._labels,
            self._ground,
            self._lattice,
            self._entry,
        )
        return expected_s


def _widened(cells: Mask) -> Mask:
    """Return a mask (y, x) extended by the eight neighbours of each cell."""
    return cells | neighbours_of(cells)


def _around(
    cells: Mask, lattice: Lattice
) -> tuple[tuple[slice, slice], tuple[slice, slice], Lattice]:
    """Return a window around cells: the slices of its cells and nodes, and its lattice."""
    rows, cols = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
    top, left = max(int(rows[0]) - 4, 0), max(int(cols[0]) - 4, 0)
    end, right = min(int(rows[-1]) + 5, lattice.rows), min(int(cols[-1]) + 5, lattice.cols)
    part = lattice._replace(rows=end - top, cols=right - left)
    here, nodes = (
        (slice(top, end), slice(left, right)),
        (slice(top, end + 1), slice(left, right + 1)),
    )
    return here, nodes, part


def _within(cells: Mask, at: Floats) -> Mask:
    """Return True for each position (k; y, x from the grid's corner) inside a mask of cells."""
    rows, cols = cells.shape
    row = np.clip(np.nan_to_num(at[:, 0]), 0, rows - 1).astype(np.int64)
    col = np.clip(np.nan_to_num(at[:, 1]), 0, cols - 1).astype(np.int64)
    return np.asarray(cells[row, col])


def _empty_queue(room: int) -> Queue:
    return Queue(np.empty(room), np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int32))
