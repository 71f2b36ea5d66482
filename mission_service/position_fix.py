"""Where a vehicle is, on the map and on the grid."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Here:
    """Where a vehicle is: on the grid, in metres, and how it moves over the ground."""

    at_s: float
    row: float
    col: float
    x_m: float
    y_m: float
    altitude_m: float
    east_m_s: float
    north_m_s: float
