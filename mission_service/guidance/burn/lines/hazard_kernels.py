"""Compiled parts of ``hazard``: bounds on ignition times in cells, and time margins of legs.

Lengths are in metres and times in seconds. ``west`` and ``north`` are the coordinates of the
north-west corner of cell (0, 0). Arrays are (y, x), with row 0 in the north. ``first`` and ``last``
bound the ignition times inside each cell. ``at_s`` holds the ignition times at the corners of the
cells, and has one row and one column more than ``first``. ``reach`` is the distance margin. The
vector (``wx``, ``wy``) points downwind; its length is the distance that the wind adds to ``reach``.
"""

import math

from firemodel.compiled import kernel


@kernel
def mark_lit(sources, west, north, cell, first):  # type: ignore[no-untyped-def]
    """Lower the bounds ``first`` near sources; a small fire may not reach any corner of a cell."""
    rows, cols = first.shape
    for number in range(sources.shape[0]):
        col = math.floor((sources[number, 0] - west) / cell)
        row = math.floor((north - sources[number, 1]) / cell)
        # Beyond the raster the conversion to an integer could overflow.
        if not (-2 < row < rows + 1 and -2 < col < cols + 1):
            continue
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(col - 1, 0), min(col + 2, cols)):
                first[r, c] = min(first[r, c], sources[number, 2])


@kernel
def bound_times(at_s, cell, begins, top, left, first, last):  # type: ignore[no-untyped-def]
    """Bound the times in each cell by the times at its corners and the steepest slope near them.

    Each point of a cell is within half a diagonal of a corner. Therefore the bounds also hold for
    fires lit between corners, and for ridges where fires meet.
    """
    last_row, last_col = at_s.shape[0] - 1, at_s.shape[1] - 1
    for i in range(first.shape[0]):
        for j in range(first.shape[1]):
            row, col = top + i, left + j
            low, high, east, south = math.inf, -math.inf, 0.0, 0.0
            for r in range(row, row + 2):
                for c in range(col, col + 2):
                    low, high = min(low, at_s[r, c]), max(high, at_s[r, c])
            if low == math.inf:
                first[i, j], last[i, j] = low, low
                continue
            r1, c1 = min(row + 2, last_row), min(col + 2, last_col)
            for r in range(max(row - 1, 0), r1 + 1):
                for c in range(max(col - 1, 0), c1 + 1):
                    if at_s[r, c] == math.inf:
                        continue
                    if c < c1 and at_s[r, c + 1] < math.inf:
                        east = max(east, abs(at_s[r, c + 1] - at_s[r, c]))
                    if r < r1 and at_s[r + 1, c] < math.inf:
                        south = max(south, abs(at_s[r + 1, c] - at_s[r, c]))
            spare = math.sqrt(0.5) * math.hypot(east, south)
            first[i, j], last[i, j] = max(low - spare, begins), high + spare


@kernel
def margin_near_s(first, last, west, north, cell, reach, wx, wy, residence, x, y, t0, t1, slack):  # type: ignore[no-untyped-def]
    """Return the smallest time margin of positions within ``slack`` of (x, y), from t0 to t1."""
    rows, cols = first.shape
    wind = math.hypot(wx, wy)
    max_m = reach + wind + slack
    left, right = (math.floor((x - max_m - west) / cell), math.floor((x + max_m - west) / cell))
    top, bottom = (math.floor((north - y - max_m) / cell), math.floor((north - y + max_m) / cell))
    if left < 0 or top < 0 or right >= cols or bottom >= rows:
        return -math.inf
    about = slack + math.sqrt(0.5) * cell  # maximum error of a distance from a cell's centre
    min_s = math.inf
    for row in range(top, bottom + 1):
        for col in range(left, right + 1):
            if last[row, col] <= t0 - residence or first[row, col] - t1 >= min_s:
                continue
            # Vector from the centre of the cell, where fire may burn, to the vehicle.
            dx, dy = x - (west + (col + 0.5) * cell), y - (north - (row + 0.5) * cell)
            away = math.hypot(max(abs(dx) - 0.5 * cell, 0.0), max(abs(dy) - 0.5 * cell, 0.0))
            along = wx * dx + wy * dy + wind * about
            gap = math.hypot(dx, dy) - about
            more = 0.0
            if along > 0.0:
                more = wind if along >= wind * gap else along / gap
            if away <= reach + more + slack:
                min_s = first[row, col] - t1
    return min_s


@kernel
def min_margin_s(  # type: ignore[no-untyped-def]
    first, last, west, north, cell, reach, wx, wy, residence, x0, y0, t0, x1, y1, t1
):
    """Return the smallest time margin of a straight leg."""
    # Vertical legs also have slack, so that the end of a safe leg is a safe start for the next leg.
    count = max(math.ceil(math.hypot(x1 - x0, y1 - y0) / cell), 1)
    min_s = math.inf
    for number in range(count):
        part, middle, end = number / count, (number + 0.5) / count, (number + 1) / count
        margin_s = margin_near_s(
            *(first, last, west, north, cell, reach, wx, wy, residence),
            *(x0 + middle * (x1 - x0), y0 + middle * (y1 - y0)),
            *(t0 + part * (t1 - t0), t0 + end * (t1 - t0), 0.5 * cell),
        )
        min_s = min(min_s, margin_s)
    return min_s


@kernel
def is_surely_in_danger(  # type: ignore[no-untyped-def]
    at_s, west, north, cell, reach, wx, wy, residence, time, x0, y0, t0, x1, y1, t1
):
    """Return whether fire at a corner of any cell is too close to a straight leg."""
    max_m = reach + math.hypot(wx, wy)
    count = max(math.ceil(math.hypot(x1 - x0, y1 - y0) / cell), math.ceil(t1 - t0), 1)
    for number in range(count + 1):
        part = number / count
        x, y, t = x0 + part * (x1 - x0), y0 + part * (y1 - y0), t0 + part * (t1 - t0)
        left, right = (math.ceil((x - max_m - west) / cell), math.floor((x + max_m - west) / cell))
        top, bottom = (
            math.ceil((north - y - max_m) / cell),
            math.floor((north - y + max_m) / cell),
        )
        for row in range(max(top, 0), min(bottom, at_s.shape[0] - 1) + 1):
            for col in range(max(left, 0), min(right, at_s.shape[1] - 1) + 1):
                if t - residence < at_s[row, col] < t + time:
                    dx, dy = x - (west + col * cell), y - (north - row * cell)
                    away = math.hypot(dx, dy)
                    along = max(wx * dx + wy * dy, 0.0)
                    if away <= reach or away * away <= reach * away + along:
                        return True
    return False
