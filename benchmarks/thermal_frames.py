"""Measure the georeferencing of rendered thermal frames over steep ground.

    python -m benchmarks.thermal_frames [FRAMES] [SEED]

Frames of 640 x 512 pixels are rendered 120 m above ground with the true pose of the camera, and
georeferenced with a pose that has errors: 1.5 m in each axis of the position, and 0.5 degrees in
yaw, pitch and roll. The elevation has peaks and valleys of 600 m on grids of 30 m and 10 m. Printed
are the mean error of the places of pixels, and the share of frames in which the 90 % ellipse
contains the true place of the middle pixel. The baseline uses the same pose over flat ground at the
elevation below the camera.
"""

import sys
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, TiffImagePlugin

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from mission_service.sensors.camera_geometry import CameraPose, Lens, PoseErrors, focal_px_of
from mission_service.sensors.ground_points import covariances, ground_points

HEIGHT_M = 120.0
LENS = Lens(640, 512, focal_px_of(45.0, 640), (-0.25, 0.08, 0.001, -0.001, 0.0))
ERRORS = PoseErrors(1.5, 1.5, 0.5, 0.0)  # the rendered elevation has no error
GPS_IFD = 0x8825
CHI_SQUARE_90 = 4.605  # of two degrees of freedom
TILTS_DEG = (-90.0, -75.0, -60.0, -45.0)
XMP = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
    'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description '
    'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" drone-dji:GimbalYawDegree="{:+.4f}" '
    'drone-dji:GimbalPitchDegree="{:+.4f}" drone-dji:GimbalRollDegree="{:+.4f}" '
    'drone-dji:CalibratedFocalLength="{:.4f}"/></rdf:RDF></x:xmpmeta>'
)


class Georeferenced(NamedTuple):
    """Errors over all frames."""

    mean_error_m: float
    covered: float  # share of the frames
    flat_error_m: float  # of the baseline


def steep_landscape(cell_size_m: float, size_m: float = 6000.0) -> Landscape:
    """Return a landscape in UTM zone 16 with peaks and valleys of 600 m."""
    cells = round(size_m / cell_size_m)
    x, y = np.meshgrid(np.arange(cells) * cell_size_m, np.arange(cells) * cell_size_m)
    waves = np.sin(x / 500.0) * np.cos(y / 420.0) + 0.4 * np.sin((x + 2.0 * y) / 190.0)
    elevation_m = (700.0 + 215.0 * waves).astype(np.float32)
    fuel = np.full((cells, cells), 1, dtype=np.int16)
    return Landscape("EPSG:32616", 747_000.0, 4_030_000.0, cell_size_m, fuel, elevation_m)


def pose_above(
    landscape: Landscape, row: float, col: float, yaw: float, pitch: float
) -> CameraPose:
    """Return a camera ``HEIGHT_M`` above the ground at a grid position."""
    x_m, y_m = landscape.xy_of(row, col)
    altitude_m = float(landscape.elevation_at(x_m, y_m)) + HEIGHT_M
    return CameraPose(x_m, y_m, altitude_m, yaw, pitch)


def measured(pose: CameraPose, rng: np.random.Generator) -> CameraPose:
    """Return a pose with the errors of ``ERRORS``."""
    steps = (
        *rng.normal(0.0, ERRORS.position_sd_m, 2),
        rng.normal(0.0, ERRORS.altitude_sd_m),
        *rng.normal(0.0, ERRORS.direction_sd_deg, 3),
    )
    return CameraPose(*(float(part + step) for part, step in zip(pose, steps, strict=True)))


def write_frame(
    path: Path,
    landscape: Landscape,
    pose: CameraPose,
    values: NDArray[Any],
    taken: datetime,
    lens: Lens = LENS,
) -> None:
    """Write an image (y, x) as TIFF with EXIF and XMP, as radiometric cameras do.

    Floats are temperatures in °C, 16-bit integers are counts and 8-bit integers are grey levels.
    """
    lat_deg, lon_deg = (float(each) for each in landscape.lat_lon_of(pose.x_m, pose.y_m))
    yaw_deg = float(landscape.true_deg(pose.yaw_deg))
    gps = {
        1: "N" if lat_deg >= 0 else "S",
        2: _sexagesimal(lat_deg),
        3: "E" if lon_deg >= 0 else "W",
        4: _sexagesimal(lon_deg),
        5: b"\x00",
        6: TiffImagePlugin.IFDRational(round(pose.altitude_amsl_m * 1000), 1000),
        7: (float(taken.hour), float(taken.minute), taken.second + taken.microsecond / 1e6),
        29: taken.strftime("%Y:%m:%d"),
    }
    image = Image.fromarray(values.astype(np.float32) if values.dtype == np.float64 else values)
    exif = Image.Exif()
    exif.get_ifd(GPS_IFD).update(gps)
    exif[GPS_IFD] = 0  # Pillow writes the folders of tags whose key is present
    exif[700] = XMP.format(yaw_deg, pose.pitch_deg, pose.roll_deg, lens.focal_px).encode()
    image.save(path, exif=exif)


def _sexagesimal(degrees: float) -> tuple[float, float, TiffImagePlugin.IFDRational]:
    whole, rest = divmod(abs(degrees) * 60.0, 1.0)
    seconds = TiffImagePlugin.IFDRational(round(rest * 60.0 * 1_000_000), 1_000_000)
    return float(whole // 60), float(whole % 60), seconds


def rendered(
    landscape: Landscape,
    arrival_s: Floats,
    at_s: float,
    pose: CameraPose,
    rng: np.random.Generator,
    lens: Lens = LENS,
) -> Floats:
    """Return the temperatures (y, x) that a camera sees of a fire; the sky is 25 °C cold.

    Ground burns at 600 °C for 90 s after the fire's arrival, and then cools from 120 °C with a time
    constant of one hour. Unburned ground has 25 °C with a noise of 2 °C.

    Args:
        landscape: The landscape.
        arrival_s: The fire's arrival times (y, x) in s; infinite where it does not burn.
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


def georeferenced(
    landscape: Landscape, pitch_deg: float, frames: int, rng: np.random.Generator
) -> Georeferenced:
    """Georeference frames at random places, and compare with the true places of pixels."""
    level = np.zeros(landscape.shape, dtype=np.float32)
    flat = replace(landscape, elevation_m=level, gradient=None)  # type: ignore[arg-type]  # computed
    size, cell_m = landscape.shape[0], landscape.cell_size_m
    col, row = (
        each.ravel() for each in np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 511, 7))
    )
    errors_m: list[float] = []
    flat_errors_m: list[float] = []
    inside = 0
    for _ in range(frames):
        at = rng.uniform(0.2 * size, 0.8 * size, 2)
        pose = pose_above(
            landscape, float(at[0]), float(at[1]), float(rng.uniform(0, 360)), pitch_deg
        )
        seen = measured(pose, rng)
        true = ground_points(landscape, LENS, pose, col, row)
        found = ground_points(landscape, LENS, seen, col, row)
        errors_m += list(np.hypot(*((found - true) * cell_m).T))
        below_m = float(landscape.elevation_at(pose.x_m, pose.y_m))
        lowered = seen._replace(altitude_amsl_m=seen.altitude_amsl_m - below_m)
        flat_errors_m += list(
            np.hypot(*((ground_points(flat, LENS, lowered, col, row) - true) * cell_m).T)
        )
        middle = slice(col.size // 2, col.size // 2 + 1)
        covariance = covariances(landscape, LENS, seen, ERRORS, col[middle], row[middle])[0]
        off = (found - true)[col.size // 2]
        east_north_m = np.array([off[1], -off[0]]) * cell_m
        inside += bool(east_north_m @ np.linalg.solve(covariance, east_north_m) <= CHI_SQUARE_90)
    return Georeferenced(
        float(np.nanmean(errors_m)), inside / frames, float(np.nanmean(flat_errors_m))
    )


def main() -> None:
    """Print a table."""
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    sys.stdout.write("cells   pitch   mean error   flat ground   inside the 90 % ellipse\n")
    for cell_size_m in (30.0, 10.0):
        landscape = steep_landscape(cell_size_m)
        for pitch_deg in TILTS_DEG:
            found = georeferenced(landscape, pitch_deg, frames, rng)
            sys.stdout.write(
                f"{cell_size_m:4.0f} m   {pitch_deg:4.0f}°   {found.mean_error_m:7.2f} m   "
                f"{found.flat_error_m:8.2f} m   {found.covered:.0%}\n"
            )


if __name__ == "__main__":
    main()
