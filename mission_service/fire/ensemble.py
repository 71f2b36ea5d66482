"""Forecast a fire by one expected run and by an ensemble of perturbed runs."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.ensemble.draws import latin_draws
from firemodel.ensemble.member_fires import Start, Window, burned_windows
from firemodel.ensemble.products import burn_probability
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.spread.fire_scheme import Fire, StartArea

# Odd, and no share of members is 10, 50 or 90 %, so that bands never follow the centres of cells.
MEMBERS = 15

Floats = NDArray[np.float64]


class Arrival(NamedTuple):
    """The arrival times of a fire: simulated in the past, forecast in the future."""

    at_s: float  # time of the forecast
    until_s: float  # at least the requested time
    arrival_s: Floats  # (y, x); after until_s finite only next to the fire
    version: int
    start_area: StartArea | None = None  # of an initial fire, used for fronts


class EnsembleForecast(NamedTuple):
    """The perturbed runs of one fire, all from the same state."""

    at_s: float
    until_s: float
    shape: tuple[int, int]
    members: list[Window]
    version: int


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
    fire: Fire,
    until_s: float,
    version: int,
    seed: int,
    uncertainty: Uncertainty | None = None,
    go_on: Callable[[], bool] = lambda: True,
) -> EnsembleForecast:
    """Return the ensemble of a fire until a time; the fire is not changed.

    The draws depend only on the seed, the uncertainty and the number of fuels, so that successive
    forecasts differ only because the fire has changed. If ``uncertainty`` is None, the defaults are
    used. The computation ends with fewer members if ``go_on()`` returns False.
    """
    start = Start(fire)
    draws = latin_draws(uncertainty or Uncertainty(), seed, MEMBERS, start.fuels)
    numbers = (number for number in range(MEMBERS) if go_on())
    members = list(burned_windows(start, draws, numbers, until_s, seed))
    return EnsembleForecast(fire.time_s, until_s, fire.landscape.shape, members, version)


def probability_at(ensemble: EnsembleForecast, at_s: float) -> Floats:
    """Return the fraction (y, x) of members in which each cell has burned by the time ``at_s``."""
    return burn_probability(ensemble.members, ensemble.shape, at_s - ensemble.at_s)
