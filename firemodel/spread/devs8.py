"""Discrete-event spread over cells in eight directions, with the rules of DEVS-FIRE.

Hu, Sun & Ntaimo 2012 (Simulation 88, 259-279), and its authors' program, des-fire. A burning cell
spreads towards each neighbour with the rate of its own fuel, slope and wind, brought down to the
map. What is left of the way is kept for each direction, so that a change of weather changes the
rate and loses no progress. The next event is always the earliest arrival anywhere.

Fire that can only go in eight directions burns less than the ellipse it is made of: on even ground
the octagon with its corners on the ellipse, 78 % of it at a length/width of 1.43 and 60 % at 2.21
where the wind blows along one of the eight, up to 5 points less between two.
"""

import copy
import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.fuels import FUEL_MODELS
from firemodel.physics.rothermel import fireline_intensity_kw_m, fuel_bed
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.fire import Burning, Fire, Ignition, check_burning, check_ignitions
from firemodel.spread.front import neighbours_of
from firemodel.spread.heap import drop_first, push
from firemodel.spread.local_spread import (
    Tables,
    Terrain,
    burnable_codes,
    head_of,
    perturbed,
    tables_of,
    terrain_of,
)

# The papers name no value; des-fire has 0.
IGNITION_INTENSITY_KW_M = 0.0

# An event's key is 9 cell + side: fire comes from the cell to its neighbour on that side (north,
# north-east, east, ...), or is lit in the cell itself.
SIDES, LIT = 9, 8
STEP_ROW = np.array([-1, -1, 0, 1, 1, 1, 0, -1, 0])
STEP_COL = np.array([0, 1, 1, 1, 0, -1, -1, -1, 0])
WAY_CELLS = np.array([1.0, math.sqrt(2.0)] * 4)

Floats = NDArray[np.float64]


class Ground(NamedTuple):
    """What the rates are reckoned with; cells in one row (n)."""

    cols: int
    cell_m: float
    terrain: Terrain
    tables: Tables
    slowest_m_s: Floats  # (entries, fuels) the rate a cell must pass to ignite and to spread


class Heap(NamedTuple):
    """The events to come (see ``heap``)."""

    times: Floats
    keys: NDArray[np.int64]
    size: int


class Halted(NamedTuple):
    """Ways on which fire does not go on under the weather there is, and what is left of them."""

    keys: NDArray[np.int64]
    left_m: Floats
    size: int


class Devs8Fire(Fire):
    """The scheme of DEVS-FIRE; see the module."""

    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        ignitions: Sequence[Ignition],
        burning: Burning | None = None,
        *,
        wind_limit: bool = False,
        ignition_intensity_kw_m: float = IGNITION_INTENSITY_KW_M,
    ) -> None:
        """A cell ignites when fire comes to it while its own fireline intensity passes a threshold.

        That is Byram's, at its head. A cell that does not pass it waits for weather in which it
        does (in des-fire for another neighbour), and one that burns stands still (in des-fire it
        goes out); a cell of ``ignitions`` burns in any case. A fire that is already there sets out
        anew from the centres of its outermost cells. Raises FireModelError where nothing can burn.
        """
        if not 0.0 <= ignition_intensity_kw_m < math.inf:
            raise FireModelError(
                f"ignition_intensity_kw_m = {ignition_intensity_kw_m} must be 0 or more"
            )
        self.landscape = landscape
        self.weather = weather
        self.wind_limit = wind_limit
        self.time_s = burning.at_s if burning else 0.0
        self.start_area = None  # it has cells only
        if burning:
            check_burning(burning, landscape)
        check_ignitions(landscape, ignitions, self.time_s)
        self._ground = Ground(
            landscape.shape[1],
            landscape.cell_size_m,
            terrain_of(landscape),
            tables_of(landscape, weather.entries, wind_limit),
            _slowest_m_s(landscape, weather.entries, ignition_intensity_kw_m),
        )
        self._arrival_s = np.full(landscape.fuel_model.size, np.inf)
        self.arrival_time_s = self._arrival_s.reshape(landscape.shape)
        self._halted = Halted(np.empty(0, dtype=np.int64), np.empty(0), 0)
        self._entry = weather.index_at(self.time_s)
        self._changes_s = [*weather.change_times(), math.inf]
        edge = self._take_over(burning) if burning else np.empty(0, dtype=np.int64)
        self._heap = Heap(np.empty(1024), np.empty(1024, dtype=np.int64), 0)
        for ignition in ignitions:
            self._light(ignition)
        self._make_room(8 * edge.size)
        sizes = _set_out(edge, self.time_s, self._arrival_s, *self._state())
        self._keep(*sizes)
        self.advance(self.time_s)

    def _take_over(self, burning: Burning) -> NDArray[np.int64]:
        """Cells of a fire that is already there with something around them left to burn."""
        burned = np.isfinite(burning.arrival_s)
        self.arrival_time_s[burned] = burning.arrival_s[burned]
        can_burn = self._ground.terrain.fuel.reshape(burned.shape) >= 0
        return np.flatnonzero(burned & can_burn & neighbours_of(can_burn & ~burned))

    def _light(self, ignition: Ignition) -> None:
        row, col, at_s = ignition
        self._make_room(1)
        key = (row * self.landscape.shape[1] + col) * SIDES + LIT
        self._heap = self._heap._replace(size=push(*self._heap, float(at_s), key))

    def copy(self) -> Self:
        found = copy.copy(self)
        found._arrival_s = self._arrival_s.copy()
        found.arrival_time_s = found._arrival_s.reshape(self.landscape.shape)
        found._heap = Heap(self._heap.times.copy(), self._heap.keys.copy(), self._heap.size)
        halted = self._halted
        found._halted = Halted(halted.keys.copy(), halted.left_m.copy(), halted.size)
        found._changes_s = self._changes_s.copy()
        return found

    def perturb(self, wind_factor: float, turn_deg: float, spread_factor: float) -> None:
        ground, entry = self._ground, self._entry
        slowest = ground.slowest_m_s
        self._ground = ground._replace(
            tables=perturbed(ground.tables, entry, wind_factor, turn_deg, spread_factor),
            slowest_m_s=np.concatenate([slowest[: entry + 1], slowest[entry:]]),
        )
        self._changes_s.insert(entry, self.time_s)
        self.advance(self.time_s)

    def _burn_until(self, to_time_s: float) -> None:
        while True:
            change_s = self._changes_s[self._entry]
            self._burn(min(to_time_s, change_s))
            if change_s > to_time_s:
                return
            self._change_weather(change_s)

    def _burn(self, to_time_s: float) -> None:
        """With the weather as it is now."""
        while True:
            self._make_room(8)
            self._keep(*_burn(to_time_s, self._arrival_s, *self._state()))
            if self._heap.size == 0 or self._heap.times[0] > to_time_s:
                return

    def _change_weather(self, at_s: float) -> None:
        before, halted = self._heap, self._halted
        room = before.size + halted.size
        self._heap = Heap(np.empty(room), np.empty(room, dtype=np.int64), 0)
        self._halted = Halted(np.empty(room, dtype=np.int64), np.empty(room), 0)
        self._keep(*_change_rates(at_s, before, halted, self._arrival_s, *self._state()))
        self._entry += 1

    def _state(self) -> tuple[Heap, Halted, Ground, int]:
        return self._heap, self._halted, self._ground, self._entry

    def _keep(self, heap_size: int, halted_size: int) -> None:
        self._heap = self._heap._replace(size=heap_size)
        self._halted = self._halted._replace(size=halted_size)

    def _make_room(self, more: int) -> None:
        """For so many more events, and as many again so that it is not often called for."""
        times, keys, size = self._heap
        if size + more > times.size:
            self._heap = Heap(
                np.resize(times, 2 * (size + more)), np.resize(keys, 2 * (size + more)), size
            )
        keys, left_m, size = self._halted
        if size + more > keys.size:
            self._halted = Halted(
                np.resize(keys, 2 * (size + more)), np.resize(left_m, 2 * (size + more)), size
            )

    def _expected_s(self) -> Floats:
        times, keys, size = self._heap
        cells, sides = np.divmod(keys[:size], SIDES)
        coming = sides != LIT
        targets = cells + STEP_ROW[sides] * self._ground.cols + STEP_COL[sides]
        expected_s = self._arrival_s.copy()
        np.minimum.at(expected_s, targets[coming], times[:size][coming])
        return expected_s.reshape(self.landscape.shape)


def _slowest_m_s(landscape: Landscape, entries: Sequence[Weather], intensity_kw_m: float) -> Floats:
    """The rate at which each fuel has this intensity, under each entry: (entries, fuels)."""
    fuels = [FUEL_MODELS[code] for code in burnable_codes(landscape)]
    beds = [fuel_bed(fuel, entry.moisture) for entry in entries for fuel in fuels]
    per_m_s = np.array([fireline_intensity_kw_m(bed, 1.0) for bed in beds])
    found = np.full(per_m_s.shape, np.inf)
    np.divide(intensity_kw_m, per_m_s, out=found, where=per_m_s > 0.0)
    return found.reshape(len(entries), len(fuels))


@kernel
def _passes(cell, rate, ground, entry):  # type: ignore[no-untyped-def]
    return rate > ground.slowest_m_s[entry, ground.terrain.fuel[cell]]


@kernel
def _rate_towards(cell, side, head, terrain):  # type: ignore[no-untyped-def]
    """Spread rate on the map towards a neighbour (m/s): along the slope, then projected."""
    rate, head_north, head_east, e = head
    north, east = -STEP_ROW[side] / WAY_CELLS[side], STEP_COL[side] / WAY_CELLS[side]
    along = rate * (1.0 - e) / (1.0 - e * (head_north * north + head_east * east))
    rise = terrain.gradient[0, cell] * north + terrain.gradient[1, cell] * east
    return along / math.sqrt(1.0 + rise * rise)


@kernel
def _go(key, left_m, now, head, heap, halted, heap_size, halted_size, ground, entry):  # type: ignore[no-untyped-def]
    """Put a way into the heap, or among the halted; returns the new sizes of both."""
    cell, side = key // SIDES, key % SIDES
    if not _passes(cell, head[0], ground, entry):
        halted.keys[halted_size], halted.left_m[halted_size] = key, left_m
        return heap_size, halted_size + 1
    arrives_s = now + left_m / _rate_towards(cell, side, head, ground.terrain)
    return push(heap.times, heap.keys, heap_size, arrives_s, key), halted_size


@kernel
def _spread(cell, head, now, arrival_s, heap, halted, heap_size, halted_size, ground, entry):  # type: ignore[no-untyped-def]
    """Set out from a cell towards all neighbours left to burn; returns as ``_go``."""
    cols, fuel = ground.cols, ground.terrain.fuel
    row, col = cell // cols, cell % cols
    for side in range(8):
        to_row, to_col = row + STEP_ROW[side], col + STEP_COL[side]
        if not (0 <= to_row < arrival_s.size // cols and 0 <= to_col < cols):
            continue
        target = to_row * cols + to_col
        if fuel[target] >= 0 and arrival_s[target] == np.inf:
            key, left_m = cell * SIDES + side, ground.cell_m * WAY_CELLS[side]
            heap_size, halted_size = _go(
                key, left_m, now, head, heap, halted, heap_size, halted_size, ground, entry
            )
    return heap_size, halted_size


@kernel
def _set_out(cells, now, arrival_s, heap, halted, ground, entry):  # type: ignore[no-untyped-def]
    """``_spread`` from several cells."""
    heap_size, halted_size = heap.size, halted.size
    for cell in cells:
        head = head_of(cell, entry, ground.terrain, ground.tables)
        heap_size, halted_size = _spread(
            cell, head, now, arrival_s, heap, halted, heap_size, halted_size, ground, entry
        )
    return heap_size, halted_size


@kernel
def _burn(to_time_s, arrival_s, heap, halted, ground, entry):  # type: ignore[no-untyped-def]
    """Take events off the heap until a time, or until there is no room; returns as ``_go``."""
    times, keys, heap_size = heap
    halted_size = halted.size
    while heap_size > 0 and times[0] <= to_time_s:
        if heap_size + 8 > times.size or halted_size + 8 > halted.keys.size:
            break
        now, key = times[0], keys[0]
        heap_size = drop_first(times, keys, heap_size)
        cell, side = key // SIDES, key % SIDES
        target = cell + STEP_ROW[side] * ground.cols + STEP_COL[side]
        if arrival_s[target] < np.inf:
            continue
        head = head_of(target, entry, ground.terrain, ground.tables)
        if side != LIT and not _passes(target, head[0], ground, entry):
            halted.keys[halted_size], halted.left_m[halted_size] = key, 0.0
            halted_size += 1
            continue
        arrival_s[target] = now
        heap_size, halted_size = _spread(
            target, head, now, arrival_s, heap, halted, heap_size, halted_size, ground, entry
        )
    return heap_size, halted_size


@kernel
def _change_rates(now, before, stood, arrival_s, heap, halted, ground, entry):  # type: ignore[no-untyped-def]
    """All ways, from the heap and the halted before, at the rates of the next entry of the weather.

    What was covered stays covered. Returns as ``_go``.
    """
    terrain, tables = ground.terrain, ground.tables
    heap_size, halted_size = 0, 0
    for place in range(before.size + stood.size):
        under_way = place < before.size
        key = before.keys[place] if under_way else stood.keys[place - before.size]
        cell, side = key // SIDES, key % SIDES
        if arrival_s[cell + STEP_ROW[side] * ground.cols + STEP_COL[side]] < np.inf:
            continue
        if side == LIT:
            heap_size = push(heap.times, heap.keys, heap_size, before.times[place], key)
            continue
        if under_way:
            head = head_of(cell, entry, terrain, tables)
            left_m = (before.times[place] - now) * _rate_towards(cell, side, head, terrain)
        else:
            left_m = stood.left_m[place - before.size]
        head = head_of(cell, entry + 1, terrain, tables)
        heap_size, halted_size = _go(
            key, left_m, now, head, heap, halted, heap_size, halted_size, ground, entry + 1
        )
    return heap_size, halted_size
