"""One flight along an ignition line, with all legs and drops checked for safety."""

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
FireOfSources = Callable[[Floats], Simulation]  # sources (n, 3) x, y, at_s: the fire of them alone

HIGH_M = 1e-6  # a height so little below the safe one is safe
TOWARDS_M2 = 1e-3  # a leg that nears a drop by less (times its length) goes away from it
CLIMB_EVERY_M, CLIMBS = 5.0, 12  # places along a leg tried for a climb: spacing, number
OUT_M = (0.0, 15.0, 30.0, 45.0)  # distances from a drop at which a climb is tried
DOWN_SPARE_M = 1.0  # more than the error of rasters
ROUNDED_S = 1e-6


class FlightPoint(NamedTuple):
    """A place of a flight: metres, above the ground, seconds of mission time."""

    x_m: float
    y_m: float
    height_m: float
    at_s: float


Route = list[FlightPoint]  # from where the vehicle is; flown straight


def point_on_leg(leg: tuple[FlightPoint, FlightPoint], part: float) -> FlightPoint:
    """The point on a leg after a part (0 to 1) of its time."""
    begin, end = leg
    return FlightPoint(*(one + part * (other - one) for one, other in zip(begin, end, strict=True)))


def _box(leg: tuple[FlightPoint, FlightPoint]) -> Box:
    (x0, y0, *_), (x1, y1, *_) = leg
    return min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)


def _away_m(leg: tuple[FlightPoint, FlightPoint], places_m: Floats) -> Floats:
    """Distances of places (n, 2) from a leg."""
    begin, step = np.array(leg[0][:2]), np.subtract(leg[1][:2], leg[0][:2])
    length2 = max(float(step @ step), 1e-12)
    part = np.clip((places_m - begin) @ step / length2, 0.0, 1.0)
    away: Floats = np.hypot(*(places_m - begin - part[:, None] * step).T)
    return away


def fastest_m_s(fire: Simulation) -> float:
    """An upper bound of a fire's rate of spread, by ``EllipseFire.spreads``; else infinity."""
    spreads = getattr(fire, "spreads", None)
    if not spreads:
        return math.inf
    rates = np.array([(one.head_m_s, one.back_m_s, one.flank_m_s) for one in spreads])
    head, back, flank = rates.T
    return float((np.abs(head - back) / 2.0 + np.maximum((head + back) / 2.0, flank)).max())


@dataclass(frozen=True, eq=False)
class FlightConstraints:
    """The area, the fire and the settings that flights are checked against.

    ``low`` and ``high`` are for paths below and at the safe height; the vehicle lands at
    ``home_m``.
    """

    unit: BurnUnit
    settings: BurnSection
    fire: Simulation
    lights: FireOfSources
    hazard: Hazard
    low: VisibilityGraph
    high: VisibilityGraph | None  # inside the fence
    home_m: tuple[float, float]
    places: dict[tuple[float, float], Hazard] = field(default_factory=dict)

    def fly_to(self, here: FlightPoint, x_m: float, y_m: float, height_m: float) -> FlightPoint:
        """The end of a straight leg: level at speed, or straight up or down at their rates."""
        up_m = height_m - here.height_m
        rate = self.settings.climb_m_s if up_m > 0.0 else self.settings.sink_m_s
        level_m = math.hypot(x_m - here.x_m, y_m - here.y_m)
        taken_s = level_m / self.settings.speed_m_s + abs(up_m) / rate
        return FlightPoint(x_m, y_m, height_m, here.at_s + taken_s)

    def along(self, route: Route, places: list[tuple[float, float]]) -> Route:
        """A route continued at its height through places, of which the first is its end."""
        for x_m, y_m in places[1:]:
            route = [*route, self.fly_to(route[-1], x_m, y_m, route[-1].height_m)]
        return route

    def straight_up(self, here: FlightPoint) -> Route:
        """The route straight up to the safe height."""
        if here.height_m >= self.settings.safe_height_m:
            return [here]
        return [here, self.fly_to(here, here.x_m, here.y_m, self.settings.safe_height_m)]

    def high_path(
        self, here: FlightPoint, x_m: float, y_m: float
    ) -> list[tuple[float, float]] | None:
        """The path at the safe height, inside the fence; None if there is none."""
        begin, end = (here.x_m, here.y_m), (x_m, y_m)
        return [begin, end] if self.high is None else self.high.shortest_path(begin, end)

    def home_s(self, here: FlightPoint) -> float:
        """Time from the safe height here to the ground at home; infinity without a path."""
        way = self.high_path(here, *self.home_m)
        if way is None:
            return math.inf
        above = self.along([here], way)[-1]
        return self.fly_to(above, *self.home_m, 0.0).at_s - here.at_s

    def margin_s(self, leg: tuple[FlightPoint, FlightPoint]) -> float:
        """The time by which a leg is ahead of fire.

        Where the raster does not decide, a finer one is used. A descent keeps a little farther
        away, since the next leg must be safe as well.
        """
        if self.is_high(leg):
            return math.inf
        begin, end = leg
        ends = (begin.x_m, begin.y_m, begin.at_s, end.x_m, end.y_m, end.at_s)
        margin_s = self.hazard.leg_margin_s(*ends)
        if margin_s >= self.settings.time_margin_s:
            return margin_s
        if margin_s == -math.inf:
            return margin_s if begin[:2] != end[:2] else self._elsewhere(begin).leg_margin_s(*ends)
        if self.hazard.surely_in_danger(*ends):
            return margin_s
        more_m = DOWN_SPARE_M if end.height_m < begin.height_m else 0.0
        return max(margin_s, self.hazard.fine.leg_margin_s(*ends, more_m=more_m))

    def _elsewhere(self, here: FlightPoint) -> Hazard:
        """A raster around a place outside the other one, as the start may be."""
        key = here[:2]
        if key not in self.places:
            self.places[key] = self.hazard.over((*key, *key), self.hazard.cell_m)
        return self.places[key]

    def is_high(self, leg: tuple[FlightPoint, FlightPoint]) -> bool:
        """Whether all of a leg is at the safe height or above."""
        return min(leg[0].height_m, leg[1].height_m) >= self.settings.safe_height_m - HIGH_M


class SphereFires:
    """The fires that a flight's own spheres will light.

    On a leg that nears any of its drops, or descends from the safe height, they count like any
    fire, with the margin of time. On a leg away from all of them (as right after a drop, when the
    sphere below ignites within that margin) none may burn within reach.
    """

    def __init__(self, air: FlightConstraints) -> None:
        self.air = air
        self.sources: Floats = np.empty((0, 3))

    def add_drop(self, x_m: float, y_m: float, dropped_s: float) -> None:
        """Add a drop."""
        burns_s = dropped_s + self.air.settings.ignition_delay_s
        self.sources = np.concatenate([self.sources, [[x_m, y_m, burns_s]]])

    def nears(self, leg: tuple[FlightPoint, FlightPoint]) -> bool:
        """Whether a leg nears any drop, so that drops count with the margin of time."""
        begin, end = leg
        if begin[:2] == end[:2]:
            return end.height_m < begin.height_m
        step = np.array([end.x_m - begin.x_m, end.y_m - begin.y_m])
        towards = (self.sources[:, :2] - (begin.x_m, begin.y_m)) @ step
        return bool((towards > TOWARDS_M2 * math.hypot(*step)).any())

    def margin_s(self, leg: tuple[FlightPoint, FlightPoint]) -> float:
        """The margin as for any fire on a leg that nears drops; else infinity, or less than 0 s."""
        if not len(self.sources) or self.air.is_high(leg):
            return math.inf
        nears = self.nears(leg)
        begin, end = leg
        if nears or begin[:2] == end[:2]:
            parts = 1
        else:  # a sphere that ignites at the end of a long leg is no danger at its begin
            short_s = max(self.air.settings.ignition_delay_s / 4.0, 1.0)
            parts = max(math.ceil((end.at_s - begin.at_s) / short_s), 1)
        ends = [begin, *(point_on_leg(leg, number / parts) for number in range(1, parts)), end]
        min_margin_s = min(self._margin_s(part, nears) for part in pairwise(ends))
        return min_margin_s if nears or min_margin_s < 0.0 else math.inf

    def _margin_s(self, leg: tuple[FlightPoint, FlightPoint], nears: bool) -> float:
        begin, end = leg
        later_s = self.air.settings.time_margin_s if nears else 0.0
        matter = self.sources[self.sources[:, 2] < end.at_s + later_s]
        if len(matter):
            spread_m = fastest_m_s(self.air.lights(matter)) * (end.at_s + later_s - matter[:, 2])
            reach_m = self.air.hazard.margins.reach_m + self.air.hazard.cell_m
            matter = matter[_away_m(leg, matter[:, :2]) <= reach_m + spread_m]
        if not len(matter):
            return math.inf
        hazard = hazard_of(
            self.air.lights(matter),
            _box(leg),
            self.air.hazard.margins,
            cell_m=self.air.hazard.cell_m,
            begins_s=float(matter[:, 2].min()),
        )
        return hazard.leg_margin_s(begin.x_m, begin.y_m, begin.at_s, end.x_m, end.y_m, end.at_s)

    def burns_by(self, x_m: float, y_m: float, at_s: float) -> bool:
        """Whether one of these fires reaches a place by a time."""
        if not len(self.sources) or at_s <= self.sources[:, 2].min():
            return False
        fire = self.air.lights(self.sources)
        return float(fire.ignition_time_s(np.array([[x_m, y_m]]))[0]) <= at_s


@dataclass(frozen=True, eq=False)
class LineFlight:
    """A checked flight. ``drops`` (m, 3) x, y, at_s; ``skipped`` (k, 2); ``why_ended`` if early."""

    route: tuple[FlightPoint, ...]
    drops: Floats
    skipped: Floats
    min_margin_s: float
    climbs_first: bool
    home_s: float  # duration of the way from its end to the ground at home
    why_ended: Literal["", "spheres", "battery"]

    @property
    def duration_s(self) -> float:
        """Duration from begin to end."""
        return self.route[-1].at_s - self.route[0].at_s


def fly_line(
    air: FlightConstraints, start: FlightPoint, places_m: Floats, spheres: int, battery_s: float
) -> LineFlight:
    """Drop at the places (n, 2) in their order, as many as can be, then climb and hold.

    A place that cannot be reached safely, is not safe to drop at when it is reached, or could not
    be left upwards, is skipped for the next, from where the vehicle is. It ends where spheres or
    the battery (seconds to be in the air at most, way home included) do not suffice for one more.
    """
    trip = _flown(air, start, places_m, spheres, battery_s, careful=False)
    # One check for all drops: whether an earlier one's fire reaches a later one before it ignites.
    lit = trip.drops + np.array([0.0, 0.0, air.settings.ignition_delay_s])
    if (air.lights(lit).ignition_time_s(lit[:, :2]) < lit[:, 2] - ROUNDED_S).any():
        return _flown(air, start, places_m, spheres, battery_s, careful=True)
    return trip


def _flown(
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
        lands_s = at_s + air.settings.ignition_delay_s
        good = base_s > lands_s and not (drops and at_s - drops[-1][2] < min_gap_s)
        good = good and not (careful and flight.own.burns_by(x_m, y_m, lands_s))
        way_out = flight.way_out(found[0], at_s) if good and found is not None else None
        if found is None or way_out is None:
            skipped.append((x_m, y_m))
            continue
        then_home_s = air.home_s(way_out[0][-1])
        if way_out[0][-1].at_s - start.at_s + then_home_s > battery_s:
            why = "battery"
            break
        flight.add_route(*found)
        flight.own.add_drop(x_m, y_m, at_s)
        drops.append((x_m, y_m, at_s))
        (flight.out, out_margin_s), home_s = way_out, then_home_s
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
    """A flight as it is built leg by leg, and the safe routes from its end."""

    def __init__(self, air: FlightConstraints, start: FlightPoint) -> None:
        self.air, self.settings = air, air.settings
        self.own = SphereFires(air)
        self.route: Route = [start]
        self.out: Route = []  # from the last drop to the safe height
        self.min_margin_s = math.inf
        self.climbs_first = False

    def checked(self, route: Route, own: SphereFires | None = None) -> float | None:
        """The smallest margin of a route; None if it is unsafe."""
        min_margin_s = math.inf
        for leg in pairwise(route):
            margin_s = min(self.air.margin_s(leg), (own or self.own).margin_s(leg))
            if margin_s < self.settings.time_margin_s:
                return None
            min_margin_s = min(min_margin_s, margin_s)
        return min_margin_s

    def add_route(self, route: Route, margin_s: float) -> None:
        """Append a route that begins where the flight ends."""
        self.route += route[1:]
        self.min_margin_s = min(self.min_margin_s, margin_s)

    def climb_out_of_danger(self) -> None:
        """Climb at once if the start is in danger."""
        start = self.route[0]
        if self.air.margin_s((start, start)) < self.settings.time_margin_s:
            route = self.air.straight_up(start)
            self.add_route(route, self.air.margin_s((start, route[-1])))
            self.climbs_first = True

    def towards(self, x_m: float, y_m: float) -> tuple[Route, float] | None:
        """The fastest safe route to the drop height at a place, with its margin; None if none is.

        Low (straight, or around areas closed to low flight) or at the safe height. If a climb is
        not safe where the vehicle is, it flies on low as far as it must, and never into danger.
        """
        here = self.route[-1]
        low = self._with_margin(self._low(here, x_m, y_m))
        if low is not None and self._is_straight(low[0]):
            return low
        up = self._up(here, x_m, y_m)
        high = None if up is None else self._with_margin(self._over(up, x_m, y_m))
        safe = [found for found in (low, high) if found is not None]
        return min(safe, key=lambda found: found[0][-1].at_s, default=None)

    def _with_margin(self, route: Route | None) -> tuple[Route, float] | None:
        margin_s = None if route is None else self.checked(route)
        return None if route is None or margin_s is None else (route, margin_s)

    def _is_straight(self, low: Route) -> bool:
        """Whether a low route has one horizontal leg at most: then no other one is faster."""
        return sum(one[:2] != other[:2] for one, other in pairwise(low)) <= 1

    def _up(self, here: FlightPoint, x_m: float, y_m: float) -> Route | None:
        """A route to the safe height: here, by the way out, or on the line to (x, y)."""
        for route in (self.air.straight_up(here), self.out):
            if route and route[0] == here and self.checked(route) is not None:
                return route
        low = self._level(here)
        away_m = math.hypot(x_m - here.x_m, y_m - here.y_m)
        every_m = max(CLIMB_EVERY_M, away_m / CLIMBS)
        for number in range(1, math.ceil(away_m / every_m)):
            part = number * every_m / away_m
            there = (here.x_m + part * (x_m - here.x_m), here.y_m + part * (y_m - here.y_m))
            if not low or not self.air.low.is_straight_clear((here.x_m, here.y_m), there):
                return None
            flown = self.air.along(low, [(here.x_m, here.y_m), there])
            if self.checked(flown) is None:
                return None
            route = [*flown, *self.air.straight_up(flown[-1])[1:]]
            if self.checked(route) is not None:
                return route
        return None

    def way_out(self, arrives: Route, dropped_s: float) -> tuple[Route, float] | None:
        """A route from a drop to the safe height, safe from its own fire; None if there is none.

        Straight up, or else a little farther on or upwind first.
        """
        here = arrives[-1]
        own = SphereFires(self.air)
        own.sources = self.own.sources
        own.add_drop(here.x_m, here.y_m, dropped_s)
        upwind_rad = self.air.hazard.margins.toward_rad + math.pi
        before = next((place for place in arrives[::-1] if place[:2] != here[:2]), None)
        onwards_rad = upwind_rad
        if before is not None:
            onwards_rad = math.atan2(here.y_m - before.y_m, here.x_m - before.x_m)
        for away_m in OUT_M:
            for angle_rad in (onwards_rad, upwind_rad)[: 1 if away_m == 0.0 else 2]:
                x = here.x_m + away_m * math.cos(angle_rad)
                y = here.y_m + away_m * math.sin(angle_rad)
                if away_m and not self.air.low.is_straight_clear((here.x_m, here.y_m), (x, y)):
                    continue
                there = self.air.along([here], [(here.x_m, here.y_m), (x, y)][: 2 if away_m else 1])
                route = [*there, *self.air.straight_up(there[-1])[1:]]
                margin_s = self.checked(route, own)
                if margin_s is not None:
                    return route, margin_s
        return None

    def _level(self, here: FlightPoint) -> Route | None:
        """The route to the drop height; None from the safe height, which is left only once."""
        if here.height_m >= self.settings.safe_height_m - HIGH_M:
            return None
        if here.height_m == self.settings.drop_height_m:
            return [here]
        return [here, self.air.fly_to(here, here.x_m, here.y_m, self.settings.drop_height_m)]

    def _low(self, here: FlightPoint, x_m: float, y_m: float) -> Route | None:
        level = self._level(here)
        way = self.air.low.shortest_path((here.x_m, here.y_m), (x_m, y_m)) if level else None
        return None if way is None or level is None else self.air.along(level, way)

    def _over(self, up: Route, x_m: float, y_m: float) -> Route | None:
        """A route to the safe height continued over a place and down to the drop height."""
        way = self.air.high_path(up[-1], x_m, y_m)
        if way is None:
            return None
        route = self.air.along(up, way)
        if route[-1].height_m > self.settings.safe_height_m:
            route = [*route, self.air.fly_to(route[-1], x_m, y_m, self.settings.safe_height_m)]
        return [*route, self.air.fly_to(route[-1], x_m, y_m, self.settings.drop_height_m)]
