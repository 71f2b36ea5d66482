"""How the pixels of an image are placed on the ground: by pose and lens, or by corner points. Pure.

Both views have the methods ``places`` and ``covariances``, which take the columns and rows of
pixels (n,) and return grid positions (n, 2), row and column, and covariance matrices (n, 2, 2) in
m², east and north of the grid. Pixels that show no ground of the landscape give NaN.
"""

from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalCameraSection
from mission_service.sensors.camera_geometry import CameraPose, Lens, PoseErrors, focal_px_of
from mission_service.sensors.corner_points import corner_places, homography, quadrilateral
from mission_service.sensors.ground_points import covariances, ground_points
from mission_service.sensors.thermal_image import ThermalImage


class PoseView(NamedTuple):
    """Lines of sight that are followed to the elevation of the landscape."""

    landscape: Landscape
    lens: Lens
    pose: CameraPose
    errors: PoseErrors

    def places(self, col: Floats, row: Floats) -> Floats:
        """Return the places of pixels. Raises FireModelError if the camera is below the ground."""
        return ground_points(self.landscape, self.lens, self.pose, col, row)

    def covariances(self, col: Floats, row: Floats) -> Floats:
        """Return the covariances of the places of pixels."""
        return covariances(self.landscape, self.lens, self.pose, self.errors, col, row)


class CornerView(NamedTuple):
    """A projective transformation between the places of an image's corners."""

    landscape: Landscape
    matrix: Floats  # (3, 3)
    sd_m: float  # of each axis

    def places(self, col: Floats, row: Floats) -> Floats:
        """Return the places of pixels."""
        return corner_places(self.landscape, self.matrix, col, row)

    def covariances(self, col: Floats, row: Floats) -> Floats:
        """Return the covariances of the places of pixels, which are equal."""
        return np.tile(np.eye(2) * self.sd_m**2, (col.size, 1, 1))


def view_of(
    image: ThermalImage, landscape: Landscape, settings: ThermalCameraSection
) -> PoseView | CornerView:
    """Return the view of an image.

    Raises FireModelError for implausible corner points, and without a focal length.
    """
    height, width = image.values.shape
    if image.corners is not None:
        matrix = homography(width, height, quadrilateral(landscape, image.corners))
        return CornerView(landscape, matrix, image.corners.sd_m)
    focal_px = image.focal_px
    if settings.field_of_view_deg is not None:
        focal_px = focal_px_of(settings.field_of_view_deg, width)
    if focal_px is None:
        raise FireModelError(
            f"the file has no focal length; give {settings.TABLE}.field_of_view_deg"
        )
    lens = Lens(width, height, focal_px, settings.distortion)
    errors = PoseErrors(
        settings.position_sd_m,
        settings.altitude_sd_m,
        settings.direction_sd_deg,
        settings.elevation_sd_m,
    )
    return PoseView(landscape, lens, _pose_of(image, landscape), errors)


def _pose_of(image: ThermalImage, landscape: Landscape) -> CameraPose:
    x_m, y_m = landscape.xy_of_lat_lon(image.lat_deg, image.lon_deg)
    if not np.isfinite(x_m + y_m):
        raise FireModelError("the camera is not above the landscape")
    yaw_deg = landscape.grid_deg(image.yaw_deg)
    return CameraPose(
        float(x_m), float(y_m), image.altitude_amsl_m, yaw_deg, image.pitch_deg, image.roll_deg
    )
