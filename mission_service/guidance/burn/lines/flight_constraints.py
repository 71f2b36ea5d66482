"""Constraints on a flight in a burn: the unit, the fence, the settings, and danger from fire."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.ellipses.point_observations import Simulation
from mission_service.config.sections import BurnSection
from mission_service.guidance.burn.burn_unit import BurnUnit
from mission_service.guidance.burn.lines.hazard import Hazard
from mission_service.visibility_graph import VisibilityGraph

Floats = NDArray[np.float64]
# Returns the fire that spreads from the given sources only (n, 3: x, y, at_s).
FireOfSources = Callable[[Floats], Simulation]

HIGH_M = 1e-6  # tolerance when heights are compared with the safe height
DOWN_SPARE_M = 1.0  # added to the distance margin of descents; larger than a raster's error


class FlightPoint(NamedTuple):
    """A point of a flight: x, y and height above ground in metres, and mission time in seconds."""

    x_m: float
    y_m: float
    height_m: float
    at_s: float


Leg = tuple[FlightPoint, FlightPoint]
Route = list[FlightPoint]  # points joined by straight legs, beginning at the vehicle's position


def point_on_leg(leg: Leg, part: float) -> FlightPoint:
    """Return the point on a leg after a fraction (0 to 1) of the leg's duration."""
    begin, end = leg
    return FlightPoint(*(one + part * (other - one) for one, other in zip(begin, end, strict=True)))


@dataclass(frozen=True, eq=False)
class FlightConstraints:
    """The area, the fire and the settings against which flights are checked.

    ``low`` is the visibility graph for paths below the safe height, and ``high`` is the visibility
    graph for paths at the safe height. The vehicle lands at ``home_m``.
    """

    unit: BurnUnit
    settings: BurnSection
    fire: Simulation
    lights: FireOfSources
    hazard: Hazard
    low: VisibilityGraph
    high: VisibilityGraph | None  # inside the fence; None without a fence
    home_m: tuple[float, float]
    places: dict[tuple[float, float], Hazard] = field(default_factory=dict)

    def fly_to(self, start: FlightPoint, x_m: float, y_m: float, height_m: float) -> FlightPoint:
        """Return the end point of a straight leg flown at the speeds in the settings."""
        up_m = height_m - start.height_m
        rate = self.settings.climb_m_s if up_m > 0.0 else self.settings.sink_m_s
        level_m = math.hypot(x_m - start.x_m, y_m - start.y_m)
        duration_s = level_m / self.settings.speed_m_s + abs(up_m) / rate
        return FlightPoint(x_m, y_m, height_m, start.at_s + duration_s)

    def along(self, route: Route, places: list[tuple[float, float]]) -> Route:
        """Return the given route, continued at its last height through ``places``.

        The first position is the end of the given route.
        """
        for x_m, y_m in places[1:]:
            route = [*route, self.fly_to(route[-1], x_m, y_m, route[-1].height_m)]
        return route

    def straight_up(self, start: FlightPoint) -> Route:
        """Return the route from ``start`` vertically up to the safe height."""
        if start.height_m >= self.settings.safe_height_m:
            return [start]
        return [start, self.fly_to(start, start.x_m, start.y_m, self.settings.safe_height_m)]

    def high_path(
        self, start: FlightPoint, x_m: float, y_m: float
    ) -> list[tuple[float, float]] | None:
        """Return the path to (x, y) at the safe height and inside the fence, or None."""
        begin, end = (start.x_m, start.y_m), (x_m, y_m)
        return [begin, end] if self.high is None else self.high.shortest_path(begin, end)

    def home_s(self, start: FlightPoint) -> float:
        """Return the time to fly home from ``start`` and land; infinity if there is no path.

        ``start`` is at the safe height.
        """
        path = self.high_path(start, *self.home_m)
        if path is None:
            return math.inf
        above = self.along([start], path)[-1]
        return self.fly_to(above, *self.home_m, 0.0).at_s - start.at_s

    def margin_s(self, leg: Leg) -> float:
        """Return the time margin of a leg: the shortest time until fire comes within reach.

        If the main raster is too coarse for a decision, a finer raster is used. On the finer raster
        a descent has a larger distance margin, because the next leg must be safe as well.
        """
        if self.is_high(leg):
            return math.inf
        begin, end = leg
        ends = (begin.x_m, begin.y_m, begin.at_s, end.x_m, end.y_m, end.at_s)
        margin_s = self.hazard.leg_margin_s(*ends)
        if margin_s >= self.settings.time_margin_s:
            return margin_s
        if margin_s == -math.inf:
            return (
                margin_s if begin[:2] != end[:2] else self._hazard_around(begin).leg_margin_s(*ends)
            )
        if self.hazard.surely_in_danger(*ends):
            return margin_s
        more_m = DOWN_SPARE_M if end.height_m < begin.height_m else 0.0
        return max(margin_s, self.hazard.fine.leg_margin_s(*ends, more_m=more_m))

    def _hazard_around(self, point: FlightPoint) -> Hazard:
        """Return the hazard around a point that may be outside the main raster, e.g. the start."""
        key = point[:2]
        if key not in self.places:
            self.places[key] = self.hazard.over((*key, *key), self.hazard.cell_m)
        return self.places[key]

    def is_high(self, leg: Leg) -> bool:
        """Return whether the whole leg is at or above the safe height."""
        return min(leg[0].height_m, leg[1].height_m) >= self.settings.safe_height_m - HIGH_M
