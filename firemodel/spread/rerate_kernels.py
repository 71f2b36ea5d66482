"""Restart an any-angle fire when the weather changes.

Each line along which fire is moving is cut at the fire's position. The cuts on the best lines to
neighbouring nodes are the tips; tips that are close together are joined. Fire then spreads from the
whole front (Huygens) and not only from single points; otherwise frequent weather changes would
distort the fire.
"""

import numpy as np

from firemodel.arrays import Floats
from firemodel.compiled import kernel
from firemodel.spread.anyangle_kernels import (
    EDGES,
    OFFSETS,
    WORTH_A_POINT,
    kind_of,
    prepare_around,
    slide_on_front,
    step_s,
)
from firemodel.spread.heap import push
from firemodel.spread.labels import (
    ActivePaths,
    Lattice,
    add_path,
    add_point,
    empty_paths,
    ij_of,
    key_of,
    place_of,
)
from firemodel.spread.travel_time import STEP_COL, STEP_ROW, from_segment, travel, travel_s

NEAR_FRONT = 4  # distance in i and j up to which a point of a front has paths to nodes
WINDOW = 6  # maximum distance in i and j from a node to the segment from which fire reaches it
SEGMENT_CELLS = 1.5  # largest distance between two neighbouring tips that are joined
FARTHER = 1.5  # lines extend to this multiple of the distance to the chord between two tips
PIECES = 4  # number of pieces into which the front between two tips is divided
POINTS_PER_TIP = 2 + 2 * (PIECES - 1)  # maximum; includes one point for the slide of the tip's node
APPROACH = 0.25  # smallest cosine between the paths from two tips and the line that joins them
# Steps to four neighbours on edges, so that each pair of neighbours occurs once.
NEXT_I = np.array([0, 1, 1, 1])
NEXT_J = np.array([1, 0, 1, -1])


def paths_from(front_yx: Floats, at_s: float, best_s: Floats, lattice: Lattice) -> ActivePaths:
    """Return the paths from the points (k, 2) of a front to unreached nodes around each point."""
    keys = np.empty((2 * NEAR_FRONT + 1) ** 2, dtype=np.int64)
    paths = empty_paths(_count_paths_from(front_yx, best_s, lattice, keys))
    _add_paths_from(front_yx, at_s, best_s, lattice, keys, paths)
    return paths


@kernel
def _unreached_around(y, x, best_s, lattice, keys):  # type: ignore[no-untyped-def]
    """Store the keys of the unreached nodes around a point in ``keys``; return their number."""
    nearest_i, nearest_j = int(np.floor(2.0 * y + 0.5)), int(np.floor(2.0 * x + 0.5))
    count = 0
    for i in range(
        max(nearest_i - NEAR_FRONT, 0), min(nearest_i + NEAR_FRONT, 2 * lattice.rows) + 1
    ):
        for j in range(
            max(nearest_j - NEAR_FRONT, 0), min(nearest_j + NEAR_FRONT, 2 * lattice.cols) + 1
        ):
            if lattice.step == 2 and (i - j) & 1:
                continue
            key = key_of(i, j, lattice)
            if best_s[key] == np.inf:
                keys[count] = key
                count += 1
    return count


@kernel
def _count_paths_from(front_yx, best_s, lattice, keys):  # type: ignore[no-untyped-def]
    """Return the number of paths from the points (k, 2) of a front."""
    count = 0
    for point in range(len(front_yx)):
        count += _unreached_around(front_yx[point, 0], front_yx[point, 1], best_s, lattice, keys)
    return count


@kernel
def _add_paths_from(front_yx, at_s, best_s, lattice, keys, paths):  # type: ignore[no-untyped-def]
    """Store the paths from the points (k, 2) of a front in ``paths``."""
    used = 0
    for point in range(len(front_yx)):
        y, x = front_yx[point, 0], front_yx[point, 1]
        for number in range(_unreached_around(y, x, best_s, lattice, keys)):
            paths.target[used] = keys[number]
            paths.at[used, 0], paths.at[used, 1], paths.at[used, 2] = y, x, at_s
            used += 1


@kernel
def _position_at(y, x, to_i, to_j, time_s, ground, entry):  # type: ignore[no-untyped-def]
    """Return the position of fire that has moved from (y, x) towards a node for ``time_s``."""
    to_y, to_x = 0.5 * to_i, 0.5 * to_j
    _, part = travel(y, x, to_y, to_x, time_s, ground, entry)
    return y + part * (to_y - y), x + part * (to_x - x)


@kernel
def active_paths(  # type: ignore[no-untyped-def]
    at_s,
    since_s,
    queue,
    size,
    waits,
    paths,
    points,
    used,
    labels,
    ground,
    lattice,
    entry,
    found,
    tips,
):
    """Find every line along which fire is moving at the given time.

    ``found`` receives the paths from the last weather change that are not yet completed, and the
    paths to neighbours of nodes that were reached since then. ``tips`` receives, for each node next
    to the fire, the position of the fire on the best line to this node. Returns the number of paths
    in ``found`` and in ``tips``, and the number of points in use.
    """
    best_s, sources, _ = labels
    count = tip = 0
    for k in range(paths.target.size):
        target = np.int64(paths.target[k])
        if best_s[target] > at_s:
            to_i, to_j = ij_of(target, lattice)
            lasts_s = at_s - paths.at[k, 2]
            y, x = _position_at(paths.at[k, 0], paths.at[k, 1], to_i, to_j, lasts_s, ground, entry)
            count = add_path(found, count, count, target, y, x, at_s)
    for k in range(size + waits):
        target = np.int64(queue.keys[k] if k < size else queue.waiting[k - size])
        if k < size and best_s[target] != queue.times[k]:
            continue  # replaced by a better entry
        to_i, to_j = ij_of(target, lattice)
        used = slide_on_front(
            0.5 * to_i, 0.5 * to_j, target, points, used, labels, ground, lattice, entry
        )
        y, x, from_s = place_of(sources[target], points, labels, lattice)
        tips.source[tip, 0], tips.source[tip, 1], tips.source[tip, 2] = y, x, from_s
        if from_s < at_s:
            y, x = _position_at(y, x, to_i, to_j, at_s - from_s, ground, entry)
        tips.target[tip] = target
        tips.at[tip, 0], tips.at[tip, 1] = y, x
        tip += 1
        first = count
        kind = kind_of(to_i, to_j, lattice)
        for number in range(EDGES[kind]):
            i, j = to_i + OFFSETS[kind, number, 0], to_j + OFFSETS[kind, number, 1]
            if not (0 <= i <= 2 * lattice.rows and 0 <= j <= 2 * lattice.cols):
                continue
            key = key_of(i, j, lattice)
            if not since_s <= best_s[key] <= at_s:
                continue
            prepare_around(i, j, ground, lattice, entry)
            if step_s(i, j, to_i - i, to_j - j, ground, lattice) == 0.0:
                continue
            for own in range(2):
                source = np.int64(sources[key]) if own == 0 else key
                from_y, from_x, from_s = place_of(source, points, labels, lattice)
                if from_s < since_s:
                    continue
                y, x = _position_at(from_y, from_x, to_i, to_j, at_s - from_s, ground, entry)
                count = add_path(found, count, first, target, y, x, at_s)
    return count, tip, used


@kernel
def _approach(at, tip, other, i, j, other_i, other_j):  # type: ignore[no-untyped-def]
    """Return True if fire moves from each tip towards the other, so that they are on two fronts."""
    tip_y, tip_x, other_y, other_x = at[tip, 0], at[tip, 1], at[other, 0], at[other, 1]
    down, right = other_y - tip_y, other_x - tip_x
    near_y, near_x = 0.5 * i - tip_y, 0.5 * j - tip_x
    far_y, far_x = other_y - 0.5 * other_i, other_x - 0.5 * other_j
    length2 = APPROACH * APPROACH * (down * down + right * right)
    near, far = near_y * down + near_x * right, far_y * down + far_x * right
    return (
        near > 0.0
        and far > 0.0
        and near * near > length2 * (near_y * near_y + near_x * near_x)
        and far * far > length2 * (far_y * far_y + far_x * far_x)
    )


@kernel
def _neighbour_tip(tip, i, j, next_i, next_j, tips, marks, lattice):  # type: ignore[no-untyped-def]
    """Return the tip at node (next_i, next_j) if it is on the front of the tip at (i, j), else -1.

    ``marks`` contains -2 - k at the key of tip k. Tips that approach each other are on different
    fronts.
    """
    if not (0 <= next_i <= 2 * lattice.rows and 0 <= next_j <= 2 * lattice.cols):
        return -1
    if next_i % 2 == 1 and next_j % 2 == 1:
        return -1
    other = -2 - marks[key_of(next_i, next_j, lattice)]
    if other < 0 or _approach(tips.at, tip, other, i, j, next_i, next_j):
        return -1
    return other


@kernel
def _join_tips(tips, marks, joined, lattice):  # type: ignore[no-untyped-def]
    """Store the neighbours of each tip on the front, one for each step of ``NEXT_I``; -1 for none.

    Neighbours that are farther apart than ``SEGMENT_CELLS`` are left out.
    """
    step = lattice.step
    for k in range(tips.target.size):
        i, j = ij_of(np.int64(tips.target[k]), lattice)
        for side in range(4):
            joined[k, side] = -1
            if i % 2 == 1 and j % 2 == 1:
                continue
            next_i, next_j = i + step * NEXT_I[side], j + step * NEXT_J[side]
            other = _neighbour_tip(k, i, j, next_i, next_j, tips, marks, lattice)
            if other >= 0:
                down, right = tips.at[k, 0] - tips.at[other, 0], tips.at[other, 1] - tips.at[k, 1]
                if down * down + right * right <= SEGMENT_CELLS * SEGMENT_CELLS:
                    joined[k, side] = other


@kernel
def _along_front(to_i, to_j, tips, joined, marks, ground, lattice, entry):  # type: ignore[no-untyped-def]
    """Return the tip next to the point of the front from which fire first reaches a node, or -1.

    ``joined`` (tips, 4) is the result of ``_join_tips``.
    """
    step = lattice.step
    best, found = np.inf, -1
    low_i, low_j = max(to_i - WINDOW, 0), max(to_j - WINDOW, 0)
    if step == 2:
        low_i, low_j = low_i + low_i % 2, low_j + low_j % 2
    for i in range(low_i, min(to_i + WINDOW, 2 * lattice.rows) + 1, step):
        for j in range(low_j, min(to_j + WINDOW, 2 * lattice.cols) + 1, step):
            if i % 2 == 1 and j % 2 == 1:
                continue
            tip = -2 - marks[key_of(i, j, lattice)]
            if tip < 0:
                continue
            for side in range(4):
                other = joined[tip, side]
                if other < 0:
                    continue
                time, y, x = from_segment(
                    tips.at[tip, 0],
                    tips.at[tip, 1],
                    tips.at[other, 0],
                    tips.at[other, 1],
                    0.5 * to_i,
                    0.5 * to_j,
                    SEGMENT_CELLS,
                    ground,
                    entry,
                )
                if time < best:
                    to_tip = abs(y - tips.at[tip, 0]) + abs(x - tips.at[tip, 1])
                    to_other = abs(y - tips.at[other, 0]) + abs(x - tips.at[other, 1])
                    best, found = time, (tip if to_tip <= to_other else other)
    return found


@kernel
def _beside(k, tips, marks, lattice):  # type: ignore[no-untyped-def]
    """Return the next tips along the front on either side of the path from tip k; -1 for none."""
    i, j = ij_of(np.int64(tips.target[k]), lattice)
    left = right = -1
    left_2 = right_2 = SEGMENT_CELLS * SEGMENT_CELLS
    if i % 2 == 1 and j % 2 == 1:
        return left, right
    to_y, to_x = 0.5 * i - tips.at[k, 0], 0.5 * j - tips.at[k, 1]
    for number in range(8):
        next_i, next_j = i + lattice.step * STEP_ROW[number], j + lattice.step * STEP_COL[number]
        other = _neighbour_tip(k, i, j, next_i, next_j, tips, marks, lattice)
        if other < 0:
            continue
        down, across = tips.at[other, 0] - tips.at[k, 0], tips.at[other, 1] - tips.at[k, 1]
        distance_2, side = down * down + across * across, to_y * across - to_x * down
        if side > 0.0 and distance_2 < left_2:
            left, left_2 = other, distance_2
        elif side < 0.0 and distance_2 < right_2:
            right, right_2 = other, distance_2
    return left, right


@kernel
def _divide(k, other, side, at_s, first, tips, points, used, ground, lattice, entry):  # type: ignore[no-untyped-def]
    """Add points on the front between tips k and ``other``, which is on ``side`` of tip k.

    Each point is on a line from a position between the sources of the two tips, so that the points
    lie on the curved front and not on its chord. Returns the number of points in use.
    """
    before = first + k
    for number in range(1, PIECES):
        share = number / PIECES
        from_y = tips.source[k, 0] + share * (tips.source[other, 0] - tips.source[k, 0])
        from_x = tips.source[k, 1] + share * (tips.source[other, 1] - tips.source[k, 1])
        from_s = tips.source[k, 2] + share * (tips.source[other, 2] - tips.source[k, 2])
        y = tips.at[k, 0] + share * (tips.at[other, 0] - tips.at[k, 0])
        x = tips.at[k, 1] + share * (tips.at[other, 1] - tips.at[k, 1])
        far_y, far_x = from_y + FARTHER * (y - from_y), from_x + FARTHER * (x - from_x)
        if 0.0 <= far_y <= lattice.rows and 0.0 <= far_x <= lattice.cols:
            _, part = travel(from_y, from_x, far_y, far_x, at_s - from_s, ground, entry)
            if part * FARTHER > 1.0:
                y, x = from_y + part * (far_y - from_y), from_x + part * (far_x - from_x)
        points.beside[before, side if number == 1 else 1] = used
        before = used
        used = add_point(points, used, y, x, at_s, used - 1 if number > 1 else first + k, -1)
    points.beside[before, 1] = first + other
    for back in range(2):
        if points.beside[first + other, back] == first + k:
            points.beside[first + other, back] = before
    return used


@kernel
def _known_tips(paths, tips, marks, best, ground, lattice, entry):  # type: ignore[no-untyped-def]
    """Set each unknown tip to the start of the fastest path to its node.

    ``best`` (tips) is a work array.
    """
    for k in range(tips.target.size):
        best[k] = np.inf if tips.at[k, 0] != tips.at[k, 0] else -np.inf
    for k in range(paths.target.size):
        tip = -2 - marks[paths.target[k]]
        if best[tip] == -np.inf:
            continue
        to_i, to_j = ij_of(np.int64(paths.target[k]), lattice)
        y, x = paths.at[k, 0], paths.at[k, 1]
        path_s = travel_s(y, x, 0.5 * to_i, 0.5 * to_j, best[tip], ground, entry)
        if path_s < best[tip] or tips.at[tip, 0] != tips.at[tip, 0]:
            best[tip], tips.at[tip, 0], tips.at[tip, 1] = path_s, y, x


@kernel
def front_of(at_s, paths, tips, best, points, used, labels, ground, lattice, entry):  # type: ignore[no-untyped-def]
    """Store the front as points with ``beside``: first the tips, then the points between tips.

    ``labels.source`` of the node of tip k becomes -2 - k. ``best`` (tips) is a work array. Returns
    the number of points in use.
    """
    first, marks = used, labels.source
    for k in range(tips.target.size):
        marks[tips.target[k]] = -2 - k
    _known_tips(paths, tips, marks, best, ground, lattice, entry)
    for k in range(tips.target.size):
        left, right = _beside(k, tips, marks, lattice)
        left, right = (first + left if left >= 0 else -1), (first + right if right >= 0 else -1)
        used = add_point(points, used, tips.at[k, 0], tips.at[k, 1], at_s, left, right)
    for k in range(tips.target.size):
        for side in range(2):
            other = points.beside[first + k, side] - first
            is_tip = 0 <= other < tips.target.size
            if is_tip and tips.source[k, 2] + tips.source[other, 2] < np.inf:
                used = _divide(
                    k, other, side, at_s, first, tips, points, used, ground, lattice, entry
                )
    return used


@kernel
def start_paths(  # type: ignore[no-untyped-def]
    at_s, paths, tips, first, best, joined, queue, points, used, labels, ground, lattice, entry
):
    """Restart the fire from paths and tips: set the labels and the queue.

    The tips are the points from ``first`` on (``front_of``). ``best`` (tips) and ``joined`` (tips,
    4) are work arrays.
    Returns the number of points in use, the heap's size and the number of waiting centres.
    """
    best_s, sources, active_row = labels
    n, count = sources.size, tips.target.size
    _join_tips(tips, sources, joined, lattice)
    for k in range(count):
        target = np.int64(tips.target[k])
        to_i, to_j = ij_of(target, lattice)
        active_row[to_i >> 1] = True
        best_s[target], best[k] = np.inf, first + k
        for candidate in (
            k,
            _along_front(to_i, to_j, tips, joined, sources, ground, lattice, entry),
        ):
            if candidate >= 0:
                y, x, limit_s = tips.at[candidate, 0], tips.at[candidate, 1], best_s[target] - at_s
                path_s = travel_s(y, x, 0.5 * to_i, 0.5 * to_j, limit_s, ground, entry)
                if path_s < limit_s:
                    best_s[target], best[k] = at_s + path_s, first + candidate
    for k in range(count):
        key = np.int64(tips.target[k])
        sources[key] = n + np.int64(best[k])
        i, j = ij_of(key, lattice)
        used = slide_on_front(0.5 * i, 0.5 * j, key, points, used, labels, ground, lattice, entry)
    for k in range(paths.target.size):
        target = np.int64(paths.target[k])
        to_i, to_j = ij_of(target, lattice)
        limit_s = (1.0 - WORTH_A_POINT) * (best_s[target] - at_s)
        y, x = paths.at[k, 0], paths.at[k, 1]
        path_s = travel_s(y, x, 0.5 * to_i, 0.5 * to_j, limit_s, ground, entry)
        if path_s < limit_s:
            best_s[target], sources[target] = at_s + path_s, n + used
            used = add_point(points, used, y, x, at_s, -1, -1)
    size = waits = 0
    for k in range(count):
        key = np.int64(tips.target[k])
        i, j = ij_of(key, lattice)
        if i % 2 == 1 and j % 2 == 1:
            queue.waiting[waits] = key
            waits += 1
        else:
            size = push(queue.times, queue.keys, size, best_s[key], key)
    return used, size, waits
