"""Converts operators' orders to commands for vehicles along a front or in formation. Pure."""

from collections.abc import Callable
from dataclasses import replace

from mission_service import events
from mission_service.commands import (
    CONFIRM,
    REJECTED,
    AnyCommand,
    Hold,
    HoldAt,
    Return,
    StartMission,
)
from mission_service.config.scenario import Scenario
from mission_service.core.airspace_guard import AirspaceGuard
from mission_service.core.autopilot_reports import back_under_control
from mission_service.core.decision_engine import DecisionEngine
from mission_service.core.landings import Landings
from mission_service.core.preflight import Preflight
from mission_service.guidance.registry import way_of
from mission_service.vehicles.approvals import MissionApprovals
from mission_service.vehicles.availability import MISSION, named_mode
from mission_service.vehicles.endurance import time_up_words
from mission_service.vehicles.vehicle_state import Vehicle, announce

HOLD_AGAIN_S = 3.0
UNANSWERED_S = 30.0  # longer than the bridge keeps repeating a hold
START_AFTER_S = 2.0
# In simulation, PX4's plane lost 10 to 12 m of height when ordered to hold during takeoff.
CLIMB_FIRST_M = 30.0

Start = Callable[[Vehicle, float], list[AnyCommand]]


class OperatorOrders:
    """The part of the core that applies operators' orders; ``Vehicle`` stores their effects."""

    def __init__(
        self,
        scenario: Scenario,
        decision_engine: DecisionEngine,
        vehicles: dict[str, Vehicle],
        start: Start,
        approvals: MissionApprovals | None,
        landings: Landings,
        airspace: AirspaceGuard,
        preflight: Preflight,
    ) -> None:
        self._resumes_mission = way_of(scenario).resumes_mission
        self._renews_missions = way_of(scenario).along_front or approvals is not None
        self.decision_engine = decision_engine
        self.vehicles = vehicles
        self._start = start
        self._approvals = approvals
        self._landings = landings
        self._airspace = airspace
        self._preflight = preflight

    def handle(self, event: events.AnyOperatorEvent) -> list[AnyCommand]:
        """Apply an operator's event and return the commands that it causes."""
        match event:
            case events.OrderGiven():
                return self._to_each(event.vehicle, lambda vehicle: self._ordered(vehicle, event))
            case events.Aborted():
                why = f"aborted by {event.by}"
                return [
                    *self._to_each("", lambda vehicle: self._abort(vehicle, event)),
                    *self._to_each("", lambda vehicle: self._withdrawn(vehicle, why)),
                ]
            case events.MissionRequested():
                return self._to_each(
                    event.vehicle, lambda vehicle: self._request_mission(vehicle, event.by)
                )
            case events.MissionAccepted() | events.MissionRefused():
                return self._decided_on(event)
            case _:
                return []

    def _to_each(self, name: str, order: Callable[[Vehicle], list[AnyCommand]]) -> list[AnyCommand]:
        """Apply ``order`` to the named vehicle, or to all vehicles that this process flies."""
        named = self.vehicles if not name else [name] if name in self.vehicles else []
        return [command for each in named for command in order(self.vehicles[each])]

    def _ordered(self, vehicle: Vehicle, event: events.OrderGiven) -> list[AnyCommand]:
        """Execute an order, or request confirmation if it would end a mode that was not ordered."""
        obstacle = self._obstacle(vehicle, event)
        if obstacle:
            words = f"{REJECTED} {vehicle.name}: {obstacle}"
            return [announce(vehicle, words, warning=True)]
        time_up = self._time_up(vehicle, event)
        if time_up and not event.confirmed:
            why = f"it does not have enough energy to {event.order}: {time_up}"
            if vehicle.availability.needs_confirmation(event.order):
                why += f"; {_ended_mode(vehicle, event.order)}"
            return _question(vehicle, why)
        was_taken_over = vehicle.availability.taken_over
        if self.decision_engine.apply_order(vehicle.name, event):
            vehicle.energy.flies_on = bool(time_up)
            ended = back_under_control(vehicle) if was_taken_over else []
            if event.order in ("hold", "return", "land"):
                ended += self._withdrawn(vehicle, f"{event.order} by {event.by}")
            vehicle.hold_at = event.hold_at
            self._airspace.end_evasion(vehicle.name)
            if _takes_off(vehicle, event.order):
                ended += self._preflight.sign_off(vehicle, event)
            return [*self._order(vehicle, event.order, event.by, event.at_us / 1e6), *ended]
        if event.by == events.SERVICE:
            words = f"no order is sent: it stays in {named_mode(vehicle.availability.mode)}"
            return [announce(vehicle, words)]
        return _question(vehicle, _ended_mode(vehicle, event.order))

    def _time_up(self, vehicle: Vehicle, event: events.OrderGiven) -> str:
        """Return why low energy makes an order to fly need confirmation; "" if it does not."""
        flies = event.order in ("start", "resume") and vehicle.availability.airborne
        return time_up_words(vehicle, event.at_us / 1e6) if flies else ""

    def _obstacle(self, vehicle: Vehicle, event: events.OrderGiven) -> str:
        """Return why an order cannot be executed even if confirmed; "" without an obstacle."""
        availability, on_board = vehicle.availability, self._resumes_mission
        order = event.order
        if refusal := availability.refuses(order):
            return refusal
        if order == "land":
            return self._landings.obstacle(vehicle)
        if order == "start" and vehicle.ordered:
            return "a hold is ordered: order resume first"
        if order == "takeoff" and (begun := _takeoff_begun(vehicle)):
            return begun
        if _takes_off(vehicle, order):
            return self._preflight.obstacle(vehicle, event)
        if order == "resume" and on_board and availability.airborne and not availability.online:
            return "its link is lost: order resume again when the link is restored"
        return ""

    def _abort(self, vehicle: Vehicle, event: events.Aborted) -> list[AnyCommand]:
        """Order a hold; it begins once any mode selected by the autopilot or pilot has ended."""
        at_s, mode = event.at_us / 1e6, named_mode(vehicle.availability.mode)
        vehicle.hold_at = None
        self._airspace.end_evasion(vehicle.name)
        if self.decision_engine.apply_abort(vehicle.name):
            if self._goes_around(vehicle):
                return self._landings.go_around(vehicle, f"aborted by {event.by}", at_s)
            return self._hold(vehicle, event.by, at_s, "aborted")
        vehicle.ordered, vehicle.hold_again_at_s = "hold", at_s
        vehicle.end_intentions()
        ended = self._landings.end(vehicle, holds=True)
        words = f"aborted by {event.by}; stays in {mode}, which its autopilot or pilot selected"
        return [*ended, announce(vehicle, words, warning=True)]

    def _order(
        self, vehicle: Vehicle, order: events.Order, by: str, at_s: float
    ) -> list[AnyCommand]:
        if order in ("hold", "go-around"):
            if self._goes_around(vehicle):
                return self._landings.go_around(vehicle, f"{order} ordered by {by}", at_s)
            return self._hold(vehicle, by, at_s, f"{order} ordered")
        if order == "land":
            return self._landings.land(vehicle, f"ordered by {by}", at_s)
        return [*self._landings.end(vehicle), *self._fly(vehicle, order, by, at_s)]

    def _fly(self, vehicle: Vehicle, order: events.Order, by: str, at_s: float) -> list[AnyCommand]:
        match order:
            case "return":
                vehicle.ordered, vehicle.hold_again_at_s = "", None
                vehicle.end_intentions()
                vehicle.waits_for_operator = True
                availability, words = vehicle.availability, f"return ordered by {by}"
                vehicle.sent_home = True
                if availability.airborne and availability.online:
                    return [announce(vehicle, words), Return(vehicle.name)]
                # A vehicle on the ground also needs a hold, as an earlier order to start may still
                # take effect.
                vehicle.return_again_at_s = at_s
                if availability.airborne:
                    return [announce(vehicle, words)]
                if availability.armed:
                    return [announce(vehicle, f"{words}: executed after takeoff")]
                why = "it is on the ground; no command is sent until an operator orders its start"
                return [announce(vehicle, f"{words}: {why}", warning=True)]
            case "resume":
                return self._resume(vehicle, by)
            case _:  # start, takeoff
                if order == "takeoff":
                    vehicle.ordered, vehicle.hold_again_at_s = "", None
                vehicle.started, vehicle.waits_for_operator, vehicle.refusal = True, False, None
                vehicle.return_again_at_s = None
                self._cancel_return(vehicle)
                if vehicle.flown_line is None or not vehicle.availability.online:
                    vehicle.start_again_at_s = at_s + START_AFTER_S
                    words = f"{order} ordered by {by}: executed when a mission is on board"
                    return [announce(vehicle, words)]
                words = "started" if order == "start" else "takeoff signed off"
                return [announce(vehicle, f"{words} by {by}"), *self._start(vehicle, at_s)]

    def _hold(self, vehicle: Vehicle, by: str, at_s: float, why: str) -> list[AnyCommand]:
        """Hold until the next order; the hold is repeated until the autopilot accepts it."""
        vehicle.ordered, vehicle.hold_again_at_s = "hold", at_s + HOLD_AGAIN_S
        vehicle.end_intentions()
        self._cancel_return(vehicle)
        ended = self._landings.end(vehicle, holds=True)
        climb_s = _climb_first_s(vehicle)
        if climb_s > 0.0:
            vehicle.hold_again_at_s = at_s + climb_s
            then = f"it holds in {climb_s:.0f} s, when it has climbed to {CLIMB_FIRST_M:.0f} m"
            return [announce(vehicle, f"{why} by {by}; {then}", warning=True), *ended]
        words = announce(vehicle, f"{why} by {by}", warning=True)
        if not vehicle.availability.online or _is_on_ground(vehicle):
            vehicle.hold_again_at_s = at_s
            return [words, *ended]
        return [words, *ended, _hold_of(vehicle)]

    def _goes_around(self, vehicle: Vehicle) -> bool:
        """Return whether an order to hold breaks off a landing; not after touchdown."""
        return self._landings.must_go_around(vehicle) and not vehicle.availability.touched_down

    def _cancel_return(self, vehicle: Vehicle) -> None:
        vehicle.sent_home = vehicle.going_home = False
        if vehicle.unconfirmed is not None:
            vehicle.unconfirmed = replace(vehicle.unconfirmed, recalled=False)

    def _resume(self, vehicle: Vehicle, by: str) -> list[AnyCommand]:
        vehicle.ordered, vehicle.hold_again_at_s = "", None
        self._cancel_return(vehicle)
        vehicle.return_again_at_s, vehicle.refusal = None, None
        vehicle.waits_for_operator = False
        on_board = self._resumes_mission and vehicle.availability.airborne
        if on_board and vehicle.unconfirmed is not None:
            vehicle.unconfirmed = replace(vehicle.unconfirmed, resumed=True)
            return [announce(vehicle, f"resumed by {by}: executed when its mission is read back")]
        if on_board:
            if vehicle.flown_line is None:  # the mission on board is unknown
                vehicle.deployed, vehicle.holding = False, True
                return [announce(vehicle, f"resumed by {by}: executed when it has a mission")]
            # The mission ends at the fire's edge; from there the formation controls the vehicle.
            return [announce(vehicle, f"resumed by {by}"), StartMission(vehicle.name)]
        if vehicle.availability.airborne:  # resumed with a new mission, because the front has moved
            vehicle.holding, vehicle.flown_line = True, None
        elif vehicle.started:
            vehicle.flown_line = None
            vehicle.started = False
        return [announce(vehicle, f"resumed by {by}")]

    def _request_mission(self, vehicle: Vehicle, by: str) -> list[AnyCommand]:
        if not self._renews_missions:
            words = f"{REJECTED} the rule of this run does not renew missions"
            return [announce(vehicle, words, warning=True)]
        vehicle.due, vehicle.refusal = f"requested by {by}", None
        availability = vehicle.availability
        if not availability.position_good:
            words = "no position fix: a mission is sent when the vehicle has one"
            return [announce(vehicle, words, warning=True)]
        led = not (availability.airborne and (availability.taken_over or vehicle.ordered))
        if availability.recalled or not led:
            why, then = f"in {named_mode(availability.mode)}", "its planner has control"
            if not availability.airborne:
                why, then = "ordered to return on the ground", "an operator orders its start"
            words = f"{why}: a mission is sent when {then}"
            return [announce(vehicle, words, warning=True)]
        return self._withdrawn(vehicle, f"{by} requested another mission")

    def _withdrawn(self, vehicle: Vehicle, why: str) -> list[AnyCommand]:
        """Withdraw the proposed mission of a vehicle."""
        return [] if self._approvals is None else [*self._approvals.withdraw(vehicle, why)]

    def _decided_on(
        self, event: events.MissionAccepted | events.MissionRefused
    ) -> list[AnyCommand]:
        vehicle = self.vehicles.get(event.vehicle)
        if vehicle is None:
            return []
        if self._approvals is None:
            words = f"{REJECTED} the missions of this run do not need approval"
            return [announce(vehicle, words, warning=True)]
        if isinstance(event, events.MissionAccepted):
            mission = self._approvals.accepted(vehicle, event.mission_hash)
            if mission is not None:
                words = f"mission {mission.mission_id} accepted by {event.by}"
                return [announce(vehicle, words), mission]
        elif self._approvals.refused(vehicle, event.mission_hash, event.by):
            words = "no similar mission will be proposed until the front or the reason changes"
            return [announce(vehicle, f"mission refused by {event.by}: {words}")]
        words = f"{REJECTED} this mission is no longer proposed; reload the proposal"
        return [announce(vehicle, words, warning=True)]


def hold_again(vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
    """Repeat a hold that was not accepted, once the previous command has been answered."""
    if vehicle.hold_again_at_s is None or at_s < vehicle.hold_again_at_s:
        return []
    since_s = vehicle.hold_under_way_s
    if since_s is not None and at_s - since_s < UNANSWERED_S:
        return []
    if _is_on_ground(vehicle):
        return []
    vehicle.hold_again_at_s = at_s + HOLD_AGAIN_S
    return [_hold_of(vehicle)]


def _climb_first_s(vehicle: Vehicle) -> float:
    """Return how many seconds a plane in its takeoff item climbs before it holds; otherwise 0."""
    availability, section = vehicle.availability, vehicle.section
    takes_off = section.kind == "plane" and availability.mode == MISSION and availability.armed
    takes_off &= vehicle.takes_off and not availability.on_ground
    left_m = CLIMB_FIRST_M - availability.height_m
    return max(left_m / section.climb_m_s, 0.0) if takes_off else 0.0


def _is_on_ground(vehicle: Vehicle) -> bool:
    """Return whether a vehicle needs no hold: it is disarmed on the ground or has landed."""
    availability = vehicle.availability
    return availability.touched_down or not (availability.airborne or availability.armed)


def _takes_off(vehicle: Vehicle, order: events.Order) -> bool:
    """Return whether an order leads to a takeoff, and therefore signs off the checks."""
    return order in ("start", "resume", "takeoff") and not vehicle.availability.airborne


def _takeoff_begun(vehicle: Vehicle) -> str:
    """Return the refusal of a takeoff that has already begun; "" if it has not begun."""
    availability, signed_off = vehicle.availability, vehicle.signed_off
    if availability.airborne:
        return "it is in the air: order resume or start"
    if vehicle.start_under_way or (availability.armed and availability.mode == MISSION):
        return "its takeoff has already begun"
    if signed_off is not None and vehicle.start_is_pending:
        return f"{signed_off.by} has already signed off its takeoff"
    return ""


def _ended_mode(vehicle: Vehicle, order: events.Order) -> str:
    """Return which mode of the autopilot or the pilot an order would end."""
    availability = vehicle.availability
    why = (
        "which its autopilot or pilot selected"
        if availability.taken_over
        else "while its autopilot reports a failsafe"
    )
    return f"{order} would end {named_mode(availability.mode)}, {why}"


def _question(vehicle: Vehicle, why: str) -> list[AnyCommand]:
    """Return the reply to an order that needs confirmation."""
    question = f"{CONFIRM} {vehicle.name}: {why}"
    words = f"{question}; repeat the order with confirmation to execute it"
    return [announce(vehicle, words, warning=True)]


def _hold_of(vehicle: Vehicle) -> Hold | HoldAt:
    """Return the command for the ordered hold."""
    return Hold(vehicle.name) if vehicle.hold_at is None else HoldAt(vehicle.name, *vehicle.hold_at)
