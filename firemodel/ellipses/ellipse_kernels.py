"""Compute the arrival time from one source, and the earliest over all sources, for ``ellipse``.

For each point, only the sources whose fire may arrive first somewhere in the point's tile are
compared. At each level of the quadtree (``tiles``), the sources of a square are selected from the
sources of its parent square. A source is dropped if its fire's earliest arrival in the square is
later than the latest arrival there of another source's fire.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.compiled import kernel
from firemodel.ellipses.tiles import first_of

MAX_STEPS = 100
WARM_STEPS = 5  # number of steps from the previous solution before a search with a bracket
CLOSE = 1e-11  # the search ends at this relative error of the time
SLACK = 1e-9  # a source is kept if its relative delay behind another source is smaller


class Bounds(NamedTuple):
    """Upper bounds on the distance that fire covers in each of k directions.

    A reference fire that starts with the first period has covered ``begins_m`` (periods, k) at the
    start of each period. A source's fire is always ``lit_m`` (sources, k) behind the reference
    fire.
    """

    normals: Floats  # (k, 2)
    speeds: Floats  # (periods, k) m/s
    begins_m: Floats
    lit_m: Floats
    limit_m: Floats  # (k) work array: distance covered by the reference fire by a time limit
    last: NDArray[np.int64]  # (sources) work array: the direction that last excluded a source


@kernel
def _box_of(level, square, tiles):  # type: ignore[no-untyped-def]
    """Return the centre (x, y) and half-widths (x, y) of the box around a square's points."""
    box = tiles.boxes[first_of(level) + square]
    return (
        0.5 * (box[0] + box[1]),
        0.5 * (box[2] + box[3]),
        0.5 * (box[1] - box[0]),
        0.5 * (box[3] - box[2]),
    )


# Constant wind. The coordinates are scaled so that the travel time of fire along a vector d from a
# source is |d| - e d_x; the sources are then the sites of an additively weighted Voronoi diagram.


@kernel
def to_plane(points, origin, matrix, found):  # type: ignore[no-untyped-def]
    """Write the product of (p - origin) and ``matrix`` into ``found``, for each point p.

    Returns the index of the first point that is not finite, or the number of points if all are
    finite.
    """
    for k in range(points.shape[0]):
        x, y = points[k, 0] - origin[0], points[k, 1] - origin[1]
        if not abs(x) + abs(y) < math.inf:
            return k
        found[k, 0] = x * matrix[0, 0] + y * matrix[1, 0]
        found[k, 1] = x * matrix[0, 1] + y * matrix[1, 1]
    return points.shape[0]


@kernel
def _keep_steady(level, square, sources, e, tiles, kept, counts, earliest):  # type: ignore[no-untyped-def]
    """Keep the parent square's (level - 1) sources whose fire may arrive first in a square."""
    x, y, half_x, half_y = _box_of(level, square, tiles)
    latest = np.inf
    parent = max(level - 1, 0)
    for k in range(counts[parent]):
        number = kept[parent, k]
        dx, dy = abs(x - sources[number, 0]), abs(y - sources[number, 1])
        # The term - e x of the point is omitted, because it is the same for all sources.
        since = sources[number, 2] + e * sources[number, 0]
        near_x, near_y = max(dx - half_x, 0.0), max(dy - half_y, 0.0)
        far_x, far_y = dx + half_x, dy + half_y
        earliest[k] = since + math.sqrt(near_x * near_x + near_y * near_y)
        latest = min(latest, since + math.sqrt(far_x * far_x + far_y * far_y))
    latest += SLACK * (1.0 + abs(latest))
    count = 0
    for k in range(counts[parent]):
        if earliest[k] <= latest:
            kept[level, count] = kept[parent, k]
            count += 1
    counts[level] = count


@kernel
def steady(sources, e, tiles, kept, counts, at, earliest, best, first):  # type: ignore[no-untyped-def]
    """Write the arrival time at each point into ``best``, and the source into ``first``.

    Points are in the order of the tiles; an empty ``first`` is not filled. On entry, level 0 of
    ``kept`` (levels + 1, sources) contains all sources, and all of ``at`` (levels + 1) is -1.
    """
    for tile in range(tiles.begin.size - 2):
        begin, end = tiles.begin[tile], tiles.begin[tile + 1]
        if begin == end:
            continue
        for level in range(tiles.levels + 1):
            square = tile >> (2 * (tiles.levels - level))
            if at[level] != square:
                at[level] = square
                _keep_steady(level, square, sources, e, tiles, kept, counts, earliest)
        # Slices are used so that indices begin at 0 and the loop can be vectorised.
        xs, ys, times = tiles.x[begin:end], tiles.y[begin:end], best[begin:end]
        for k in range(counts[tiles.levels]):
            number = kept[tiles.levels, k]
            x, y, at_s = sources[number, 0], sources[number, 1], sources[number, 2]
            if first.size:
                for place in range(xs.size):
                    dx, dy = xs[place] - x, ys[place] - y
                    time = at_s + (math.sqrt(dx * dx + dy * dy) - e * dx)
                    if time < times[place]:
                        times[place], first[begin + place] = time, number
            else:
                for place in range(xs.size):
                    dx, dy = xs[place] - x, ys[place] - y
                    time = at_s + (math.sqrt(dx * dx + dy * dy) - e * dx)
                    times[place] = time if time < times[place] else times[place]


# Changing wind. A direction n is d + u m, where m is d turned left by 90 degrees, so d·n = d·d.


@kernel
def _steepest(dx, dy, period, table):  # type: ignore[no-untyped-def]
    """Return the u at which h(n) of one period has its minimum."""
    cx, cy = table[period, 1], table[period, 2]
    xx, xy, yy = table[period, 3], table[period, 4], table[period, 5]
    c = cy * dx - cx * dy
    beta = (xy * dx + yy * dy) * dx - (xx * dx + xy * dy) * dy
    gamma = xx * dy * dy - 2.0 * xy * dx * dy + yy * dx * dx
    length2 = dx * dx + dy * dy
    det = (xx * yy - xy * xy) * length2 * length2
    return (-c * math.sqrt(det / (gamma - c * c)) - beta) / gamma


@kernel
def _bracket(dx, dy, period, table):  # type: ignore[no-untyped-def]
    """Return the smallest and largest of the values of u that minimise the periods' h(n).

    The minimum of Σ τ h is between these two values of u.
    """
    low, high = math.inf, -math.inf
    for number in range(period, table.shape[0]):
        if table[number, 3] + table[number, 5] > 0.0:
            u = _steepest(dx, dy, number, table)
            low, high = min(low, u), max(high, u)
    return low, high


@kernel
def _walk(u, dx, dy, at_s, period, limit_s, table):  # type: ignore[no-untyped-def]
    """Return the time at which Σ τ h(n) equals d·n, then h, Σ τ h' and Σ τ h'' at that time.

    The derivatives are with respect to u. If the time is after ``limit_s``, any time at or after
    the limit is returned instead.
    """
    nx, ny = dx - u * dy, dy + u * dx
    distance = dx * dx + dy * dy
    total, slope, curve, now = 0.0, 0.0, 0.0, at_s
    for number in range(period, table.shape[0]):
        if now >= limit_s:
            break
        xx, xy, yy = table[number, 3], table[number, 4], table[number, 5]
        until = table[number + 1, 0] if number + 1 < table.shape[0] else math.inf
        if xx + yy > 0.0:
            cx, cy = table[number, 1], table[number, 2]
            qx, qy = xx * nx + xy * ny, xy * nx + yy * ny
            root = math.sqrt(qx * nx + qy * ny)
            h = cx * nx + cy * ny + root
            reached = total + h * (until - now) >= distance
            tau = (distance - total) / h if reached else until - now
            total += tau * h
            per = 1.0 / root
            slope += tau * (cy * dx - cx * dy + (qy * dx - qx * dy) * per)
            curve += tau * (xx * yy - xy * xy) * (per * per * per)
            if reached:
                return now + tau, h, slope, curve * distance * distance
        now = until
    return now, 1.0, 0.0, 1.0


@kernel
def reach(dx, dy, at_s, period, limit_s, nx, ny, table):  # type: ignore[no-untyped-def]
    """Return the arrival time at d from a source, and the direction (nx, ny) that determines it.

    The source is lit at ``at_s``. Each u gives a lower bound on the time. If a bound is at or after
    ``limit_s``, the search stops and returns that bound. On entry, (nx, ny) is an initial guess of
    the direction; (0, 0) means that there is none.
    """
    if dx == 0.0 and dy == 0.0:
        return at_s, nx, ny
    low, high, u = -math.inf, math.inf, 0.0
    forward = nx * dx + ny * dy
    warm = forward > 0.1 * (abs(nx) + abs(ny)) * (abs(dx) + abs(dy))
    if warm:
        u = (ny * dx - nx * dy) / forward
    time = at_s
    for step in range(MAX_STEPS):
        if step == (WARM_STEPS if warm else 0):
            low, high = _bracket(dx, dy, period, table)
            if low > high:
                return math.inf, 0.0, 0.0
            u = 0.5 * (low + high)
        time, h, slope, curve = _walk(u, dx, dy, at_s, period, limit_s, table)
        if time >= limit_s:
            break
        rest = 0.5 * slope * slope / (curve * h)
        if rest <= CLOSE * (time - at_s):
            time += rest
            break
        if slope > 0.0:
            high = u
        else:
            low = u
        u -= slope / curve
        if not low < u < high:
            u = 0.5 * (low + high)
    return time, dx - u * dy, dy + u * dx


@kernel
def _reach_from(x, y, source, period, limit_s, normals, number, table):  # type: ignore[no-untyped-def]
    """Return the time of ``reach``; row ``number`` of ``normals`` is the initial guess."""
    time, nx, ny = reach(
        x - source[0],
        y - source[1],
        source[2],
        period,
        limit_s,
        normals[number, 0],
        normals[number, 1],
        table,
    )
    normals[number, 0], normals[number, 1] = nx, ny
    return time


@kernel
def _limit(limit_s, table, bounds):  # type: ignore[no-untyped-def]
    """Set ``bounds.limit_m`` to the distances that the reference fire covers by the time limit."""
    period = table.shape[0] - 1
    while period > 0 and table[period, 0] > limit_s:
        period -= 1
    since_s = limit_s - table[period, 0]
    for k in range(bounds.limit_m.size):
        speed = bounds.speeds[period, k]
        bounds.limit_m[k] = bounds.begins_m[period, k] + (speed * since_s if speed > 0.0 else 0.0)


@kernel
def _too_late(x, y, half_x, half_y, sources, number, limit_s, bounds):  # type: ignore[no-untyped-def]
    """Return True if a source's fire is certain to reach a box only after the time limit.

    This is certain if, in at least one direction, the fire does not cover the distance to the box
    in time.
    """
    if sources[number, 2] > limit_s:
        return True
    dx, dy = x - sources[number, 0], y - sources[number, 1]
    count = bounds.limit_m.size
    for turn in range(count):
        k = bounds.last[number] + turn
        k = k - count if k >= count else k
        nx, ny = bounds.normals[k, 0], bounds.normals[k, 1]
        distance = dx * nx + dy * ny - (half_x * abs(nx) + half_y * abs(ny))
        if distance > bounds.limit_m[k] - bounds.lit_m[number, k]:
            bounds.last[number] = k
            return True
    return False


@kernel
def _keep_changing(  # type: ignore[no-untyped-def]
    level, square, sources, periods, table, bounds, tiles, kept, counts, normals
):
    """Keep sources as ``_keep_steady`` does, but for changing wind.

    The source whose fire arrives first at the centre of the square is put first. The area burned
    from one source is convex; it therefore covers a square as soon as it covers the four corners.
    """
    x, y, half_x, half_y = _box_of(level, square, tiles)
    parent = max(level - 1, 0)
    middle_s, winner = math.inf, 0
    for k in range(counts[parent]):
        number = kept[parent, k]
        if middle_s < math.inf and _too_late(x, y, 0.0, 0.0, sources, number, middle_s, bounds):
            continue
        source, period = sources[number], periods[number]
        time = _reach_from(x, y, source, period, middle_s, normals, number, table)
        if time < middle_s:
            middle_s, winner = time, k
            _limit(middle_s, table, bounds)
    number = kept[parent, winner]
    latest = -math.inf
    for corner in range(4):
        at_x = x + (half_x if corner & 1 else -half_x)
        at_y = y + (half_y if corner & 2 else -half_y)
        dx, dy = at_x - sources[number, 0], at_y - sources[number, 1]
        nx, ny = normals[number, 0], normals[number, 1]
        at_s, period = sources[number, 2], periods[number]
        time, nx, ny = reach(dx, dy, at_s, period, math.inf, nx, ny, table)
        latest = max(latest, time)
    latest += SLACK * (1.0 + abs(latest))
    if latest < math.inf:
        _limit(latest, table, bounds)
    count = 0
    for place in range(counts[parent]):
        k = winner if place == 0 else (0 if place == winner else place)
        number = kept[parent, k]
        if latest == math.inf or not _too_late(
            x, y, half_x, half_y, sources, number, latest, bounds
        ):
            kept[level, count] = number
            count += 1
    counts[level] = count


@kernel
def changing(  # type: ignore[no-untyped-def]
    sources, periods, table, bounds, tiles, kept, counts, at, normals, best, first
):
    """Compute arrival times as ``steady`` does, but for changing wind.

    ``periods`` (sources) are the periods in which the sources are lit; ``normals`` is 0 on entry.
    """
    for tile in range(tiles.begin.size - 2):
        begin, end = tiles.begin[tile], tiles.begin[tile + 1]
        if begin == end:
            continue
        for level in range(1, tiles.levels + 1):
            square = tile >> (2 * (tiles.levels - level))
            if at[level] != square:
                at[level] = square
                _keep_changing(
                    level, square, sources, periods, table, bounds, tiles, kept, counts, normals
                )
        candidates = kept[tiles.levels]
        for place in range(begin, end):
            x, y = tiles.x[place], tiles.y[place]
            for k in range(counts[tiles.levels]):
                number, limit_s = candidates[k], best[place]
                if limit_s < math.inf and _too_late(
                    x, y, 0.0, 0.0, sources, number, limit_s, bounds
                ):
                    continue
                source, period = sources[number], periods[number]
                time = _reach_from(x, y, source, period, limit_s, normals, number, table)
                if time < limit_s:
                    best[place] = time
                    _limit(time, table, bounds)
                    if first.size:
                        first[place] = number
