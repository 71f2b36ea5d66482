"""Correct a simulated fire with observations, by Gaussian-process regression along paths.

An error in the rate of spread accumulates along the path from the source. Therefore the regression
does not estimate arrival times but w, the logarithm of a factor that multiplies the slowness (time
per distance). A path that takes t seconds in the simulation takes t · mean(exp w) in the corrected
fire. An observation constrains w along the whole path from the ignition to the observed position
and, by correlation, along the path beyond it. In the corrected fire no place burns before ignition,
and arrival times increase along each path.

The unknowns are the rates and the wind of the simulation (``paths.AdjustableFire``), and a field of
w over positions, which represents errors in fuel and terrain. All unknowns have Gaussian priors and
are estimated together (Gauss-Newton, MAP). The position error of an observation, multiplied by the
slowness at this position, is a time error, which is combined with ``TIME_SD_S``. The likelihood of
a burning observation is a Student's t distribution, so that a few outliers have little influence.
The likelihood of a burned or unburned observation is the probability of its state (Laplace's
method). From a few candidates for the prior sd and length of the field, those with the highest
marginal likelihood (of the linearised regression) are used. See Rasmussen & Williams 2006, chapters
2, 3 and 5.
"""

import math
from functools import cache, cached_property
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.special import log_ndtr
from threadpoolctl import ThreadpoolController

from firemodel.arrays import Floats
from firemodel.ellipses.ellipse import EllipseFire
from firemodel.ellipses.gaussian_kernels import Field, slopes, stretch, variances
from firemodel.ellipses.paths import AdjustableEllipses, AdjustableFire, StraightPaths
from firemodel.ellipses.point_observations import BURNED, BURNING, UNBURNED

PLACE_SD_M = 6.0  # standard deviation of an observation's position
TIME_SD_S = 15.0  # standard deviation of an observation's time
MIN_S = 45.0  # lower limit of the time along a path; shorter times contain little information
LOG_SD = 0.05  # standard deviation of ln of the observed time along a path
UNEXPLAINED_SD = 0.1  # further sd of this logarithm: real fires spread around slow places
FIELD_SDS = (0.2, 0.3, 0.4)  # candidates for the prior sd of the field
# Length scales of the field, as fractions of the diagonal of the bounding box of observations and
# sources.
LENGTHS = (1 / 16, 1 / 8, 1 / 4)
MIN_M = 100.0  # lower limit of that diagonal
NODES = 32  # maximum number of nodes along the longer side of the field
STEPS, PARTS = 5, (1.0, 0.5, 0.25, 0.1)  # number of steps; fractions of a step that are tried
CHOSEN_AT = 1  # index of the step in which the prior of the field is chosen
STEPS_NEAR = 2  # number of steps when starting from the result of a similar correction
GOOD_ENOUGH = 0.05  # the iteration ends below this gain in ln of the posterior density
SMALL_RATE = 1e-3  # change in a rate for numerical derivatives
MAX_LOG = 2.5  # limit of |w| in the field
TAIL = 4.0  # degrees of freedom of Student's t

EAST, NORTH = np.array([1.0, 0.0]), np.array([0.0, 1.0])


class _Prior(NamedTuple):
    """The prior of the parameters (rates, then field) as L z, where z has unit variance."""

    sd: float
    length_m: float
    rates_sd: Floats
    of_rows: Floats  # lower Cholesky factors of the field's correlation along rows and columns
    of_cols: Floats

    def white(self, of_rates: Floats, of_place: Floats) -> Floats:
        """Compute A L (n, parameters) for A = [of_rates (n, k), of_place (n, rows, cols)]."""
        place = self.sd * (self.of_rows.T @ of_place @ self.of_cols)
        return np.concatenate([of_rates * self.rates_sd, place.reshape(len(place), -1)], axis=1)

    def colour(self, z: Floats) -> tuple[Floats, Floats]:
        """Return the rates (k,) and the field w (rows, cols) for the unit-variance parameters z."""
        k = len(self.rates_sd)
        place = z[k:].reshape(len(self.of_rows), len(self.of_cols))
        return z[:k] * self.rates_sd, self.sd * (self.of_rows @ place @ self.of_cols.T)


@cache
def _blas() -> ThreadpoolController:
    """Return the controller that limits BLAS to one thread.

    With more threads, the sums would depend on the machine, and at these sizes they would not be
    computed faster.
    """
    return ThreadpoolController()


class _Evaluation(NamedTuple):
    """The expected and observed times along the paths, for given rates and a given field."""

    fire: AdjustableFire
    field: Field
    paths: StraightPaths
    expected: Floats  # ln of the simulated time along the path (n,)
    observed: Floats  # ln of the observed time along the path (n,)
    sd: Floats  # standard deviation of ``observed`` (n,)


class GaussianCorrected:
    """A fire corrected with observations (n, 4); without observations it is unchanged.

    The columns of the observations are x, y, at_s and state. The computing time increases with n³,
    which limits n to a few hundred. Observations at positions that the simulated fire never reaches
    are ignored, because fire at such a position needs another source.

    ``near`` is an earlier correction of the same fire by nearly the same observations. If ``near``
    is given, the fit uses the prior of ``near`` and begins at the result of ``near``. The fit then
    takes a third of the time and gives nearly the same result.
    """

    def __init__(
        self,
        fire: EllipseFire | AdjustableFire,
        observations: Floats,
        *,
        place_sd_m: float = PLACE_SD_M,
        near: "GaussianCorrected | None" = None,
    ) -> None:
        self.fire, self.place_sd_m = fire, place_sd_m
        self.observations = np.asarray(observations, dtype=np.float64).reshape(-1, 4)
        reached = np.isfinite(fire.ignition_time_s(self.observations[:, :2]))
        self._reachable = self.observations[reached]
        self._points = np.ascontiguousarray(self._reachable[:, :2])
        self._rated = AdjustableEllipses(fire) if isinstance(fire, EllipseFire) else fire
        if len(self._rated.places()):
            places = np.concatenate([self._points, self._rated.places()])
            self._field, self._diagonal_m = _empty_field(places)
            rates_sd, length_m = self._rated.rates_sd, LENGTHS[1] * self._diagonal_m
            self._prior = _prior(rates_sd, self._field, FIELD_SDS[-1], length_m)
            self._a = np.empty((0, len(rates_sd) + self._field.slower.size))
            self._w, self._z = np.empty(0), np.empty(0)
        if len(self._reachable):
            with _blas().limit(limits=1, user_api="blas"):
                self._fit(self._rated, near)

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """Return the arrival times (n,) in s at points (n, 2) in metres; infinity if unburned."""
        if not len(self._reachable):
            return self.fire.ignition_time_s(points_m)
        points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 2)
        paths = self._rated.paths(points)
        found = np.empty(len(points))
        stretch(points, paths.origin, self._field, found)
        return paths.lit_s + paths.takes_s * found

    def sd_s(self, points_m: Floats) -> Floats:
        """Return the standard deviation (n,) of ``ignition_time_s`` in s; infinity if unburned.

        Errors of the observations themselves are not included.
        """
        points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 2)
        if not len(self._rated.places()):
            return np.full(len(points), np.inf)
        paths = self._rated.paths(points)
        of_rates = _rates_slopes(self._rated, points, paths)
        slower, variance = np.empty(len(points)), np.empty(len(points))
        stretch(points, paths.origin, self._field, slower)
        variances(points, paths.origin, of_rates, self._field, self._covariance, variance)
        sd = np.sqrt(np.maximum(variance, 0.0) + UNEXPLAINED_SD**2)
        found: Floats = np.where(np.isinf(paths.takes_s), np.inf, paths.takes_s * slower * sd)
        return found

    @cached_property
    def _covariance(self) -> Floats:
        """The posterior covariance of the rates and the field's nodes (parameters, parameters)."""
        prior, a = self._prior, self._a
        inner = a @ a.T + np.diag(1.0 / self._w)
        half: NDArray[np.floating] = a
        if len(a):
            half = solve_triangular(np.linalg.cholesky(inner), a, lower=True, check_finite=False)
        reduction = np.array([np.concatenate([r, w.ravel()]) for r, w in map(prior.colour, half)])
        found = np.zeros((a.shape[1], a.shape[1]))
        k = len(prior.rates_sd)
        np.fill_diagonal(found[:k, :k], np.square(prior.rates_sd))
        grams = (factor @ factor.T for factor in (prior.of_rows, prior.of_cols))
        found[k:, k:] = prior.sd**2 * np.kron(*grams)
        reduction = reduction.reshape(-1, a.shape[1])
        found -= reduction.T @ reduction
        return found

    def _fit(self, fire: AdjustableFire, near: "GaussianCorrected | None") -> None:
        field, prior, diagonal_m = self._field, self._prior, self._diagonal_m
        steps = range(STEPS)
        if near is not None and len(near._reachable) and _same_place(near._field, field):
            prior, steps = near._prior, range(CHOSEN_AT + 1, CHOSEN_AT + 1 + STEPS_NEAR)
            current, z, score = self._try(fire, field, prior, near._z)
        else:
            current, z, score = self._start(fire, field, prior)
        for step in steps:
            of_rates = _rates_slopes(current.fire, self._points, current.paths)
            of_place = np.zeros((len(self._points), *field.slower.shape))
            slopes(self._points, current.paths.origin, current.field, of_place)
            a = prior.white(of_rates, of_place)
            y = current.observed - current.expected + a @ z
            w, b = _curvature(self._reachable[:, 3], y, current.sd, a @ z)
            if step == CHOSEN_AT:
                prior = self._choose(fire, field, diagonal_m, of_rates, of_place, w, b, prior)
                a = prior.white(of_rates, of_place)
                score = math.inf
            k, f = a @ a.T, a @ z
            for _ in range(4):
                w, b = _curvature(self._reachable[:, 3], y, current.sd, f)
                f, alpha = _mode(k, w, b)
            towards = a.T @ alpha - z
            tried = []
            for part in PARTS:
                tried.append(self._try(fire, field, prior, z + part * towards))
                if tried[-1][2] <= score:
                    break
            before = score
            current, z, score = min(tried, key=itemgetter(2))
            if abs(before - score) < GOOD_ENOUGH:
                break
        self._rated, self._field, self._prior, self._z = current.fire, current.field, prior, z
        self.rates = prior.colour(z)[0]
        self._a, self._w = a, w

    def _start(
        self, fire: AdjustableFire, field: Field, prior: _Prior
    ) -> tuple[_Evaluation, Floats, float]:
        """Return the result of ``_try`` for the most probable row of ``first_rates``."""
        found = []
        for rates in fire.first_rates:
            z = np.concatenate([rates / fire.rates_sd, np.zeros(field.slower.size)])
            found.append(self._try(fire, field, prior, z))
        return min(found, key=itemgetter(2))

    def _try(
        self, fire: AdjustableFire, field: Field, prior: _Prior, z: Floats
    ) -> tuple[_Evaluation, Floats, float]:
        rates, w = prior.colour(z)
        current = self._evaluate(
            fire.rated(rates), field._replace(slower=np.exp(np.clip(w, -MAX_LOG, MAX_LOG)))
        )
        miss = _log_likelihood(
            self._reachable[:, 3], current.observed, current.sd, current.expected
        )
        return current, z, 0.5 * float(z @ z) - miss

    def _evaluate(self, fire: AdjustableFire, field: Field) -> _Evaluation:
        points, n = self._points, len(self._points)
        paths = fire.paths(np.concatenate([points, points + EAST, points + NORTH]))
        slower = np.empty(n)
        at_points = StraightPaths(*(part[:n] for part in paths))
        stretch(points, at_points.origin, field, slower)
        time_s, east_s, north_s = (paths.lit_s + paths.takes_s).reshape(3, n)
        slowness_s_m = np.hypot(east_s - time_s, north_s - time_s) * slower
        expected_s = np.maximum(at_points.takes_s * slower, MIN_S)
        observed_s = np.maximum(self._reachable[:, 2] - at_points.lit_s, MIN_S)
        error_s2 = np.square(self.place_sd_m * slowness_s_m) + TIME_SD_S**2
        sd = np.sqrt(error_s2 / np.square(0.5 * (expected_s + observed_s)) + LOG_SD**2)
        return _Evaluation(fire, field, at_points, np.log(expected_s), np.log(observed_s), sd)

    def _choose(
        self,
        fire: AdjustableFire,
        field: Field,
        diagonal_m: float,
        of_rates: Floats,
        of_place: Floats,
        w: Floats,
        b: Floats,
        given: _Prior,
    ) -> _Prior:
        """Return the prior that gives the burning observations the highest likelihood."""
        # Observations without weight are left out.
        burning = (self._reachable[:, 3] == BURNING) & (w > 0.0)
        if np.count_nonzero(burning) < 3:
            return given
        y, sd2 = b[burning] / w[burning], 1.0 / w[burning]
        scaled = of_rates[burning] * fire.rates_sd
        rest = scaled @ scaled.T + np.diag(sd2)
        found = []
        for length in LENGTHS:
            prior = _prior(fire.rates_sd, field, 1.0, length * diagonal_m)
            place = prior.white(of_rates[burning], of_place[burning])[:, len(fire.rates_sd) :]
            k_place = place @ place.T
            for sd in FIELD_SDS:
                factor, _ = cho_factor(rest + sd**2 * k_place, lower=True, check_finite=False)
                half = solve_triangular(factor, y, lower=True, check_finite=False)
                score = -0.5 * float(half @ half) - float(np.log(np.diag(factor)).sum())
                found.append((score, prior._replace(sd=sd)))
        return max(found, key=itemgetter(0))[1]


def _same_place(one: Field, other: Field) -> bool:
    """Return True if two fields have the same nodes."""
    return one.slower.shape == other.slower.shape and one[:3] == other[:3]


def _rates_slopes(fire: AdjustableFire, points: Floats, paths: StraightPaths) -> Floats:
    """Return numerical derivatives (n, k) of ln(time along each path) with respect to each rate."""
    found = np.empty((len(points), len(fire.rates_sd)))
    before_s = np.maximum(paths.takes_s, 1.0)
    for number in range(found.shape[1]):
        step = np.where(np.arange(found.shape[1]) == number, SMALL_RATE, 0.0)
        other_s = fire.rated(step).ignition_time_s(points) - paths.lit_s
        with np.errstate(invalid="ignore"):
            found[:, number] = np.log(np.maximum(other_s, 1.0) / before_s) / SMALL_RATE
    return found


def _empty_field(places: Floats) -> tuple[Field, float]:
    """Return a field with w = 0 around places (k, 2), and the diagonal in m of their extent."""
    low, high = places.min(axis=0), places.max(axis=0)
    diagonal_m = max(float(np.hypot(*(high - low))), MIN_M)
    margin_m = 2.0 * LENGTHS[1] * diagonal_m
    low, high = low - margin_m, high + margin_m
    apart_m = max(float((high - low).max()) / (NODES - 1), 0.75 * LENGTHS[0] * diagonal_m)
    cols, rows = (int(count) for count in np.ceil((high - low) / apart_m) + 1)
    return Field(float(low[0]), float(low[1]), apart_m, np.ones((rows, cols))), diagonal_m


def _prior(rates_sd: Floats, field: Field, sd: float, length_m: float) -> _Prior:
    rows, cols = (_factor(count, field.apart_m / length_m) for count in field.slower.shape)
    return _Prior(sd, length_m, rates_sd, rows, cols)


def _factor(count: int, apart: float) -> Floats:
    """Return the Cholesky factor of the squared exponential on ``count`` nodes.

    ``apart`` is the distance between neighbouring nodes as a multiple of the length scale.
    """
    at = np.arange(count) * apart
    squares = np.square(at[:, None] - at)
    return np.asarray(np.linalg.cholesky(np.exp(-0.5 * squares) + 1e-6 * np.eye(count)), np.float64)


def _log_likelihood(state: Floats, y: Floats, sd: Floats, f: Floats) -> float:
    r = (y - f) / sd
    each = -0.5 * (TAIL + 1.0) * np.log1p(r * r / TAIL) - np.log(sd)
    each = np.where(state == BURNED, log_ndtr(r), each)
    return float(np.where(state == UNBURNED, log_ndtr(-r), each).sum())


def _curvature(state: Floats, y: Floats, sd: Floats, f: Floats) -> tuple[Floats, Floats]:
    """Return the curvature w (n,) and w f + slope (n,) of each observation's log likelihood at f.

    For Student's t, w is the curvature of the Gaussian that touches the likelihood at f.
    """
    r = y - f
    w = (TAIL + 1.0) / (TAIL * sd * sd + r * r)
    b = w * y
    for kind, sign in ((BURNED, 1.0), (UNBURNED, -1.0)):
        these = state == kind
        z = sign * r[these] / sd[these]
        ratio = np.exp(-0.5 * z * z - 0.5 * math.log(2.0 * math.pi) - log_ndtr(z))
        w[these] = np.maximum(ratio * (z + ratio), 1e-6) / sd[these] ** 2
        b[these] = w[these] * f[these] - sign * ratio / sd[these]
    return w, b


def _mode(k: Floats, w: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return the mode f under the Gaussian prior with covariance k, and alpha.

    The results satisfy f = k alpha and alpha = b - w f.
    """
    root = np.sqrt(w)
    inner = np.eye(len(w)) + root[:, None] * k * root
    factor = cho_factor(inner, lower=True, check_finite=False)
    alpha = b - root * cho_solve(factor, root * (k @ b), check_finite=False)
    return k @ alpha, alpha
