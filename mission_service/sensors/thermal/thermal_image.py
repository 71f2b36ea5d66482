"""Read thermal images: temperatures or grey levels, and the time and the pose in their metadata.

Files are TIFF with temperatures in °C (32-bit floats) or counts of a radiometric camera (16 bits),
or TIFF, JPEG and PNG with grey levels (8 bits). Positions and times are read from EXIF, and the
direction of the camera from DJI's XMP keys ``GimbalYawDegree``, ``GimbalPitchDegree`` and
``GimbalRollDegree``. Metadata that a file does not contain are taken from the telemetry of the
vehicles, if ``pose_of`` is given. Temperatures are read from FLIR's radiometric JPEGs (R-JPEG,
``flir_temperatures``); R-JPEGs of other makers are read as grey-level images.
"""

import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mission_service.errors import MissionServiceError
from mission_service.sensors.thermal.camera_geometry import focal_px_of
from mission_service.sensors.thermal.flir_temperatures import SEGMENT, flir_celsius
from mission_service.sensors.thermal.image_corners import CornerPoints
from mission_service.sensors.thermal.telemetry_poses import PoseUnknownError, TelemetryPose

if TYPE_CHECKING:
    from PIL.Image import Exif, Image

SUFFIXES = (".tif", ".tiff", ".jpg", ".jpeg", ".png")
MAX_FILE_BYTES = 64_000_000
MAX_PIXELS = 25_000_000
MAX_XMP_BYTES = 256_000
MAX_MESSAGE = 200
EXIF_IFD, GPS_IFD = 0x8769, 0x8825
TAKEN, OFFSET, FOCAL_35_MM, XMP_TAG, ORIENTATION = 0x9003, 0x9011, 0xA405, 700, 0x0112
NOT_TURNED = (None, 0, 1)
HEMISPHERES = {"N": 1.0, "S": -1.0, "E": 1.0, "W": -1.0}
BELOW_SEA = (1, 3, b"\x01", b"\x03")
GREY_MODES = ("1", "L", "LA")
MAX_COLOUR = 16.0  # largest mean difference between the colour components of a grey picture
GPS_LAT_REF, GPS_LAT, GPS_LON_REF, GPS_LON, GPS_BELOW_SEA, GPS_ALTITUDE = range(1, 7)
GPS_TIME, GPS_DATE = 7, 29
NO_POSITION = "EXIF has no GPS latitude, longitude and altitude"
FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
Position = tuple[float, float, float]  # latitude, longitude, altitude above mean sea level
Direction = tuple[float, float, float]  # yaw, pitch, roll in degrees
PoseOf = Callable[[str, datetime | None], TelemetryPose]  # from a file's name and time, if known
DIRECTIONS = ("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree")


class ThermalImageError(MissionServiceError):
    """A file that is not a usable thermal image; the message names the file and the reason."""


class _MissingError(ThermalImageError):
    """A part of the metadata that the file does not contain."""


class NoPoseError(ThermalImageError):
    """Neither the file nor the telemetry so far contains the pose, which may arrive later."""


class ThermalImage(NamedTuple):
    """A thermal image with the time and the pose of its camera.

    ``position_sd_m`` and ``direction_sd_deg`` are the errors of a pose from telemetry that are due
    to the error of the image's time; they are 0 for a pose in the file.
    An image with ``corners`` is georeferenced by these points, not by its direction and focal
    length.
    """

    name: str
    values: NDArray[np.float32]  # (y, x) °C, counts or grey levels
    kind: str  # of the values: "celsius", "counts" or "levels"
    taken: datetime
    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    yaw_deg: float  # clockwise from true north
    pitch_deg: float  # -90: straight down
    roll_deg: float
    focal_px: float | None  # None if unknown
    position_sd_m: float = 0.0
    direction_sd_deg: float = 0.0
    corners: CornerPoints | None = None


def read_thermal_image(path: Path, pose_of: PoseOf | None = None) -> ThermalImage:
    """Read a thermal image; ``pose_of`` supplies the metadata that the file does not contain.

    Raises MissionServiceError for a file that is not usable, and NoPoseError if ``pose_of`` cannot
    supply the missing metadata.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        if path.exists() and not path.is_file():
            raise ThermalImageError(f"{path}: is not a file")
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise ThermalImageError(
                f"{path}: {size / 1e6:.0f} MB; the maximum is {MAX_FILE_BYTES / 1e6:.0f} MB"
            )
        with Image.open(path, formats=("TIFF", "JPEG", "PNG")) as image:
            if image.width * image.height > MAX_PIXELS:
                raise ThermalImageError(
                    f"{path}: {image.width} x {image.height} pixels are too many"
                )
            return _image_of(path, image, pose_of)
    except (MissionServiceError, MemoryError):
        raise
    except UnidentifiedImageError:
        raise ThermalImageError(f"{path}: is not a TIFF, JPEG or PNG image") from None
    except OSError as error:
        raise ThermalImageError(f"{path}: {_in_words(error)}") from None
    # Pillow raises many kinds of errors for damaged files.
    except Exception as error:
        raise ThermalImageError(f"{path}: is damaged: {_in_words(error)}") from None


def _in_words(error: Exception) -> str:
    words = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(str(words).split())[:MAX_MESSAGE]


def _image_of(path: Path, image: "Image", pose_of: PoseOf | None) -> ThermalImage:
    exif = image.getexif()
    gps, camera = exif.get_ifd(GPS_IFD), exif.get_ifd(EXIF_IFD)
    xmp = _xmp_keys(_xmp_of(image, exif))
    source, orientation = xmp.get("ImageSource", ""), exif.get(ORIENTATION)
    if source and "infrared" not in source.lower():
        raise ThermalImageError(f"{path}: was taken by the {source}, which is not thermal")
    if orientation not in NOT_TURNED:
        raise ThermalImageError(
            f"{path}: EXIF orientation is {orientation}; store images as the camera sees them (1)"
        )
    values, kind = _values(path, image)
    missing: list[ThermalImageError] = []
    position = _found(missing, lambda: _position(path, gps))
    direction = _found(missing, lambda: _direction(path, xmp))
    taken = _found(missing, lambda: _taken(path, gps, camera))
    focal_px = _focal_px(values.shape, camera, xmp)
    position_sd_m = direction_sd_deg = 0.0
    if missing:
        pose = _from_telemetry(path, pose_of, taken, missing[0])
        if position is None:
            position = (pose.lat_deg, pose.lon_deg, pose.altitude_amsl_m)
            position_sd_m = pose.position_sd_m
        if direction is None:
            direction, direction_sd_deg = pose.direction, pose.direction_sd_deg
        taken = pose.taken
        if focal_px is None and pose.field_of_view_deg is not None:
            focal_px = focal_px_of(pose.field_of_view_deg, values.shape[1])
    assert position is not None
    assert direction is not None
    assert taken is not None
    return ThermalImage(
        path.name,
        values,
        kind,
        taken,
        *position,
        *direction,
        focal_px,
        position_sd_m,
        direction_sd_deg,
    )


Part = TypeVar("Part")


def _found(missing: list[ThermalImageError], read: Callable[[], Part]) -> Part | None:
    """Return a part of the metadata; if the file lacks it, add the error and return None."""
    try:
        return read()
    except _MissingError as error:
        missing.append(error)
        return None


def _from_telemetry(
    path: Path, pose_of: PoseOf | None, taken: datetime | None, error: ThermalImageError
) -> TelemetryPose:
    if pose_of is None:
        raise error
    try:
        return pose_of(path.name, taken)
    except PoseUnknownError as reason:
        raise NoPoseError(f"{error}; telemetry: {reason}") from None


def _values(path: Path, image: "Image") -> tuple[NDArray[np.float32], str]:
    if any(data.startswith(SEGMENT) for _, data in getattr(image, "applist", ())):
        values, kind = flir_celsius(path), "celsius"
    elif image.mode == "F":
        values, kind = np.asarray(image, dtype=np.float32), "celsius"
    elif image.mode.startswith("I"):
        values, kind = np.asarray(image).astype(np.float32), "counts"
    else:
        if image.mode not in GREY_MODES:
            _refuse_colours(path, image)
        values, kind = np.asarray(image.convert("L"), dtype=np.float32), "levels"
    if values.ndim != 2 or min(values.shape) < 2:
        raise ThermalImageError(
            f"{path}: has the shape {values.shape}; an image has rows and columns"
        )
    if not np.isfinite(values).all():
        raise ThermalImageError(f"{path}: contains values that are not finite")
    return values, kind


def is_coloured(rgb: NDArray[Any]) -> bool:
    """Return True for a colour picture (y, x, 3), False for grey levels."""
    return float(np.mean(rgb.max(axis=2) - rgb.min(axis=2))) > MAX_COLOUR


def _refuse_colours(path: Path, image: "Image") -> None:
    if is_coloured(np.asarray(image.convert("RGB"))):
        raise ThermalImageError(
            f"{path}: is a colour picture; set the camera's palette to grey levels (white hot)"
        )


def _position(path: Path, gps: Mapping[int, Any]) -> Position:
    if GPS_LAT not in gps and GPS_LON not in gps:
        raise _MissingError(f"{path}: {NO_POSITION}")
    try:
        lat_deg, lon_deg = (
            _degrees(gps[place]) * HEMISPHERES[_text(gps[ref])[:1].upper()]
            for place, ref in ((GPS_LAT, GPS_LAT_REF), (GPS_LON, GPS_LON_REF))
        )
        altitude_m = float(gps[GPS_ALTITUDE])
        below = gps.get(GPS_BELOW_SEA, 0) in BELOW_SEA
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        raise ThermalImageError(f"{path}: {NO_POSITION}") from None
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and abs(altitude_m) < 20_000.0):
        raise ThermalImageError(
            f"{path}: the GPS position in EXIF is not valid: {lat_deg}, {lon_deg}, {altitude_m} m"
        )
    return lat_deg, lon_deg, -altitude_m if below else altitude_m


def _text(value: Any) -> str:
    return (value.decode("latin-1") if isinstance(value, bytes) else str(value)).strip("\0 ")


def _degrees(parts: Any) -> float:
    degrees, minutes, seconds = (float(part) for part in parts)
    return degrees + minutes / 60.0 + seconds / 3600.0


def _taken(path: Path, gps: Mapping[int, Any], camera: Mapping[int, Any]) -> datetime:
    """Return the GPS time, which is UTC, or else the camera's time with its offset from UTC."""
    with suppress(KeyError, TypeError, ValueError, OverflowError):
        year, month, day = (int(part) for part in _text(gps[GPS_DATE]).split(":"))
        hours, minutes, seconds = (float(part) for part in gps[GPS_TIME])
        whole, part = divmod(seconds, 1.0)
        clock = (int(hours), int(minutes), int(whole))
        return datetime(year, month, day, *clock, tzinfo=UTC) + timedelta(seconds=part)
    with suppress(KeyError, TypeError, ValueError):
        text = f"{_text(camera[TAKEN])} {_text(camera[OFFSET])}"
        return datetime.strptime(text, "%Y:%m:%d %H:%M:%S %z").astimezone(UTC)
    raise _MissingError(
        f"{path}: EXIF has neither GPS date and time nor DateTimeOriginal with OffsetTimeOriginal"
    )


def _xmp_of(image: "Image", exif: "Exif") -> bytes:
    found = image.info.get("xmp") or exif.get(XMP_TAG) or b""
    data = found.encode() if isinstance(found, str) else bytes(found)
    return data if len(data) <= MAX_XMP_BYTES else b""


def _xmp_keys(data: bytes) -> dict[str, str]:
    """Return the values of XMP keys without namespaces; {} if the XMP is missing or damaged."""
    from xml.etree import ElementTree

    begin = data.find(b"<x:xmpmeta")
    end = data.find(b"</x:xmpmeta>", begin)  # of the first packet
    if begin < 0 or end < 0:
        return {}
    found = {}
    with suppress(ElementTree.ParseError):
        for element in ElementTree.fromstring(data[begin : end + len(b"</x:xmpmeta>")]).iter():
            for key, value in (*element.attrib.items(), (element.tag, element.text or "")):
                found[re.sub(r"^\{.*\}", "", key)] = value.strip()
    return found


def _direction(path: Path, xmp: Mapping[str, str]) -> Direction:
    if missing := [key for key in DIRECTIONS if not xmp.get(key)]:
        raise _MissingError(f"{path}: XMP has no {', '.join(missing)}")
    try:
        yaw, pitch, roll = (float(xmp[key]) for key in DIRECTIONS)
    except ValueError as error:
        raise ThermalImageError(f"{path}: a direction in XMP: {_in_words(error)}") from None
    if not (abs(yaw) <= 360.0 and abs(pitch) <= 180.0 and abs(roll) <= 180.0):
        raise ThermalImageError(f"{path}: the direction in XMP is {yaw}, {pitch}, {roll}")
    if abs(roll) == 180.0 and pitch < -90.0:  # the same direction, written upside down
        return yaw + 180.0, -180.0 - pitch, 0.0
    return yaw, pitch, roll


def _focal_px(
    shape: tuple[int, ...], camera: Mapping[int, Any], xmp: Mapping[str, str]
) -> float | None:
    """Return DJI's calibrated focal length, or EXIF's 35 mm equivalent, in pixels; or None."""
    rows, cols = shape
    diagonal_px = math.hypot(rows, cols)
    for number, px in (
        (xmp.get("CalibratedFocalLength"), 1.0),
        (camera.get(FOCAL_35_MM), diagonal_px / FILM_DIAGONAL_MM),
    ):
        with suppress(TypeError, ValueError, ZeroDivisionError):
            focal_px = float(number) * px  # type: ignore[arg-type]
            if 0.1 * cols < focal_px < 100.0 * cols:
                return focal_px
    return None
