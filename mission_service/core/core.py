"""Converts events to commands: a state machine without a clock, network or randomness.

Simulation, live flight, replay and tests run the same core on events from different sources.
"""

from collections.abc import Callable
from typing import ClassVar, NamedTuple

from autopilot_bridge.stacks.stacks import STACKS
from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.commands import (
    Announce,
    AnyCommand,
    Hold,
    HoldAt,
    Land,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import Scenario
from mission_service.core.airspace_guard import AirspaceGuard
from mission_service.core.airspeed_watch import airspeed_compared
from mission_service.core.autopilot_reports import (
    back_under_control,
    remote_id_watched,
    reported,
    taken_over,
    texts_over,
)
from mission_service.core.clearing_airspace.airspace_clearing import AirspaceClearing
from mission_service.core.clearing_airspace.clearing_predictions import ClearingPredictions
from mission_service.core.continuation import Continuation
from mission_service.core.decision_engine import DecisionEngine
from mission_service.core.energy_watch import EnergyWatch
from mission_service.core.hold_height import raised_hold
from mission_service.core.landings import Landings
from mission_service.core.lost_link import reaction_compared
from mission_service.core.mission_starts import WAITS, MissionStarts
from mission_service.core.operator_orders import OperatorOrders, hold_again
from mission_service.core.other_aircraft import OtherAircraft
from mission_service.core.preflight import Preflight
from mission_service.core.reliefs import Reliefs
from mission_service.core.request_results import RequestResults
from mission_service.core.return_ground import ReturnGround
from mission_service.core.return_parameters import return_read
from mission_service.guidance.protocol import Decision, Guidance
from mission_service.guidance.registry import way_of
from mission_service.guidance.way_of_flying import WayOfFlying
from mission_service.missions.landing import Landing
from mission_service.position_fix import PositionFix
from mission_service.vehicles.approvals import MissionApprovals
from mission_service.vehicles.availability import (
    GOING_HOME,
    LEADS_TO,
    MISSION,
    VehicleAvailability,
    named_mode,
)
from mission_service.vehicles.endurance import must_return
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.reconciliation import unconfirmed
from mission_service.vehicles.traffic import TrafficManager
from mission_service.vehicles.vehicle_state import (
    Vehicle,
    announce,
)

STACK_NAMES = frozenset(each.name for each in STACKS)
BEFORE_MODES = ("", "initialising")  # modes before the first report, and while ArduPlane boots


class Core:
    """The state machine that applies events to the vehicles and returns the resulting commands."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        self.scenario = scenario
        self.landscape = landscape
        self._missions = MissionsSent()
        self._approvals: MissionApprovals | None = None
        if scenario.mission.approval == "each":
            settings = scenario.mission
            self._approvals = MissionApprovals(settings.path_tolerance_m, settings.horizon_m)
        availability = {section.name: VehicleAvailability() for section in scenario.vehicles}
        self.traffic = TrafficManager(scenario, landscape, availability)
        self.guidance: Guidance = self._way.guidance(
            scenario, landscape, self.traffic, self._missions
        )
        self.decision_engine = DecisionEngine(
            scenario, landscape, self.guidance.planners, availability
        )
        self.vehicles = {
            section.name: Vehicle(
                section,
                availability[section.name],
                landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg),
                Landing(scenario, section, landscape),
                waits_for_operator=scenario.preflight.signoff == "each",
            )
            for section in scenario.flown
        }
        self._energy = EnergyWatch(scenario, landscape)
        self.return_ground = ReturnGround(landscape, self._energy)
        self.airspace = AirspaceGuard(
            scenario,
            landscape,
            self.vehicles,
            self._missions,
            self.guidance,
            self.return_ground,
        )
        self._other_aircraft: OtherAircraft | None = None
        if scenario.surveillance is not None:
            self._other_aircraft = OtherAircraft(scenario.surveillance, scenario, landscape)
        self._preflight = Preflight(
            scenario,
            landscape,
            self._energy,
            self.airspace,
            self.return_ground,
            self._other_aircraft,
        )
        self._starts = MissionStarts(scenario, self.traffic, self.guidance, self._preflight)
        self._landings = Landings(
            landscape,
            self.decision_engine,
            self.vehicles,
            self.traffic,
            self._missions,
            self.airspace,
        )
        self.clearing = AirspaceClearing(
            self.vehicles,
            self._landings,
            self.airspace,
            ClearingPredictions(landscape, self.vehicles, self._landings, self._energy),
            self._way.prescribed,
        )
        self._results = RequestResults(self.guidance, self._starts, self._landings)
        self._continuation = Continuation(
            self._way.prescribed,
            self.decision_engine,
            self.guidance,
            self._results,
            self._landings,
        )
        self._orders = OperatorOrders(
            scenario,
            self.decision_engine,
            self.vehicles,
            self._start_by_order,
            self._approvals,
            self._landings,
            self.airspace,
            self._preflight,
        )

        self._reliefs: Reliefs | None = None
        if scenario.relief is not None:
            self._reliefs = Reliefs(
                scenario.relief, landscape, self.vehicles, self.guidance, self._energy
            )

    @property
    def _way(self) -> WayOfFlying:
        return way_of(self.scenario)

    def handle(self, event: events.AnyEvent) -> list[AnyCommand]:
        """Apply one event and return the commands that it causes, in order.

        Raises KeyError for a vehicle that is not in the scenario.
        """
        at_s = event.at_us / 1e6
        if self._other_aircraft is not None:
            self._other_aircraft.on_event(event)
        accepted = isinstance(event, events.MissionAccepted)
        commands = [self._raised(command) for command in self._handle(event)]
        commands = self.airspace.checked(commands, at_s, accepted)
        if self._approvals is not None and not accepted:
            commands = self._approvals.held_back(commands, self.vehicles, at_s)
        commands = [command for command in commands if not self._withheld(command)]
        commands += self.guidance.further_commands(event, commands, self.vehicles)
        for command in commands:
            self.decision_engine.on_command(command, at_s)
            if isinstance(command, StartMission):
                self.vehicles[command.vehicle].start_under_way = True
            elif isinstance(command, Hold | HoldAt):
                self.vehicles[command.vehicle].hold_under_way_s = at_s
            if self._other_aircraft is not None:
                self._other_aircraft.on_command(command)
        return commands

    def _raised(self, command: AnyCommand) -> AnyCommand:
        """Return the command, or a higher hold if the ground around the hold is too high."""
        if not isinstance(command, Hold):
            return command
        return raised_hold(command, self.vehicles[command.vehicle], self.landscape)

    def _withheld(self, command: AnyCommand) -> bool:
        """Return whether a command must not be sent, independently of the callers' checks.

        A command is withheld if it would change a mode that the autopilot or the pilot selected, or
        if it would start a vehicle without an operator's order. A command that an operator
        confirmed is sent. A start ordered in the air is withheld from a vehicle that has landed
        since, as is a hold that would make it take off again. No vehicle takes off while the
        airspace is being cleared.
        """
        if type(command) not in LEADS_TO:
            return False
        vehicle = self.vehicles[command.vehicle]
        availability, uploads = vehicle.availability, isinstance(command, UploadMission)
        if availability.taken_over and (availability.airborne or not uploads):
            if uploads:
                vehicle.drop_upload()
            return True
        if isinstance(command, Land) and not availability.airborne:
            return True
        stays_down = self.clearing.state.in_force and not availability.airborne
        if isinstance(command, StartMission) and (availability.landed or stays_down):
            vehicle.end_intentions()
            vehicle.waits_for_operator = True
            return True
        if availability.touched_down and not uploads:
            return True
        on_ground = isinstance(command, StartMission) and not availability.airborne
        return on_ground and (vehicle.waits_for_operator or self._stands_by(vehicle))

    def _stands_by(self, vehicle: Vehicle) -> bool:
        return self._reliefs is not None and self._reliefs.stays_on_ground(vehicle)

    def _start_by_order(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        """Start the mission on board; a vehicle on standby takes off when its relief is due."""
        if self._stands_by(vehicle):
            return [announce(vehicle, "stands by: it takes off when its relief is due")]
        return self._starts.start_mission(vehicle, at_s)

    def _handle(self, event: events.AnyEvent) -> list[AnyCommand]:
        if isinstance(event, events.OperatorEvent):
            return self._on_operator(event)
        vehicle = self.vehicles[event.vehicle]
        availability = vehicle.availability
        was = _Was(
            availability.airborne,
            availability.recalled,
            availability.taken_over,
            availability.armed,
            availability.mode,
            availability.estimator_healthy,
        )
        decision = self.decision_engine.apply(event)
        unreachable = self.airspace.apply(event)
        commands = [*unreachable, *self._answer(vehicle, event, decision, was)]
        commands += self.guidance.on_vehicle(vehicle, event)
        commands = self._kept_out(vehicle, event, commands)
        commands += self._preflight.watch(vehicle, event)
        return [*commands, *self.clearing.on_vehicle(event)]

    def _kept_out(
        self, vehicle: Vehicle, event: events.VehicleEvent, commands: list[AnyCommand]
    ) -> list[AnyCommand]:
        """Add the commands that keep a vehicle out of closed airspace; they replace others."""
        if not isinstance(event, events.Telemetry):
            return commands
        evades = self.airspace.watch(vehicle, event.at_us / 1e6)
        if any(type(command) in LEADS_TO for command in evades):
            commands = [command for command in commands if type(command) not in LEADS_TO]
        return [*commands, *evades]

    def _on_operator(self, event: events.AnyOperatorEvent) -> list[AnyCommand]:
        refused = self.clearing.refused(event)
        if refused:
            return refused
        commands = [*self.airspace.on_operator(event), *self._requested(event)]
        return [*commands, *self.clearing.on_operator(event)]

    def _requested(self, event: events.AnyOperatorEvent) -> list[AnyCommand]:
        if self._reliefs is not None:
            self._reliefs.record_request(event)
        if isinstance(event, events.Resumed):  # after a restart, links and commands are unconfirmed
            self.decision_engine.apply_restart(event)
            for vehicle in self.vehicles.values():
                if self._approvals is not None and vehicle.proposed is not None:
                    vehicle.due = vehicle.due or vehicle.proposed.due
                    self._approvals.withdraw(vehicle, "the service was restarted")
                unconfirmed(vehicle)
                vehicle.end_sign_off()
        if self._way.prescribed:
            return self.guidance.on_operator(event)
        return [*self._orders.handle(event), *self.guidance.on_operator(event)]

    def _answer(
        self, vehicle: Vehicle, event: events.VehicleEvent, decision: Decision | None, was: "_Was"
    ) -> list[AnyCommand]:
        match event:
            case events.Telemetry():
                led_home = self.airspace.leads_home(vehicle.name)
                watched = self._energy.moved(vehicle, event, was.airborne, led_home)
                goal_m = self.airspace.return_goal_m(vehicle)
                watched += self.return_ground.at_position(vehicle, event, goal_m)
                return [*watched, *self._telemetry(vehicle, event.at_us / 1e6, decision, was)]
            case events.BatteryUpdated():
                self._energy.battery(vehicle, event)
                return []
            case events.ModeChanged():
                return self._mode_changed(vehicle, event, was)
            case events.VehicleRebooted():
                return self._rebooted(vehicle, event.at_us / 1e6, was)
            case events.EstimatorStatusChanged() if not (was.airborne or was.estimator_healthy):
                # During the estimator's start its problems change often: the alarm suffices.
                return [each for each in reported(vehicle, event) if not isinstance(each, Announce)]
            case (
                events.SystemStateChanged()
                | events.FenceStatusChanged()
                | events.LandedStateChanged()
            ):
                commands = reported(vehicle, event)
                # The failsafe or landing reported by this event ended the commanded mode.
                if vehicle.availability.taken_over and not was.taken_over:
                    commands += self._taken_over(vehicle)
                return commands
            case events.UploadFinished():
                return self._results.upload_finished(vehicle, event)
            case events.CommandFinished():
                return self._results.command_finished(vehicle, event)
            case events.MissionReadBack():
                return self._continuation.read_back(vehicle, event)
            case _:
                answer = self._ANSWERS.get(type(event))
                return reported(vehicle, event) if answer is None else answer(self, vehicle, event)

    def _telemetry(
        self, vehicle: Vehicle, at_s: float, decision: Decision | None, was: "_Was"
    ) -> list[AnyCommand]:
        commands = texts_over(vehicle, at_s) + airspeed_compared(vehicle, at_s)
        commands += remote_id_watched(vehicle, self.scenario.preflight.remote_id, at_s)
        if vehicle.availability.airborne and not was.airborne:
            vehicle.start_again_at_s = None  # the takeoff was the start that was due
            commands += self._found_in_air(vehicle, was)
        if self._reliefs is not None and at_s >= self.scenario.deploy_at_s:
            commands += self._reliefs.moved(vehicle, at_s)
        return [*commands, *self._moved(vehicle, at_s, decision)]

    def _connected(self, vehicle: Vehicle, event: events.VehicleConnected) -> list[AnyCommand]:
        vehicle.atomic_upload = event.atomic_upload
        stack = event.stack.partition(" ")[0]
        vehicle.reported_stack = stack if stack in STACK_NAMES else ""
        return [announce(vehicle, f"connected ({event.stack})")]

    def _link_lost(self, vehicle: Vehicle, event: events.LinkLost) -> list[AnyCommand]:
        then = "the mission on board ends in a loiter"
        left = vehicle.availability.taken_over or vehicle.availability.recalled
        if left or not self.guidance.in_mission(vehicle.name):
            then = "it continues to circle, or its autopilot executes a failsafe"
        if vehicle.lost_link:
            then += f"; by its parameters it {vehicle.lost_link}"
        words = f"no heartbeat for {event.silent_s:.1f} s: link lost; {then}"
        return [announce(vehicle, words, warning=True)]

    def _link_restored(self, vehicle: Vehicle, event: events.LinkRestored) -> list[AnyCommand]:
        vehicle.flown_line = None  # a new mission is due, because the front has moved
        return [announce(vehicle, "link restored")]

    def _airspeed_measured(
        self, vehicle: Vehicle, event: events.AirspeedMeasured
    ) -> list[AnyCommand]:
        vehicle.airspeed_m_s = event.airspeed_m_s
        return []

    def _air_data_measured(
        self, vehicle: Vehicle, event: events.AirDataMeasured
    ) -> list[AnyCommand]:
        self._energy.air_measured(vehicle, event)
        return []

    def _aircraft_reported(
        self, vehicle: Vehicle, event: events.AircraftReported
    ) -> list[AnyCommand]:
        aircraft = self._other_aircraft
        if aircraft is None:
            return []
        return aircraft.reported(vehicle, event, self.airspace.controls_return(vehicle.name))

    def _progressed(self, vehicle: Vehicle, event: events.MissionProgress) -> list[AnyCommand]:
        vehicle.current_seq = event.current_seq
        last_seq = 1 if vehicle.section.kind == "vtol" else 0  # of the items of a takeoff
        vehicle.takes_off &= event.current_seq <= last_seq
        self._landings.progressed(vehicle, event)
        return []

    def _parameters_reported(
        self, vehicle: Vehicle, event: events.ParametersReported
    ) -> list[AnyCommand]:
        return [*reaction_compared(vehicle, event), *return_read(vehicle, event)]

    def _moved(self, vehicle: Vehicle, at_s: float, decision: Decision | None) -> list[AnyCommand]:
        availability = vehicle.availability
        fix = availability.fix
        if fix is None or not availability.online or at_s < self.scenario.deploy_at_s:
            return []
        if availability.taken_over and availability.airborne:
            return []
        if vehicle.landing_state.active or availability.recalled:
            landing = self._landings.moved(vehicle, fix)
            return [*landing, *self._return_again(vehicle, at_s)]
        if vehicle.ordered == "hold":
            return hold_again(vehicle, at_s)
        if self._takes_no_decision(vehicle) or self.airspace.controls_return(vehicle.name):
            return []
        commands: list[AnyCommand] = []
        if self._approvals is not None:
            commands += self._approvals.lapsed(vehicle, at_s)
        commands += self.guidance.announcements(vehicle, at_s, decision)
        if self._stands_by(vehicle):
            return commands
        if not vehicle.deployed:
            return [*commands, *self._deploy(vehicle, fix)]
        if not availability.airborne:
            return [*commands, *self._on_the_ground(vehicle, fix)]
        if self._starts.is_due(vehicle, at_s):
            return [*commands, *self._starts.start_mission(vehicle, at_s)]
        if must_return(vehicle):  # also during an upload, which may take minutes on a lossy link
            led_home = self.guidance.way_home(vehicle, fix)
            return [*commands, *(self._send_home(vehicle, fix) if led_home is None else led_home)]
        return [*commands, *self.guidance.lead(vehicle, fix)]

    def _takes_no_decision(self, vehicle: Vehicle) -> bool:
        """Return whether decisions for a vehicle are suspended, apart from operators' orders."""
        availability = vehicle.availability
        if vehicle.unconfirmed is not None and not self._way.prescribed:
            return True  # wait until its mission is read back
        if availability.in_failsafe and availability.mode == MISSION:
            return True  # ArduPlane may be landing by its mission, and a new one would end that
        return not availability.position_good  # decisions are not based on dead reckoning

    def validate_state(self) -> None:
        """Check the invariants between two events; raises AssertionError. For tests."""
        for vehicle in self.vehicles.values():
            vehicle.validate_state()
        if self._approvals is not None:
            self._approvals.validate_state(self.vehicles)
        if self._reliefs is not None:
            self._reliefs.task.validate_state()

    # Flight to the fire and home --------------------------------------------------------------

    def _on_the_ground(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Repeat a refused start, or upload a mission to a vehicle that has none."""
        if self._starts.is_due(vehicle, fix.at_s):
            return self._starts.start_mission(vehicle, fix.at_s)
        idle = not vehicle.awaits_mission and vehicle.flown_line is None
        if idle and fix.at_s >= vehicle.not_before_s:
            return self._deploy(vehicle, fix)
        return []

    def _deploy(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Upload the mission to the fire as soon as the guidance provides a path."""
        path = self.guidance.first_path(vehicle, fix)
        if path is None:
            return []
        vehicle.deployed = True
        items = self.guidance.items(vehicle, path, fix)
        return [self._missions.upload(vehicle, path, items, fix, "fly to the fire")]

    def _send_home(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        self.decision_engine.recall(vehicle.name, fix.at_s)
        vehicle.end_intentions()
        vehicle.sent_home = vehicle.waits_for_operator = True
        flown_min = (fix.at_s - vehicle.availability.took_off_at_s) / 60.0
        found = vehicle.energy.estimate
        why = "its energy is needed for the flight home" if found is None else found.words
        words = f"sent home after {flown_min:.0f} min in the air: {why}"
        return [announce(vehicle, words), Return(vehicle.name)]

    def _return_again(self, vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
        again_at_s = vehicle.return_again_at_s
        if again_at_s is None or at_s < again_at_s or not vehicle.availability.airborne:
            return []
        vehicle.return_again_at_s = None
        return [Return(vehicle.name)]

    def _mode_changed(
        self, vehicle: Vehicle, event: events.ModeChanged, was: "_Was"
    ) -> list[AnyCommand]:
        availability, vehicle.mode = vehicle.availability, event.mode
        if was.armed and not event.armed:
            return self._disarmed(vehicle, was.airborne)
        if event.mode == MISSION and event.armed:
            vehicle.start_again_at_s = None
        if availability.taken_over and (availability.airborne or vehicle.started):
            return self._taken_over(vehicle)
        if vehicle.start_is_pending and self._was_overridden(vehicle, was):
            return self._start_ended(vehicle)
        if availability.recalled and not was.recalled:
            return [_announce_return(vehicle, event.mode)]
        if event.mode == MISSION and was.mode != MISSION:
            found = self._landings.found_flying(vehicle, event.at_us / 1e6)
            if found:
                return [*back_under_control(vehicle), *found]
        if vehicle.landing_state.active:
            return back_under_control(vehicle) if was.taken_over else []
        if (was.recalled or was.taken_over) and event.mode == MISSION:
            vehicle.flown_line = None
            if was.mode in GOING_HOME:
                # The pilot has ended the return; when energy runs low, the vehicle is sent home
                # again.
                energy = vehicle.energy.estimate
                time_up = energy is not None and energy.time_on_task_s <= 0.0
                vehicle.sent_home &= time_up or self.airspace.controls_return(vehicle.name)
            return [*back_under_control(vehicle), announce(vehicle, "back in its mission")]
        return back_under_control(vehicle) if was.taken_over else []

    def _found_in_air(self, vehicle: Vehicle, was: "_Was") -> list[AnyCommand]:
        """Handle the mode of a vehicle after its takeoff or its first report in the air."""
        if vehicle.availability.taken_over:
            return self._taken_over(vehicle)
        if vehicle.availability.recalled and not was.recalled:
            return [_announce_return(vehicle, vehicle.availability.mode)]
        return []

    def _taken_over(self, vehicle: Vehicle) -> list[AnyCommand]:
        why = f"{named_mode(vehicle.availability.mode)} was not ordered"
        return [*taken_over(vehicle), *self._end_intentions(vehicle, why)]

    def _end_intentions(self, vehicle: Vehicle, why: str) -> list[AnyCommand]:
        """Cancel the vehicle's pending commands, its landing and its proposed mission."""
        vehicle.end_intentions()
        ended = self._landings.end(vehicle)
        return (
            ended if self._approvals is None else [*ended, *self._approvals.withdraw(vehicle, why)]
        )

    def _was_overridden(self, vehicle: Vehicle, was: "_Was") -> bool:
        """Return whether the autopilot or the pilot changed the mode of a vehicle on the ground."""
        mode, booted = vehicle.availability.mode, was.mode not in BEFORE_MODES
        changed = booted and mode != was.mode and mode not in LEADS_TO[StartMission]
        return changed and not vehicle.availability.airborne

    def _start_ended(self, vehicle: Vehicle) -> list[AnyCommand]:
        """End a start that has not taken effect; the next start needs an order or an approval."""
        vehicle.waits_for_operator |= not self._way.prescribed
        why = f"{named_mode(vehicle.availability.mode)} was not ordered"
        chosen = f"start cancelled: {why}, but selected by its autopilot or pilot"
        words = announce(vehicle, f"{chosen}; {WAITS}", warning=True)
        return [*self._end_intentions(vehicle, why), words]

    def _disarmed(self, vehicle: Vehicle, has_landed: bool) -> list[AnyCommand]:
        vehicle.waits_for_operator = True
        vehicle.sent_home = vehicle.going_home = vehicle.lands_after_return = False
        ended = self._end_intentions(vehicle, "the vehicle was disarmed")
        ended += self._energy.ended(vehicle)
        ended += back_under_control(vehicle)
        if not has_landed:
            return [*ended, announce(vehicle, f"disarmed {WAITS}", warning=True)]
        # The mission on board begins in the air, so a takeoff needs a new mission.
        vehicle.flown_line = vehicle.refusal = None
        self.traffic.forget(vehicle.name)
        return [*ended, announce(vehicle, "landed")]

    def _rebooted(self, vehicle: Vehicle, at_s: float, was: "_Was") -> list[AnyCommand]:
        """Reset a vehicle whose autopilot was restarted; an order to return remains valid.

        The restarted autopilot may have any mission on board or none.
        """
        returns = vehicle.availability.recalled or self.airspace.is_led_home(vehicle.name)
        ended = self._end_intentions(vehicle, "the autopilot was restarted")
        self.airspace.end_evasion(vehicle.name)
        vehicle.deployed = vehicle.started = vehicle.going_home = False
        vehicle.sent_home &= returns
        if vehicle.sent_home:
            self.decision_engine.recall(vehicle.name, at_s)
            vehicle.return_again_at_s = at_s
        vehicle.drop_upload()
        vehicle.flown_line = vehicle.accepted = vehicle.unconfirmed = None
        vehicle.takes_off = False
        vehicle.waits_for_operator |= was.airborne
        self.traffic.forget(vehicle.name)
        waits = "it waits for an operator's order to start"
        then = waits if vehicle.waits_for_operator else "a new mission is sent"
        words = announce(vehicle, f"autopilot restarted: {then}", warning=True)
        return [*ended, *back_under_control(vehicle), words]

    # Handlers that do not depend on the vehicle's prior state.
    _ANSWERS: ClassVar[dict[type[events.VehicleEvent], Callable[..., list[AnyCommand]]]] = {
        events.VehicleConnected: _connected,
        events.LinkLost: _link_lost,
        events.LinkRestored: _link_restored,
        events.AirspeedMeasured: _airspeed_measured,
        events.AirDataMeasured: _air_data_measured,
        events.MissionProgress: _progressed,
        events.ParametersReported: _parameters_reported,
        events.AircraftReported: _aircraft_reported,
    }


class _Was(NamedTuple):
    """A vehicle's state before an event."""

    airborne: bool
    recalled: bool
    taken_over: bool
    armed: bool
    mode: str
    estimator_healthy: bool


def _announce_return(vehicle: Vehicle, mode: str) -> Announce:
    where = "returning home" if mode != "land" else "landing at its position"
    return announce(vehicle, f"{where} ({mode})", warning=True)
