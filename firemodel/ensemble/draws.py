"""Draw what is uncertain about a fire: wind, moisture, spread rates, the place of the ignition."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from firemodel.arrays import Floats

COMMON = 6  # numbers of a draw that do not depend on the fuels
# Dead fuel moisture has this number of values, so that members share the terms of their fuels.
MOISTURES = 15


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """The standard deviations of a fire's inputs; all errors are independent and last.

    Factors are log-normal with a median of 1, angles and distances normal with a mean of 0.

    Cruz & Alexander 2013 (Environ. Model. Softw. 47, 16-28) compared 1278 rates of spread: the best
    models have an error of 35 %, including errors of weather. Rates grow with the wind to a power
    of 1.2 to 1.6. The three deviations of wind speed and rates (a common one, and one for each
    fuel) therefore combine to 0.37. That the error is half common and half of the fuel is an
    assumption.

    Models of the moisture of dead grass have a mean error of 1.16 percentage points (Fire 2019,
    2(1), 2), which is a deviation of 0.15 at a moisture of 10 %. The deviations of the wind's
    direction (two of three winds are within 15 degrees of the reported one) and of the ignition
    are assumptions without a source.
    """

    wind_log_sd: float = 0.2  # of the wind speed's factor
    wind_turn_sd_deg: float = 15.0
    spread_log_sd: float = 0.18  # of the factor of all spread rates
    fuel_log_sd: float = 0.18  # of a further factor of the spread rate in each fuel
    moisture_log_sd: float = 0.15  # of the factor of dead fuel moisture
    ignition_sd_m: float = 50.0  # towards north and towards east


class Draw(NamedTuple):
    """The errors of one member: true input = stated input times factor, or plus offset."""

    wind_factor: float
    turn_deg: float  # clockwise
    spread_factor: float
    moisture_factor: float  # of dead fuel
    north_m: float  # from the stated to the true ignition
    east_m: float
    fuel_factors: tuple[float, ...]  # of the spread rate, for each burnable fuel, ascending codes


def latin_draws(
    uncertainty: Uncertainty, seed: int | Sequence[int], count: int, fuels: int
) -> list[Draw]:
    """Return draws by Latin hypercube sampling (McKay et al. 1979).

    Args:
        uncertainty: The distributions.
        seed: Equal arguments give equal draws.
        count: The number of draws. Other counts give other draws.
        fuels: The number of burnable fuels of the landscape.

    Returns:
        The draws, in random order.
    """
    rng = np.random.default_rng((*np.atleast_1d(seed).tolist(), count))
    middle = ndtri((np.arange(count) + 0.5) / count)
    normal = np.stack([rng.permutation(middle) for _ in range(COMMON + fuels)], axis=1)
    return _draws_of(normal, uncertainty)


def random_draws(
    uncertainty: Uncertainty, rng: np.random.Generator, count: int, fuels: int
) -> list[Draw]:
    """Return independent draws, as for a true fire; arguments as for ``latin_draws``."""
    return _draws_of(rng.standard_normal((count, COMMON + fuels)), uncertainty)


def _draws_of(normal: Floats, uncertainty: Uncertainty) -> list[Draw]:
    """Return the draws of standard normal numbers (count, 6 + fuels)."""
    scale = np.full(normal.shape[1], uncertainty.fuel_log_sd)
    scale[:COMMON] = (
        uncertainty.wind_log_sd,
        uncertainty.wind_turn_sd_deg,
        uncertainty.spread_log_sd,
        uncertainty.moisture_log_sd,
        uncertainty.ignition_sd_m,
        uncertainty.ignition_sd_m,
    )
    values: Any = normal.copy()
    values[:, 3] = _in_classes(normal[:, 3])
    values *= scale
    factors = [0, 2, 3, *range(COMMON, normal.shape[1])]
    values[:, factors] = np.exp(values[:, factors])
    found = []
    for row in values.tolist():
        wind, turn, spread, moisture, north, east = row[:COMMON]
        found.append(Draw(wind, turn, spread, moisture, north, east, tuple(row[COMMON:])))
    return found


def _in_classes(normal: Floats) -> Floats:
    """Return standard normal numbers rounded to ``MOISTURES`` equally likely values."""
    middles = ndtri((np.arange(MOISTURES) + 0.5) / MOISTURES)
    place = np.minimum((ndtr(normal) * MOISTURES).astype(np.int64), MOISTURES - 1)
    found: Floats = (middles / middles.std())[place]
    return found
