"""Guides a burn's vehicle: lines with drops are proposed, approved and flown one by one.

The transitions between phases are:

planning --> proposed --approval--> approved --vehicle flies the mission--> flying
flying --end of the path--> planning; --invalid plan--> climbing --safe height--> planning

In the phase "waiting" (after an abort, a rejection or manual control, and at the end) an operator
must request the next plan. Missions contain no drops: the guidance orders each drop when it is
due, if all conditions for a drop are met.
"""

import math
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    REJECTED,
    Announce,
    AnyCommand,
    Drop,
    ProposePlan,
    WithdrawPlan,
)
from mission_service.config.scenario import Scenario
from mission_service.errors import MissionServiceError, ScenarioError
from mission_service.events import (
    Aborted,
    AnyOperatorEvent,
    Approved,
    BatteryUpdated,
    BurnUnitSet,
    ChecklistAnswered,
    ClearingOrdered,
    DropFinished,
    GpsFixChanged,
    HostTime,
    LinkLost,
    ModeChanged,
    Observed,
    PersonReported,
    PlanRequested,
    Rejected,
    Resumed,
    VehicleEvent,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.fire.estimated_fire import EstimatedFire
from mission_service.fire.scenario_fire import weather_of
from mission_service.guidance.burn.approved_plan import (
    ApprovedPlan,
    approved_plan_of,
)
from mission_service.guidance.burn.burn_state import BurnState
from mission_service.guidance.burn.checklist import Checklist
from mission_service.guidance.burn.due_drops import due_drops
from mission_service.guidance.burn.lines.line_planner import LinePlan, NoPlan
from mission_service.guidance.burn.plan_approval import ApprovalTracker
from mission_service.guidance.burn.plan_mission import mission_items
from mission_service.guidance.burn.plan_validity import (
    WindFrom,
    mean_wind,
    wind_differs,
)
from mission_service.guidance.burn.plan_watch import invalid_reason
from mission_service.guidance.burn.planners import Undecided
from mission_service.guidance.burn.safe_climb import SafeClimb
from mission_service.guidance.protocol import Awaited, Decision, Guidance
from mission_service.position_fix import PositionFix
from mission_service.vehicles.availability import named_mode
from mission_service.vehicles.missions_sent import MissionsSent
from mission_service.vehicles.traffic import TrafficManager
from mission_service.vehicles.vehicle_state import Vehicle, announce

Floats = NDArray[np.float64]
Phase = Literal["waiting", "planning", "proposed", "approved", "flying", "climbing"]

CHECK_EVERY_S, CHECK_PROPOSED_EVERY_S = 1.0, 5.0
BEGINS_ON_GROUND_S, BEGINS_IN_AIR_S = 30.0, 15.0  # from proposal to planned start
OFF_PATH_M = 12.0
AT_END_M = 3.0
WIND_COUNT = 3  # successive measurements that must differ from the planned wind


class BurnFlight(Guidance):
    """The guidance of a burn's only vehicle."""

    def __init__(
        self,
        scenario: Scenario,
        landscape: Landscape,
        spacing: TrafficManager,
        missions: MissionsSent,
    ) -> None:
        assert scenario.burn is not None  # ensured by the scenario's check
        burn, section = scenario.burn, scenario.vehicles[0]
        self.planners = {section.name: Undecided()}
        self.state = BurnState(burn, landscape, weather_of(scenario), section)
        self._refuse_stations_inside()
        self.approvals = ApprovalTracker(burn)
        self.checklist = Checklist(burn.go_items)
        self.phase: Phase = "planning"
        self.complete = False
        self._missions = missions
        self._vehicle: Vehicle | None = None
        self._name = section.name
        self._found: LinePlan | None = None
        self._flown: ApprovedPlan | None = None
        self._after_climb: Phase = "planning"
        self._mode, self._armed, self._fix_good, self._manual_control = "", False, True, False
        self._battery_pct: float | None = None
        self._safe_climb = SafeClimb(self.state)
        self._checked_at_s = -math.inf
        self._reloads = False
        self._winds: list[WindFrom] = []

    def _refuse_stations_inside(self) -> None:
        """Raise ScenarioError if an operator's station is inside the burn unit."""
        for station in self.state.burn.stations:
            x_m, y_m = self.state.landscape.xy_of_lat_lon(station.lat_deg, station.lon_deg)
            if self.state.unit.area.covers(shapely.Point(x_m, y_m)):
                raise ScenarioError(
                    f"burn.stations: {station.name} is inside the burn unit; move it outside"
                )

    # Inputs ----------------------------------------------------------------------------

    def on_operator(self, event: AnyOperatorEvent) -> list[AnyCommand]:
        """Process an operator's request."""
        self.approvals.on_operator_input(event)
        try:
            changed = self.state.fire.apply(event)
        except FireModelError as error:
            return self._announce(f"{REJECTED} {error}", warning=True)
        match event:
            case PersonReported() | BurnUnitSet():
                return self._unit_reported(event)
            case ChecklistAnswered():
                return self._answered(event)
            case PlanRequested():
                return self._plan_requested(event)
            case Approved():
                return self._approved(event)
            case Rejected() if event.plan_hash == self.approvals.plan_hash:
                return self._stop(f"rejected by {event.by}", "waiting")
            case Rejected():
                words = f"{REJECTED} this plan is not proposed; reload the state of the burn"
                return self._announce(words, warning=True)
            case Aborted() | ClearingOrdered():
                return self._aborted(event)
            case Resumed():
                self.checklist.apply(event)
                self._manual_control, self._mode = False, ""
                return self._stop(f"the service was down for {event.down_s:.0f} s", always=True)
            case _:
                return self._changed(event.at_us / 1e6) if changed else []

    def _aborted(self, event: Aborted | ClearingOrdered) -> list[AnyCommand]:
        self.checklist.apply(event)
        why = f"aborted by {event.by}"
        if isinstance(event, ClearingOrdered):
            why = f"airspace clearing ordered by {event.by}"
        words = f"{why}: no further drops; request a plan for the next line"
        return [
            *self._announce(words, warning=True),
            *self._stop(why, "waiting", always=True),
        ]

    def on_vehicle(self, vehicle: Vehicle, event: VehicleEvent) -> list[AnyCommand]:
        """Process a vehicle's event, such as a new mode, a lost link or the result of a drop."""
        self._vehicle = vehicle
        match event:
            case ModeChanged():
                return self._mode_changed(vehicle, event)
            case HostTime():
                self.approvals.host_time(event)
                return self._stop_if(self._why_expired(event.at_us))
            case LinkLost():
                return self._stop("the link was lost")
            case VehicleRebooted():
                self.checklist.clear("the autopilot was restarted")
                return self._stop("the autopilot was restarted")
            case GpsFixChanged():
                self._fix_good = event.good
                return [] if event.good else self._stop(f"the position fix was lost ({event.fix})")
            case BatteryUpdated(percent=percent) if percent is not None:
                return self._battery_reported(vehicle, percent)
            case DropFinished():
                return self._drop_finished(event)
            case WindMeasured() if vehicle.availability.airborne:
                return self._wind_measured(event)
            case Observed():
                self.state.fire.apply(event)  # the periodic check of the plan follows
        return []

    # Fire, unit and wind ----------------------------------------------------------------------

    def _unit_reported(self, event: PersonReported | BurnUnitSet) -> list[AnyCommand]:
        try:
            self.state.unit_reported(event)
        except MissionServiceError as error:
            return self._announce(f"{REJECTED} {error}", warning=True)
        return self._changed(event.at_us / 1e6)

    def _wind_measured(self, event: WindMeasured) -> list[AnyCommand]:
        """Adopt the mean of ``WIND_COUNT`` successive measurements that differ from the plan."""
        plan, wind = self.approvals.plan, (event.speed_m_s, event.from_deg)
        if plan is None:
            return []
        differs = wind_differs(plan, wind, self.state.burn) is not None
        self._winds = [*self._winds, wind] if differs else []
        if len(self._winds) < WIND_COUNT:
            return []
        wind, self._winds = mean_wind(self._winds), []
        self.state.fire.blow(*wind, event.at_us / 1e6)
        return self._changed(event.at_us / 1e6)

    def _changed(self, at_s: float) -> list[AnyCommand]:
        """Check the plan after the fire, unit or wind has changed; withdraw an invalid plan."""
        return self._stop_if(self._why_invalid(at_s))

    def _stop_if(self, why: str | None) -> list[AnyCommand]:
        return [] if why is None else self._stop(why)

    def _why_invalid(self, at_s: float) -> str | None:
        """Return why the current plan is invalid; None if the plan is valid or there is no plan."""
        plan, flown = self.approvals.plan, self._flown if self.phase == "flying" else None
        if plan is None:
            return None
        return invalid_reason(self.state, plan, self._found, flown, self._vehicle, at_s)

    # Plans and approvals ----------------------------------------------------------------------

    def announcements(
        self, vehicle: Vehicle, at_s: float, decision: Decision | None
    ) -> list[AnyCommand]:
        """Check the approval and the plan, or plan the next line; called for each position fix."""
        fix = vehicle.availability.fix
        if fix is None:
            return []
        # The vehicle is on the ground.
        if not (vehicle.availability.airborne or self._armed or vehicle.deployed):
            self.state.calibrate_altitude(fix)
        why = self._why_expired(round(at_s * 1e6))
        if why is None and self.phase in ("proposed", "approved"):
            why = self._check(at_s)
        if why is not None:
            return self._stop(why)
        flown = self._flown
        if self.phase == "approved" and flown is not None and self._flies(vehicle, flown):
            self.phase = "flying"
            words = f"flies line {flown.plan.line}: {len(flown.plan.drops)} drops"
            return [announce(vehicle, words)]
        if self.phase == "planning" and self._may_plan(vehicle, fix):
            return self._plan(vehicle, fix)
        return []

    def _why_expired(self, at_us: int) -> str | None:
        """Return why the plan or its approval has expired; None if neither has expired."""
        expired = "the plan has expired" if self.approvals.is_expired(at_us) else None
        return self.approvals.expiry_reason(at_us) or expired

    def _check(self, at_s: float) -> str | None:
        """Check the plan if a check is due; return why the plan is invalid, or None."""
        every_s = CHECK_PROPOSED_EVERY_S if self.phase == "proposed" else CHECK_EVERY_S
        if at_s - self._checked_at_s < every_s:
            return None
        self._checked_at_s = at_s
        return self._why_invalid(at_s)

    def _flies(self, vehicle: Vehicle, flown: ApprovedPlan) -> bool:
        """Return whether the vehicle reports that it is flying the plan's mission."""
        on_board = flown.sent and vehicle.pending is None and vehicle.flown_line is not None
        return on_board and self._armed and self._mode == "mission"

    def _may_plan(self, vehicle: Vehicle, fix: PositionFix) -> bool:
        if not self._fix_good or self._battery_low or vehicle.going_home or self.complete:
            return False
        return not vehicle.availability.airborne or self._safe_climb.is_high(fix)

    def _plan_requested(self, event: PlanRequested) -> list[AnyCommand]:
        if self.phase in ("flying", "approved", "climbing"):
            words = f"{REJECTED} a line is being flown; the next plan follows when it has ended"
            return self._announce(words, warning=True)
        refused = self.state.set_spacings(event)
        if refused is not None:
            return self._announce(refused, warning=True)
        commands = self._withdraw("a new plan was requested")
        self.phase, self.complete, self._manual_control = "planning", False, False
        return commands

    def _approved(self, event: Approved) -> list[AnyCommand]:
        items = self.checklist.open_items
        refused = (
            self.approvals.refusal(event) if not items else f"{len(items)} checklist items are open"
        )
        plan, given = self.approvals.plan, self.approvals.approval
        if refused is not None or plan is None:
            words = self._announce(f"{REJECTED} approval by {event.by}: {refused}", warning=True)
            repeated = event.plan_hash == self.approvals.plan_hash and given is not None
            return [*words, *self._stop("the approval is uncertain")] if repeated else words
        if given is not None and self.phase in ("approved", "flying"):
            return self._announce(f"line {plan.line} is already approved by {given.by}")
        why = self._why_invalid(event.at_us / 1e6)
        if why is not None:
            words = self._announce(f"{REJECTED} approval by {event.by}", warning=True)
            return [*words, *self._stop(why)]
        self.approvals.approve(event)
        self._flown = approved_plan_of(plan, self.state.landscape)
        self.phase, self._manual_control = "approved", False
        return self._announce(f"line {plan.line} approved by {event.by} at {event.station}")

    def _answered(self, event: ChecklistAnswered) -> list[AnyCommand]:
        commands = self._announce(self.checklist.apply(event) or "")
        if not event.go and self.phase in ("approved", "flying"):
            return [*commands, *self._stop(f"NO-GO by {event.by}: {event.item}")]
        if self.checklist.complete and self._reloads:
            self._reloads = False
            self.state.account.load(self.state.burn.spheres)
        return commands

    def _plan(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Propose the next line; if no line is possible, an airborne vehicle returns home."""
        airborne = vehicle.availability.airborne
        begin_s = fix.at_s + (BEGINS_IN_AIR_S if airborne else BEGINS_ON_GROUND_S)
        found = self.state.next_plan(vehicle, fix, begin_s)
        if isinstance(found, NoPlan):
            self.phase, self.complete = "waiting", found.why == "complete"
            vehicle.going_home = airborne
            return self._announce(f"no further line: {found.words}")
        line, plan = found
        name = self.approvals.propose(plan)
        self._found, self.phase, self._checked_at_s = line, "proposed", fix.at_s
        words = (
            f"line {plan.line} proposed, {name[:12]}: {len(plan.drops)} drops in "
            f"{plan.duration_s:.0f} s, {len(plan.skipped)} skipped as unsafe"
        )
        return [ProposePlan(self._name, plan, name), *self._announce(words)]

    def status(self) -> dict[str, Any]:
        """Return the state of the burn for interfaces."""
        plan, approval = self.approvals.plan, self.approvals.approval
        return {
            "phase": self.phase,
            "line": self.state.line,
            "complete": self.complete,
            "plan_hash": self.approvals.plan_hash,
            "approved_by": None if approval is None else f"{approval.by} at {approval.station}",
            "drops_planned": 0 if plan is None else len(plan.drops),
            "drops_done": len(self.state.account.of_plan(self.approvals.plan_hash)),
            "spheres_left": self.state.account.left,
            "battery_pct": self._battery_pct,
            "position_good": self._fix_good,
            "mode": self._mode,
            "checklist": self.checklist.status(),
            "corrections": self.state.fire.log.status(),
            **self.state.map_shapes(),
        }

    def awaited(self) -> Awaited:
        """Return the plan that awaits approval, if any, and whether checklist items are open."""
        plan = "" if self.approvals.approval is not None else self.approvals.plan_hash
        return Awaited(plan, not self.checklist.complete)

    @property
    def estimated_fire(self) -> EstimatedFire:
        """Return the estimated fire, on which plans are based."""
        return self.state.fire

    # In the air -------------------------------------------------------------------------------

    def first_path(self, vehicle: Vehicle, fix: PositionFix) -> Floats | None:
        """Return the path (n, 2) of the approved plan; None once its mission has been sent."""
        flown = self._flown
        if self.phase != "approved" or flown is None or flown.sent:
            return None
        return flown.progress.points_m[:, :2]

    def items(self, vehicle: Vehicle, path_m: Floats, fix: PositionFix) -> tuple[MissionItem, ...]:
        """Return the mission of the approved plan, with the plan's path but without drops."""
        assert self._flown is not None
        self._flown.sent = True
        plan, on_ground = self._flown.plan, not vehicle.availability.airborne
        path = plan.path[1:] if on_ground else plan.path
        return mission_items(path, plan.speed_m_s, vehicle.section, self.state.burn, on_ground)

    def in_mission(self, name: str) -> bool:
        """Return whether the vehicle is in its mission mode."""
        return self._mode == "mission"

    def lead(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Return commands to send the plan's mission, to drop, or to climb to the safe height."""
        if not self._fix_good:
            return []
        if self.phase == "flying" and self._flown is not None:
            return self._fly(vehicle, self._flown, fix)
        if self.phase == "approved":
            path = self.first_path(vehicle, fix)
            if path is None or vehicle.pending is not None or fix.at_s < vehicle.not_before_s:
                return []
            items = self.items(vehicle, path, fix)
            return [self._missions.upload(vehicle, path, items, fix, "fly the approved line")]
        return self._climb(vehicle, fix)

    def way_home(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand] | None:
        """Return the climb to the safe height before a return home; None at the safe height."""
        return None if self._safe_climb.is_high(fix) else self._climb(vehicle, fix)

    def _fly(self, vehicle: Vehicle, flown: ApprovedPlan, fix: PositionFix) -> list[AnyCommand]:
        off_m = flown.progress.update(np.array([fix.x_m, fix.y_m, self.state.height_m(fix)]))
        off_path = f"the vehicle is {off_m:.0f} m off its path" if off_m > OFF_PATH_M else None
        why = off_path or self._check(fix.at_s)
        if why is not None:
            return self._stop(why)
        commands = self._release(vehicle, flown, fix)
        if flown.progress.remaining_m <= AT_END_M:
            commands += self._line_done(vehicle, flown)
        return commands

    def _release(self, vehicle: Vehicle, flown: ApprovedPlan, fix: PositionFix) -> list[AnyCommand]:
        """Return a warning for each drop skipped now, and the command for a drop that is due."""
        commands: list[AnyCommand] = []
        for due in due_drops(self.state, flown, fix):
            why_not = due.why_not or self._why_no_drop()
            if why_not is None:
                name = self.approvals.plan_hash
                self.state.account.order(due.sphere(name, round(fix.at_s * 1e6)))
                place = self.state.lat_lon(*due.falls_m)
                return [*commands, Drop(self._name, name, due.number, *place)]
            words = f"drop {due.number + 1} of line {flown.plan.line} skipped: {why_not}"
            commands.append(announce(vehicle, words, warning=True))
        return commands

    def _why_no_drop(self) -> str | None:
        """Return why no drop is allowed now; None if drops are allowed."""
        if self.approvals.approval is None or not self.checklist.complete:
            return "the plan is not approved"
        if self._mode != "mission" or not self._armed:
            return f"the vehicle is in {named_mode(self._mode)}"
        return None

    def _drop_finished(self, event: DropFinished) -> list[AnyCommand]:
        sphere = self.state.account.finish(event)
        if sphere is None:
            return []
        if not sphere.counts:
            return self._announce(f"drop {sphere.number + 1} refused: {event.reason}", warning=True)
        ignites_s = sphere.at_us / 1e6 + self.state.burn.ignition_delay_s
        source = (*sphere.falls_m, ignites_s)
        if sphere.plan_hash == self.approvals.plan_hash:
            self.state.fire.hold(source)
        else:  # its line has ended
            self.state.fire.ignite(np.array([source]))
        if event.done:
            return []
        return self._announce(f"drop {sphere.number + 1}: {event.reason}", warning=True)

    def _line_done(self, vehicle: Vehicle, flown: ApprovedPlan) -> list[AnyCommand]:
        spheres = self.state.account.of_plan(self.approvals.plan_hash)
        max_miss_m = max((sphere.max_miss_m for sphere in spheres), default=0.0)
        planned, is_lit = len(flown.plan.drops), bool(spheres or not flown.plan.drops)
        if is_lit and self._found is not None:
            self.state.area_left = self._found.area_left
        self.state.line += is_lit
        self._end_plan()
        self.phase = "planning"
        if not is_lit:
            words = f"line {flown.plan.line}: 0 of {planned} dropped; the line is planned again"
            return self._announce(words, warning=True)
        return self._announce(
            f"line {flown.plan.line} done: {len(spheres)} of {planned} dropped, "
            f"at most {max_miss_m:.1f} m off target; {self.state.account.left} spheres left"
        )

    # End of a plan ----------------------------------------------------------------------------

    def _withdraw(self, why: str) -> list[AnyCommand]:
        """Withdraw the proposed or approved plan, if any."""
        name = self.approvals.plan_hash
        self._end_plan()
        if not name:
            return []
        words = self._announce(f"plan withdrawn: {why}", warning=True)
        return [WithdrawPlan(self._name, name, why), *words]

    def _end_plan(self) -> None:
        self.approvals.withdraw()
        self._flown = self._found = None
        self._winds = []
        self.state.fire.let_go()

    def _stop(self, why: str, then: Phase = "planning", always: bool = False) -> list[AnyCommand]:
        """Withdraw the plan; a vehicle flying the plan climbs to the safe height and holds.

        If ``always``, an airborne vehicle climbs and holds even without a plan. The phase ``then``
        begins when the climb has ended, or at once if no climb is needed.
        """
        vehicle, flew = self._vehicle, self.phase in ("approved", "flying", "climbing")
        commands = self._withdraw(why)
        if vehicle is None or not vehicle.availability.airborne or not (flew or always):
            self.phase = then
            if vehicle is not None and not vehicle.availability.airborne:
                # This reset prevents a takeoff on a mission that may still be on board.
                vehicle.deployed = vehicle.started = False
                vehicle.drop_upload()
                vehicle.flown_line = vehicle.start_again_at_s = None
            return commands
        vehicle.drop_upload()
        vehicle.flown_line = None
        self.phase, self._after_climb = "climbing", then
        self._safe_climb.restart()
        fix = vehicle.availability.fix
        if vehicle.availability.flies and fix is not None and self._fix_good:
            commands += self._climb(vehicle, fix)
        return commands

    def _climb(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Return a vertical climb to the safe height, unless the vehicle is flown manually."""
        if self._safe_climb.is_high(fix) and (self._safe_climb.ordered or self.phase != "climbing"):
            if self.phase == "climbing":
                vehicle.holding, self.phase = True, self._after_climb
            return []
        return [] if self._manual_control else self._safe_climb.order(self._name, fix)

    def _mode_changed(self, vehicle: Vehicle, event: ModeChanged) -> list[AnyCommand]:
        was_armed = self._armed
        self._mode, self._armed = event.mode, event.armed
        if not event.armed and not was_armed:
            return []
        if not event.armed:
            if vehicle.started:
                self._reloads, vehicle.started = True, False
                self.checklist.clear("the vehicle has landed")
            return self._stop("the vehicle was disarmed")
        if event.mode == "mission":
            self._manual_control = False
        elif self.phase == "flying":
            self._manual_control, self.phase = True, "waiting"
            return self._withdraw(f"{named_mode(event.mode)} was not ordered by the service")
        return []

    def _battery_reported(self, vehicle: Vehicle, percent: float) -> list[AnyCommand]:
        self._battery_pct = percent
        if not self._battery_low:
            return []
        vehicle.going_home = vehicle.availability.airborne
        return self._stop(f"the battery is at {percent:.0f} %")

    @property
    def _battery_low(self) -> bool:
        percent = self._battery_pct
        return percent is not None and percent < self.state.burn.min_battery_pct

    def _announce(self, text: str, warning: bool = False) -> list[AnyCommand]:
        return [Announce(self._name, text, "warning" if warning else "info")] if text else []


def burn_flight(guidance: Guidance) -> BurnFlight:
    """Return a run's guidance as a ``BurnFlight``.

    Raises MissionServiceError if the guidance is of another type.
    """
    if not isinstance(guidance, BurnFlight):
        raise MissionServiceError("this run is not a burn")
    return guidance
