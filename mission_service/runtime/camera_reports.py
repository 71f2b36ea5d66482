"""Converts camera and gimbal reports to events for the sensors. Pure.

These events occur only in runs with sensors. The camera direction is computed for each ATTITUDE
message from the vehicle. The direction is reported ``MIN_INTERVAL_US`` after the last report if it
has changed by ``CHANGED_DEG``, and ``EVERY_US`` after the last report in any case. The error in a
reported direction therefore exceeds ``CHANGED_DEG`` for at most ``MIN_INTERVAL_US``.
"""

from autopilot_bridge.vehicle import camera_telemetry as camera
from autopilot_bridge.vehicle.client_events import Attitude
from mission_service.events import (
    CameraDirection,
    CameraFieldOfView,
    HotPointSeen,
    ImageCaptured,
    TargetTracked,
)

CHANGED_DEG, EVERY_US = 0.5, 1_000_000
MIN_INTERVAL_US = 200_000
GIMBAL_LASTS_US = 1_000_000  # PX4 also uses a gimbal's report for one second
FIELD_OF_VIEW_CHANGED_DEG = 0.05

Angles = tuple[float, float, float]


class CameraReports:
    """The camera of one vehicle; the age of a gimbal report is measured on the link's clock."""

    def __init__(self, name: str, hot_c: float) -> None:
        """Set the vehicle's name and the minimum temperature of hot points."""
        self._name = name
        self._hot_c = hot_c
        self._hot_point_us = self._target_us = -EVERY_US  # times of the last reports
        self._gimbal: camera.GimbalAttitude | None = None
        self._heading_deg: float | None = None
        self._reported: CameraDirection | None = None
        self._field_of_view_deg: float | None = None

    def on_gimbal(self, event: camera.GimbalAttitude) -> None:
        """Store the direction of the gimbal for the next ATTITUDE message or image."""
        self._gimbal = event

    def on_attitude(self, event: Attitude, mission_us: int) -> CameraDirection | None:
        """Return the camera's direction at the given mission time, or None if no report is due."""
        self._heading_deg = event.yaw_deg
        airframe = (event.yaw_deg, event.pitch_deg, event.roll_deg)
        gimbal = self._gimbal_angles(event.at_us)
        angles = airframe if gimbal is None else gimbal
        now = CameraDirection(mission_us, self._name, *_rounded(angles), gimbal is not None)
        if self._reported is not None and not _differs(self._reported, now):
            return None
        self._reported = now
        return now

    def on_image(self, event: camera.ImageCaptured, mission_us: int) -> ImageCaptured:
        """Return the image with the direction of the camera, if the direction is known.

        With an image, an autopilot reports the attitude of the airframe or, on PX4, that of the
        gimbal. If the gimbal has reported its direction, that direction replaces the attitude of
        the airframe.
        """
        angles, gimbal = event.angles, not event.of_vehicle
        if event.of_vehicle and (found := self._gimbal_angles(event.at_us)) is not None:
            angles, gimbal = found, True
        return ImageCaptured(
            mission_us,
            self._name,
            event.lat_deg,
            event.lon_deg,
            round(event.altitude_amsl_m, 2),
            None if angles is None else _rounded(angles),
            gimbal,
            event.image_index,
            event.file_name,
            event.taken_utc_us,
        )

    def on_field_of_view(
        self, event: camera.FieldOfView, mission_us: int
    ) -> CameraFieldOfView | None:
        """Return the field of view if it has changed, or None."""
        before, now_deg = self._field_of_view_deg, round(event.horizontal_deg, 2)
        vertical_deg = None if event.vertical_deg is None else round(event.vertical_deg, 2)
        if before is not None and abs(now_deg - before) < FIELD_OF_VIEW_CHANGED_DEG:
            return None
        self._field_of_view_deg = now_deg
        return CameraFieldOfView(mission_us, self._name, now_deg, vertical_deg)

    def on_hottest(self, event: camera.HottestPoint, mission_us: int) -> HotPointSeen | None:
        """Return an image's hottest point if it reaches the minimum temperature, or None.

        A point is returned at most once a second.
        """
        if event.max_c < self._hot_c or 0 <= mission_us - self._hot_point_us < EVERY_US:
            return None
        self._hot_point_us = mission_us
        place = (round(event.x, 4), round(event.y, 4))
        return HotPointSeen(mission_us, self._name, round(event.max_c, 1), *place)

    def on_target(self, event: camera.TrackedPlace, mission_us: int) -> TargetTracked | None:
        """Return the position of a tracked object, at most once a second, or None."""
        if 0 <= mission_us - self._target_us < EVERY_US:
            return None
        self._target_us = mission_us
        place = (event.lat_deg, event.lon_deg, event.horizontal_sd_m)
        return TargetTracked(mission_us, self._name, *place)

    def _gimbal_angles(self, now_us: int) -> Angles | None:
        """Return the gimbal's direction, with yaw measured from north, or None if unknown."""
        gimbal = self._gimbal
        if gimbal is None or now_us - gimbal.at_us > GIMBAL_LASTS_US:
            return None
        yaw_deg, pitch_deg, roll_deg = gimbal.angles
        if not gimbal.from_north:
            if self._heading_deg is None:
                return None
            yaw_deg += self._heading_deg
        return yaw_deg, pitch_deg, roll_deg


def _differs(before: CameraDirection, now: CameraDirection) -> bool:
    """Return whether the direction ``now`` must be reported, given the last report ``before``."""
    passed_us = now.at_us - before.at_us
    if not 0 <= passed_us < EVERY_US or now.gimbal != before.gimbal:
        return True
    if passed_us < MIN_INTERVAL_US:
        return False
    pairs = (
        (before.yaw_deg, now.yaw_deg),
        (before.pitch_deg, now.pitch_deg),
        (before.roll_deg, now.roll_deg),
    )
    return any(abs((b - a + 180.0) % 360.0 - 180.0) >= CHANGED_DEG for a, b in pairs)


def _rounded(angles: Angles) -> Angles:
    yaw_deg, pitch_deg, roll_deg = angles
    return round(yaw_deg % 360.0, 2), round(pitch_deg, 2), round(roll_deg, 2)
