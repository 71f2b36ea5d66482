"""Kernels of ``ground_points``, which find where lines of sight meet the ground."""

import math

from firemodel.compiled import kernel

HALVINGS = 20


@kernel
def _elevation(elevation_m, row, col):  # type: ignore[no-untyped-def]
    """Return the bilinearly interpolated elevation at a position inside the grid."""
    top = min(int(row), elevation_m.shape[0] - 2)
    left = min(int(col), elevation_m.shape[1] - 2)
    down, right = row - top, col - left
    north = elevation_m[top, left] * (1 - right) + elevation_m[top, left + 1] * right
    south = elevation_m[top + 1, left] * (1 - right) + elevation_m[top + 1, left + 1] * right
    return north * (1 - down) + south * down


@kernel
def cast_rays(elevation_m, start, directions, cell_size_m, highest_m, reach_m, found):  # type: ignore[no-untyped-def]
    """Write the first point (row, column) of the ground on each ray to ``found`` (n, 2).

    ``start`` is the row, column and altitude of the camera, and ``directions`` (n, 3) are unit
    vectors: east, north, up. A ray that leaves the grid, rises above ``highest_m`` or passes
    ``reach_m`` gives NaN. The steps are half a cell long. In the step that meets the ground, the
    point is found by ``HALVINGS`` bisections.
    """
    last_row, last_col = elevation_m.shape[0] - 1.0, elevation_m.shape[1] - 1.0
    step_m = cell_size_m / 2.0
    for ray in range(directions.shape[0]):
        east, north, up = directions[ray, 0], directions[ray, 1], directions[ray, 2]
        found[ray, 0] = found[ray, 1] = math.nan
        above_m = 0.0
        while above_m < reach_m:
            far_m = above_m + step_m
            row = start[0] - far_m * north / cell_size_m
            col = start[1] + far_m * east / cell_size_m
            altitude_m = start[2] + far_m * up
            if not (0.0 <= row <= last_row and 0.0 <= col <= last_col):
                break
            if up >= 0.0 and altitude_m > highest_m:
                break
            if altitude_m > _elevation(elevation_m, row, col):
                above_m = far_m
                continue
            for _ in range(HALVINGS):
                middle_m = (above_m + far_m) / 2.0
                row = start[0] - middle_m * north / cell_size_m
                col = start[1] + middle_m * east / cell_size_m
                if start[2] + middle_m * up > _elevation(elevation_m, row, col):
                    above_m = middle_m
                else:
                    far_m = middle_m
            found[ray, 0] = start[0] - far_m * north / cell_size_m
            found[ray, 1] = start[1] + far_m * east / cell_size_m
            break
