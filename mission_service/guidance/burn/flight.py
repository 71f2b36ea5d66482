"""One flight along an ignition line: each leg where it is safe, each drop where it is."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.ellipses.observations import Simulation
from mission_service.config.sections import BurnSection
from mission_service.guidance.burn.hazard import Box, Hazard, hazard_of
from mission_service.guidance.burn.unit import Unit
from mission_service.guidance.burn.visibility_graph import VisibilityGraph

Floats = NDArray[np.float64]
Lights = Callable[[Floats], Simulation]  # sources (n, 3) x, y, at_s: the fire of them alone

HIGH_M = 1e-6  # a height so little below the safe one is safe
TOWARDS_M2 = 1e-3  # a leg that nears a drop by less (times its length) goes away from it
CLIMB_EVERY_M, CLIMBS = 5.0, 12  # places along a leg tried for a climb: how far apart, how many
OUT_M = (0.0, 15.0, 30.0, 45.0)  # from a drop, where it is tried to climb
DOWN_SPARE_M = 1.0  # more than rasters are in doubt by
ROUNDED_S = 1e-6


class Place(NamedTuple):
    """Of a flight: metres, above the ground, seconds of mission time."""

    x_m: float
    y_m: float
    height_m: float
    at_s: float


Route = list[Place]  # from where the vehicle is; flown straight


def part_of(leg: tuple[Place, Place], part: float) -> Place:
    """Where on a leg the vehicle is after a part (0 to 1) of its time."""
    begin, end = leg
    return Place(*(one + part * (other - one) for one, other in zip(begin, end, strict=True)))


def _box(leg: tuple[Place, Place]) -> Box:
    (x0, y0, *_), (x1, y1, *_) = leg
    return min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)


def _away_m(leg: tuple[Place, Place], places_m: Floats) -> Floats:
    """How far places (n, 2) are from a leg."""
    begin, step = np.array(leg[0][:2]), np.subtract(leg[1][:2], leg[0][:2])
    length2 = max(float(step @ step), 1e-12)
    part = np.clip((places_m - begin) @ step / length2, 0.0, 1.0)
    away: Floats = np.hypot(*(places_m - begin - part[:, None] * step).T)
    return away


def fastest_m_s(fire: Simulation) -> float:
    """No fire spreads faster: by its ``spreads``, as EllipseFire has them; else infinity."""
    spreads = getattr(fire, "spreads", None)
    if not spreads:
        return math.inf
    rates = np.array([(one.head_m_s, one.back_m_s, one.flank_m_s) for one in spreads])
    head, back, flank = rates.T
    return float((np.abs(head - back) / 2.0 + np.maximum((head + back) / 2.0, flank)).max())


@dataclass(frozen=True, eq=False)
class Air:
    """What flights are checked against. ``home_m`` is where the vehicle lands."""

    unit: Unit
    settings: BurnSection
    fire: Simulation
    lights: Lights
    hazard: Hazard
    low: VisibilityGraph
    high: VisibilityGraph | None  # inside the fence
    home_m: tuple[float, float]
    places: dict[tuple[float, float], Hazard] = field(default_factory=dict)

    def moved(self, here: Place, x_m: float, y_m: float, height_m: float) -> Place:
        """There, straight: level at speed, or straight up or down at their rates."""
        up_m = height_m - here.height_m
        rate = self.settings.climb_m_s if up_m > 0.0 else self.settings.sink_m_s
        level_m = math.hypot(x_m - here.x_m, y_m - here.y_m)
        taken_s = level_m / self.settings.speed_m_s + abs(up_m) / rate
        return Place(x_m, y_m, height_m, here.at_s + taken_s)

    def along(self, route: Route, places: list[tuple[float, float]]) -> Route:
        """A route and on at its height through places, the first of which is where it ends."""
        for x_m, y_m in places[1:]:
            route = [*route, self.moved(route[-1], x_m, y_m, route[-1].height_m)]
        return route

    def straight_up(self, here: Place) -> Route:
        """To the safe height where it is."""
        if here.height_m >= self.settings.safe_height_m:
            return [here]
        return [here, self.moved(here, here.x_m, here.y_m, self.settings.safe_height_m)]

    def high_way(self, here: Place, x_m: float, y_m: float) -> list[tuple[float, float]] | None:
        """At the safe height, inside the fence; None if there is none."""
        begin, end = (here.x_m, here.y_m), (x_m, y_m)
        return [begin, end] if self.high is None else self.high.shortest_path(begin, end)

    def home_s(self, here: Place) -> float:
        """Time from the safe height here to the ground at home; infinity if there is no way."""
        way = self.high_way(here, *self.home_m)
        if way is None:
            return math.inf
        above = self.along([here], way)[-1]
        return self.moved(above, *self.home_m, 0.0).at_s - here.at_s

    def margin_s(self, leg: tuple[Place, Place]) -> float:
        """How far ahead of fire.

        Where the raster is in doubt, a finer one is asked. Who comes down keeps a little farther
        away: the next leg must be safe as well.
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

    def _elsewhere(self, here: Place) -> Hazard:
        """Around a place where there is no raster, as the one it starts from may be."""
        key = here[:2]
        if key not in self.places:
            self.places[key] = self.hazard.over((*key, *key), self.hazard.cell_m)
        return self.places[key]

    def is_high(self, leg: tuple[Place, Place]) -> bool:
        """Whether all of a leg is at the safe height or above."""
        return min(leg[0].height_m, leg[1].height_m) >= self.settings.safe_height_m - HIGH_M


class OwnFires:
    """The fires that a flight's own drops will be.

    Where a leg nears any of its drops, or comes down from the safe height, they count like any
    fire, with the margin of time. While it goes away from all of them (as right after a drop, when
    the sphere below ignites within that margin) none may burn within reach.
    """

    def __init__(self, air: Air) -> None:
        self.air = air
        self.sources: Floats = np.empty((0, 3))

    def add(self, x_m: float, y_m: float, dropped_s: float) -> None:
        """Another drop."""
        burns_s = dropped_s + self.air.settings.ignition_delay_s
        self.sources = np.concatenate([self.sources, [[x_m, y_m, burns_s]]])

    def nears(self, leg: tuple[Place, Place]) -> bool:
        """Whether drops count with the margin of time."""
        begin, end = leg
        if begin[:2] == end[:2]:
            return end.height_m < begin.height_m
        step = np.array([end.x_m - begin.x_m, end.y_m - begin.y_m])
        towards = (self.sources[:, :2] - (begin.x_m, begin.y_m)) @ step
        return bool((towards > TOWARDS_M2 * math.hypot(*step)).any())

    def margin_s(self, leg: tuple[Place, Place]) -> float:
        """As of any fire if it nears them; else infinity, or what is less than 0 s."""
        if not len(self.sources) or self.air.is_high(leg):
            return math.inf
        nears = self.nears(leg)
        begin, end = leg
        if nears or begin[:2] == end[:2]:
            parts = 1
        else:  # a sphere that ignites at the end of a long leg is no danger at its begin
            short_s = max(self.air.settings.ignition_delay_s / 4.0, 1.0)
            parts = max(math.ceil((end.at_s - begin.at_s) / short_s), 1)
        ends = [begin, *(part_of(leg, number / parts) for number in range(1, parts)), end]
        least_s = min(self._margin_s(part, nears) for part in pairwise(ends))
        return least_s if nears or least_s < 0.0 else math.inf

    def _margin_s(self, leg: tuple[Place, Place], nears: bool) -> float:
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
        """Whether one of them will have come to a place."""
        if not len(self.sources) or at_s <= self.sources[:, 2].min():
            return False
        fire = self.air.lights(self.sources)
        return float(fire.ignition_time_s(np.array([[x_m, y_m]]))[0]) <= at_s


@dataclass(frozen=True, eq=False)
class Trip:
    """What came of it. ``drops`` (m, 3) x, y, at_s; ``skipped`` (k, 2); ``why_ended`` if early."""

    route: tuple[Place, ...]
    drops: Floats
    skipped: Floats
    least_margin_s: float
    climbs_first: bool
    home_s: float  # from its end to the ground at home
    why_ended: Literal["", "spheres", "battery"]

    @property
    def duration_s(self) -> float:
        """From begin to end."""
        return self.route[-1].at_s - self.route[0].at_s


def fly(air: Air, start: Place, places_m: Floats, spheres: int, battery_s: float) -> Trip:
    """Drop at the places (n, 2) in their order, as many as can be, then climb and hold.

    A place that cannot be reached safely, is not safe to drop at when it is reached, or could not
    be left upwards, is skipped for the next, from where the vehicle is. It ends where spheres or
    the battery (seconds to be in the air at most, way home included) do not suffice for one more.
    """
    trip = _flown(air, start, places_m, spheres, battery_s, careful=False)
    # Whether an earlier drop's fire comes to a later one before it ignites is asked once for all.
    lit = trip.drops + np.array([0.0, 0.0, air.settings.ignition_delay_s])
    if (air.lights(lit).ignition_time_s(lit[:, :2]) < lit[:, 2] - ROUNDED_S).any():
        return _flown(air, start, places_m, spheres, battery_s, careful=True)
    return trip


def _flown(
    air: Air, start: Place, places_m: Floats, spheres: int, battery_s: float, careful: bool
) -> Trip:
    flier = Flier(air, start)
    flier.climb_out_of_danger()
    home_s, out_margin_s = math.inf, math.inf
    burns_s = air.fire.ignition_time_s(places_m)
    drops: list[tuple[float, float, float]] = []
    skipped: list[tuple[float, float]] = []
    why: Literal["", "spheres", "battery"] = ""
    least_gap_s = 60.0 / air.settings.most_drops_per_min - ROUNDED_S
    for (x_m, y_m), base_s in zip(places_m.tolist(), burns_s.tolist(), strict=True):
        if len(drops) >= spheres:
            why = "spheres"
            break
        found = flier.towards(x_m, y_m)
        at_s = math.inf if found is None else found[0][-1].at_s
        lands_s = at_s + air.settings.ignition_delay_s
        good = base_s > lands_s and not (drops and at_s - drops[-1][2] < least_gap_s)
        good = good and not (careful and flier.own.burns_by(x_m, y_m, lands_s))
        way_out = flier.way_out(found[0], at_s) if good and found is not None else None
        if found is None or way_out is None:
            skipped.append((x_m, y_m))
            continue
        then_home_s = air.home_s(way_out[0][-1])
        if way_out[0][-1].at_s - start.at_s + then_home_s > battery_s:
            why = "battery"
            break
        flier.take(*found)
        flier.own.add(x_m, y_m, at_s)
        drops.append((x_m, y_m, at_s))
        (flier.out, out_margin_s), home_s = way_out, then_home_s
    flier.take(flier.out, out_margin_s)
    return Trip(
        tuple(flier.route),
        np.array(drops, np.float64).reshape(-1, 3),
        np.array(skipped, np.float64).reshape(-1, 2),
        flier.least_s,
        flier.climbs_first,
        home_s,
        why,
    )


class Flier:
    """Where a flight has come to, and what is safe from there."""

    def __init__(self, air: Air, start: Place) -> None:
        self.air, self.settings = air, air.settings
        self.own = OwnFires(air)
        self.route: Route = [start]
        self.out: Route = []  # from the last drop to the safe height
        self.least_s = math.inf
        self.climbs_first = False

    def checked(self, route: Route, own: OwnFires | None = None) -> float | None:
        """The least margin of a route; None if it is unsafe."""
        least_s = math.inf
        for leg in pairwise(route):
            margin_s = min(self.air.margin_s(leg), (own or self.own).margin_s(leg))
            if margin_s < self.settings.time_margin_s:
                return None
            least_s = min(least_s, margin_s)
        return least_s

    def take(self, route: Route, margin_s: float) -> None:
        """Fly it."""
        self.route += route[1:]
        self.least_s = min(self.least_s, margin_s)

    def climb_out_of_danger(self) -> None:
        """Where the start is in danger nothing is better than to climb at once."""
        start = self.route[0]
        if self.air.margin_s((start, start)) < self.settings.time_margin_s:
            route = self.air.straight_up(start)
            self.take(route, self.air.margin_s((start, route[-1])))
            self.climbs_first = True

    def towards(self, x_m: float, y_m: float) -> tuple[Route, float] | None:
        """The fastest safe route to the drop height at a place, with its margin; None if none is.

        Low (straight, or around what must not be flown over low) or at the safe height. If a climb
        is not safe where the vehicle is, it flies on low as far as it must, and never into danger.
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
        """Then nothing is faster."""
        return sum(one[:2] != other[:2] for one, other in pairwise(low)) <= 1

    def _up(self, here: Place, x_m: float, y_m: float) -> Route | None:
        """To the safe height: here, by the way out, or as near as is safe on the way to a place."""
        for route in (self.air.straight_up(here), self.out):
            if route and route[0] == here and self.checked(route) is not None:
                return route
        low = self._level(here)
        away_m = math.hypot(x_m - here.x_m, y_m - here.y_m)
        every_m = max(CLIMB_EVERY_M, away_m / CLIMBS)
        for number in range(1, math.ceil(away_m / every_m)):
            part = number * every_m / away_m
            there = (here.x_m + part * (x_m - here.x_m), here.y_m + part * (y_m - here.y_m))
            if not low or not self.air.low.straight((here.x_m, here.y_m), there):
                return None
            flown = self.air.along(low, [(here.x_m, here.y_m), there])
            if self.checked(flown) is None:
                return None
            route = [*flown, *self.air.straight_up(flown[-1])[1:]]
            if self.checked(route) is not None:
                return route
        return None

    def way_out(self, arrives: Route, dropped_s: float) -> tuple[Route, float] | None:
        """From a drop to the safe height, the drop's own fire minded; None if there is none.

        Straight up, or else a little farther on or upwind first.
        """
        here = arrives[-1]
        own = OwnFires(self.air)
        own.sources = self.own.sources
        own.add(here.x_m, here.y_m, dropped_s)
        upwind_rad = self.air.hazard.margins.toward_rad + math.pi
        before = next((place for place in arrives[::-1] if place[:2] != here[:2]), None)
        onwards_rad = upwind_rad
        if before is not None:
            onwards_rad = math.atan2(here.y_m - before.y_m, here.x_m - before.x_m)
        for away_m in OUT_M:
            for angle_rad in (onwards_rad, upwind_rad)[: 1 if away_m == 0.0 else 2]:
                x = here.x_m + away_m * math.cos(angle_rad)
                y = here.y_m + away_m * math.sin(angle_rad)
                if away_m and not self.air.low.straight((here.x_m, here.y_m), (x, y)):
                    continue
                there = self.air.along([here], [(here.x_m, here.y_m), (x, y)][: 2 if away_m else 1])
                route = [*there, *self.air.straight_up(there[-1])[1:]]
                margin_s = self.checked(route, own)
                if margin_s is not None:
                    return route, margin_s
        return None

    def _level(self, here: Place) -> Route | None:
        """At the drop height where it is; None from the safe height, which is not left twice."""
        if here.height_m >= self.settings.safe_height_m - HIGH_M:
            return None
        if here.height_m == self.settings.drop_height_m:
            return [here]
        return [here, self.air.moved(here, here.x_m, here.y_m, self.settings.drop_height_m)]

    def _low(self, here: Place, x_m: float, y_m: float) -> Route | None:
        level = self._level(here)
        way = self.air.low.shortest_path((here.x_m, here.y_m), (x_m, y_m)) if level else None
        return None if way is None or level is None else self.air.along(level, way)

    def _over(self, up: Route, x_m: float, y_m: float) -> Route | None:
        """On from a route to the safe height, over and down to the drop height."""
        way = self.air.high_way(up[-1], x_m, y_m)
        if way is None:
            return None
        route = self.air.along(up, way)
        if route[-1].height_m > self.settings.safe_height_m:
            route = [*route, self.air.moved(route[-1], x_m, y_m, self.settings.safe_height_m)]
        return [*route, self.air.moved(route[-1], x_m, y_m, self.settings.drop_height_m)]
