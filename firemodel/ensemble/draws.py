"""Draw what is uncertain about a fire: wind, moisture, spread rates, the place of the ignition."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from firemodel.arrays import Floats
from firemodel.ensemble.uncertainty import Uncertainty

COMMON = 6  # numbers of a draw that do not depend on the fuels
# Dead fuel moisture has this number of values, so that members share the terms of their fuels.
MOISTURES = 15


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
