"""Compiled parts of ``coverage``: the weight inside a circle, and paths around the fire.

Lengths are in cells. A position is a row and a column, as floats; cell centres have integer values.
A box is (top, bottom, left, right) and excludes row ``bottom`` and column ``right``. The lattice
has a node at each cell whose row and column are multiples of ``stride``. Node (i, j) has the index
``i * wide + j``.

Indices in inner loops are unsigned, because signed indices require a test for negative values.
"""

import math

import numpy as np

from firemodel.compiled import kernel

NEAR, FAR = 5, 1  # weights of cells in fifths (section 3.4)
RINGS = 8  # radius, in strides, of the search for the first free node
PER_CELL = 4  # samples of a straight line, per cell
NO_PATH = math.inf
CROSSING = 9.0  # additional path length for each cell inside the augmentation
# Maximum cost of another agent within the spacing, and additional maximum cost within CROWD_M.
NEIGHBOUR, CROWD = 800.0, 5000.0
TOUCHING = 50.0  # cost of a position within the margin of the augmented fire


@kernel
def extent(fire):  # type: ignore[no-untyped-def]
    """Return the smallest box that contains all fire; the box is empty without fire."""
    rows, cols = fire.shape
    top, bottom, left, right = rows, 0, cols, 0
    for r in range(rows):
        some = False
        for c in range(cols):
            some |= fire[r, c]
        if some:
            top, bottom = min(top, r), r + 1
            first = 0
            while not fire[r, first]:
                first += 1
            last = cols
            while not fire[r, last - 1]:
                last -= 1
            left, right = min(left, first), max(right, last)
    return top, bottom, left, right


@kernel
def wider(box, by, shape):  # type: ignore[no-untyped-def]
    """Return a box extended by ``by`` cells on each side, but not beyond the map."""
    return (
        max(box[0] - by, 0),
        min(box[1] + by, shape[0]),
        max(box[2] - by, 0),
        min(box[3] + by, shape[1]),
    )


@kernel
def sum_left_over(fire, augmentation, monitored, others_row, others_col, radius, box, sums):  # type: ignore[no-untyped-def]
    """Fill ``sums`` (rows, cols + 1) in the box: cumulative uncovered weights along each row."""
    top, bottom, left, right = box
    for r in range(top, bottom):
        for c in range(left, right):
            row, col = np.uint64(r), np.uint64(c)
            weight = NEAR if augmentation[row, col] != 0 else FAR
            if monitored[row, col] == 0 or fire[row, col]:
                weight = 0
            sums[row, np.uint64(c + 1)] = weight
    for k in range(others_row.size):
        row_k, col_k = others_row[k], others_col[k]
        for r in range(
            max(math.ceil(row_k - radius), top), min(math.floor(row_k + radius) + 1, bottom)
        ):
            half = math.sqrt(max(radius * radius - (r - row_k) ** 2, 0.0))
            for c in range(
                max(math.ceil(col_k - half), left), min(math.floor(col_k + half) + 1, right)
            ):
                sums[np.uint64(r), np.uint64(c + 1)] = 0
    for r in range(top, bottom):
        total = 0
        sums[r, left] = 0
        for c in range(left, right):
            total += sums[np.uint64(r), np.uint64(c + 1)]
            sums[np.uint64(r), np.uint64(c + 1)] = total


@kernel
def weight_within(row, col, half_widths, box, sums):  # type: ignore[no-untyped-def]
    """Return the weight inside a circle; ``sums`` is filled by ``sum_left_over``.

    ``half_widths`` holds the circle's half width in each row.
    """
    top, bottom, left, right = box
    reach = half_widths.size // 2
    total = 0
    for r in range(max(row - reach, top), min(row + reach + 1, bottom)):
        half = half_widths[np.uint64(r - row + reach)]
        first, end = max(col - half, left), min(col + half + 1, right)
        if first < end:
            total += sums[np.uint64(r), np.uint64(end)] - sums[np.uint64(r), np.uint64(first)]
    return total


@kernel
def crowding(row, col, others_row, others_col, spacing, neighbour, crowd_at, crowd):  # type: ignore[no-untyped-def]
    """Return the cost of other agents nearby.

    Each agent within ``spacing`` costs up to ``neighbour``, and within ``crowd_at`` also up to
    ``crowd``.
    """
    total = 0.0
    for k in range(others_row.size):
        away = math.hypot(row - others_row[k], col - others_col[k])
        if away < spacing:
            total += neighbour * (1.0 - away / spacing) ** 2
        if away < crowd_at:
            total += crowd * (1.0 - away / crowd_at)
    return total


@kernel
def is_free(row, col, augmentation, margin):  # type: ignore[no-untyped-def]
    """Return whether a cell is on the map and ``margin`` cells or more outside the augmentation."""
    rows, cols = augmentation.shape
    if not (0 <= row < rows and 0 <= col < cols) or augmentation[row, col] != 0:
        return False
    if margin > 0:
        slant = math.ceil(margin * 0.7)
        for down in range(-1, 2):
            for right in range(-1, 2):
                step = slant if down != 0 and right != 0 else margin
                r = min(max(row + step * down, 0), rows - 1)
                c = min(max(col + step * right, 0), cols - 1)
                if augmentation[r, c] != 0:
                    return False
    return True


@kernel
def leg(row, col, to_row, to_col, augmentation, crossing):  # type: ignore[no-untyped-def]
    """Return the length of the straight line between two positions.

    The part of the line inside the augmentation counts ``1 + crossing`` times. If ``crossing`` is
    ``NO_PATH``, the result is ``NO_PATH`` for a line that enters the augmentation or leaves the
    map.
    """
    steps = math.ceil(PER_CELL * max(abs(to_row - row), abs(to_col - col)))
    inside = 0
    for k in range(steps + 1):
        share = k / max(steps, 1)
        r = math.floor(row + share * (to_row - row) + 0.5)
        c = math.floor(col + share * (to_col - col) + 0.5)
        if not is_free(r, c, augmentation, 0):
            if crossing == NO_PATH:
                return NO_PATH
            inside += 1
    length = math.hypot(to_row - row, to_col - col)
    return length * (1.0 + crossing * inside / (steps + 1)) if inside else length


@kernel
def find_paths(  # type: ignore[no-untyped-def]
    row, col, augmentation, box, stride, crossing, distances, previous, queue, queued
):
    """Fill ``distances`` with the length of the path from (row, col) to each node in the box.

    The length is ``NO_PATH`` if there is no path; see ``leg`` for ``crossing``. A path begins with
    a straight leg from (row, col) to a first node. The first nodes are the nearest nodes to which
    such a leg exists. If (row, col) is inside the augmentation, and crossings are not allowed, the
    first nodes are the nearest free nodes. ``previous`` is filled with the preceding node on the
    path, or -1 for a first node. ``queue`` and ``queued`` are work arrays with one entry per node.
    Returns whether there is a first node.
    """
    wide = (augmentation.shape[1] - 1) // stride + 1
    i_top, i_end = (box[0] + stride - 1) // stride, (box[1] - 1) // stride + 1
    j_left, j_end = (box[2] + stride - 1) // stride, (box[3] - 1) // stride + 1
    for i in range(i_top, i_end):
        for j in range(j_left, j_end):
            distances[i * wide + j], queued[i * wide + j] = NO_PATH, False
    first, count = 0, 0
    leaves = crossing == NO_PATH and not is_free(
        math.floor(row + 0.5), math.floor(col + 0.5), augmentation, 0
    )
    i0, j0 = math.floor(row / stride), math.floor(col / stride)
    for ring in range(RINGS):
        for i in range(max(i0 - ring, i_top), min(i0 + 2 + ring, i_end)):
            for j in range(max(j0 - ring, j_left), min(j0 + 2 + ring, j_end)):
                r, c = i * stride, j * stride
                length = leg(row, col, r, c, augmentation, crossing)
                if leaves and is_free(r, c, augmentation, 0):
                    length = math.hypot(r - row, c - col)
                if length < NO_PATH:
                    node = i * wide + j
                    distances[node], previous[node] = length, -1
                    queue[count], queued[node] = node, True
                    count += 1
        if count:
            break
    found = count > 0
    while count:
        node = queue[np.uint64(first)]
        first = (first + 1) % queue.size
        count -= 1
        queued[np.uint64(node)] = False
        i, j = node // wide, node % wide
        for a in range(max(i - 1, i_top), min(i + 2, i_end)):
            for b in range(max(j - 1, j_left), min(j + 2, j_end)):
                other = np.uint64(a * wide + b)
                so_far = distances[np.uint64(node)]
                if so_far + math.hypot(a - i, b - j) * stride >= distances[other] - 1e-9:
                    continue
                longer = so_far + leg(
                    i * stride, j * stride, a * stride, b * stride, augmentation, crossing
                )
                if longer < distances[other] - 1e-9:
                    distances[other], previous[other] = longer, node
                    if not queued[other]:
                        queue[np.uint64((first + count) % queue.size)] = other
                        queued[other] = True
                        count += 1
    return found


@kernel
def node_next_to(row, col, stride, box, wide, distances):  # type: ignore[no-untyped-def]
    """Return the last node on the shortest path to a cell, and the length of this path.

    The node is -1 if no path leads to the cell.
    """
    best, best_node = NO_PATH, -1
    for i in range(row // stride, row // stride + 2):
        for j in range(col // stride, col // stride + 2):
            r, c = i * stride, j * stride
            if box[0] <= r < box[1] and box[2] <= c < box[3]:
                length = distances[i * wide + j] + math.hypot(r - row, c - col)
                if length < best:
                    best, best_node = length, i * wide + j
    return best_node, best


@kernel
def first_leg(row, col, augmentation, box, stride, crossing, distances, previous, found):  # type: ignore[no-untyped-def]
    """Set ``found[2:]`` to the last node of the path that one straight leg can reach.

    The path leads to the position ``found[:2]``. The straight leg must be as short as the path to
    the node. ``find_paths`` must be called first. Returns whether a path exists.
    """
    wide = (augmentation.shape[1] - 1) // stride + 1
    goal_row, goal_col = math.floor(found[0] + 0.5), math.floor(found[1] + 0.5)
    node, _ = node_next_to(goal_row, goal_col, stride, box, wide, distances)
    if node < 0:
        return False
    while True:
        found[2], found[3] = node // wide * stride, node % wide * stride
        straight = leg(row, col, found[2], found[3], augmentation, crossing)
        if previous[node] < 0 or straight <= distances[node] + 1e-9:
            return True
        node = previous[node]


@kernel
def find_goal(  # type: ignore[no-untyped-def]
    row, col, goal_row, goal_col, others_row, others_col,
    fire, augmentation, monitored, area, worth, path_cost, margin, radius, monitored_reach,
    area_reach, spacing, crowd_at, stride, half_widths, sums, distances, previous, queue, queued,
    found,
):  # fmt: skip
    """Fill ``found`` (4) with the goal and the via point of ``coverage.next_goal``, in cells.

    The path to the goal leads around the augmentation, or across the augmentation if there is no
    other path. Returns whether there is a goal.
    """
    burning = extent(fire)
    box = wider(burning, monitored_reach, fire.shape)
    sum_left_over(fire, augmentation, monitored, others_row, others_col, radius, box, sums)
    scene = (
        augmentation, margin, half_widths, box, sums, others_row, others_col, spacing, crowd_at
    )  # fmt: skip
    # The current goal, unless fire has reached this goal, and the best position near the goal.
    found[0], found[1] = goal_row, goal_col
    r, c = math.floor(goal_row + 0.5), math.floor(goal_col + 0.5)
    threshold, best = -math.inf, -math.inf
    if is_free(r, c, augmentation, 0):
        threshold = worth + value(r, c, scene) - path_cost * math.hypot(r - row, c - col)
        near_row, near_col = climb(r, c, stride, area, scene)
        distance = math.hypot(near_row - row, near_col - col)
        best = value(near_row, near_col, scene) - path_cost * distance
        if best > threshold:
            found[0], found[1] = near_row, near_col
    # The best node of the lattice, and the best position near this node.
    field = wider(burning, area_reach, fire.shape)
    on_lattice, node_row, node_col = -math.inf, -1, -1
    for r in range((field[0] + stride - 1) // stride * stride, field[1], stride):
        for c in range((field[2] + stride - 1) // stride * stride, field[3], stride):
            if area[r, c] != 0 and augmentation[r, c] == 0:
                new = value(r, c, scene) - path_cost * math.hypot(r - row, c - col)
                if new > on_lattice:
                    on_lattice, node_row, node_col = new, r, c
    if node_row >= 0:
        r, c = climb(node_row, node_col, stride, area, scene)
        new = value(r, c, scene) - path_cost * math.hypot(r - row, c - col)
        if new > max(best, threshold):
            found[0], found[1] = r, c
    elif threshold == -math.inf:
        return False
    found[2], found[3] = found[0], found[1]
    if leg(row, col, found[0], found[1], augmentation, NO_PATH) < NO_PATH:
        return True
    reach = RINGS * stride
    field = (
        max(min(field[0], int(row) - reach), 0),
        min(max(field[1], int(row) + reach), fire.shape[0]),
        max(min(field[2], int(col) - reach), 0),
        min(max(field[3], int(col) + reach), fire.shape[1]),
    )
    for crossing in (NO_PATH, CROSSING):
        nodes = (augmentation, field, stride, crossing, distances, previous)
        if find_paths(row, col, *nodes, queue, queued) and first_leg(row, col, *nodes, found):
            return True
    return False


@kernel
def value(row, col, scene):  # type: ignore[no-untyped-def]
    """Return the gain of an agent at a free cell, minus the costs of the position."""
    augmentation, margin, half_widths, box, sums, others_row, others_col, spacing, crowd_at = scene
    gain = weight_within(row, col, half_widths, box, sums) - crowding(
        row, col, others_row, others_col, spacing, NEIGHBOUR, crowd_at, CROWD
    )
    return gain if is_free(row, col, augmentation, margin) else gain - TOUCHING


@kernel
def climb(row, col, step, area, scene):  # type: ignore[no-untyped-def]
    """Return the best cell of the area near a cell, by hill climbing with decreasing steps."""
    augmentation = scene[0]
    best = value(row, col, scene)
    while step > 1:
        step = (step + 1) // 2
        gained = True
        while gained:
            gained = False
            for side in range(9):
                r, c = row + step * (side // 3 - 1), col + step * (side % 3 - 1)
                if is_free(r, c, augmentation, 0) and area[r, c] != 0:
                    new = value(r, c, scene)
                    if new > best + 1e-9:
                        best, next_row, next_col, gained = new, r, c, True
            if gained:
                row, col = next_row, next_col
    return row, col
