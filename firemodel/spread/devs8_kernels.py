"""Process the events of ``devs8``, which are kept in a heap."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.compiled import kernel
from firemodel.spread.heap import drop_first, push
from firemodel.spread.local_spread import Tables, Terrain, head_of

# An event's key is 9 * cell + side: fire reaches the cell's neighbour on that side (north,
# north-east, east, ...), or, with the side LIT, the cell itself is lit.
SIDES, LIT = 9, 8
STEP_ROW = np.array([-1, -1, 0, 1, 1, 1, 0, -1, 0])
STEP_COL = np.array([0, 1, 1, 1, 0, -1, -1, -1, 0])
STEP_CELLS = np.array([1.0, math.sqrt(2.0)] * 4)


class Ground(NamedTuple):
    """The inputs for the spread rates; cells are flattened (n)."""

    cols: int
    cell_m: float
    terrain: Terrain
    tables: Tables
    slowest_m_s: Floats  # (entries, fuels) above this rate a cell ignites, and fire spreads from it


class EventHeap(NamedTuple):
    """The future events, ordered by time (see ``heap``)."""

    times: Floats
    keys: NDArray[np.int64]
    size: int


class Halted(NamedTuple):
    """The paths on which fire does not spread in the current weather, with remaining distances."""

    keys: NDArray[np.int64]
    left_m: Floats
    size: int


@kernel
def _passes(cell, rate, ground, entry):  # type: ignore[no-untyped-def]
    return rate > ground.slowest_m_s[entry, ground.terrain.fuel[cell]]


@kernel
def _rate_towards(cell, side, head, terrain):  # type: ignore[no-untyped-def]
    """Return the spread rate in m/s towards a neighbour along the slope, projected onto the map."""
    rate, head_north, head_east, e = head
    north, east = -STEP_ROW[side] / STEP_CELLS[side], STEP_COL[side] / STEP_CELLS[side]
    along = rate * (1.0 - e) / (1.0 - e * (head_north * north + head_east * east))
    rise = terrain.gradient[0, cell] * north + terrain.gradient[1, cell] * east
    return along / math.sqrt(1.0 + rise * rise)


@kernel
def _queue_path(key, left_m, now, head, heap, halted, heap_size, halted_size, ground, entry):  # type: ignore[no-untyped-def]
    """Put a path into ``heap`` or ``halted``, and return the new sizes of both."""
    cell, side = key // SIDES, key % SIDES
    if not _passes(cell, head[0], ground, entry):
        halted.keys[halted_size], halted.left_m[halted_size] = key, left_m
        return heap_size, halted_size + 1
    arrives_s = now + left_m / _rate_towards(cell, side, head, ground.terrain)
    return push(heap.times, heap.keys, heap_size, arrives_s, key), halted_size


@kernel
def _spread(cell, head, now, arrival_s, heap, halted, heap_size, halted_size, ground, entry):  # type: ignore[no-untyped-def]
    """Start paths from a cell to all neighbours that can still burn.

    Returns the new sizes of the heap and of the halted paths.
    """
    cols, fuel = ground.cols, ground.terrain.fuel
    row, col = cell // cols, cell % cols
    for side in range(8):
        to_row, to_col = row + STEP_ROW[side], col + STEP_COL[side]
        if not (0 <= to_row < arrival_s.size // cols and 0 <= to_col < cols):
            continue
        target = to_row * cols + to_col
        if fuel[target] >= 0 and arrival_s[target] == np.inf:
            key, left_m = cell * SIDES + side, ground.cell_m * STEP_CELLS[side]
            heap_size, halted_size = _queue_path(
                key, left_m, now, head, heap, halted, heap_size, halted_size, ground, entry
            )
    return heap_size, halted_size


@kernel
def start_paths(cells, now, arrival_s, heap, halted, ground, entry):  # type: ignore[no-untyped-def]
    """Start paths from several cells.

    Returns the new sizes of the heap and of the halted paths.
    """
    heap_size, halted_size = heap.size, halted.size
    for cell in cells:
        head = head_of(cell, entry, ground.terrain, ground.tables)
        heap_size, halted_size = _spread(
            cell, head, now, arrival_s, heap, halted, heap_size, halted_size, ground, entry
        )
    return heap_size, halted_size


@kernel
def burn_until(to_time_s, arrival_s, heap, halted, ground, entry):  # type: ignore[no-untyped-def]
    """Process events from the heap until the given time, but stop when an array is full.

    Returns the new sizes of the heap and of the halted paths.
    """
    times, keys, heap_size = heap
    halted_size = halted.size
    while heap_size > 0 and times[0] <= to_time_s:
        if heap_size + 8 > times.size or halted_size + 8 > halted.keys.size:
            break
        now, key = times[0], keys[0]
        heap_size = drop_first(times, keys, heap_size)
        cell, side = key // SIDES, key % SIDES
        target = cell + STEP_ROW[side] * ground.cols + STEP_COL[side]
        if arrival_s[target] < np.inf or ground.terrain.fuel[target] < 0:
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
def change_rates(now, before, halted_before, arrival_s, heap, halted, ground, entry):  # type: ignore[no-untyped-def]
    """Queue all moving and halted paths again, with the rates of the next weather entry.

    The distance already covered is kept. Returns the new sizes of the heap and of the halted paths.
    """
    terrain, tables = ground.terrain, ground.tables
    heap_size, halted_size = 0, 0
    for place in range(before.size + halted_before.size):
        moving = place < before.size
        key = before.keys[place] if moving else halted_before.keys[place - before.size]
        cell, side = key // SIDES, key % SIDES
        target = cell + STEP_ROW[side] * ground.cols + STEP_COL[side]
        if arrival_s[target] < np.inf or terrain.fuel[target] < 0:
            continue
        if side == LIT:
            heap_size = push(heap.times, heap.keys, heap_size, before.times[place], key)
            continue
        if moving:
            head = head_of(cell, entry, terrain, tables)
            left_m = (before.times[place] - now) * _rate_towards(cell, side, head, terrain)
        else:
            left_m = halted_before.left_m[place - before.size]
        head = head_of(cell, entry + 1, terrain, tables)
        heap_size, halted_size = _queue_path(
            key, left_m, now, head, heap, halted, heap_size, halted_size, ground, entry + 1
        )
    return heap_size, halted_size
