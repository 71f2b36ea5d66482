"""Distances between places near each other, on a round Earth."""

import math

M_PER_DEG = 111_195.0  # of latitude


def distance_m(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Between two places (lat_deg, lon_deg)."""
    north_m = M_PER_DEG * (other[0] - one[0])
    east_m = M_PER_DEG * (other[1] - one[1]) * math.cos(math.radians(one[0]))
    return math.hypot(north_m, east_m)
