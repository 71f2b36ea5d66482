"""Measure the length and height of slopes, upwards or downwards (compiled)."""

import math

from firemodel.compiled import inlined, kernel


@inlined
def _height_at(elevation, row, col):  # type: ignore[no-untyped-def]
    """Interpolate an elevation (y, x) bilinearly; the position is within the grid."""
    top = min(int(row), max(elevation.shape[0] - 2, 0))
    left = min(int(col), max(elevation.shape[1] - 2, 0))
    low, right = min(top + 1, elevation.shape[0] - 1), min(left + 1, elevation.shape[1] - 1)
    down, across = row - top, col - left
    north = elevation[top, left] * (1.0 - across) + elevation[top, right] * across
    south = elevation[low, left] * (1.0 - across) + elevation[low, right] * across
    return north * (1.0 - down) + south * down


@kernel
def slope_lengths(elevation, rise, upward, cell_m, length_m, height_m):  # type: ignore[no-untyped-def]
    """Write the length and the height in m of the slope from each cell along a straight line.

    ``rise`` (2, y, x) is the rise per metre towards north and east. The line follows the steepest
    rise of the cell where ``upward`` (y, x) is true, else the steepest fall, in steps of one cell,
    as long as the ground rises or falls. ``length_m`` is measured along the ground.
    """
    rows, cols = elevation.shape
    for row in range(rows):
        for col in range(cols):
            length_m[row, col], height_m[row, col] = 0.0, 0.0
            north, east = rise[0, row, col], rise[1, row, col]
            slope = math.hypot(north, east)
            if slope == 0.0:
                continue
            sign = 1.0 if upward[row, col] else -1.0
            down, right = -sign * north / slope, sign * east / slope
            before = elevation[row, col]
            steps = 0
            while True:
                at_row, at_col = row + (steps + 1) * down, col + (steps + 1) * right
                if not (0.0 <= at_row <= rows - 1 and 0.0 <= at_col <= cols - 1):
                    break
                here = _height_at(elevation, at_row, at_col)
                if sign * (here - before) <= 0.0:
                    break
                before = here
                steps += 1
            change = abs(before - elevation[row, col])
            height_m[row, col] = change
            length_m[row, col] = math.hypot(steps * cell_m, change)
