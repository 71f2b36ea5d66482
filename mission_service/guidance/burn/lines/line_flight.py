"""Plans a flight along an ignition line, and checks the safety of all legs and drops."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.burn.lines.flight_constraints import (
    HIGH_M,
    FlightConstraints,
    FlightPoint,
    Route,
)
from mission_service.guidance.burn.lines.sphere_fires import SphereFires

Floats = NDArray[np.float64]

CLIMB_EVERY_M, CLIMBS = 5.0, 12  # minimum spacing and maximum number of climbs tried on a leg
OUT_M = (0.0, 15.0, 30.0, 45.0)  # distances from a drop at which a climb is tried
ROUNDED_S = 1e-6


@dataclass(frozen=True, eq=False)
class LineFlight:
    """A checked flight; ``why_ended`` is the reason for an early end ("" if there is none)."""

    route: tuple[FlightPoint, ...]
    drops: Floats  # (m, 3) x, y, at_s
    skipped: Floats  # (k, 2) positions without a drop
    min_margin_s: float
    climbs_first: bool
    home_s: float  # duration of the return home from the flight's end, including landing
    why_ended: Literal["", "spheres", "battery"]

    @property
    def duration_s(self) -> float:
        """Return the duration from the flight's start to its end."""
        return self.route[-1].at_s - self.route[0].at_s


def fly_line(
    air: FlightConstraints, start: FlightPoint, places_m: Floats, spheres: int, battery_s: float
) -> LineFlight:
    """Plan a flight with drops at as many of the positions (n, 2) as possible, in the given order.

    The flight ends with a climb to the safe height. A position is skipped if it cannot be reached
    safely, if a drop is not safe at the time of arrival, or if no climb from the position is safe.
    The flight ends early if the spheres or the battery do not suffice for another drop.
    ``battery_s`` is the maximum flight time, including the return.
    """
    trip = _flight(air, start, places_m, spheres, battery_s, careful=False)
    # Check for all drops at once whether fire from one sphere reaches another sphere before
    # that sphere ignites.
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
    """A builder of flights, which appends routes and finds safe routes from the flight's end."""

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
        """Append a route that begins at the flight's end, and has the time margin ``margin_s``."""
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
        """Return the fastest safe route to the drop height at a position, with its margin, or None.

        The route is either low (straight, or around areas closed to low flight) or at the safe
        height. If a climb is not safe at the current position, the route stays low until a climb is
        safe.
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

        The route is also safe from the fire that the dropped sphere lights. The route is vertical,
        or first goes a short distance ahead or upwind.
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
        """Return the route to a position at the drop height, or None if there is no low path."""
        level = self._level(start)
        path = self.air.low.shortest_path((start.x_m, start.y_m), (x_m, y_m)) if level else None
        return None if path is None or level is None else self.air.along(level, path)

    def _over(self, up: Route, x_m: float, y_m: float) -> Route | None:
        """Return ``up``, continued to above a position and down to the drop height, or None."""
        path = self.air.high_path(up[-1], x_m, y_m)
        if path is None:
            return None
        route = self.air.along(up, path)
        if route[-1].height_m > self.settings.safe_height_m:
            route = [*route, self.air.fly_to(route[-1], x_m, y_m, self.settings.safe_height_m)]
        return [*route, self.air.fly_to(route[-1], x_m, y_m, self.settings.drop_height_m)]
