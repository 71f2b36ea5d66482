"""Forecast a fire by one expected run and by an ensemble of perturbed runs."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from firemodel.spread.fire_scheme import Fire, StartArea

# Odd, and no share of members is 10, 50 or 90 %, so that bands never follow the centres of cells.
MEMBERS = 15
# Standard deviation of the model's error. Cruz & Alexander 2013 (Environ. Model. Softw. 47, 16-28)
# compared 1278 rates of spread: the best models have an error of 35 %, including errors of weather.
# Rates grow with the wind to a power of 1.2 to 1.6, so that both deviations combine to 0.37.
SPREAD_LOG_SD = 0.25
WIND_LOG_SD = 0.2  # 1 m/s of 5
# Assumption without a source: two of three winds are within 15 degrees of the reported direction.
WIND_TURN_SD_DEG = 15.0

Floats = NDArray[np.float64]


class Arrival(NamedTuple):
    """The arrival times of a fire: simulated in the past, forecast in the future."""

    at_s: float  # time of the forecast
    until_s: float  # at least the requested time
    arrival_s: Floats  # (y, x); after until_s finite only next to the fire
    version: int
    start_area: StartArea | None = None  # of an initial fire, used for fronts


class Member(NamedTuple):
    """The arrival times of one run in a window that begins at row ``top`` and column ``left``."""

    top: int
    left: int
    after_s: NDArray[np.float32]  # (y, x) seconds after the ensemble's start, infinity for never


class Ensemble(NamedTuple):
    """The perturbed runs of one fire, all from the same state."""

    at_s: float
    until_s: float
    shape: tuple[int, int]
    members: list[Member]
    version: int


class Perturbation(NamedTuple):
    """The perturbation of one run, as in ``Fire.perturb``."""

    wind_factor: float
    turn_deg: float
    spread_factor: float


def perturbations(seed: int, count: int = MEMBERS) -> list[Perturbation]:
    """Return perturbations drawn by Latin hypercube sampling (McKay et al. 1979).

    They depend only on seed and count, so that successive forecasts differ only because the fire
    differs.
    """
    rng = np.random.default_rng((seed, count))
    middle = ndtri((np.arange(count) + 0.5) / count)
    wind, turn, spread = (rng.permutation(middle) for _ in range(3))
    factors = np.exp(WIND_LOG_SD * wind), WIND_TURN_SD_DEG * turn, np.exp(SPREAD_LOG_SD * spread)
    return [Perturbation(*row) for row in np.column_stack(factors).tolist()]


def burned_ahead(fire: Fire, until_s: float, version: int, seed: int) -> Arrival:
    """Advance a fire to a time and return its arrival times; pass a copy, because it is changed.

    A random scheme receives another generator, so that the forecast does not predict the random
    numbers of the fire.
    """
    at_s = fire.time_s
    fire.draw_from(np.random.default_rng((seed, 0)))
    fire.advance(max(until_s, at_s))
    return Arrival(at_s, fire.time_s, fire.expected_s(), version, fire.start_area)


def ensemble_of(
    fire: Fire, until_s: float, version: int, seed: int, go_on: Callable[[], bool] = lambda: True
) -> Ensemble:
    """Return the ensemble of a fire until a time; the fire is not changed.

    The ensemble has fewer members if ``go_on()`` returns False during the computation.
    """
    members = []
    for number, perturbation in enumerate(perturbations(seed), start=1):
        if not go_on():
            break
        member = fire.copy()
        member.draw_from(np.random.default_rng((seed, number)))
        member.perturb(*perturbation)
        member.advance(max(until_s, fire.time_s))
        members.append(_compact(member.arrival_time_s, fire.time_s))
    return Ensemble(fire.time_s, until_s, fire.landscape.shape, members, version)


def probability_at(ensemble: Ensemble, at_s: float) -> Floats:
    """Return the fraction (y, x) of members in which each cell has burned by a time."""
    burned = np.zeros(ensemble.shape)
    for top, left, after_s in ensemble.members:
        rows, cols = after_s.shape
        burned[top : top + rows, left : left + cols] += after_s <= at_s - ensemble.at_s
    return burned / max(len(ensemble.members), 1)


def _compact(arrival_s: Floats, at_s: float) -> Member:
    """Return the window of burned cells, with arrival times in s after ``at_s`` as float32.

    The times of cells that have burned by ``at_s`` stay at 0 s or less.
    """
    burned = np.isfinite(arrival_s)
    rows, cols = np.flatnonzero(burned.any(axis=1)), np.flatnonzero(burned.any(axis=0))
    if not rows.size:
        return Member(0, 0, np.empty((0, 0), dtype=np.float32))
    window = arrival_s[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    return Member(int(rows[0]), int(cols[0]), (window - at_s).astype(np.float32))
