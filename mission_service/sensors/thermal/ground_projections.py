"""Place the pixels of an image on the ground, using pose and lens or corner points. Pure.

Both projections have the method ``places``, which returns the grid positions (n, 2), row and
column, that pixels (n,) show, and the inverse method ``pixels``. The method ``covariances`` returns
the covariance matrices (n, 2, 2) of positions in m², along grid east and grid north. The position
of a pixel that shows no ground of the landscape is NaN. The pixel of a position that an image does
not show is NaN or outside the image.
"""

import math
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalCameraSection
from mission_service.sensors.thermal.camera_geometry import (
    CameraPose,
    Lens,
    PoseErrors,
    focal_px_of,
    pixels_of,
)
from mission_service.sensors.thermal.ground_points import (
    covariances,
    elevation_sds_m,
    ground_points,
    hidden,
    offsets_m,
    pose_effects,
)
from mission_service.sensors.thermal.image_corners import corner_places, homography, quadrilateral
from mission_service.sensors.thermal.telemetry_poses import TelemetryPose
from mission_service.sensors.thermal.thermal_image import ThermalImage


class PoseProjection(NamedTuple):
    """A projection along lines of sight to the ground of the landscape."""

    landscape: Landscape
    lens: Lens
    pose: CameraPose
    covariance: Floats  # (6, 6) of the error of the pose, see ``PoseErrors``
    elevation_sd_m: float

    def places(self, col: Floats, row: Floats) -> Floats:
        """Return the positions of pixels; raises FireModelError if the camera is below ground."""
        return ground_points(self.landscape, self.lens, self.pose, col, row)

    def pixels(self, places: Floats) -> tuple[Floats, Floats]:
        """Return the columns and rows (n,) of the pixels that show positions."""
        col, row = pixels_of(self.lens, self.pose, offsets_m(self.landscape, self.pose, places))
        inside = (np.abs(col - (self.lens.width - 1) / 2.0) <= self.lens.width / 2.0) & (
            np.abs(row - (self.lens.height - 1) / 2.0) <= self.lens.height / 2.0
        )
        inside[inside] = ~hidden(self.landscape, self.pose, places[inside])
        return np.where(inside, col, np.nan), np.where(inside, row, np.nan)

    def covariances(self, places: Floats) -> Floats:
        """Return the covariances of positions."""
        effects = pose_effects(self.landscape, self.pose, places)
        sds_m = elevation_sds_m(self.landscape, places, self.elevation_sd_m)
        return covariances(effects, self.covariance, sds_m)


class CornerProjection(NamedTuple):
    """A projective transformation determined by the positions of an image's corners."""

    landscape: Landscape
    matrix: Floats  # (3, 3)
    sd_m: float  # along each axis

    def places(self, col: Floats, row: Floats) -> Floats:
        """Return the positions of pixels."""
        return corner_places(self.landscape, self.matrix, col, row)

    def pixels(self, places: Floats) -> tuple[Floats, Floats]:
        """Return the columns and rows (n,) of the pixels that show positions."""
        projected = (
            np.column_stack([places, np.ones(places.shape[0])]) @ np.linalg.inv(self.matrix).T
        )
        projected[projected[:, 2] <= 0.0] = np.nan  # beyond the horizon of the plane
        return projected[:, 0] / projected[:, 2], projected[:, 1] / projected[:, 2]

    def covariances(self, places: Floats) -> Floats:
        """Return the covariances of positions, which are the same for all positions."""
        found = np.tile(np.eye(2) * self.sd_m**2, (places.shape[0], 1, 1))
        found[np.isnan(places[:, 0])] = np.nan
        return found


def projection_of(
    image: ThermalImage, landscape: Landscape, settings: ThermalCameraSection
) -> PoseProjection | CornerProjection:
    """Return the projection of an image.

    Raises FireModelError for implausible corner points, and without a focal length.
    """
    height, width = image.values.shape
    if image.corners is not None:
        matrix = homography(width, height, quadrilateral(landscape, image.corners))
        return CornerProjection(landscape, matrix, image.corners.sd_m)
    focal_px = image.focal_px
    if settings.field_of_view_deg is not None:
        focal_px = focal_px_of(settings.field_of_view_deg, width)
    if focal_px is None:
        raise FireModelError(
            "neither the file nor the vehicle reports the focal length; set "
            f"{settings.TABLE}.field_of_view_deg"
        )
    lens = Lens(width, height, focal_px, settings.distortion)
    errors = stated_errors(settings, image)
    pose = _pose_of(image, landscape)
    return PoseProjection(landscape, lens, pose, errors.covariance(), errors.elevation_sd_m)


def stated_errors(
    settings: ThermalCameraSection, pose: ThermalImage | TelemetryPose | None = None
) -> PoseErrors:
    """Return the standard deviations in the settings, combined with those of ``pose``."""
    position_sd_m, direction_sd_deg = (
        (0.0, 0.0) if pose is None else (pose.position_sd_m, pose.direction_sd_deg)
    )
    return PoseErrors(
        math.hypot(settings.position_sd_m, position_sd_m),
        settings.altitude_sd_m,
        math.hypot(settings.direction_sd_deg, direction_sd_deg),
        settings.elevation_sd_m,
    )


def _pose_of(image: ThermalImage, landscape: Landscape) -> CameraPose:
    x_m, y_m = landscape.xy_of_lat_lon(image.lat_deg, image.lon_deg)
    if not np.isfinite(x_m + y_m):
        raise FireModelError("the camera is not above the landscape")
    yaw_deg = landscape.grid_deg(image.yaw_deg)
    return CameraPose(
        float(x_m), float(y_m), image.altitude_amsl_m, yaw_deg, image.pitch_deg, image.roll_deg
    )
