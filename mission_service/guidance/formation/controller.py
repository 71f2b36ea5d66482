"""Flight in a formation: orbits that move with virtual agents, and loiters at settled agents.

A vehicle flies to the fire and loiters by a mission, so that it ends there if anything fails. On
the way its agent takes control: orbit commands of the stack follow the virtual agent. Once the
agent has settled, the circle becomes the loiter of the vehicle's mission, which it then flies; when
the agent moves, orbit commands resume. Meanwhile the mission on board is renewed at intervals, so
that it ends in a circle nearby. The rate of commands is limited: one under way at a time, and a
minimum interval for each kind.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.commands import AnyCommand, ChangeSpeed, Orbit, StartMission
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.errors import MissionServiceError
from mission_service.events import (
    AnyOperatorEvent,
    CommandFinished,
    LinkLost,
    LinkRestored,
    MissionReadBack,
    ModeChanged,
    PeerLinkChanged,
    PeerMessage,
    Resumed,
    Telemetry,
    UploadFinished,
    VehicleEvent,
    VehicleRebooted,
)
from mission_service.guidance.formation.agent import Intention
from mission_service.guidance.formation.members import Formation
from mission_service.guidance.protocol import Guidance
from mission_service.missions.landing import Landing
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
    waiting_place,
)
from mission_service.peer_messages import AnyMessage
from mission_service.position_fix import PositionFix
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.traffic import TAKEOFF_CLEAR_M, TrafficManager
from mission_service.vehicles.vehicle_state import Vehicle, announce

Floats = NDArray[np.float64]

ORBIT_EVERY_S, ORBIT_MOVES_M = 2.0, 20.0
# Near others a vehicle must fly the orbit that its agent has sent and checked.
NEAR_EVERY_S, NEAR_MOVES_M = 0.75, 8.0
RADIUS_CHANGES_M, ALTITUDE_CHANGES_M = 1.0, 5.0
LOOK_DOWN_EVERY_S = 10.0
SPEED_EVERY_S, SPEED_CHANGES_M_S = 3.0, 0.5
CLIMBS_BELOW_M = 30.0
SETTLED_FOR_S = 20.0
RENEW_EVERY_S, RENEW_BEYOND_M = 60.0, 300.0
AGAIN_AFTER_S = 5.0
HOME_WITHIN_M = 500.0  # from here its autopilot flies home
UNANSWERED_S = 30.0  # timeout of an order without an outcome
TAKES_EFFECT_S = 15.0  # a mode change within this time of an orbit order is its effect
# The mode in which a stack flies commanded orbits.
ORBITS_IN = {"px4": ("hold", "guided", "orbit"), "ardupilot": ("guided",)}


@dataclass
class Led:
    """The flight state of one vehicle, and the orders sent to it."""

    leads: bool = False  # it flies its mission or our orbits, not under manual control
    taken_over: bool = False
    mode: str = ""
    order: str = ""  # under way
    ordered_at_s: float = -math.inf
    circle: Circle | None = None  # ordered last, or flown by the mission
    altitude_m: float = 0.0
    orbit_at_s: float = -math.inf
    look_down_at_s: float = -math.inf
    airspeed_m_s: float | None = None
    speed_at_s: float = -math.inf
    settled_since_s: float | None = None
    start_not_before_s: float = -math.inf
    goes_home_until_s: float = math.inf  # latest end of the agent's control
    sending: Circle | None = None  # final circle of a mission being uploaded
    loiter: Circle | None = None  # final circle of the mission on board


def clear_of_fire_m(formation: Formation, section: VehicleSection) -> float:
    """Distance from the fire's centre at which a vehicle's circle is clear of all known fire."""
    return formation.reach_m + 3.0 * section.loiter_radius_m


def waits_at(
    scenario: Scenario, formation: Formation, section: VehicleSection, home_m: Place
) -> Place:
    """The end of a vehicle's first mission: its own place at the fire's edge."""
    number = [each.name for each in scenario.vehicles].index(section.name)
    reach_m = clear_of_fire_m(formation, section)
    apart_m = 2.0 * section.loiter_radius_m + 4.0 * scenario.formation.safety_radius_m
    return waiting_place(number, formation.centre_m, reach_m, home_m, apart_m)


def mission_to_place(
    scenario: Scenario, section: VehicleSection, landscape: Landscape
) -> tuple[MissionItem, ...]:
    """The first mission of a vehicle on the ground: to its place at the fire's edge."""
    home_m = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    place_m = waits_at(scenario, Formation(scenario, landscape), section, home_m)
    landing = Landing(scenario, section, landscape).at(scenario.first_flight_s)
    return first_mission(landscape, Circle(*place_m, -section.loiter_radius_m), section, landing)


class FormationFlight(Guidance):
    """Commands each vehicle to fly as its agent intends."""

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
        self._led = {section.name: Led() for section in scenario.vehicles}
        self._not_understood: set[str] = set()
        self._in_contact = not scenario.formation.peer_messaging  # else it circles in place

    # Inputs ----------------------------------------------------------------------------

    def on_operator(self, event: AnyOperatorEvent) -> list[AnyCommand]:
        """After a restart of the service: drop pending orders; agents send their orbits again."""
        if isinstance(event, Resumed):
            for led in self._led.values():
                if led.order == "orbit":  # it may have arrived and may still change the mode
                    led.orbit_at_s = event.at_us / 1e6
                led.order, led.circle, led.airspeed_m_s = "", None, None
        return []

    def on_vehicle(self, vehicle: Vehicle, event: VehicleEvent) -> list[AnyCommand]:
        """Process results, modes and restarts; returns announcements and messages."""
        led, at_s = self._led[vehicle.name], event.at_us / 1e6
        commands: list[AnyCommand] = []
        match event:
            case CommandFinished():
                self._finished(led, event, at_s)
            case UploadFinished() if vehicle.pending is None:
                led.loiter = led.sending if event.outcome == "accepted" else None
            case MissionReadBack() if vehicle.read_back == "new":
                led.loiter = led.sending
            case MissionReadBack() if vehicle.read_back == "unknown":
                led.loiter = None
            case Telemetry() if self._is_manual(vehicle, led):
                assert vehicle.availability.fix is not None
                self.formation.track_manual(vehicle.name, vehicle.availability.fix)
            case LinkLost() if (
                led.taken_over or self.formation.members[vehicle.name].manual_control
            ):
                self.formation.on_link_lost(vehicle.name)
            case LinkRestored():
                led.circle = led.airspeed_m_s = None
            case VehicleRebooted():
                self.formation.end_tracking(vehicle.name, event.at_us)
                self._led[vehicle.name] = Led()
            case ModeChanged():
                self._mode_changed(vehicle, led, event, at_s)
            case PeerLinkChanged():
                self._in_contact = event.there
            case PeerMessage():
                commands += self._receive(vehicle, event.message)
            case _:
                pass
        return [*commands, *self.formation.outgoing()]

    def _is_manual(self, vehicle: Vehicle, led: Led) -> bool:
        """Whether it is in the air and under control of neither its agent nor its mission."""
        availability = vehicle.availability
        if not availability.airborne or availability.fix is None:
            return False
        return bool(vehicle.ordered) or availability.recalled or not led.leads

    def _receive(self, vehicle: Vehicle, message: AnyMessage) -> list[AnyCommand]:
        """Apply a peer's message; reject cells off this map, with one report per sender."""
        try:
            self.formation.deliver(vehicle.name, message)
        except MissionServiceError as error:
            if message.sender not in self._not_understood:
                self._not_understood.add(message.sender)
                return [announce(vehicle, f"message dropped: {error}", warning=True)]
        return []

    def _finished(self, led: Led, event: CommandFinished, at_s: float) -> None:
        if event.command != led.order:
            return
        led.order = ""
        if event.accepted:
            return
        match event.command:
            case "orbit":
                led.circle, led.orbit_at_s = None, at_s + AGAIN_AFTER_S - ORBIT_EVERY_S
            case "change speed":
                led.airspeed_m_s, led.speed_at_s = None, at_s + AGAIN_AFTER_S
            case _:
                led.start_not_before_s = at_s + 2.0 * AGAIN_AFTER_S

    def _mode_changed(self, vehicle: Vehicle, led: Led, event: ModeChanged, at_s: float) -> None:
        if not event.armed:
            self.formation.members[vehicle.name].agent.come_back()
            self.formation.end_tracking(vehicle.name, event.at_us)
            self._led[vehicle.name] = Led(loiter=led.loiter, sending=led.sending)
            return
        if event.mode == led.mode and led.leads and event.mode != "mission":
            return  # reported again after a restart of the service
        if event.mode != led.mode:  # both stacks reset the speed with the mode
            led.mode, led.airspeed_m_s = event.mode, None
        if event.mode == "mission":
            led.leads = True
            if led.loiter is None or led.loiter != led.circle:
                led.circle = None
            return
        ordered = led.order == "orbit" or at_s - led.orbit_at_s < TAKES_EFFECT_S
        if not led.leads or (ordered and event.mode in ORBITS_IN[vehicle.section.stack]):
            return
        self._led[vehicle.name] = Led(mode=event.mode, loiter=led.loiter, sending=led.sending)
        self.formation.members[vehicle.name].left(at_s)
        self.formation.end_tracking(vehicle.name, event.at_us)

    def in_mission(self, name: str) -> bool:
        """Whether it flies the mission it has on board, by its mode."""
        return self._led[name].mode == "mission"

    # Missions ---------------------------------------------------------------------------------

    def first_path(self, vehicle: Vehicle, fix: PositionFix) -> Floats:
        """The path to the edge of the fire; in the air to the nearest place clear of it."""
        section, centre_m = vehicle.section, self.formation.centre_m
        if vehicle.availability.airborne:
            reach_m = clear_of_fire_m(self.formation, section)
            place_m = pushed_out((fix.x_m, fix.y_m), centre_m, reach_m)
        else:
            place_m = waits_at(self.scenario, self.formation, section, vehicle.home_m)
        return np.array([(fix.x_m, fix.y_m), place_m])

    def items(self, vehicle: Vehicle, path_m: Floats, fix: PositionFix) -> tuple[MissionItem, ...]:
        """The mission to a waiting place."""
        section, led = vehicle.section, self._led[vehicle.name]
        circle = Circle(float(path_m[-1, 0]), float(path_m[-1, 1]), -section.loiter_radius_m)
        led.sending = circle
        if not vehicle.availability.airborne:
            return first_mission(self.landscape, circle, section, vehicle.landing.at(fix.at_s))
        altitude_m = self._altitude(vehicle, circle, fix)
        return loiter_mission(self.landscape, circle, altitude_m, vehicle.landing.at(fix.at_s))

    def _begin_again(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Send the first mission again to a vehicle that refused it in the air at the start."""
        if fix.at_s < vehicle.not_before_s:
            return []
        path_m = self.first_path(vehicle, fix)
        items = self.items(vehicle, path_m, fix)
        return [self._missions.upload(vehicle, path_m, items, fix, "fly to the fire")]

    def _renew(self, vehicle: Vehicle, led: Led, fix: PositionFix) -> list[AnyCommand]:
        """Renew the mission so that it ends in the circle being flown, if that is due."""
        circle = led.circle
        if circle is None or vehicle.awaits_mission or led.mode == "mission":
            return []
        if led.order == "orbit" or fix.at_s < vehicle.not_before_s:
            return []
        settled = self._has_settled(led, fix)
        if led.loiter is not None and not settled:
            near = math.dist(circle.centre_m, led.loiter.centre_m) < RENEW_BEYOND_M
            if near or fix.at_s - vehicle.uploaded_at_s < RENEW_EVERY_S:
                return []
        if circle == led.loiter:
            return []
        led.sending = circle
        items = loiter_mission(self.landscape, circle, led.altitude_m, vehicle.landing.at(fix.at_s))
        why = "settled: loiter here" if settled else "loiter not far from here"
        path_m = np.array([circle.centre_m])
        return [self._missions.upload(vehicle, path_m, items, fix, why)]

    def _altitude(self, vehicle: Vehicle, circle: Circle, fix: PositionFix) -> float:
        place_m = (fix.x_m, fix.y_m)
        return altitude_amsl_m(self.landscape, circle, vehicle.section.altitude_agl_m, place_m)

    # Orders -----------------------------------------------------------------------------------

    def lead(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Commands to follow the agent; none before the vehicle has climbed out by its mission."""
        led = self._led[vehicle.name]
        if not vehicle.started and not vehicle.awaits_mission and vehicle.flown_line is None:
            return self._begin_again(vehicle, fix)
        if not led.leads or not (led.taken_over or self._takes_over(vehicle, led, fix)):
            return []
        if not self._in_contact:
            return []
        intention = self.formation.step(vehicle.name, fix)
        wanted = Circle(
            intention.orbit_x_m,
            intention.orbit_y_m,
            intention.orbit_radius_m,
            intention.climb_m,
        )
        near = not intention.settled and self.formation.is_near_others(vehicle.name)
        orbit_due = self._orbit_due(vehicle, led, wanted, fix, near)
        if orbit_due or not intention.settled:
            led.settled_since_s = None
        elif led.settled_since_s is None:
            led.settled_since_s = fix.at_s
        commands: list[AnyCommand] = []
        if led.order and fix.at_s - led.ordered_at_s < UNANSWERED_S:
            pass
        elif orbit_due:
            commands.append(self._orbit(vehicle, led, wanted, fix))
        elif self._start_due(led, fix):
            led.order, led.ordered_at_s = "start mission", fix.at_s
            led.start_not_before_s = fix.at_s + AGAIN_AFTER_S
            commands.append(StartMission(vehicle.name))
        else:
            commands += self._speed(vehicle, led, intention, fix, near)
        return [*commands, *self._renew(vehicle, led, fix)]

    def way_home(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand] | None:
        """Commands home by the agent, which avoids the others; None near home."""
        led = self._led[vehicle.name]
        away_m = math.dist((fix.x_m, fix.y_m), vehicle.home_m)
        if away_m < HOME_WITHIN_M or not led.taken_over:
            return None
        if not vehicle.going_home:
            vehicle.going_home = True
            slow_m_s = max(vehicle.section.airspeed_m_s / 2.0, 1.0)
            led.goes_home_until_s = fix.at_s + away_m / slow_m_s
            self.formation.members[vehicle.name].agent.go_home(*vehicle.home_m)
            words = "its time is nearly over: led home"
            return [announce(vehicle, words), *self.lead(vehicle, fix)]
        return self.lead(vehicle, fix) if fix.at_s < led.goes_home_until_s else None

    def _takes_over(self, vehicle: Vehicle, led: Led, fix: PositionFix) -> bool:
        """Whether it is clear of its home and of the terrain."""
        place_m: Place = (fix.x_m, fix.y_m)
        if math.dist(place_m, vehicle.home_m) < TAKEOFF_CLEAR_M:
            return False
        reach_m = 2.0 * vehicle.section.loiter_radius_m
        ground_m = highest_ground_m(self.landscape, place_m, place_m, reach_m)
        clear_m = min(CLIMBS_FIRST_M, vehicle.section.altitude_agl_m) / 2.0
        led.taken_over = fix.altitude_m >= ground_m + clear_m
        return led.taken_over

    def _orbit_due(
        self, vehicle: Vehicle, led: Led, wanted: Circle, fix: PositionFix, near: bool
    ) -> bool:
        flown = led.circle
        if flown is None:
            return fix.at_s - led.orbit_at_s >= ORBIT_EVERY_S
        wider = abs(wanted.radius_m - flown.radius_m) >= RADIUS_CHANGES_M
        if fix.at_s - led.orbit_at_s < (NEAR_EVERY_S if wider or near else ORBIT_EVERY_S):
            return False
        moves_m = NEAR_MOVES_M if near else ORBIT_MOVES_M
        if wider or math.dist(wanted.centre_m, flown.centre_m) > moves_m:
            return True
        if abs(wanted.climb_m - flown.climb_m) >= ALTITUDE_CHANGES_M:
            return True
        if fix.at_s < led.look_down_at_s:
            return False
        led.look_down_at_s = fix.at_s + LOOK_DOWN_EVERY_S
        return abs(self._altitude(vehicle, flown, fix) - led.altitude_m) >= ALTITUDE_CHANGES_M

    def _orbit(self, vehicle: Vehicle, led: Led, wanted: Circle, fix: PositionFix) -> Orbit:
        led.circle, led.altitude_m = wanted, self._altitude(vehicle, wanted, fix)
        led.order, led.ordered_at_s = "orbit", fix.at_s
        led.orbit_at_s, led.look_down_at_s = fix.at_s, fix.at_s + LOOK_DOWN_EVERY_S
        return orbit_of(vehicle.name, self.landscape, wanted, led.altitude_m)

    def _has_settled(self, led: Led, fix: PositionFix) -> bool:
        since_s = led.settled_since_s
        return since_s is not None and fix.at_s - since_s >= SETTLED_FOR_S

    def _start_due(self, led: Led, fix: PositionFix) -> bool:
        """Whether to start the mission on board, which ends in the commanded circle being flown."""
        ready = led.loiter is not None and led.loiter == led.circle and led.mode != "mission"
        return ready and self._has_settled(led, fix) and fix.at_s >= led.start_not_before_s

    def _speed(
        self, vehicle: Vehicle, led: Led, intention: Intention, fix: PositionFix, near: bool
    ) -> list[AnyCommand]:
        section = vehicle.section
        least, most = section.min_airspeed_m_s, section.max_airspeed_m_s
        if fix.altitude_m < led.altitude_m - CLIMBS_BELOW_M:  # a climb needs airspeed
            least = max(least, min(section.airspeed_m_s, most))
        wanted = round(min(max(intention.airspeed_m_s, least), most), 1)
        told = led.airspeed_m_s
        # At once after a mode change, which resets the airspeed.
        every_s = NEAR_EVERY_S if near else SPEED_EVERY_S
        if fix.at_s - led.speed_at_s < (0.0 if told is None else every_s):
            return []
        if told is not None and abs(wanted - told) <= SPEED_CHANGES_M_S:
            return []
        led.airspeed_m_s, led.speed_at_s = wanted, fix.at_s
        led.order, led.ordered_at_s = "change speed", fix.at_s
        return [ChangeSpeed(vehicle.name, wanted)]
