"""Ignite cells in order of time: the inner loop of ``anyangle``."""

import numpy as np

from firemodel.compiled import kernel
from firemodel.spread.heap import drop_first, push
from firemodel.spread.labels import blocked_diagonal, place_of
from firemodel.spread.travel_time import (
    STEP_COL,
    STEP_ROW,
    cell_at,
    crossing_s,
    from_segment,
    travel,
)

MAX_LINE_CELLS = 32  # longest line over ground that is not uniform
KNIGHT_ROW = np.array([-2, -1, 1, 2, 2, 1, -1, -2])
KNIGHT_COL = np.array([1, 2, 2, 1, -1, -2, -2, -1])
ROUNDING = 1e-12  # relative gain in time that a path must exceed to replace another
WORTH_A_POINT = 0.002  # relative gain in time that justifies a new source


@kernel
def burn_until(to_time_s, times, cells, size, points, used, labels, ground, entry):  # type: ignore[no-untyped-def]
    """Ignite cells from the heap until a time, but stop when the heap or the points are full.

    Returns the heap's new size and the number of points in use.
    """
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
        reachable = max(alike, MAX_LINE_CELLS)
        for side in range(8):
            to_row, to_col = row + STEP_ROW[side], col + STEP_COL[side]
            if not (0 <= to_row < rows and 0 <= to_col < cols):
                continue
            target = to_row * cols + to_col
            if best_s[target] <= now or blocked_diagonal(row, col, to_row, to_col, best_s, cols):
                continue
            best, via = best_s[target], sources[target]
            length = max(abs(to_row - from_row), abs(to_col - from_col))
            if source != cell and source != via and length <= reachable:
                limit_s = best - from_s
                path_s, _ = travel(
                    from_row, from_col, float(to_row), float(to_col), limit_s, ground, entry
                )
                other = via
                if path_s < limit_s:
                    best, via = max(from_s + path_s, now), source
                if other >= n and source >= n and points[other - n, 2] == from_s:
                    # Both sources are on the same front: try a source between them.
                    time, at_row, at_col = from_segment(
                        from_row,
                        from_col,
                        points[other - n, 0],
                        points[other - n, 1],
                        target,
                        ground,
                        entry,
                    )
                    limit_s = best - from_s
                    path_s, _ = travel(
                        at_row, at_col, float(to_row), float(to_col), limit_s, ground, entry
                    )
                    if time < np.inf and path_s < limit_s - WORTH_A_POINT * (best - from_s):
                        best, via = max(from_s + path_s, now), n + used
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
        # A cell that becomes the source of most cells ahead also tries the knight's moves: in only
        # eight directions the arrival between two directions of a narrow ellipse would be late.
        if source != cell and max(abs(row - from_row), abs(col - from_col)) + 1.0 <= reachable:
            continue
        for side in range(8):
            to_row, to_col = row + KNIGHT_ROW[side], col + KNIGHT_COL[side]
            if not (0 <= to_row < rows and 0 <= to_col < cols):
                continue
            target = to_row * cols + to_col
            if best_s[target] > now:
                limit_s = best_s[target] * (1.0 - ROUNDING) - now
                path_s, _ = travel(
                    float(row), float(col), float(to_row), float(to_col), limit_s, ground, entry
                )
                if path_s < limit_s:
                    best_s[target], sources[target] = now + path_s, cell
                    size = push(times, cells, size, now + path_s, target)
    return size, used
