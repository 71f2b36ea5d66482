"""Measure the registration of rendered thermal frames of one pass to each other.

    python -m benchmarks.registered_frames [PASSES] [SEED] [ELEVATION_SD_M]

A plane flies lines of 8 images, 30 m and 1.5 s apart, 120 m above steep ground whose temperatures
have a standard deviation of 2 °C; the sensor has noise of 0.1 °C and a fixed pattern of 0.2 °C. The
heights of the true ground are those of the service (grids of 30 m and 10 m), and have a smooth
error in addition if ELEVATION_SD_M is above 0 (default), which is also its stated standard
deviation. The errors of the poses are those of ``benchmarks.thermal_frames``: of each image alone
(independent), the same in all images of a pass (constant), or half of the variance each. The
benchmark prints the mean error of the places of pixels, the share of places in the stated ellipse
of 90 %, and the share of pixels that are not used: for the poses as measured, for the poses after
the registration, and for the last images after the registration. It also prints the number of
matches and the processor time of an image.
"""

import sys
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from benchmarks.thermal_frames import (
    ERRORS,
    TILTS_DEG,
    TRUE_CELL_M,
    Placed,
    placed,
    pose_above,
    pose_error,
    steep_landscape,
    summary,
)
from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from mission_service.sensors.thermal.camera_geometry import CameraPose, Lens, moved
from mission_service.sensors.thermal.frame_matching import reduced
from mission_service.sensors.thermal.frame_registration import FrameRegistration
from mission_service.sensors.thermal.ground_points import ground_points
from mission_service.simulation.thermal_images import LENS

IMAGES, APART_M, APART_S = 8, 30.0, 1.5
UNEVEN_M = 50.0  # smoothing of the error of the elevation
TEXTURE_C, NOISE_C, PATTERN_C = 2.0, 0.1, 0.2
TILE, TILE_CELL_M = 1024, 0.5  # of the texture, which repeats
OWN = {"independent": 1.0, "half": 0.5, "constant": 0.0}  # share of the variance
SMALL = Lens(160, 128, LENS.focal_px / 4.0, LENS.distortion)


class Pass(NamedTuple):
    """The images of one pass."""

    poses: list[CameraPose]  # true
    celsius: list[Floats]  # (y, x) each


class Registered(NamedTuple):
    """The errors of the images of a pass."""

    before: list[Placed]
    after: list[Placed]
    matches: int
    spent_s: float


def texture(rng: np.random.Generator) -> Floats:
    """Return temperatures (y, x) of ground, periodic, with a mean of zero and ``TEXTURE_C``."""
    frequency = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.fftfreq(TILE)[None])
    frequency[0, 0] = np.inf
    spectrum = np.fft.fft2(rng.normal(size=(TILE, TILE))) / frequency
    found: Floats = np.fft.ifft2(spectrum).real
    found *= TEXTURE_C / found.std()
    return found


def uneven(ground: Landscape, sd_m: float, rng: np.random.Generator) -> Landscape:
    """Return ground that differs from the elevation of the service by a smooth error."""
    from scipy.ndimage import gaussian_filter

    error_m = gaussian_filter(rng.normal(size=ground.shape), UNEVEN_M / ground.cell_size_m)
    error_m *= sd_m / error_m.std()
    assert ground.elevation_m is not None
    elevation_m = (ground.elevation_m + error_m).astype(np.float32)
    return replace(ground, elevation_m=elevation_m, gradient=None)  # type: ignore[arg-type]  # computed


def image_of(
    ground: Landscape,
    warmth_c: Floats,
    pose: CameraPose,
    pattern_c: Floats,
    rng: np.random.Generator,
) -> Floats:
    """Return the temperatures (y, x) that a camera sees; the sky is cold."""
    from scipy.ndimage import map_coordinates

    col, row = np.meshgrid(np.arange(SMALL.width) * 1.0, np.arange(SMALL.height) * 1.0)
    places = ground_points(ground, SMALL, pose, col.ravel(), row.ravel())
    seen = np.isfinite(places[:, 0])
    celsius: Floats = np.full(seen.size, -25.0)
    tile = places[seen].T * (ground.cell_size_m / TILE_CELL_M)
    celsius[seen] = 25.0 + map_coordinates(warmth_c, tile, order=1, mode="grid-wrap")
    image: Floats = celsius.reshape(col.shape) + pattern_c
    image += rng.normal(0.0, NOISE_C, col.shape)
    return image


def flown(ground: Landscape, pitch_deg: float, rng: np.random.Generator) -> Pass:
    """Return the images of one pass, in which the wind turns the camera a little."""
    warmth_c = texture(rng)
    pattern_c = rng.normal(0.0, PATTERN_C, (SMALL.height, SMALL.width))
    row, col = rng.uniform(0.3, 0.7, 2) * ground.shape[0]
    heading_deg = float(rng.uniform(0.0, 360.0))
    north, east = np.cos(np.deg2rad(heading_deg)), np.sin(np.deg2rad(heading_deg))
    poses = []
    for cells in np.arange(IMAGES) * APART_M / ground.cell_size_m:
        yaw_deg, tilt_deg, roll_deg = rng.normal((heading_deg, pitch_deg, 0.0), 1.0)
        pose = pose_above(ground, row - cells * north, col + cells * east, yaw_deg, tilt_deg)
        poses.append(pose._replace(roll_deg=roll_deg))
    return Pass(poses, [image_of(ground, warmth_c, pose, pattern_c, rng) for pose in poses])


def errors_of(own: float, rng: np.random.Generator) -> Floats:
    """Return the errors (images, 6) of poses; a share of their variance is independent."""
    alone = np.array([pose_error(rng) for _ in range(IMAGES)])
    return float(np.sqrt(own)) * alone + float(np.sqrt(1.0 - own)) * pose_error(rng)


def registered(
    ground: Landscape, landscape: Landscape, images: Pass, errors: Floats, elevation_sd_m: float
) -> Registered:
    """Register the images of a pass in the order of their times."""
    registration = FrameRegistration(landscape)
    stated = ERRORS._replace(elevation_sd_m=elevation_sd_m)
    before, after, matches, spent_s = [], [], 0, 0.0
    steady = np.ones((SMALL.height, SMALL.width), dtype=bool)
    for number, (true, celsius) in enumerate(zip(*images, strict=True)):
        seen = moved(true, errors[number])
        began_s = time.thread_time()
        frame = reduced(celsius.astype(np.float32), steady, SMALL, seen, stated, number * APART_S)
        found = registration.registered(frame)
        spent_s += time.thread_time() - began_s
        matches += found.matches
        before.append(
            placed(ground, landscape, true, seen, ERRORS.covariance(), elevation_sd_m, SMALL)
        )
        after.append(
            placed(ground, landscape, true, found.pose, found.covariance, elevation_sd_m, SMALL)
        )
    return Registered(before, after, matches, spent_s)


def main() -> None:
    """Print a table."""
    passes = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    elevation_sd_m = float(sys.argv[3]) if len(sys.argv) > 3 else 0.0
    sys.stdout.write(
        "pitch   cells   errors        as measured         registered          last image"
        "          matches   s\n"
    )
    for pitch_deg in TILTS_DEG:
        rng = np.random.default_rng([seed, int(-pitch_deg)])
        ground = uneven(steep_landscape(TRUE_CELL_M), elevation_sd_m, rng)
        found: dict[tuple[float, str], list[Registered]] = {}
        for _ in range(passes):
            images = flown(ground, pitch_deg, rng)
            for name, own in OWN.items():
                errors = errors_of(own, rng)
                for cell_size_m in (30.0, 10.0):
                    each = registered(
                        ground, steep_landscape(cell_size_m), images, errors, elevation_sd_m
                    )
                    found.setdefault((cell_size_m, name), []).append(each)
        for (cell_size_m, name), each_pass in sorted(found.items(), reverse=True):
            sys.stdout.write(
                f"{pitch_deg:4.0f}°   {cell_size_m:4.0f} m  {name:12}  {_line(each_pass)}\n"
            )
            sys.stdout.flush()


def _line(passes: list[Registered]) -> str:
    before, after, last = (
        summary([image for each in images for image in each])
        for images in (
            [each.before for each in passes],
            [each.after for each in passes],
            [each.after[-1:] for each in passes],
        )
    )
    texts = [
        f"{each.mean_error_m:5.2f} m {each.covered:4.0%} {each.inexact:3.0%}"
        for each in (before, after, last)
    ]
    images = len(passes) * IMAGES
    matches = sum(each.matches for each in passes) / images
    spent_s = sum(each.spent_s for each in passes) / images
    return f"{'   '.join(texts)}   {matches:7.0f}   {spent_s:.2f}"


if __name__ == "__main__":
    main()
