"""Keeps all vehicles out of closed airspace: checks each command, and each flight again. Pure.

Each command is checked before it is sent (``checked``), whichever module made it. A mission that
would enter a closed volume is rerouted around it, or not sent. When a volume closes, and at each
position report, the current flight of a vehicle is checked (``watch``). A vehicle that would enter
a volume gets a new mission from its planner; if there is none in time, the vehicle holds short of
the volume. A vehicle inside leaves by the shortest way and holds outside. A return that would be
too low over the ground is replaced by a mission home that clears the ground.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Literal

import shapely

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.airspace.clearance import Airspace, blocked_area
from mission_service.airspace.occupied_space import (
    LOITER_RADIUS_FACTOR,
    MissionPlace,
)
from mission_service.airspace.operational_intent import IntendedPart
from mission_service.airspace.volumes import Volume, require_homes_inside
from mission_service.commands import (
    AnyCommand,
    ClearAlarm,
    ClimbAndHold,
    Hold,
    HoldAt,
    Orbit,
    Return,
    Severity,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import Scenario
from mission_service.core.airspace_evasions import NEAR_HOME_M, Evasions
from mission_service.core.closed_airspace import ClosedAirspace
from mission_service.core.flight_space import FlightSpace, position_of, return_above_m
from mission_service.core.place_checks import PlaceChecks
from mission_service.core.return_ground import CLEAR_AGAIN_M, CLEARANCE_M, ReturnGround
from mission_service.guidance.protocol import Guidance
from mission_service.position_fix import PositionFix
from mission_service.vehicles.airspace_state import AIRSPACE, AirspaceState, Evasion, raised
from mission_service.vehicles.availability import GOING_HOME, LEADS_TO, MISSION
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.vehicle_state import Vehicle, announce

CHANGED = "the airspace has changed"
AT_PLACE_M = 10.0  # a waypoint this near, and farther below, is a descent at the place
BEFORE_ENTRY_S = 25.0  # without a new mission, a vehicle holds this long before it would enter
ACTS_AGAIN_S = 15.0  # longer than an upload
RETURNS_AGAIN_S = 30.0  # longer than the bridge keeps repeating a return
START_AGAIN_S = 10.0
FAILED_WAYS_HOME = 2  # after this many failed uploads, a vehicle climbs and returns straight home


class AirspaceGuard:
    """The closed volumes of a run, and the checks of all vehicles' flights against them."""

    def __init__(
        self,
        scenario: Scenario,
        landscape: Landscape,
        vehicles: Mapping[str, Vehicle],
        missions: MissionsSent,
        guidance: Guidance,
        return_ground: ReturnGround,
    ) -> None:
        """Read the scenario's volumes. Raises ScenarioError for a volume that cannot be used."""
        self._closed = ClosedAirspace(scenario.airspace, landscape)
        require_homes_inside(scenario, landscape)
        self._space = FlightSpace(landscape)
        self._states = {name: AirspaceState() for name in vehicles}
        self._evasions = Evasions(landscape, self._closed, self._space, missions, guidance)
        self._places = PlaceChecks(landscape, self._space, self._evasions, self._states)
        self._landscape = landscape
        self._return_ground = return_ground
        self._vehicles = vehicles
        self._landings_version = 0  # airspace version for which landings are planned
        self._diverts = not scenario.way.prescribed  # a burn's vehicle climbs to its safe height

    @property
    def volumes(self) -> tuple[Volume, ...]:
        """The volumes that are, were or are yet to be closed."""
        return self._closed.volumes

    def intended(self, name: str) -> list[IntendedPart]:
        """Return the space of the rest of a vehicle's flight; empty without a flight."""
        return self._space.of_intent(self._vehicles[name], self._states[name])

    def on_operator(self, event: events.AnyOperatorEvent) -> list[AnyCommand]:
        """Apply an operator's event that closes or opens a volume."""
        match event:
            case events.AirspaceClosed():
                announced = self._announced(self._closed.close(event))
                return [*announced, *self._unreachable(event.at_us / 1e6)]
            case events.AirspaceOpened():
                return self._announced(self._closed.open(event))
            case _:
                return []

    def exit_step(self, name: str) -> Literal["", "sent", "on board", "flown"]:
        """Return the progress of the mission by which a vehicle leaves a volume; "" without one."""
        state = self._states[name]
        if state.evasion is not Evasion.EXIT:
            return ""
        if self._flies_out(self._vehicles[name]):
            return "flown"
        return "on board" if state.on_board_id == state.evasion_id else "sent"

    def end_evasion(self, name: str) -> None:
        """End a vehicle's evasion because an order to the vehicle is executed."""
        state = self._states[name]
        state.evasion, state.checked, state.acts_again_at_s = Evasion.NONE, (), -math.inf
        state.failed_ways_home = 0

    def _announced(self, words: str) -> list[AnyCommand]:
        first = next(iter(self._vehicles.values()), None)
        return [] if first is None else [announce(first, words, warning=True)]

    def _unreachable(self, at_s: float) -> list[AnyCommand]:
        """Raise alarms for vehicles without a link that may be in, or enter, closed airspace."""
        airspace, found = self._closed.at(at_s), []
        for vehicle in self._vehicles.values():
            fix, availability = vehicle.availability.fix, vehicle.availability
            if fix is None or availability.online or not availability.airborne:
                continue
            conflict = _inside(airspace, fix) or self._flight_conflict(vehicle, fix, airspace)
            if conflict is not None:
                words = f"its link is lost: it may be inside {conflict}, or enter it"
                found += self._raised(vehicle, words, "severe")
        return found

    # The check before sending -----------------------------------------------------------------

    def checked(
        self, commands: Iterable[AnyCommand], at_s: float, accepted: bool = False
    ) -> list[AnyCommand]:
        """Return the commands except those that lead into closed airspace.

        A mission is rerouted around closed volumes if possible, unless an operator has ``accepted``
        it. A withheld command raises an alarm.
        """
        airspace = self._closed.at(at_s)
        found: list[AnyCommand] = []
        for command in commands:
            match command:
                case UploadMission():
                    found += self._checked_upload(command, airspace, at_s, accepted)
                case StartMission():
                    found += self._checked_start(command, airspace, at_s)
                case Orbit() | ClimbAndHold() | HoldAt():
                    vehicle = self._vehicles[command.vehicle]
                    found += self._places.checked(vehicle, command, airspace)
                case Return():
                    found += self._checked_return(command, airspace, at_s)
                case _:
                    found.append(command)
        return found

    def _checked_upload(
        self, command: UploadMission, airspace: Airspace, at_s: float, accepted: bool
    ) -> list[AnyCommand]:
        vehicle = self._vehicles[command.vehicle]
        state = self._states[vehicle.name]
        places = self._space.route(vehicle, command.items)
        conflict = None
        if command.mission_id != state.evasion_id:
            conflict = self._conflict(vehicle, places, airspace)
        if conflict is not None:
            led_around = None
            if self._diverts and not (command.lands or accepted):
                led_around = self._evasions.around(vehicle, command, places, airspace)
            if led_around is None:
                vehicle.drop_upload()
                vehicle.not_before_s = at_s + START_AGAIN_S
                state.withheld = True
                words = f"a mission is not sent, because it would enter {conflict}"
                return self._withheld(vehicle, words)
            command, places = led_around
        state.sent[command.mission_id] = (places, self._space.landing(vehicle, command.items))
        state.withheld = False
        return [command]

    def _checked_start(
        self, command: StartMission, airspace: Airspace, at_s: float
    ) -> list[AnyCommand]:
        vehicle = self._vehicles[command.vehicle]
        state = self._states[vehicle.name]
        if not state.on_board:
            return [command]
        fix = vehicle.availability.fix
        if fix is not None and state.on_board_id == state.evasion_id != 0:
            conflict = self._evasions.conflict(vehicle, fix, state, airspace)
            state.acts_again_at_s = state.acts_again_at_s if conflict is None else at_s
        else:
            conflict = self._conflict(vehicle, state.on_board, airspace)
        state.withheld = conflict is not None
        if conflict is None:
            return [command]
        vehicle.end_intentions()
        if vehicle.availability.airborne:
            vehicle.holding, vehicle.due = True, vehicle.due or CHANGED
        else:
            vehicle.start_again_at_s = at_s + START_AGAIN_S
        return self._withheld(vehicle, f"is not started: its mission would enter {conflict}")

    def _checked_return(self, command: Return, airspace: Airspace, at_s: float) -> list[AnyCommand]:
        vehicle = self._vehicles[command.vehicle]
        if not self._may_divert(vehicle):
            return [command]
        fix = vehicle.availability.fix
        assert fix is not None
        conflict = self._return_conflict(vehicle, fix, airspace)
        if conflict is None:
            state = self._states[vehicle.name]
            state.home_clear_version, state.return_sent_s = self._closed.version, at_s
            return [command]
        evades = self._evade(vehicle, fix, airspace, conflict, at_s, returns=True)
        if any(type(each) in LEADS_TO for each in evades):
            return evades
        if _inside(airspace, fix):
            return [*evades, command]  # there is no other way out
        words = f"no return is sent, because it would enter {conflict}"
        return [*evades, announce(vehicle, words, warning=True)]

    def departure_obstacle(self, vehicle: Vehicle, at_s: float) -> str:
        """Return the airspace that a takeoff would enter, at home or on the mission; "" if none."""
        airspace = self._closed.at(at_s)
        if not airspace.is_limited:
            return ""
        home_amsl_m = float(self._landscape.elevation_at(*vehicle.home_m))
        volume = airspace.volume_at((*vehicle.home_m, home_amsl_m + 1.0))
        if volume is not None:
            return volume.words
        on_board = self._states[vehicle.name].on_board if vehicle.flown_line is not None else ()
        return self._conflict(vehicle, on_board, airspace) or ""

    def mission_and_return(
        self, vehicle: Vehicle
    ) -> tuple[tuple[MissionPlace, ...], tuple[float, float]]:
        """Return the positions of the mission on board, and where a return leads (x, y).

        A mission without a takeoff yields no positions.
        """
        takes_off = vehicle.accepted is not None and vehicle.accepted.takes_off
        places = self._states[vehicle.name].on_board if takes_off else ()
        return places, self.return_goal_m(vehicle)

    def return_goal_m(self, vehicle: Vehicle) -> tuple[float, float]:
        """Return the position (x, y) to which a vehicle's return leads directly."""
        return self._space.return_goal_m(vehicle, self._states[vehicle.name])

    def return_obstacle(self, vehicle: Vehicle, fix: PositionFix) -> str:
        """Return why a vehicle cannot fly straight home now; "" if the way is free."""
        conflict = self._return_conflict(vehicle, fix, self._closed.at(fix.at_s))
        return "" if conflict is None else f"its way home would enter {conflict}"

    def mission_obstacle(self, vehicle: Vehicle, items: tuple[MissionItem, ...]) -> str:
        """Return why a vehicle cannot fly a mission now; "" if the mission is free."""
        fix = vehicle.availability.fix
        assert fix is not None
        places = self._space.route(vehicle, items)
        conflict = self._conflict(vehicle, places, self._closed.at(fix.at_s))
        return "" if conflict is None else f"its mission would enter {conflict}"

    def flight_obstacle(self, vehicle: Vehicle, fix: PositionFix) -> str:
        """Return why a vehicle cannot continue its current flight; "" if the flight is free."""
        inside = _inside(self._closed.at(fix.at_s), fix)
        if inside is not None:
            return f"it is inside {inside}"
        conflict = self._states[vehicle.name].conflict
        return f"it would enter {conflict}" if conflict else ""

    # Flights under way ------------------------------------------------------------------------

    def apply(self, event: events.VehicleEvent) -> list[AnyCommand]:
        """Record which mission is on board, and how much of it has been flown.

        Returns an alarm if a vehicle that may be in closed airspace has lost its link.
        """
        self._plan_landings(event.at_us / 1e6)
        state = self._states[event.vehicle]
        match event:
            case events.UploadFinished():
                sent = state.sent.get(event.mission_id)
                if event.outcome == "accepted" and sent is not None:
                    self._put_on_board(state, event.mission_id, *sent)
                    pending = self._vehicles[event.vehicle].pending
                    # The outcome of an upload that the evasion superseded does not end the evasion.
                    awaited = pending is not None and pending.mission_id == event.mission_id
                    if awaited and event.mission_id != state.evasion_id:
                        state.evasion = Evasion.NONE
                if event.mission_id == state.evasion_id:
                    _count_failure(state, event)
            case events.MissionReadBack():
                sent = state.sent.get(event.mission_id)
                if sent is not None:
                    self._put_on_board(state, event.mission_id, *sent)
                elif event.mission_id != state.on_board_id:
                    state.on_board, state.on_board_id, state.landing = (), 0, ()
            case events.ModeChanged():
                state.began_at = None
                if not event.armed or event.mode not in GOING_HOME:
                    state.home_clear_version = -1
                if not event.armed or event.mode in GOING_HOME:
                    state.evasion, state.failed_ways_home = Evasion.NONE, 0
            case events.LinkLost():
                return self._unreachable(event.at_us / 1e6)
            case _:
                pass
        return []

    def _plan_landings(self, at_s: float) -> None:
        """Replan the landings of all vehicles after a change of the airspace."""
        airspace = self._closed.at(at_s)
        if self._landings_version == self._closed.version:
            return
        self._landings_version = self._closed.version
        for vehicle in self._vehicles.values():
            home_amsl_m = float(self._landscape.elevation_at(*vehicle.home_m))
            near = airspace.blocked(home_amsl_m, home_amsl_m + return_above_m(vehicle))
            vehicle.landing.keep_clear_of(blocked_area(near, airspace.margins.horizontal_m))

    def _put_on_board(
        self,
        state: AirspaceState,
        mission_id: int,
        places: tuple[MissionPlace, ...],
        landing: tuple[MissionPlace, ...],
    ) -> None:
        state.on_board_id, state.on_board, state.landing = mission_id, places, landing
        state.sent = {number: sent for number, sent in state.sent.items() if number > mission_id}

    def controls_return(self, name: str) -> bool:
        """Return whether a vehicle that was sent home flies a mission home, or is waiting for one.

        No planner changes this flight.
        """
        vehicle, state = self._vehicles[name], self._states[name]
        return vehicle.sent_home and state.evasion is not Evasion.NONE

    def leads_home(self, name: str) -> bool:
        """Return whether a vehicle flies a mission home, clear of closed airspace and terrain."""
        around = self._states[name].evasion is Evasion.AROUND
        return around and self._flies_out(self._vehicles[name])

    def is_led_home(self, name: str) -> bool:
        """Return whether a vehicle is flying a mission home, or this mission is being sent."""
        return self._vehicles[name].sent_home and self._states[name].evasion is Evasion.AROUND

    def must_be_led_home(self, vehicle: Vehicle) -> bool:
        """Return whether a return would be too low over the ground and a mission replaces it."""
        fix = vehicle.availability.fix
        return fix is not None and self._ground_on_way_home(vehicle, fix) is not None

    def watch(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Check a vehicle's current flight; return commands that keep it out of closed airspace."""
        airspace = self._closed.at(at_s)
        state, fix = self._states[vehicle.name], vehicle.availability.fix
        if fix is None or not (airspace.is_limited or state.alarm or state.evasion_id):
            return []
        availability = vehicle.availability
        if not (availability.airborne and availability.armed):
            self._note_check(state, (self._closed.version,))
            return self._lowered(vehicle) if not availability.armed else []
        if state.began_at is None:
            state.began_at = position_of(fix)
        inside = _inside(airspace, fix)
        self._check_again(vehicle, fix, airspace)
        conflict = inside or state.conflict
        if not conflict:
            return [*self._lowered(vehicle), *self._goes_home(vehicle, fix, airspace)]
        words = f"is inside {conflict}" if inside is not None else f"would enter {conflict}"
        if not self._may_divert(vehicle):
            why = "it is not under the service's control"
            if not self._diverts:
                why = "the service does not divert the vehicle of a burn"
            elif vehicle.landing_state.active:
                why = "it is landing"
            return self._raised(vehicle, f"{words}; {why}")
        if at_s < state.acts_again_at_s or _waits_for_upload(vehicle, inside is not None):
            return []
        if inside is not None and self._ends_outside(vehicle, airspace):
            return []
        if inside is None and not self._is_urgent(vehicle, fix, airspace):
            if vehicle.due != CHANGED:
                vehicle.due = vehicle.due or CHANGED
                vehicle.not_before_s = min(vehicle.not_before_s, at_s)
            return self._raised(vehicle, f"{words}: a new mission is needed")
        returns = availability.recalled or self.controls_return(vehicle.name)
        commands = self._evade(vehicle, fix, airspace, conflict, at_s, returns)
        return commands or self._raised(vehicle, words, "severe")

    def _check_again(self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace) -> None:
        """Check the vehicle's route if anything has changed since the last check."""
        state = self._states[vehicle.name]
        mode = vehicle.availability.mode
        now: tuple[object, ...] = (self._closed.version, mode, state.on_board_id, state.began_at)
        is_same = self._note_check(state, now)
        if is_same and not state.conflict:
            return
        if mode in GOING_HOME and state.home_clear_version == self._closed.version:
            state.conflict = ""  # checked when the return was ordered
            return
        state.conflict = self._flight_conflict(vehicle, fix, airspace) or ""

    @staticmethod
    def _note_check(state: AirspaceState, now: tuple[object, ...]) -> bool:
        """Record the inputs of a check; return whether those of the last check were the same.

        If they were not, no command counts as withheld any longer.
        """
        same = now == state.checked
        state.checked, state.withheld = now, state.withheld and same
        return same

    def _is_urgent(self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace) -> bool:
        """Return whether a vehicle may enter a closed volume before it flies a new mission."""
        if vehicle.availability.mode != MISSION:
            return True
        state = self._states[vehicle.name]
        speed_m_s = max(math.hypot(fix.east_m_s, fix.north_m_s), vehicle.section.airspeed_m_s)
        near_m = speed_m_s * BEFORE_ENTRY_S + airspace.margins.horizontal_m
        near_m += 2.0 * LOITER_RADIUS_FACTOR * vehicle.section.loiter_radius_m
        parts = self._space.of_flight(vehicle, fix, state)
        high_m = max([fix.altitude_m, *(part.highest_m for part in parts)])
        low_m = min([fix.altitude_m, *(part.lowest_m for part in parts)])
        here = shapely.Point(fix.x_m, fix.y_m)
        return any(
            shapely.dwithin(volume.area_m, here, near_m)
            for volume in airspace.blocked(low_m, high_m)
        )

    def _ends_outside(self, vehicle: Vehicle, airspace: Airspace) -> bool:
        """Return whether the vehicle is flying out of a volume to a position that is still free."""
        route, fix = self._states[vehicle.name].on_board, vehicle.availability.fix
        ends = bool(route) and airspace.volume_at(route[-1].position) is None
        if not ends or fix is None or not self._flies_out(vehicle):
            return False
        return vehicle.section.winged or not self._descends_inside(vehicle, fix, airspace)

    def _descends_inside(self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace) -> bool:
        """Return whether a multirotor descends at its place, and will not soon be below the volume.

        A mission home that was planned before the volume closed may begin with such a descent.
        """
        route = self._states[vehicle.name].on_board
        target = next((each for each in route if each.seq >= vehicle.current_seq), route[-1])
        x_m, y_m, down_to_m = target.position
        here = math.dist((x_m, y_m), (fix.x_m, fix.y_m)) < AT_PLACE_M
        if not here or down_to_m > fix.altitude_m - AT_PLACE_M:
            return False
        inside = airspace.volume_at(position_of(fix))
        return inside is None or max(down_to_m, fix.altitude_m - AT_PLACE_M) >= inside.floor_m

    def _flies_out(self, vehicle: Vehicle) -> bool:
        """Return whether the vehicle is flying the mission by which it leaves a volume."""
        state = self._states[vehicle.name]
        flown = vehicle.availability.mode == MISSION and state.on_board_id == state.evasion_id != 0
        return flown and state.evasion in (Evasion.EXIT, Evasion.AROUND)

    # Evasions ---------------------------------------------------------------------------------

    def _may_divert(self, vehicle: Vehicle) -> bool:
        """Return whether the service may send a vehicle around or out of closed airspace."""
        availability = vehicle.availability
        if not self._diverts or availability.fix is None or vehicle.landing_state.active:
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
        """Return the commands for a vehicle that would enter a volume or is inside one."""
        state = self._states[vehicle.name]
        state.acts_again_at_s = at_s + ACTS_AGAIN_S
        if returns:
            around = self._evasions.way_home(vehicle, fix, airspace, state)
            if around is not None:
                words = f"flies home around {conflict}"
                return [*self._raised(vehicle, words), announce(vehicle, words), around]
        stays = self._space.of_hold(vehicle, position_of(fix))
        if not _inside(airspace, fix) and airspace.conflict([stays], self._landscape) is None:
            vehicle.drop_upload()
            state.evasion, vehicle.holding = Evasion.HOLD, not (vehicle.ordered or returns)
            words = f"holds short of {conflict}"
            if vehicle.availability.mode == "hold":
                return self._raised(vehicle, words)
            return [*self._raised(vehicle, words), announce(vehicle, words), Hold(vehicle.name)]
        in_mission = vehicle.availability.mode == MISSION
        if returns and in_mission and self._flight_conflict(vehicle, fix, airspace) is None:
            state.evasion = Evasion.HOLD  # this flight is free; a hold might not be
            return self._raised(
                vehicle, f"continues its mission: every way home would enter {conflict}"
            )
        leaves = self._evasions.way_out(vehicle, fix, airspace, state)
        if leaves is None:
            return self._raised(vehicle, f"has no clear route out of {conflict}", "severe")
        words = f"leaves {conflict}"
        return [*self._raised(vehicle, words), announce(vehicle, words, warning=True), leaves]

    def _goes_home(
        self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace
    ) -> list[AnyCommand]:
        """Return the order to return once the straight way home is free.

        A mission home, which flies high above the ground, ends only where the return has more than
        the least clearance. A vehicle that was sent home but is not flying there, because no way
        was free or its mission could not be uploaded or started, also gets a mission around the
        volumes as soon as there is one.
        """
        state, at_s = self._states[vehicle.name], fix.at_s
        flies = self.leads_home(vehicle.name)
        waits = vehicle.sent_home and state.evasion is not Evasion.NONE and not flies
        if not (waits or flies) or vehicle.start_under_way or not self._may_divert(vehicle):
            return []
        again_at_s = max(state.acts_again_at_s, state.return_sent_s + RETURNS_AGAIN_S)
        if vehicle.pending is not None or at_s < again_at_s:
            return []
        clearance_m = CLEAR_AGAIN_M if flies else CLEARANCE_M
        if self._return_conflict(vehicle, fix, airspace, clearance_m) is None:
            state.home_clear_version = self._closed.version
            state.acts_again_at_s = at_s + ACTS_AGAIN_S
            vehicle.sent_home = vehicle.waits_for_operator = True
            vehicle.end_intentions()
            return [announce(vehicle, "the way home is clear"), Return(vehicle.name)]
        around = self._evasions.way_home(vehicle, fix, airspace, state) if waits else None
        if around is None:
            return []
        state.acts_again_at_s = at_s + ACTS_AGAIN_S
        words = "flies home clear of closed airspace and terrain"
        climbs = self._climbs_to_return(vehicle, fix, airspace)
        return [*climbs, announce(vehicle, words), around]

    def _climbs_to_return(
        self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace
    ) -> list[AnyCommand]:
        """Return the climb for a vehicle that accepts no mission home over the ground.

        A return follows when the climb is complete. If a climb would not help or would enter closed
        airspace, an alarm is raised.
        """
        if self._states[vehicle.name].failed_ways_home < FAILED_WAYS_HOME:
            return []
        if self._closed_on_way_home(vehicle, fix, airspace):
            return []
        climb = self._return_ground.climb(vehicle, fix, self.return_goal_m(vehicle))
        words = "does not accept a mission home that is clear of terrain"
        if climb is None or self._enters_in_climb(vehicle, fix, climb, airspace):
            return self._raised(vehicle, f"{words}, and its return would be too low", "severe")
        words += f": climbs to {climb.altitude_amsl_m:.0f} m AMSL to return"
        return [*self._raised(vehicle, words, "severe"), climb]

    def _enters_in_climb(
        self, vehicle: Vehicle, fix: PositionFix, climb: HoldAt, airspace: Airspace
    ) -> bool:
        """Return whether a climb to a hold would enter closed airspace."""
        column = replace(self._space.of_hold_at(vehicle, climb), lowest_m=fix.altitude_m)
        return airspace.conflict([column], self._landscape, position_of(fix)) is not None

    def _conflict(
        self, vehicle: Vehicle, places: tuple[MissionPlace, ...], airspace: Airspace
    ) -> str | None:
        """Return the airspace that a mission would enter if it began now."""
        parts = self._space.of_mission(vehicle, places)
        return airspace.conflict(parts, self._landscape, self._space.start_of(vehicle))

    def _flight_conflict(
        self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace
    ) -> str | None:
        """Return the airspace that the current flight would enter."""
        if vehicle.availability.mode in GOING_HOME:
            return self._closed_on_way_home(vehicle, fix, airspace)
        parts = self._space.of_flight(vehicle, fix, self._states[vehicle.name])
        return airspace.conflict(parts, self._landscape, position_of(fix))

    def _return_conflict(
        self,
        vehicle: Vehicle,
        fix: PositionFix,
        airspace: Airspace,
        clearance_m: float = CLEARANCE_M,
    ) -> str | None:
        """Return, in words, the airspace that a return would enter if it began now, or None.

        This is closed airspace, or airspace less than ``clearance_m`` above the ground.
        """
        closed = self._closed_on_way_home(vehicle, fix, airspace)
        return closed or self._ground_on_way_home(vehicle, fix, clearance_m)

    def _closed_on_way_home(
        self, vehicle: Vehicle, fix: PositionFix, airspace: Airspace
    ) -> str | None:
        """Return, in words, the closed volume that a return would enter, or None.

        A return does not follow the terrain, so the limit above ground does not apply.
        """
        parts = self._space.of_return(vehicle, fix, self._states[vehicle.name])
        volumes = replace(airspace, max_altitude_agl_m=None)
        return volumes.conflict(parts, self._landscape, position_of(fix))

    def _ground_on_way_home(
        self, vehicle: Vehicle, fix: PositionFix, clearance_m: float = CLEARANCE_M
    ) -> str | None:
        """Return, in words, the airspace close above ground on the straight way home, or None.

        Near home no comparison is made, so that a mission home always ends in a return.
        """
        goal_m = self.return_goal_m(vehicle)
        near_m = math.dist((fix.x_m, fix.y_m), goal_m)
        if near_m <= NEAR_HOME_M or self._space.start_of(vehicle) is None:
            return None
        return self._return_ground.obstacle(vehicle, fix, goal_m, clearance_m)

    # Alarms -----------------------------------------------------------------------------------

    def _raised(
        self, vehicle: Vehicle, words: str, severity: Severity = "warning"
    ) -> list[AnyCommand]:
        return raised(vehicle, self._states[vehicle.name], words, severity)

    def _withheld(self, vehicle: Vehicle, words: str) -> list[AnyCommand]:
        """Raise the alarm about a command that is not sent, unless an evasion is under way."""
        evades = self._states[vehicle.name].evasion is not Evasion.NONE
        return [] if evades else self._raised(vehicle, words)

    def _lowered(self, vehicle: Vehicle) -> list[AnyCommand]:
        state = self._states[vehicle.name]
        # A vehicle held by an operator stays where it is after an evasion.
        evades = state.evasion is not Evasion.NONE and not vehicle.ordered
        if not state.alarm or state.withheld or evades:
            return []
        state.alarm = ""
        return [ClearAlarm(vehicle.name, AIRSPACE)]


def _count_failure(state: AirspaceState, event: events.UploadFinished) -> None:
    """Count the consecutive missions home that the autopilot has not accepted."""
    if event.outcome == "accepted":
        state.failed_ways_home = 0
    elif event.outcome != "cancelled" and state.evasion is Evasion.AROUND:
        state.failed_ways_home += 1


def _inside(airspace: Airspace, fix: PositionFix) -> str | None:
    """Return the closed volume that contains a vehicle, in words, or None."""
    volume = airspace.volume_at(position_of(fix))
    return None if volume is None else volume.words


def _waits_for_upload(vehicle: Vehicle, inside: bool) -> bool:
    """Return whether an upload must end first; a mission out of a volume replaces others."""
    pending = vehicle.pending
    return pending is not None and (pending.evades or not inside)
