"""Guides a formation using orbit commands and loiter missions around the virtual agents.

A vehicle's first mission ends in a loiter near the fire, where the vehicle stays if anything fails.
During this flight the vehicle's agent takes control, and orbit commands to the autopilot follow the
virtual agent. When the orbit has not moved for some time, a mission that ends in a loiter on this
orbit is uploaded and started. When the virtual agent moves again, orbit commands resume.

The mission on board is updated at intervals, so that it ends in a circle near the vehicle. The rate
of commands is limited: there is one pending command at a time, and a minimum interval for each kind
of command.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    ORDER_NAMES,
    REJECTED,
    Announce,
    AnyCommand,
    ChangeSpeed,
    Orbit,
    StartMission,
)
from mission_service.config.scenario import Scenario
from mission_service.errors import MissionServiceError
from mission_service.events import (
    AnyEvent,
    AnyOperatorEvent,
    CommandFinished,
    LinkLost,
    LinkRestored,
    MissionReadBack,
    ModeChanged,
    PeerLinkChanged,
    PeerMessage,
    Resumed,
    SettingsChanged,
    Telemetry,
    UploadFinished,
    VehicleEvent,
    VehicleRebooted,
)
from mission_service.guidance.formation.agent import Intention
from mission_service.guidance.formation.members import Formation
from mission_service.guidance.formation.order_state import OrderState
from mission_service.guidance.formation.waiting_places import clear_of_fire_m, waits_at
from mission_service.guidance.protocol import Guidance
from mission_service.missions.from_path import mission_along
from mission_service.missions.orbits import (
    CLIMBS_FIRST_M,
    Circle,
    Place,
    altitude_amsl_m,
    first_mission,
    highest_ground_m,
    loiter_mission,
    orbit_of,
    pushed_out,
)
from mission_service.peer_messages import AnyMessage
from mission_service.position_fix import PositionFix
from mission_service.vehicles.first_climb import with_first_climb
from mission_service.vehicles.home_altitude import landing_items
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.traffic import TAKEOFF_CLEAR_M, TrafficManager
from mission_service.vehicles.vehicle_state import Vehicle, announce

Floats = NDArray[np.float64]

ORBIT_EVERY_S, ORBIT_MOVES_M = 2.0, 20.0
# Limits near other vehicles: the commanded orbit must match the orbit that the agent has checked.
NEAR_EVERY_S, NEAR_MOVES_M = 0.75, 8.0
RADIUS_CHANGES_M, ALTITUDE_CHANGES_M = 1.0, 5.0
CHECK_GROUND_EVERY_S = 10.0
SPEED_EVERY_S, SPEED_CHANGES_M_S = 3.0, 0.5
CLIMBS_BELOW_M = 30.0
RENEW_EVERY_S, RENEW_BEYOND_M = 60.0, 300.0
RETRY_AFTER_S = 5.0
HOME_WITHIN_M = 500.0  # within this distance of home the autopilot flies the return
ORDER_TIMEOUT_S = 30.0
TAKES_EFFECT_S = 15.0  # mode changes within this time are attributed to the last orbit command
# Modes in which the autopilot stacks fly commanded orbits.
ORBITS_IN = {"px4": ("hold", "guided", "orbit"), "ardupilot": ("guided",)}


class FormationFlight(Guidance):
    """The guidance of a formation, which commands the orbits that the agents intend."""

    def __init__(
        self,
        scenario: Scenario,
        landscape: Landscape,
        spacing: TrafficManager,
        missions: MissionsSent,
    ) -> None:
        self.scenario = scenario
        self.landscape = landscape
        self.formation = Formation(scenario, landscape)
        self.planners = self.formation.members
        self._missions = missions
        self._states = {section.name: OrderState() for section in scenario.vehicles}
        self._ordered_to = ""  # the vehicle that receives an order in the current event
        self._rejected_senders: set[str] = set()
        self._in_contact = (
            not scenario.formation.peer_messaging
        )  # if False, each vehicle stays in its loiter

    # Inputs ----------------------------------------------------------------------------

    def on_operator(self, event: AnyOperatorEvent) -> list[AnyCommand]:
        """Discard pending orders after a restart of the service; orbits are commanded again.

        A change of settings is refused.
        """
        if isinstance(event, SettingsChanged):
            words = f"{REJECTED} the rule formation does not have these settings: none was changed"
            return [Announce(self.scenario.flown[0].name, words, "warning")]
        if isinstance(event, Resumed):
            for state in self._states.values():
                if state.order == "orbit":  # the autopilot may have received the order
                    state.orbit_at_s = event.at_us / 1e6
                state.order, state.circle, state.airspeed_m_s = "", None, None
        return []

    def on_vehicle(self, vehicle: Vehicle, event: VehicleEvent) -> list[AnyCommand]:
        """Process a vehicle's event; return announcements, and messages for other processes."""
        state, at_s = self._states[vehicle.name], event.at_us / 1e6
        commands: list[AnyCommand] = []
        match event:
            case CommandFinished():
                self._finished(state, event, at_s)
            case UploadFinished() if vehicle.pending is None:
                state.loiter = state.sending if event.outcome == "accepted" else None
            case MissionReadBack() if vehicle.read_back == "new":
                state.loiter = state.sending
            case MissionReadBack() if vehicle.read_back == "unknown":
                state.loiter = None
            case Telemetry() if self._is_manual(vehicle, state):
                assert vehicle.availability.fix is not None
                self.formation.track_manual(vehicle.name, vehicle.availability.fix)
            case LinkLost() if (
                state.taken_over or self.formation.members[vehicle.name].manual_control
            ):
                self.formation.on_link_lost(vehicle.name)
            case LinkRestored():
                state.circle = state.airspeed_m_s = None
            case VehicleRebooted():
                self.formation.end_tracking(vehicle.name, event.at_us)
                self._states[vehicle.name] = OrderState()
            case ModeChanged():
                self._mode_changed(vehicle, event, at_s)
            case PeerLinkChanged():
                self._in_contact = event.there
            case PeerMessage():
                commands += self._receive(vehicle, event.message)
        return [*commands, *self.formation.outgoing()]

    def _is_manual(self, vehicle: Vehicle, state: OrderState) -> bool:
        """Return whether a vehicle is airborne but controlled by neither agent nor mission."""
        availability = vehicle.availability
        if not availability.airborne or availability.fix is None:
            return False
        lands = availability.landing != "none"
        return bool(vehicle.ordered) or availability.recalled or lands or not state.guided

    def _receive(self, vehicle: Vehicle, message: AnyMessage) -> list[AnyCommand]:
        """Apply a peer's message; return one warning per sender about rejected messages."""
        try:
            self.formation.deliver(vehicle.name, message)
        except MissionServiceError as error:
            if message.sender not in self._rejected_senders:
                self._rejected_senders.add(message.sender)
                return [announce(vehicle, f"message rejected: {error}", warning=True)]
        return []

    def _finished(self, state: OrderState, event: CommandFinished, at_s: float) -> None:
        if event.command != state.order:
            return
        if event.accepted:
            state.order = ""
        else:
            self._refused(state, at_s)

    def _refused(self, state: OrderState, at_s: float) -> None:
        """Record that the pending order was refused or not sent; it is repeated later."""
        order, state.order = state.order, ""
        match order:
            case "orbit":
                state.circle, state.orbit_at_s = None, at_s + RETRY_AFTER_S - ORBIT_EVERY_S
            case "change speed":
                state.airspeed_m_s, state.speed_at_s = None, at_s + RETRY_AFTER_S
            case _:
                state.start_not_before_s = at_s + 2.0 * RETRY_AFTER_S

    def further_commands(
        self, event: AnyEvent, leaving: list[AnyCommand], vehicles: Mapping[str, Vehicle]
    ) -> list[AnyCommand]:
        """Treat an order that was withheld, for example by closed airspace, as refused."""
        name, self._ordered_to = self._ordered_to, ""
        if name:
            state = self._states[name]
            sent = [ORDER_NAMES.get(type(each)) for each in leaving if each.vehicle == name]
            if state.order and state.order not in sent:
                self._refused(state, event.at_us / 1e6)
        return []

    def _mode_changed(self, vehicle: Vehicle, event: ModeChanged, at_s: float) -> None:
        state = self._states[vehicle.name]
        if not event.armed:
            self.formation.members[vehicle.name].agent.come_back()
            self.formation.end_tracking(vehicle.name, event.at_us)
            self._states[vehicle.name] = OrderState(loiter=state.loiter, sending=state.sending)
            return
        if event.mode == state.mode and state.guided and event.mode != "mission":
            return  # a repeated report after the service has restarted
        if event.mode != state.mode:  # both stacks reset the airspeed at a mode change
            state.mode, state.airspeed_m_s = event.mode, None
        if event.mode == "mission":
            state.guided = True
            if state.loiter is None or state.loiter != state.circle:
                state.circle = None
            return
        ordered = state.order == "orbit" or at_s - state.orbit_at_s < TAKES_EFFECT_S
        if not state.guided or (ordered and event.mode in ORBITS_IN[vehicle.section.stack]):
            return
        state = OrderState(mode=event.mode, loiter=state.loiter, sending=state.sending)
        self._states[vehicle.name] = state
        self.formation.members[vehicle.name].left(at_s)
        self.formation.end_tracking(vehicle.name, event.at_us)

    def in_mission(self, name: str) -> bool:
        """Return whether the vehicle is in its mission mode."""
        return self._states[name].mode == "mission"

    # Missions ---------------------------------------------------------------------------------

    def first_path(self, vehicle: Vehicle, fix: PositionFix) -> Floats:
        """Return the path to a waiting position near the fire.

        For an airborne vehicle this is the nearest position that is clear of fire.
        """
        section, centre_m = vehicle.section, self.formation.centre_m
        if vehicle.availability.airborne:
            reach_m = clear_of_fire_m(self.formation, section)
            place_m = pushed_out((fix.x_m, fix.y_m), centre_m, reach_m)
        else:
            place_m = waits_at(self.scenario, self.formation, section, vehicle.home_m)
        return np.array([(fix.x_m, fix.y_m), place_m])

    def items(self, vehicle: Vehicle, path_m: Floats, fix: PositionFix) -> tuple[MissionItem, ...]:
        """Return the mission to the waiting position at the end of a path.

        A path with corners avoids closed airspace; the mission contains these corners.
        """
        section, state = vehicle.section, self._states[vehicle.name]
        circle = Circle(float(path_m[-1, 0]), float(path_m[-1, 1]), -section.loiter_radius_m)
        state.sending = circle
        if not vehicle.availability.airborne:
            return first_mission(self.landscape, circle, section, landing_items(vehicle, fix.at_s))
        landing = landing_items(vehicle, fix.at_s)
        if len(path_m) > 2:
            here_m = (fix.x_m, fix.y_m)
            found = mission_along(
                path_m, False, section, self.landscape, False, landing, start_m=here_m
            )
        else:
            altitude_m = self._altitude(vehicle, circle, fix)
            found = loiter_mission(self.landscape, circle, altitude_m, landing)
        return with_first_climb(found, vehicle, self.landscape, fix)

    def _resend_first(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Send the first mission again to an airborne vehicle that rejected it."""
        if fix.at_s < vehicle.not_before_s:
            return []
        path_m = self.first_path(vehicle, fix)
        items = self.items(vehicle, path_m, fix)
        return [self._missions.upload(vehicle, path_m, items, fix, "fly to the fire")]

    def _renew(self, vehicle: Vehicle, state: OrderState, fix: PositionFix) -> list[AnyCommand]:
        """Return the upload of a mission that ends in the current circle, if an upload is due."""
        circle = state.circle
        if circle is None or circle == state.loiter or vehicle.awaits_mission:
            return []
        if state.mode == "mission" or state.order == "orbit" or fix.at_s < vehicle.not_before_s:
            return []
        settled = state.has_settled(fix.at_s)
        if state.loiter is not None and not settled:
            near = math.dist(circle.centre_m, state.loiter.centre_m) < RENEW_BEYOND_M
            if near or fix.at_s - vehicle.uploaded_at_s < RENEW_EVERY_S:
                return []
        state.sending = circle
        landing = landing_items(vehicle, fix.at_s)
        items = loiter_mission(self.landscape, circle, state.altitude_m, landing)
        why = "settled: loiter on this circle" if settled else "loiter on a circle nearby"
        path_m = np.array([circle.centre_m])
        return [self._missions.upload(vehicle, path_m, items, fix, why)]

    def _altitude(self, vehicle: Vehicle, circle: Circle, fix: PositionFix) -> float:
        place_m = (fix.x_m, fix.y_m)
        return altitude_amsl_m(self.landscape, circle, vehicle.section.altitude_agl_m, place_m)

    # Orders -----------------------------------------------------------------------------------

    def lead(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Return commands that follow the agent; none before the mission's climb is complete."""
        state = self._states[vehicle.name]
        if not vehicle.started and not vehicle.awaits_mission and vehicle.flown_line is None:
            return self._resend_first(vehicle, fix)
        if not state.guided or not (state.taken_over or self._takes_over(vehicle, state, fix)):
            return []
        if not self._in_contact:
            return []
        intention = self.formation.step_agent(vehicle.name, fix)
        centre_m, radius_m = (intention.orbit_x_m, intention.orbit_y_m), intention.orbit_radius_m
        desired = Circle(*centre_m, radius_m, intention.climb_m)
        near = not intention.settled and self.formation.is_near_others(vehicle.name)
        orbit_due = self._orbit_due(vehicle, state, desired, fix, near)
        if orbit_due or not intention.settled:
            state.settled_since_s = None
        elif state.settled_since_s is None:
            state.settled_since_s = fix.at_s
        commands: list[AnyCommand] = []
        if state.order and fix.at_s - state.ordered_at_s < ORDER_TIMEOUT_S:
            pass
        elif orbit_due:
            commands.append(self._orbit(vehicle, desired, fix))
        elif state.start_due(fix.at_s):
            state.order, state.ordered_at_s = "start mission", fix.at_s
            state.start_not_before_s = fix.at_s + RETRY_AFTER_S
            commands.append(StartMission(vehicle.name))
        else:
            commands += self._speed(vehicle, intention, fix, near)
        self._ordered_to = vehicle.name if commands else ""
        return [*commands, *self._renew(vehicle, state, fix)]

    def way_home(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand] | None:
        """Return the commands with which the agent guides a vehicle home.

        The result is None if the vehicle is near home, if the agent's time limit has passed, if the
        agent has not taken control, or if this process has no contact with the other processes.
        """
        state = self._states[vehicle.name]
        away_m = math.dist((fix.x_m, fix.y_m), vehicle.home_m)
        leads = state.guided and state.taken_over and self._in_contact
        if away_m < HOME_WITHIN_M or not leads:
            return None
        if not vehicle.going_home:
            vehicle.going_home, state.led_home = True, False
            slow_m_s = max(vehicle.section.airspeed_m_s / 2.0, 1.0)
            state.goes_home_until_s = fix.at_s + away_m / slow_m_s
            self.formation.members[vehicle.name].agent.go_home(*vehicle.home_m)
        elif fix.at_s >= state.goes_home_until_s:
            return None
        orders = self.lead(vehicle, fix)
        if state.led_home or not orders:
            return orders
        state.led_home = True
        return [announce(vehicle, "flight time is nearly used up: guided home"), *orders]

    def _takes_over(self, vehicle: Vehicle, state: OrderState, fix: PositionFix) -> bool:
        """Return whether the agent takes control: when the vehicle is clear of home and terrain."""
        place_m: Place = (fix.x_m, fix.y_m)
        if math.dist(place_m, vehicle.home_m) < TAKEOFF_CLEAR_M:
            return False
        reach_m = 2.0 * vehicle.section.loiter_radius_m
        ground_m = highest_ground_m(self.landscape, place_m, place_m, reach_m)
        clear_m = min(CLIMBS_FIRST_M, vehicle.section.altitude_agl_m) / 2.0
        state.taken_over = fix.altitude_m >= ground_m + clear_m
        return state.taken_over

    def _orbit_due(
        self, vehicle: Vehicle, state: OrderState, desired: Circle, fix: PositionFix, near: bool
    ) -> bool:
        flown = state.circle
        if flown is None:
            return fix.at_s - state.orbit_at_s >= ORBIT_EVERY_S
        wider = abs(desired.radius_m - flown.radius_m) >= RADIUS_CHANGES_M
        if fix.at_s - state.orbit_at_s < (NEAR_EVERY_S if wider or near else ORBIT_EVERY_S):
            return False
        moves_m = NEAR_MOVES_M if near else ORBIT_MOVES_M
        if wider or math.dist(desired.centre_m, flown.centre_m) > moves_m:
            return True
        if abs(desired.climb_m - flown.climb_m) >= ALTITUDE_CHANGES_M:
            return True
        if fix.at_s < state.check_ground_at_s:
            return False
        state.check_ground_at_s = fix.at_s + CHECK_GROUND_EVERY_S
        return abs(self._altitude(vehicle, flown, fix) - state.altitude_m) >= ALTITUDE_CHANGES_M

    def _orbit(self, vehicle: Vehicle, circle: Circle, fix: PositionFix) -> Orbit:
        state = self._states[vehicle.name]
        state.circle, state.altitude_m = circle, self._altitude(vehicle, circle, fix)
        state.order, state.ordered_at_s = "orbit", fix.at_s
        state.orbit_at_s, state.check_ground_at_s = fix.at_s, fix.at_s + CHECK_GROUND_EVERY_S
        return orbit_of(vehicle.name, self.landscape, circle, state.altitude_m)

    def _speed(
        self, vehicle: Vehicle, intention: Intention, fix: PositionFix, near: bool
    ) -> list[AnyCommand]:
        section, state = vehicle.section, self._states[vehicle.name]
        min_m_s, max_m_s = section.min_airspeed_m_s, section.max_airspeed_m_s
        if fix.altitude_m < state.altitude_m - CLIMBS_BELOW_M:  # a climb needs airspeed
            min_m_s = max(min_m_s, min(section.airspeed_m_s, max_m_s))
        new_m_s = round(min(max(intention.airspeed_m_s, min_m_s), max_m_s), 1)
        ordered_m_s = state.airspeed_m_s  # None after a mode change, which resets the airspeed
        every_s = NEAR_EVERY_S if near else SPEED_EVERY_S
        if fix.at_s - state.speed_at_s < (0.0 if ordered_m_s is None else every_s):
            return []
        if ordered_m_s is not None and abs(new_m_s - ordered_m_s) <= SPEED_CHANGES_M_S:
            return []
        state.airspeed_m_s, state.speed_at_s = new_m_s, fix.at_s
        state.order, state.ordered_at_s = "change speed", fix.at_s
        return [ChangeSpeed(vehicle.name, new_m_s)]
