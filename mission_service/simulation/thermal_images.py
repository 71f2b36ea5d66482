"""Renders images from a thermal camera above a fire, and writes them like radiometric cameras.

Simulated cameras, tests and benchmarks use these images.
"""

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from mission_service.sensors.thermal.camera_geometry import CameraPose, Lens, focal_px_of
from mission_service.sensors.thermal.ground_points import ground_points

if TYPE_CHECKING:
    from PIL.TiffImagePlugin import IFDRational

LENS = Lens(640, 512, focal_px_of(45.0, 640), (-0.25, 0.08, 0.001, -0.001, 0.0))
GPS_IFD, XMP_TAG = 0x8825, 700
XMP = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
    'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description '
    'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" drone-dji:GimbalYawDegree="{:+.4f}" '
    'drone-dji:GimbalPitchDegree="{:+.4f}" drone-dji:GimbalRollDegree="{:+.4f}" '
    'drone-dji:CalibratedFocalLength="{:.4f}"/></rdf:RDF></x:xmpmeta>'
)


def write_frame(
    path: Path,
    landscape: Landscape,
    pose: CameraPose | None,
    values: NDArray[Any],
    taken: datetime,
    lens: Lens = LENS,
) -> None:
    """Write an image (y, x) as a TIFF file with EXIF and XMP, like a radiometric camera.

    Floats are temperatures in °C, 16-bit integers are counts and 8-bit integers are grey levels.
    Without ``pose`` the file's metadata contain only the time, like files of cameras without a GPS
    receiver.
    """
    from PIL import Image

    gps: dict[int, Any] = {
        7: (float(taken.hour), float(taken.minute), taken.second + taken.microsecond / 1e6),
        29: taken.strftime("%Y:%m:%d"),
    }
    exif = Image.Exif()
    if pose is not None:
        gps = _position(landscape, pose) | gps
        yaw_deg = float(landscape.true_deg(pose.yaw_deg))
        exif[XMP_TAG] = XMP.format(yaw_deg, pose.pitch_deg, pose.roll_deg, lens.focal_px).encode()
    exif.get_ifd(GPS_IFD).update(gps)
    exif[GPS_IFD] = 0  # Pillow writes only the tag groups whose key is present
    image = Image.fromarray(values.astype(np.float32) if values.dtype == np.float64 else values)
    image.save(path, format="TIFF", exif=exif)


def _position(landscape: Landscape, pose: CameraPose) -> dict[int, Any]:
    """Return the GPS tags for a position."""
    from PIL.TiffImagePlugin import IFDRational

    lat_deg, lon_deg = (float(each) for each in landscape.lat_lon_of(pose.x_m, pose.y_m))
    return {
        1: "N" if lat_deg >= 0 else "S",
        2: _sexagesimal(lat_deg),
        3: "E" if lon_deg >= 0 else "W",
        4: _sexagesimal(lon_deg),
        5: b"\x00",
        6: IFDRational(round(pose.altitude_amsl_m * 1000), 1000),
    }


def _sexagesimal(degrees: float) -> "tuple[float, float, IFDRational]":
    from PIL.TiffImagePlugin import IFDRational

    whole, rest = divmod(abs(degrees) * 60.0, 1.0)
    seconds = IFDRational(round(rest * 60.0 * 1_000_000), 1_000_000)
    return float(whole // 60), float(whole % 60), seconds


def rendered(
    landscape: Landscape,
    arrival_s: Floats,
    at_s: float,
    pose: CameraPose,
    rng: np.random.Generator,
    lens: Lens = LENS,
) -> Floats:
    """Return the temperatures (y, x) in °C of a thermal image of a fire; the sky is at -25 °C.

    Ground burns at 600 °C for 90 s after the fire's arrival, and then cools from 120 °C with a time
    constant of one hour. Unburned ground is at 25 °C. The noise has a standard deviation of 2 °C.

    Args:
        landscape: The landscape.
        arrival_s: The fire's arrival times (y, x) in s; infinite in cells that do not burn.
        at_s: The time of the image in s.
        pose: The camera's true pose.
        rng: The generator of the noise.
        lens: The camera's lens.
    """
    col, row = np.meshgrid(np.arange(lens.width, dtype=float), np.arange(lens.height, dtype=float))
    places = ground_points(landscape, lens, pose, col.ravel(), row.ravel())
    celsius: Floats = np.full(places.shape[0], 25.0)
    celsius += rng.normal(0.0, 2.0, celsius.size)
    seen = np.isfinite(places[:, 0])
    celsius[~seen] -= 50.0
    cells = np.rint(places[seen]).astype(int)
    since_s = at_s - arrival_s[cells[:, 0], cells[:, 1]]
    with np.errstate(over="ignore"):
        burned_c = 95.0 * np.exp(-np.clip(since_s, 0.0, 1e6) / 3600.0)
    celsius[seen] += np.where(since_s >= 0.0, np.where(since_s < 90.0, 575.0, burned_c), 0.0)
    return celsius.reshape(lens.height, lens.width)
