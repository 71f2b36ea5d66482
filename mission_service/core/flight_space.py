"""Computes the space that vehicles occupy in flights that they have begun or would begin."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import shapely

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import (
    LOITER_RADIUS_FACTOR,
    RETURN_ABOVE_M,
    MissionPlace,
    Part,
    Position,
    approach_part,
    between_altitudes,
    corner_parts,
    disc,
    held_turn,
    landing_places,
    late_places,
    mission_parts,
    mission_places,
    path_parts,
    turn_area,
    turning_parts,
    turns_towards,
)
from mission_service.airspace.operational_intent import IntendedPart, Purpose
from mission_service.commands import ClimbAndHold, HoldAt, Orbit
from mission_service.config.sections import VehicleSection
from mission_service.missions.landing import APPROACH_HEIGHTS_M, glide_m
from mission_service.position_fix import PositionFix
from mission_service.vehicles.airspace_state import AirspaceState
from mission_service.vehicles.availability import AIRBORNE_M, GOING_HOME, MISSION
from mission_service.vehicles.first_climb import fastest_m_s
from mission_service.vehicles.vehicle_state import Vehicle

HOLDS_FOR_UPLOAD_S = 3.0  # until a vehicle that holds for an upload continues
STARTS_WITHIN_S = 2.0  # until a vehicle flies a mission sent now
COPTER_REACH_M = 20.0
SINK_M_S = 5.0  # default of FW_T_SINK_MAX and TECS_SINK_MAX


def position_of(fix: PositionFix) -> Position:
    """Return the x, y and altitude of a vehicle."""
    return fix.x_m, fix.y_m, fix.altitude_m


def return_above_m(vehicle: Vehicle) -> float:
    """Return the height above home up to which a vehicle's returns are checked."""
    known_m = (vehicle.return_flight.height_m, vehicle.section.return_height_m)
    return max((RETURN_ABOVE_M, *(height_m for height_m in known_m if height_m is not None)))


class FlightSpace:
    """The space occupied by flights over a landscape."""

    def __init__(self, landscape: Landscape) -> None:
        self._landscape = landscape

    def route(self, vehicle: Vehicle, items: Sequence[MissionItem]) -> tuple[MissionPlace, ...]:
        """Return the positions of a mission. Where a mission loiters, a multirotor hovers."""
        places = mission_places(items, self._landscape, self._home_altitude_m(vehicle))
        if vehicle.section.winged:
            return places
        most_m = COPTER_REACH_M / LOITER_RADIUS_FACTOR
        return tuple(place._replace(radius_m=min(place.radius_m, most_m)) for place in places)

    def landing(self, vehicle: Vehicle, items: Sequence[MissionItem]) -> tuple[MissionPlace, ...]:
        """Return the positions of the landing in a mission, to which PX4's return leads."""
        return landing_places(items, self._landscape, self._home_altitude_m(vehicle))

    def start_of(self, vehicle: Vehicle) -> Position | None:
        """Return the position where a new mission would begin in the air; None on the ground.

        A vehicle that returns or lands counts as on the ground below ``AIRBORNE_M``: a mission
        would be a takeoff.
        """
        availability = vehicle.availability
        fix = availability.fix
        if fix is None or not availability.airborne:
            return None
        over_ground_m = fix.altitude_m - float(self._landscape.elevation_at(fix.x_m, fix.y_m))
        height_m = max(availability.height_m, over_ground_m)
        if availability.mode in GOING_HOME and height_m <= AIRBORNE_M:
            return None
        return position_of(fix)

    def of_mission(self, vehicle: Vehicle, places: Sequence[MissionPlace]) -> list[Part]:
        """Return the space of a mission that would begin now."""
        radius_m = turn_radius_m(vehicle)
        fix = vehicle.availability.fix
        if not places:
            return []
        if fix is None or not vehicle.availability.airborne:
            after_takeoff = _space_along(vehicle, places[0].position, places[1:], places[1:])
            return turning_parts(places, radius_m) + mission_parts(places) + after_takeoff.late
        along = _space_along(vehicle, position_of(fix), places, places)
        # The first leg begins with a turn (see below).
        parts = along.turns + along.late + along.legs[1:]
        here = (fix.x_m, fix.y_m)
        positions = [place.position for place in places]
        away = [each for each in positions if math.dist(each[:2], here) > 1.0] or positions[-1:]
        # If the first position is the vehicle's own, it lies behind the vehicle when the mission
        # begins.
        for first, *then in (positions, away):
            for entry in self._entries(vehicle, fix, first[:2]):
                parts += path_parts([*entry, first])
                parts += [turn_area([*entry, first])] if vehicle.section.winged else []
                parts += corner_parts([entry[-1], first, *then[:1]], radius_m)
        return parts

    def of_flight(self, vehicle: Vehicle, fix: PositionFix, state: AirspaceState) -> list[Part]:
        """Return the space of the vehicle's current flight, according to its mode."""
        mode = vehicle.availability.mode
        if mode == MISSION:
            if not state.on_board:
                return []
            seq = vehicle.current_seq
            left = [place for place in state.on_board if place.seq >= seq]
            left = left or list(state.on_board[-1:])
            along = _space_along(vehicle, position_of(fix), left, state.on_board, seq)
            return along.legs + along.turns + along.late
        if mode in GOING_HOME:
            return self.of_return(vehicle, fix, state)
        if mode in ("guided", "orbit") and state.orbit is not None:
            return [state.orbit]
        if state.orbit is not None and vehicle.hold_at is not None and vehicle.ordered:
            return [state.orbit]  # PX4 also holds at another place in this mode
        return [self.of_hold(vehicle, state.began_at or position_of(fix))]

    def of_hold_at(self, vehicle: Vehicle, command: Orbit | ClimbAndHold | HoldAt) -> Part:
        """Return the space of a hold or an orbit at a place."""
        x_m, y_m = self._landscape.xy_of_lat_lon(command.lat_deg, command.lon_deg)
        radius_m = vehicle.section.loiter_radius_m if vehicle.section.winged else 0.0
        if isinstance(command, Orbit):
            radius_m = abs(command.radius_m)
        altitude_m, reach_m = command.altitude_amsl_m, LOITER_RADIUS_FACTOR * radius_m + 1.0
        return disc(float(x_m), float(y_m), reach_m, altitude_m, altitude_m)

    def of_hold(self, vehicle: Vehicle, position: Position) -> Part:
        """Return the space of a hold that begins at a position."""
        section = vehicle.section
        reach_m = _hold_reach_m(section)
        return disc(position[0], position[1], reach_m, position[2], position[2])

    def of_return(self, vehicle: Vehicle, fix: PositionFix, state: AirspaceState) -> list[Part]:
        """Return the space of the autopilot's return, at any altitude that it may use.

        The return is flown straight home. A plane then circles above home. If PX4 returns to the
        landing in its mission, it flies straight to the landing's loiter and glides home.
        """
        home_altitude_m = self._home_altitude_m(vehicle)
        high_m = max(fix.altitude_m, home_altitude_m + return_above_m(vehicle))
        goal_m = self.return_goal_m(vehicle, state)
        goal = (*goal_m, home_altitude_m)
        routes = [[*entry, goal] for entry in self._entries(vehicle, fix, goal_m)]
        parts = [part for route in routes for part in path_parts(route)]
        section = vehicle.section
        if section.winged:
            parts += [turn_area(route) for route in routes]
            reach_m = LOITER_RADIUS_FACTOR * section.loiter_radius_m
            circle = disc(*goal_m, reach_m, home_altitude_m, high_m)
            parts += [approach_part(route[-2], circle) for route in routes]
            glide = _return_landing(vehicle, state)[1:]
            parts += [approach_part(place.position, circle) for place in glide]
        return [replace(part, lowest_m=home_altitude_m, highest_m=high_m) for part in parts]

    def return_goal_m(self, vehicle: Vehicle, state: AirspaceState) -> tuple[float, float]:
        """Return the position (x, y) to which a return leads directly: home or a landing."""
        landing = _return_landing(vehicle, state)
        return landing[0].position[:2] if landing else vehicle.home_m

    def of_intent(self, vehicle: Vehicle, state: AirspaceState) -> list[IntendedPart]:
        """Return the space of the rest of a flight, for an operational intent; empty without one.

        The vehicle may hold anywhere on its flight, and return from any place that it can reach.
        The return lies inside the convex hull of these places and home. The landing lies inside a
        disc around home, so that the approach may have any course. A vehicle on the ground has a
        flight if a mission with a takeoff was accepted.
        """
        fix, home_amsl_m = vehicle.availability.fix, self._home_altitude_m(vehicle)
        home = (*vehicle.home_m, home_amsl_m)
        if vehicle.availability.airborne and fix is not None:
            parts = self.of_flight(vehicle, fix, state) or [self.of_hold(vehicle, position_of(fix))]
            way_home = self.of_return(vehicle, fix, state)
        elif vehicle.flown_line is not None and vehicle.accepted and vehicle.accepted.takes_off:
            parts, way_home = mission_parts(state.on_board, [home]), []
            parts += turning_parts(state.on_board, turn_radius_m(vehicle))
        else:
            return []
        section = vehicle.section
        hold_m = _hold_reach_m(section)
        landing_m, turn_m = COPTER_REACH_M, 0.0
        if section.winged:
            landing_m = glide_m(APPROACH_HEIGHTS_M[-1]) + hold_m
            turn_m = 2.0 * section.turn_radius_m
        field = disc(*vehicle.home_m, landing_m, home_amsl_m, home_amsl_m)
        shapes = [part.shape for part in (*parts, *way_home, field)]
        highest_m = max(home_amsl_m + return_above_m(vehicle), *(part.highest_m for part in parts))
        back = Part(shapely.union_all(shapes).convex_hull, home_amsl_m, highest_m)
        named = [IntendedPart(_purpose(vehicle, part), part, hold_m) for part in parts]
        return [*named, IntendedPart("return and landing", back, hold_m + turn_m)]

    def _entries(
        self, vehicle: Vehicle, fix: PositionFix, target_m: tuple[float, float]
    ) -> list[list[Position]]:
        """Return the positions along each possible turn from the vehicle towards a target.

        The vehicle flies on until the mission is on board. If it holds for the upload, as ArduPilot
        does, it may turn right meanwhile. It may turn to either side towards a target behind it.
        Wind widens a turn.
        """
        section = vehicle.section
        if not section.winged:
            return [[position_of(fix)]]
        here, height_m = (fix.x_m, fix.y_m), fix.altitude_m
        velocity_m_s = (fix.east_m_s, fix.north_m_s)
        radius_m = turn_radius_m(vehicle)
        ahead_m = (velocity_m_s[0] * STARTS_WITHIN_S, velocity_m_s[1] * STARTS_WITHIN_S)
        begun = [([here, (here[0] + ahead_m[0], here[1] + ahead_m[1])], velocity_m_s)]
        if not vehicle.atomic_upload and vehicle.availability.mode == MISSION:
            begun.append(held_turn(here, velocity_m_s, section.turn_radius_m, HOLDS_FOR_UPLOAD_S))
        return [
            [(x_m, y_m, height_m) for x_m, y_m in (*way, *turn[1:])]
            for way, then_m_s in begun
            for turn in turns_towards(way[-1], then_m_s, target_m, radius_m)
        ]

    def _home_altitude_m(self, vehicle: Vehicle) -> float:
        return float(self._landscape.elevation_at(*vehicle.home_m))


def _return_landing(vehicle: Vehicle, state: AirspaceState) -> tuple[MissionPlace, ...]:
    """Return the positions of the landing to which a return leads; empty if it leads home."""
    return state.landing if vehicle.return_flight.to_landing else ()


class _SpaceAlong(NamedTuple):
    """The space of a mission; ``late`` is that of altitudes which a plane reaches late."""

    legs: list[Part]
    turns: list[Part]
    late: list[Part]


def _space_along(
    vehicle: Vehicle,
    start: Position,
    left: Sequence[MissionPlace],
    places: Sequence[MissionPlace],
    from_seq: int = 0,
) -> _SpaceAlong:
    """Return the space of the flight from ``start`` through the places left of a mission.

    ``places`` are all positions of the mission; turns before ``from_seq`` are omitted.
    """
    radius_m = turn_radius_m(vehicle)
    legs, turns = mission_parts(left, [start]), turning_parts(places, radius_m, from_seq)
    if not vehicle.section.winged:
        return _SpaceAlong(legs, turns, [])
    climb_m_s, fastest = vehicle.section.climb_m_s, fastest_m_s(vehicle)
    late = late_places(left, start, climb_m_s / fastest, max(climb_m_s, SINK_M_S) / fastest)
    if late == tuple(left):
        return _SpaceAlong(legs, turns, [])
    all_late = [*(place for place in places if place.seq < late[0].seq), *late]
    late_parts = mission_parts(late, [start]) + turning_parts(all_late, radius_m, from_seq)
    return _SpaceAlong(legs, turns, between_altitudes(legs + turns, late_parts))


def turn_radius_m(vehicle: Vehicle) -> float:
    """Return a vehicle's turn radius over ground in the measured wind; 0 for a copter."""
    section, wind = vehicle.section, vehicle.availability.measured_wind
    if not section.winged:
        return 0.0
    factor = 1.0 + (0.0 if wind is None else wind.speed_m_s / section.airspeed_m_s)
    return float(section.turn_radius_m * factor**2)


def _hold_reach_m(section: VehicleSection) -> float:
    """Return how far a vehicle may stray from its position in a hold."""
    if not section.winged:
        return COPTER_REACH_M
    return 2.0 * LOITER_RADIUS_FACTOR * section.loiter_radius_m


def _purpose(vehicle: Vehicle, part: Part) -> Purpose:
    kind = part.shape.geom_type
    if kind != "Polygon":
        return "leg" if kind == "LineString" else "climb"
    in_mission = vehicle.availability.mode == MISSION or not vehicle.availability.airborne
    return "loiter" if in_mission else "hold"
