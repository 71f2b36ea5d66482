"""Read packets of MISB ST 0601 metadata: time, camera pose and corner points of a video frame.

``tstrans`` decodes the packets and verifies their checksums. Values that are marked as errors or as
out of range count as missing. Pure.
"""

import math
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mission_service.config.fire_sections import ThermalVideoSection
from mission_service.errors import MissionServiceError
from mission_service.sensors.thermal.camera_geometry import CameraPose, axes_of, mounted_direction
from mission_service.sensors.thermal.image_corners import CornerPoints

if TYPE_CHECKING:
    from tstrans.klv import UasDatalinkLs

KEY_BYTES = 16
EPOCH, LATEST = datetime(1970, 1, 1, tzinfo=UTC), datetime(2100, 1, 1, tzinfo=UTC)
HEADING, PITCH, ROLL, FULL_PITCH, FULL_ROLL = 5, 6, 7, 90, 91  # platform tags
LAT, LON, ALTITUDE, HEIGHT, EXTENDED_HEIGHT = 13, 14, 15, 75, 104  # sensor tags
FIELD_OF_VIEW, VERTICAL_FIELD_OF_VIEW, AZIMUTH, ELEVATION, TURN = 16, 17, 18, 19, 20
CENTRE_LAT, CENTRE_LON = 23, 24  # frame tags
OFFSETS, CORNERS = range(26, 34), range(82, 90)  # latitude and longitude of four corners
FIELDS = {
    HEADING: "platform_heading_deg",
    PITCH: "platform_pitch_deg",
    ROLL: "platform_roll_deg",
    LAT: "sensor_lat_deg",
    LON: "sensor_lon_deg",
    ALTITUDE: "sensor_alt_m",
    FIELD_OF_VIEW: "sensor_hfov_deg",
    VERTICAL_FIELD_OF_VIEW: "sensor_vfov_deg",
    AZIMUTH: "sensor_rel_az_deg",
    ELEVATION: "sensor_rel_el_deg",
    TURN: "sensor_rel_roll_deg",
    CENTRE_LAT: "frame_center_lat_deg",
    CENTRE_LON: "frame_center_lon_deg",
    HEIGHT: "sensor_ellipsoid_height_m",
    FULL_PITCH: "platform_pitch_full_deg",
    FULL_ROLL: "platform_roll_full_deg",
    EXTENDED_HEIGHT: "sensor_ellipsoid_height_extended_m",
    **{
        tag: f"corner_{'lon' if number % 2 else 'lat'}{middle}_p{number // 2 + 1}_deg"
        for tags, middle in ((OFFSETS, "_offset"), (CORNERS, ""))
        for number, tag in enumerate(tags)
    },
}

# Limits on the change between two packets: a constant, and an increase per second between them.
MAX_BREAK_S = 60.0
MAX_MOVE_DEG = (0.0002, 0.003)  # latitude and longitude of the camera; 300 m/s
MAX_CLIMB_M = (10.0, 100.0)
MAX_TURN_DEG = (3.0, 180.0)
MAX_CORNER_DEG = (0.002, 0.05)


class VideoMetadataError(MissionServiceError):
    """A damaged or unusable packet of metadata; the message gives the reason."""


class SensorPose(NamedTuple):
    """The pose of a camera from metadata."""

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    yaw_deg: float  # clockwise from true north
    pitch_deg: float  # -90: straight down
    roll_deg: float


class VideoMetadata(NamedTuple):
    """The values of one packet for the video frame at the time of the packet."""

    taken: datetime
    pose: SensorPose | None
    no_pose: str  # why there is no pose; otherwise empty
    field_of_view_deg: float | None  # horizontal
    vertical_field_of_view_deg: float | None
    corners: CornerPoints | None


def is_uas_metadata(payload: bytes) -> bool:
    """Return True if a payload begins with the key of an ST 0601 set."""
    from tstrans.klv import is_st0601_family

    return len(payload) >= KEY_BYTES and is_st0601_family(payload[:KEY_BYTES])


def read_metadata(packet: bytes, settings: ThermalVideoSection) -> VideoMetadata:
    """Read a packet of ST 0601, including the key at its beginning.

    Raises VideoMetadataError for a damaged packet, and for one without a plausible time.
    """
    from tstrans.exceptions import KlvError
    from tstrans.klv import decode_uas_datalink

    try:
        fields = decode_uas_datalink(packet)
    except KlvError as error:
        raise VideoMetadataError(str(error)) from None
    values = _values_in(fields)
    pose, no_pose = _pose_of(values, settings)
    return VideoMetadata(
        _taken(fields, settings),
        pose,
        no_pose,
        values.get(FIELD_OF_VIEW),
        values.get(VERTICAL_FIELD_OF_VIEW),
        _corners_of(values, settings.corner_sd_m),
    )


def is_continuous(one: VideoMetadata, other: VideoMetadata) -> bool:
    """Return True if an aircraft and its camera can move this far between two packets.

    The checksum, a sum of 16 bits, does not detect all damage. Damaged values usually differ much
    from those of the packets before and after.
    """
    seconds = abs((other.taken - one.taken).total_seconds())
    changes = []
    if one.pose is not None and other.pose is not None:
        moves = np.abs(np.subtract(one.pose[:2], other.pose[:2])).max()
        changes.append((moves, MAX_MOVE_DEG))
        changes.append((abs(one.pose[2] - other.pose[2]), MAX_CLIMB_M))
        changes.append((_turn_deg(one.pose, other.pose), MAX_TURN_DEG))
    if one.corners is not None and other.corners is not None:
        corners = np.subtract(one.corners.lat_lon_deg, other.corners.lat_lon_deg)
        changes.append((np.abs(corners).max(), MAX_CORNER_DEG))
    return seconds <= MAX_BREAK_S and all(
        change <= at_once + rate * seconds for change, (at_once, rate) in changes
    )


def _turn_deg(one: SensorPose, other: SensorPose) -> float:
    """Return the angle of the rotation between two directions."""
    before, after = (axes_of(CameraPose(0.0, 0.0, 0.0, *pose[3:])) for pose in (one, other))
    cosine = (np.trace(before @ after.T) - 1.0) / 2.0
    return math.degrees(math.acos(float(np.clip(cosine, -1.0, 1.0))))


def _values_in(fields: "UasDatalinkLs") -> dict[int, float]:
    """Return the values by tag, without those that are marked as errors or as out of range."""
    found = {tag: getattr(fields, name) for tag, name in FIELDS.items()}
    marked = fields.sentinel_tags
    return {tag: value for tag, value in found.items() if value is not None and tag not in marked}


def _taken(fields: "UasDatalinkLs", settings: ThermalVideoSection) -> datetime:
    """Return the time in UTC. Raises VideoMetadataError for a missing or implausible time."""
    if fields.timestamp_us is None:
        raise VideoMetadataError("tag 2, the time stamp, is missing or damaged")
    leap_s = settings.leap_seconds if fields.leap_seconds is None else fields.leap_seconds
    at_us = fields.timestamp_us + (fields.correction_offset_us or 0) - leap_s * 1_000_000
    try:
        taken = EPOCH + timedelta(microseconds=at_us)
    except OverflowError:
        taken = LATEST
    if not EPOCH < taken < LATEST:
        raise VideoMetadataError(f"tag 2, the time stamp, is {fields.timestamp_us} µs")
    return taken


def _pose_of(
    values: Mapping[int, float], settings: ThermalVideoSection
) -> tuple[SensorPose | None, str]:
    """Return the pose and an empty text, or None and the reason."""
    whole = {PITCH: values.get(FULL_PITCH), ROLL: values.get(FULL_ROLL)}
    values = {**values, **{tag: value for tag, value in whole.items() if value is not None}}
    needed = (HEADING, PITCH, ROLL, AZIMUTH, ELEVATION, TURN, LAT, LON)
    if missing := [str(tag) for tag in needed if tag not in values]:
        return None, f"tags missing or out of range: {', '.join(missing)}"
    heading, pitch, roll, azimuth, elevation, turn, lat_deg, lon_deg = (
        values[tag] for tag in needed
    )
    altitude_m = values.get(ALTITUDE)
    height_m = values.get(EXTENDED_HEIGHT, values.get(HEIGHT))
    if altitude_m is None and height_m is not None and settings.geoid_m is not None:
        altitude_m = height_m - settings.geoid_m
    if altitude_m is None:
        needs = f"; tag {HEIGHT} requires {settings.TABLE}.geoid_m" if height_m is not None else ""
        return None, f"tag missing or out of range: {ALTITUDE}{needs}"
    direction = mounted_direction((heading, pitch, roll), (azimuth, elevation, turn))
    return SensorPose(lat_deg, lon_deg, altitude_m, *direction), ""


def _corners_of(values: Mapping[int, float], sd_m: float) -> CornerPoints | None:
    """Return the corner points from their own tags, or else from offsets to the frame centre."""
    if all(tag in values for tag in CORNERS):
        flat = [values[tag] for tag in CORNERS]
    elif all(tag in values for tag in (CENTRE_LAT, CENTRE_LON, *OFFSETS)):
        centre = (values[CENTRE_LAT], values[CENTRE_LON]) * 4
        flat = [values[tag] + start for tag, start in zip(OFFSETS, centre, strict=True)]
    else:
        return None
    return CornerPoints(tuple(zip(flat[::2], flat[1::2], strict=True)), sd_m)
