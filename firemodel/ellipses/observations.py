"""Observations of a fire: a place, a time, and the state of the place at that time."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# The sign of (time of ignition - time of the observation).
BURNED, BURNING, UNBURNED = -1, 0, 1


class Simulation(Protocol):
    """A fire whose time of ignition is known everywhere, in the past and in the future."""

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """When fire comes to each point: (n, 2) x, y in metres to (n,); infinity for never."""


class PointObservation(NamedTuple):
    """At ``at_s`` the place is BURNED (it came before), BURNING (it comes then) or UNBURNED."""

    x_m: float
    y_m: float
    at_s: float
    state: int


def errors_s(fire: Simulation, observations: Floats) -> Floats:
    """How much later than simulated the fire came to each observation (n, 4), in s: (n,).

    Negative for earlier, infinite where the fire never comes by the simulation. A burned or
    unburned observation that the simulation agrees with has no error.
    """
    late_s: Floats = observations[:, 2] - fire.ignition_time_s(observations[:, :2])
    state = observations[:, 3]
    late_s = np.where(state == BURNED, np.minimum(late_s, 0.0), late_s)
    return np.where(state == UNBURNED, np.maximum(late_s, 0.0), late_s)
