"""Computes the fastest paths between two oriented places in a constant wind.

The paths are trochoidal Dubins paths (Techy & Woolsey, "Minimum-time path planning for unmanned
aerial vehicles in steady uniform winds", 2009): relative to the air they consist of turns at the
turn radius and a straight leg. Places are x (east) and y (north) in metres, and the heading of the
nose in radians, anticlockwise from east; over the ground the vehicle also drifts with the wind.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.front.informative.wind_turn_kernels import FAMILIES, fastest

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]  # x_m, y_m, heading_rad
TURN = {"L": 1.0, "S": 0.0, "R": -1.0}


@dataclass(frozen=True, slots=True)
class Flight:
    """A vehicle's speed and turn radius through the air, and the air's velocity (x, y)."""

    airspeed_m_s: float
    turn_radius_m: float
    wind_m_s: tuple[float, float]

    def __post_init__(self) -> None:
        if not math.hypot(*self.wind_m_s) < self.airspeed_m_s:
            raise ValueError(
                f"wind {math.hypot(*self.wind_m_s):g} m/s is not slower than the airspeed "
                f"{self.airspeed_m_s:g} m/s: no path leads upwind"
            )


@dataclass(frozen=True, slots=True)
class WindPath:
    """The fastest path from a start to a goal.

    ``family`` names the three parts: left, straight, right. ``parts_m`` are their lengths through
    the air.
    """

    start: Pose
    flight: Flight
    duration_s: float
    family: str
    parts_m: tuple[float, float, float]

    def poses(self, at_s: Floats) -> Floats:
        """Return the poses (n, 3) over the ground at times (n) after the start."""
        x, y, heading = (np.full(len(at_s), value) for value in self.start)
        left_m = at_s * self.flight.airspeed_m_s
        for name, part_m in zip(self.family, self.parts_m, strict=True):
            length = np.clip(left_m, 0.0, part_m)
            left_m = left_m - part_m
            turned = TURN[name] * length / self.flight.turn_radius_m
            # The chord of an arc is at half of the angle turned.
            chord = length * np.sinc(turned / 2.0 / math.pi)
            x = x + chord * np.cos(heading + turned / 2.0)
            y = y + chord * np.sin(heading + turned / 2.0)
            heading = heading + turned
        wind_x, wind_y = self.flight.wind_m_s
        return np.column_stack([x + wind_x * at_s, y + wind_y * at_s, heading])


def turn_times_s(starts: Floats, goals: Floats, flight: Flight) -> Floats:
    """Return the times (n) of the fastest paths from starts (n, 3) to goals (n, 3).

    The search is in steps of time; a time is infinite if it finds no path.
    """
    return _fastest(starts, goals, flight)[:, 0]


def fastest_path(start: Pose, goal: Pose, flight: Flight) -> WindPath:
    """Return the fastest path from a pose to another; see ``turn_times_s``."""
    duration, family, *parts = _fastest(np.array([start]), np.array([goal]), flight)[0].tolist()
    return WindPath(start, flight, duration, FAMILIES[int(family)], (parts[0], parts[1], parts[2]))


def heading_on_course(course_rad: float, flight: Flight) -> float:
    """Return the heading at which the vehicle's course over the ground is the given one."""
    wind_x, wind_y = flight.wind_m_s
    to_left = wind_y * math.cos(course_rad) - wind_x * math.sin(course_rad)
    return course_rad - math.asin(to_left / flight.airspeed_m_s)


def _fastest(starts: Floats, goals: Floats, flight: Flight) -> Floats:
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
