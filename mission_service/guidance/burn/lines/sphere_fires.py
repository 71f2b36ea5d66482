"""The fires that a flight's own spheres light, and the danger that they pose to the flight."""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from firemodel.ellipses.point_observations import Simulation
from mission_service.guidance.burn.lines.flight_constraints import (
    FlightConstraints,
    Leg,
    point_on_leg,
)
from mission_service.guidance.burn.lines.hazard import Box, hazard_of

Floats = NDArray[np.float64]

TOWARDS_M2 = 1e-3  # a leg approaches only drops that are ahead of its start by 1 mm or more


def _box(leg: Leg) -> Box:
    (x0, y0, *_), (x1, y1, *_) = leg
    return min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)


def _away_m(leg: Leg, places_m: Floats) -> Floats:
    """Return the horizontal distances of positions (n, 2) from a leg."""
    begin, step = np.array(leg[0][:2]), np.subtract(leg[1][:2], leg[0][:2])
    length2 = max(float(step @ step), 1e-12)
    part = np.clip((places_m - begin) @ step / length2, 0.0, 1.0)
    away: Floats = np.hypot(*(places_m - begin - part[:, None] * step).T)
    return away


def fastest_m_s(fire: Simulation) -> float:
    """Return an upper bound on the rate of spread of an ``EllipseFire``; infinity for others."""
    spreads = getattr(fire, "spreads", None)
    if not spreads:
        return math.inf
    rates = np.array([(one.head_m_s, one.back_m_s, one.flank_m_s) for one in spreads])
    head, back, flank = rates.T
    return float((np.abs(head - back) / 2.0 + np.maximum((head + back) / 2.0, flank)).max())


class SphereFires:
    """The fires that a flight's own spheres light.

    On a leg that approaches any of the drops, or descends vertically, the time margin applies to
    these fires, as it does to other fire. On a leg away from all drops, only fire that burns within
    reach is a danger. For example, the leg directly after a drop is safe, although the sphere
    ignites within the time margin.
    """

    def __init__(self, air: FlightConstraints) -> None:
        self.air = air
        self.sources: Floats = np.empty((0, 3))

    def add_drop(self, x_m: float, y_m: float, dropped_s: float) -> None:
        """Add the fire that a drop lights."""
        ignites_s = dropped_s + self.air.settings.ignition_delay_s
        self.sources = np.concatenate([self.sources, [[x_m, y_m, ignites_s]]])

    def approaches(self, leg: Leg) -> bool:
        """Return whether a leg approaches any drop, so that the time margin applies.

        A vertical leg counts as an approach if it descends.
        """
        begin, end = leg
        if begin[:2] == end[:2]:
            return end.height_m < begin.height_m
        step = np.array([end.x_m - begin.x_m, end.y_m - begin.y_m])
        towards = (self.sources[:, :2] - (begin.x_m, begin.y_m)) @ step
        return bool((towards > TOWARDS_M2 * math.hypot(*step)).any())

    def margin_s(self, leg: Leg) -> float:
        """Return the time margin of a leg.

        If the leg leads away from all drops, the margin is negative (danger) or infinite.
        """
        if not len(self.sources) or self.air.is_high(leg):
            return math.inf
        approaches = self.approaches(leg)
        begin, end = leg
        if approaches or begin[:2] == end[:2]:
            parts = 1
        else:  # a sphere that ignites during a long leg is no danger at the start of the leg
            part_s = max(self.air.settings.ignition_delay_s / 4.0, 1.0)
            parts = max(math.ceil((end.at_s - begin.at_s) / part_s), 1)
        ends = [begin, *(point_on_leg(leg, number / parts) for number in range(1, parts)), end]
        min_margin_s = min(self._margin_s(part, approaches) for part in pairwise(ends))
        return min_margin_s if approaches or min_margin_s < 0.0 else math.inf

    def _margin_s(self, leg: Leg, approaches: bool) -> float:
        begin, end = leg
        later_s = self.air.settings.time_margin_s if approaches else 0.0
        sources = self.sources[self.sources[:, 2] < end.at_s + later_s]
        if len(sources):
            spread_m = fastest_m_s(self.air.lights(sources)) * (end.at_s + later_s - sources[:, 2])
            reach_m = self.air.hazard.margins.reach_m + self.air.hazard.cell_m
            sources = sources[_away_m(leg, sources[:, :2]) <= reach_m + spread_m]
        if not len(sources):
            return math.inf
        hazard = hazard_of(
            self.air.lights(sources),
            _box(leg),
            self.air.hazard.margins,
            cell_m=self.air.hazard.cell_m,
            begins_s=float(sources[:, 2].min()),
        )
        return hazard.leg_margin_s(begin.x_m, begin.y_m, begin.at_s, end.x_m, end.y_m, end.at_s)

    def burns_by(self, x_m: float, y_m: float, at_s: float) -> bool:
        """Return whether any of these fires reaches a position by the time ``at_s``."""
        if not len(self.sources) or at_s <= self.sources[:, 2].min():
            return False
        fire = self.air.lights(self.sources)
        return float(fire.ignition_time_s(np.array([[x_m, y_m]]))[0]) <= at_s
