"""Flight of a burn: a line is proposed, approved, flown, and dropped sphere by sphere.

planning --> proposed --approved, all GO--> approved --its mission is flown--> flying
flying --at the path's end--> planning; --anything amiss--> climbing --safe height--> planning
waiting: nothing is planned before somebody wants it (an abort, a hand on the vehicle).
No drop is in a mission on board: each is ordered here while everything that must hold holds.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape import Landscape
from mission_service.burn.approval import Approvals
from mission_service.burn.checklist import Checklist
from mission_service.burn.drops import Account
from mission_service.burn.fire_state import BelievedFire, toward
from mission_service.burn.plan import IgnitionPlan
from mission_service.burn.timetable import Timetable
from mission_service.commands import AnyCommand, ClimbAndHold, Propose, Withdraw
from mission_service.config import Scenario
from mission_service.config_sections import BurnSection
from mission_service.events import (
    Aborted,
    Answered,
    Approved,
    BatteryTold,
    CrewEvent,
    DropFinished,
    FixTold,
    LinkLost,
    ModeChanged,
    Observed,
    PersonTold,
    PlanWanted,
    Rejected,
    Resumed,
    UnitTold,
    VehicleEvent,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.fire_setup import weather_of
from mission_service.missions_sent import MissionsSent
from mission_service.planners.protocol import Decision
from mission_service.steering import Here
from mission_service.vehicle import Vehicle, say

Floats = NDArray[np.float64]
Phase = Literal["waiting", "planning", "proposed", "approved", "flying", "climbing", "complete"]

HIGH_SHARE = 0.9  # of the safe height: high enough
CLIMB_AGAIN_S = 5.0
LOOK_EVERY_S = 1.0  # whether the rest of the path is still safe
BEGINS_ON_GROUND_S, BEGINS_IN_AIR_S = 30.0, 15.0  # after the proposal, as planned
OFF_PATH_M = 15.0
AT_END_M = 3.0
WIND_FOR = 3  # measurements in a row that must differ before the wind counts as changed
CALM_M_S = 1.0  # below it the direction of the wind says nothing
LOW_SHARE, HIGH_BAND_SHARE, FAST_SHARE = 0.6, 1.5, 1.5  # of the plan's height and speed, at drops
LED_IN = ("mission", "hold", "guided", "takeoff")  # not by somebody's hand


@dataclass(slots=True)
class Flown:
    """The plan that is approved, on its way."""

    plan: IgnitionPlan
    table: Timetable
    targets_m: Floats  # (m, 2)
    next_drop: int = 0
    sent: bool = False
    looked_at_s: float = -math.inf


class BurnFlight:
    """Leads the one vehicle of a burn."""

    def __init__(self, scenario: Scenario, landscape: Landscape, missions: MissionsSent) -> None:
        assert scenario.burn is not None  # by the scenario's own check
        self.burn: BurnSection = scenario.burn
        self.landscape = landscape
        self.phase: Phase = "planning"
        self.unit = unit_of(self.burn, landscape)
        self.fire = BelievedFire(self.burn, landscape, weather_of(scenario))
        self.approvals = Approvals(self.burn)
        self.checklist = Checklist(self.burn.go_items)
        self.account = Account(self.burn.spheres)
        self.area_left = self.unit.area
        self.line = 1
        self._missions = missions
        self._vehicle: Vehicle | None = None
        self._name = scenario.vehicles[0].name
        self._found: LinePlan | None = None
        self._flown: Flown | None = None
        self._after_climb: Phase = "planning"
        self._mode, self._armed, self._fix_good = "", False, True
        self._battery_pct: float | None = None
        self._climbed_at_s = -math.inf
        self._winds: list[WindMeasured] = []

    # What comes in ----------------------------------------------------------------------------

    def told(self, event: CrewEvent) -> list[AnyCommand]:
        """What a person did or said."""
        self.approvals.heard(event)
        changed = self.fire.take(event)
        match event:
            case PersonTold() | UnitTold():
                return self._unit_told(event)
            case Answered():
                return self._answered(event)
            case PlanWanted():
                return self._plan_wanted(event)
            case Approved():
                return self._approved(event)
            case Rejected() if event.plan_hash == self.approvals.plan_hash:
                return self._stop(f"rejected by {event.by}", "waiting")
            case Aborted():
                self.checklist.take(event)
                return self._stop(f"aborted by {event.by}", "waiting", always=True)
            case Resumed():
                self.checklist.take(event)
                return self._stop(f"the service was down for {event.down_s:.0f} s", "planning")
            case _:
                return self._changed(event.at_us / 1e6) if changed else []

    def heard(self, vehicle: Vehicle, event: VehicleEvent) -> list[AnyCommand]:
        """Take note of the link, the mode, the position, the battery and what was dropped."""
        self._vehicle = vehicle
        at_s = event.at_us / 1e6
        match event:
            case ModeChanged():
                return self._mode_changed(vehicle, event)
            case LinkLost():
                return self._stop("the link is lost", "planning")
            case VehicleRebooted():
                self.checklist.clear("the autopilot was restarted")
                return self._stop("the autopilot was restarted", "planning")
            case FixTold():
                self._fix_good = event.good
                return [] if event.good else self._stop(f"its position is lost ({event.fix})")
            case BatteryTold():
                return self._battery_told(vehicle, event)
            case DropFinished():
                return self._dropped(vehicle, event)
            case WindMeasured():
                return self._wind_measured(vehicle, event)
            case Observed() if self.fire.take(event):
                return self._changed(at_s)
            case _:
                return []

    # The fire, the unit and the wind ----------------------------------------------------------

    def _unit_told(self, event: PersonTold | UnitTold) -> list[AnyCommand]:
        self.unit = self.unit.told(event, self.landscape)
        if isinstance(event, UnitTold):
            self.area_left = shapely.intersection(self.area_left, self.unit.area)
        return self._changed(event.at_us / 1e6)

    def _wind_measured(self, vehicle: Vehicle, event: WindMeasured) -> list[AnyCommand]:
        """Wind that stays unlike the one planned for is the wind from now on."""
        plan = self.approvals.plan
        if plan is None or not vehicle.presence.airborne:
            return []
        self._winds.append(event)
        if not self._wind_differs(plan, event.speed_m_s, event.from_deg):
            self._winds = []
        if len(self._winds) < WIND_FOR:
            return []
        speed_m_s, from_deg = mean_wind([(each.speed_m_s, each.from_deg) for each in self._winds])
        self._winds = []
        self.fire.blow(speed_m_s, from_deg, event.at_us / 1e6)
        return self._changed(event.at_us / 1e6)

    def _wind_differs(self, plan: IgnitionPlan, speed_m_s: float, from_deg: float) -> bool:
        if abs(speed_m_s - plan.wind_speed_m_s) > self.burn.wind_changes_m_s:
            return True
        turned_deg = abs((from_deg - plan.wind_from_deg + 180.0) % 360.0 - 180.0)
        blows = min(speed_m_s, plan.wind_speed_m_s) > CALM_M_S
        return blows and turned_deg > self.burn.wind_changes_deg

    def _changed(self, at_s: float) -> list[AnyCommand]:
        """Whatever is proposed or flown must still be right."""
        why = self._why_void(at_s)
        return [] if why is None else self._stop(why)

    def _why_void(self, at_s: float) -> str | None:
        """What speaks against the plan that is proposed or flown, with what is known now."""
        plan = self.approvals.plan
        if plan is None:
            return None
        if plan.digest != self.unit.digest:
            return "the burn unit, its people or its settings are not those of the plan"
        wind = self.fire.weather_at(at_s)
        if self._wind_differs(plan, wind.wind_speed_m_s, wind.wind_from_deg):
            return (
                f"the wind is {wind.wind_speed_m_s:.1f} m/s from {wind.wind_from_deg:.0f}°, the "
                f"plan was for {plan.wind_speed_m_s:.1f} m/s from {plan.wind_from_deg:.0f}°"
            )
        return self._danger_ahead(at_s)

    def _danger_ahead(self, at_s: float) -> str | None:
        """Where the path that is proposed or still ahead would come too near to fire."""
        plan, flown = self.approvals.plan, self._flown
        if plan is None:
            return None
        if flown is not None and self.phase == "flying":
            path = flown.table.ahead(at_s)
        else:
            path = table_of(plan, self.landscape).ahead(max(at_s, plan.begin_us / 1e6))
        path[:, 2] -= self.landscape.elevation_at(path[:, 0], path[:, 1])
        found = first_danger(path, self.hazard(at_s), self.burn)
        return (
            None
            if found is None
            else f"fire is expected too near to the path in {found - at_s:.0f} s"
        )

    def hazard(self, at_s: float) -> Hazard:
        """Where it is dangerous when, as the fire is believed now."""
        key = self.fire.version
        if self._hazard is None or self._hazard[0] != key:
            wind = self.fire.weather_at(at_s)
            velocity = toward(self.landscape, wind.wind_speed_m_s, wind.wind_from_deg)
            found = hazard_of(self.fire.simulation, self.unit, velocity, self.burn)
            self._hazard = (key, found)
        return self._hazard[1]

    # Plans and their approval -----------------------------------------------------------------

    def news(self, vehicle: Vehicle, at_s: float, decision: Decision | None) -> list[AnyCommand]:
        """What time brings: an approval that lapses, a plan that is due."""
        here, at_us = vehicle.presence.here, round(at_s * 1e6)
        if here is None:
            return []
        why = self.approvals.lapsed(at_us)
        plan = self.approvals.plan
        if why is None and self.phase == "proposed" and plan and at_us > plan.valid_until_us:
            why = "not approved in time"
        if why is not None:
            return self._stop(why)
        flown = self._flown
        if self.phase == "approved" and flown is not None and self._flies(vehicle, flown):
            self.phase = "flying"
            return [say(vehicle, f"flies line {flown.plan.line}: {len(flown.plan.drops)} drops")]
        if self.phase == "planning" and self._may_plan(vehicle, here):
            return self._plan(vehicle, here)
        return []

    def _flies(self, vehicle: Vehicle, flown: Flown) -> bool:
        """Whether it flies the mission of the plan, by all that it told."""
        on_board = flown.sent and vehicle.pending is None and vehicle.flown_line is not None
        return on_board and self._armed and self._mode == "mission"

    def _may_plan(self, vehicle: Vehicle, here: Here) -> bool:
        if not self._fix_good or vehicle.going_home:
            return False
        return not vehicle.presence.airborne or self._is_high(here)

    def _plan_wanted(self, event: PlanWanted) -> list[AnyCommand]:
        spacings = {
            "line_spacing_m": event.line_spacing_m or self.burn.line_spacing_m,
            "drop_spacing_m": event.drop_spacing_m or self.burn.drop_spacing_m,
        }
        least_m = self.burn.speed_m_s * 60.0 / self.burn.most_drops_per_min
        if spacings["drop_spacing_m"] < least_m or min(spacings.values()) <= 0.0:
            return self._say(f"spacings are not taken: drops must be at least {least_m:g} m apart")
        self.burn = self.burn.model_copy(update=spacings)
        if self.phase in ("flying", "approved", "climbing"):
            return self._say("a line is being flown: the next plan comes after it")
        self.phase = "planning"
        return self._void("a new plan is wanted")

    def _approved(self, event: Approved) -> list[AnyCommand]:
        refused = self.approvals.approve(event)
        plan = self.approvals.plan
        if refused is not None or plan is None:
            return self._say(f"approval of {event.by} does not count: {refused}", warning=True)
        why = self._why_void(event.at_us / 1e6)
        if why is not None:
            return self._stop(why)
        self._flown = flown_of(plan, self.landscape)
        self.phase = "approved"
        words = f"line {plan.line} approved by {event.by} at {event.station}"
        still = self.checklist.open_items
        if still:
            words += f"; NO-GO until answered: {', '.join(still)}"
        return self._say(words)

    def _answered(self, event: Answered) -> list[AnyCommand]:
        commands = self._say(self.checklist.take(event) or "")
        if not event.go and self.phase in ("approved", "flying"):
            return [*commands, *self._stop(f"NO-GO by {event.by}: {event.item}")]
        if self.checklist.complete and self._reload:
            self._reload = False
            self.account.load(self.burn.spheres)
        return commands

    def _plan(self, vehicle: Vehicle, here: Here) -> list[AnyCommand]:
        """Propose the next line; without one the vehicle goes home."""
        airborne = vehicle.presence.airborne
        begin_s = here.at_s + (BEGINS_IN_AIR_S if airborne else BEGINS_ON_GROUND_S)
        found = next_line(self._situation(vehicle, here, begin_s), self.burn)
        if not isinstance(found, LinePlan):
            self.phase = "complete" if found.complete else "waiting"
            vehicle.going_home = airborne
            return self._say(f"no further line: {found.reason}")
        plan = self._as_data(found, here, begin_s)
        self._found, self.phase = found, "proposed"
        name = self.approvals.propose(plan)
        words = (
            f"line {plan.line} proposed, {name[:12]}: {len(plan.drops)} drops in "
            f"{plan.duration_s:.0f} s, {len(plan.skipped)} skipped as unsafe"
        )
        return [Propose(self._name, plan, name), *self._say(words)]

    def _situation(self, vehicle: Vehicle, here: Here, begin_s: float) -> Situation:
        wind = self.fire.weather_at(begin_s)
        return Situation(
            at_s=begin_s,
            place_m=(here.x_m, here.y_m),
            height_m=self._height_m(here) if vehicle.presence.airborne else 0.0,
            home_m=vehicle.home_m,
            wind_m_s=toward(self.landscape, wind.wind_speed_m_s, wind.wind_from_deg),
            fire=self.fire.simulation,
            unit=self.unit,
            area=self.area_left,
            drops_m=np.array(self.account.fallen_m()).reshape(-1, 2),
            spheres=self.account.left,
            flown_s=here.at_s - vehicle.presence.took_off_at_s
            if vehicle.presence.airborne
            else 0.0,
        )

    # In the air -------------------------------------------------------------------------------

    def first_path(self, vehicle: Vehicle, here: Here) -> Floats | None:
        """That of the plan, once it is approved and the list complete."""
        flown = self._flown
        if self.phase != "approved" or flown is None or flown.sent or not self.checklist.complete:
            return None
        return flown.table.points_m[:, :2]

    def items(self, vehicle: Vehicle, path_m: Floats, here: Here) -> tuple[MissionItem, ...]:
        """The mission of the plan: its path and nothing else."""
        assert self._flown is not None
        self._flown.sent = True
        return mission_items(self._flown.plan, vehicle.section, not vehicle.presence.airborne)

    def lead(self, vehicle: Vehicle, here: Here) -> list[AnyCommand]:
        """Send what is approved, watch and drop what is flown, or climb to the safe height."""
        if not self._fix_good:
            return []
        if self.phase == "flying" and self._flown is not None:
            return self._fly(vehicle, self._flown, here)
        if self.phase == "approved":
            path = self.first_path(vehicle, here)
            if path is None or vehicle.pending is not None or here.at_s < vehicle.not_before_s:
                return []
            items = self.items(vehicle, path, here)
            return [self._missions.upload(vehicle, path, items, here, "fly the line approved")]
        return self._climb(vehicle, here)

    def way_home(self, vehicle: Vehicle, here: Here) -> list[AnyCommand] | None:
        """At the safe height."""
        return None if self._is_high(here) else self._climb(vehicle, here)

    def _climb(self, vehicle: Vehicle, here: Here) -> list[AnyCommand]:
        """To the safe height, straight up, unless somebody's hand is on it."""
        if self._is_high(here):
            vehicle.holding = True
            if self.phase == "climbing":
                self.phase = self._after_climb
            return []
        if self._mode not in LED_IN or here.at_s - self._climbed_at_s < CLIMB_AGAIN_S:
            return []
        self._climbed_at_s = here.at_s
        ground_m = float(self.landscape.elevation_at(here.x_m, here.y_m))
        lat_deg, lon_deg = self.landscape.lat_lon_of(here.x_m, here.y_m)
        altitude_m = round(ground_m + self.burn.safe_height_m, 1)
        return [ClimbAndHold(self._name, float(lat_deg), float(lon_deg), altitude_m)]

    def _is_high(self, here: Here) -> bool:
        return self._height_m(here) >= HIGH_SHARE * self.burn.safe_height_m

    def _height_m(self, here: Here) -> float:
        return here.altitude_m - float(self.landscape.elevation_at(here.x_m, here.y_m))

    def _fly(self, vehicle: Vehicle, flown: Flown, here: Here) -> list[AnyCommand]:
        place_m = np.array([here.x_m, here.y_m, here.altitude_m])
        off_m = flown.table.moved(place_m)
        if off_m > OFF_PATH_M:
            return self._stop(f"it is {off_m:.0f} m off its path")
        if here.at_s - flown.looked_at_s >= LOOK_EVERY_S:
            flown.looked_at_s = here.at_s
            why = self._why_void(here.at_s)
            if why is not None:
                return self._stop(why)
        commands = self._release(vehicle, flown, here)
        if flown.table.left_m <= AT_END_M:
            commands += self._line_done(vehicle, flown)
        return commands

    def _release(self, vehicle: Vehicle, flown: Flown, here: Here) -> list[AnyCommand]:
        """Let go of the next sphere if it would fall on its place now."""
        commands: list[AnyCommand] = []
        while flown.next_drop < len(flown.plan.drops):
            target_m = flown.targets_m[flown.next_drop]
            fall = self._fall(here)
            due = is_due(fall, target_m, here, self.burn)
            if due == "wait":
                break
            flown.next_drop += 1
            if due == "missed":
                words = f"drop {flown.next_drop} of line {flown.plan.line} missed: it is behind"
                commands.append(say(vehicle, words, warning=True))
                continue
            why = self._why_not_drop(flown, fall, here)
            if why is not None:
                words = f"drop {flown.next_drop} of line {flown.plan.line} left out: {why}"
                commands.append(say(vehicle, words, warning=True))
                continue
            commands.append(self._order_drop(flown, fall, here))
            break
        return commands

    def _line_done(self, vehicle: Vehicle, flown: Flown) -> list[AnyCommand]:
        plan = flown.plan
        spheres = self.account.of(self.approvals.plan_hash)
        farthest_m = max((sphere.miss_m for sphere in spheres), default=0.0)
        self.area_left = self._found.area_left if self._found else self.area_left
        self.line += 1
        vehicle.holding = False  # it holds in its mission
        self._end_plan()
        self.phase = "planning"
        return [
            say(
                vehicle,
                f"line {plan.line} done: {len(spheres)} of {len(plan.drops)} dropped, the farthest "
                f"{farthest_m:.1f} m off its place; {self.account.left} spheres left",
            )
        ]

    # What ends a plan -------------------------------------------------------------------------

    def _void(self, why: str) -> list[AnyCommand]:
        """What is proposed or approved no longer is."""
        name = self.approvals.plan_hash
        self._end_plan()
        if not name:
            return []
        return [Withdraw(self._name, name, why), *self._say(f"plan withdrawn: {why}", warning=True)]

    def _end_plan(self) -> None:
        self.approvals.void()
        self._flown = self._found = None
        self._winds = []

    def _stop(self, why: str, then: Phase = "planning", always: bool = False) -> list[AnyCommand]:
        """Withdraw the plan; who is in the air climbs to the safe height and holds.

        ``always``: also where no plan is.
        """
        vehicle, was = self._vehicle, self.phase
        commands = self._void(why)
        if not commands and not always and was not in ("flying", "approved"):
            return []
        if vehicle is None or not vehicle.presence.airborne:
            self.phase = then
            if vehicle is not None:  # it does not take off with what it may have on board
                vehicle.deployed = vehicle.started = False
                vehicle.pending = vehicle.flown_line = vehicle.start_again_at_s = None
            return commands
        vehicle.pending = vehicle.flown_line = None
        self.phase, self._after_climb, self._climbed_at_s = "climbing", then, -math.inf
        here = vehicle.presence.here
        if vehicle.presence.flies and here is not None and self._fix_good:
            commands += self._climb(vehicle, here)
        return commands

    def _mode_changed(self, vehicle: Vehicle, event: ModeChanged) -> list[AnyCommand]:
        self._mode, self._armed = event.mode, event.armed
        if not event.armed:
            if vehicle.started:
                self._reload, vehicle.started = True, False
                self.checklist.clear("it has landed")
            return self._stop("it is disarmed")
        if self.phase == "flying" and event.mode != "mission":
            commands = self._void(f"mode {event.mode} is not ours")
            self.phase = "waiting"
            return commands
        return []

    def _battery_told(self, vehicle: Vehicle, event: BatteryTold) -> list[AnyCommand]:
        self._battery_pct = event.percent
        if event.percent >= self.burn.least_battery_pct or not vehicle.presence.airborne:
            return []
        vehicle.going_home = True
        return self._stop(f"its battery is at {event.percent:.0f} %")

    def _say(self, text: str, warning: bool = False) -> list[AnyCommand]:
        return [Announce(self._name, text, "warning" if warning else "info")] if text else []
