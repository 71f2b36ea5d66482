"""Small landscapes and weather that several tests share."""

from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream

CRS = "EPSG:32616"
WEST_M, NORTH_M, CELL_M = 500_000.0, 4_000_000.0, 30.0


def landscape(
    fuel: NDArray[np.integer] | int = 1,
    elevation: np.ndarray[tuple[int, int], np.dtype[np.floating]] | None = None,
    shape: tuple[int, int] = (41, 41),
) -> Landscape:
    """Return a landscape of one fuel (or the given codes), flat unless an elevation is given."""
    if elevation is not None:
        shape = elevation.shape
    codes = np.full(shape, fuel) if isinstance(fuel, int) else fuel
    heights = np.zeros(codes.shape) if elevation is None else elevation
    return Landscape(
        CRS, WEST_M, NORTH_M, CELL_M, codes.astype(np.int16), heights.astype(np.float32)
    )


def weather(wind_speed_m_s: float = 0.0, wind_from_deg: float = 0.0, at_s: float = 0.0) -> Weather:
    """Return dry weather with this wind."""
    return Weather(at_s, wind_speed_m_s, wind_from_deg, 6.0, 7.0, 8.0, 60.0, 90.0)


def steady(wind_speed_m_s: float = 0.0, wind_from_deg: float = 0.0) -> WeatherStream:
    """Return a stream with constant weather."""
    return WeatherStream([weather(wind_speed_m_s, wind_from_deg)])


def write_raster(
    path: Path, bands: NDArray[Any], names: tuple[str, ...] = (), **changes: Any
) -> Path:
    """Write a GeoTIFF on the usual grid; ``changes`` override rasterio's profile."""
    profile = {
        "driver": "GTiff",
        "height": bands.shape[-2],
        "width": bands.shape[-1],
        "count": 1 if bands.ndim == 2 else bands.shape[0],
        "dtype": bands.dtype,
        "crs": CRS,
        "transform": rasterio.Affine(CELL_M, 0.0, WEST_M, 0.0, -CELL_M, NORTH_M),
    }
    with rasterio.open(path, "w", **{**profile, **changes}) as file:
        file.write(bands.reshape(-1, *bands.shape[-2:]))
        for number, name in enumerate(names, start=1):
            file.set_band_description(number, name)
    return path
