"""The course of a fastest path in wind, by which tests check its duration."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.front.informative.wind_turn_kernels import FAMILIES
from mission_service.guidance.front.informative.wind_turns import Flight, Pose, fastest_paths

Floats = NDArray[np.float64]
TURN = {"L": 1.0, "S": 0.0, "R": -1.0}


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


def fastest_path(start: Pose, goal: Pose, flight: Flight) -> WindPath:
    """Return the fastest path from a pose to another."""
    duration, family, *parts = fastest_paths(np.array([start]), np.array([goal]), flight)[
        0
    ].tolist()
    return WindPath(start, flight, duration, FAMILIES[int(family)], (parts[0], parts[1], parts[2]))
