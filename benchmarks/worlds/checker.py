"""Checks the flights in a world from the lines of a journal, by code that the service does not use.

A violation is

- a commanded position, leg or loiter nearer to a closed volume than the margin: missions, starts,
  orbits, holds at a place, go-arounds and returns, with the leg from the vehicle's position,
- a position or a leg above the altitude limit,
- a commanded altitude lower above the ground than ordered by the scenario, except takeoff and
  landing,
- a vehicle that enters a closed volume, if it was far away when the volume closed,
- a vehicle that stays in a closed volume longer than the flight to a free place outside takes,
- a vehicle that comes lower than ``MIN_HEIGHT_M`` above the ground in its mission or in a hold.

The last three concern only vehicles that the service can lead (lines ``Led`` of light worlds).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from benchmarks.worlds.ground import Place, Terrain, plane_m
from benchmarks.worlds.outlines import Closed

Line = dict[str, Any]

ROUNDING_M = 2.0  # of positions, and of the service's projection
TERRAIN_M = 4.0  # the service knows the ground on a grid
LOW_M = 15.0  # below this height above home a vehicle takes off or lands
MIN_HEIGHT_M = 15.0
FREE_M = 350.0  # a vehicle farther from a volume that closes has the time to turn away
REACTS_S = 20.0  # report, upload (up to 3 s), start, and the way ahead meanwhile
SLOWER = 1.3  # the flown way out compared with the straight one
RETURN_ABOVE_M = 150.0
SAMPLE_M = 25.0
BEARINGS = 24
ON_THE_WAY_OUT = ("leave closed airspace", "fly home around closed airspace")
WAYPOINT, LOITER, LAND, TAKEOFF, LOITER_TO_ALT = 16, 17, 21, 22, 31
RELATIVE_FRAMES = (3, 6)
LANDING_CLEARANCE_M = 30.0

Position = tuple[float, float, float]  # east, north, altitude above mean sea level, in metres


class Kind(NamedTuple):
    """What the checker uses of a vehicle of the scenario."""

    plane: bool
    airspeed_m_s: float
    turn_radius_m: float
    loiter_radius_m: float
    height_m: float  # planned height above the ground
    home: Position


@dataclass
class Rules:
    """What the flights of a world must comply with."""

    closed: list[Closed]
    margin_m: float
    vertical_margin_m: float
    max_height_m: float | None
    descends_to_m: float
    kinds: dict[str, Kind]
    wind_m_s: Place  # velocity of the air, east and north
    terrain: Terrain


class Item(NamedTuple):
    """A position of a mission."""

    command: int
    position: Position
    radius_m: float


@dataclass
class Visit:
    """What the checker keeps of one vehicle and one volume."""

    free: bool = False  # whether the vehicle has had the time to stay outside
    since_s: float = -math.inf  # time at which the vehicle was first inside, or led again
    may_stay_s: float = math.inf
    inside: bool = False


@dataclass
class Flown:
    """What the checker keeps of one vehicle."""

    position: Position | None = None
    velocity_m_s: Place = (0.0, 0.0)
    airborne: bool = False
    led: bool = True
    mode: str = ""
    lands: bool = False  # whether the mission on board only lands
    landing: str = "none"
    sent: dict[int, Line] = field(default_factory=dict)
    on_board: Line | None = None
    low_until_s: float = math.inf  # a start from the ground or a low hold ends
    visits: dict[str, Visit] = field(default_factory=dict)


# The rules of a scenario ---------------------------------------------------------------------------


def rules_of(scenario: Line, terrain: Terrain) -> Rules:
    """Return the rules for a scenario, as a dictionary, on a terrain."""
    airspace = scenario["airspace"]
    weather = scenario["weather"][0]
    towards = math.radians(weather["wind_from_deg"] + 180.0)
    wind_m_s = weather["wind_speed_m_s"]
    surveillance = scenario.get("surveillance") or {}
    return Rules(
        _volumes(airspace),
        airspace["margin_m"],
        airspace["vertical_margin_m"],
        airspace["max_altitude_agl_m"],
        surveillance.get("descend_to_agl_m", 0.0),
        {vehicle["name"]: _kind(vehicle, terrain) for vehicle in scenario["vehicles"]},
        (wind_m_s * math.sin(towards), wind_m_s * math.cos(towards)),
        terrain,
    )


def _kind(vehicle: Line, terrain: Terrain) -> Kind:
    east_m, north_m = plane_m(vehicle["home_lat_deg"], vehicle["home_lon_deg"])
    return Kind(
        vehicle["kind"] == "plane",
        vehicle["airspeed_m_s"],
        vehicle["turn_radius_m"],
        vehicle["loiter_radius_m"],
        vehicle["altitude_agl_m"],
        (east_m, north_m, float(terrain.ground_m(east_m, north_m))),
    )


def _volumes(airspace: Line) -> list[Closed]:
    found = []
    for entry in airspace["closed"]:
        volume = _limited(Closed(entry["name"], _corners(entry)), entry)
        volume.from_s = entry["from_s"]
        volume.known_s = entry["from_s"] - airspace["lead_s"]
        volume.until_s = math.inf if entry["until_s"] is None else entry["until_s"]
        found.append(volume)
    for entry in airspace["allowed"]:
        found.append(Closed("outside " + entry["name"], _corners(entry), inverted=True))
    return found


def _corners(entry: Line) -> list[Place]:
    return [plane_m(*corner) for corner in entry["corners"]]


def _limited(volume: Closed, entry: Line) -> Closed:
    for reference in ("amsl", "agl"):
        floor_m, ceiling_m = entry.get(f"floor_{reference}_m"), entry.get(f"ceiling_{reference}_m")
        if floor_m is not None:
            volume.floor_m, volume.floor_agl = floor_m, reference == "agl"
        if ceiling_m is not None:
            volume.ceiling_m, volume.ceiling_agl = ceiling_m, reference == "agl"
    return volume


# The checker --------------------------------------------------------------------------------------


class Checker:
    """Reads the lines of a journal one by one, and returns the violations in words."""

    def __init__(self, rules: Rules) -> None:
        self.rules = rules
        self.flown = {name: Flown() for name in rules.kinds}

    def receive(self, line: Line) -> Iterator[str]:
        """Read a line and yield the violations that it contains, in words."""
        for part in ("truth", "event", "command"):
            if part in line:
                found = self._event(line[part]) if part != "command" else self._command(line[part])
                for words in found:
                    yield f"{self._at_s:.0f} s: {words}"

    _at_s = 0.0

    def _event(self, event: Line) -> Iterator[str]:
        self._at_s = event["at_us"] / 1e6
        self._airspace_changed(event)
        flown = self.flown.get(event.get("vehicle", ""))
        if flown is None:
            return
        match event["type"]:
            case "Telemetry" | "Position":
                yield from self._moved(event["vehicle"], flown, event)
            case "Led":
                flown.led = event["led"]
                if not flown.led:
                    flown.visits.clear()
            case "ModeChanged":
                flown.mode = event["mode"]
                if not event["armed"]:
                    flown.airborne, flown.low_until_s = False, math.inf
            case "UploadFinished":
                sent = flown.sent.pop(event["mission_id"], None)
                if event["outcome"] == "accepted" and sent is not None:
                    flown.on_board = sent
            case _:
                pass

    def _airspace_changed(self, event: Line) -> None:
        """Apply a request that closes or opens a volume."""
        if event["type"] == "AirspaceClosed":
            volume = _limited(Closed(event["name"], _corners(event)), event)
            volume.from_s = volume.known_s = self._at_s
            if event["for_s"] is not None:
                volume.until_s = self._at_s + event["for_s"]
            self.rules.closed.append(volume)
        elif event["type"] == "AirspaceOpened":
            for volume in self.rules.closed:
                if volume.name == event["name"]:
                    volume.until_s = min(volume.until_s, self._at_s)

    # Positions ------------------------------------------------------------------------------------

    def _moved(self, name: str, flown: Flown, event: Line) -> Iterator[str]:
        place = plane_m(event["lat_deg"], event["lon_deg"])
        flown.position = (*place, event["altitude_amsl_m"])
        flown.velocity_m_s = (event["velocity_east_m_s"], event["velocity_north_m_s"])
        was = flown.airborne
        flown.airborne = event["altitude_relative_m"] > LOW_M
        if flown.airborne and not was:
            flown.low_until_s = math.inf
        if not (flown.airborne and flown.led):
            return
        if event["at_us"] % 1_000_000 == 0:
            for volume in self.rules.closed:
                words = self._in_volume(name, flown, volume)
                if words:
                    yield f"{name} {words}"
            yield from self._too_low(name, flown)

    def _too_low(self, name: str, flown: Flown) -> Iterator[str]:
        """Yield a vehicle that is near the ground, but does not take off or land."""
        assert flown.position is not None
        east_m, north_m, altitude_m = flown.position
        height_m = altitude_m - float(self.rules.terrain.ground_m(east_m, north_m))
        kind = self.rules.kinds[name]
        if height_m >= min(40.0, kind.height_m - 20.0):
            flown.low_until_s = -math.inf  # it has taken off
        lands = flown.landing != "none" or flown.mode in ("return", "land")
        if height_m < MIN_HEIGHT_M and not lands and flown.low_until_s < self._at_s:
            flown.low_until_s = math.inf  # one violation
            yield f"{name} is {height_m:.0f} m above the ground in mode {flown.mode}"

    def _in_volume(self, name: str, flown: Flown, volume: Closed) -> str:
        """Update the visit from a position; return a violation in words, or ""."""
        at_s = self._at_s
        visit = flown.visits.get(volume.name)
        if not volume.counts(at_s):
            flown.visits.pop(volume.name, None)
            return ""
        assert flown.position is not None
        east_m, north_m, altitude_m = flown.position
        place = (east_m, north_m)
        floor_m, ceiling_m = volume.limits_m(self.rules.terrain, place)
        covers = volume.covers(place)
        inside = covers and volume.edge_m(place) > ROUNDING_M
        inside &= floor_m + ROUNDING_M < altitude_m < ceiling_m - ROUNDING_M
        far = not covers and volume.edge_m(place) > FREE_M
        if visit is None:
            visit = flown.visits[volume.name] = Visit(free=far)
        visit.free |= far
        lands = flown.landing != "none"
        if lands:  # the service does not divert a vehicle that lands
            visit.free = visit.inside = False
        if not inside or lands:
            visit.inside = False
            return ""
        if visit.free:
            visit.free, visit.inside, visit.since_s = False, True, at_s
            visit.may_stay_s = math.inf
            return f"enters {volume.name}" if volume.is_closed(at_s) else ""
        if not visit.inside:
            visit.inside, visit.since_s = True, at_s
            visit.may_stay_s = self._way_out_s(name, flown, volume)
        if at_s - visit.since_s > visit.may_stay_s and volume.is_closed(at_s):
            stayed_s, visit.may_stay_s = at_s - visit.since_s, math.inf
            return f"stays in {volume.name} for more than {stayed_s:.0f} s"
        return ""

    def _way_out_s(self, name: str, flown: Flown, volume: Closed) -> float:
        """Return the time of the flight to the nearest free place outside; inf without one."""
        kind = self.rules.kinds[name]
        assert flown.position is not None
        here = flown.position[:2]
        others = [
            each
            for each in self.rules.closed
            if each is not volume and each.counts(self._at_s) and not each.covers(here)
        ]
        beyond_m = self.rules.margin_m + 1.3 * kind.loiter_radius_m + 30.0
        best_s = math.inf
        for number in range(BEARINGS):
            bearing = math.tau * number / BEARINGS
            ahead = (math.sin(bearing), math.cos(bearing))
            away_m = self._free_after_m(here, ahead, beyond_m)
            if away_m is None:
                continue
            end = (here[0] + away_m * ahead[0], here[1] + away_m * ahead[1])
            if any(
                each.leg_off_m(here, end) < self.rules.margin_m + ROUNDING_M for each in others
            ):
                continue
            speed_m_s = self._ground_speed_m_s(kind, ahead)
            if speed_m_s > 1.0:
                best_s = min(best_s, away_m / speed_m_s)
        turn_s = math.pi * 1.5 * kind.turn_radius_m / kind.airspeed_m_s if kind.plane else 3.0
        return REACTS_S + turn_s + SLOWER * best_s

    def _free_after_m(self, here: Place, ahead: Place, beyond_m: float) -> float | None:
        """Return how far ahead a place is ``beyond_m`` from all volumes; None within 3 km."""
        for step in range(1, 121):
            away_m = 25.0 * step
            place = (here[0] + away_m * ahead[0], here[1] + away_m * ahead[1])
            if all(
                each.off_m(place) > beyond_m
                for each in self.rules.closed
                if each.counts(self._at_s)
            ):
                return away_m
        return None

    def _ground_speed_m_s(self, kind: Kind, ahead: Place) -> float:
        """Return the speed over ground on a course (the wind triangle)."""
        wind = self.rules.wind_m_s
        along = wind[0] * ahead[0] + wind[1] * ahead[1]
        across = wind[0] * ahead[1] - wind[1] * ahead[0]
        if abs(across) >= kind.airspeed_m_s:
            return 0.0
        return along + math.sqrt(kind.airspeed_m_s**2 - across**2)

    # Commands -------------------------------------------------------------------------------------

    def _command(self, command: Line) -> Iterator[str]:
        name = command["vehicle"]
        flown = self.flown.get(name)
        if flown is None:
            return
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
            yield f"{name} {command['type']} ({why}) {words}" if why else (
                f"{name} {command['type']} {words}"
            )

    def _items(self, name: str, command: Line) -> list[Item]:
        """Return the positions that are flown in a mission, up to its unlimited loiter."""
        found = []
        home = self.rules.kinds[name].home
        for item in command["items"]:
            number = item["command"]
            if number not in (WAYPOINT, LOITER, LAND, TAKEOFF, LOITER_TO_ALT):
                continue
            place = plane_m(item["x"] / 1e7, item["y"] / 1e7)
            altitude_m = item["z"] + (home[2] if item["frame"] in RELATIVE_FRAMES else 0.0)
            radius_m = {LOITER: "param3", LOITER_TO_ALT: "param2"}.get(number)
            radius_m = abs(item.get(radius_m, 0.0)) if radius_m else 0.0
            found.append(Item(number, (*place, altitude_m), radius_m))
            if number == LOITER:
                break
        return found

    def _mission(self, name: str, flown: Flown, command: Line) -> list[str]:
        """Return the closed volumes that a mission would enter, or come too near to."""
        items = self._items(name, command)
        if not items:
            return []
        start = flown.position if flown.airborne else None
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
            legs = [*zip(positions, positions[1:], strict=False)]
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

    def _is_near(
        self, volume: Closed, one: Position, other: Position, margin_m: float
    ) -> bool:
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
        for one, other in zip(positions, positions[1:], strict=False):
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
        """Return where a mission is lower above the ground than the scenario orders."""
        kind = self.rules.kinds[name]
        items = self._items(name, command)
        found = []
        for one, other in zip(items, items[1:], strict=False):
            if one.command == TAKEOFF or other.command in (LAND, LOITER_TO_ALT):
                continue
            if one.command in (LAND, LOITER_TO_ALT):
                break  # a go-around climbs ahead
            ground_m = self._grounds_m(one.position, other.position)
            share = np.linspace(0.0, 1.0, len(ground_m))
            planned_m = one.position[2] + share * (other.position[2] - one.position[2])
            found += _lower(float(np.min(planned_m - ground_m)), kind.height_m, "a leg")
        first = items[0] if items else None
        if first is not None and flown.airborne and flown.position is not None:
            if first.command != TAKEOFF:
                ground_m = self._grounds_m(flown.position, first.position)
                height_m = first.position[2] - float(np.max(ground_m))
                found += _lower(height_m, kind.height_m, "the way to its first position")
        for item in items:
            if item.radius_m > 0.0:
                needed_m = kind.height_m if item.command == LOITER else LANDING_CLEARANCE_M
                if item.command == LOITER and command["lands"]:
                    needed_m = LANDING_CLEARANCE_M  # after a go-around
                found += _lower(self._circle_m(item.position, item.radius_m), needed_m, "a loiter")
        return found

    def _circle_m(self, position: Position, radius_m: float) -> float:
        """Return the least height above the ground on a circle and at its centre."""
        turns = np.linspace(0.0, math.tau, 36)
        east_m = np.append(position[0] + radius_m * np.sin(turns), position[0])
        north_m = np.append(position[1] + radius_m * np.cos(turns), position[1])
        return position[2] - float(np.max(self.rules.terrain.ground_m(east_m, north_m)))

    def _return(self, name: str, flown: Flown) -> list[str]:
        """Return the closed volumes on the straight way home."""
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
        return found

    def _place(self, name: str, flown: Flown, command: Line) -> list[str]:
        """Return what is wrong with a hold, an orbit or a go-around at a place."""
        kind, start = self.rules.kinds[name], flown.position
        place = plane_m(command["lat_deg"], command["lon_deg"])
        position = (*place, command["altitude_amsl_m"])
        radius_m = abs(command.get("radius_m", kind.loiter_radius_m)) if kind.plane else 0.0
        found = []
        if command["type"] == "HoldAt":
            height_m = self._circle_m(position, radius_m)
            found += _lower(height_m, self.rules.descends_to_m, "a hold")
        for volume in self.rules.closed:
            if not volume.counts(self._at_s) or command["type"] == "GoAround":
                continue
            margin_m = self._margin_m(volume, start)
            if margin_m > 0.0 and self._is_near(volume, position, position, margin_m + radius_m):
                found.append(f"leads to a place in {volume.name}")
        return found


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
