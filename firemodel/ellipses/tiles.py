"""Sort points into the squares of a quadtree, for computations that run once per square."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.compiled import kernel
from firemodel.errors import FireModelError

MAX_LEVELS = 9


class Tiles(NamedTuple):
    """A quadtree with ``levels`` levels below its root and with squares in Morton order.

    Square k of a level contains the four squares 4 k to 4 k + 3 of the next level. The squares of
    the last level are the tiles: the sorted points of tile k are those from ``begin[k]`` up to, but
    not including, ``begin[k + 1]``.
    """

    levels: int
    begin: NDArray[np.int64]  # (tiles + 1)
    order: NDArray[np.int64]  # (n) index of each sorted point in the input
    x: Floats  # (n) sorted
    y: Floats
    boxes: Floats  # (all squares, 4) minimum and maximum x, then y, of the points


def tiles_of(points_m: Floats, points_a_tile: int, side_m: float = 0.0) -> Tiles:
    """Sort points (n, 2) into tiles of about ``points_a_tile`` points.

    If ``side_m`` is given, a square whose sides are at most this long is not divided further.
    Raises FireModelError for a point that is not finite.
    """
    points: Any = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 2)
    count = len(points)
    box = np.array([np.inf, -np.inf, np.inf, -np.inf])
    check_finite(points, _enclose(points, box))
    west, east, south, north = box if count else np.zeros(4)
    extent_m = max(east - west, north - south)
    levels = min(math.ceil(math.log(max(count / points_a_tile, 1.0), 4.0)), MAX_LEVELS)
    if side_m > 0.0:
        levels = min(levels, math.ceil(math.log2(max(extent_m / side_m, 1.0))))
    per_m = 2**levels / extent_m if extent_m > 0.0 else 0.0
    found = Tiles(
        levels,
        np.zeros(4**levels + 2, dtype=np.int64),
        np.empty(count, dtype=np.int64),
        np.empty(count),
        np.empty(count),
        np.empty(((4 ** (levels + 1) - 1) // 3, 4)),
    )
    _sort(points, west, south, per_m, np.empty(count, dtype=np.int32), found)
    _bound(found)
    return found


def check_finite(points: Floats, wrong: int) -> None:
    """Raise FireModelError for the point ``wrong``, unless ``wrong`` is the number of points."""
    if wrong < len(points):
        raise FireModelError(f"point {wrong}: x, y = {points[wrong].tolist()}; both must be finite")


@kernel
def _enclose(points, box):  # type: ignore[no-untyped-def]
    """Widen a box until it contains all points.

    Returns the index of the first point that is not finite, or the number of points if all are
    finite.
    """
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        if not abs(x) + abs(y) < np.inf:
            return k
        box[0], box[1] = min(box[0], x), max(box[1], x)
        box[2], box[3] = min(box[2], y), max(box[3], y)
    return points.shape[0]


@kernel
def _spread_bits(number):  # type: ignore[no-untyped-def]
    """Insert a 0 bit between every two adjacent bits of a number with at most 16 bits."""
    number = (number | (number << 8)) & 0x00FF00FF
    number = (number | (number << 4)) & 0x0F0F0F0F
    number = (number | (number << 2)) & 0x33333333
    return (number | (number << 1)) & 0x55555555


@kernel
def _sort(points, west, south, per_m, tile_of, tiles):  # type: ignore[no-untyped-def]
    """Sort the points into tiles by counting sort, which needs one more element in ``begin``."""
    most = (1 << tiles.levels) - 1
    for k in range(points.shape[0]):
        column = min(np.int64((points[k, 0] - west) * per_m), most)
        row = min(np.int64((points[k, 1] - south) * per_m), most)
        tile = _spread_bits(column) | (_spread_bits(row) << 1)
        tile_of[k] = tile
        tiles.begin[tile + 2] += 1
    for tile in range(2, tiles.begin.size):
        tiles.begin[tile] += tiles.begin[tile - 1]
    for k in range(points.shape[0]):
        place = tiles.begin[tile_of[k] + 1]
        tiles.begin[tile_of[k] + 1] = place + 1
        tiles.order[place] = k
        tiles.x[place], tiles.y[place] = points[k, 0], points[k, 1]


@kernel
def first_of(level):  # type: ignore[no-untyped-def]
    """Return the index, among all squares, of the first square of a level."""
    return ((1 << (2 * level)) - 1) // 3


@kernel
def _bound(tiles):  # type: ignore[no-untyped-def]
    """Compute the boxes of all squares; in an empty square, minima are inf and maxima -inf."""
    boxes, last = tiles.boxes, first_of(tiles.levels)
    for square in range(boxes.shape[0]):
        boxes[square, 0] = boxes[square, 2] = np.inf
        boxes[square, 1] = boxes[square, 3] = -np.inf
    for tile in range(boxes.shape[0] - last):
        box = boxes[last + tile]
        for k in range(tiles.begin[tile], tiles.begin[tile + 1]):
            box[0], box[1] = min(box[0], tiles.x[k]), max(box[1], tiles.x[k])
            box[2], box[3] = min(box[2], tiles.y[k]), max(box[3], tiles.y[k])
    for square in range(boxes.shape[0] - 1, 0, -1):
        box, around = boxes[square], boxes[(square - 1) // 4]
        around[0], around[1] = min(around[0], box[0]), max(around[1], box[1])
        around[2], around[3] = min(around[2], box[2]), max(around[3], box[3])
