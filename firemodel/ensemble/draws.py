"""Draw random errors in a fire's inputs: wind, moisture, spread rates, ignition position."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from firemodel.arrays import Floats
from firemodel.ensemble.uncertainty import Uncertainty

COMMON = 6  # number of errors in a draw, not counting the factors of individual fuels
# Number of different moisture factors. Members with equal factors share one table of spread rates.
MOISTURES = 15


class Draw(NamedTuple):
    """The errors of a member: factors and offsets that are applied to the given inputs."""

    wind_factor: float
    turn_deg: float  # clockwise turn of the wind
    spread_factor: float
    moisture_factor: float  # factor of dead fuel moisture
    north_m: float  # offset of the ignitions
    east_m: float
    fuel_factors: tuple[float, ...]  # for each burnable fuel, in ascending order of code


def latin_draws(
    uncertainty: Uncertainty, seed: int | Sequence[int], count: int, fuels: int
) -> list[Draw]:
    """Return draws from Latin hypercube sampling (McKay et al. 1979).

    Args:
        uncertainty: The distributions.
        seed: The seed. Identical arguments give identical draws.
        count: The number of draws. A different count gives different draws.
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
    """Return independent draws, for example for true fires (arguments: see ``latin_draws``)."""
    return _draws_of(rng.standard_normal((count, COMMON + fuels)), uncertainty)


def _draws_of(normal: Floats, uncertainty: Uncertainty) -> list[Draw]:
    """Convert standard normal numbers (count, 6 + fuels) to draws."""
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
    """Round standard normal numbers to ``MOISTURES`` equally likely values."""
    middles = ndtri((np.arange(MOISTURES) + 0.5) / MOISTURES)
    place = np.minimum((ndtr(normal) * MOISTURES).astype(np.int64), MOISTURES - 1)
    found: Floats = (middles / middles.std())[place]
    return found
