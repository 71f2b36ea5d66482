"""Find tie points in two overlapping thermal images, by correlation. Pure.

A tie point is a position on the ground that both images show. A patch of ground around each
candidate is sampled from both images, using their measured poses and the landscape's elevation. If
the poses had no errors, the two patches would be equal. The errors of the poses displace one patch
relative to the other; at this displacement, the normalised cross-correlation of the patches is
largest. Hot ground changes from image to image and is left out. A patch without texture has no
clear maximum of the correlation and is left out.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask
from firemodel.landscape.landscape import Landscape
from mission_service.sensors.thermal.camera_geometry import CameraPose, Lens, PoseErrors, pixels_of
from mission_service.sensors.thermal.ground_points import (
    ground_points,
    offsets_m,
    pose_effects,
)

COLUMNS = 160  # approximate width of a reduced image
ACROSS, DOWN = 5, 4  # maximum tie points of an image
PATCH, REACH = 32, 20  # size of a patch, and the largest distance searched, in samples
SIGMAS = 3.5  # standard deviations that the search covers
MIN_SAMPLE = 0.7  # distance between samples, as a fraction of the width of a pixel on the ground
MIN_CORRELATION = 0.6
MAX_SECOND, PEAK = 0.85, 4  # second maximum, as a fraction of the first; samples around a maximum
MIN_SHIFT = 0.08  # tangent, between two images; at smaller shifts, fixed-pattern noise would match
MATCH_SD = 0.3  # standard deviation of a displacement, in samples


class Frame(NamedTuple):
    """A reduced image, and the measured pose of its camera with the errors of the pose."""

    values: NDArray[np.float32]  # (y, x)
    steady: Mask  # (y, x) pixels whose ground is not hot
    lens: Lens
    pose: CameraPose
    errors: PoseErrors
    taken_s: float


class Ties(NamedTuple):
    """The tie points (n) of an earlier and a later image."""

    earlier: Floats  # (n, 2) pixels, column and row, of the earlier image
    later: Floats  # (n, 2) pixels of the later image
    match_sd_m: Floats  # (n,) of the position on the ground, along each axis


class Match(NamedTuple):
    """Two images and their tie points."""

    earlier: Frame
    later: Frame
    ties: Ties


def reduced(
    values: NDArray[np.float32],
    steady: Mask,
    lens: Lens,
    pose: CameraPose,
    errors: PoseErrors,
    taken_s: float,
) -> Frame:
    """Reduce an image (y, x) to about ``COLUMNS`` columns; each pixel is the mean of a block."""
    step = max(1, round(lens.width / COLUMNS))
    rows, cols = lens.height // step, lens.width // step
    top, left = (lens.height - rows * step) // 2, (lens.width - cols * step) // 2
    block = (slice(top, top + rows * step), slice(left, left + cols * step))
    shape = (rows, step, cols, step)
    mean = values[block].reshape(shape).mean(axis=(1, 3))
    small = Lens(cols, rows, lens.focal_px / step, lens.distortion)
    whole: Mask = np.all(steady[block].reshape(shape), axis=(1, 3), keepdims=False)
    return Frame(mean, whole, small, pose, errors, taken_s)


def ties_between(landscape: Landscape, earlier: Frame, later: Frame) -> Ties | None:
    """Return the tie points of two images, or None if there are none."""
    lens = later.lens
    col, row = (
        each.ravel()
        for each in np.meshgrid(
            (np.arange(ACROSS) + 0.5) * lens.width / ACROSS - 0.5,
            (np.arange(DOWN) + 0.5) * lens.height / DOWN - 0.5,
        )
    )
    places = ground_points(landscape, lens, later.pose, col, row)
    pixels = np.column_stack([col, row])
    before = np.column_stack(_pixels(landscape, earlier, places))  # NaN without ground
    size = np.array([earlier.lens.width, earlier.lens.height])
    shift = (before - size / 2.0) / earlier.lens.focal_px
    shift -= (pixels - np.array([lens.width, lens.height]) / 2.0) / lens.focal_px
    used = (np.abs(before / (size - 1) - 0.5) < 0.5).all(axis=1)
    used &= np.linalg.norm(shift, axis=1) > MIN_SHIFT
    if not used.any():
        return None
    places, pixels = places[used], pixels[used]
    spread = np.zeros((places.shape[0], 2, 2))
    for each in (earlier, later):
        effects = pose_effects(landscape, each.pose, places)
        spread += effects @ each.errors.covariance() @ effects.transpose(0, 2, 1)
    sd_m = np.sqrt(np.linalg.eigvalsh(spread)[:, 1])
    pixel_m = np.linalg.norm(offsets_m(landscape, later.pose, places), axis=1) / lens.focal_px
    sample_m = np.maximum(SIGMAS * sd_m / REACH, MIN_SAMPLE * pixel_m)
    fixed = _samples(landscape, later, places, sample_m, PATCH // 2)
    searched = _samples(landscape, earlier, places, sample_m, PATCH // 2 + REACH)
    steps, found = _best_steps(searched, fixed)
    if not found.any():
        return None
    matched = places + np.column_stack([-steps[:, 1], steps[:, 0]]) * (
        sample_m[:, None] / landscape.cell_size_m
    )
    ties = Ties(
        np.column_stack(_pixels(landscape, earlier, matched)),
        pixels,
        MATCH_SD * sample_m,
    )
    return Ties(*(each[found] for each in ties))


def _pixels(landscape: Landscape, frame: Frame, places: Floats) -> tuple[Floats, Floats]:
    return pixels_of(frame.lens, frame.pose, offsets_m(landscape, frame.pose, places))


def _samples(
    landscape: Landscape, frame: Frame, places: Floats, sample_m: Floats, half: int
) -> Floats:
    """Sample an image around ground positions (n): (n, northwards, eastwards); NaN: unseen."""
    from scipy.ndimage import map_coordinates

    steps = np.arange(-half, half) * (sample_m / landscape.cell_size_m)[:, None]
    row, col = np.broadcast_arrays(
        places[:, 0, None, None] - steps[:, :, None], places[:, 1, None, None] + steps[:, None, :]
    )
    grid = np.column_stack([row.ravel(), col.ravel()])
    at_col, at_row = _pixels(landscape, frame, grid)
    values = np.where(frame.steady, frame.values, np.nan)
    found: Floats = map_coordinates(
        values, [at_row, at_col], output=np.float64, order=1, cval=np.nan, prefilter=False
    )
    return found.reshape(row.shape)


def _best_steps(searched: Floats, fixed: Floats) -> tuple[Floats, Mask]:
    """Return the steps east and north (n, 2) to the best matches, and which matches are clear."""
    correlation = _correlations(searched, fixed)
    count, size, _ = correlation.shape
    flat = correlation.reshape(count, -1)
    best = flat.argmax(axis=1)
    at = np.column_stack(np.unravel_index(best, (size, size)))
    peak = flat[np.arange(count), best]
    inner = ((at > 0) & (at < size - 1)).all(axis=1)
    near = np.abs(np.arange(size) - at[:, :, None]) < PEAK
    others = np.where(near[:, 0, :, None] & near[:, 1, None, :], -1.0, correlation)
    clear = inner & (peak > MIN_CORRELATION)
    clear &= others.reshape(count, -1).max(axis=1) < MAX_SECOND * peak
    at = np.clip(at, 1, size - 2)
    fine = [at[:, axis] + _top(correlation, at, axis) - REACH for axis in (1, 0)]
    return np.column_stack(fine), clear


def _top(values: Floats, at: NDArray[np.int64], axis: int) -> Floats:
    """Return the vertices (n,) of parabolas along an axis, in samples from ``at``."""
    number = np.arange(values.shape[0])
    step = np.eye(2, dtype=np.int64)[axis]
    low, middle, high = (
        values[number, at[:, 0] + side * step[0], at[:, 1] + side * step[1]] for side in (-1, 0, 1)
    )
    bend = low - 2.0 * middle + high
    found: Floats = np.clip((low - high) / np.where(bend < 0.0, 2.0 * bend, -np.inf), -0.5, 0.5)
    return found


def _correlations(searched: Floats, fixed: Floats) -> Floats:
    """Return the normalised cross-correlation (n, s, s) of patches at each searched position.

    The value is -1 for a patch with an unseen sample, and at positions where the searched image has
    an unseen sample.
    """
    from scipy.fft import irfft2, rfft2

    size = searched.shape[1]
    places = size - PATCH + 1
    usable: Mask = np.isfinite(fixed).reshape(fixed.shape[0], -1).min(axis=1)
    patch = np.where(usable[:, None, None], fixed, 0.0)
    patch = patch - patch.mean(axis=(1, 2), keepdims=True)
    unseen = ~np.isfinite(searched)
    level = np.nanmean(np.where(unseen, np.nan, searched)) if not unseen.all() else 0.0
    area = np.where(unseen, 0.0, searched - level)
    product = irfft2(rfft2(area) * np.conj(rfft2(patch, s=(size, size))), s=(size, size))
    mean, square = (_boxes(each) / PATCH**2 for each in (area, area * area))
    variance = np.maximum(square - mean * mean, 1e-9)
    power = np.maximum(patch.var(axis=(1, 2)), 1e-9)[:, None, None]
    found: Floats = product[:, :places, :places] / PATCH**2 / np.sqrt(variance * power)
    found[(_boxes(unseen.astype(float)) > 0.5) | ~usable[:, None, None]] = -1.0
    return found


def _boxes(values: Floats) -> Floats:
    """Return the sums (n, s, s) of the values (n, y, x) in all patch-sized boxes."""
    sums = np.pad(values, ((0, 0), (1, 0), (1, 0))).cumsum(axis=1).cumsum(axis=2)
    found: Floats = sums[:, PATCH:, PATCH:] - sums[:, :-PATCH, PATCH:]
    found -= sums[:, PATCH:, :-PATCH] - sums[:, :-PATCH, :-PATCH]
    return found
