"""Random fires: wind series, fuels in patches, hills; for properties that hold on any fire."""

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter

from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread.schemes import SchemeName
from mission_service.experiments.fires import CELL_M, CELLS, HOUR_S, Burn, burn, wind
from mission_service.experiments.islam_hu.ideal_flight import fly
from mission_service.experiments.islam_hu.predictive_flight import fly_predictive
from mission_service.experiments.islam_hu.scenarios import islam_hu_planner

END_S = 4 * HOUR_S
FUELS = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10)
MIN_CELLS, MAX_CELLS = 60, 12_000  # burned cells at deployment and at the end
MIN_ERROR, AIM_ERROR, MAX_ERROR = 7.0, 10.5, 16.0  # error of circling, in cells
FIRST_GUESS_M_S, MAX_GUESSES = 3.0, 6


def random_fire(seed: int) -> Burn:
    """Return fire number ``seed``, equal on every machine; even numbers burn with devs8.

    Fires that are out at deployment or reach the edge before the end are drawn again.
    """
    rng = np.random.default_rng(seed)
    scheme: SchemeName = "devs8" if seed % 2 == 0 else "anyangle"
    while True:
        landscape, weather = _landscape(rng), _weather(rng)
        ignition = (int(rng.integers(80, 121)), int(rng.integers(80, 121)))
        fire = burn(f"random {seed}", scheme, landscape, weather, ignition, END_S, 1.0)
        count = np.count_nonzero(fire.burned(fire.deploy_s)), np.count_nonzero(fire.burned(END_S))
        edge = fire.burned(END_S)[[0, 1, -2, -1]].any() or fire.burned(END_S)[:, [0, -1]].any()
        if count[0] >= MIN_CELLS and count[1] <= MAX_CELLS and not edge:
            found = _with_speed(fire)
            if found is not None:
                return found


def _with_speed(fire: Burn) -> Burn | None:
    """Return the fire with a vehicle speed at which circling has an error of 7 to 16 cells."""
    speed_m_s = FIRST_GUESS_M_S
    for _ in range(MAX_GUESSES):
        fire = replace(fire, speed_m_s=speed_m_s)
        error = circling_error(fire)
        if MIN_ERROR <= error <= MAX_ERROR:
            return fire
        speed_m_s *= min(max(error / AIM_ERROR, 1.0 / 3.0), 3.0)
    return None


def circling_error(fire: Burn) -> float:
    """Return the mean of the largest error of circling, reconstructed as in the paper, in cells.

    The error is infinite if the vehicle has not completed a lap half-way through the flight.
    """
    flight = fly(fire, islam_hu_planner(fire, "circling"))
    if not flight.at_s.size or flight.at_s[0] > (fire.deploy_s + fire.end_s) / 2.0:
        return math.inf
    return float(flight.max_error.mean())


def _landscape(rng: np.random.Generator) -> Landscape:
    """Return two or three fuels in patches of about a kilometre, on hills."""
    rough = gaussian_filter(rng.standard_normal((CELLS, CELLS)), 15.0)
    fuels = rng.choice(FUELS, size=int(rng.integers(1, 4)), replace=False)
    share = np.argsort(np.argsort(rough, axis=None)).reshape(rough.shape) / rough.size
    fuel = fuels[np.minimum((share * fuels.size).astype(int), fuels.size - 1)].astype(np.int16)
    hills = gaussian_filter(rng.standard_normal((CELLS, CELLS)), 20.0)
    height_m = hills / np.abs(hills).max() * rng.uniform(0.0, 300.0)
    return Landscape("EPSG:32611", 5e5, 4e6, CELL_M, fuel, (500.0 + height_m).astype(np.float32))


def _weather(rng: np.random.Generator) -> WeatherStream:
    """Return a wind that changes slightly every ten minutes and sometimes shifts."""
    speed_m_s, from_deg = rng.uniform(1.0, 7.0), rng.uniform(0.0, 360.0)
    entries = []
    for at_s in np.arange(0.0, END_S, 600.0):
        if at_s > 0.0 and rng.random() < 0.06:
            from_deg += rng.uniform(-150.0, 150.0)
            speed_m_s *= rng.uniform(0.5, 2.0)
        speed_m_s = float(np.clip(speed_m_s + 0.6 * rng.standard_normal(), 0.3, 11.0))
        from_deg += 8.0 * rng.standard_normal()
        entries.append(wind(float(at_s), speed_m_s, float(from_deg % 360.0)))
    return WeatherStream(entries)


def mean_max_errors(seed: int) -> tuple[float, float]:
    """Return the mean of the largest error in cells of circling and of predictive, on a fire."""
    fire = random_fire(seed)
    return circling_error(fire), float(fly_predictive(fire, seed).max_error.mean())
