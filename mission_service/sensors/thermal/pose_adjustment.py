"""Jointly adjust the poses of overlapping images by least squares. Pure.

The tie points of the images (``frame_matching``) determine differences between the errors of the
poses. The adjustment is the mean of a Gaussian posterior: the stated standard deviations are the
prior, and robust weights reduce the influence of tie points that contradict the others. An error of
the elevation displaces a position by different amounts in images from different sides; the
elevation errors of positions near each other are similar. Tie points have further errors in common,
for example those of the interpolated elevation and of a position that is matched in several images.
Therefore, the covariance of the tie points is multiplied by ``DEPENDENCE``.

The error of each pose is the sum of an individual error, which the adjustment averages out, and an
error common to all poses of the pass, for example from a slowly changing GPS error or a tilted
mount. The common error remains, unless views of the same ground from different sides determine it.
The fraction of the variance that is individual is unknown. Therefore, the poses are computed for
several such fractions, for position and for direction, and the results are averaged with the
likelihood of the tie points as weights. The covariance includes the differences between these
results.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats, Mask
from firemodel.landscape.landscape import Landscape
from mission_service.sensors.thermal.camera_geometry import CameraPose, moved
from mission_service.sensors.thermal.frame_matching import Frame, Match
from mission_service.sensors.thermal.ground_points import (
    UP,
    elevation_sds_m,
    ground_points,
    pose_effects,
)

OWN_SHARES = (0.02, 0.2, 0.5, 0.8, 0.98)  # individual fractions of the variance
SHARES = tuple(product(OWN_SHARES, OWN_SHARES))  # for position and for direction
FIRST_SHARES = ((0.5, 0.5),)  # in all rounds but the last
ROUNDS = 3
IMPROBABLE = 13.8  # chi square of two degrees of freedom, exceeded with a probability of 0.1 %
SOFT = 6.0  # chi square at which the weight of a tie point is one half
TYPICAL = 1.386  # median of chi square of two degrees of freedom
UNUSED = 1e-9  # weight of a tie point that is left out
DEPENDENCE = 2.0  # tie points that contain as much information as one independent tie point
ELEVATION_LENGTH_M = 100.0  # errors of the elevation are similar over this distance


class _Shared(NamedTuple):
    """The positions (n) of the tie points on the ground."""

    known: Mask  # (n,) True if both images show ground there
    x_y_m: Floats  # (n, 2)
    apart_m: (
        Floats  # (n, 2) east and north, from the position in the earlier to that in the later image
    )
    match_sd_m: Floats  # (n,) of ``apart_m``
    parallax_sd_m: Floats  # (n, 2) of ``apart_m``, due to the error of the elevation
    effects: Floats  # (n, 2, 6 f) of the errors of all f poses on ``apart_m``


def adjusted(
    landscape: Landscape, frames: list[Frame], matches: list[Match]
) -> tuple[Floats, Floats]:
    """Return the error (6,) of the last image's pose, and the covariance (6, 6) of the error.

    In each round, the positions of the tie points are computed with the poses of the previous
    round.

    Raises FireModelError if an adjusted camera is below the ground or off the landscape.
    """
    sds = np.concatenate([frame.errors.pose_sds() for frame in frames])
    errors = np.zeros(len(frames) * 6)
    covariance = np.zeros((errors.size, errors.size))
    weight: Floats = np.ones(sum(each.ties.match_sd_m.size for each in matches))
    scale = 1.0
    for number in range(ROUNDS):
        each_error = errors.reshape(-1, 6)
        poses = [moved(frame.pose, -error) for frame, error in zip(frames, each_error, strict=True)]
        shared = _shared(landscape, frames, poses, matches)
        weight[~shared.known] = UNUSED
        measured_m = shared.apart_m + shared.effects @ errors
        alone = _blocks(_noise(shared, np.ones(weight.size)))
        if not number:
            spread = shared.effects @ np.diag(sds**2) @ shared.effects.transpose(0, 2, 1)
            weight[_squares(measured_m, spread + alone) > IMPROBABLE] = UNUSED
        shares = SHARES if number == ROUNDS - 1 else FIRST_SHARES
        noise = _noise(shared, weight) * scale * DEPENDENCE
        errors, covariance = _averaged(measured_m, noise, shared.effects, sds, shares)
        squares = _squares(measured_m - shared.effects @ errors, alone)
        used = weight > UNUSED
        scale = max(1.0, float(np.median(squares[used])) / TYPICAL) if used.any() else 1.0
        weight = np.where(used, 1.0 / (1.0 + squares / scale / SOFT), UNUSED)
    return errors[-6:], covariance[-6:, -6:]


def _shared(
    landscape: Landscape,
    frames: list[Frame],
    poses: list[CameraPose],
    matches: list[Match],
) -> _Shared:
    """Compute the positions of the tie points in both images from the poses."""
    number = {id(frame): at for at, frame in enumerate(frames)}
    parts = []
    for match in matches:
        ends = []
        for frame, pixels in ((match.earlier, match.ties.earlier), (match.later, match.ties.later)):
            pose = poses[number[id(frame)]]
            places = ground_points(landscape, frame.lens, pose, pixels[:, 0], pixels[:, 1])
            x_y_m = np.column_stack(landscape.xy_of(places[:, 0], places[:, 1]))
            ends.append((places, x_y_m, pose_effects(landscape, pose, places)))
        (_, one_m, one), (places, other_m, other) = ends
        effects = np.zeros((places.shape[0], 2, len(frames), 6))
        effects[:, :, number[id(match.earlier)]] = -one
        effects[:, :, number[id(match.later)]] = other
        sds_m = elevation_sds_m(landscape, places, match.later.errors.elevation_sd_m)
        parallax_m = (other - one)[:, :, UP] * sds_m[:, None]
        flat = effects.reshape(-1, 2, len(frames) * 6)
        known = np.isfinite(one_m + other_m).all(axis=1)
        parts.append([known, other_m, other_m - one_m, match.ties.match_sd_m, parallax_m, flat])
    known, *found = (np.concatenate(each) for each in zip(*parts, strict=True))
    return _Shared(known, *(np.nan_to_num(each) for each in found))


def _noise(ties: _Shared, weight: Floats) -> Floats:
    """Return the covariance (n, 2, n, 2) of ``apart_m`` for poses without errors."""
    between_m = np.linalg.norm(ties.x_y_m[:, None] - ties.x_y_m, axis=2)
    alike = np.exp(-between_m / ELEVATION_LENGTH_M)
    found: Floats = np.einsum("na,mb,nm->namb", ties.parallax_sd_m, ties.parallax_sd_m, alike)
    number = np.arange(weight.size)
    for axis in range(2):
        found[number, axis, number, axis] += ties.match_sd_m**2 / weight
    return found


def _blocks(noise: Floats) -> Floats:
    """Return the covariance (n, 2, 2) of each tie point."""
    number = np.arange(noise.shape[0])
    found: Floats = noise[number, :, number, :]
    return found


def _squares(differences: Floats, covariance: Floats) -> Floats:
    """Return chi square (n,) of differences (n, 2) with covariances (n, 2, 2)."""
    solved = np.linalg.solve(covariance, differences[:, :, None])[:, :, 0]
    found: Floats = (differences * solved).sum(axis=1)
    return found


def _averaged(
    apart_m: Floats,
    noise: Floats,
    effects: Floats,
    sds: Floats,
    shares: tuple[tuple[float, float], ...],
) -> tuple[Floats, Floats]:
    """Return the errors (6 f,) of all f poses and their covariance, averaged over ``shares``."""
    count, size = apart_m.size, effects.shape[2]
    design = effects.reshape(count, size)
    pulled = np.linalg.solve(noise.reshape(count, count), design)
    information, right_side = design.T @ pulled, apart_m.reshape(count) @ pulled
    results = []
    for position, direction in shares:
        own = np.repeat([position, direction], 3)
        prior = _prior(sds, own)
        system = np.eye(size) + information @ prior
        covariance = prior @ np.linalg.inv(system)
        errors = covariance @ right_side
        fit = 0.5 * right_side @ errors - 0.5 * np.linalg.slogdet(system)[1]
        results.append((fit, errors, covariance))
    fits, each_errors, each_covariance = (np.array(part) for part in zip(*results, strict=True))
    share = np.exp(fits - fits.max())
    share /= share.sum()
    mean: Floats = share @ each_errors
    off = each_errors - mean
    covariance = np.tensordot(share, each_covariance, axes=1) + (share[:, None] * off).T @ off
    return mean, covariance


def _prior(sds: Floats, own: Floats) -> Floats:
    """Return the prior covariance (6 f, 6 f) of the errors of f poses.

    Args:
        sds: The standard deviations (6 f,) of these errors.
        own: The fraction (6,) of the variance of each component that is individual.
    """
    frames = sds.size // 6
    alike = np.kron(np.eye(frames), np.diag(own))
    alike = alike + np.kron(np.ones((frames, frames)), np.diag(1.0 - own))
    found: Floats = alike * np.outer(sds, sds)
    return found
