"""Measure the georeferencing of rendered thermal frames over steep ground.

    python -m benchmarks.thermal_frames [FRAMES] [SEED]

Places of pixels are computed with the true pose of a camera 120 m above ground, and with a pose
that has errors: 1.5 m in each axis of the position, and rotations of 0.5 degrees about each axis of
the camera. The true ground has peaks and valleys of 600 m on a grid of 5 m; the elevation of the
service contains the same heights on grids of 30 m and 10 m. Pixels whose place has a stated
standard deviation above the default of ``max_position_sd_m`` are not used. The benchmark prints the
mean and the median error of the places of the other pixels, the share of places inside the 90 %
ellipse that is stated for the pixel, and the share of pixels not used. The baseline uses the same
pose over flat ground at the elevation below the camera. ``benchmarks.registered_frames`` measures
whole passes.
"""

import sys
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats, Mask
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalFramesSection
from mission_service.sensors.thermal.camera_geometry import CameraPose, Lens, PoseErrors, moved
from mission_service.sensors.thermal.ground_points import (
    covariances,
    elevation_sds_m,
    ground_points,
    pose_effects,
)
from mission_service.simulation.thermal_images import LENS

HEIGHT_M = 120.0
TRUE_CELL_M = 5.0
MAX_SD_M = ThermalFramesSection().max_position_sd_m
ERRORS = PoseErrors(1.5, 1.5, 0.5, 0.0)  # the elevation is exact at the centres of cells
CHI_SQUARE_90 = 4.605  # of two degrees of freedom
TILTS_DEG = (-90.0, -75.0, -60.0, -45.0)


class Placed(NamedTuple):
    """The places of some pixels (n) of an image that show ground."""

    off_m: Floats  # (n,) from the true place
    inside: Mask  # (n,) in the ellipse of 90 %
    sd_m: Floats  # (n,) stated, of each axis


class Summary(NamedTuple):
    """Errors over the pixels whose stated error is not too large."""

    mean_error_m: float
    median_error_m: float
    covered: float  # share of the pixels
    inexact: float  # share of all pixels that are not used


def steep_landscape(cell_size_m: float, size_m: float = 6000.0) -> Landscape:
    """Return a landscape in UTM zone 16 with peaks and valleys of 600 m."""
    cells = round(size_m / cell_size_m)
    middle_m = (np.arange(cells) + 0.5) * cell_size_m  # of each cell
    x, y = np.meshgrid(middle_m, middle_m)
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


def pose_error(rng: np.random.Generator) -> Floats:
    """Return an error (6,) of a pose, see ``PoseErrors``."""
    found: Floats = rng.normal(0.0, np.sqrt(np.diag(ERRORS.covariance())))
    return found


def placed(
    ground: Landscape,
    landscape: Landscape,
    true: CameraPose,
    seen: CameraPose,
    covariance: Floats,
    elevation_sd_m: float = ERRORS.elevation_sd_m,
    lens: Lens = LENS,
) -> Placed:
    """Place 63 pixels by a pose with errors, and compare with their true places.

    Args:
        ground: The true ground.
        landscape: The landscape of the service.
        true: The camera's true pose.
        seen: The pose with errors.
        covariance: The stated covariance (6, 6) of its error.
        elevation_sd_m: The stated standard deviation of the landscape's elevation.
        lens: The camera's lens.
    """
    col, row = (
        each.ravel()
        for each in np.meshgrid(
            np.linspace(0, lens.width - 1, 9), np.linspace(0, lens.height - 1, 7)
        )
    )
    places = ground_points(landscape, lens, seen, col, row)
    true_m = np.column_stack(ground.xy_of(*ground_points(ground, lens, true, col, row).T))
    off_m = np.column_stack(landscape.xy_of(*places.T)) - true_m
    effects = pose_effects(landscape, seen, places)
    spread = covariances(effects, covariance, elevation_sds_m(landscape, places, elevation_sd_m))
    known = np.isfinite(off_m).all(axis=1)
    off_m, spread = off_m[known], spread[known]
    squares = (off_m * np.linalg.solve(spread, off_m[:, :, None])[:, :, 0]).sum(axis=1)
    sd_m = np.sqrt(np.trace(spread, axis1=1, axis2=2) / 2.0)
    return Placed(np.hypot(*off_m.T), squares <= CHI_SQUARE_90, sd_m)


def summary(images: list[Placed]) -> Summary:
    """Return the errors over the pixels of images."""
    off_m, inside, sd_m = (np.concatenate(parts) for parts in zip(*images, strict=True))
    used = sd_m <= MAX_SD_M
    return Summary(
        float(off_m[used].mean()),
        float(np.median(off_m[used])),
        float(inside[used].mean()),
        1.0 - float(used.mean()),
    )


def georeferenced(
    ground: Landscape,
    landscape: Landscape,
    pitch_deg: float,
    frames: int,
    rng: np.random.Generator,
) -> tuple[Summary, float]:
    """Return the errors of images at random places, and the mean error over flat ground."""
    level = np.zeros(landscape.shape, dtype=np.float32)
    flat = replace(landscape, elevation_m=level, gradient=None)  # type: ignore[arg-type]  # computed
    found, baseline_m = [], []
    for _ in range(frames):
        row, col = rng.uniform(0.2, 0.8, 2) * ground.shape[0]
        pose = pose_above(ground, float(row), float(col), float(rng.uniform(0, 360)), pitch_deg)
        seen = moved(pose, pose_error(rng))
        found.append(placed(ground, landscape, pose, seen, ERRORS.covariance()))
        below_m = float(landscape.elevation_at(pose.x_m, pose.y_m))
        lowered = seen._replace(altitude_amsl_m=seen.altitude_amsl_m - below_m)
        baseline_m.append(placed(ground, flat, pose, lowered, ERRORS.covariance()).off_m)
    return summary(found), float(np.concatenate(baseline_m).mean())


def main() -> None:
    """Print a table."""
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    sys.stdout.write(
        "cells   pitch   mean error   median   inside the ellipse   not used   flat ground\n"
    )
    ground = steep_landscape(TRUE_CELL_M)
    for cell_size_m in (30.0, 10.0):
        landscape = steep_landscape(cell_size_m)
        for pitch_deg in TILTS_DEG:
            found, flat_m = georeferenced(ground, landscape, pitch_deg, frames, rng)
            sys.stdout.write(
                f"{cell_size_m:4.0f} m   {pitch_deg:4.0f}°   {found.mean_error_m:8.2f} m   "
                f"{found.median_error_m:4.2f} m   {found.covered:16.0%}   {found.inexact:8.0%}   "
                f"{flat_m:9.2f} m\n"
            )


if __name__ == "__main__":
    main()
