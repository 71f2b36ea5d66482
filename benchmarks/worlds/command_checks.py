"""Checks the commands in a world: against closed volumes, the altitude limit, and the ground."""

import itertools
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from benchmarks.worlds.ground import plane_m
from benchmarks.worlds.outlines import Closed
from benchmarks.worlds.rules import GOING_HOME, ROUNDING_M, Flown, Line, Position, Rules

TERRAIN_M = 4.0  # the service knows the ground on a grid
RETURN_ABOVE_M = 150.0  # returns may use any altitude up to this height above home
FLOOR_M = 4.0  # a hold is 1 m below a floor, which the service measures on its grid
SAMPLE_M = 25.0
ON_THE_WAY_OUT = ("leave closed airspace", "fly home clear of closed airspace and terrain")
CHANGES_FLIGHT = ("UploadMission", "Hold", "HoldAt", "Return", "GoAround")
WAYPOINT, LOITER, LAND, TAKEOFF, LOITER_TO_ALT = 16, 17, 21, 22, 31
RELATIVE_FRAMES = (3, 6)
LANDING_CLEARANCE_M = 30.0
RETURN_CLEARANCE_M, LANDS_BELOW_M = 10.0, 15.0


class Item(NamedTuple):
    """A position of a mission."""

    command: int
    position: Position
    radius_m: float


class CommandChecks:
    """Finds the violations in commands."""

    def __init__(self, rules: Rules, flown: dict[str, Flown]) -> None:
        self.rules = rules
        self.flown = flown
        self._at_s = 0.0

    def check(self, command: Line, at_s: float) -> Iterator[str]:
        """Yield the violations in a command, in words."""
        self._at_s, name = at_s, command["vehicle"]
        flown = self.flown.get(name)
        if flown is None:
            return
        if command["type"] in CHANGES_FLIGHT:
            flown.commanded_s = at_s
            flown.leaves = command.get("why") in ON_THE_WAY_OUT
        found: list[str] = []
        match command["type"]:
            case "UploadMission":
                flown.sent[command["mission_id"]] = command
                found = [*self._mission(name, flown, command), *self._floor(name, flown, command)]
            case "StartMission" if flown.on_board is not None:
                found = self._mission(name, flown, flown.on_board)
            case "Return":
                found = self._return(name, flown)
            case "Orbit" | "HoldAt" | "GoAround" | "ClimbAndHold":
                found = self._place(name, flown, command)
            case "ShowLanding":
                flown.landing = command["phase"]
            case _:
                pass
        why = command.get("why", "")
        for words in found[:1]:
            yield (
                f"{name} {command['type']} ({why}) {words}"
                if why
                else (f"{name} {command['type']} {words}")
            )

    def _items(self, name: str, command: Line) -> list[Item]:
        """Return the positions that are flown in a mission, up to its unlimited loiter."""
        found = []
        kind = self.rules.kinds[name]
        home = kind.home
        for item in command["items"]:
            number = item["command"]
            if number not in (WAYPOINT, LOITER, LAND, TAKEOFF, LOITER_TO_ALT):
                continue
            place = plane_m(item["x"] / 1e7, item["y"] / 1e7)
            altitude_m = item["z"] + (home[2] if item["frame"] in RELATIVE_FRAMES else 0.0)
            radius_key = {LOITER: "param3", LOITER_TO_ALT: "param2"}.get(number, "")
            # Multirotors of both stacks hover at a loiter.
            radius_m = abs(item.get(radius_key, 0.0)) if kind.plane else 0.0
            found.append(Item(number, (*place, altitude_m), radius_m))
            if number == LOITER:
                break
        return found

    def _mission(self, name: str, flown: Flown, command: Line) -> list[str]:
        """Return the closed volumes that a mission would enter, or come too near to."""
        items = self._items(name, command)
        if not items:
            return []
        start = flown.start
        leaves = command["why"] in ON_THE_WAY_OUT
        positions = [item.position for item in items]
        found = []
        for volume in self.rules.closed:
            if not volume.counts(self._at_s):
                continue
            margin_m = self._margin_m(volume, start)
            if leaves:  # begins where the vehicle was when it was sent
                margin_m = min(margin_m, self._margin_m(volume, positions[0]))
            if start is not None and margin_m <= 0.0:
                found += self._end(volume, items[-1])
                continue
            legs = [*itertools.pairwise(positions)]
            first = positions[0]
            if start is not None and not leaves:
                words = self._first_leg(name, volume, start, first, margin_m)
                found += [words] if words else []
            for one, other in legs:
                if self._is_near(volume, one, other, margin_m):
                    found.append(f"leads into {volume.name}")
            for item in items:
                reach_m = margin_m + item.radius_m
                if self._is_near(volume, item.position, item.position, reach_m):
                    found.append(f"leads to a place in {volume.name}")
        return found + self._above_limit([start, *positions] if start else positions)

    def _end(self, volume: Closed, last: Item) -> list[str]:
        """Return whether a flight out of a volume ends inside it."""
        near = self._is_near(volume, last.position, last.position, last.radius_m)
        return [f"ends in {volume.name}"] if near else []

    def _margin_m(self, volume: Closed, start: Position | None) -> float:
        """Return the margin; of a vehicle that is within the margin, its distance less 1 m."""
        margin_m = self.rules.margin_m - ROUNDING_M
        if start is None or not self._overlaps(volume, start, start):
            return margin_m
        return min(margin_m, max(volume.off_m(start[:2]) - 1.0 - ROUNDING_M, 0.0))

    def _first_leg(
        self, name: str, volume: Closed, start: Position, first: Position, margin_m: float
    ) -> str:
        """Return whether the leg from the vehicle's position is too near; it begins with a turn."""
        kind = self.rules.kinds[name]
        speed_m_s = math.hypot(*self.rules.wind_m_s)
        width_m = 0.0
        if kind.plane:
            width_m = 2.2 * kind.turn_radius_m * (1.0 + speed_m_s / kind.airspeed_m_s) ** 2
            width_m += 2.0 * (kind.airspeed_m_s + speed_m_s)
        length_m = math.dist(start[:2], first[:2])
        if length_m < 1.0:
            return ""
        begin = 0.0
        while begin < 1.0:
            end = min(begin + max(SAMPLE_M / length_m, 0.02), 1.0)
            left_m = margin_m - width_m * (1.0 - begin)
            if left_m > 0.0:
                one, other = _along(start, first, begin), _along(start, first, end)
                low_m, high_m = sorted((start[2], first[2]))
                if self._is_near(volume, (*one[:2], low_m), (*other[:2], high_m), left_m):
                    return f"leads into {volume.name} on the way to its first position"
            begin = end
        return ""

    def _overlaps(self, volume: Closed, one: Position, other: Position) -> bool:
        """Return whether the altitudes between two positions are too near to those of a volume."""
        low_m, high_m = sorted((one[2], other[2]))
        up_m = self.rules.vertical_margin_m - ROUNDING_M
        floor_m, ceiling_m = volume.limits_m(self.rules.terrain, one[:2])
        if volume.floor_agl or volume.ceiling_agl:  # the limits follow the ground
            up_m = 0.0
        return low_m < ceiling_m + up_m and high_m > floor_m - up_m

    def _is_near(self, volume: Closed, one: Position, other: Position, margin_m: float) -> bool:
        """Return whether a leg is nearer to a volume than the margin.

        A leg has all altitudes between its ends. In volumes whose limits follow the ground only
        positions inside count.
        """
        if not (volume.floor_agl or volume.ceiling_agl):
            if not self._overlaps(volume, one, other):
                return False
            return volume.leg_off_m(one[:2], other[:2]) < margin_m
        if volume.leg_off_m(one[:2], other[:2]) > 0.0:
            return False
        count = max(1, math.ceil(math.dist(one[:2], other[:2]) / SAMPLE_M))
        low_m, high_m = sorted((one[2], other[2]))
        for number in range(count + 1):
            place = _along(one, other, number / count)[:2]
            if volume.covers(place) and volume.edge_m(place) > ROUNDING_M:
                floor_m, ceiling_m = volume.limits_m(self.rules.terrain, place)
                if low_m < ceiling_m - ROUNDING_M and high_m > floor_m + ROUNDING_M:
                    return True
        return False

    def _above_limit(self, positions: list[Position]) -> list[str]:
        limit_m = self.rules.max_height_m
        if limit_m is None:
            return []
        for one, other in itertools.pairwise(positions):
            high_m = max(one[2], other[2]) - float(np.min(self._grounds_m(one, other)))
            if high_m > limit_m + TERRAIN_M and other is not positions[1]:
                return [f"is {high_m:.0f} m above the ground; the limit is {limit_m:.0f} m"]
        return []

    def _grounds_m(self, one: Position, other: Position) -> Any:
        """Return the altitudes of the ground along a leg."""
        count = max(2, math.ceil(math.dist(one[:2], other[:2]) / SAMPLE_M) + 1)
        share = np.linspace(0.0, 1.0, count)
        return self.rules.terrain.ground_m(
            one[0] + share * (other[0] - one[0]), one[1] + share * (other[1] - one[1])
        )

    def _floor(self, name: str, flown: Flown, command: Line) -> list[str]:
        """Return where the height of a mission above the ground is below that of the scenario.

        A vehicle may leave a volume without a climb, at 30 m or more above the ground.
        """
        kind = self.rules.kinds[name]
        if command["why"] in ON_THE_WAY_OUT:
            kind = kind._replace(height_m=min(kind.height_m, LANDING_CLEARANCE_M))
        items = self._items(name, command)
        found = []
        for one, other in itertools.pairwise(items):
            if one.command == TAKEOFF or other.command in (LAND, LOITER_TO_ALT):
                continue
            if command["lands"] and one.command in (LAND, LOITER_TO_ALT):
                break  # a go-around climbs ahead
            ground_m = self._grounds_m(one.position, other.position)
            share = np.linspace(0.0, 1.0, len(ground_m))
            planned_m = one.position[2] + share * (other.position[2] - one.position[2])
            found += _lower(float(np.min(planned_m - ground_m)), kind.height_m, "a leg")
        first = items[0] if items else None
        start = flown.start
        if first is not None and start is not None and first.command != TAKEOFF:
            height_m = first.position[2] - float(np.max(self._grounds_m(start, first.position)))
            found += _lower(height_m, kind.height_m, "the way to its first position")
        for item in items:
            if item.radius_m > 0.0:
                needed_m = kind.height_m if item.command == LOITER else LANDING_CLEARANCE_M
                if item.command == LOITER and command["lands"]:
                    needed_m = LANDING_CLEARANCE_M  # after a go-around
                found += _lower(self._circle_m(item.position, item.radius_m), needed_m, "a loiter")
        return found

    def _circle_m(self, position: Position, radius_m: float) -> float:
        """Return the lowest height above the ground on a circle and at its centre."""
        turns = np.linspace(0.0, math.tau, 36)
        east_m = np.append(position[0] + radius_m * np.sin(turns), position[0])
        north_m = np.append(position[1] + radius_m * np.cos(turns), position[1])
        return position[2] - float(np.max(self.rules.terrain.ground_m(east_m, north_m)))

    def _return(self, name: str, flown: Flown) -> list[str]:
        """Return the closed volumes on the straight way home, and whether the ground is near.

        The autopilots of light worlds return at the altitude of the vehicle.
        """
        start = flown.position
        if start is None or not flown.airborne or not flown.led:
            return []
        home = self.rules.kinds[name].home
        high_m = max(start[2], home[2] + RETURN_ABOVE_M)
        found = []
        for volume in self.rules.closed:
            margin_m = self._margin_m(volume, start)
            if volume.counts(self._at_s) and margin_m > 0.0:
                words = self._first_leg(name, volume, (*start[:2], high_m), home, margin_m)
                found += [words] if words else []
        height_m = start[2] - home[2]
        if flown.mode in GOING_HOME and height_m <= LANDS_BELOW_M:
            return found
        over_ground_m = start[2] - float(np.max(self._grounds_m(start, home)))
        return found + _lower(over_ground_m, RETURN_CLEARANCE_M, "the straight way home")

    def _place(self, name: str, flown: Flown, command: Line) -> list[str]:
        """Return what is wrong with a hold, an orbit or a go-around at a place."""
        kind, start = self.rules.kinds[name], flown.position
        place = plane_m(command["lat_deg"], command["lon_deg"])
        position = (*place, command["altitude_amsl_m"])
        radius_m = abs(command.get("radius_m", kind.loiter_radius_m)) if kind.plane else 0.0
        found = []
        if command["type"] == "HoldAt":
            height_m, needed_m = self._circle_m(position, radius_m), self.rules.descends_to_m
            if start is not None and self._is_just_below_a_volume(start, position):
                now_m = self._circle_m((*place, start[2]), radius_m)
                needed_m = min(needed_m, now_m + 1.0)  # at least higher than now
            found += _lower(height_m, needed_m, "a hold")
        for volume in self.rules.closed:
            if not volume.counts(self._at_s) or command["type"] == "GoAround":
                continue
            if command["type"] == "HoldAt" and self._is_below(volume, start, position):
                continue
            margin_m = self._margin_m(volume, start)
            if margin_m > 0.0 and self._is_near(volume, position, position, margin_m + radius_m):
                found.append(f"leads to a place in {volume.name}")
        return found

    def _is_just_below_a_volume(self, start: Position, place: Position) -> bool:
        """Return whether a closed volume prevents a hold from being raised further."""
        return any(
            volume.counts(self._at_s)
            and self._is_below(volume, start, place)
            and abs(volume.least_floor_m(self.rules.terrain) - place[2]) < FLOOR_M
            for volume in self.rules.closed
        )

    def _is_below(self, volume: Closed, start: Position | None, place: Position) -> bool:
        """Return whether a hold is raised above rising ground, and stays below a volume.

        The ground has precedence over the vertical margin.
        """
        if start is None or math.dist(start[:2], place[:2]) > ROUNDING_M or place[2] < start[2]:
            return False
        floor_m, _ = volume.limits_m(self.rules.terrain, place[:2])
        return place[2] < floor_m


def _along(one: Position, other: Position, share: float) -> Position:
    return (
        one[0] + share * (other[0] - one[0]),
        one[1] + share * (other[1] - one[1]),
        one[2] + share * (other[2] - one[2]),
    )


def _lower(height_m: float, needed_m: float, what: str) -> list[str]:
    if height_m >= needed_m - TERRAIN_M:
        return []
    return [f"{what} is {height_m:.0f} m above the ground, less than {needed_m:.0f} m"]
