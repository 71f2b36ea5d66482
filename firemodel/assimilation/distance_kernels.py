"""Compute distances in a window of cells without SciPy, which is slow to import."""

import numpy as np

from firemodel.compiled import compiled


@compiled
def distance_cells(cells):  # type: ignore[no-untyped-def]
    """Return the distance (y, x) in cells from each cell to the nearest cell of a mask.

    The distance is between the centres of cells, and infinite if the mask is empty. The result
    equals ``scipy.ndimage.distance_transform_edt(~cells)`` bit for bit.
    """
    rows, cols = cells.shape
    in_column = np.empty((rows, cols))  # distance to the nearest cell in the same column
    for col in range(cols):
        gap = np.inf
        for row in range(rows):
            gap = 0.0 if cells[row, col] else gap + 1.0
            in_column[row, col] = gap
        for row in range(rows - 1, -1, -1):
            gap = 0.0 if cells[row, col] else gap + 1.0
            in_column[row, col] = min(in_column[row, col], gap)
    found = np.empty((rows, cols))
    for row in range(rows):
        for col in range(cols):
            nearest, away = in_column[row, col] ** 2, 1
            while away < cols and away * away < nearest:
                for other in (col - away, col + away):
                    if 0 <= other < cols:
                        nearest = min(nearest, away * away + in_column[row, other] ** 2)
                away += 1
            found[row, col] = np.sqrt(nearest)
    return found
