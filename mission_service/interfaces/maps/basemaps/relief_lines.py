"""Computes the contour and drainage lines of a landscape from its elevation, as GeoJSON.

Drainage lines follow the steepest descent from each cell; depressions are filled by the
Priority-Flood algorithm (Barnes, Lehman & Mulla 2014, doi:10.1016/j.cageo.2013.04.024).
"""

import heapq
from itertools import pairwise
from typing import Any

import contourpy
import numpy as np
import shapely
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.interfaces.maps.terrain import halved

MAX_CELLS = 300_000  # larger landscapes are averaged over 2 x 2, 4 x 4, ... cells
INTERVALS_M = (1.0, 2.0, 5.0, 10.0, 20.0, 25.0, 50.0, 100.0, 200.0)
MAX_LEVELS = 30
INDEX_EVERY = 5  # every fifth contour line is bold and labelled
MIN_DRAINED_M2 = 250_000.0
MIN_RELIEF_M = 5.0  # flatter landscapes have no drainage lines
TOLERANCE_CELLS = 0.35  # maximum deviation of simplified lines
NEIGHBOURS = [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)]

Heights = NDArray[np.float64]
Positions = NDArray[np.float64]


def relief_lines(landscape: Landscape) -> dict[str, Any]:
    """Return contour lines and drainage lines as a FeatureCollection (longitude, latitude).

    A contour line has the properties ``kind`` (contour), ``height_m`` and ``index``; a drainage
    line has ``kind`` (drainage) and ``drained_ha``, the area that drains through its lower end.
    """
    if landscape.elevation_m is None:
        return {"type": "FeatureCollection", "features": []}
    levels = halved(landscape.elevation_m)
    times = next((i for i, each in enumerate(levels) if each.size <= MAX_CELLS), len(levels) - 1)
    heights, size = levels[times].astype(np.float64), 2.0**times
    features = [*_contours(landscape, heights, size), *_drainage(landscape, heights, size)]
    return {"type": "FeatureCollection", "features": features}


def interval_m(relief_m: float) -> float:
    """Return the contour interval for a landscape with this relief."""
    return next((each for each in INTERVALS_M if relief_m / each <= MAX_LEVELS), INTERVALS_M[-1])


def _feature(
    landscape: Landscape, rows_cols: Positions, size: float, properties: dict[str, Any]
) -> dict[str, Any] | None:
    """Return a line through rows and columns (n, 2) of the reduced grid, or None if too short."""
    line = shapely.LineString(rows_cols).simplify(TOLERANCE_CELLS)
    row, col = (shapely.get_coordinates(line).T + 0.5) * size - 0.5
    if len(row) < 2:
        return None
    lat, lon = landscape.lat_lon_of(*landscape.xy_of(row, col))
    points = np.round(np.stack([lon, lat], axis=1), 5).tolist()
    geometry = {"type": "LineString", "coordinates": points}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _contours(landscape: Landscape, heights: Heights, size: float) -> list[dict[str, Any]]:
    low, high = float(heights.min()), float(heights.max())
    step = interval_m(high - low)
    drawn = contourpy.contour_generator(z=heights, name="serial")
    features = []
    for number in range(int(np.floor(low / step)) + 1, int(np.ceil(high / step))):
        about = {"kind": "contour", "height_m": number * step, "index": number % INDEX_EVERY == 0}
        for line in drawn.lines(number * step):
            found = _feature(landscape, np.asarray(line)[:, ::-1], size, about)
            if found is not None:
                features.append(found)
    return features


def drains_to(heights: Heights) -> tuple[NDArray[np.int64], list[int]]:
    """Return for each cell the index of the cell to which it drains, and all cells in order.

    Cells at the edge drain to -1. In the order of the list, each cell comes after the cell to which
    it drains.
    """
    rows, cols = heights.shape
    flat = heights.ravel().tolist()
    to = np.full(heights.size, -2, np.int64)
    queue: list[tuple[float, int]] = []
    for cell in range(heights.size):
        row, col = divmod(cell, cols)
        if row in (0, rows - 1) or col in (0, cols - 1):
            to[cell] = -1
            queue.append((flat[cell], cell))
    heapq.heapify(queue)
    order = []
    while queue:
        level, cell = heapq.heappop(queue)
        order.append(cell)
        row, col = divmod(cell, cols)
        for down, right in NEIGHBOURS:
            if 0 <= row + down < rows and 0 <= col + right < cols:
                other = cell + down * cols + right
                if to[other] == -2:
                    to[other] = cell
                    heapq.heappush(queue, (max(level, flat[other]), other))
    return to, order


def _drainage(landscape: Landscape, heights: Heights, size: float) -> list[dict[str, Any]]:
    if float(np.ptp(heights)) < MIN_RELIEF_M or min(heights.shape) < 3:
        return []
    cell_m2 = (landscape.cell_size_m * size) ** 2
    to, order = drains_to(heights)
    drained = np.ones(heights.size)
    for cell in reversed(order):
        if to[cell] >= 0:
            drained[to[cell]] += drained[cell]
    is_stream = drained * cell_m2 >= MIN_DRAINED_M2
    inflows = np.bincount(to[is_stream & (to >= 0)], minlength=heights.size)
    features = []
    for head in np.flatnonzero(is_stream & (inflows != 1)):
        path = [int(head)]
        while to[path[-1]] >= 0:
            path.append(int(to[path[-1]]))
            if inflows[path[-1]] != 1:  # a confluence, where another line begins
                break
        if len(path) < 2:
            continue
        cells = np.array([divmod(cell, heights.shape[1]) for cell in path], np.float64)
        drained_ha = round(float(drained[path[-2]]) * cell_m2 / 1e4, 1)
        about = {"kind": "drainage", "drained_ha": drained_ha}
        found = _feature(landscape, _smoothed(cells), size, about)
        if found is not None:
            features.append(found)
    return features


def _smoothed(cells: Positions) -> Positions:
    """Return a path of cells with its 45-degree steps smoothed and its ends unchanged."""
    if len(cells) < 3:
        return cells
    middles = [(one + other) / 2.0 for one, other in pairwise(cells)]
    return np.stack([cells[0], *middles, cells[-1]])
