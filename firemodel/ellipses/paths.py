"""Define the paths by which fire reaches points, in simulations with adjustable spread rates.

A path is a straight line from an ignition to a point.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from firemodel.arrays import Floats
from firemodel.ellipses.ellipse import EllipseFire


class StraightPaths(NamedTuple):
    """The paths by which fire reaches n points.

    ``origin`` (n, 2) and ``lit_s`` (n,) are the position and time of the ignition from which each
    path starts; ``takes_s`` (n,) is the travel time along the path.

    Where fire never arrives, ``takes_s`` is infinite, and ``origin`` and ``lit_s`` are undefined.
    """

    origin: Floats
    lit_s: Floats
    takes_s: Floats


class AdjustableFire(Protocol):
    """A simulated fire with paths to points and with adjustable rates of spread."""

    @property
    def rates_sd(self) -> Floats:
        """The prior standard deviations (k,) of the adjustments in ``rated``."""

    @property
    def first_rates(self) -> Floats:
        """The sets of adjustments (m, k) from which the search for the best set starts."""

    def rated(self, rates: Floats) -> "AdjustableFire":
        """Return the fire with its rates adjusted by ``rates`` (k,); zeros change nothing."""

    def paths(self, points_m: Floats) -> StraightPaths:
        """Return the paths to points (n, 2), given as x, y in metres."""

    def places(self) -> Floats:
        """Return points (k, 2) as x, y in metres, whose bounding box contains the ignitions."""

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """Return the arrival times (n,) in s at points (n, 2); infinity if unburned."""


class AdjustableEllipses:
    """An ``EllipseFire`` with at least one source, as an ``AdjustableFire``.

    The first three of the four adjustments are logarithms of factors. The first factor applies to
    all rates of spread. In addition, the second factor applies to the head and the third to the
    flanks. The fourth adjustment is a rotation of the wind in radians.
    """

    rates_sd = np.array([0.6, 1.2, 0.7, 0.35])

    first_rates = np.array(
        [
            [0.0, 0.0, 0.0, 0.0],
            [0.8, 0.0, 0.0, 0.0],
            [0.0, -1.5, 0.0, 0.0],
            [0.3, -0.5, 0.0, 0.5],
            [0.3, -0.5, 0.0, -0.5],
        ]
    )

    def __init__(self, fire: EllipseFire) -> None:
        self.fire = fire

    def rated(self, rates: Floats) -> "AdjustableEllipses":
        """Return the fire with its rates and wind adjusted equally in all weather periods."""
        every, head, flank, turn_rad = (float(rate) for rate in rates)
        spreads = [
            spread._replace(
                head_m_s=spread.head_m_s * math.exp(every + head),
                back_m_s=spread.back_m_s * math.exp(every),
                flank_m_s=spread.flank_m_s * math.exp(every + flank),
                toward_rad=spread.toward_rad + turn_rad,
            )
            for spread in self.fire.spreads
        ]
        return AdjustableEllipses(EllipseFire(spreads, self.fire.sources))

    def paths(self, points_m: Floats) -> StraightPaths:
        """Return the paths to points (n, 2), given as x, y in metres."""
        time_s, number = self.fire.arrivals(points_m)
        lit = self.fire.sources[np.maximum(number, 0)]
        return StraightPaths(lit[:, :2].copy(), lit[:, 2].copy(), time_s - lit[:, 2])

    def places(self) -> Floats:
        """Return the positions (k, 2) of the sources, as x, y in metres."""
        return self.fire.sources[:, :2]

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """Return the arrival times (n,) in s at points (n, 2); infinity if unburned."""
        return self.fire.ignition_time_s(points_m)
