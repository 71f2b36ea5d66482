"""Computes distances between nearby positions on a spherical Earth; defines length units."""

import math

M_PER_DEG = 111_195.0  # metres per degree of latitude
M_PER_FT, M_PER_NMI = 0.3048, 1852.0


def offset_m(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Return the offset in m, north and east, from one position (lat_deg, lon_deg) to another."""
    north_m = M_PER_DEG * (other[0] - one[0])
    return north_m, M_PER_DEG * (other[1] - one[1]) * math.cos(math.radians(one[0]))


def place_at(centre: tuple[float, float], north_m: float, east_m: float) -> tuple[float, float]:
    """Return the position (lat_deg, lon_deg) at an offset from another position."""
    east_deg = east_m / M_PER_DEG / math.cos(math.radians(centre[0]))
    return centre[0] + north_m / M_PER_DEG, centre[1] + east_deg


def distance_m(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the distance in metres between two positions (lat_deg, lon_deg)."""
    return math.hypot(*offset_m(one, other))
