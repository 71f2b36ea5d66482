"""Computes distances between nearby positions on a spherical Earth."""

import math

M_PER_DEG = 111_195.0  # metres for one degree of latitude


def offset_m(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Return the metres north and east from one position (lat_deg, lon_deg) to another."""
    north_m = M_PER_DEG * (other[0] - one[0])
    return north_m, M_PER_DEG * (other[1] - one[1]) * math.cos(math.radians(one[0]))


def distance_m(one: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the distance in metres between two positions (lat_deg, lon_deg)."""
    return math.hypot(*offset_m(one, other))
