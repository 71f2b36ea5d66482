"""Small landscapes and weathers that several tests share."""

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape import Landscape
from firemodel.weather import Weather, WeatherStream

CRS = "EPSG:32616"
WEST_M, NORTH_M, CELL_M = 500_000.0, 4_000_000.0, 30.0


def landscape(
    fuel: NDArray[np.integer] | int = 1,
    elevation: np.ndarray[tuple[int, int], np.dtype[np.floating]] | None = None,
    shape: tuple[int, int] = (41, 41),
) -> Landscape:
    """A grid of one fuel (or the given codes), flat unless an elevation is given."""
    if elevation is not None:
        shape = elevation.shape
    codes = np.full(shape, fuel) if isinstance(fuel, int) else fuel
    heights = np.zeros(codes.shape) if elevation is None else elevation
    return Landscape(
        CRS, WEST_M, NORTH_M, CELL_M, codes.astype(np.int16), heights.astype(np.float32)
    )


def weather(wind_speed_m_s: float = 0.0, wind_from_deg: float = 0.0, at_s: float = 0.0) -> Weather:
    """Dry weather with this wind."""
    return Weather(at_s, wind_speed_m_s, wind_from_deg, 6.0, 7.0, 8.0, 60.0, 90.0)


def steady(wind_speed_m_s: float = 0.0, wind_from_deg: float = 0.0) -> WeatherStream:
    """One weather for all time."""
    return WeatherStream([weather(wind_speed_m_s, wind_from_deg)])
