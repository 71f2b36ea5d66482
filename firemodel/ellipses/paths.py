"""Define the paths of fire to places, in simulations whose rates the corrections adjust.

A path is a straight line from the ignition to the place.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from firemodel.arrays import Floats
from firemodel.ellipses.ellipse import EllipseFire


class StraightPaths(NamedTuple):
    """The paths of fire to n places.

    Each path has the place ``origin`` (n, 2) and the time ``lit_s`` (n,) of its ignition, and a
    travel time ``takes_s`` (n,).

    Where fire never arrives, ``takes_s`` is infinite, and ``origin`` and ``lit_s`` are undefined.
    """

    origin: Floats
    lit_s: Floats
    takes_s: Floats


class AdjustableFire(Protocol):
    """A fire that has paths, and rates of spread that can be adjusted."""

    @property
    def rates_sd(self) -> Floats:
        """The prior standard deviations (k,) of the rates that ``rated`` accepts."""

    @property
    def first_rates(self) -> Floats:
        """The sets of rates (m, k) from which the search begins."""

    def rated(self, rates: Floats) -> "AdjustableFire":
        """Return the fire with its rates adjusted by ``rates`` (k,); zeros leave it unchanged."""

    def paths(self, points_m: Floats) -> StraightPaths:
        """Return the paths to points (n, 2), which are x, y in metres."""

    def places(self) -> Floats:
        """Return places (k, 2), as x, y in metres, that enclose the ignitions."""

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """Return the arrival times (n,) in s at points (n, 2); unburned points have infinity."""


class AdjustableEllipses:
    """An ``EllipseFire`` with at least one source, as an ``AdjustableFire``.

    The first three of the four adjustments are logarithms of factors. The first applies to all
    rates of spread; the second and the third apply in addition to the head and to the flanks. The
    fourth adjustment is a turn of the wind in radians.
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
        """Return the paths to points (n, 2), which are x, y in metres."""
        time_s, number = self.fire.arrivals(points_m)
        lit = self.fire.sources[np.maximum(number, 0)]
        return StraightPaths(lit[:, :2].copy(), lit[:, 2].copy(), time_s - lit[:, 2])

    def places(self) -> Floats:
        """Return the places (k, 2) of the sources, as x, y in metres."""
        return self.fire.sources[:, :2]

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """Return the arrival times (n,) in s at points (n, 2); unburned points have infinity."""
        return self.fire.ignition_time_s(points_m)
