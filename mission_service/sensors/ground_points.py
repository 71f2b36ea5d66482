"""Compute the places on the ground that pixels show, with their errors, by ray casting. Pure.

A line of sight is followed to the elevation of the landscape, interpolated bilinearly. The errors
of the pose are carried along to first order: each part of the pose is changed by its standard
deviation, and the displacements of the place on the ground are the columns of the root of its
covariance.
"""

from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.sensors.camera_geometry import CameraPose, Lens, PoseErrors, lines_of_sight
from mission_service.sensors.ray_casting_kernels import cast_rays

REACH_M = 5000.0  # pixels that show ground farther away are not used


class ErrorEllipse(NamedTuple):
    """The ellipse of one standard deviation of a place on the ground."""

    major_m: float
    minor_m: float
    major_from_grid_north_deg: float


def ground_points(
    landscape: Landscape, lens: Lens, pose: CameraPose, col: Floats, row: Floats
) -> Floats:
    """Return the grid positions (n, 2), row and column, that pixels (n,) show.

    Pixels of the sky, and those that show ground off the landscape or beyond ``REACH_M``, give NaN.

    Raises FireModelError if the landscape has no elevation, or the camera is not above its ground.
    """
    if landscape.elevation_m is None:
        raise FireModelError("the landscape has no elevation, which georeferencing requires")
    at_row, at_col = landscape.row_col_of(pose.x_m, pose.y_m)
    if not landscape.contains(pose.x_m, pose.y_m):
        raise FireModelError("the camera is not above the landscape")
    ground_m = float(landscape.elevation_at(pose.x_m, pose.y_m))
    if pose.altitude_amsl_m <= ground_m:
        raise FireModelError(
            f"the camera is {ground_m - pose.altitude_amsl_m:.0f} m below the ground; its altitude "
            "must be above mean sea level"
        )
    start = np.array([float(at_row), float(at_col), pose.altitude_amsl_m])
    directions = lines_of_sight(lens, pose, col, row)
    found = np.empty((col.size, 2))
    highest_m = float(landscape.elevation_m.max())
    size_m = landscape.cell_size_m
    cast_rays(landscape.elevation_m, start, directions, size_m, highest_m, REACH_M, found)
    return found


def covariances(
    landscape: Landscape,
    lens: Lens,
    pose: CameraPose,
    errors: PoseErrors,
    col: Floats,
    row: Floats,
) -> Floats:
    """Return the covariance matrices (n, 2, 2) in m² of the places that pixels (n,) show.

    The axes are east and north of the grid. Pixels that show no ground give NaN.
    """
    here = ground_points(landscape, lens, pose, col, row)
    found = np.zeros((col.size, 2, 2))
    for shifted in errors.shifted(pose):
        moved = ground_points(landscape, lens, shifted, col, row) - here
        east_north_m = np.column_stack([moved[:, 1], -moved[:, 0]]) * landscape.cell_size_m
        found += east_north_m[:, :, None] * east_north_m[:, None, :]
    return found


def ellipse_of(covariance: Floats) -> ErrorEllipse:
    """Return the ellipse of a covariance matrix (2, 2) of east and north in m²."""
    values, vectors = np.linalg.eigh(covariance)
    east, north = vectors[:, 1]
    major_m, minor_m = np.sqrt(np.maximum(values[::-1], 0.0))
    return ErrorEllipse(
        float(major_m), float(minor_m), float(np.rad2deg(np.arctan2(east, north)) % 180.0)
    )
