"""Separates all vehicles in flight according to the rules in ``missions/separation.py``."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.fire.scenario_fire import fire_position
from mission_service.missions.from_path import LeastAltitude
from mission_service.missions.separation import (
    AHEAD_S,
    MARGIN_M,
    SPACING_M,
    Track,
    ahead_on,
    avoidance_position,
    comes_too_low,
    descent_of,
    gives_way,
    has_passed,
    heights_below,
    is_near,
    places_of,
    straight_on,
    track_of,
)
from mission_service.position_fix import PositionFix
from mission_service.vehicles.availability import VehicleAvailability

Floats = NDArray[np.float64]

TAKEOFF_CLEAR_M = 300.0
TAKES_OFF_WITHIN_S = 60.0
LEAVES_M, LEAVES_WITHIN_S = 400.0, 30.0  # distance and time of the flight to a waiting position
WAITS_AT_MOST_S = 120.0
CANNOT_GIVE_WAY_FOR_S = 30.0  # after closed airspace, or failed uploads, prevented giving way
STALE_S = 5.0  # an older position is not used
DESCENDING = ("approach", "final", "going around")  # phases of a landing


@dataclass(slots=True, eq=False)
class Flown:
    """A vehicle's planned track, and the vehicle to which this vehicle gives way."""

    section: VehicleSection
    availability: VehicleAvailability
    home_m: tuple[float, float]
    track: Track | None = None  # of the mission on board
    sent_track: Track | None = None  # of a mission that is being sent
    sent_id: int = 0  # ID of the mission sent last
    descent_m: Floats | None = None  # (n, 2) descent of the landing mission sent last
    sent: int = 0  # number of missions sent
    compared: tuple[int, ...] = ()  # ``sent`` of the vehicles below at the last comparison
    gave_way_to: str | None = None
    cannot_give_way_until_s: float = -math.inf  # until then the vehicle cannot give way
    waits_since_s: float = 0.0
    waits_at: Floats | None = None  # (1, 2) waiting position
    started_at_s: float = -1e9


class TrafficManager:
    """The tracks and positions of all vehicles, and the decisions about which of them gives way."""

    def __init__(
        self, scenario: Scenario, landscape: Landscape, availability: dict[str, VehicleAvailability]
    ) -> None:
        self._landscape = landscape
        self._separation_m = scenario.mission.separation_m
        self._fire_m = fire_position(scenario, landscape)
        self._all = {
            section.name: Flown(
                section,
                availability[section.name],
                landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg),
            )
            for section in scenario.vehicles
        }
        self._below = {name: self._vehicles_below(name) for name in self._all}
        self._earlier = {name: set(list(self._all)[:n]) for n, name in enumerate(self._all)}

    def _vehicles_below(self, name: str) -> list[Flown]:
        top_m = self._all[name].section.altitude_agl_m - self._separation_m
        return [other for other in self._all.values() if other.section.altitude_agl_m <= top_m]

    # Vertical separation of missions ----------------------------------------------------------

    def on_mission(self, name: str, mission_id: int, items: tuple[MissionItem, ...]) -> None:
        """Record a mission that is sent to the vehicle; the mission on board stays recorded."""
        flown = self._all[name]
        fix = flown.availability.fix
        start_m = (fix.x_m, fix.y_m) if fix and flown.availability.airborne else None
        radius_m = flown.section.loiter_radius_m
        flown.sent_track = track_of(items, self._landscape, radius_m, start_m)
        flown.sent_id = mission_id
        flown.sent += 1
        flown.compared = self._missions_below(name)

    def on_outcome(self, name: str, pending_id: int, on_board_id: int) -> None:
        """Record whether the mission sent last is still being sent, is on board, or has failed."""
        flown = self._all[name]
        if flown.sent_track is None or flown.sent_id == pending_id:
            return
        if flown.sent_id == on_board_id:
            flown.track = flown.sent_track
        flown.sent_track = None

    def on_landing(self, name: str, items: tuple[MissionItem, ...]) -> None:
        """Record a landing mission that is sent to the vehicle, instead of its mission."""
        self.forget(name)
        flown = self._all[name]
        flown.descent_m = descent_of(items, self._landscape, flown.section.loiter_radius_m)

    def forget(self, name: str) -> None:
        """Delete the mission of a vehicle that lands or is on the ground."""
        flown = self._all[name]
        flown.track = flown.sent_track = flown.gave_way_to = flown.descent_m = None

    def min_altitudes(self, name: str) -> LeastAltitude:
        """Return the function that gives the minimum altitude of a new mission at points (n, 2)."""
        tracks = self._tracks_below(name)
        return lambda points_m: heights_below(points_m, tracks) + self._separation_m + MARGIN_M

    def comes_too_low(self, name: str) -> bool:
        """Return whether a vehicle in a lower layer has a new mission close below its mission."""
        own = self._all[name]
        missions = self._missions_below(name)
        if missions == own.compared or own.track is None or own.availability.fix is None:
            return False
        own.compared = missions
        left = ahead_on(own.track, own.availability.fix.x_m, own.availability.fix.y_m)
        return comes_too_low(left, self._tracks_below(name), self._separation_m)

    def _tracks_below(self, name: str) -> list[Track]:
        """Return the tracks and positions of the vehicles in lower layers.

        A vehicle to which a mission is being sent has two tracks.
        """
        below = self._below[name]
        both = [track for other in below for track in (other.track, other.sent_track)]
        tracks = [track for track in both if track is not None]
        places = [other.availability.fix for other in below if other.availability.airborne]
        fixes = [fix for fix in places if fix is not None]
        return [*tracks, places_of(fixes)] if fixes else tracks

    def _missions_below(self, name: str) -> tuple[int, ...]:
        return tuple(other.sent for other in self._below[name])

    # Giving way -------------------------------------------------------------------------------

    def gave_way_to(self, name: str) -> str | None:
        """Return the vehicle for which a vehicle waits, if any."""
        return self._all[name].gave_way_to

    def give_way_to(self, name: str) -> str | None:
        """Return and record the vehicle to which a vehicle must give way now, if any."""
        own = self._all[name]
        fix = own.availability.fix
        assert fix is not None
        if fix.at_s < own.cannot_give_way_until_s:
            return None
        if own.gave_way_to is not None and self._is_passing(own, self._all[own.gave_way_to]):
            return own.gave_way_to
        others = (each for each in self._all if each != name)
        own.gave_way_to = next(
            (each for each in others if self._has_right_of_way(name, each)), None
        )
        if own.gave_way_to is not None:
            offset_m = self._separation_m
            offset_m += 2.0 * own.section.turn_radius_m + 3.0 * own.section.loiter_radius_m
            other = self._all[own.gave_way_to]
            assert other.availability.fix is not None
            descent_m = self._descent_above(fix, other)
            path_m = straight_on(other.availability.fix) if descent_m is None else descent_m
            own.waits_at = avoidance_position(fix, path_m, self._fire_m, offset_m)
            own.waits_since_s = fix.at_s
        return own.gave_way_to

    def end_giving_way(self, name: str) -> None:
        """Record that a vehicle no longer gives way, because it received another command."""
        self._all[name].gave_way_to = None

    def on_giving_way_prevented(self, name: str, at_s: float) -> None:
        """Record that a vehicle cannot receive a mission to give way, so that others give way."""
        self.end_giving_way(name)
        self._all[name].cannot_give_way_until_s = at_s + CANNOT_GIVE_WAY_FOR_S

    def _is_passing(self, own: Flown, other: Flown) -> bool:
        fixes = _reported_fixes(own, other)
        if fixes is None or fixes[0].at_s - own.waits_since_s > WAITS_AT_MOST_S:
            return False
        if self._descent_above(fixes[0], other) is not None:
            return True
        turn_m = max(own.section.turn_radius_m, other.section.turn_radius_m)
        return not has_passed(*fixes, self._separation_m, turn_m)

    def _has_right_of_way(self, name: str, other_name: str) -> bool:
        own, other = self._all[name], self._all[other_name]
        fixes = _reported_fixes(own, other)
        if fixes is None or self._are_in_layers(own, other):
            return False
        fix, other_fix = fixes
        waits_for = _waits_for(other, fix.at_s)
        if waits_for == name:
            return False
        turn_m = max(own.section.turn_radius_m, other.section.turn_radius_m)
        descent_m = self._descent_above(fix, other)
        if descent_m is not None:
            apart_m = _path_ahead(own, fix)[:, None] - descent_m
            near_m = self._separation_m + turn_m
            return bool(np.hypot(apart_m[..., 0], apart_m[..., 1]).min() < near_m)
        if waits_for is not None and other.waits_at is not None:
            x_m, y_m = other.waits_at[0]
            other_fix = replace(other_fix, x_m=x_m, y_m=y_m, east_m_s=0.0, north_m_s=0.0)
            turn_m += other.section.loiter_radius_m / 2.0
        if not is_near(fix, other_fix, self._separation_m, turn_m):
            return False
        unable = waits_for is not None or not _can_give_way(other, fix.at_s)
        return unable or gives_way(fix, other_fix, other_name in self._earlier[name])

    def _descent_above(self, fix: PositionFix, other: Flown) -> Floats | None:
        """Return the descent of a vehicle that is landing from above a position, or None."""
        other_fix = other.availability.fix
        if other.availability.landing not in DESCENDING or other_fix is None:
            return None
        below = fix.altitude_m < other_fix.altitude_m + self._separation_m
        return other.descent_m if below else None

    def _are_in_layers(self, own: Flown, other: Flown) -> bool:
        """Return whether two vehicles have different layers and have reached them."""
        fix, other_fix = own.availability.fix, other.availability.fix
        both = own.availability.flies and other.availability.flies
        if fix is None or other_fix is None or not both:
            return False
        above_m = fix.altitude_m - other_fix.altitude_m
        if own in self._below[other.section.name]:
            return -above_m >= self._separation_m / 2.0
        return other in self._below[own.section.name] and above_m >= self._separation_m / 2.0

    def may_turn_back(self, name: str) -> bool:
        """Return whether a vehicle may turn back: no nearby vehicle is moving out of the way."""
        fix = self._all[name].availability.fix
        for other in self._all.values():
            other_fix = other.availability.fix
            if other.gave_way_to != name or fix is None or other_fix is None:
                continue
            leaving = fix.at_s - other.waits_since_s < LEAVES_WITHIN_S
            if leaving and math.dist((fix.x_m, fix.y_m), (other_fix.x_m, other_fix.y_m)) < LEAVES_M:
                return False
        return True

    def waits_at(self, name: str) -> Floats:
        """Return the waiting position of the vehicle, (1, 2)."""
        place = self._all[name].waits_at
        assert place is not None
        return place

    def takeoff_obstacle(self, name: str, at_s: float) -> str:
        """Return why another vehicle prevents a takeoff; record the takeoff if none does."""
        own = self._all[name]
        for other in self._all.values():
            if other is own:
                continue
            fix, availability = other.availability.fix, other.availability
            if availability.landing in DESCENDING and availability.may_still_land(at_s):
                place, why = other.home_m, "is landing"
            elif availability.airborne and fix is not None and at_s - fix.at_s < STALE_S:
                place, why = (fix.x_m, fix.y_m), f"is within {TAKEOFF_CLEAR_M:.0f} m of its home"
            elif at_s - other.started_at_s < TAKES_OFF_WITHIN_S:
                place, why = other.home_m, "is taking off"
            else:
                continue
            if math.dist(place, own.home_m) < TAKEOFF_CLEAR_M:
                return f"{other.section.name} {why}"
        own.started_at_s = at_s
        return ""


def _can_give_way(own: Flown, at_s: float) -> bool:
    """Return whether a vehicle can give way: it flies its missions, and no hold is ordered."""
    follows = own.availability.flies and not own.availability.hold_is_ordered
    return follows and at_s >= own.cannot_give_way_until_s


def _waits_for(own: Flown, at_s: float) -> str | None:
    """Return the vehicle to which a vehicle gives way at this time, if any."""
    waits = _can_give_way(own, at_s) and at_s - own.waits_since_s <= WAITS_AT_MOST_S
    return own.gave_way_to if waits else None


def _path_ahead(own: Flown, fix: PositionFix) -> Floats:
    """Return points (n, 2) of a vehicle's path over the next ``AHEAD_S``, from its position."""
    if own.track is None:
        return straight_on(fix)
    count = 2 + math.ceil(AHEAD_S * math.hypot(fix.east_m_s, fix.north_m_s) / SPACING_M)
    ahead_m = ahead_on(own.track, fix.x_m, fix.y_m).points_m[:count]
    return np.vstack([(fix.x_m, fix.y_m), ahead_m])


def _reported_fixes(own: Flown, other: Flown) -> tuple[PositionFix, PositionFix] | None:
    """Return two vehicles' positions; None unless ``other`` is airborne with a recent position."""
    fix, other_fix = own.availability.fix, other.availability.fix
    if fix is None or other_fix is None or not other.availability.airborne:
        return None
    return (fix, other_fix) if fix.at_s - other_fix.at_s < STALE_S else None
