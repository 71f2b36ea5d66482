"""Define observations of a fire: a position, a time, and the state there at that time."""

from typing import NamedTuple, Protocol

import numpy as np

from firemodel.arrays import Floats

# Each value is the sign of (arrival time - observation time).
BURNED, BURNING, UNBURNED = -1, 0, 1


class Simulation(Protocol):
    """A fire with an arrival time at every position, in the past and in the future."""

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """Return the arrival times (n,) in s at points (n, 2) in metres; infinity if unburned."""


class PointObservation(NamedTuple):
    """The state at a position at the time ``at_s``.

    BURNED means that fire arrives before that time, BURNING that fire arrives at that time, and
    UNBURNED that fire arrives later or never.
    """

    x_m: float
    y_m: float
    at_s: float
    state: int


def errors_s(fire: Simulation, observations: Floats) -> Floats:
    """Return the delays (n,) in s of the observed fire relative to the simulated fire.

    The observations (n, 4) are rows of x, y, at_s and state.

    The delay is negative where the fire arrived earlier than simulated, and infinite where the
    simulated fire never arrives. A burned or unburned observation that agrees with the simulation
    has an error of 0.
    """
    late_s: Floats = observations[:, 2] - fire.ignition_time_s(observations[:, :2])
    state = observations[:, 3]
    late_s = np.where(state == BURNED, np.minimum(late_s, 0.0), late_s)
    return np.where(state == UNBURNED, np.maximum(late_s, 0.0), late_s)
