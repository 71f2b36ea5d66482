"""The inner loops of ``ellipse``: the time from one source, and the least over all of them.

Of all sources only those are tried on a point that may be first somewhere in its tile: down the
quadtree of ``tiles`` a square keeps of its parent's sources those whose earliest time anywhere in
it is not after the latest time of another there.
"""

import math

import numpy as np

from firemodel.compiled import kernel
from firemodel.tiles import first_of

MOST_STEPS = 100
WARM_STEPS = 5  # from where the last point was, before the safe way
CLOSE = 1e-11  # part of the time by which an estimate may still be off
SLACK = 1e-9  # part of the times by which a source may be behind another and is kept


@kernel
def _box_of(level, square, tiles):  # type: ignore[no-untyped-def]
    """Middle x, y and half of the size."""
    box = tiles.boxes[first_of(level) + square]
    return (
        0.5 * (box[0] + box[1]),
        0.5 * (box[2] + box[3]),
        0.5 * (box[1] - box[0]),
        0.5 * (box[3] - box[2]),
    )


# With one wind for all time, on a plane stretched so that the time from a source at d is
# |d| - e d_x: the sources are the sites of an additively weighted Voronoi diagram.


@kernel
def _keep_steady(level, square, sources, e, tiles, kept, counts, earliest):  # type: ignore[no-untyped-def]
    """Of the sources kept by the parent (level - 1), those that may be first in a square."""
    x, y, half_x, half_y = _box_of(level, square, tiles)
    latest = np.inf
    parent = max(level - 1, 0)
    for k in range(counts[parent]):
        number = kept[parent, k]
        dx, dy = abs(x - sources[number, 0]), abs(y - sources[number, 1])
        # The part of the time that a place adds, - e x, is the same for all.
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
    """The least time of each point (sorted), and its source if ``first`` has room for it.

    ``kept`` (levels + 1, sources) holds all sources on level 0, ``at`` (levels + 1) is -1.
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
        for k in range(counts[tiles.levels]):
            number = kept[tiles.levels, k]
            x, y, at_s = sources[number, 0], sources[number, 1], sources[number, 2]
            if first.size:
                for place in range(begin, end):
                    dx, dy = tiles.x[place] - x, tiles.y[place] - y
                    time = at_s + (math.sqrt(dx * dx + dy * dy) - e * dx)
                    if time < best[place]:
                        best[place], first[place] = time, number
            else:
                for place in range(begin, end):
                    dx, dy = tiles.x[place] - x, tiles.y[place] - y
                    time = at_s + (math.sqrt(dx * dx + dy * dy) - e * dx)
                    best[place] = min(best[place], time)


# With wind that changes. A direction n is d + u m, m being d turned left, so that d·n = d·d.


@kernel
def _steepest(dx, dy, period, table):  # type: ignore[no-untyped-def]
    """The u at which one period's h(n) is least."""
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
    """Σ τ h is least between the u at which the single periods' h are."""
    low, high = math.inf, -math.inf
    for number in range(period, table.shape[0]):
        if table[number, 3] + table[number, 5] > 0.0:
            u = _steepest(dx, dy, number, table)
            low, high = min(low, u), max(high, u)
    return low, high


@kernel
def _time_along(nx, ny, way, at_s, period, limit_s, table):  # type: ignore[no-untyped-def]
    """When Σ τ h(n) comes to ``way``; or any time from the limit on."""
    total, now = 0.0, at_s
    for number in range(period, table.shape[0]):
        if now >= limit_s:
            return now
        until = table[number + 1, 0] if number + 1 < table.shape[0] else math.inf
        xx, xy, yy = table[number, 3], table[number, 4], table[number, 5]
        if xx + yy > 0.0:
            root = math.sqrt(xx * nx * nx + 2.0 * xy * nx * ny + yy * ny * ny)
            h = table[number, 1] * nx + table[number, 2] * ny + root
            if total + h * (until - now) >= way:
                return now + (way - total) / h
            total += h * (until - now)
        now = until
    return math.inf


@kernel
def _walk(u, dx, dy, at_s, period, limit_s, table):  # type: ignore[no-untyped-def]
    """When Σ τ h(n) comes to d·n: (time, h then, Σ τ h', Σ τ h''), by u; as ``_time_along``."""
    nx, ny = dx - u * dy, dy + u * dx
    way = dx * dx + dy * dy
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
            here = total + h * (until - now) >= way
            tau = (way - total) / h if here else until - now
            total += tau * h
            per = 1.0 / root
            slope += tau * (cy * dx - cx * dy + (qy * dx - qx * dy) * per)
            curve += tau * (xx * yy - xy * xy) * (per * per * per)
            if here:
                return now + tau, h, slope, curve * way * way
        now = until
    return now, 1.0, 0.0, 1.0


@kernel
def reach(dx, dy, at_s, period, limit_s, nx, ny, table):  # type: ignore[no-untyped-def]
    """When fire lit at a time comes to d from its source, and the n that tells: (time, nx, ny).

    Or any time from the limit on: each u gives a bound from below. ``n`` is a first guess; 0, 0
    for none.
    """
    if dx == 0.0 and dy == 0.0:
        return at_s, nx, ny
    low, high, u = -math.inf, math.inf, 0.0
    forward = nx * dx + ny * dy
    warm = forward > 0.1 * (abs(nx) + abs(ny)) * (abs(dx) + abs(dy))
    if warm:
        u = (ny * dx - nx * dy) / forward
        time = _time_along(
            dx - u * dy, dy + u * dx, dx * dx + dy * dy, at_s, period, limit_s, table
        )
        if time >= limit_s:
            return time, nx, ny
    time = at_s
    for step in range(MOST_STEPS):
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
    """``reach`` from a source, beginning with the n of the last time, which it keeps anew."""
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
def _keep_changing(  # type: ignore[no-untyped-def]
    level, square, sources, periods, table, tiles, kept, counts, normals
):
    """As ``_keep_steady``; the one that is first in the middle comes first.

    What has burned from one source is convex: it has a square once it has its corners. Any n gives
    a bound of another's earliest time there.
    """
    x, y, half_x, half_y = _box_of(level, square, tiles)
    parent = max(level - 1, 0)
    middle_s, winner = math.inf, 0
    for k in range(counts[parent]):
        number = kept[parent, k]
        source, period = sources[number], periods[number]
        time = _reach_from(x, y, source, period, middle_s, normals, number, table)
        if time < middle_s:
            middle_s, winner = time, k
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
    count = 0
    for place in range(counts[parent]):
        k = winner if place == 0 else (0 if place == winner else place)
        number = kept[parent, k]
        nx, ny, at_s = normals[number, 0], normals[number, 1], sources[number, 2]
        way = (x - sources[number, 0]) * nx + (y - sources[number, 1]) * ny
        way -= half_x * abs(nx) + half_y * abs(ny)
        if way > 0.0:
            at_s = _time_along(nx, ny, way, at_s, periods[number], latest, table)
        if at_s <= latest:
            kept[level, count] = number
            count += 1
    counts[level] = count


@kernel
def changing(sources, periods, table, tiles, kept, counts, at, normals, best, first):  # type: ignore[no-untyped-def]
    """As ``steady``; ``periods`` are those in which the sources are lit, ``normals`` all 0."""
    for tile in range(tiles.begin.size - 2):
        begin, end = tiles.begin[tile], tiles.begin[tile + 1]
        if begin == end:
            continue
        for level in range(1, tiles.levels + 1):
            square = tile >> (2 * (tiles.levels - level))
            if at[level] != square:
                at[level] = square
                _keep_changing(level, square, sources, periods, table, tiles, kept, counts, normals)
        candidates = kept[tiles.levels]
        for place in range(begin, end):
            for k in range(counts[tiles.levels]):
                number = candidates[k]
                source, limit_s = sources[number], best[place]
                if source[2] >= limit_s:
                    continue
                time = _reach_from(
                    tiles.x[place],
                    tiles.y[place],
                    source,
                    periods[number],
                    limit_s,
                    normals,
                    number,
                    table,
                )
                if time < best[place]:
                    best[place] = time
                    if first.size:
                        first[place] = number
