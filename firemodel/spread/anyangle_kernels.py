"""Process the nodes in order of arrival time: the inner loop of ``anyangle``."""

import numpy as np

from firemodel.compiled import inlined, kernel
from firemodel.spread.heap import drop_first, push
from firemodel.spread.labels import (
    Lattice,
    add_bend,
    add_path,
    add_point,
    ij_of,
    key_of,
    keys_of,
    place_of,
)
from firemodel.spread.travel_time import (
    STEP_COL,
    STEP_ROW,
    cell_at,
    crossing_s,
    evenest_cell,
    from_segment,
    prepare,
    travel_s,
)

MAX_LINE_CELLS = 32  # longest line over ground that is not uniform
IGNITES = 17  # distance in i and j up to which the centre of a lit cell has paths to nodes
IGNITION_ROOM = (2 * IGNITES + 1) ** 2
ADJOINS = 5  # paths from an ignition are stored for nodes within this distance in i and j
ROOM = 100  # maximum number of entries that processing a node adds to the heap or to the points
BETWEEN_CELLS = 3.0  # maximum distance between two joined sources on a front
MAX_SLIDES = 12  # maximum number of front points that a source is moved past at once
BEND_CELLS = 14  # longest line to which a bend is added
UNLIKE = 0.15  # least relative difference in slowness between the cells at an edge with a bend
SEARCH_ROUNDS = 2  # searches for the position of a bend, each finer than the previous one
SEARCH_CELLS = 0.25  # first step of the search along an edge
SEARCH_SHARE = 0.06  # the same in proportion to the length of the line; the larger one is used
ROUNDING = 1e-12  # relative gain in time that a path must exceed to replace another
WORTH_A_POINT = 0.002  # relative gain in time that justifies a new source on a front
WORTH_A_BEND = 0.005  # the same for a bend in a line from a node
WORTH_A_SECOND_BEND = 0.002  # the same for a bend in a line from a point
WORTH_A_MOVE = 0.003  # the same for another position of a bend


def _within_a_cell(step: int, odd_i: bool, odd_j: bool) -> list[tuple[int, int]]:
    """Return the offsets (i, j) from a node to its cells' nodes; nodes on edges come first."""
    reach_i, reach_j = 1 if odd_i else 2, 1 if odd_j else 2
    found = []
    for i in range(-reach_i, reach_i + 1):
        for j in range(-reach_j, reach_j + 1):
            to_odd_i, to_odd_j = (i + odd_i) % 2 == 1, (j + odd_j) % 2 == 1
            at_centre = to_odd_i and to_odd_j
            on_lattice = step == 1 or not (to_odd_i or to_odd_j)
            if (i, j) != (0, 0) and (at_centre or on_lattice):
                found.append((at_centre, (i, j)))
    return [offset for _, offset in sorted(found, key=lambda each: each[0])]


def _offsets() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the offsets (kinds, 24, 4), and the number of offsets for each kind of node.

    An offset consists of four differences between two nodes: in i, in j, in the row of the cell to
    which the key belongs, and in the rest of the key. The second array contains the number of
    offsets to nodes on edges, the third the number of all offsets. The first two kinds
    (``kind_of``) are those of the lattice of corners: a corner and a centre. The other four are
    those of the lattice with edge midpoints: a corner, the midpoint of a horizontal edge, the
    midpoint of a vertical edge, and a centre.
    """
    kinds = [(2, odd, odd) for odd in (False, True)]
    kinds += [(1, odd_i, odd_j) for odd_i in (False, True) for odd_j in (False, True)]
    each = [_within_a_cell(*kind) for kind in kinds]
    table = np.zeros((len(each), 24, 4), dtype=np.int64)
    for number, ((step, odd_i, odd_j), offsets) in enumerate(zip(kinds, each, strict=True)):
        lattice = Lattice(step, 0, 0, 2 if step == 2 else 4)  # a lattice with one column of keys
        i, j = np.array([*offsets, (0, 0)]).T
        down, keys = (i + odd_i) // 2, keys_of(i + odd_i, j + odd_j, lattice)
        differences = np.stack([i, j, down, keys - keys[-1] - lattice.each * down], axis=1)
        table[number, : len(offsets)] = differences[:-1]
    edges = [
        sum((i + odd_i) % 2 == 0 or (j + odd_j) % 2 == 0 for i, j in offsets)
        for (_, odd_i, odd_j), offsets in zip(kinds, each, strict=True)
    ]
    return table, np.array(edges), np.array([len(offsets) for offsets in each])


OFFSETS, EDGES, COUNTS = _offsets()
KNIGHT_I = np.array([-4, -2, 2, 4, 4, 2, -2, -4])
KNIGHT_J = np.array([2, 4, 4, 2, -2, -4, -4, -2])


@inlined
def kind_of(i, j, lattice):  # type: ignore[no-untyped-def]
    """Return the kind of a node, an index of ``OFFSETS``."""
    return i % 2 if lattice.step == 2 else 2 + 2 * (i % 2) + j % 2


@inlined
def _source_of(key, points, labels, ground, lattice):  # type: ignore[no-untyped-def]
    """Return the key, position (y, x), time and cell of a node's source, and a distance.

    Within this distance (in cells), all cells have the same conditions as the source's cell.
    """
    source = np.int64(labels.source[key])
    y, x, at_s = place_of(source, points, labels, lattice)
    origin = evenest_cell(y, x, ground)
    return source, y, x, at_s, origin, ground.reach[origin] - 0.5


@kernel
def prepare_around(i, j, ground, lattice, entry):  # type: ignore[no-untyped-def]
    """Compute those slownesses of a node's cells that are not yet known."""
    for row in range(max((i - 1) >> 1, 0), min((i >> 1) + 1, lattice.rows)):
        for col in range(max((j - 1) >> 1, 0), min((j >> 1) + 1, lattice.cols)):
            prepare(row * lattice.cols + col, ground, entry)


@inlined
def step_s(i, j, di, dj, ground, lattice):  # type: ignore[no-untyped-def]
    """Return the travel time from a node to another node of the same cell.

    Along an edge, the time is that of the faster of the two cells. The time is infinite if fire
    does not spread there in the current weather, and 0 if the cells cannot burn. The slownesses of
    the cells must have been computed.
    """
    north, east = -0.5 * di * ground.cell_m, 0.5 * dj * ground.cell_m
    length2 = north * north + east * east
    row, col = (2 * i + di) >> 2, (2 * j + dj) >> 2  # cell of the midpoint between the nodes
    along_row = di == 0 and i % 2 == 0
    along_col = dj == 0 and j % 2 == 0
    cell, found = row * lattice.cols + col, 0.0
    if row < lattice.rows and col < lattice.cols and ground.terrain.fuel[cell] >= 0:
        found = crossing_s(cell, north, east, length2, ground)
    if (along_row and row > 0) or (along_col and col > 0):
        cell -= lattice.cols if along_row else 1
        if ground.terrain.fuel[cell] >= 0:
            other = crossing_s(cell, north, east, length2, ground)
            if found == 0.0 or other < found:
                found = other
    return found


@kernel
def burn_until(  # type: ignore[no-untyped-def]
    to_time_s, clock_s, since_s, queue, size, waits, points, used, labels, ground, lattice, entry
):
    """Process queued nodes until the given time, but stop when the queue or the points are full.

    A faster path to a node may be found after later nodes were processed. The node's time may then
    be earlier than the times of nodes processed before it. The time of a centre is never earlier
    than ``clock_s``, the latest time processed so far.

    Returns the heap's new size, the number of waiting centres, the number of points in use, and the
    clock.
    """
    times, keys, waiting = queue
    best_s, sources, active_row = labels
    n = best_s.size
    row_keys = lattice.each * (lattice.cols + 1)
    source, origin = np.int64(-1), 0
    from_y = from_x = from_s = alike = 0.0
    while size > 0 and times[0] <= to_time_s:
        if (
            size + ROOM > times.size
            or waits + ROOM > waiting.size
            or used + ROOM > points.at.shape[0]
        ):
            break
        now, key = times[0], np.int64(keys[0])
        size = drop_first(times, keys, size)
        if best_s[key] != now:
            continue  # replaced by a better entry
        clock_s = max(clock_s, now)
        i, j = ij_of(key, lattice)
        active_row[i >> 1] = True
        y, x = 0.5 * i, 0.5 * j
        if source != sources[key]:
            source, from_y, from_x, from_s, origin, alike = _source_of(
                key, points, labels, ground, lattice
            )
        far = max(abs(y - from_y), abs(x - from_x))
        if on_front(source - n, points):
            used = slide_on_front(y, x, key, points, used, labels, ground, lattice, entry)
        elif far > alike:
            if source < n:
                slide(i, j, key, since_s, labels, ground, lattice, entry)
            else:
                used = move_bend(y, x, key, since_s, points, used, labels, ground, lattice, entry)
            if far <= BEND_CELLS:
                worth = WORTH_A_BEND if source < n else WORTH_A_SECOND_BEND
                used = bend(y, x, key, worth, points, used, labels, ground, lattice, entry)
        if source != sources[key]:
            source, from_y, from_x, from_s, origin, alike = _source_of(
                key, points, labels, ground, lattice
            )
        reachable = max(alike, MAX_LINE_CELLS)
        prepare(origin, ground, entry)
        prepared = False
        at_s = best_s[key]
        kind = kind_of(i, j, lattice)
        even = far + 1.0 <= alike
        inside = 2 <= i <= 2 * lattice.rows - 2 and 2 <= j <= 2 * lattice.cols - 2
        for number in range(COUNTS[kind]):
            di, dj = OFFSETS[kind, number, 0], OFFSETS[kind, number, 1]
            to_i, to_j = i + di, j + dj
            if not inside and not (0 <= to_i <= 2 * lattice.rows and 0 <= to_j <= 2 * lattice.cols):
                continue
            target = key + OFFSETS[kind, number, 2] * row_keys + OFFSETS[kind, number, 3]
            centre = number >= EDGES[kind]
            other = np.int64(sources[target])
            # A single condition, because the processor cannot predict either of its parts.
            if (best_s[target] <= (clock_s if centre else now)) | (even & (source == other)):
                continue
            to_y, to_x = 0.5 * to_i, 0.5 * to_j
            best, via = best_s[target], other
            length = max(abs(to_y - from_y), abs(to_x - from_x))
            if even or length <= alike:
                if source == other:
                    continue
                north, east = (from_y - to_y) * ground.cell_m, (to_x - from_x) * ground.cell_m
                path_s = crossing_s(origin, north, east, north * north + east * east, ground)
                if from_s + path_s < best:
                    best, via = from_s + path_s, source
            else:
                if not prepared:
                    prepare_around(i, j, ground, lattice, entry)
                    prepared = True
                path_s = step_s(i, j, di, dj, ground, lattice)
                if path_s == 0.0:
                    continue
                if at_s + path_s < best * (1.0 - ROUNDING):
                    best, via = at_s + path_s, key
                # With edge midpoints, targets that are not onwards are tried from other nodes
                # beside the line.
                onwards = di * (to_y - from_y) >= 0.0 and dj * (to_x - from_x) >= 0.0
                if source != other and length <= reachable and (lattice.step == 2 or onwards):
                    limit_s = best * (1.0 + ROUNDING) - from_s  # a straight line wins a tie
                    path_s = travel_s(from_y, from_x, to_y, to_x, limit_s, ground, entry)
                    if path_s < limit_s:
                        best, via = from_s + path_s, source
            if best < best_s[target] or other < 0:
                via = via if via >= 0 else key
                best_s[target], sources[target] = best, via
                if not centre:
                    size = push(times, keys, size, best, target)
                    continue
                if on_front(via - n, points):
                    used = slide_on_front(
                        to_y, to_x, target, points, used, labels, ground, lattice, entry
                    )
                best_s[target] = max(best_s[target], clock_s)
                if other < 0:
                    waiting[waits] = target
                    waits += 1
        # From a node that becomes the source of most nodes ahead, the knight's moves (two steps and
        # one step) are also tried: with only eight directions, arrival times between two directions
        # of a narrow ellipse would be too late.
        if lattice.step == 1 or far + 1.0 <= reachable:
            continue
        for side in range(8):
            to_i, to_j = i + KNIGHT_I[side], j + KNIGHT_J[side]
            if not (0 <= to_i <= 2 * lattice.rows and 0 <= to_j <= 2 * lattice.cols):
                continue
            target = key_of(to_i, to_j, lattice)
            if best_s[target] > now:
                limit_s = best_s[target] * (1.0 - ROUNDING) - now
                path_s = travel_s(y, x, 0.5 * to_i, 0.5 * to_j, limit_s, ground, entry)
                if path_s < limit_s:
                    best_s[target], sources[target] = now + path_s, key
                    size = push(times, keys, size, now + path_s, target)
    return size, waits, used, clock_s


@kernel
def arrive(to_time_s, waiting, waits, arrival_s, labels, lattice):  # type: ignore[no-untyped-def]
    """Set the arrival times of the waiting centres that fire has reached by the given time.

    Returns the number of centres still waiting.
    """
    rest = 0
    for k in range(waits):
        key = np.int64(waiting[k])
        if labels.best_s[key] <= to_time_s:
            i, j = ij_of(key, lattice)
            arrival_s[i // 2, j // 2] = labels.best_s[key]
        else:
            waiting[rest] = key
            rest += 1
    return rest


@kernel
def _bend_edge(source, to, ground, entry):  # type: ignore[no-untyped-def]
    """Return the edge between cells at which a line most probably bends.

    The line leads from ``source`` (y, x, ...) to ``to`` (y, x). Of all edges that it crosses, this
    is the one with the largest relative difference in slowness between the adjoining cells; if
    several have it, the one nearest to the midpoint. Returns whether the edge is along a row, the
    row or the column of the edge, and the position along it; the row or column is -1 if no
    difference exceeds ``UNLIKE``.
    """
    from_y, from_x, y, x = source[0], source[1], to[0], to[1]
    along_found, edge_found, place, most, nearest = False, -1.0, 0.0, UNLIKE, 0.5
    for along_row in (False, True):
        start, end = (from_y, y) if along_row else (from_x, x)
        edge = np.floor(min(start, end)) + 1.0
        while edge < max(start, end):
            share = (edge - start) / (end - start)
            if along_row:
                at = from_x + share * (x - from_x)
                one, other = cell_at(edge - 0.5, at, ground), cell_at(edge, at, ground)
            else:
                at = from_y + share * (y - from_y)
                one, other = cell_at(at, edge - 0.5, ground), cell_at(at, edge, ground)
            prepare(one, ground, entry)
            prepare(other, ground, entry)
            a, b = ground.slowness[4 * one], ground.slowness[4 * other]
            differs = abs(a - b) / max(a, b)
            if differs > most or (differs == most and abs(share - 0.5) < nearest):
                along_found, edge_found, place = along_row, edge, at
                most, nearest = differs, abs(share - 0.5)
            edge += 1.0
    return along_found, edge_found, place


@kernel
def _add_fastest_bend(  # type: ignore[no-untyped-def]
    y, x, key, source, bend, worth_s, points, used, labels, ground, lattice, entry
):
    """Improve a node's label: search along an edge for the fastest bend between source and node.

    ``bend`` consists of the row or the column of the edge, whether the edge is along a row, the
    position along it at which the search begins, and the first step. If the gain in time is more
    than ``worth_s``, a point is added at the bend. Returns the number of points in use.
    """
    best_s, sources, _ = labels
    edge, along_row, place, step = bend
    from_y, from_x, from_s = place_of(source, points, labels, lattice)
    most = ground.cols if along_row else lattice.rows
    found_s, found, bend_s = best_s[key] * (1.0 - ROUNDING), -1.0, 0.0
    for _ in range(SEARCH_ROUNDS):
        centre = place if found < 0.0 else found
        for side in (-step, step):
            for steps in (1, 2):
                at = centre + steps * side
                if not 0.0 <= at <= most:
                    break
                at_y, at_x = (edge, at) if along_row else (at, edge)
                first_s = travel_s(from_y, from_x, at_y, at_x, found_s - from_s, ground, entry)
                limit_s = found_s - from_s - first_s
                if limit_s <= 0.0:
                    break
                then_s = travel_s(at_y, at_x, y, x, limit_s, ground, entry)
                if then_s >= limit_s:
                    break
                found_s, found, bend_s = from_s + first_s + then_s, at, from_s + first_s
        step *= 0.4
    if found >= 0.0 and found_s < best_s[key] - worth_s:
        best_s[key], sources[key] = found_s, best_s.size + used
        at_y, at_x = (edge, found) if along_row else (found, edge)
        used = add_bend(points, used, at_y, at_x, bend_s, source)
    return used


@kernel
def bend(y, x, key, worth, points, used, labels, ground, lattice, entry):  # type: ignore[no-untyped-def]
    """Improve a node's label: try paths that bend on an edge between the source and the node.

    If the relative gain in time is more than ``worth``, a point is added at the bend. Returns the
    number of points in use.
    """
    best_s, sources, _ = labels
    source = np.int64(sources[key])
    start = place_of(source, points, labels, lattice)
    from_y, from_x, from_s = start
    along_row, edge, place = _bend_edge(start, (y, x), ground, entry)
    if edge < 0.0:
        return used
    step = max(SEARCH_CELLS, SEARCH_SHARE * max(abs(y - from_y), abs(x - from_x)))
    found, worth_s = (edge, along_row, place, step), worth * (best_s[key] - from_s)
    return _add_fastest_bend(
        y, x, key, source, found, worth_s, points, used, labels, ground, lattice, entry
    )


@kernel
def move_bend(y, x, key, since_s, points, used, labels, ground, lattice, entry):  # type: ignore[no-untyped-def]
    """Improve a node's label: try other positions on the edge for the bend that is its source.

    The position of a bend is the best one for the node for which the bend was added. If another one
    is better for this node, a point is added there. Bends that were added before ``since_s``, the
    last weather change, are not moved. Returns the number of points in use.
    """
    best_s, sources, _ = labels
    point = np.int64(sources[key]) - best_s.size
    source = np.int64(points.bend_source[point])
    if source < 0 or place_of(source, points, labels, lattice)[2] < since_s:
        return used
    bend_y, bend_x, bend_s = points.at[point, 0], points.at[point, 1], points.at[point, 2]
    along_row = bend_y == np.floor(bend_y)
    edge, place = (bend_y, bend_x) if along_row else (bend_x, bend_y)
    moved, worth_s = (edge, along_row, place, SEARCH_CELLS), WORTH_A_MOVE * (best_s[key] - bend_s)
    return _add_fastest_bend(
        y, x, key, source, moved, worth_s, points, used, labels, ground, lattice, entry
    )


@inlined
def on_front(point, points):  # type: ignore[no-untyped-def]
    """Return True if a point has other points beside it on a front."""
    return point >= 0 and max(points.beside[point, 0], points.beside[point, 1]) >= 0


@kernel
def slide_on_front(y, x, key, points, used, labels, ground, lattice, entry):  # type: ignore[no-untyped-def]
    """Improve a node's label: move the source along the front at the last weather change.

    If a position between two points is better, a point is added there. Returns the number of points
    in use.
    """
    best_s, sources, _ = labels
    n = best_s.size
    for _ in range(MAX_SLIDES):
        source = np.int64(sources[key])
        if not on_front(source - n, points):
            break
        from_y, from_x, from_s = place_of(source, points, labels, lattice)
        moved = False
        for side in range(2):
            other = points.beside[source - n, side]
            if other < 0:
                continue
            other_y, other_x = points.at[other, 0], points.at[other, 1]
            time, at_y, at_x = from_segment(
                from_y, from_x, other_y, other_x, y, x, BETWEEN_CELLS, ground, entry
            )
            if time == np.inf or (at_y == from_y and at_x == from_x):
                continue
            to_point = at_y == other_y and at_x == other_x
            worth = ROUNDING if to_point else WORTH_A_POINT
            limit_s = (1.0 - worth) * (best_s[key] - from_s)
            path_s = travel_s(at_y, at_x, y, x, limit_s, ground, entry)
            if path_s < limit_s:
                best_s[key] = from_s + path_s
                if to_point:
                    sources[key] = n + other
                    moved = True
                else:
                    sources[key] = n + used
                    used = add_point(points, used, at_y, at_x, from_s, source - n, other)
                break
        if not moved:
            break
    return used


@inlined
def slide(i, j, key, since_s, labels, ground, lattice, entry):  # type: ignore[no-untyped-def]
    """Improve a node's label: try the nodes beside the source as sources."""
    best_s, sources, _ = labels
    now = best_s[key]
    from_i, from_j = ij_of(np.int64(sources[key]), lattice)
    y, x = 0.5 * i, 0.5 * j
    across = abs(j - from_j) > abs(i - from_i)
    for side in range(-1, 2, 2):
        at_i = from_i + (side * lattice.step if across else 0)
        at_j = from_j + (0 if across else side * lattice.step)
        if not (0 <= at_i <= 2 * lattice.rows and 0 <= at_j <= 2 * lattice.cols):
            continue
        if (at_i % 2 == 1 and at_j % 2 == 1) or (at_i == i and at_j == j):
            continue
        other = key_of(at_i, at_j, lattice)
        if not since_s <= best_s[other] < now:
            continue
        limit_s = best_s[key] - best_s[other]
        if limit_s <= 0.0:
            continue
        path_s = travel_s(0.5 * at_i, 0.5 * at_j, y, x, limit_s, ground, entry)
        if path_s < limit_s * (1.0 - ROUNDING):
            best_s[key], sources[key] = best_s[other] + path_s, other


@kernel
def ignite(  # type: ignore[no-untyped-def]
    at_s, row, col, queue, size, waits, paths, points, used, labels, ground, lattice, entry
):
    """Light the centre of a cell: set the labels of the nodes around the centre.

    ``paths`` receives the paths to the nearest nodes. Returns the heap's new size, the number of
    waiting centres and the number of paths.
    """
    best_s, sources, active_row = labels
    n = best_s.size
    y, x = row + 0.5, col + 0.5
    mid_i, mid_j = 2 * row + 1, 2 * col + 1
    active_row[max(mid_i - IGNITES, 0) >> 1 : (mid_i + IGNITES >> 1) + 1] = True
    add_point(points, used, y, x, at_s, -1, -1)
    count = 0
    for i in range(max(mid_i - IGNITES, 0), min(mid_i + IGNITES, 2 * lattice.rows) + 1):
        for j in range(max(mid_j - IGNITES, 0), min(mid_j + IGNITES, 2 * lattice.cols) + 1):
            if lattice.step == 2 and i % 2 != j % 2:
                continue
            target = key_of(i, j, lattice)
            if best_s[target] <= at_s:
                continue
            far = max(abs(i - mid_i), abs(j - mid_j))
            if 0 < far <= ADJOINS:
                count = add_path(paths, count, count, target, y, x, at_s)
            path_s = travel_s(y, x, 0.5 * i, 0.5 * j, best_s[target] - at_s, ground, entry)
            if at_s + path_s < best_s[target] or (far <= ADJOINS and sources[target] < 0):
                if i % 2 == 0 or j % 2 == 0:
                    size = push(queue.times, queue.keys, size, at_s + path_s, target)
                elif sources[target] < 0:
                    queue.waiting[waits] = target
                    waits += 1
                best_s[target], sources[target] = at_s + path_s, n + used
    return size, waits, count


@kernel
def expect_neighbours(expected_s, arrival_s, points, labels, ground, lattice, entry):  # type: ignore[no-untyped-def]
    """Lower the expected times (y, x) of burned cells' neighbours whose centres have no label."""
    for row in range(lattice.rows):
        for col in range(lattice.cols):
            if arrival_s[row, col] == np.inf:
                continue
            source = np.int64(labels.source[key_of(2 * row + 1, 2 * col + 1, lattice)])
            for side in range(8):
                to_row, to_col = row + STEP_ROW[side], col + STEP_COL[side]
                if not (0 <= to_row < lattice.rows and 0 <= to_col < lattice.cols):
                    continue
                key = key_of(2 * to_row + 1, 2 * to_col + 1, lattice)
                if labels.source[key] >= 0 or labels.best_s[key] != np.inf:
                    continue
                y, x, from_s = row + 0.5, col + 0.5, arrival_s[row, col]
                for own in range(2):
                    if own == 1 and source >= 0:
                        y, x, from_s = place_of(source, points, labels, lattice)
                    limit_s = expected_s[to_row, to_col] - from_s
                    path_s = travel_s(y, x, to_row + 0.5, to_col + 0.5, limit_s, ground, entry)
                    expected_s[to_row, to_col] = min(from_s + path_s, expected_s[to_row, to_col])
