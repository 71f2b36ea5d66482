"""Computes where a vehicle meets the vehicle that it relieves. Pure."""

import math
from itertools import pairwise

Point = tuple[float, float]

STEP_M = 50.0


def meeting_point(path_m: list[Point], speed_m_s: float, from_m: Point, other_m_s: float) -> Point:
    """Return the first point on a path that another vehicle reaches before the one on the path.

    The first vehicle is at the beginning of the path (x, y) and flies along it at ``speed_m_s``.
    The other vehicle flies straight from ``from_m`` at ``other_m_s``. If it is too late for every
    point, the result is the end of the path.
    """
    flown_m = 0.0
    for start, end in pairwise(path_m):
        length_m = math.dist(start, end)
        for step in range(math.ceil(length_m / STEP_M)):
            share = step * STEP_M / length_m
            point = (
                start[0] + share * (end[0] - start[0]),
                start[1] + share * (end[1] - start[1]),
            )
            arrives_s = (flown_m + step * STEP_M) / speed_m_s
            if math.dist(from_m, point) / other_m_s <= arrives_s:
                return point
        flown_m += length_m
    return path_m[-1]
