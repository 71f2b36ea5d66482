"""Simulate the fires of the papers' experiments; each fire is simulated once, to its end."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.schemes import SchemeName, new_fire
from mission_service.experiments.boundary_following import enclosed_s

Floats = NDArray[np.float64]

CELLS = 200
CELL_M = 30.0
HOUR_S = 3600.0
SHORT_GRASS, TALL_GRASS, BRUSH, TIMBER_LITTER = 1, 3, 5, 8


@dataclass(frozen=True)
class Burn:
    """A complete fire; ``arrival_s`` (y, x) is the time at which each cell ignites."""

    name: str
    scheme: SchemeName
    landscape: Landscape
    weather: WeatherStream
    ignition: tuple[int, int]  # row, column
    deploy_s: float  # time at which the vehicles arrive at the front
    end_s: float
    speed_m_s: float  # speed of the vehicles
    arrival_s: Floats

    def burned(self, at_s: float) -> NDArray[np.bool_]:
        """Return the mask (y, x) of the cells that have ignited by the given time."""
        return self.arrival_s <= at_s

    @cached_property
    def enclosed_s(self) -> Floats:
        """The time (y, x) at which each cell burned or was cut off from the outside."""
        return enclosed_s(self.arrival_s)


def flat(fuel: NDArray[np.int16], cell_m: float = CELL_M) -> Landscape:
    """Return a level landscape with the given fuels (y, x)."""
    return Landscape("EPSG:32611", 5e5, 4e6, cell_m, fuel, np.zeros(fuel.shape, np.float32))


def of_one_fuel(code: int) -> NDArray[np.int16]:
    """Return an array (y, x) with one fuel."""
    return np.full((CELLS, CELLS), code, np.int16)


def of_two_fuels(north: int, south: int) -> NDArray[np.int16]:
    """Return an array (y, x) with one fuel in the northern half and one in the southern half."""
    fuel = of_one_fuel(north)
    fuel[CELLS // 2 :] = south
    return fuel


def wind(at_s: float, speed_m_s: float, from_deg: float) -> Weather:
    """Return dry weather with the given wind."""
    return Weather(at_s, speed_m_s, from_deg, 5.0, 6.0, 7.0, 60.0, 90.0)


def dry_wind(at_s: float, speed_m_s: float, from_deg: float) -> Weather:
    """Return very dry weather with the given wind, in which live fuel burns too."""
    return Weather(at_s, speed_m_s, from_deg, 3.0, 4.0, 5.0, 30.0, 60.0)


def burn(
    name: str,
    scheme: SchemeName,
    landscape: Landscape,
    weather: WeatherStream,
    ignition: tuple[int, int],
    end_s: float,
    speed_m_s: float,
    deploy_s: float = HOUR_S,
) -> Burn:
    """Simulate a fire to its end."""
    fire = new_fire(scheme, landscape, weather, [(*ignition, 0.0)])
    fire.advance(end_s)
    arrival_s = fire.arrival_time_s.copy()
    return Burn(name, scheme, landscape, weather, ignition, deploy_s, end_s, speed_m_s, arrival_s)
