"""The plane and the terrain of random worlds, by formulas that the service does not use."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

CENTRE = (36.364232, -84.140907)  # latitude and longitude of the fire in every world
_LAT_RAD = math.radians(CENTRE[0])
# Series for the lengths of a degree on the WGS84 ellipsoid (NGA Standard 0036).
M_PER_DEG_LAT = 111_132.92 - 559.82 * math.cos(2.0 * _LAT_RAD) + 1.175 * math.cos(4.0 * _LAT_RAD)
M_PER_DEG_LON = 111_412.84 * math.cos(_LAT_RAD) - 93.5 * math.cos(3.0 * _LAT_RAD)

Place = tuple[float, float]  # metres east and north of ``CENTRE``


def plane_m(lat_deg: Any, lon_deg: Any) -> tuple[Any, Any]:
    """Return the metres east and north of ``CENTRE``, for numbers or arrays."""
    return (lon_deg - CENTRE[1]) * M_PER_DEG_LON, (lat_deg - CENTRE[0]) * M_PER_DEG_LAT


def lat_lon_of(east_m: float, north_m: float) -> tuple[float, float]:
    """Return latitude and longitude in degrees of a position in the plane."""
    return CENTRE[0] + north_m / M_PER_DEG_LAT, CENTRE[1] + east_m / M_PER_DEG_LON


@dataclass(frozen=True)
class Terrain:
    """A slope with round hills; ``hills`` are (east, north, height, width), all in metres."""

    base_amsl_m: float
    slope_east: float = 0.0
    slope_north: float = 0.0
    hills: tuple[tuple[float, float, float, float], ...] = ()

    def ground_m(self, east_m: Any, north_m: Any) -> Any:
        """Return the altitude of the ground above mean sea level, for numbers or arrays."""
        ground_m = self.base_amsl_m + self.slope_east * east_m + self.slope_north * north_m
        for hill_east_m, hill_north_m, height_m, width_m in self.hills:
            square = (east_m - hill_east_m) ** 2 + (north_m - hill_north_m) ** 2
            ground_m = ground_m + height_m * np.exp(-square / (2.0 * width_m * width_m))
        return ground_m
