"""The sensor ``camera_points``: single points of fire that cameras report over MAVLink.

CAMERA_THERMAL_RANGE contains the hottest point of a thermal image; the position of this point is
computed with the camera's pose from telemetry. CAMERA_TRACKING_GEO_STATUS contains the position of
a tracked object, which an operator selected because the object burns. Each point becomes one burned
cell. The limit ``hot_c``, the lens and the errors of the pose are those of
``estimate.thermal_frames``.
"""

import math
from collections import deque

import numpy as np

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.events import AnyEvent, HotPointSeen, Observed, TargetTracked, Telemetry
from mission_service.sensors.thermal.camera_geometry import (
    CameraPose,
    Lens,
    focal_px_of,
)
from mission_service.sensors.thermal.ground_projections import PoseProjection, stated_errors
from mission_service.sensors.thermal.telemetry_poses import (
    PoseUnknownError,
    TelemetryPose,
    TelemetryPoses,
)

TELEMETRY_DELAY_US = 3_000_000
MAX_AGE_US = 60_000_000  # of a point, if its vehicle reports no more positions
TRACKED_SD_M = 10.0  # if the camera does not report the error
MAX_WAITING = 20
WIDTH = 640  # pixels into which the horizontal field of view is divided


class CameraPoints:
    """The hot points and tracked objects of all vehicles' cameras."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        self._settings = scenario.estimate.thermal_frames
        self._landscape = landscape
        self._poses = TelemetryPoses(self._settings.fixed_pitch_deg, self._settings.file_time_sd_s)
        self._waiting: deque[HotPointSeen | TargetTracked] = deque(maxlen=MAX_WAITING)
        self.problem = ""  # why the last point could not be used

    def on_event(self, event: AnyEvent) -> None:
        """Store telemetry, hot points and tracked objects."""
        if isinstance(event, HotPointSeen | TargetTracked):
            self._waiting.append(event)
        else:
            self._poses.on_event(event, event.at_us / 1e6)

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return the next point of a vehicle, or None until the telemetry for it has arrived."""
        self._expire(fix.at_us)
        point = next((each for each in self._waiting if each.vehicle == fix.vehicle), None)
        if point is None or point.at_us > fix.at_us:
            return None
        try:
            row, col, sd_m = self._place_of(point)
        except PoseUnknownError as error:
            if fix.at_us - point.at_us < TELEMETRY_DELAY_US:
                return None
            self._refuse(point, str(error))
            return None
        except FireModelError as error:
            self._refuse(point, str(error))
            return None
        self._waiting.remove(point)
        self.problem = ""
        return Observed(point.at_us, fix.vehicle, row, col, ("b",), position_sd_m=round(sd_m, 2))

    def _expire(self, at_us: int) -> None:
        """Remove the points that have waited too long."""
        for point in list(self._waiting):
            if at_us - point.at_us > MAX_AGE_US:
                self._refuse(point, f"no position arrived within {MAX_AGE_US / 1e6:.0f} s")

    def _refuse(self, point: HotPointSeen | TargetTracked, reason: str) -> None:
        self._waiting.remove(point)
        self.problem = f"a point from {point.vehicle} is not used: {reason}"

    def _place_of(self, point: HotPointSeen | TargetTracked) -> tuple[int, int, float]:
        """Return the row and column of a point's cell, and the point's standard deviation."""
        land = self._landscape
        if isinstance(point, TargetTracked):
            x_m, y_m = land.xy_of_lat_lon(point.lat_deg, point.lon_deg)
            if not land.contains(x_m, y_m):
                raise FireModelError("it is not on the landscape")
            row, col = (round(float(each)) for each in land.row_col_of(x_m, y_m))
            sd_m = TRACKED_SD_M if point.horizontal_sd_m is None else point.horizontal_sd_m
            return row, col, sd_m
        pose = self._poses.pose_at(point.vehicle, point.at_us)
        lens = self._lens(point.vehicle, pose)
        pixel = (
            np.array([point.x * lens.width - 0.5]),
            np.array([point.y * lens.height - 0.5]),
        )
        x_m, y_m = land.xy_of_lat_lon(pose.lat_deg, pose.lon_deg)
        yaw_deg, pitch_deg, roll_deg = pose.direction
        place = (float(x_m), float(y_m), pose.altitude_amsl_m)
        camera = CameraPose(*place, float(land.grid_deg(yaw_deg)), pitch_deg, roll_deg)
        errors = stated_errors(self._settings, pose)
        projection = PoseProjection(land, lens, camera, errors.covariance(), errors.elevation_sd_m)
        cells = projection.places(*pixel)
        if not np.isfinite(cells).all():
            raise FireModelError("it shows no ground of the landscape")
        (cell,), (spread,) = cells, projection.covariances(cells)
        if not np.isfinite(spread).all():
            raise FireModelError("its position error is unknown")
        return round(float(cell[0])), round(float(cell[1])), math.sqrt(np.trace(spread) / 2.0)

    def _lens(self, vehicle: str, pose: TelemetryPose) -> Lens:
        horizontal_deg = self._settings.field_of_view_deg or pose.field_of_view_deg
        vertical_deg = self._poses.vertical_deg_of(vehicle)
        if horizontal_deg is None:
            raise FireModelError(
                "the camera does not report its field of view; set "
                "estimate.thermal_frames.field_of_view_deg"
            )
        focal_px = focal_px_of(horizontal_deg, WIDTH)
        height = 0.8 * WIDTH  # as in thermal detectors (640 x 512)
        if vertical_deg is not None:
            height = 2.0 * focal_px * math.tan(math.radians(vertical_deg) / 2.0)
        return Lens(WIDTH, round(height), focal_px, self._settings.distortion)
