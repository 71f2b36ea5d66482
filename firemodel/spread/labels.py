"""Store the arrival times and sources of the any-angle scheme's nodes.

A node is a corner of a cell, the centre of a cell or, in the precise variant, an edge midpoint.
Positions are (y, x) in cells from the north-west corner of the grid, so that corners have integer
coordinates. A node's place in the lattice is (i, j) = (2 y, 2 x): both are even at a corner, both
odd at a centre. Fire passes through corners and edges; centres only receive arrival times.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.compiled import kernel

BESIDE_ROWS = 2  # maximum number of cell rows between a node and the nodes that it reaches


class Lattice(NamedTuple):
    """The numbering of the nodes by keys, cell by cell, so that neighbours are close in memory.

    The keys of a cell are those of its north-west corner, of the midpoints of its north and west
    edges (only with edge midpoints), and of its centre, in this order. The keys include one row and
    one column of cells beyond the grid.
    """

    step: int  # spacing in i and j of the nodes on edges: 2 with corners alone, 1 with midpoints
    rows: int  # number of cell rows
    cols: int
    each: int  # number of keys for each cell: 2 or 4


class Labels(NamedTuple):
    """The arrival time and the source of fire at each node."""

    best_s: Floats  # (keys) earliest arrival found so far; minus infinity if never reached
    source: NDArray[np.int32]  # (keys) a node's key, or keys + index of a point; -1: unknown
    # (rows + 1) of cells: True if a node was processed or a path was started in the row since the
    # fire was created or copied. Other nodes are changed only within ``BESIDE_ROWS`` of such rows.
    active_row: NDArray[np.bool_]


class Points(NamedTuple):
    """Sources that are not nodes: lit points, bends, and the front at a weather change."""

    at: Floats  # (k, 3) position and time: y, x, s
    beside: NDArray[np.int32]  # (k, 2) the next points on both sides along the front; -1 for none
    # (k) for a bend, the source of the line that leads to it: a key, or keys + index; -1: no bend
    bend_source: NDArray[np.int32]

    def first(self, count: int) -> "Points":
        """Return views of the first ``count`` points."""
        return Points(self.at[:count], self.beside[:count], self.bend_source[:count])


class Queue(NamedTuple):
    """The nodes that fire reaches next: nodes on edges in a heap (``heap``), centres in a list."""

    times: Floats
    keys: NDArray[np.int32]
    waiting: NDArray[np.int32]  # keys of the centres that have a label and have not burned


class ActivePaths(NamedTuple):
    """Lines along which fire was moving at the last weather change, and lines from lit cells."""

    target: NDArray[np.int32]  # (k) key of the node at the end of the line
    at: Floats  # (k, 3) position of the fire: y, x, time

    def first(self, count: int) -> "ActivePaths":
        """Return a copy of the first ``count`` paths."""
        return ActivePaths(self.target[:count].copy(), self.at[:count].copy())


class Tips(NamedTuple):
    """The position of fire on the fastest line to each node next to the fire."""

    target: NDArray[np.int32]  # (k) key of the node
    at: Floats  # (k, 2) position: y, x; NaN if not known
    source: Floats  # (k, 3) position and time of the line's source: y, x, s; NaN if not known

    def first(self, count: int) -> "Tips":
        """Return views of the first ``count`` tips."""
        return Tips(self.target[:count], self.at[:count], self.source[:count])


def lattice_of(shape: tuple[int, int], precise: bool) -> Lattice:
    """Return the lattice of a grid with ``shape`` (rows, columns)."""
    rows, cols = shape
    return Lattice(1, rows, cols, 4) if precise else Lattice(2, rows, cols, 2)


def by_cells(values: NDArray[Any], lattice: Lattice) -> NDArray[Any]:
    """Return the view (rows + 1, columns + 1, each) of values (keys)."""
    return values.reshape(lattice.rows + 1, lattice.cols + 1, lattice.each)


def at_centres(values: NDArray[Any], lattice: Lattice) -> NDArray[Any]:
    """Return the view (y, x) of values (keys) at the cells' centres."""
    return by_cells(values, lattice)[:-1, :-1, -1]


def empty_labels(burnable: NDArray[np.bool_], lattice: Lattice) -> Labels:
    """Return the labels before any fire for the mask (y, x) of the cells that can burn.

    Fire cannot pass a corner at which two unburnable cells touch diagonally. Such a corner, and a
    node that adjoins no burnable cell, are never reached.
    """
    count = (lattice.rows + 1) * (lattice.cols + 1) * lattice.each
    labels = Labels(
        np.full(count, np.inf),
        np.full(count, -1, dtype=np.int32),
        np.zeros(lattice.rows + 1, dtype=bool),
    )
    best_s = by_cells(labels.best_s, lattice)
    padded = np.pad(burnable, 1)
    nw, ne, sw, se = padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]
    diagonal = (nw & se & ~ne & ~sw) | (~nw & ~se & ne & sw)
    best_s[~(nw | ne | sw | se) | diagonal, 0] = -np.inf
    best_s[~se, -1] = -np.inf
    if lattice.each == 4:
        best_s[~(ne | se), 1] = -np.inf
        best_s[~(sw | se), 2] = -np.inf
    return labels


def settle(
    labels: Labels, arrival_s: Floats, burnable: NDArray[np.bool_], lattice: Lattice
) -> None:
    """Set the labels of an initial fire from the arrival times (y, x) of its burned cells.

    A node on an edge has burned if all burnable cells beside it have burned; the time of its label
    is the latest of their arrival times.
    """
    last_s = np.pad(np.where(burnable, arrival_s, -np.inf), 1, constant_values=-np.inf)
    nw, ne, sw, se = last_s[:-1, :-1], last_s[:-1, 1:], last_s[1:, :-1], last_s[1:, 1:]
    slots = [(0, np.maximum(np.maximum(nw, ne), np.maximum(sw, se))), (-1, se)]
    if lattice.each == 4:
        slots += [(1, np.maximum(ne, se)), (2, np.maximum(sw, se))]
    for slot, time_s in slots:
        view = by_cells(labels.best_s, lattice)[..., slot]
        reached = (view == np.inf) & np.isfinite(time_s)
        view[reached] = time_s[reached]


def nodes_beside(cells: NDArray[np.bool_], lattice: Lattice) -> NDArray[np.bool_]:
    """Return the mask (keys) of the nodes in or beside the cells of a mask (y, x)."""
    found = np.zeros((lattice.rows + 1) * (lattice.cols + 1) * lattice.each, dtype=bool)
    padded = np.pad(cells, 1)
    nw, ne, sw, se = padded[:-1, :-1], padded[:-1, 1:], padded[1:, :-1], padded[1:, 1:]
    slots = by_cells(found, lattice)
    slots[..., 0], slots[..., -1] = nw | ne | sw | se, se
    if lattice.each == 4:
        slots[..., 1], slots[..., 2] = ne | se, sw | se
    return found


def replace_labels(
    labels: Labels,
    nodes: NDArray[np.bool_],
    arrival_s: Floats,
    burnable: NDArray[np.bool_],
    lattice: Lattice,
) -> None:
    """Set the labels of some nodes (mask of the keys) from arrival times (y, x); see ``settle``."""
    new = empty_labels(burnable, lattice)
    settle(new, arrival_s, burnable, lattice)
    labels.best_s[nodes], labels.source[nodes] = new.best_s[nodes], new.source[nodes]
    labels.active_row[:] = True


def tips_with(tips: Tips, chosen: NDArray[np.bool_], paths: ActivePaths, labels: Labels) -> Tips:
    """Return the tips selected by ``chosen``; those of all other nodes with paths are unknown.

    The kernels require a tip for each path, even if the path does not reach its node.
    """
    without = np.zeros(labels.source.size, dtype=bool)
    without[paths.target], without[tips.target[chosen]] = True, False
    further = np.flatnonzero(without).astype(tips.target.dtype)
    new = empty_tips(further.size)
    return Tips(
        np.concatenate([tips.target[chosen], further]),
        np.concatenate([tips.at[chosen], new.at]),
        np.concatenate([tips.source[chosen], new.source]),
    )


@kernel
def rewind(labels, arrival_s, model, model_arrival_s, lattice):  # type: ignore[no-untyped-def]
    """Reset changed copies to the labels ``model`` and their arrival times (y, x).

    Only rows in which nodes may have changed are copied.
    """
    each = lattice.each * (lattice.cols + 1)
    for row in range(lattice.rows + 1):
        first, end = max(row - BESIDE_ROWS, 0), min(row + BESIDE_ROWS, lattice.rows) + 1
        changed = False
        for near in range(first, end):
            changed |= labels.active_row[near]
        if not changed:
            continue
        for key in range(row * each, (row + 1) * each):
            labels.best_s[key], labels.source[key] = model.best_s[key], model.source[key]
        if row < lattice.rows:
            for col in range(lattice.cols):
                arrival_s[row, col] = model_arrival_s[row, col]
    labels.active_row[:] = False


def keys_of(i: NDArray[np.int64], j: NDArray[np.int64], lattice: Lattice) -> NDArray[np.int64]:
    """Return the keys of the nodes at places (i, j), given as arrays; see ``key_of``."""
    slot = i % 2 if lattice.each == 2 else 2 * (i % 2) + j % 2
    return lattice.each * ((i // 2) * (lattice.cols + 1) + j // 2) + slot


def empty_points(room: int) -> Points:
    """Return uninitialised arrays for ``room`` points."""
    return Points(
        np.empty((room, 3)), np.empty((room, 2), dtype=np.int32), np.empty(room, dtype=np.int32)
    )


def empty_paths(room: int) -> ActivePaths:
    """Return uninitialised arrays for ``room`` paths."""
    return ActivePaths(np.empty(room, dtype=np.int32), np.empty((room, 3)))


def empty_tips(room: int) -> Tips:
    """Return arrays for ``room`` tips with unknown positions."""
    target = np.empty(room, dtype=np.int32)
    return Tips(target, np.full((room, 2), np.nan), np.full((room, 3), np.nan))


@kernel
def key_of(i, j, lattice):  # type: ignore[no-untyped-def]
    """Return the key of the node at (i, j)."""
    cell = (i >> 1) * (lattice.cols + 1) + (j >> 1)
    return 2 * cell + (i & 1) if lattice.each == 2 else 4 * cell + 2 * (i & 1) + (j & 1)


@kernel
def ij_of(key, lattice):  # type: ignore[no-untyped-def]
    """Return the place (i, j) of a node."""
    cell = key >> 1 if lattice.each == 2 else key >> 2
    row = cell // (lattice.cols + 1)
    col = cell - row * (lattice.cols + 1)
    if lattice.each == 2:
        return 2 * row + (key & 1), 2 * col + (key & 1)
    return 2 * row + ((key >> 1) & 1), 2 * col + (key & 1)


@kernel
def place_of(source, points, labels, lattice):  # type: ignore[no-untyped-def]
    """Return the position (y, x) and the time of a source."""
    n = labels.source.size
    if source < n:
        i, j = ij_of(source, lattice)
        return 0.5 * i, 0.5 * j, labels.best_s[source]
    return points.at[source - n, 0], points.at[source - n, 1], points.at[source - n, 2]


@kernel
def add_point(points, used, y, x, at_s, left, right):  # type: ignore[no-untyped-def]
    """Store a point in row ``used`` and return the number of points in use."""
    points.at[used, 0], points.at[used, 1], points.at[used, 2] = y, x, at_s
    points.beside[used, 0], points.beside[used, 1] = left, right
    points.bend_source[used] = -1
    return used + 1


@kernel
def add_bend(points, used, y, x, at_s, source):  # type: ignore[no-untyped-def]
    """Store a bend in the line from ``source``; return the number of points in use."""
    add_point(points, used, y, x, at_s, -1, -1)
    points.bend_source[used] = source
    return used + 1


@kernel
def add_path(paths, count, first, target, y, x, at_s):  # type: ignore[no-untyped-def]
    """Store a path unless one of the paths from ``first`` on starts at the same position.

    Returns the number of paths.
    """
    for other in range(first, count):
        if paths.at[other, 0] == y and paths.at[other, 1] == x:
            return count
    paths.target[count] = target
    paths.at[count, 0], paths.at[count, 1], paths.at[count, 2] = y, x, at_s
    return count + 1


@kernel
def paths_to_centres(found, arrival_s, top, left, cell_m, points, labels, lattice):  # type: ignore[no-untyped-def]
    """Set the vectors (2, y, x) from sources to burned centres, in m north and east.

    ``found`` and ``arrival_s`` (y, x) are those of a window whose first cell is (top, left).
    """
    for y_in in range(arrival_s.shape[0]):
        for x_in in range(arrival_s.shape[1]):
            if arrival_s[y_in, x_in] == np.inf:
                continue
            row, col = top + y_in, left + x_in
            source = np.int64(labels.source[key_of(2 * row + 1, 2 * col + 1, lattice)])
            if source >= 0:
                y, x, _ = place_of(source, points, labels, lattice)
                found[0, y_in, x_in] = (y - (row + 0.5)) * cell_m
                found[1, y_in, x_in] = (col + 0.5 - x) * cell_m


@kernel
def _lowest(front_of, point):  # type: ignore[no-untyped-def]
    """Return the lowest index among the points that have been joined with a point."""
    while front_of[point] != point:
        front_of[point] = front_of[front_of[point]]  # shortens the search in the next call
        point = front_of[point]
    return point


@kernel
def join_fronts(beside, front_of):  # type: ignore[no-untyped-def]
    """Set the number of each point's front, which is the lowest index of the front's points.

    ``beside`` (k, 2) is as in ``Points``. On entry, ``front_of`` (k) contains each point's own
    index.
    """
    for point in range(front_of.size):
        for side in range(2):
            if beside[point, side] >= 0:
                one, other = _lowest(front_of, point), _lowest(front_of, beside[point, side])
                front_of[max(one, other)] = min(one, other)
    for point in range(front_of.size):
        front_of[point] = _lowest(front_of, point)


def without_unused(points: Points, labels: Labels, since_s: float) -> tuple[Points, Labels]:
    """Return the points that are still needed, and the labels with the new indices.

    For a node that was reached before ``since_s``, the last weather change, only the point that is
    the node's source is kept. For all other nodes, all points of the front on which the source lies
    are kept.
    """
    count, keys = len(points.at), labels.best_s.size
    at_point = np.flatnonzero(labels.source >= keys)
    source = labels.source[at_point] - keys
    front_of = np.arange(count, dtype=np.int32)
    join_fronts(points.beside, front_of)
    is_active = np.zeros(count, dtype=bool)
    is_active[front_of[source[labels.best_s[at_point] >= since_s]]] = True
    linked = is_active[front_of]
    kept = linked.copy()
    kept[source] = True
    number = np.cumsum(kept) - 1
    beside = np.where(linked[:, None] & (points.beside >= 0), number[points.beside], -1)
    new_source = labels.source.copy()
    new_source[at_point] = keys + number[source]
    return (
        # The bends that are kept are no longer moved: the indices of their sources have changed.
        Points(
            points.at[kept],
            beside[kept].astype(np.int32),
            np.full(np.count_nonzero(kept), -1, dtype=np.int32),
        ),
        labels._replace(source=new_source),
    )
