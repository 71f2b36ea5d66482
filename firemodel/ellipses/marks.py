"""What people and sensors say of a fire: places with a time, and what is there at that time."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# The sign of (time of ignition - time of the mark).
BURNED, BURNING, UNBURNED = -1, 0, 1


class Simulation(Protocol):
    """A fire whose time of ignition is known everywhere, in the past and in the future."""

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """When fire comes to each point: (n, 2) x, y in metres to (n,); infinity for never."""


class Mark(NamedTuple):
    """At ``at_s`` the place is BURNED (it came before), BURNING (it comes then) or UNBURNED."""

    x_m: float
    y_m: float
    at_s: float
    state: int


def errors_s(fire: Simulation, marks: Floats) -> Floats:
    """How much later than simulated the fire came to each mark (n, 4): (n,), negative for earlier.

    Infinite where the fire never comes by the simulation. A burned or unburned mark that the
    simulation agrees with has no error.
    """
    late_s: Floats = marks[:, 2] - fire.ignition_time_s(marks[:, :2])
    state = marks[:, 3]
    late_s = np.where(state == BURNED, np.minimum(late_s, 0.0), late_s)
    return np.where(state == UNBURNED, np.maximum(late_s, 0.0), late_s)
