"""Keeps all vehicles out of closed airspace: checks each command, and each flight again. Pure.

Each command is checked before it is sent (``checked``), whichever module has caused it. A mission
that would enter a closed volume is led around it, or not sent. When a volume closes, and at each
report of a position, the flight that a vehicle has begun is checked (``watch``). A vehicle that
would enter gets a new mission from its planner; if it has none in time, it holds before the volume.
A vehicle inside leaves by the shortest way and holds outside.
"""

import math
from collections.abc import Iterable, Mapping

import numpy as np
import shapely
from shapely.ops import substring

from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.airspace.clearance import Airspace, Margins, blocked_area
from mission_service.airspace.occupied_space import (
    WIDER,
    MissionPlace,
    Part,
    Position,
    disc,
    mission_parts,
    mission_places,
    path_parts,
    straight,
    turns_towards,
)
from mission_service.airspace.routes import Detours, exits_from
from mission_service.airspace.volumes import Volume, polygon_of, volumes_of
from mission_service.commands import (
    REJECTED,
    AnyCommand,
    ClearAlarm,
    ClimbAndHold,
    Hold,
    Orbit,
    RaiseAlarm,
    Return,
    Severity,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import Scenario
from mission_service.guidance.protocol import Guidance
from mission_service.position_fix import PositionFix
from mission_service.vehicles.airspace_state import AirspaceState, Evasion
from mission_service.vehicles.availability import GOING_HOME, MISSION
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.vehicle_state import Vehicle, announce

AIRSPACE = "airspace"
CHANGED = "the airspace has changed"
BEFORE_ENTRY_S = 25.0  # a vehicle without a new mission holds this time before it would enter
ACTS_AGAIN_S = 15.0  # longer than an upload
START_AGAIN_S = 10.0
STARTS_WITHIN_S = 2.0  # until a vehicle flies a mission that is sent now
RETURN_ABOVE_M = 150.0  # returns are checked up to this height above home
STRAIGHT_HOME_M = 400.0
CUTS_M = (0.0, 150.0, 300.0, 600.0)  # lengths by which a mission's path is shortened, in turn


class AirspaceGuard:
    """The closed volumes of a run, and the checks of all vehicles' flights against them."""

    def __init__(
        self,
        scenario: Scenario,
        landscape: Landscape,
        vehicles: Mapping[str, Vehicle],
        missions: MissionsSent,
        guidance: Guidance,
    ) -> None:
        """Read the scenario's volumes. Raises ScenarioError for a file that cannot be read."""
        section = scenario.airspace
        self.volumes: tuple[Volume, ...] = volumes_of(section, landscape)
        self._lead_s = section.lead_s
        self._margins = Margins(section.margin_m, section.vertical_margin_m)
        self._max_agl_m = section.max_altitude_agl_m
        self._landscape = landscape
        self._vehicles = vehicles
        self._missions = missions
        self._guidance = guidance
        self._moves = not scenario.way.prescribed  # a burn's vehicle has its own safe climb
        self._states = {name: AirspaceState() for name in vehicles}
        self._closed: tuple[Volume, ...] = ()
        self._version = 0  # increases when a volume closes or opens
        self._detours: dict[tuple[str, ...], Detours] = {}

    # Closing and opening ----------------------------------------------------------------------

    def on_operator(self, event: events.AnyOperatorEvent) -> list[AnyCommand]:
        """Apply an operator's event: close or open a volume; an order ends an evasion."""
        match event:
            case events.AirspaceClosed():
                return self._close(event)
            case events.AirspaceOpened():
                return self._open(event)
            case events.OrderGiven() | events.Aborted():
                named = "" if isinstance(event, events.Aborted) else event.vehicle
                for name in self._vehicles:
                    if named in ("", name):
                        self._states[name].evasion = Evasion.NONE
                        self._states[name].checked = ()
                return []
            case _:
                return []

    def _close(self, event: events.AirspaceClosed) -> list[AnyCommand]:
        if any(volume.name == event.name for volume in self.volumes):
            words = f"{REJECTED} {event.name!r} is closed already: open it first, or rename it"
            return self._to_all(words, warning=True)
        at_s = event.at_us / 1e6
        area_m = polygon_of(event.name, event.corners, self._landscape)
        floor_m = -math.inf if event.floor_amsl_m is None else event.floor_amsl_m
        ceiling_m = math.inf if event.ceiling_amsl_m is None else event.ceiling_amsl_m
        until_s = math.inf if event.for_s is None else at_s + event.for_s
        volume = Volume(event.name, area_m, floor_m, ceiling_m, at_s, until_s)
        self.volumes = (*self.volumes, volume)
        return self._to_all(f"airspace {event.name!r} closed by {event.by}", warning=True)

    def _open(self, event: events.AirspaceOpened) -> list[AnyCommand]:
        left = tuple(volume for volume in self.volumes if volume.name != event.name)
        if len(left) == len(self.volumes):
            names = ", ".join(repr(volume.name) for volume in self.volumes) or "none"
            words = f"{REJECTED} no closed volume {event.name!r}; closed are: {names}"
            return self._to_all(words, warning=True)
        self.volumes = left
        return self._to_all(f"airspace {event.name!r} opened by {event.by}", warning=True)

    def _to_all(self, words: str, warning: bool) -> list[AnyCommand]:
        first = next(iter(self._vehicles.values()), None)
        return [] if first is None else [announce(first, words, warning)]

    def airspace_at(self, at_s: float) -> Airspace:
        """Return the airspace at a mission time; volumes count as closed ``lead_s`` earlier."""
        closed = tuple(each for each in self.volumes if each.is_closed(at_s, self._lead_s))
        if closed != self._closed:
            self._closed, self._detours = closed, {}
            self._version += 1
        return Airspace(closed, self._margins, self._max_agl_m)

    # The check before sending -----------------------------------------------------------------

    def checked(self, commands: Iterable[AnyCommand], at_s: float) -> list[AnyCommand]:
        """Return the commands without those that lead into closed airspace.

        A mission is led around closed volumes if possible. A withheld command raises an alarm.
        """
        airspace = self.airspace_at(at_s)
        found: list[AnyCommand] = []
        for command in commands:
            match command:
                case UploadMission():
                    found += self._checked_upload(command, airspace, at_s)
                case StartMission():
                    found += self._checked_start(command, airspace, at_s)
                case Orbit() | ClimbAndHold():
                    found += self._checked_place(command, airspace)
                case Return():
                    found += self._checked_return(command, airspace, at_s)
                case _:
                    found.append(command)
        return found

    def _checked_upload(
        self, command: UploadMission, airspace: Airspace, at_s: float
    ) -> list[AnyCommand]:
        vehicle = self._vehicles[command.vehicle]
        state = self._states[vehicle.name]
        sent = command
        if command.mission_id != state.evasion_id:
            conflict = self._mission_conflict(vehicle, self._places(vehicle, command), airspace)
            if conflict is not None:
                led_around = self._led_around(vehicle, command, airspace)
                if led_around is None:
                    vehicle.drop_upload()
                    vehicle.not_before_s = at_s + START_AGAIN_S
                    state.withheld = True
                    words = f"a mission is not sent, because it would enter {conflict}"
                    return self._raised(vehicle, words)
                sent = led_around
        state.sent[sent.mission_id] = self._places(vehicle, sent)
        state.withheld = False
        return [sent]

    def _checked_start(
        self, command: StartMission, airspace: Airspace, at_s: float
    ) -> list[AnyCommand]:
        vehicle = self._vehicles[command.vehicle]
        state = self._states[vehicle.name]
        if not state.on_board or state.on_board_id == state.evasion_id != 0:
            return [command]
        conflict = self._mission_conflict(vehicle, state.on_board, airspace)
        state.withheld = conflict is not None
        if conflict is None:
            return [command]
        vehicle.end_intentions()
        if vehicle.availability.airborne:
            vehicle.holding, vehicle.due = True, vehicle.due or CHANGED
        else:
            vehicle.start_again_at_s = at_s + START_AGAIN_S
        return self._raised(vehicle, f"is not started: its mission would enter {conflict}")

    def _checked_place(self, command: Orbit | ClimbAndHold, airspace: Airspace) -> list[AnyCommand]:
        vehicle = self._vehicles[command.vehicle]
        fix = vehicle.availability.fix
        if fix is None:
            return [command]
        x_m, y_m = self._landscape.xy_of_lat_lon(command.lat_deg, command.lon_deg)
        radius_m = abs(command.radius_m) if isinstance(command, Orbit) else 0.0
        target = (float(x_m), float(y_m), command.altitude_amsl_m)
        place = disc(target[0], target[1], WIDER * radius_m + 1.0, target[2], target[2])
        parts = [straight(_position(fix), target), place]
        conflict = airspace.conflict(parts, self._landscape, _position(fix))
        if conflict is not None and isinstance(command, Orbit):
            return self._raised(vehicle, f"an orbit is not ordered: it would enter {conflict}")
        self._states[vehicle.name].orbit = place
        return [command]  # a climb out of the reach of flames is more urgent

    def _checked_return(self, command: Return, airspace: Airspace, at_s: float) -> list[AnyCommand]:
        vehicle = self._vehicles[command.vehicle]
        if not self._may_move(vehicle) or vehicle.pending is not None:
            return [command]
        fix = vehicle.availability.fix
        assert fix is not None
        conflict = airspace.conflict(
            self._return_parts(vehicle, fix), self._landscape, _position(fix)
        )
        if conflict is None:
            self._states[vehicle.name].home_clear = self._version
            return [command]
        return self._evade(vehicle, fix, airspace, conflict, at_s, returns=True) or [command]

    # Flights under way ------------------------------------------------------------------------

    def apply(self, event: events.VehicleEvent) -> None:
        """Record which mission is on board, and how far it is flown."""
        state = self._states[event.vehicle]
        match event:
            case events.UploadFinished():
                places = state.sent.get(event.mission_id)
                if event.outcome == "accepted" and places is not None:
                    self._put_on_board(state, event.mission_id, places)
            case events.MissionReadBack():
                places = state.sent.get(event.mission_id)
                if places is not None:
                    self._put_on_board(state, event.mission_id, places)
                elif event.mission_id != state.on_board_id:
                    state.on_board, state.on_board_id = (), 0
            case events.MissionProgress():
                state.current_seq = event.current_seq
            case events.ModeChanged():
                state.began_at = None
                if not event.armed or event.mode in GOING_HOME:
                    state.evasion = Evasion.NONE
            case _:
                pass

    def _put_on_board(
        self, state: AirspaceState, mission_id: int, places: tuple[MissionPlace, ...]
    ) -> None:
        state.on_board_id, state.on_board = mission_id, places
        state.sent = {number: sent for number, sent in state.sent.items() if number > mission_id}
        if mission_id != state.evasion_id:
            state.evasion = Evasion.NONE

    def leads(self, name: str) -> bool:
        """Return whether a vehicle flies home around closed volumes, which no planner changes."""
        return self._states[name].evasion is Evasion.AROUND

    def watch(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Check the present flight of a vehicle; return the commands that keep it out."""
        airspace = self.airspace_at(at_s)
        state, fix = self._states[vehicle.name], vehicle.availability.fix
        if fix is None or not (airspace.is_limited or state.alarm or state.evasion_id):
            return []
        availability = vehicle.availability
        if not (availability.airborne and availability.armed):
            return self._lowered(vehicle) if not availability.armed else []
        if state.began_at is None:
            state.began_at = _position(fix)
        inside = airspace.volume_at(_position(fix))
        self._check_again(vehicle, fix, airspace)
        conflict = f"the closed volume {inside.name!r}" if inside is not None else state.conflict
        if not conflict:
            return [*self._lowered(vehicle), *self._straight_home(vehicle, fix, airspace)]
        words = f"is inside {conflict}" if inside is not None else f"would enter {conflict}"
        if not self._may_move(vehicle):
            return self._raised(vehicle, f"{words}; it is not under control of the service")
        if at_s < state.acts_again_at_s or vehicle.pending is not None:
            return []
        if inside is not None and self._flies_out(vehicle):
            return []
        if inside is None and not self._is_urgent(vehicle, fix, airspace):
            if vehicle.due != CHANGED:
                vehicle.due = vehicle.due or CHANGED
                vehicle.not_before_s = min(vehicle.not_before_s, at_s)
            return self._raised(vehicle, f"{words}: a new mission is due")
        returns = availability.recalled
        commands = self._evade(vehicle, fix, airspace, conflict, at_s, returns)
        return commands or self._raised(vehicle, words, "severe")

    def _check_again(self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace) -> None:
        """Check the route that the vehicle flies, if anything has changed since the last check."""
        state = self._states[vehicle.name]
        mode = vehicle.availability.mode
        now: tuple[object, ...] = (self._version, mode, state.on_board_id, state.began_at)
        if now == state.checked and not state.conflict:
            return
        state.checked = now
        if mode in GOING_HOME and state.home_clear == self._version:
            state.conflict = ""  # checked when the return was ordered
            return
        parts = self._flown_parts(vehicle, fix)
        state.conflict = airspace.conflict(parts, self._landscape, _position(fix)) or ""

    def _flown_parts(self, vehicle: Vehicle, fix: PositionFix) -> list[Part]:
        """Return the space of the flight that the vehicle has begun, by its mode."""
        state, mode = self._states[vehicle.name], vehicle.availability.mode
        if mode == MISSION:
            if not state.on_board:
                return []
            left = [place for place in state.on_board if place.seq >= state.current_seq]
            return mission_parts(left or state.on_board[-1:], [_position(fix)])
        if mode in GOING_HOME:
            return self._return_parts(vehicle, fix)
        if mode in ("guided", "orbit") and state.orbit is not None:
            return [state.orbit]
        assert state.began_at is not None
        return [self._hold_disc(vehicle, state.began_at)]

    def _hold_disc(self, vehicle: Vehicle, position: Position) -> Part:
        """Return the space of a hold that begins at a position."""
        section = vehicle.section
        reach_m = 2.0 * WIDER * section.loiter_radius_m if section.kind == "plane" else 20.0
        return disc(position[0], position[1], reach_m, position[2], position[2])

    def _return_parts(self, vehicle: Vehicle, fix: PositionFix) -> list[Part]:
        """Return the space of the autopilot's return: straight home, at any altitude it may use."""
        home_altitude_m = self._home_altitude_m(vehicle)
        high_m = max(fix.altitude_m, home_altitude_m + RETURN_ABOVE_M)
        home = (*vehicle.home_m, home_altitude_m)
        routes = [[*entry, home] for entry in self._entries(vehicle, fix, vehicle.home_m)]
        parts = [part for route in routes for part in path_parts(route)]
        return [Part(part.shape, home_altitude_m, high_m) for part in parts]

    def _entries(
        self, vehicle: Vehicle, fix: PositionFix, target_m: tuple[float, float]
    ) -> list[list[Position]]:
        """Return the positions of the possible turns towards a target, each from the vehicle.

        The vehicle first flies on until the mission is on board. In a turn to the rear the side is
        not known. Wind widens a turn.
        """
        section = vehicle.section
        if section.kind != "plane":
            return [[_position(fix)]]
        ahead_m = (fix.east_m_s * STARTS_WITHIN_S, fix.north_m_s * STARTS_WITHIN_S)
        start = (fix.x_m + ahead_m[0], fix.y_m + ahead_m[1])
        wider = 1.0 + vehicle.availability.wind_m_s / section.airspeed_m_s
        turns = turns_towards(
            start, (fix.east_m_s, fix.north_m_s), target_m, section.turn_radius_m * wider**2
        )
        height_m = fix.altitude_m
        return [
            [_position(fix), *((x_m, y_m, height_m) for x_m, y_m in points)] for points in turns
        ]

    def _is_urgent(self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace) -> bool:
        """Return whether a vehicle may enter a closed volume before a new mission is flown."""
        if vehicle.availability.mode != MISSION:
            return True
        speed_m_s = max(math.hypot(fix.east_m_s, fix.north_m_s), vehicle.section.airspeed_m_s)
        near_m = speed_m_s * BEFORE_ENTRY_S + airspace.margins.horizontal_m
        near_m += 2.0 * WIDER * vehicle.section.loiter_radius_m
        parts = self._flown_parts(vehicle, fix)
        high_m = max([fix.altitude_m, *(part.highest_m for part in parts)])
        low_m = min([fix.altitude_m, *(part.lowest_m for part in parts)])
        here = shapely.Point(fix.x_m, fix.y_m)
        return any(
            shapely.dwithin(volume.area_m, here, near_m)
            for volume in airspace.blocked(low_m, high_m)
        )

    def _flies_out(self, vehicle: Vehicle) -> bool:
        """Return whether the vehicle flies the mission by which it leaves a volume."""
        state = self._states[vehicle.name]
        flown = vehicle.availability.mode == MISSION and state.on_board_id == state.evasion_id != 0
        return flown and state.evasion in (Evasion.EXIT, Evasion.AROUND)

    # Evasions ---------------------------------------------------------------------------------

    def _may_move(self, vehicle: Vehicle) -> bool:
        """Return whether the service may move a vehicle out of closed airspace."""
        availability = vehicle.availability
        if not self._moves or availability.fix is None:
            return False
        led = availability.online and availability.airborne and not availability.taken_over
        return led and availability.position_good and vehicle.unconfirmed is None

    def _evade(
        self,
        vehicle: Vehicle,
        fix: PositionFix,
        airspace: Airspace,
        conflict: str,
        at_s: float,
        returns: bool,
    ) -> list[AnyCommand]:
        """Return the commands for a vehicle that would enter a volume, or is inside."""
        state = self._states[vehicle.name]
        state.acts_again_at_s = at_s + ACTS_AGAIN_S
        position = _position(fix)
        inside = airspace.volume_at(position) is not None
        if returns:
            around = self._around_home(vehicle, fix, airspace)
            if around is not None:
                words = f"flies home around {conflict}"
                return [*self._raised(vehicle, words), announce(vehicle, words), around]
        stays = disc(*position[:2], self._reach_m(vehicle), position[2], position[2])
        if not inside and airspace.conflict([stays], self._landscape) is None:
            state.evasion, vehicle.holding = Evasion.HOLD, not vehicle.ordered
            words = f"holds before {conflict}"
            if vehicle.availability.mode == "hold":
                return self._raised(vehicle, words)
            return [*self._raised(vehicle, words), announce(vehicle, words), Hold(vehicle.name)]
        leaves = self._exit(vehicle, fix, airspace)
        if leaves is None:
            return self._raised(vehicle, f"finds no way out of {conflict}", "severe")
        words = f"leaves {conflict}"
        return [*self._raised(vehicle, words), announce(vehicle, words, warning=True), leaves]

    def _reach_m(self, vehicle: Vehicle) -> float:
        section = vehicle.section
        return 2.0 * WIDER * section.loiter_radius_m if section.kind == "plane" else 20.0

    def _exit(self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace) -> UploadMission | None:
        """Return the mission out of the volumes around a vehicle, with a loiter outside."""
        near = airspace.blocked(fix.altitude_m - 1.0, fix.altitude_m + 1.0)
        margin_m = airspace.margins.horizontal_m
        here = shapely.Point(fix.x_m, fix.y_m)
        around = [each for each in near if shapely.dwithin(each.area_m, here, margin_m)]
        others = Airspace(
            tuple(each for each in airspace.volumes if each not in around),
            airspace.margins,
            airspace.max_altitude_agl_m,
        )
        if not around:
            around = near
        beyond_m = WIDER * vehicle.section.loiter_radius_m + 20.0
        blocked = blocked_area(around, margin_m)
        for place in exits_from((fix.x_m, fix.y_m), blocked, beyond_m):
            path = np.array([(fix.x_m, fix.y_m), place])
            items = self._guidance.items(vehicle, path, fix)
            places = mission_places(items, self._landscape, self._home_altitude_m(vehicle))
            parts = mission_parts(places, [_position(fix)])
            if others.conflict(parts, self._landscape) is not None:
                continue
            if airspace.conflict(parts[-1:], self._landscape) is not None:  # the loiter outside
                continue
            return self._upload(vehicle, path, fix, "leave closed airspace", Evasion.EXIT)
        return None

    def _around_home(
        self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace
    ) -> UploadMission | None:
        """Return the mission home around the volumes; the autopilot's return follows near home."""
        straight_home = np.array([(fix.x_m, fix.y_m), vehicle.home_m])
        path = self._detours_around(airspace.volumes, vehicle).around(straight_home)
        if path is None or math.dist(path[-1], vehicle.home_m) > STRAIGHT_HOME_M:
            return None
        items = self._guidance.items(vehicle, path, fix)
        places = mission_places(items, self._landscape, self._home_altitude_m(vehicle))
        outside = airspace.volume_at(_position(fix)) is None
        if outside and self._mission_conflict(vehicle, places, airspace) is not None:
            return None
        return self._upload(vehicle, path, fix, "fly home around closed airspace", Evasion.AROUND)

    def _upload(
        self,
        vehicle: Vehicle,
        path: np.ndarray,
        fix: PositionFix,
        why: str,
        evasion: Evasion,
    ) -> UploadMission:
        """Return the upload of an evasion, which is started as soon as it is on board."""
        state = self._states[vehicle.name]
        vehicle.drop_upload()
        items = self._guidance.items(vehicle, path, fix)
        upload = self._missions.upload(vehicle, path, items, fix, why, keeps_apart=True)
        assert vehicle.pending is not None
        vehicle.pending.evades = True
        vehicle.holding = True
        state.evasion, state.evasion_id = evasion, upload.mission_id
        state.sent[upload.mission_id] = self._places(vehicle, upload)
        return upload

    def _straight_home(
        self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace
    ) -> list[AnyCommand]:
        """Return the order to return, once the straight way home is free."""
        state = self._states[vehicle.name]
        if state.evasion is not Evasion.AROUND or not self._may_move(vehicle):
            return []
        if vehicle.pending is not None or vehicle.availability.mode != MISSION:
            return []
        if fix.at_s < state.acts_again_at_s:
            return []
        parts = self._return_parts(vehicle, fix)
        if airspace.conflict(parts, self._landscape, _position(fix)) is not None:
            return []
        state.home_clear, state.acts_again_at_s = self._version, fix.at_s + ACTS_AGAIN_S
        vehicle.sent_home = vehicle.waits_for_operator = True
        vehicle.end_intentions()
        return [announce(vehicle, "the way home is free"), Return(vehicle.name)]

    # Missions around volumes ------------------------------------------------------------------

    def _led_around(
        self, vehicle: Vehicle, command: UploadMission, airspace: Airspace
    ) -> UploadMission | None:
        """Return the mission on a path around the closed volumes, or None."""
        fix = vehicle.availability.fix
        if not self._moves or fix is None:
            return None
        places = self._places(vehicle, command)
        positions = [place.position for place in places]
        altitudes = [fix.altitude_m, *(position[2] for position in positions)]
        near = airspace.blocked(min(altitudes), max(altitudes))
        path = np.array([position[:2] for position in positions])
        here = np.array([(fix.x_m, fix.y_m)])
        if len(path) == 1 or math.dist(path[0], here[0]) > 1.0:
            path = np.vstack([here, path])
        around = self._detours_around(near, vehicle).around(path)
        for cut_m in CUTS_M if around is not None else ():
            line = shapely.LineString(around)
            if line.length - cut_m < vehicle.section.min_leg_m:
                break
            cut = shapely.get_coordinates(substring(line, 0.0, line.length - cut_m))
            items = self._guidance.items(vehicle, cut, fix)
            changed = UploadMission(
                command.vehicle, command.mission_id, command.why, items, command.keeps_apart
            )
            if self._mission_conflict(vehicle, self._places(vehicle, changed), airspace) is None:
                return changed
        return None

    def _detours_around(self, volumes: Iterable[Volume], vehicle: Vehicle) -> Detours:
        """Return the ways around volumes for a vehicle; computed once for these volumes."""
        volumes = tuple(volumes)
        extra_m = vehicle.section.turn_radius_m / 2.0 if vehicle.section.kind == "plane" else 10.0
        key = (*(volume.name for volume in volumes), f"{extra_m:g}")
        if key not in self._detours:
            area = blocked_area(volumes, self._margins.horizontal_m + extra_m)
            self._detours[key] = Detours(area)
        return self._detours[key]

    def _places(self, vehicle: Vehicle, command: UploadMission) -> tuple[MissionPlace, ...]:
        return mission_places(command.items, self._landscape, self._home_altitude_m(vehicle))

    def _mission_conflict(
        self, vehicle: Vehicle, places: tuple[MissionPlace, ...], airspace: Airspace
    ) -> str | None:
        fix = vehicle.availability.fix
        if fix is None or not vehicle.availability.airborne or not places:
            return airspace.conflict(mission_parts(places), self._landscape)
        first = next(
            (p for p in places if math.dist(p.position[:2], (fix.x_m, fix.y_m)) > 1.0), places[-1]
        )
        parts = mission_parts(places)
        for entry in self._entries(vehicle, fix, first.position[:2]):
            parts += path_parts([*entry, first.position])
        return airspace.conflict(parts, self._landscape, _position(fix))

    def _home_altitude_m(self, vehicle: Vehicle) -> float:
        return float(self._landscape.elevation_at(*vehicle.home_m))

    # Alarms -----------------------------------------------------------------------------------

    def _raised(
        self, vehicle: Vehicle, words: str, severity: Severity = "warning"
    ) -> list[AnyCommand]:
        state = self._states[vehicle.name]
        if words == state.alarm or (state.withheld and state.evasion is not Evasion.NONE):
            return []
        state.alarm = words
        return [RaiseAlarm(vehicle.name, AIRSPACE, words, severity)]

    def _lowered(self, vehicle: Vehicle) -> list[AnyCommand]:
        state = self._states[vehicle.name]
        if not state.alarm or state.withheld or state.evasion is not Evasion.NONE:
            return []
        state.alarm = ""
        return [ClearAlarm(vehicle.name, AIRSPACE)]


def _position(fix: PositionFix) -> Position:
    return fix.x_m, fix.y_m, fix.altitude_m
