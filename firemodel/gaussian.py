"""A fire simulation set right by marks: Gaussian-process regression along the ways fire took.

An error of the rate of spread grows along the way from the source. So what is regressed is not the
time but the logarithm w of the slowness: fire that by the simulation needs e seconds along its way
needs e · mean(exp w) along it, and a mark, whenever it was made, says something of the whole way
behind it and, through what is alike, of what lies ahead. Fire so corrected never comes before it
was lit, and always later further along its way.

w is the sum of what a burn is wrong about:

- rates and wind as they were set: factors on head, back and flank and a turn of the wind, of the
  ellipse itself (``EllipseFire`` only);
- fuel and ground: a field over places, of a length that the marks choose;
- weather: what changes with time, for all directions alike and by direction (one sine).

All have Gaussian priors and are found together (Gauss-Newton; MAP). A mark is as wrong as its place
times the slowness there; one that burns is held as by Student's t, so that a few wrong ones do
little, and one that is burned or unburned by the probability that it is true (Laplace's method).
Prior sd and length of the field are the most likely of a few (marginal likelihood of the linearised
regression). See Rasmussen & Williams 2006, chapters 2, 3 and 5.
"""

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import log_ndtr

from firemodel.compiled import kernel
from firemodel.ellipse import EllipseFire
from firemodel.errors import FireModelError
from firemodel.marks import BURNED, BURNING, UNBURNED, Simulation

PIECES = 12  # of a way
PLACE_SD_M = 6.0  # of a mark
TIME_SD_S = 15.0
LEAST_S = 30.0  # along a way; shorter ones say little
LOG_SD = 0.05  # what no field explains
RATES_SD = np.array([0.5, 0.35, 0.35, 0.6])  # ln of all, of head and of flank besides; turn in rad
FIELD_SDS = (0.25, 0.5, 0.8)
LENGTHS = (1 / 16, 1 / 8, 1 / 4)  # of the diagonal of what is marked and lit
WEATHER_SDS = (0.1, 0.3)
WEATHER_S = 900.0
STEPS = 5
TAIL = 4.0  # degrees of freedom of Student's t
MOST_LOG = 2.5
NODES, TIMES = 36, 24  # of the fields, at most, along each axis

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Ways(NamedTuple):
    """How fire comes to n points: from ``origin`` (n, 2), lit at ``lit_s``, within ``takes_s``."""

    origin: Floats
    lit_s: Floats
    takes_s: Floats


class Field(NamedTuple):
    """w over places (rows of y, columns of x) and over time (even, x, y)."""

    west_m: float
    south_m: float
    apart_m: float
    of_place: Floats  # (rows, cols), row 0 in the south
    from_s: float
    apart_s: float
    of_time: Floats  # (3, times)


def firsts(fire: EllipseFire, points: Floats) -> tuple[Floats, Floats]:
    """Time of ignition (n,) and the source (n, 3) it comes from, the first where fire never comes."""
    time_s, number = fire._burned(points, with_sources=True)
    return time_s, fire.sources[np.maximum(number, 0)]


@kernel
def _cell(x, apart, count):  # type: ignore[no-untyped-def]
    """Node below and share of the one above; held at the ends."""
    at = min(max(x / apart, 0.0), count - 1.0)
    node = min(int(at), count - 2)
    return node, at - node


@kernel
def _w(x, y, at_s, to_x, to_y, field):  # type: ignore[no-untyped-def]
    rows, cols = field.of_place.shape
    col, right = _cell(x - field.west_m, field.apart_m, cols)
    row, up = _cell(y - field.south_m, field.apart_m, rows)
    f = field.of_place
    found = (1.0 - up) * ((1.0 - right) * f[row, col] + right * f[row, col + 1]) + up * (
        (1.0 - right) * f[row + 1, col] + right * f[row + 1, col + 1]
    )
    t = field.of_time
    node, late = _cell(at_s - field.from_s, field.apart_s, t.shape[1])
    early = 1.0 - late
    found += early * t[0, node] + late * t[0, node + 1]
    found += to_x * (early * t[1, node] + late * t[1, node + 1])
    found += to_y * (early * t[2, node] + late * t[2, node + 1])
    return min(max(found, -MOST_LOG), MOST_LOG)


@kernel
def _stretch(points, origin, lit_s, takes_s, field, found):  # type: ignore[no-untyped-def]
    """mean(exp w) along each way."""
    for place in range(points.shape[0]):
        dx, dy = points[place, 0] - origin[place, 0], points[place, 1] - origin[place, 1]
        length = math.sqrt(dx * dx + dy * dy)
        to_x, to_y = (dx / length, dy / length) if length > 0.0 else (0.0, 0.0)
        total = 0.0
        for piece in range(PIECES):
            part = (piece + 0.5) / PIECES
            total += math.exp(
                _w(
                    origin[place, 0] + part * dx,
                    origin[place, 1] + part * dy,
                    lit_s[place] + part * takes_s[place],
                    to_x,
                    to_y,
                    field,
                )
            )
        found[place] = total / PIECES


@kernel
def _slopes(points, origin, lit_s, takes_s, field, of_place, of_time):  # type: ignore[no-untyped-def]
    """d ln mean(exp w) by each node: of_place (n, rows, cols), of_time (n, 3, times), from 0."""
    rows, cols = field.of_place.shape
    times = field.of_time.shape[1]
    for place in range(points.shape[0]):
        dx, dy = points[place, 0] - origin[place, 0], points[place, 1] - origin[place, 1]
        length = math.sqrt(dx * dx + dy * dy)
        to_x, to_y = (dx / length, dy / length) if length > 0.0 else (0.0, 0.0)
        total = 0.0
        for second in range(2):
            for piece in range(PIECES):
                part = (piece + 0.5) / PIECES
                x, y = origin[place, 0] + part * dx, origin[place, 1] + part * dy
                at_s = lit_s[place] + part * takes_s[place]
                share = math.exp(_w(x, y, at_s, to_x, to_y, field))
                if second == 0:
                    total += share
                    continue
                share /= total
                col, right = _cell(x - field.west_m, field.apart_m, cols)
                row, up = _cell(y - field.south_m, field.apart_m, rows)
                of_place[place, row, col] += share * (1.0 - up) * (1.0 - right)
                of_place[place, row, col + 1] += share * (1.0 - up) * right
                of_place[place, row + 1, col] += share * up * (1.0 - right)
                of_place[place, row + 1, col + 1] += share * up * right
                node, late = _cell(at_s - field.from_s, field.apart_s, times)
                of_time[place, 0, node] += share * (1.0 - late)
                of_time[place, 0, node + 1] += share * late
                of_time[place, 1, node] += share * (1.0 - late) * to_x
                of_time[place, 1, node + 1] += share * late * to_x
                of_time[place, 2, node] += share * (1.0 - late) * to_y
                of_time[place, 2, node + 1] += share * late * to_y


def refitted(fire: EllipseFire, rates: Floats) -> EllipseFire:
    """The fire with other rates and wind: ln of all, of head and of flank besides; turn in rad."""
    every, head, flank, turn_rad = rates
    return EllipseFire(
        [
            spread._replace(
                head_m_s=spread.head_m_s * math.exp(every + head),
                back_m_s=spread.back_m_s * math.exp(every),
                flank_m_s=spread.flank_m_s * math.exp(every + flank),
                toward_rad=spread.toward_rad + turn_rad,
            )
            for spread in fire.spreads
        ],
        fire.sources,
    )


class _State(NamedTuple):
    """Where the regression stands: the fire refitted, w, and the marks seen from there."""

    rates: Floats
    field: Field
    fire: EllipseFire
    ways: Ways
    found_s: Floats  # along the way, corrected
    sd: Floats  # of ln of the time along the way
    observed: Floats  # ln of it
    given: Floats  # and as found


class GaussianCorrected:
    """An ``EllipseFire`` with marks (n, 4) x, y, at_s, state."""

    def __init__(self, fire: EllipseFire, marks: Floats, *, place_sd_m: float = PLACE_SD_M) -> None:
        self.fire = fire
        self.marks = np.asarray(marks, dtype=np.float64).reshape(-1, 4)
        self.place_sd_m = place_sd_m
        self._at = None
        if len(self.marks) and len(fire.sources):
            self._fit()

    # --- regression

    def _look(self, rates: Floats, field: Field) -> _State:
        marks = self.marks
        fire = refitted(self.fire, rates)
        points = np.ascontiguousarray(marks[:, :2])
        time_s, lit = firsts(fire, points)
        ways = Ways(lit[:, :2].copy(), lit[:, 2].copy(), time_s - lit[:, 2])
        stretch = np.empty(len(marks))
        _stretch(points, *ways, field, stretch)
        beside = np.concatenate([points + (1.0, 0.0), points + (0.0, 1.0)])
        east_s, north_s = fire.ignition_time_s(beside).reshape(2, -1)
        slowness = np.hypot(east_s - time_s, north_s - time_s) * stretch
        found_s = np.maximum(ways.takes_s * stretch, LEAST_S)
        observed_s = np.maximum(marks[:, 2] - ways.lit_s, LEAST_S)
        near_s = np.maximum(0.5 * (found_s + observed_s), LEAST_S)
        sd = np.sqrt(
            (np.square(self.place_sd_m * slowness) + TIME_SD_S**2) / np.square(near_s) + LOG_SD**2
        )
        return _State(rates, field, fire, ways, found_s, sd, np.log(observed_s), np.log(found_s))

    def _rates_slopes(self, state: _State) -> Floats:
        points = np.ascontiguousarray(self.marks[:, :2])
        found = np.empty((len(points), 4))
        for number in range(4):
            step = np.zeros(4)
            step[number] = 1e-3
            time_s = refitted(self.fire, state.rates + step).ignition_time_s(points)
            takes_s = np.maximum(time_s - state.ways.lit_s, 1e-3)
            before_s = np.maximum(state.ways.takes_s, 1e-3)
            found[:, number] = np.log(takes_s / before_s) / 1e-3
        return found

    def _fit(self) -> None:
        field, diagonal_m = self._empty_field()
        state = self._look(np.zeros(4), field)
        rows, cols = field.of_place.shape
        times = field.of_time.shape[1]
        points = np.ascontiguousarray(self.marks[:, :2])
        theta = np.zeros(4 + rows * cols + 3 * times)
        chosen = (0.5, diagonal_m * LENGTHS[1], 0.1)
        for step in range(STEPS):
            of_place = np.zeros((len(points), rows, cols))
            of_time = np.zeros((len(points), 3, times))
            _slopes(points, *state.ways, state.field, of_place, of_time)
            of_rates = self._rates_slopes(state)
            a = np.concatenate(
                [of_rates, of_place.reshape(len(points), -1), of_time.reshape(len(points), -1)],
                axis=1,
            )
            y = state.observed - state.given + a @ theta
            w, b = _likelihood(self.marks[:, 3], y, state.sd, a @ theta)
            if step == 1 or step == 3:
                chosen = self._choose(field, of_rates, of_place, of_time, w, b, diagonal_m)
            pa = _prior_times(field, chosen, of_rates, of_place, of_time)
            k = a @ pa
            f = a @ theta
            for _ in range(4):
                w, b = _likelihood(self.marks[:, 3], y, state.sd, f)
                f, alpha = _solve(k, w, b)
            theta = pa @ alpha
            state = self._look(
                theta[:4],
                field._replace(
                    of_place=theta[4 : 4 + rows * cols].reshape(rows, cols),
                    of_time=theta[4 + rows * cols :].reshape(3, times),
                ),
            )
        self._at = state
        self.chosen = chosen
        self._posterior = (a, pa, k, w)

    def _empty_field(self) -> tuple[Field, float]:
        places = np.concatenate([self.marks[:, :2], self.fire.sources[:, :2]])
        low, high = places.min(axis=0), places.max(axis=0)
        diagonal_m = max(float(np.hypot(*(high - low))), 100.0)
        diagonal_m = 2.0 ** round(math.log2(diagonal_m) * 2) ** 1 if False else diagonal_m
        margin_m = 2.0 * LENGTHS[1] * diagonal_m
        low, high = low - margin_m, high + margin_m
        apart_m = max(float((high - low).max()) / (NODES - 1), 0.75 * LENGTHS[0] * diagonal_m)
        cols, rows = (int(n) for n in np.ceil((high - low) / apart_m) + 1)
        from_s = float(self.fire.sources[:, 2].min())
        until_s = max(float(self.marks[:, 2].max()) + 2.0 * WEATHER_S, from_s + WEATHER_S)
        times = int(min(TIMES, math.ceil((until_s - from_s) / (WEATHER_S / 3.0)) + 1))
        return Field(
            float(low[0]),
            float(low[1]),
            apart_m,
            np.zeros((rows, cols)),
            from_s,
            (until_s - from_s) / (times - 1),
            np.zeros((3, times)),
        ), diagonal_m

    def _choose(self, field, of_rates, of_place, of_time, w, b, diagonal_m):
        burning = self.marks[:, 3] == BURNING
        if burning.sum() < 3:
            return (0.5, diagonal_m * LENGTHS[1], 0.1)
        y, sd2 = (b / w)[burning], 1.0 / w[burning]
        of_rates, of_place, of_time = of_rates[burning], of_place[burning], of_time[burning]
        k_rates = (of_rates * RATES_SD**2) @ of_rates.T
        flat_time = of_time.reshape(len(y), -1)
        k_time = flat_time @ _times_prior(field, of_time).reshape(len(y), -1).T
        best, found = -math.inf, None
        for length in LENGTHS:
            k_place = of_place.reshape(len(y), -1) @ (
                _places_prior(field, length * diagonal_m, of_place).reshape(len(y), -1).T
            )
            for sd, weather_sd in product(FIELD_SDS, WEATHER_SDS):
                k = k_rates + sd**2 * k_place + weather_sd**2 * k_time + np.diag(sd2)
                factor = cho_factor(k, lower=True, check_finite=False)
                score = -0.5 * y @ cho_solve(factor, y, check_finite=False)
                score -= np.log(np.diag(factor[0])).sum()
                score -= 0.5 * (math.log(sd / 0.5) / 0.5) ** 2
                if score > best:
                    best, found = score, (sd, length * diagonal_m, weather_sd)
        return found

    # --- prediction

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """When fire comes to each point: (n, 2) x, y in metres to (n,); infinity for never."""
        if self._at is None:
            return self.fire.ignition_time_s(points_m)
        points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 2)
        fire, field = self._at.fire, self._at.field
        time_s, lit = firsts(fire, points)
        takes_s = time_s - lit[:, 2]
        stretch = np.empty(len(points))
        _stretch(points, lit[:, :2].copy(), lit[:, 2].copy(), takes_s, field, stretch)
        return lit[:, 2] + takes_s * stretch


def _likelihood(state: Floats, y: Floats, sd: Floats, f: Floats) -> tuple[Floats, Floats]:
    """Curvature w and w f + slope of the log likelihood of each mark at f."""
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


def _solve(k: Floats, w: Floats, b: Floats) -> tuple[Floats, Floats]:
    """(f, alpha) with f = k alpha, at the top of the Gaussian of curvature w and w f = b."""
    root = np.sqrt(w)
    m = np.eye(len(w)) + root[:, None] * k * root
    factor = cho_factor(m, lower=True, check_finite=False)
    alpha = b - root * cho_solve(factor, root * (k @ b), check_finite=False)
    return k @ alpha, alpha


def _gram(count: int, apart: float, length: float) -> Floats:
    at = np.arange(count) * apart
    return np.exp(-0.5 * np.square((at[:, None] - at) / length))


def _places_prior(field: Field, length_m: float, of_place: Floats) -> Floats:
    rows, cols = field.of_place.shape
    return _gram(rows, field.apart_m, length_m) @ of_place @ _gram(cols, field.apart_m, length_m)


def _times_prior(field: Field, of_time: Floats) -> Floats:
    times = field.of_time.shape[1]
    return of_time @ _gram(times, field.apart_s, WEATHER_S)


def _prior_times(field, chosen, of_rates, of_place, of_time) -> Floats:
    """P a' (parameters, n)."""
    sd, length_m, weather_sd = chosen
    n = len(of_rates)
    return np.concatenate(
        [
            of_rates * RATES_SD**2,
            sd**2 * _places_prior(field, length_m, of_place).reshape(n, -1),
            weather_sd**2 * _times_prior(field, of_time).reshape(n, -1),
        ],
        axis=1,
    ).T
