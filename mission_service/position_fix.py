"""Defines the position and velocity of a vehicle on the map and on the grid."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PositionFix:
    """A position in grid cells and in metres on the map, with the velocity over the ground."""

    at_s: float
    row: float
    col: float
    x_m: float
    y_m: float
    altitude_m: float
    east_m_s: float
    north_m_s: float
