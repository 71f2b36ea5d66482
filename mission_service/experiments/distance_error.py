"""Distance error: how far the fire a planner believes in is from the true one (Islam & Hu, VI.E).

Both are distances from the ignition on 360 whole-degree bearings, in cells.
"""

import numpy as np
from numpy.typing import NDArray
from shapely import convex_hull, get_coordinates, multipoints

from mission_service.fire_map import BEARINGS, EAST, NORTH

Floats = NDArray[np.float64]

SAMPLES_PER_CELL = 2


class TrueShape:
    """The outermost burned ground on each bearing, from arrival times (y, x) in s."""

    def __init__(self, arrival_s: Floats, centre: tuple[int, int]) -> None:
        reach = int(np.hypot(*arrival_s.shape)) * SAMPLES_PER_CELL
        distance = np.arange(reach) / SAMPLES_PER_CELL
        rows = np.rint(centre[0] - NORTH[:, None] * distance).astype(np.int64)
        cols = np.rint(centre[1] + EAST[:, None] * distance).astype(np.int64)
        inside = (rows >= 0) & (cols >= 0) & (rows < arrival_s.shape[0])
        inside &= cols < arrival_s.shape[1]
        along = np.full(rows.shape, np.inf)
        along[inside] = arrival_s[rows[inside], cols[inside]]
        # When ground at least as far out first burned: rises with the distance.
        self._reached_s = np.minimum.accumulate(along[:, ::-1], axis=1)[:, ::-1]

    def at(self, at_s: float) -> Floats:
        """Distance of the front in cells on 360 bearings, to half a cell."""
        reached = np.count_nonzero(self._reached_s <= at_s, axis=1)
        distance: Floats = np.maximum(reached - 1, 0) / SAMPLES_PER_CELL
        return distance


def hull_of(shape: Floats) -> Floats:
    """Section VI.E: the filled convex hull of a shape (360), as distances on 360 bearings."""
    points = np.column_stack([shape * EAST, shape * NORTH])
    corners = get_coordinates(convex_hull(multipoints(points)))[:-1]  # clockwise
    bearing = np.rad2deg(np.arctan2(corners[:, 0], corners[:, 1])) % 360.0
    first = int(np.argmin(bearing))
    corners, bearing = np.roll(corners, -first, axis=0), np.roll(bearing, -first)
    after = np.searchsorted(bearing, np.arange(BEARINGS), side="right") % len(corners)
    start, end = corners[after - 1], corners[after]
    side = end - start
    across = EAST * side[:, 1] - NORTH * side[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (start[:, 0] * side[:, 1] - start[:, 1] * side[:, 0]) / across
    return np.where(np.isfinite(distance), np.maximum(distance, shape), shape)
