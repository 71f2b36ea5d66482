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
from typing import NamedTuple

import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service.sensors.camera_geometry import CameraPose, PoseErrors
from mission_service.sensors.ground_points import covariances, ground_points
from mission_service.simulation.thermal_images import LENS

HEIGHT_M = 120.0
ERRORS = PoseErrors(1.5, 1.5, 0.5, 0.0)  # the rendered elevation has no error
CHI_SQUARE_90 = 4.605  # of two degrees of freedom
TILTS_DEG = (-90.0, -75.0, -60.0, -45.0)


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
