"""Place the pixels of an image on the ground using its four corner points. Pure.

The camera's computer computes the corner points by intersecting the corners' lines of sight with a
ground model. Between the corner points, pixels are placed by a projective transformation
(homography). This transformation is exact for a plane; over uneven ground it is an approximation.
"""

from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape

SHORTEST_M, LONGEST_M = 2.0, 10_000.0  # sides of the quadrilateral


class CornerPoints(NamedTuple):
    """The positions that the corners of an image show, and the standard deviation along each axis.

    ``lat_lon_deg`` (4, 2) begins with the upper left corner and continues clockwise.
    """

    lat_lon_deg: tuple[tuple[float, float], ...]
    sd_m: float


def quadrilateral(landscape: Landscape, corners: CornerPoints) -> Floats:
    """Return the grid positions (4, 2), row and column, of corner points.

    Raises FireModelError unless the points are clockwise on the ground and form a convex
    quadrilateral with sides of ``SHORTEST_M`` to ``LONGEST_M``.
    """
    x_m, y_m = landscape.xy_of_places(corners.lat_lon_deg).T
    found: Floats = np.column_stack(landscape.row_col_of(x_m, y_m))
    sides = np.roll(found, -1, axis=0) - found
    lengths_m = np.linalg.norm(sides, axis=1) * landscape.cell_size_m
    if not (lengths_m.min() >= SHORTEST_M and lengths_m.max() <= LONGEST_M):  # NaN also fails
        raise FireModelError(
            f"the corner points are {lengths_m.min():.0f} to {lengths_m.max():.0f} m apart"
        )
    following = np.roll(sides, -1, axis=0)
    turns = sides[:, 1] * following[:, 0] - sides[:, 0] * following[:, 1]
    if not (turns > 0.0).all():
        raise FireModelError("the corner points are mirrored or cross each other")
    return found


def homography(width: int, height: int, places: Floats) -> Floats:
    """Return the matrix (3, 3) from a pixel (column, row, 1) to a grid position (row, column, 1).

    ``places`` (4, 2) are the grid positions of the image's corners, clockwise from the upper left.
    """
    right, low = width - 0.5, height - 0.5
    corners = ((-0.5, -0.5), (right, -0.5), (right, low), (-0.5, low))
    equations, values = [], []
    for (col, row), place in zip(corners, places, strict=True):
        equations.append([col, row, 1.0, 0.0, 0.0, 0.0, -col * place[0], -row * place[0]])
        equations.append([0.0, 0.0, 0.0, col, row, 1.0, -col * place[1], -row * place[1]])
        values += [place[0], place[1]]
    return np.append(np.linalg.solve(np.array(equations), np.array(values)), 1.0).reshape(3, 3)


def corner_places(landscape: Landscape, matrix: Floats, col: Floats, row: Floats) -> Floats:
    """Return the grid positions (n, 2) that pixels (n,) show; NaN off the landscape."""
    projected = np.column_stack([col, row, np.ones_like(col)]) @ matrix.T
    found: Floats = projected[:, :2] / projected[:, 2:]
    last = np.array(landscape.shape) - 1.0
    found[~((found >= 0.0) & (found <= last)).all(axis=1)] = np.nan
    return found
