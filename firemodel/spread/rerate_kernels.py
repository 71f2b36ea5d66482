"""Restart an any-angle fire when the weather changes.

Each active line is cut at the position of the fire. On the best lines to neighbouring cells, cuts
that are close together are joined. Fire then spreads from the whole front (Huygens) and not only
from single points; otherwise frequent changes of weather would distort the fire.
"""

import numpy as np

from firemodel.arrays import Floats
from firemodel.compiled import kernel
from firemodel.spread.heap import push
from firemodel.spread.labels import ActivePaths, blocked_diagonal, place_of
from firemodel.spread.travel_time import STEP_COL, STEP_ROW, from_segment, travel

NEAR_FRONT_CELLS = 2  # distance up to which an initial front has paths to cells
WINDOW_CELLS = 3  # maximum distance of a cell from the segment of the front that ignites it


def paths_from(front: Floats, best_s: Floats, shape: tuple[int, int]) -> ActivePaths:
    """Return the paths from each point (k, 2) of a front to the unburned cells around it."""
    rows, cols = shape
    around = np.arange(-NEAR_FRONT_CELLS, NEAR_FRONT_CELLS + 1)
    cell = np.floor(front + 0.5).astype(np.int64)
    row = (cell[:, 0, None, None] + around[:, None]).repeat(around.size, axis=2)
    col = (cell[:, 1, None, None] + around).repeat(around.size, axis=1)
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    target = np.where(inside, row * cols + col, 0)
    reachable = inside & (best_s[target] == np.inf)
    point = np.nonzero(reachable)[0]
    return ActivePaths(target[reachable].astype(np.int32), front[point])


@kernel
def active_paths(at_s, since_s, heap, paths, points, labels, ground, entry, found, tips):  # type: ignore[no-untyped-def]
    """Find every line along which fire is moving at a time.

    ``found`` receives the paths from the last weather change that are not completed, and the paths
    to neighbours of cells that have burned since then. ``tips`` receives, for each cell next to the
    fire, the position of the fire on the best line to this cell. Returns the number of paths in
    ``found`` and in ``tips``.
    """
    arrival_s, best_s, sources = labels
    cols = ground.cols
    rows = arrival_s.size // cols
    count = tip = 0
    for k in range(paths.target.size):
        target = paths.target[k]
        if arrival_s[target] == np.inf:
            row, col = paths.at[k, 0], paths.at[k, 1]
            to_row, to_col = float(target // cols), float(target % cols)
            _, part = travel(row, col, to_row, to_col, at_s - since_s, ground, entry)
            found.target[count] = target
            found.at[count, 0] = row + part * (to_row - row)
            found.at[count, 1] = col + part * (to_col - col)
            count += 1
    for k in range(heap.size):
        target = np.int64(heap.cells[k])
        if arrival_s[target] < np.inf or best_s[target] != heap.times[k]:
            continue  # replaced by a better entry
        to_row, to_col = target // cols, target % cols
        at_row, at_col, at_s_ = place_of(sources[target], points, labels, cols)
        if sources[target] == target:
            at_row, at_col = np.nan, np.nan
        else:
            _, part = travel(
                at_row, at_col, float(to_row), float(to_col), at_s - at_s_, ground, entry
            )
            at_row, at_col = at_row + part * (to_row - at_row), at_col + part * (to_col - at_col)
        tips.target[tip] = target
        tips.at[tip, 0], tips.at[tip, 1] = at_row, at_col
        tip += 1
        first = count
        for side in range(8):
            row, col = to_row + STEP_ROW[side], to_col + STEP_COL[side]
            if not (0 <= row < rows and 0 <= col < cols):
                continue
            cell = row * cols + col
            if not since_s <= arrival_s[cell] < np.inf:
                continue
            if blocked_diagonal(row, col, to_row, to_col, best_s, cols):
                continue
            for own in range(2):
                source = np.int64(sources[cell]) if own == 0 else cell
                from_row, from_col, from_s = place_of(source, points, labels, cols)
                if from_s < since_s or (own == 1 and source == sources[cell]):
                    continue
                _, part = travel(
                    from_row, from_col, float(to_row), float(to_col), at_s - from_s, ground, entry
                )
                at_row = from_row + part * (to_row - from_row)
                at_col = from_col + part * (to_col - from_col)
                duplicate = False  # True if another neighbour gave the same source
                for other in range(first, count):
                    duplicate |= found.at[other, 0] == at_row and found.at[other, 1] == at_col
                if not duplicate:
                    found.target[count] = target
                    found.at[count, 0], found.at[count, 1] = at_row, at_col
                    count += 1
    return count, tip


@kernel
def _along_front(target, tips, sources, ground, entry):  # type: ignore[no-untyped-def]
    """Return the place on the joined front from which fire is estimated to reach a cell first.

    The result is NaN if no piece of the front is near. Tip k is marked in ``sources`` as -2 - k.
    """
    cols = ground.cols
    rows = sources.size // cols
    row, col = target // cols, target % cols
    best, best_row, best_col = np.inf, np.nan, np.nan
    for near_row in range(max(row - WINDOW_CELLS, 0), min(row + WINDOW_CELLS + 1, rows)):
        for near_col in range(max(col - WINDOW_CELLS, 0), min(col + WINDOW_CELLS + 1, cols)):
            tip = -2 - sources[near_row * cols + near_col]
            if tip < 0:
                continue
            for side in range(4):  # each pair of neighbours once
                other_row, other_col = near_row + STEP_ROW[side], near_col + STEP_COL[side]
                if not (0 <= other_row < rows and 0 <= other_col < cols):
                    continue
                other = -2 - sources[other_row * cols + other_col]
                if other < 0:
                    continue
                time, at_row, at_col = from_segment(
                    tips.at[tip, 0],
                    tips.at[tip, 1],
                    tips.at[other, 0],
                    tips.at[other, 1],
                    target,
                    ground,
                    entry,
                )
                if time < best:
                    best, best_row, best_col = time, at_row, at_col
    return best_row, best_col


@kernel
def _try_path(k, row, col, at_s, tips, best, ground, entry):  # type: ignore[no-untyped-def]
    """Store a path in row k of ``best`` (time, row, column) if tip k has no faster path yet."""
    target, cols = tips.target[k], ground.cols
    limit_s = best[k, 0] - at_s
    path_s, _ = travel(
        row, col, float(target // cols), float(target % cols), limit_s, ground, entry
    )
    if path_s < limit_s or best[k, 1] != best[k, 1]:
        best[k, 0], best[k, 1], best[k, 2] = at_s + path_s, row, col


@kernel
def start_paths(at_s, paths, tips, best, heap, points, used, labels, ground, entry):  # type: ignore[no-untyped-def]
    """Restart the fire from paths and tips: set the labels, the heap and the source points.

    ``best`` (tips, 3) is a work array. Returns the number of points in use and the heap's size.
    """
    _, best_s, sources = labels
    n = sources.size
    for k in range(tips.target.size):
        sources[tips.target[k]] = -2 - k
        best[k, 0], best[k, 1], best[k, 2] = np.inf, np.nan, np.nan
    for k in range(tips.target.size):
        if tips.at[k, 0] == tips.at[k, 0]:
            _try_path(k, tips.at[k, 0], tips.at[k, 1], at_s, tips, best, ground, entry)
        row, col = _along_front(np.int64(tips.target[k]), tips, sources, ground, entry)
        if row == row:
            _try_path(k, row, col, at_s, tips, best, ground, entry)
    for k in range(paths.target.size):
        tip = -2 - sources[paths.target[k]]
        _try_path(tip, paths.at[k, 0], paths.at[k, 1], at_s, tips, best, ground, entry)
    size = 0
    for k in range(tips.target.size):
        target = tips.target[k]
        best_s[target] = best[k, 0]
        points[used, 0], points[used, 1], points[used, 2] = best[k, 1], best[k, 2], at_s
        sources[target] = n + used
        used += 1
        size = push(heap.times, heap.cells, size, best_s[target], target)
    return used, size
