"""How fire comes to places, in simulations whose rates can be changed: what corrections rest on.

A way is taken as straight, from where fire was lit to the place.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from firemodel.ellipses.ellipse import EllipseFire

Floats = NDArray[np.float64]


class StraightPaths(NamedTuple):
    """To n places: from ``origin`` (n, 2) x, y, lit at ``lit_s`` (n,), within ``takes_s`` (n,).

    Where fire never comes, ``takes_s`` is infinite and the rest is of some other way.
    """

    origin: Floats
    lit_s: Floats
    takes_s: Floats


class AdjustableFire(Protocol):
    """A fire with its paths, and the same fire at other rates."""

    @property
    def rates_sd(self) -> Floats:
        """Prior standard deviations of what ``rated`` takes; (k,)."""

    @property
    def first_rates(self) -> Floats:
        """Rates (m, k) to begin the search from."""

    def rated(self, rates: Floats) -> "AdjustableFire":
        """The fire with other rates; 0 for those it has."""

    def paths(self, points_m: Floats) -> StraightPaths:
        """To points (n, 2) x, y."""

    def places(self) -> Floats:
        """Some x, y (k, 2) between which the fire was lit."""

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """When fire comes to each point."""


class AdjustableEllipses:
    """An ``EllipseFire``, at least one source lit.

    Rates are logarithms of a factor on all, on the head and on the flanks besides, and a turn of
    the wind in radians.
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
        """All spreads of the fire changed alike."""
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
        """From the source that fire comes from first."""
        time_s, number = self.fire.arrivals(points_m)
        lit = self.fire.sources[np.maximum(number, 0)]
        return StraightPaths(lit[:, :2].copy(), lit[:, 2].copy(), time_s - lit[:, 2])

    def places(self) -> Floats:
        """The sources."""
        return self.fire.sources[:, :2]

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """When fire comes to each point."""
        return self.fire.ignition_time_s(points_m)
