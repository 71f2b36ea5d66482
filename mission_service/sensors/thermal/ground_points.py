"""Compute the positions on the ground that pixels show, and the errors of the positions. Pure.

A line of sight is followed to the ground (ray casting); the elevation is interpolated bilinearly.
The errors of the pose are propagated to first order, as if the ground were a plane with the slope
at the position.
"""

from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats, Mask
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.sensors.thermal.camera_geometry import (
    CameraPose,
    Lens,
    axes_of,
    lines_of_sight,
)
from mission_service.sensors.thermal.ray_casting_kernels import cast_rays

REACH_M = 5000.0  # pixels that show ground farther away are not used
GRAZING = 0.01  # sine of the smallest angle between a line of sight and the ground
SAME_M = 0.1  # greatest distance between a position and the same position from ray casting
UP = 2  # index of the altitude in the error of a pose


class ErrorEllipse(NamedTuple):
    """The ellipse of one standard deviation of a position on the ground."""

    major_m: float
    minor_m: float
    major_from_grid_north_deg: float


def ground_points(
    landscape: Landscape, lens: Lens, pose: CameraPose, col: Floats, row: Floats
) -> Floats:
    """Return the grid positions (n, 2), row and column, that pixels (n,) show.

    Pixels of the sky, and those that show ground off the landscape or beyond ``REACH_M``, give NaN.

    Raises FireModelError if the landscape has no elevation, or the camera is not above the ground.
    """
    if landscape.elevation_m is None:
        raise FireModelError("the landscape has no elevation, which georeferencing requires")
    if not landscape.contains(pose.x_m, pose.y_m):
        raise FireModelError("the camera is not above the landscape")
    ground_m = float(landscape.elevation_at(pose.x_m, pose.y_m))
    if pose.altitude_amsl_m <= ground_m:
        raise FireModelError(
            f"the camera is {ground_m - pose.altitude_amsl_m:.0f} m below the ground; its altitude "
            "must be above mean sea level"
        )
    return _first_ground(landscape, pose, lines_of_sight(lens, pose, col, row))


def hidden(landscape: Landscape, pose: CameraPose, places: Floats) -> Mask:
    """Return True (n,) for positions on the ground (n, 2) that are not visible from a camera.

    Other ground lies between such a position and the camera, or the position is beyond ``REACH_M``.
    """
    offset_m = offsets_m(landscape, pose, places)
    directions = offset_m / np.linalg.norm(offset_m, axis=1, keepdims=True)
    apart = np.abs(_first_ground(landscape, pose, directions) - places).max(axis=1)
    same: Mask = apart * landscape.cell_size_m < SAME_M  # False for NaN
    return ~same


def _first_ground(landscape: Landscape, pose: CameraPose, directions: Floats) -> Floats:
    """Return the first ground positions (n, 2) on lines of sight (n, 3); NaN without ground."""
    assert landscape.elevation_m is not None
    at_row, at_col = landscape.row_col_of(pose.x_m, pose.y_m)
    start = np.array([float(at_row), float(at_col), pose.altitude_amsl_m])
    found: Floats = np.empty((directions.shape[0], 2))
    highest_m = float(landscape.elevation_m.max())
    size_m = landscape.cell_size_m
    cast_rays(landscape.elevation_m, start, directions, size_m, highest_m, REACH_M, found)
    return found


def pose_effects(landscape: Landscape, pose: CameraPose, places: Floats) -> Floats:
    """Return the displacements (n, 2, 6) of positions on the ground by errors of the pose.

    A displacement is east and north in m, for each m or rad of each component of the error
    (``PoseErrors``). An error of the elevation has the opposite effect to an error of the altitude.
    The displacements are large if the line of sight is nearly parallel to the slope, and NaN for a
    position that is NaN.

    Args:
        landscape: The landscape.
        pose: The camera.
        places: The grid positions (n, 2) that ``ground_points`` found.
    """
    offset_m = offsets_m(landscape, pose, places)
    rise_east, rise_north = _slopes(landscape, places)
    # An error moves the end of the line of sight; the line then meets the ground's plane elsewhere.
    descent = rise_east * offset_m[:, 0] + rise_north * offset_m[:, 1] - offset_m[:, 2]
    along = (
        offset_m[:, :2] / np.maximum(descent, GRAZING * np.linalg.norm(offset_m, axis=1))[:, None]
    )
    moves = np.empty((places.shape[0], 6, 3))
    moves[:, :3] = np.eye(3)
    moves[:, 3:] = np.cross(axes_of(pose)[None], offset_m[:, None])
    above = (
        moves[:, :, 2] - moves[:, :, 0] * rise_east[:, None] - moves[:, :, 1] * rise_north[:, None]
    )
    found: Floats = moves[:, :, :2] + above[:, :, None] * along[:, None, :]
    return found.transpose(0, 2, 1)


def offsets_m(landscape: Landscape, pose: CameraPose, places: Floats) -> Floats:
    """Return positions on the ground (n, 2) as east, north and up (n, 3) from the camera in m."""
    x_m, y_m = landscape.xy_of(places[:, 0], places[:, 1])
    ground_m = np.full(places.shape[0], np.nan)
    known = np.isfinite(places[:, 0])
    ground_m[known] = landscape.elevation_at(x_m[known], y_m[known])
    return np.column_stack([x_m - pose.x_m, y_m - pose.y_m, ground_m - pose.altitude_amsl_m])


def _slopes(landscape: Landscape, places: Floats) -> tuple[Floats, Floats]:
    """Return the rise per metre towards east and north (n,) at grid positions (n, 2)."""
    rise = [np.full(places.shape[0], np.nan) for _ in range(2)]
    known = np.isfinite(places[:, 0])
    row, col = places[known].T
    z = landscape.elevation_m
    assert z is not None
    top = np.clip(row.astype(np.int64), 0, z.shape[0] - 2)
    left = np.clip(col.astype(np.int64), 0, z.shape[1] - 2)
    north_west, north_east = z[top, left], z[top, left + 1]
    south_west, south_east = z[top + 1, left], z[top + 1, left + 1]
    down, right = row - top, col - left
    eastwards = (north_east - north_west) * (1 - down) + (south_east - south_west) * down
    southwards = (south_west - north_west) * (1 - right) + (south_east - north_east) * right
    rise[0][known] = eastwards / landscape.cell_size_m
    rise[1][known] = -southwards / landscape.cell_size_m
    return rise[0], rise[1]


def elevation_sds_m(landscape: Landscape, places: Floats, stated_sd_m: float) -> Floats:
    """Return the standard deviations (n,) of the interpolated elevation at positions (n, 2).

    The interpolation between the centres of cells adds an error to the stated one. For ground of
    constant curvature, the added error is at most an eighth of the second difference of the
    elevation in each axis, and the root mean square of the added error over the cell is close to a
    tenth of this difference.
    """
    z = landscape.elevation_m
    assert z is not None
    found = np.full(places.shape[0], np.nan)
    known = np.isfinite(places[:, 0])
    row, col = np.rint(places[known]).astype(np.int64).T
    row, col = np.clip(row, 1, z.shape[0] - 2), np.clip(col, 1, z.shape[1] - 2)
    bends = np.abs(z[row - 1, col] + z[row + 1, col] - 2.0 * z[row, col])
    bends += np.abs(z[row, col - 1] + z[row, col + 1] - 2.0 * z[row, col])
    found[known] = np.hypot(stated_sd_m, bends / 10.0)
    return found


def covariances(effects: Floats, pose_covariance: Floats, elevation_sd_m: Floats) -> Floats:
    """Return the covariance matrices (n, 2, 2) in m² of positions on the ground.

    The axes are east and north of the grid.

    Args:
        effects: The ``pose_effects`` (n, 2, 6) at the positions.
        pose_covariance: The covariance (6, 6) of the error of the pose.
        elevation_sd_m: The standard deviations (n,) of the elevation of the ground.
    """
    vertical = effects[:, :, UP] * elevation_sd_m[:, None]
    found: Floats = effects @ pose_covariance @ effects.transpose(0, 2, 1)
    found += vertical[:, :, None] * vertical[:, None, :]
    return found


def ellipse_of(covariance: Floats) -> ErrorEllipse:
    """Return the ellipse of a covariance matrix (2, 2) of east and north in m²."""
    values, vectors = np.linalg.eigh(covariance)
    east, north = vectors[:, 1]
    major_m, minor_m = np.sqrt(np.maximum(values[::-1], 0.0))
    return ErrorEllipse(
        float(major_m), float(minor_m), float(np.rad2deg(np.arctan2(east, north)) % 180.0)
    )
