"""Checks the flights in a world from the lines of a journal, by code that the service does not use.

A violation is

- a commanded position, leg or loiter nearer to a closed volume than the margin: missions, starts,
  orbits, holds at a place, go-arounds and returns, with the leg from the vehicle's position,
- a position or a leg above the altitude limit,
- a commanded height above the ground below that of the scenario, except in takeoff and landing,
- a commanded return less than 10 m above the ground on the straight way home,
- a vehicle that enters a closed volume, if it was far away when the volume closed, and no operator
  has ordered a hold or an abort beside the volume,
- a vehicle in a closed volume that gets no command for ``REACTS_S``,
- a vehicle that stays in a closed volume longer than the flight to a free place outside takes,
- a vehicle that comes lower than ``MIN_HEIGHT_M`` above the ground in its mission or in a hold,
  later than ``REACTS_S`` after the service got control of it or a return ended.

The last four concern only vehicles that the service can lead (lines ``Led`` of light worlds).
"""

import itertools
import math
from collections.abc import Iterator

from benchmarks.worlds.command_checks import CommandChecks
from benchmarks.worlds.ground import Place, plane_m
from benchmarks.worlds.outlines import Closed
from benchmarks.worlds.rules import (
    ROUNDING_M,
    Flown,
    Kind,
    Line,
    Position,
    Rules,
    Visit,
    corners_of,
    limited,
)

LOW_M = 15.0  # below this height above home and ground a vehicle takes off or lands
STANDS_M = 1.0  # below this height above home or ground a vehicle may stand there
MIN_HEIGHT_M = 15.0
FREE_M = 350.0  # a vehicle farther from a volume that closes has the time to turn away
REACTS_S = 20.0  # report, upload (up to 3 s), start, and the way ahead meanwhile
WIDER_TURN = 1.5  # the flown turn compared with the turn radius
EITHER_SIDE = math.radians(100.0)
TURN_STEPS, UPLOAD_S = 24, 3.0
SLOWER = 1.3  # the flown way out compared with the straight one
BEARINGS = 24
HOLD_RADII = 2.6  # a hold reaches this multiple of the loiter's radius


class Checker:
    """Reads the lines of a journal one by one, and returns the violations in words."""

    def __init__(self, rules: Rules) -> None:
        self.rules = rules
        self.flown = {name: Flown() for name in rules.kinds}
        self._commands = CommandChecks(rules, self.flown)

    def receive(self, line: Line) -> Iterator[str]:
        """Read a line and yield the violations that it contains, in words."""
        if "command" in line:
            found = self._commands.check(line["command"], self._at_s)
        else:
            found = self._event(line.get("event") or line["truth"])
        for words in found:
            yield f"{self._at_s:.0f} s: {words}"

    _at_s = 0.0

    def _event(self, event: Line) -> Iterator[str]:
        self._at_s = event["at_us"] / 1e6
        self._airspace_changed(event)
        if event["type"] == "Aborted" or event.get("order") == "hold":
            self._held(event.get("vehicle", ""))
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
                elif flown.low_until_s < self._at_s:  # it may have been led low by others
                    flown.low_until_s = self._at_s + REACTS_S
            case "ModeChanged":
                returned = flown.mode == "return" != event["mode"]  # at the autopilot's altitude
                if returned and flown.low_until_s < self._at_s:
                    flown.low_until_s = self._at_s + REACTS_S
                flown.mode = event["mode"]
                if not event["armed"]:
                    flown.airborne, flown.in_air, flown.low_until_s = False, False, math.inf
            case "UploadFinished":
                sent = flown.sent.pop(event["mission_id"], None)
                if event["outcome"] == "accepted" and sent is not None:
                    flown.on_board = sent
            case _:
                pass

    def _held(self, name: str) -> None:
        """An operator holds one vehicle or all: a plane circles where it is, on either side."""
        for each, flown in self.flown.items():
            if name not in ("", each) or flown.position is None:
                continue
            reach_m = HOLD_RADII * self.rules.kinds[each].loiter_radius_m
            for volume in self.rules.closed:
                visit = flown.visits.get(volume.name)
                if visit is not None and volume.off_m(flown.position[:2]) < reach_m:
                    visit.free = False

    def _airspace_changed(self, event: Line) -> None:
        """Apply a request that closes or opens a volume."""
        if event["type"] == "AirspaceClosed":
            volume = limited(Closed(event["name"], corners_of(event)), event)
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
        over_ground_m = event["altitude_amsl_m"] - float(self.rules.terrain.ground_m(*place))
        heights_m = (event["altitude_relative_m"], over_ground_m)
        flown.airborne = max(heights_m) > LOW_M
        flown.in_air = flown.airborne or (flown.in_air and min(heights_m) > STANDS_M)
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
        if height_m < MIN_HEIGHT_M and not flown.comes_down and flown.low_until_s < self._at_s:
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
            visit.answered = math.isinf(visit.may_stay_s)
        visit.answered |= flown.commanded_s >= visit.since_s or flown.leaves
        if not visit.answered and at_s - visit.since_s > REACTS_S:
            visit.answered = True
            return f"gets no command in {volume.name} for {REACTS_S:.0f} s"
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
        best_s = straight_s = math.inf
        for number in range(BEARINGS):
            bearing = math.tau * number / BEARINGS
            ahead = (math.sin(bearing), math.cos(bearing))
            away_m = self._free_after_m(here, ahead, beyond_m)
            if away_m is None:
                continue
            end = (here[0] + away_m * ahead[0], here[1] + away_m * ahead[1])
            if any(each.leg_off_m(here, end) < self.rules.margin_m + ROUNDING_M for each in others):
                continue
            speed_m_s = self._ground_speed_m_s(kind, ahead)
            if speed_m_s <= 1.0:
                continue
            straight_s = min(straight_s, away_m / speed_m_s)
            if not (kind.plane and self._turns_into(flown, kind, bearing, others)):
                best_s = min(best_s, away_m / speed_m_s)
        if math.isinf(best_s):  # each turn may lead through another volume
            best_s = 2.0 * straight_s
        turn_s = (
            math.pi * WIDER_TURN * kind.turn_radius_m / kind.airspeed_m_s if kind.plane else 3.0
        )
        return REACTS_S + turn_s + SLOWER * best_s

    def _turns_into(self, flown: Flown, kind: Kind, bearing: float, others: list[Closed]) -> bool:
        """Return whether a plane's turn to a course may lead through another volume.

        The turn begins at once or after an upload. The autopilot may turn to either side towards a
        course that is nearly behind the plane.
        """
        assert flown.position is not None
        course, radius_m = math.atan2(*flown.velocity_m_s), WIDER_TURN * kind.turn_radius_m
        turn = (bearing - course + math.pi) % math.tau - math.pi
        sides = (1.0, -1.0) if abs(turn) > EITHER_SIDE else (math.copysign(1.0, turn),)
        for side, after_s in itertools.product(sides, (0.0, UPLOAD_S)):
            east_m = flown.position[0] + after_s * flown.velocity_m_s[0]
            north_m = flown.position[1] + after_s * flown.velocity_m_s[1]
            east_m += side * radius_m * math.cos(course)
            north_m -= side * radius_m * math.sin(course)
            angle = side * turn % math.tau
            for step in range(TURN_STEPS + 1):
                heading = course + side * angle * step / TURN_STEPS
                place = (
                    east_m - side * radius_m * math.cos(heading),
                    north_m + side * radius_m * math.sin(heading),
                )
                if any(self._is_in(each, (*place, flown.position[2])) for each in others):
                    return True
        return False

    def _is_in(self, volume: Closed, position: Position) -> bool:
        """Return whether a position is in a volume, with the vertical margin."""
        floor_m, ceiling_m = volume.limits_m(self.rules.terrain, position[:2])
        margin_m = self.rules.vertical_margin_m
        level = floor_m - margin_m < position[2] < ceiling_m + margin_m
        return level and volume.covers(position[:2])

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
