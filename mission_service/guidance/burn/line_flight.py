"""Plans a flight along an ignition line, and checks the safety of all legs and drops."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.ellipses.observations import Simulation
from mission_service.config.sections import BurnSection
from mission_service.guidance.burn.burn_unit import BurnUnit
from mission_service.guidance.burn.hazard import Box, Hazard, hazard_of
from mission_service.guidance.burn.visibility_graph import VisibilityGraph

Floats = NDArray[np.float64]
# Returns a fire that has only these sources (n, 3): x, y, at_s.
FireOfSources = Callable[[Floats], Simulation]

HIGH_M = 1e-6  # tolerance when heights are compared with the safe height
TOWARDS_M2 = 1e-3  # minimum approach of a leg to a drop, times the leg's length
CLIMB_EVERY_M, CLIMBS = 5.0, 12  # minimum spacing and maximum number of climbs tried on a leg
OUT_M = (0.0, 15.0, 30.0, 45.0)  # distances from a drop at which a climb is tried
DOWN_SPARE_M = 1.0  # added to the distance margin of descents; more than a raster's error
ROUNDED_S = 1e-6


class FlightPoint(NamedTuple):
    """A point of a flight: x, y and height above ground in metres, and mission time in seconds."""

    x_m: float
    y_m: float
    height_m: float
    at_s: float


Leg = tuple[FlightPoint, FlightPoint]
Route = list[FlightPoint]  # points joined by straight legs, from the vehicle's position on


def point_on_leg(leg: Leg, part: float) -> FlightPoint:
    """Return the point on a leg after a share (0 to 1) of its time."""
    begin, end = leg
    return FlightPoint(*(one + part * (other - one) for one, other in zip(begin, end, strict=True)))


def _box(leg: Leg) -> Box:
    (x0, y0, *_), (x1, y1, *_) = leg
    return min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)


def _away_m(leg: Leg, places_m: Floats) -> Floats:
    """Return the horizontal distances of places (n, 2) from a leg."""
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


@dataclass(frozen=True, eq=False)
class FlightConstraints:
    """The area, the fire and the settings against which flights are checked.

    ``low`` is the graph for paths below the safe height, and ``high`` the graph for paths at this
    height. The vehicle lands at ``home_m``.
    """

    unit: BurnUnit
    settings: BurnSection
    fire: Simulation
    lights: FireOfSources
    hazard: Hazard
    low: VisibilityGraph
    high: VisibilityGraph | None  # graph inside the fence
    home_m: tuple[float, float]
    places: dict[tuple[float, float], Hazard] = field(default_factory=dict)

    def fly_to(self, start: FlightPoint, x_m: float, y_m: float, height_m: float) -> FlightPoint:
        """Return the end point of a straight leg that is flown at the speeds in the settings."""
        up_m = height_m - start.height_m
        rate = self.settings.climb_m_s if up_m > 0.0 else self.settings.sink_m_s
        level_m = math.hypot(x_m - start.x_m, y_m - start.y_m)
        duration_s = level_m / self.settings.speed_m_s + abs(up_m) / rate
        return FlightPoint(x_m, y_m, height_m, start.at_s + duration_s)

    def along(self, route: Route, places: list[tuple[float, float]]) -> Route:
        """Return a route that continues at its last height through ``places``.

        The first of the places is the end of the given route.
        """
        for x_m, y_m in places[1:]:
            route = [*route, self.fly_to(route[-1], x_m, y_m, route[-1].height_m)]
        return route

    def straight_up(self, start: FlightPoint) -> Route:
        """Return the route from ``start`` straight up to the safe height."""
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
        """Return the time to fly home from ``start`` and land; infinity without a path.

        ``start`` is at the safe height.
        """
        path = self.high_path(start, *self.home_m)
        if path is None:
            return math.inf
        above = self.along([start], path)[-1]
        return self.fly_to(above, *self.home_m, 0.0).at_s - start.at_s

    def margin_s(self, leg: Leg) -> float:
        """Return the time by which a leg is ahead of fire.

        If the result on the raster is unclear, a finer raster is used. On the finer raster a
        descent has a larger distance margin, because the next leg must be safe as well.
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
        """Return the hazard on a raster around a point outside the main raster, like the start."""
        key = point[:2]
        if key not in self.places:
            self.places[key] = self.hazard.over((*key, *key), self.hazard.cell_m)
        return self.places[key]

    def is_high(self, leg: Leg) -> bool:
        """Return whether the whole leg is at or above the safe height."""
        return min(leg[0].height_m, leg[1].height_m) >= self.settings.safe_height_m - HIGH_M


class SphereFires:
    """The fires that a flight's own spheres light.

    On a leg that approaches any of the drops, or descends from the safe height, these fires are
    tested with the time margin, like other fire. On a leg away from all drops, only fire that burns
    within reach is a danger. An example is the leg directly after a drop, whose sphere ignites
    within the time margin.
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
        else:  # a sphere that ignites at the end of a long leg is no danger at its start
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
        """Return whether any of these fires reaches a place by the time ``at_s``."""
        if not len(self.sources) or at_s <= self.sources[:, 2].min():
            return False
        fire = self.air.lights(self.sources)
        return float(fire.ignition_time_s(np.array([[x_m, y_m]]))[0]) <= at_s


@dataclass(frozen=True, eq=False)
class LineFlight:
    """A checked flight; ``why_ended`` is the reason for an early end ("" without one)."""

    route: tuple[FlightPoint, ...]
    drops: Floats  # (m, 3) x, y, at_s
    skipped: Floats  # (k, 2) places without a drop
    min_margin_s: float
    climbs_first: bool
    home_s: float  # duration of the return from the flight's end to the ground at home
    why_ended: Literal["", "spheres", "battery"]

    @property
    def duration_s(self) -> float:
        """Return the duration from the flight's start to its end."""
        return self.route[-1].at_s - self.route[0].at_s


def fly_line(
    air: FlightConstraints, start: FlightPoint, places_m: Floats, spheres: int, battery_s: float
) -> LineFlight:
    """Plan a flight with drops at as many of the places (n, 2) as possible, in their order.

    The flight ends with a climb to the safe height. A place is skipped if it cannot be reached
    safely, if a drop is not safe at the time of arrival, or if no safe climb leads away from it.
    The flight ends early if the spheres or the battery do not suffice for another drop.
    ``battery_s`` is the maximum flight time, including the return.
    """
    trip = _flight(air, start, places_m, spheres, battery_s, careful=False)
    # Check all drops at once: whether the fire of one drop reaches another before it ignites.
    lit = trip.drops + np.array([0.0, 0.0, air.settings.ignition_delay_s])
    if (air.lights(lit).ignition_time_s(lit[:, :2]) < lit[:, 2] - ROUNDED_S).any():
        return _flight(air, start, places_m, spheres, battery_s, careful=True)
    return trip


def _flight(
    air: FlightConstraints,
    start: FlightPoint,
    places_m: Floats,
    spheres: int,
    battery_s: float,
    careful: bool,
) -> LineFlight:
    flight = LineFlightBuilder(air, start)
    flight.climb_out_of_danger()
    home_s, out_margin_s = math.inf, math.inf
    burns_s = air.fire.ignition_time_s(places_m)
    drops: list[tuple[float, float, float]] = []
    skipped: list[tuple[float, float]] = []
    why: Literal["", "spheres", "battery"] = ""
    min_gap_s = 60.0 / air.settings.max_drops_per_min - ROUNDED_S
    for (x_m, y_m), base_s in zip(places_m.tolist(), burns_s.tolist(), strict=True):
        if len(drops) >= spheres:
            why = "spheres"
            break
        found = flight.towards(x_m, y_m)
        at_s = math.inf if found is None else found[0][-1].at_s
        ignites_s = at_s + air.settings.ignition_delay_s
        good = base_s > ignites_s and not (drops and at_s - drops[-1][2] < min_gap_s)
        good = good and not (careful and flight.own.burns_by(x_m, y_m, ignites_s))
        escape = flight.escape(found[0], at_s) if good and found is not None else None
        if found is None or escape is None:
            skipped.append((x_m, y_m))
            continue
        new_home_s = air.home_s(escape[0][-1])
        if escape[0][-1].at_s - start.at_s + new_home_s > battery_s:
            why = "battery"
            break
        flight.add_route(*found)
        flight.own.add_drop(x_m, y_m, at_s)
        drops.append((x_m, y_m, at_s))
        (flight.out, out_margin_s), home_s = escape, new_home_s
    flight.add_route(flight.out, out_margin_s)
    return LineFlight(
        tuple(flight.route),
        np.array(drops, np.float64).reshape(-1, 3),
        np.array(skipped, np.float64).reshape(-1, 2),
        flight.min_margin_s,
        flight.climbs_first,
        home_s,
        why,
    )


class LineFlightBuilder:
    """The builder of a flight, which adds legs and finds safe routes from the flight's end."""

    def __init__(self, air: FlightConstraints, start: FlightPoint) -> None:
        self.air, self.settings = air, air.settings
        self.own = SphereFires(air)
        self.route: Route = [start]
        self.out: Route = []  # route from the last drop to the safe height
        self.min_margin_s = math.inf
        self.climbs_first = False

    def checked(self, route: Route, own: SphereFires | None = None) -> float | None:
        """Return the smallest time margin of a route, or None if the route is unsafe."""
        min_margin_s = math.inf
        for leg in pairwise(route):
            margin_s = min(self.air.margin_s(leg), (own or self.own).margin_s(leg))
            if margin_s < self.settings.time_margin_s:
                return None
            min_margin_s = min(min_margin_s, margin_s)
        return min_margin_s

    def add_route(self, route: Route, margin_s: float) -> None:
        """Append a route, with its time margin, that begins at the end of the flight."""
        self.route += route[1:]
        self.min_margin_s = min(self.min_margin_s, margin_s)

    def climb_out_of_danger(self) -> None:
        """Add a climb to the safe height if the start is in danger."""
        start = self.route[0]
        if self.air.margin_s((start, start)) < self.settings.time_margin_s:
            route = self.air.straight_up(start)
            self.add_route(route, self.air.margin_s((start, route[-1])))
            self.climbs_first = True

    def towards(self, x_m: float, y_m: float) -> tuple[Route, float] | None:
        """Return the fastest safe route to the drop height at a place, with its margin, or None.

        The route is either low (straight, or around areas closed to low flight) or at the safe
        height. If a climb is not safe at the present position, the route stays low until it is.
        """
        start = self.route[-1]
        low = self._with_margin(self._low(start, x_m, y_m))
        # No other route is faster than one with a single horizontal leg.
        if low is not None and sum(one[:2] != other[:2] for one, other in pairwise(low[0])) <= 1:
            return low
        up = self._up(start, x_m, y_m)
        high = None if up is None else self._with_margin(self._over(up, x_m, y_m))
        safe = [found for found in (low, high) if found is not None]
        return min(safe, key=lambda found: found[0][-1].at_s, default=None)

    def _with_margin(self, route: Route | None) -> tuple[Route, float] | None:
        margin_s = None if route is None else self.checked(route)
        return None if route is None or margin_s is None else (route, margin_s)

    def _up(self, start: FlightPoint, x_m: float, y_m: float) -> Route | None:
        """Return a safe route to the safe height, or None.

        The route climbs at once, follows the escape route, or climbs on the straight line to (x,
        y).
        """
        for route in (self.air.straight_up(start), self.out):
            if route and route[0] == start and self.checked(route) is not None:
                return route
        low = self._level(start)
        away_m = math.hypot(x_m - start.x_m, y_m - start.y_m)
        every_m = max(CLIMB_EVERY_M, away_m / CLIMBS)
        for number in range(1, math.ceil(away_m / every_m)):
            part = number * every_m / away_m
            end = (start.x_m + part * (x_m - start.x_m), start.y_m + part * (y_m - start.y_m))
            if not low or not self.air.low.is_straight_clear((start.x_m, start.y_m), end):
                return None
            flown = self.air.along(low, [(start.x_m, start.y_m), end])
            if self.checked(flown) is None:
                return None
            route = [*flown, *self.air.straight_up(flown[-1])[1:]]
            if self.checked(route) is not None:
                return route
        return None

    def escape(self, approach: Route, dropped_s: float) -> tuple[Route, float] | None:
        """Return a safe route from a drop to the safe height, with its margin, or None.

        The route is also safe from the drop's own fire. The route leads straight up, or first a
        short distance ahead or upwind.
        """
        drop = approach[-1]
        own = SphereFires(self.air)
        own.sources = self.own.sources
        own.add_drop(drop.x_m, drop.y_m, dropped_s)
        upwind_rad = self.air.hazard.margins.toward_rad + math.pi
        before = next((point for point in approach[::-1] if point[:2] != drop[:2]), None)
        ahead_rad = upwind_rad
        if before is not None:
            ahead_rad = math.atan2(drop.y_m - before.y_m, drop.x_m - before.x_m)
        for away_m in OUT_M:
            for angle_rad in (ahead_rad, upwind_rad) if away_m else (ahead_rad,):
                x = drop.x_m + away_m * math.cos(angle_rad)
                y = drop.y_m + away_m * math.sin(angle_rad)
                path = [(drop.x_m, drop.y_m), (x, y)] if away_m else [(drop.x_m, drop.y_m)]
                if away_m and not self.air.low.is_straight_clear(path[0], path[1]):
                    continue
                level = self.air.along([drop], path)
                route = [*level, *self.air.straight_up(level[-1])[1:]]
                margin_s = self.checked(route, own)
                if margin_s is not None:
                    return route, margin_s
        return None

    def _level(self, start: FlightPoint) -> Route | None:
        """Return the vertical route to the drop height; None at the safe height."""
        if start.height_m >= self.settings.safe_height_m - HIGH_M:
            return None
        if start.height_m == self.settings.drop_height_m:
            return [start]
        return [start, self.air.fly_to(start, start.x_m, start.y_m, self.settings.drop_height_m)]

    def _low(self, start: FlightPoint, x_m: float, y_m: float) -> Route | None:
        """Return the route to a place at the drop height, or None if there is no low path."""
        level = self._level(start)
        path = self.air.low.shortest_path((start.x_m, start.y_m), (x_m, y_m)) if level else None
        return None if path is None or level is None else self.air.along(level, path)

    def _over(self, up: Route, x_m: float, y_m: float) -> Route | None:
        """Return the route ``up``, continued over a place and down to the drop height, or None."""
        path = self.air.high_path(up[-1], x_m, y_m)
        if path is None:
            return None
        route = self.air.along(up, path)
        if route[-1].height_m > self.settings.safe_height_m:
            route = [*route, self.air.fly_to(route[-1], x_m, y_m, self.settings.safe_height_m)]
        return [*route, self.air.fly_to(route[-1], x_m, y_m, self.settings.drop_height_m)]
