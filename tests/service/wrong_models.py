"""A fire model with wrong inputs for a random fire: fuel in patches, and the wind."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firemodel.physics.weather import WeatherStream
from mission_service.experiments.fires import Burn, burn
from mission_service.experiments.islam_hu.predictive_flight import fly_predictive
from mission_service.experiments.islam_hu.without_aircraft import front_errors
from tests.service.random_fires import FUELS, circling_error, random_fire

WRONG = 0.3  # share of the patches
PATCH_CELLS = 10
TURN_SD_DEG, SPEED_SD_M_S = 30.0, 3.0
MIN_WIND_M_S = 0.3
STREAM = 1  # seed of random numbers that differ from those of the fire


def wrong_model(fire: Burn, seed: int) -> Burn:
    """Return the fire that a model with wrong inputs expects; other data are those of ``fire``.

    Another burnable fuel replaces the fuel of 30 % of the square patches. The wind is turned by
    N(0, 30 degrees), and its speed is wrong by N(0, 3 m/s), both constant during the flight. The
    fire spreads by the scheme ``anyangle`` from the known ignition.
    """
    rng = np.random.default_rng((seed, STREAM))
    fuel = _wrong_fuel(fire.landscape.fuel_model, rng)
    turn_deg, faster_m_s = rng.normal(0.0, TURN_SD_DEG), rng.normal(0.0, SPEED_SD_M_S)
    weather = WeatherStream(
        [
            replace(
                entry,
                wind_speed_m_s=max(entry.wind_speed_m_s + faster_m_s, MIN_WIND_M_S),
                wind_from_deg=(entry.wind_from_deg + turn_deg) % 360.0,
            )
            for entry in fire.weather.entries
        ]
    )
    return burn(
        f"model of {fire.name}",
        "anyangle",
        replace(fire.landscape, fuel_model=fuel),
        weather,
        fire.ignition,
        fire.end_s,
        fire.speed_m_s,
        fire.deploy_s,
    )


def _wrong_fuel(fuel: NDArray[np.int16], rng: np.random.Generator) -> NDArray[np.int16]:
    """Return fuels (y, x) with other codes of ``FUELS`` in a share of the patches."""
    rows, cols = (-(-cells // PATCH_CELLS) for cells in fuel.shape)
    further = rng.integers(1, len(FUELS), (rows, cols))
    further[rng.random((rows, cols)) >= WRONG] = 0
    further = np.kron(further, np.ones((PATCH_CELLS, PATCH_CELLS), dtype=np.int64))
    place = np.searchsorted(FUELS, fuel) + further[: fuel.shape[0], : fuel.shape[1]]
    return np.asarray(np.array(FUELS, dtype=np.int16)[place % len(FUELS)])


def mean_max_errors_wrong(seed: int) -> tuple[float, float, float]:
    """Return the means of the largest error in cells on fire ``seed``, with a wrong model.

    The errors are those of circling, of predictive with the wrong model, and of the model alone.
    """
    fire = random_fire(seed)
    model = wrong_model(fire, seed)
    flight = fly_predictive(fire, seed, model)
    alone = front_errors(model, fire, flight.at_s).max(axis=1)
    return circling_error(fire), float(flight.max_error.mean()), float(alone.mean())
