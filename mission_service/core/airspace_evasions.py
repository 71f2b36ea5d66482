"""Plans flights that keep vehicles out of closed airspace: around it, out of it, or a hold."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from operator import itemgetter

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import substring

from autopilot_bridge.items import AMSL_FRAMES, Items, at_altitudes, has_position, waypoint
from firemodel.landscape.landscape import Landscape
from mission_service.airspace.clearance import Airspace, blocked_area
from mission_service.airspace.occupied_space import (
    LOITER_RADIUS_FACTOR,
    MissionPlace,
    Part,
    Position,
    mission_parts,
)
from mission_service.airspace.routes import exits_from
from mission_service.airspace.volumes import Volume
from mission_service.commands import Hold, HoldAt, UploadMission
from mission_service.core.closed_airspace import ClosedAirspace
from mission_service.core.flight_space import COPTER_REACH_M, FlightSpace, position_of
from mission_service.core.hold_height import hold_over
from mission_service.guidance.protocol import Guidance
from mission_service.missions.climb import without_climb
from mission_service.missions.orbits import highest_ground_m
from mission_service.position_fix import PositionFix
from mission_service.vehicles.airspace_state import AirspaceState, Evasion
from mission_service.vehicles.endurance import air_velocity_m_s, to_place_s
from mission_service.vehicles.first_climb import fastest_m_s
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.vehicle_state import Vehicle

Floats = NDArray[np.float64]
NEAR_HOME_M = 400.0  # a detour that ends farther from home does not lead home
BEYOND_M = 20.0  # distance of the loiter outside a volume from its margin
LEVEL_CLEARANCE_M = 30.0  # least height above ground in level flight out of a volume
CLIMB_STEP_M = 5.0  # between the altitudes to which a multirotor may climb first
DETOURS = (1.0, 3.0)  # a mission has fewer corners than its detour, and so passes nearer
CUTS_M = (0.0, 150.0, 300.0, 600.0)  # the path is shortened by each length in turn until it is free
# The limit of the flight time of a way out without drawbacks, from that of the fastest way out.
LONGER_FACTOR, LONGER_S = 2.0, 30.0


class Evasions:
    """The missions by which vehicles avoid or leave closed volumes."""

    def __init__(
        self,
        landscape: Landscape,
        closed: ClosedAirspace,
        space: FlightSpace,
        missions: MissionsSent,
        guidance: Guidance,
    ) -> None:
        self._landscape = landscape
        self._closed = closed
        self._space = space
        self._missions = missions
        self._guidance = guidance

    def way_out(
        self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace, state: AirspaceState
    ) -> UploadMission | None:
        """Return the mission out of the volumes around a vehicle, with a loiter outside."""
        near = airspace.blocked(fix.altitude_m - 1.0, fix.altitude_m + 1.0)
        margin_m = airspace.margins.horizontal_m
        around = self._around(fix, airspace)
        beyond_m = LOITER_RADIUS_FACTOR * vehicle.section.loiter_radius_m + BEYOND_M
        blocked = blocked_area(around or near, margin_m)
        # Unless another way out takes little longer, a plane may fly towards rising ground or enter
        # another volume during its turn, and a multirotor may climb first.
        found, drawbacks, limit_s = None, (True, True), math.inf
        exits = exits_from((fix.x_m, fix.y_m), blocked, beyond_m)
        air_m_s = self._air_velocity_m_s(vehicle, fix.at_s)
        timed = [(to_place_s(vehicle, fix, each, air_m_s), each) for each in exits]
        for out_s, place in sorted(timed, key=itemgetter(0)):
            if out_s > limit_s:
                break
            path = np.array([(fix.x_m, fix.y_m), place])
            planned = self._straight_off(vehicle, path, fix)
            items = without_climb(planned)
            for way in self._altitudes_of(vehicle, items, path, fix, beyond_m):
                places = self._space.route(vehicle, way)
                if self._enters_another(places, fix, airspace) is not None:
                    continue
                turn = self._space.of_mission(vehicle, places)
                turns_into = self._enters_another(places, fix, airspace, turn) is not None
                climbs = math.dist(places[0].position[:2], (fix.x_m, fix.y_m)) < 1.0
                of_this = (items != planned or climbs, turns_into)
                if found is None:
                    limit_s = LONGER_FACTOR * out_s + LONGER_S
                if found is None or of_this < drawbacks:
                    found, drawbacks = (path, way, places), of_this
            if drawbacks == (False, False):
                break
        return None if found is None else self._exit(vehicle, *found, fix, state)

    def _air_velocity_m_s(self, vehicle: Vehicle, at_s: float) -> tuple[float, float]:
        """Return the velocity of the air (x, y) as measured by a vehicle; calm if it is unknown."""
        wind = vehicle.availability.recent_wind(at_s)
        if wind is None:
            return 0.0, 0.0
        return air_velocity_m_s(self._landscape, wind.speed_m_s, wind.from_deg)

    def _exit(
        self,
        vehicle: Vehicle,
        path: Floats,
        items: Items,
        places: tuple[MissionPlace, ...],
        fix: PositionFix,
        state: AirspaceState,
    ) -> UploadMission:
        state.evasion = Evasion.EXIT
        return self._upload(vehicle, path, items, places, fix, "leave closed airspace", state)

    def _altitudes_of(
        self, vehicle: Vehicle, items: Items, path: Floats, fix: PositionFix, reach_m: float
    ) -> Iterator[Items]:
        """Yield a mission out of a volume at different altitudes, the preferred one first.

        A descent from above a volume could enter it, as could a climb from below. The last mission
        climbs only as far as needed to clear the ground under its path and within ``reach_m`` of
        its end; a multirotor climbs before it leaves its position.
        """
        yield at_altitudes(items, AMSL_FRAMES, lambda z: max(z, fix.altitude_m))
        yield items
        start, end = (fix.x_m, fix.y_m), (float(path[-1, 0]), float(path[-1, 1]))
        beside_m = reach_m if vehicle.section.winged else COPTER_REACH_M
        ground_m = max(
            highest_ground_m(self._landscape, start, end, beside_m),
            highest_ground_m(self._landscape, end, end, reach_m),
        )
        low_m = max(fix.altitude_m, round(ground_m + LEVEL_CLEARANCE_M, 1))
        if low_m > fix.altitude_m and not vehicle.section.winged:
            items = self._guidance.items(vehicle, path, fix)
        yield at_altitudes(items, AMSL_FRAMES, lambda z: min(z, low_m))

    def way_home(
        self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace, state: AirspaceState
    ) -> UploadMission | None:
        """Return the mission home, clear of volumes and the ground; a return follows near home."""
        straight_home = np.array([(fix.x_m, fix.y_m), vehicle.home_m])
        for factor in DETOURS:
            detours = self._closed.detours(airspace.volumes, vehicle.section, factor)
            path = detours.around(straight_home)
            if path is None or math.dist(path[-1], vehicle.home_m) > NEAR_HOME_M:
                return None
            if airspace.volume_at(position_of(fix)) is None:
                choices = [self._guidance.items(vehicle, path, fix)]
            else:
                direct = without_climb(self._straight_off(vehicle, path, fix))
                level = direct if vehicle.section.winged else _level_at_first(direct, fix)
                choices = [direct] if level is direct else [level, direct]
            for items in choices:
                places = self._space.route(vehicle, items)
                if self._around_conflict(vehicle, fix, places, airspace) is None:
                    state.evasion = Evasion.AROUND
                    why = "fly home clear of closed airspace and terrain"
                    return self._upload(vehicle, path, items, places, fix, why, state)
        return None

    def conflict(
        self, vehicle: Vehicle, fix: PositionFix, state: AirspaceState, airspace: Airspace
    ) -> str | None:
        """Return the airspace that the evasion on board would enter if it began now, or None.

        A volume may have closed since the evasion was planned.
        """
        if state.evasion is Evasion.AROUND:
            return self._around_conflict(vehicle, fix, state.on_board, airspace)
        return self._enters_another(state.on_board, fix, airspace)

    def _around_conflict(
        self,
        vehicle: Vehicle,
        fix: PositionFix,
        places: tuple[MissionPlace, ...],
        airspace: Airspace,
    ) -> str | None:
        """Return the airspace that a flight home around closed volumes would enter, or None."""
        if airspace.volume_at(position_of(fix)) is not None:
            return self._enters_another(places, fix, airspace)
        parts = self._space.of_mission(vehicle, places)
        return airspace.conflict(parts, self._landscape, position_of(fix))

    def _around(self, fix: PositionFix, airspace: Airspace) -> list[Volume]:
        """Return the volumes that contain a vehicle, or whose margin does."""
        here = shapely.Point(fix.x_m, fix.y_m)
        near = airspace.blocked(fix.altitude_m - 1.0, fix.altitude_m + 1.0)
        margin_m = airspace.margins.horizontal_m
        return [each for each in near if shapely.dwithin(each.area_m, here, margin_m)]

    def _enters_another(
        self,
        places: tuple[MissionPlace, ...],
        fix: PositionFix,
        airspace: Airspace,
        turn: Sequence[Part] = (),
    ) -> str | None:
        """Return the airspace that a flight out of volumes would enter, or None.

        This is another volume, or any volume at the end of the flight. ``turn`` is the space of the
        flight's initial turn.
        """
        parts = [*turn, *mission_parts(places, [position_of(fix)])]
        around = self._around(fix, airspace)
        others = replace(
            airspace, volumes=tuple(each for each in airspace.volumes if each not in around)
        )
        enters = others.conflict(parts, self._landscape)
        return enters or airspace.conflict(parts[-1:], self._landscape)

    def _straight_off(self, vehicle: Vehicle, path: Floats, fix: PositionFix) -> Items:
        """Return a mission out of a volume that does not turn back to its starting position.

        A waypoint at the vehicle's position would make a plane turn back and a multirotor climb
        there first. A multirotor does so only if its path does not clear the terrain, and only as
        high as necessary.
        """
        items = self._guidance.items(vehicle, path[1:], fix)
        start, places = position_of(fix), self._space.route(vehicle, items)
        if vehicle.section.winged or self._is_clear(vehicle, start, places):
            return items
        lat_deg, lon_deg = map(float, self._landscape.lat_lon_of(*start[:2]))
        climb = waypoint(lat_deg, lon_deg, self._least_climb_m(vehicle, start, places))
        return (*items[: places[0].seq], climb, *items[places[0].seq :])

    def _least_climb_m(
        self, vehicle: Vehicle, start: Position, places: Sequence[MissionPlace]
    ) -> float:
        """Return the lowest altitude for a multirotor's climb at its place before it flies on."""
        ground_m = float(self._landscape.elevation_at(*start[:2]))
        low_m = max(ground_m + LEVEL_CLEARANCE_M, start[2])
        high_m = max(low_m, *(place.position[2] for place in places))
        for altitude_m in np.arange(low_m, high_m, CLIMB_STEP_M).round(1).tolist():
            if self._is_clear(vehicle, (*start[:2], altitude_m), places):
                return float(altitude_m)
        return round(high_m, 1)

    def _is_clear(self, vehicle: Vehicle, start: Position, places: Sequence[MissionPlace]) -> bool:
        """Return whether no part of the climb along a mission is too near to the ground.

        Too near is nearer than either end of a leg, and nearer than ``LEVEL_CLEARANCE_M``. A
        multirotor may not reduce its speed in a climb, and is then below the straight line.
        """
        gradient = vehicle.section.climb_m_s / fastest_m_s(vehicle)
        flown_m, from_m = 0.0, start
        for end in (place.position for place in places):
            length_m = math.dist(from_m[:2], end[:2])
            count = math.ceil(2.0 * length_m / self._landscape.cell_size_m) + 2
            line = np.linspace(from_m, end, count)
            climbed_m = start[2] + gradient * (flown_m + np.linspace(0.0, length_m, count))
            ground_m = self._landscape.elevation_at(line[:, 0], line[:, 1])
            heights_m = np.minimum(line[:, 2], climbed_m) - ground_m
            least_m = min(from_m[2] - ground_m[0], end[2] - ground_m[-1], LEVEL_CLEARANCE_M)
            if heights_m.min() < least_m - 1.0:
                return False
            flown_m, from_m = flown_m + length_m, end
        return True

    def free_hold(
        self,
        vehicle: Vehicle,
        fix: PositionFix,
        command: HoldAt,
        airspace: Airspace,
    ) -> HoldAt | Hold:
        """Return the hold that replaces a descent into closed airspace.

        The result is the lowest hold above the volumes at the same place, at most at the current
        altitude; or else the lower hold at the nearest free place; or else a hold at the vehicle's
        position.
        """
        up_m, space = airspace.margins.vertical_m, self._space.of_hold_at(vehicle, command)
        ceilings_m = [volume.ceiling_m + up_m + 1.0 for volume in airspace.volumes]
        between_m = [up for up in ceilings_m if command.altitude_amsl_m < up < fix.altitude_m]
        for altitude_m in [*sorted(between_m), fix.altitude_m]:
            column = replace(space, lowest_m=altitude_m, highest_m=fix.altitude_m)
            if airspace.conflict([column], self._landscape, position_of(fix)) is not None:
                continue
            if altitude_m == fix.altitude_m:
                return Hold(vehicle.name)
            return msgspec.structs.replace(command, altitude_amsl_m=round(altitude_m, 1))
        return self.free_place(vehicle, fix, command, airspace) or Hold(vehicle.name)

    def free_place(
        self, vehicle: Vehicle, fix: PositionFix, command: HoldAt, airspace: Airspace
    ) -> HoldAt | None:
        """Return the nearest free place for a hold, on a straight line out of the margins.

        The hold is as high above the highest ground on the way as the command is above the highest
        ground around its own place. No place is free if the way there would climb above both the
        vehicle and the command.
        """
        if self._landscape.elevation_m is None:
            return None
        radius_m = vehicle.section.loiter_radius_m
        x_m, y_m = map(float, self._landscape.xy_of_lat_lon(command.lat_deg, command.lon_deg))
        reach_m = 2.0 * LOITER_RADIUS_FACTOR * radius_m
        ground_m = highest_ground_m(self._landscape, (x_m, y_m), (x_m, y_m), reach_m)
        low_m, high_m = sorted((command.altitude_amsl_m, fix.altitude_m))
        blocked = blocked_area(airspace.blocked(low_m, high_m), airspace.margins.horizontal_m)
        beyond_m = LOITER_RADIUS_FACTOR * radius_m + BEYOND_M
        for place in exits_from((fix.x_m, fix.y_m), blocked, beyond_m):
            if not self._landscape.contains(*place):
                continue
            way_ground_m = highest_ground_m(self._landscape, (fix.x_m, fix.y_m), place, reach_m)
            up_m = max(way_ground_m - ground_m, 0.0)
            altitude_m = round(command.altitude_amsl_m + up_m, 1)
            target = MissionPlace((*place, altitude_m), radius_m, 0)
            if altitude_m > high_m or self._enters_another((target,), fix, airspace) is not None:
                continue
            return hold_over(place, altitude_m, vehicle.name, self._landscape)
        return None

    def _upload(
        self,
        vehicle: Vehicle,
        path: Floats,
        items: Items,
        places: tuple[MissionPlace, ...],
        fix: PositionFix,
        why: str,
        state: AirspaceState,
    ) -> UploadMission:
        """Return the upload of an evasion; the evasion is started as soon as it is on board."""
        vehicle.drop_upload()
        upload = self._missions.upload(vehicle, path, items, fix, why, keeps_apart=True)
        assert vehicle.pending is not None
        vehicle.pending.evades = True
        vehicle.holding, vehicle.hold_again_at_s = True, None  # no hold interrupts the evasion
        vehicle.hold_at = None
        state.evasion_id = upload.mission_id
        state.sent[upload.mission_id] = (places, self._space.landing(vehicle, items))
        return upload

    def around(
        self,
        vehicle: Vehicle,
        command: UploadMission,
        places: tuple[MissionPlace, ...],
        airspace: Airspace,
    ) -> tuple[UploadMission, tuple[MissionPlace, ...]] | None:
        """Return the mission around the closed volumes, and its positions; None without a path.

        ``places`` are the positions of the mission ``command``.
        """
        fix = vehicle.availability.fix
        if fix is None:
            return None
        start = self._space.start_of(vehicle)
        positions = [place.position for place in places]
        altitudes = [fix.altitude_m, *(position[2] for position in positions)]
        near = airspace.blocked(min(altitudes), max(altitudes))
        path = np.array([position[:2] for position in positions])
        here = np.array([(fix.x_m, fix.y_m)])
        if len(path) == 1 or math.dist(path[0], here[0]) > 1.0:
            path = np.vstack([here, path])
        for factor, cut_m in product(DETOURS, CUTS_M):
            around = self._closed.detours(near, vehicle.section, factor).around(path)
            if around is None:
                break
            line = shapely.LineString(around)
            if line.length - cut_m < vehicle.section.min_leg_m:
                continue
            cut = shapely.get_coordinates(substring(line, 0.0, line.length - cut_m))
            items = self._guidance.items(vehicle, cut, fix)
            cut_places = self._space.route(vehicle, items)
            parts = self._space.of_mission(vehicle, cut_places)
            if airspace.conflict(parts, self._landscape, start) is None:
                return msgspec.structs.replace(command, items=items), cut_places
        return None


def _level_at_first(items: Items, fix: PositionFix) -> Items:
    """Return a multirotor's mission without a descent on its first leg.

    On a steep descent a multirotor flies slowly, and would stay inside a closed volume for long.
    """
    first = next(seq for seq, item in enumerate(items) if has_position(item.command))
    if items[first].z >= fix.altitude_m:
        return items
    level = replace(items[first], z=round(fix.altitude_m, 1))
    return (*items[:first], level, *items[first + 1 :])
