"""Find the cells of a map in the footprint of a camera that looks straight down.

A footprint is a tuple: x_m, y_m, the course in radians anticlockwise from east, half the width
across the track and half the length along the track, both in metres.
"""

import math

import numpy as np
from numpy.typing import NDArray

from mission_service.fire.camera import EDGE, beyond_rectangle
from mission_service.guidance.formation.map_grid import MapGrid

Cells = NDArray[np.int64]
Floats = NDArray[np.float64]
Footprint = tuple[float, float, float, float, float]


def changed_cells(
    grid: MapGrid, footprint: Footprint, arrival_s: Floats, at_s: float, fire: NDArray[np.bool_]
) -> tuple[Cells, Cells]:
    """Return a footprint's cells that burn only in the true fire, and those only on the map.

    ``arrival_s`` (y, x) holds the arrival times of the true fire, and infinity for cells that never
    burn. Burned cells count as burning. ``fire`` (y, x) is the map. Returns two arrays of cell
    indices in ascending order.
    """
    cells = cells_in_view(grid, footprint)
    burns, mapped = arrival_s.ravel()[cells] <= at_s, fire.ravel()[cells]
    return cells[burns & ~mapped], cells[mapped & ~burns]


def mark_seen(grid: MapGrid, footprint: Footprint, seen_s: Floats, at_s: float) -> None:
    """Write the time ``at_s`` into ``seen_s`` (y, x) at the cells in a footprint."""
    seen_s.ravel()[cells_in_view(grid, footprint)] = at_s


def cells_in_view(grid: MapGrid, footprint: Footprint) -> Cells:
    """Return the indices of the cells in a footprint, in ascending order."""
    x_m, y_m, course_rad, half_across_m, half_along_m = footprint
    row, col = grid.row_col_of(x_m, y_m)
    across, along = half_across_m / grid.cell_m, half_along_m / grid.cell_m
    reach = math.hypot(across, along) + EDGE
    rows, cols = (
        np.arange(max(math.ceil(at - reach), 0), min(math.floor(at + reach) + 1, count))
        for at, count in ((row, grid.rows), (col, grid.cols))
    )
    heading_deg = 90.0 - math.degrees(course_rad)
    beyond = beyond_rectangle(rows[:, None] - row, cols - col, heading_deg, across, along)
    found: Cells = (rows[:, None] * grid.cols + cols)[~beyond]
    return found
