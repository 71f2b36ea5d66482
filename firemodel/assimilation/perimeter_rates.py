"""Compute, from mapped perimeters, the ratio of real to modelled spread at each part of a front.

The part of the landscape nearest to a segment of the front is the segment's ground. The ratio
between two perimeters is the time in which the model burns as much of that ground as actually
burned, divided by the length of the interval. The logarithm of the ratio is modelled as a Gaussian
process over position, direction of spread and time. The mean of the process falls with the length
of the forecast and with the age of the fire. A segment that does not move although the model
predicts movement is *held*. The probability that the segment is held again is computed from the
counts of held segments near the segment and along the whole front.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.ndimage import binary_erosion, distance_transform_edt, gaussian_filter

from firemodel.arrays import Floats, Mask

HOUR_S = 3600.0
MAX_SEGMENTS = 120  # approximate maximum number in one front
MIN_SEGMENT_CELLS = 4
MAX_SAMPLES = 900  # only the latest samples are used: computing time grows as n**3
SMOOTH_CELLS = 3.0  # standard deviation of the filter that gives the direction of spread
NORMAL_S = 1800.0  # the mean ratio falls with the length of longer forecasts
MIN_RATIO, MAX_RATIO = 0.01, 5.0


@dataclass(frozen=True, slots=True)
class RatePrior:
    """The prior of the ratios of real to modelled spread.

    Names ending in ``_sd`` are standard deviations of the logarithm of the ratio. The values were
    chosen on simulated fires with wrong models and on the Maria fire (``python -m
    benchmarks.perimeter_twins``, docs/estimate.md).
    """

    log_mean: float = -0.8
    fall_with_length: float = 0.35  # change in the mean per ln of the length
    fall_with_age: float = 0.24  # change in the mean per ln of the age in hours
    common_sd: float = 0.34  # common to the whole front
    common_fades_h: float = 12.0
    direction_sd: float = 0.2
    direction_sharpness: float = 1.1
    local_sd: float = 0.23
    local_m: float = 120.0
    fades_h: float = 2.6  # time scale of local and directional deviations
    sample_sd: float = 0.16  # error of one segment in one interval
    interval_sd: float = 0.36  # common to all segments in one interval
    forecast_sd: float = 0.11
    held: float = 0.12  # prior probability that a segment is held
    held_weight: float = 18.0  # weight of ``held``, in segments of 300 m
    held_common_weight: float = 1.3  # weight of the held fraction of the whole front
    held_m: float = 340.0
    held_fades_h: float = 5.4


class Segments(NamedTuple):
    """The segments (n) of a front and their ground."""

    centre_m: Floats  # (n, 2) south and east of the grid's north-west corner
    outward: Floats  # (n, 2) unit vector south, east
    cells: Floats  # (n) number of cells of the front
    of_cell: NDArray[np.int32]  # (y, x) segment of each unburned cell; -1 in burned cells


class SegmentRates(NamedTuple):
    """The prediction for each segment (n) of a front."""

    log_mean: Floats  # mean of ln of the ratio of real to modelled spread
    log_sd: Floats
    held: Floats  # probability that the segment does not move


class _Samples(NamedTuple):
    """The samples of segments (n): each has a value at a position, direction and time."""

    centre_m: Floats
    outward: Floats
    at_s: Floats
    value: Floats
    weight: Floats  # variances of the ratios, or weights of the counts

    def last(self, count: int) -> "_Samples":
        return _Samples(*(each[-count:] for each in self))


def segments_of(burned: Mask, cell_m: float) -> Segments:
    """Return the segments of a burned area's front (y, x), including outlines of islands."""
    cells = np.argwhere(burned & ~binary_erosion(burned, border_value=1))
    side = max(MIN_SEGMENT_CELLS, len(cells) // MAX_SEGMENTS)
    blocks = cells // side
    _, number = np.unique(blocks[:, 0] * burned.shape[1] + blocks[:, 1], return_inverse=True)
    count = np.bincount(number).astype(np.float64)
    smooth: Floats = gaussian_filter(burned.astype(np.float64), SMOOTH_CELLS)
    uphill: Any = np.gradient(-smooth)
    at = cells[:, 0], cells[:, 1]
    outward = _means(np.stack([uphill[0][at], uphill[1][at]], axis=1), number)
    length = np.maximum(np.hypot(*outward.T), 1e-9)
    at_front = np.full(burned.shape, -1, dtype=np.int32)
    at_front[at] = number
    nearest: Any = distance_transform_edt(~burned, return_distances=False, return_indices=True)
    of_cell = np.where(burned, -1, at_front[tuple(nearest)]).astype(np.int32)
    return Segments(_means(cells, number) * cell_m, outward / length[:, None], count, of_cell)


def _means(values: NDArray[np.floating | np.integer], number: NDArray[np.integer]) -> Floats:
    """Return the means (groups, 2) of the rows (n, 2) of each group."""
    sums = [np.bincount(number, values[:, axis]) for axis in (0, 1)]
    return np.stack(sums, axis=1) / np.bincount(number)[:, None]


class FrontRates:
    """The ratios of real to modelled spread, updated by each mapped perimeter."""

    def __init__(self, began_s: float, prior: RatePrior | None = None) -> None:
        self._began_s = began_s
        self._prior = prior or RatePrior()
        self._ratios: list[_Samples] = []
        self._counts: list[_Samples] = []

    def copy(self) -> "FrontRates":
        """Return an independent copy."""
        found = FrontRates(self._began_s, self._prior)
        found._ratios, found._counts = list(self._ratios), list(self._counts)
        return found

    def mean_at(self, at_s: float, for_s: float) -> float:
        """Return the prior mean of the log ratio for a forecast from ``at_s`` over ``for_s``."""
        prior, age_h = self._prior, max(at_s - self._began_s, 0.0) / HOUR_S
        return (
            prior.log_mean
            - prior.fall_with_age * math.log1p(age_h)
            - prior.fall_with_length * math.log(max(for_s / NORMAL_S, 1.0))
        )

    def predict(self, segments: Segments, at_s: float, for_s: float) -> SegmentRates:
        """Return the prediction for the segments of the front, from ``at_s`` over ``for_s``."""
        count, prior = len(segments.cells), self._prior
        place = _Samples(
            segments.centre_m,
            segments.outward,
            np.full(count, at_s),
            np.zeros(count),
            np.zeros(count),
        )
        mean = np.full(count, self.mean_at(at_s, for_s))
        variance = np.full(count, self._variance())
        if self._ratios:
            known = _Samples(*map(np.concatenate, zip(*self._ratios, strict=True)))
            known = known.last(MAX_SAMPLES)
            covariance = self._covariance(known, known) + np.diag(known.weight)
            covariance += prior.interval_sd**2 * (known.at_s[:, None] == known.at_s[None, :])
            factor = cho_factor(covariance)
            shared = self._covariance(known, place)
            mean += shared.T @ cho_solve(factor, known.value)
            variance -= np.sum(shared * cho_solve(factor, shared), axis=0)
        spare = prior.interval_sd**2 + prior.forecast_sd**2
        sd = np.sqrt(np.maximum(variance, 1e-4) + spare)
        return SegmentRates(mean, sd, self._held(place))

    def learn(
        self,
        segments: Segments,
        travel_s: Floats,
        burned: Mask,
        interval: tuple[float, float],
        map_error_m: float,
        cell_m: float,
    ) -> None:
        """Update the ratios from a perimeter.

        Args:
            segments: The segments of the front at the start of the interval.
            travel_s: (y, x) the modelled travel time from the initial front to each cell; infinity
                if unknown.
            burned: (y, x) the cells that have burned by the end of the interval.
            interval: The start and the end of the interval in s.
            map_error_m: The error of the mapping in m; a front that moved by less than this error
                may not have moved.
            cell_m: The size of the cells.
        """
        from_s, to_s = interval
        count = len(segments.cells)
        expected = self.predict(segments, from_s, to_s - from_s)
        ground = segments.of_cell >= 0
        of, share = segments.of_cell[ground], travel_s[ground] / (to_s - from_s)
        grown = np.bincount(of[burned[ground]], minlength=count)
        modelled = np.bincount(of[share <= np.exp(expected.log_mean)[of]], minlength=count)
        doubt = segments.cells * map_error_m / cell_m
        moved = grown >= np.maximum(doubt, 1.0)
        held = ~moved & (modelled >= np.maximum(2.0 * doubt, 2.0))
        ratio = _ratios(of, share, grown)
        moved &= np.isfinite(ratio)
        if moved.any():
            log_ratio = np.log(np.clip(ratio[moved], MIN_RATIO, MAX_RATIO))
            noise = self._prior.sample_sd**2 + (doubt[moved] / grown[moved]) ** 2
            value = log_ratio - self.mean_at(from_s, to_s - from_s)
            self._ratios.append(_samples(segments, moved, to_s, value, noise))
        either = moved | held
        if either.any():
            weight = np.clip(segments.cells[either] * cell_m / 300.0, 0.1, 1.0)
            value = held[either].astype(np.float64)
            self._counts.append(_samples(segments, either, to_s, value, weight))

    def _variance(self) -> float:
        prior = self._prior
        return prior.common_sd**2 + prior.direction_sd**2 + prior.local_sd**2

    def _covariance(self, one: _Samples, other: _Samples) -> Floats:
        """Return the covariance (n, m) between the log ratios of two sets of segments."""
        prior = self._prior
        apart_h = np.abs(one.at_s[:, None] - other.at_s[None, :]) / HOUR_S
        local = np.exp(-_squares(one, other) / (2.0 * prior.local_m**2))
        turn = np.clip(one.outward @ other.outward.T, -1.0, 1.0) - 1.0
        fading = prior.local_sd**2 * local
        fading += prior.direction_sd**2 * np.exp(prior.direction_sharpness * turn)
        common = prior.common_sd**2 * np.exp(-apart_h / prior.common_fades_h)
        found: Floats = fading * np.exp(-apart_h / prior.fades_h) + common
        return found

    def _held(self, place: _Samples) -> Floats:
        """Return the probability (n) that each of these segments is held."""
        prior = self._prior
        if not self._counts:
            return np.full(len(place.at_s), prior.held)
        known = _Samples(*map(np.concatenate, zip(*self._counts, strict=True)))
        age_h = (place.at_s[0] - known.at_s) / HOUR_S
        weight = known.weight * np.exp(-age_h / prior.held_fades_h)
        whole = prior.held_weight * prior.held + weight @ known.value
        whole /= prior.held_weight + weight.sum()
        near = weight * np.exp(-_squares(place, known) / (2.0 * prior.held_m**2))
        total = prior.held_common_weight + near.sum(axis=1)
        found: Floats = (prior.held_common_weight * whole + near @ known.value) / total
        return found


def _samples(
    segments: Segments, which: Mask, at_s: float, value: Floats, weight: Floats
) -> _Samples:
    times = np.full(np.count_nonzero(which), at_s)
    return _Samples(segments.centre_m[which], segments.outward[which], times, value, weight)


def _squares(one: _Samples, other: _Samples) -> Floats:
    """Return the squared distances (n, m) between two sets of segments in m²."""
    apart = one.centre_m[:, None, :] - other.centre_m[None, :, :]
    found: Floats = np.einsum("nmk,nmk->nm", apart, apart)
    return found


def _ratios(of: NDArray[np.int32], share: Floats, grown: NDArray[np.int64]) -> Floats:
    """Return the ratio of real to modelled spread of each segment.

    Args:
        of: (cells) the segment of each cell.
        share: (cells) the modelled time to each cell, divided by the length of the interval.
        grown: (segments) the number of cells that have burned.
    """
    order = np.lexsort((share, of))
    first = np.searchsorted(of[order], np.arange(len(grown)))
    size = np.bincount(of, minlength=len(grown))
    place = first + np.clip(grown - 1, 0, np.maximum(size - 1, 0))
    found = np.full(len(grown), np.inf)
    some = size > 0
    found[some] = share[order][place[some]]
    return found
