"""Find the camera's pose at the time of an image from the vehicles' telemetry. Pure.

A report of an image (``ImageCaptured``) belongs to a file if the report contains the name of the
file, or if both have the same time in UTC. Without such a report, the position and the direction
are interpolated at the time of the file. Times of files are in UTC; they are converted to mission
time using the times at which positions were received.
"""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import NamedTuple, TypeVar

from mission_service.errors import MissionServiceError
from mission_service.events import (
    AnyEvent,
    CameraDirection,
    CameraFieldOfView,
    ImageCaptured,
    Telemetry,
)
from mission_service.sensors.thermal.camera_geometry import Angles, tilted

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
SAMPLES = 4000  # per vehicle: a quarter of an hour at 4 Hz
SAME_TIME_S = 0.6  # many cameras store whole seconds
MAX_GAP_S = 2.5  # maximum between interpolated samples
TRIGGER_SD_S = 0.05  # for the time of a reported image

Sample = TypeVar("Sample", Telemetry, CameraDirection)


class PoseUnknownError(MissionServiceError):
    """The telemetry does not contain the pose; the message states the reason."""


class TelemetryPose(NamedTuple):
    """The pose of a camera from telemetry, with the errors due to the error of the image's time."""

    taken: datetime
    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    direction: Angles
    field_of_view_deg: float | None
    position_sd_m: float
    direction_sd_deg: float


class _Vehicle:
    """The latest telemetry of one vehicle."""

    def __init__(self) -> None:
        self.clock: deque[tuple[int, float]] = deque(maxlen=SAMPLES)  # mission us, UTC s
        self.fixes: deque[Telemetry] = deque(maxlen=SAMPLES)
        self.directions: deque[CameraDirection] = deque(maxlen=SAMPLES)
        self.images: deque[ImageCaptured] = deque(maxlen=SAMPLES)
        self.field_of_view_deg: float | None = None
        self.vertical_deg: float | None = None


class TelemetryPoses:
    """The latest telemetry of all vehicles; one thread adds events, another reads poses."""

    def __init__(self, fixed_pitch_deg: float | None, file_time_sd_s: float) -> None:
        """Set the pitch, relative to the airframe, of cameras without a gimbal; None if unknown.

        ``file_time_sd_s`` is the standard deviation of the times of files.
        """
        self._fixed_pitch_deg = fixed_pitch_deg
        self._file_time_sd_s = file_time_sd_s
        self._vehicles: dict[str, _Vehicle] = {}

    def on_event(self, event: AnyEvent, received_s: float) -> None:
        """Add an event that was received at ``received_s``, a time in UTC."""
        if not isinstance(event, Telemetry | CameraDirection | ImageCaptured | CameraFieldOfView):
            return
        vehicle = self._vehicles.setdefault(event.vehicle, _Vehicle())
        match event:
            case Telemetry():
                vehicle.clock.append((event.at_us, received_s))
                vehicle.fixes.append(event)
            case CameraDirection():
                vehicle.directions.append(event)
            case ImageCaptured():
                vehicle.images.append(event)
            case CameraFieldOfView():
                vehicle.field_of_view_deg = event.horizontal_deg
                vehicle.vertical_deg = event.vertical_deg

    def mission_us_of(self, taken_s: float) -> int | None:
        """Return the mission time for a time in UTC; None before or after the telemetry."""
        for vehicle in self._copies():
            times = list(vehicle.clock)
            place = bisect_right(times, taken_s, key=lambda each: each[1])
            if 0 < place < len(times):
                (before_us, before_s), (after_us, after_s) = times[place - 1], times[place]
                share = (taken_s - before_s) / max(after_s - before_s, 1e-6)
                return round(before_us + share * (after_us - before_us))
        return None

    def pose_of(self, name: str, taken: datetime | None) -> TelemetryPose:
        """Return the pose of the camera for a file; ``taken`` is the file's time, if known.

        Raises PoseUnknownError; the telemetry may arrive later than the file.
        """
        reported = self._reported(name, taken)
        if reported is not None:
            return self._of_report(*reported)
        if taken is None:
            raise PoseUnknownError("the vehicles have reported no image with this name")
        return self._interpolated(taken)

    def vertical_deg_of(self, vehicle: str) -> float | None:
        """Return the vertical field of view of a vehicle's camera; None if unknown."""
        found = self._vehicles.get(vehicle)
        return None if found is None else found.vertical_deg

    def pose_at(self, vehicle: str, at_us: int) -> TelemetryPose:
        """Return the pose of a vehicle's camera at a mission time; raises PoseUnknownError."""
        found = self._vehicles.get(vehicle)
        if found is None:
            raise PoseUnknownError("no telemetry has arrived yet")
        return self._interpolated_at(found, at_us, EPOCH)

    def _copies(self) -> list[_Vehicle]:
        return list(self._vehicles.values())

    def _reported(
        self, name: str, taken: datetime | None
    ) -> tuple[_Vehicle, ImageCaptured, datetime] | None:
        """Return the report of an image with its vehicle and time in UTC, or None.

        A report without the name of a file is used only if no other report is similarly close in
        time.
        """
        images = [(vehicle, image) for vehicle in self._copies() for image in list(vehicle.images)]
        named = [each for each in images if each[1].file_name.lower() == name.lower()]
        if named:
            vehicle, image = named[-1]
            utc_s = _utc_s(vehicle, image)
            if math.isfinite(utc_s):  # the clock of the camera may be wrong
                taken = EPOCH + timedelta(seconds=utc_s)
            return None if taken is None else (vehicle, image, taken)
        if taken is None:
            return None
        off_s = [
            (abs(_utc_s(vehicle, image) - taken.timestamp()), number)
            for number, (vehicle, image) in enumerate(images)
            if not image.file_name
        ]
        near = sorted(each for each in off_s if each[0] < 2.0 * SAME_TIME_S)
        if len(near) != 1 or near[0][0] > SAME_TIME_S:
            return None
        return *images[near[0][1]], taken

    def _of_report(self, vehicle: _Vehicle, image: ImageCaptured, taken: datetime) -> TelemetryPose:
        at_us = image.at_us
        if image.direction is None:
            direction, turn_deg_s = self._direction_at(vehicle, at_us)
        else:
            direction = self._of_camera(image.direction, image.gimbal)
            turn_deg_s = _turn_deg_s(vehicle, at_us)
        speed_m_s = _speed_m_s(vehicle, at_us)
        place = (image.lat_deg, image.lon_deg, image.altitude_amsl_m)
        return TelemetryPose(
            *(taken, *place, direction, vehicle.field_of_view_deg),
            *(speed_m_s * TRIGGER_SD_S, turn_deg_s * TRIGGER_SD_S),
        )

    def _interpolated(self, taken: datetime) -> TelemetryPose:
        vehicles = [each for each in self._copies() if each.fixes]
        if len(vehicles) != 1:
            raise PoseUnknownError(
                "no vehicle has reported the image; poses without a report require a single vehicle"
            )
        (vehicle,) = vehicles
        at_us = self.mission_us_of(taken.timestamp())
        if at_us is None:
            raise PoseUnknownError(f"no telemetry at {taken:%H:%M:%S} UTC")
        return self._interpolated_at(vehicle, at_us, taken)

    def _interpolated_at(self, vehicle: _Vehicle, at_us: int, taken: datetime) -> TelemetryPose:
        before, after, share = _around(list(vehicle.fixes), at_us, "position")
        lat_deg, lon_deg, altitude_m = (
            (1.0 - share) * getattr(before, key) + share * getattr(after, key)
            for key in ("lat_deg", "lon_deg", "altitude_amsl_m")
        )
        direction, turn_deg_s = self._direction_at(vehicle, at_us)
        speed_m_s = math.hypot(before.velocity_north_m_s, before.velocity_east_m_s)
        return TelemetryPose(
            *(taken, lat_deg, lon_deg, altitude_m, direction, vehicle.field_of_view_deg),
            *(speed_m_s * self._file_time_sd_s, turn_deg_s * self._file_time_sd_s),
        )

    def _direction_at(self, vehicle: _Vehicle, at_us: int) -> tuple[Angles, float]:
        """Return the direction of the camera at a mission time, and its turn rate in degrees/s."""
        before, after, share = _around(list(vehicle.directions), at_us, "direction")
        yaw_deg = before.yaw_deg + share * _turned(before.yaw_deg, after.yaw_deg)
        pitch_deg, roll_deg = (
            getattr(before, key) + share * _turned(getattr(before, key), getattr(after, key))
            for key in ("pitch_deg", "roll_deg")
        )
        angles = (yaw_deg % 360.0, pitch_deg, roll_deg)
        return self._of_camera(angles, before.gimbal), _rate_deg_s(before, after)

    def _of_camera(self, angles: Angles, gimbal: bool) -> Angles:
        if gimbal:
            return angles
        if self._fixed_pitch_deg is None:
            raise PoseUnknownError(
                "the vehicle reports no gimbal; set estimate.thermal_frames.fixed_pitch_deg for "
                "a camera that is fixed to the airframe"
            )
        return tilted(angles, self._fixed_pitch_deg)


def _utc_s(vehicle: _Vehicle, image: ImageCaptured) -> float:
    """Return the reported time of an image in UTC, or else that derived from positions."""
    if image.taken_utc_us is not None:
        return image.taken_utc_us / 1e6
    times = list(vehicle.clock)
    place = bisect_right(times, image.at_us, key=lambda each: each[0])
    if not times:
        return math.nan
    at_us, utc_s = times[max(place - 1, 0)]
    return utc_s + (image.at_us - at_us) / 1e6


def _around(samples: Sequence[Sample], at_us: int, what: str) -> tuple[Sample, Sample, float]:
    """Return the samples before and after a mission time, and the weight of the second sample."""
    place = bisect_right(samples, at_us, key=_at_us)
    if not 0 < place < len(samples):
        raise PoseUnknownError(f"no {what} at mission time {at_us / 1e6:.1f} s")
    before, after = samples[place - 1], samples[place]
    gap_us = after.at_us - before.at_us
    if gap_us > MAX_GAP_S * 1e6:
        raise PoseUnknownError(
            f"no {what} for {gap_us / 1e6:.1f} s around mission time {at_us / 1e6:.1f} s"
        )
    return before, after, (at_us - before.at_us) / max(gap_us, 1)


def _at_us(event: Telemetry | CameraDirection) -> int:
    return event.at_us


def _turned(before_deg: float, after_deg: float) -> float:
    return (after_deg - before_deg + 180.0) % 360.0 - 180.0


def _rate_deg_s(before: CameraDirection, after: CameraDirection) -> float:
    passed_s = max((after.at_us - before.at_us) / 1e6, 0.05)
    keys = ("yaw_deg", "pitch_deg", "roll_deg")
    turns = [_turned(getattr(before, key), getattr(after, key)) for key in keys]
    return math.hypot(*turns) / passed_s


def _turn_deg_s(vehicle: _Vehicle, at_us: int) -> float:
    """Return the turn rate of the camera near a mission time; 0 if unknown."""
    samples = list(vehicle.directions)
    place = min(max(bisect_right(samples, at_us, key=_at_us), 1), len(samples) - 1)
    return _rate_deg_s(samples[place - 1], samples[place]) if len(samples) > 1 else 0.0


def _speed_m_s(vehicle: _Vehicle, at_us: int) -> float:
    fixes = list(vehicle.fixes)
    if not fixes:
        return 0.0
    fix = fixes[max(bisect_right(fixes, at_us, key=_at_us) - 1, 0)]
    return math.hypot(fix.velocity_north_m_s, fix.velocity_east_m_s)
