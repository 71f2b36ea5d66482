"""Computes the fastest paths between two poses (positions with headings) in a constant wind.

The paths are trochoidal Dubins paths (Techy & Woolsey, "Minimum-time path planning for unmanned
aerial vehicles in steady uniform winds", 2009): relative to the air, the paths consist of turns at
the turn radius and at most one straight leg. A pose is x (east) and y (north) in metres, and the
heading of the nose in radians, anticlockwise from east. Over the ground the vehicle also drifts
with the wind.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.front.informative.wind_turn_kernels import fastest

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]  # x_m, y_m, heading_rad


@dataclass(frozen=True, slots=True)
class Flight:
    """A vehicle's airspeed, its turn radius relative to the air, and the wind's velocity (x, y)."""

    airspeed_m_s: float
    turn_radius_m: float
    wind_m_s: tuple[float, float]

    def __post_init__(self) -> None:
        if not math.hypot(*self.wind_m_s) < self.airspeed_m_s:
            raise ValueError(
                f"wind {math.hypot(*self.wind_m_s):g} m/s is not slower than the airspeed "
                f"{self.airspeed_m_s:g} m/s: no path leads upwind"
            )


def turn_times_s(starts: Floats, goals: Floats, flight: Flight) -> Floats:
    """Return the times (n) of the fastest paths from starts (n, 3) to goals (n, 3).

    The search proceeds in time steps. The result is infinite if the search finds no path.
    """
    return fastest_paths(starts, goals, flight)[:, 0]


def heading_on_course(course_rad: float, flight: Flight) -> float:
    """Return the heading for a given course over the ground."""
    wind_x, wind_y = flight.wind_m_s
    to_left = wind_y * math.cos(course_rad) - wind_x * math.sin(course_rad)
    return course_rad - math.asin(to_left / flight.airspeed_m_s)


def fastest_paths(starts: Floats, goals: Floats, flight: Flight) -> Floats:
    """Return the fastest paths (n, 5) from starts (n, 3) to goals (n, 3); see ``turn_times_s``.

    The columns are the duration, the index in ``FAMILIES``, and the lengths of the three parts
    through the air.
    """
    found = np.empty((len(starts), 5))
    fastest(
        np.ascontiguousarray(starts, dtype=np.float64),
        np.ascontiguousarray(goals, dtype=np.float64),
        flight.airspeed_m_s,
        flight.turn_radius_m,
        np.array(flight.wind_m_s, dtype=np.float64),
        found,
    )
    return found
