"""Decodes the reports of a vehicle's cameras and gimbals.

PX4 1.17 sends CAMERA_IMAGE_CAPTURED with the direction of the gimbal, or with the vehicle's
attitude if no gimbal reports its own (``CameraFeedback.cpp``). ArduPilot 4.6.2 sends
CAMERA_FEEDBACK with the vehicle's attitude and the time in UTC, or the time since boot if a
feedback pin is used (``AP_Camera_Backend.cpp``). Cameras and gimbals with a component id of their
own send the same messages. All directions are Euler angles in degrees: the yaw from north or from
the vehicle's heading, the pitch from the horizon (-90: straight down), and the roll about the line
of sight.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.links.field_limits import out_of_bounds

YAW_FROM_NORTH = (
    mavlink.GIMBAL_DEVICE_FLAGS_YAW_LOCK | mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME
)
LOCKED_DEG = 89.9  # nearer to the vertical, yaw and roll cannot be distinguished
NO_PLACE = 2**31 - 1
YEAR_2000_US = 946_684_800_000_000  # earlier times are times since boot

Angles = tuple[float, float, float]  # yaw, pitch, roll in degrees


@dataclass(frozen=True, slots=True)
class ImageCaptured:
    """A camera has taken an image; ``boot_us`` or ``taken_utc_us`` is None if unknown.

    ``angles`` is the direction of the camera, or of the vehicle if ``of_vehicle`` is set; None if
    unknown. ``file_name`` is empty if the camera does not report it.
    """

    at_us: int
    boot_us: int | None
    taken_utc_us: int | None
    image_index: int
    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    angles: Angles | None
    of_vehicle: bool
    file_name: str


@dataclass(frozen=True, slots=True)
class GimbalAttitude:
    """The direction of a gimbal; the yaw is from north if ``from_north``, else from the heading."""

    at_us: int
    angles: Angles
    from_north: bool


@dataclass(frozen=True, slots=True)
class FieldOfView:
    """The field of view of a camera in degrees; ``vertical_deg`` is None if unknown."""

    at_us: int
    horizontal_deg: float
    vertical_deg: float | None = None


@dataclass(frozen=True, slots=True)
class HottestPoint:
    """The hottest point of a thermal image; x and y are fractions of its size from the top left."""

    at_us: int
    max_c: float
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class TrackedPlace:
    """The ground position of the tracked object; ``horizontal_sd_m`` is None if unknown."""

    at_us: int
    lat_deg: float
    lon_deg: float
    horizontal_sd_m: float | None


CameraEvent = ImageCaptured | GimbalAttitude | FieldOfView | HottestPoint | TrackedPlace


def angles_of(q: Sequence[float]) -> Angles | None:
    """Return the yaw, pitch and roll of a quaternion (w, x, y, z) in degrees; None if invalid.

    If the line of sight is vertical, the roll is 0 and the yaw is that of the top of the image.
    """
    size = math.sqrt(math.fsum(each * each for each in q))
    if not 0.9 < size < 1.1:  # also for NaN
        return None
    w, x, y, z = (each / size for each in q)
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    if abs(math.degrees(pitch)) > LOCKED_DEG:
        yaw = math.atan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (x * x + z * z))
        return math.degrees(yaw) % 360.0, math.degrees(pitch), 0.0
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return math.degrees(yaw) % 360.0, math.degrees(pitch), math.degrees(roll)


def image_captured(message: Message, at_us: int) -> ImageCaptured | None:
    """Decode a CAMERA_IMAGE_CAPTURED; return None if the capture failed or has no position."""
    if message.capture_result != 1 or not (message.lat or message.lon):
        return None
    return ImageCaptured(
        at_us,
        message.time_boot_ms * 1000 if _of_autopilot(message) else None,
        message.time_utc if message.time_utc > YEAR_2000_US else None,
        message.image_index,
        message.lat / 1e7,
        message.lon / 1e7,
        message.alt / 1e3,
        angles_of(message.q),
        _of_autopilot(message),
        str(message.file_url).rstrip("\0").replace("\\", "/").rsplit("/", 1)[-1],
    )


def camera_feedback(message: Message, at_us: int) -> ImageCaptured | None:
    """Decode a CAMERA_FEEDBACK; return None if it has no position."""
    if not (message.lat or message.lng):
        return None
    in_utc = message.time_usec > YEAR_2000_US
    return ImageCaptured(
        at_us,
        None if in_utc else message.time_usec,
        message.time_usec if in_utc else None,
        message.img_idx,
        message.lat / 1e7,
        message.lng / 1e7,
        message.alt_msl,
        (message.yaw % 360.0, message.pitch, message.roll),
        True,
        "",
    )


def gimbal_attitude(message: Message, at_us: int) -> GimbalAttitude | None:
    """Decode a GIMBAL_DEVICE_ATTITUDE_STATUS; return None if it has no attitude."""
    angles = angles_of(message.q)
    if angles is None:
        return None
    in_vehicle_frame = message.flags & mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
    from_north = bool(message.flags & YAW_FROM_NORTH) and not in_vehicle_frame
    return GimbalAttitude(at_us, angles, from_north)


def mount_orientation(message: Message, at_us: int) -> GimbalAttitude:
    """Decode a MOUNT_ORIENTATION; the absolute yaw is NaN if unknown."""
    from_north = not math.isnan(message.yaw_absolute)
    yaw_deg = message.yaw_absolute if from_north else message.yaw
    return GimbalAttitude(at_us, (yaw_deg % 360.0, message.pitch, message.roll), from_north)


def fov_status(message: Message, at_us: int) -> FieldOfView | None:
    """Decode a CAMERA_FOV_STATUS; return None if it has no field of view."""
    return _field_of_view(message.hfov, message.vfov, at_us)


def camera_information(message: Message, at_us: int) -> FieldOfView | None:
    """Decode a CAMERA_INFORMATION; return None if it lacks the focal length or sensor width."""
    if not (message.focal_length > 0.0 and message.sensor_size_h > 0.0):
        return None
    horizontal_deg, vertical_deg = (
        math.degrees(2.0 * math.atan2(size_mm / 2.0, message.focal_length))
        for size_mm in (message.sensor_size_h, message.sensor_size_v)
    )
    return _field_of_view(horizontal_deg, vertical_deg, at_us)


def _field_of_view(horizontal_deg: float, vertical_deg: float, at_us: int) -> FieldOfView | None:
    if not 1.0 <= horizontal_deg <= 150.0:
        return None
    return FieldOfView(
        at_us, horizontal_deg, vertical_deg if 1.0 <= vertical_deg <= 150.0 else None
    )


def thermal_range(message: Message, at_us: int) -> HottestPoint | None:
    """Decode a CAMERA_THERMAL_RANGE; return None if it has no hottest point."""
    place = (message.max_point_x, message.max_point_y)
    if not (math.isfinite(message.max) and all(0.0 <= each <= 1.0 for each in place)):
        return None
    return HottestPoint(at_us, message.max, *place)


def tracked_place(message: Message, at_us: int) -> TrackedPlace | None:
    """Decode a CAMERA_TRACKING_GEO_STATUS; return None unless the camera tracks an object."""
    active = message.tracking_status == mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE
    if not active or NO_PLACE in (message.lat, message.lon) or not (message.lat or message.lon):
        return None
    sd_m = message.h_acc if 0.0 <= message.h_acc < 10_000.0 else None
    return TrackedPlace(at_us, message.lat / 1e7, message.lon / 1e7, sd_m)


def _of_autopilot(message: Message) -> bool:
    return bool(message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1)


_DECODERS = {
    "CAMERA_IMAGE_CAPTURED": image_captured,
    "CAMERA_FEEDBACK": camera_feedback,
    "GIMBAL_DEVICE_ATTITUDE_STATUS": gimbal_attitude,
    "MOUNT_ORIENTATION": mount_orientation,
    "CAMERA_FOV_STATUS": fov_status,
    "CAMERA_INFORMATION": camera_information,
    "CAMERA_THERMAL_RANGE": thermal_range,
    "CAMERA_TRACKING_GEO_STATUS": tracked_place,
}
MESSAGES = frozenset(_DECODERS)


def camera_event(message: Message, at_us: int) -> CameraEvent | None:
    """Return the event of a camera or gimbal message; None for other or implausible messages."""
    decode = _DECODERS.get(message.get_type())
    if decode is None or out_of_bounds(message) is not None:
        return None
    return decode(message, at_us)
