"""Find the front of a fire, as an ordered loop of cells or as polygons."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, bounds_of
from firemodel.landscape.landscape import Landscape

MIN_S = 1e-6  # minimum travel time assumed beyond a front
# Neighbours clockwise from west, as (row, col) steps.
_AROUND = ((0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1))


def largest_region(burned: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the largest burned region (y, x) whose cells are connected by sides or corners."""
    from scipy import ndimage

    labels, count = ndimage.label(burned, structure=np.ones((3, 3)))
    if count == 0:
        return np.zeros_like(burned)
    sizes = np.bincount(labels.ravel())[1:]
    return np.asarray(labels == int(np.argmax(sizes)) + 1)


def perimeter(burned: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the outer boundary cells (n, 2) of the largest burned region, as (row, col).

    The loop is closed and anticlockwise on a north-up map. Each cell is one of the eight neighbours
    of the previous cell. A branch one cell wide is traversed in both directions. The method is
    Moore-neighbour tracing, which ends when the first step would be repeated (Jacob's criterion).
    """
    region = np.pad(largest_region(burned), 1)
    if not region.any():
        return np.empty((0, 2), dtype=np.int32)
    row, col = (int(value) for value in np.argwhere(region)[0])
    start, loop, came_from = (row, col), [(row, col)], 0
    first_step: tuple[int, int] | None = None
    while True:
        for turn in range(1, 9):
            side = (came_from + turn) % 8
            step = _AROUND[side]
            if region[row + step[0], col + step[1]]:
                break
        else:
            break  # a single cell
        if (row, col) == start:
            if first_step == step:
                break
            first_step = first_step or step
        row, col = row + step[0], col + step[1]
        loop.append((row, col))
        # Continue from the empty cell that was examined last, relative to the new cell.
        before = _AROUND[(side - 1) % 8]
        came_from = _AROUND.index((before[0] - step[0], before[1] - step[1]))
    if len(loop) > 1:
        loop.pop()  # the start cell is repeated at the end
    return np.array(loop[::-1], dtype=np.int32) - 1


def neighbours_of(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask (y, x) that is True where one of the eight neighbours is in ``cells``."""
    padded = np.pad(cells, 1)
    rows, cols = cells.shape
    found = np.zeros_like(cells)
    for row, col in _AROUND:
        found |= padded[1 + row : 1 + row + rows, 1 + col : 1 + col + cols]
    return found


def earliest_neighbour(arrival_s: Floats) -> tuple[Floats, Floats]:
    """Return the steps in rows and in columns, each (y, x), to the neighbour that burned first.

    The step is (0, 0) where no neighbour burned before the cell itself.
    """
    padded = np.pad(arrival_s, 1, constant_values=np.inf)
    rows, cols = arrival_s.shape
    first, step_row, step_col = arrival_s.copy(), np.zeros((rows, cols)), np.zeros((rows, cols))
    for row, col in _AROUND:
        neighbour_s = padded[1 + row : 1 + row + rows, 1 + col : 1 + col + cols]
        earlier = neighbour_s < first
        first[earlier], step_row[earlier], step_col[earlier] = neighbour_s[earlier], row, col
    return step_row, step_col


def multipolygon(area: Any) -> Any:
    """Return the polygons of a shapely geometry as one MultiPolygon."""
    from shapely import get_parts
    from shapely.geometry import MultiPolygon

    return MultiPolygon([part for part in get_parts(area) if part.geom_type == "Polygon"])


def front_polygons(expected_s: Floats, time_s: float, landscape: Landscape) -> Any:
    """Return the burned area at ``time_s`` as a MultiPolygon, computed from arrival times (y, x).

    The edge of the area is interpolated linearly between cell centres. The edge is at most halfway
    to a cell that fire does not reach; no part of the area is therefore off the landscape.
    """
    from contourpy import FillType, contour_generator
    from shapely.geometry import MultiPolygon, Polygon

    burned = expected_s <= time_s
    if not burned.any():
        return MultiPolygon()
    window = bounds_of(burned)
    top, left = window[0].start, window[1].start
    ahead_s = _ahead(np.pad(expected_s, 1, constant_values=np.inf), window, time_s)
    generator = contour_generator(z=ahead_s, fill_type=FillType.OuterOffset)
    found = []
    for points, starts in zip(*generator.filled(ahead_s.min() - 1.0, 0.0), strict=True):
        x_m, y_m = landscape.xy_of(points[:, 1] + top - 1, points[:, 0] + left - 1)
        rings = np.split(np.stack([x_m, y_m], axis=1), starts[1:-1])
        found.append(Polygon(rings[0], rings[1:]))
    return MultiPolygon(found)


def _ahead(padded_s: Floats, window: tuple[slice, slice], time_s: float) -> Floats:
    """Return arrival times minus ``time_s`` in a window and the cells around it.

    A cell that fire never reaches is given the largest time since arrival among its neighbours, so
    that the interpolated edge is at most halfway to this cell.
    """
    wider = slice(window[0].start, window[0].stop + 2), slice(window[1].start, window[1].stop + 2)
    ahead_s = padded_s[wider] - time_s
    inside = np.pad(ahead_s <= 0.0, 1)
    ago_s = np.where(inside, -np.pad(ahead_s, 1), 0.0)
    rows, cols = ahead_s.shape
    longest_s = np.full((rows, cols), MIN_S)
    for row, col in _AROUND:
        shifted = slice(1 + row, 1 + row + rows), slice(1 + col, 1 + col + cols)
        np.maximum(longest_s, ago_s[shifted], out=longest_s)
    return np.where(np.isfinite(ahead_s), ahead_s, longest_s)
