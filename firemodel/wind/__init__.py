"""Compute a divergence-free wind in each cell over terrain, from one wind.

``terrain_wind`` solves a landscape once; its result gives the wind for any speed and direction.
"""

from firemodel.wind.fitted_wind import FittedWind, MeasuredWind, fit_wind
from firemodel.wind.slope_flow import slope_flow, slope_wind, sunlit_flux_w_m2
from firemodel.wind.terrain_weather import (
    free_wind,
    over_terrain,
    responses_of,
    wind_of_landscape,
)
from firemodel.wind.terrain_wind import TerrainWind, local_wind, terrain_wind
from firemodel.wind.vegetation import REFERENCE_M, Surface, surface_of, surface_of_height

__all__ = [
    "REFERENCE_M",
    "FittedWind",
    "MeasuredWind",
    "Surface",
    "TerrainWind",
    "fit_wind",
    "free_wind",
    "local_wind",
    "over_terrain",
    "responses_of",
    "slope_flow",
    "slope_wind",
    "sunlit_flux_w_m2",
    "surface_of",
    "surface_of_height",
    "terrain_wind",
    "wind_of_landscape",
]
