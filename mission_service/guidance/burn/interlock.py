"""The second lock on drops: an independent fold of events that gives reasons to refuse a drop.

It shares no state and no decision with the controller that orders drops: a fault there does not
open this lock. Missing information is a reason to refuse. Pure.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.shapes import read_shapes
from mission_service.commands import (
    AnyCommand,
    ClimbAndHold,
    Drop,
    ProposePlan,
    Return,
    WithdrawPlan,
)
from mission_service.config.sections import BurnSection
from mission_service.events import (
    Aborted,
    AnyEvent,
    Approved,
    BatteryUpdated,
    BurnUnitSet,
    ChecklistAnswered,
    DropFinished,
    GpsFixChanged,
    HostTime,
    LinkLost,
    LinkRestored,
    ModeChanged,
    OperatorEvent,
    PersonReported,
    Rejected,
    Resumed,
    Telemetry,
    VehicleConnected,
    VehicleRebooted,
)
from mission_service.ground_distance import distance_m
from mission_service.guidance.burn.plan_mission import has_drop
from mission_service.ignition_plan import IgnitionPlan, plan_hash

POSITION_GOOD_US = 1_500_000
MINUTE_US = 60_000_000
GOING_HOME = ("return", "land")  # by the bridge's names of modes
AIRBORNE_M = 2.0
# A vehicle this far off the drop's place or height is not on the approved plan. The controller
# computes the exact impact (release.py); this lock only tests for gross errors.
LATE_S = 1.0
BESIDE_M = 5.0
HEIGHT_SHARE, MIN_BAND_M = 0.5, 5.0
GRAVITY_M_S2 = 9.81

Circle = tuple[float, float, float]  # lat_deg, lon_deg, radius_m


@dataclass
class _Vehicle:
    """The state of a vehicle; unknown at first, and after a restart of autopilot or service."""

    linked: bool = False
    armed: bool = False
    mode: str = ""
    fix: Telemetry | None = None
    battery_pct: float | None = None
    fix_good: bool = False
    used: int = 0  # spheres of this load


@dataclass
class _Plan:
    """A plan that was proposed, and its approval."""

    plan: IgnitionPlan
    proposed_host_us: int | None = None  # by the host's clock
    approved: Approved | None = None
    approved_host_us: int | None = None
    attended_us: int = 0  # the last input that shows an approver's presence
    attended_host_us: int | None = None
    why_not: str = "nobody has approved it"
    over: bool = False  # withdrawn or rejected: not to be approved unless it is proposed again


class Interlock:
    """Tests each drop right before it is sent. Requires all events and commands in their order.

    An approval counts only for a plan proposed before, from a station of the scenario, with a
    complete GO list; a NO-GO ends it. It holds while the operator that gave it, or another with the
    role approve, gives input at that station. Limits: by mission time and by the host's clock.
    An abort, a restart of service or autopilot, a return home and a landing end it too and open the
    whole list: nothing is dropped until all items are GO and a plan is approved again.
    A drop that was ordered once is never allowed again, whatever its outcome.
    """

    def __init__(self, burn: BurnSection, unit: BaseGeometry | None = None) -> None:
        """``unit`` (lon, lat) is the burn unit if it comes from a file, not from the scenario."""
        self._burn = burn
        self._stations = {station.name for station in burn.stations}
        self._people: dict[str, Circle] = {
            circle.name: (circle.lat_deg, circle.lon_deg, circle.radius_m) for circle in burn.people
        }
        self._areas: dict[str, BaseGeometry] = {
            name: _polygon(corners)
            for name, corners in (("burn unit", burn.unit), ("fence", burn.fence))
            if corners is not None
        }
        if unit is not None:
            self._areas["burn unit"] = unit
        self._go: set[str] = set()
        self._plans: dict[str, _Plan] = {}
        self._host_us: int | None = None
        self._vehicles: dict[str, _Vehicle] = {}
        self._ordered: dict[str, set[int]] = {}
        self._dropped_us: deque[int] = deque()
        self._at_us = 0

    # Inputs --------------------------------------------------------------------------------------

    def apply(self, event: AnyEvent) -> None:
        """Apply an event, before the commands that it caused."""
        self._at_us = max(self._at_us, event.at_us)
        if isinstance(event, OperatorEvent):
            self._on_operator(event)
        else:
            self._on_vehicle(event)

    def on_commands(self, commands: Iterable[AnyCommand]) -> None:
        """Apply commands: drops after ``refuses`` was called, whatever its result."""
        for command in commands:
            match command:
                case ProposePlan():
                    self._propose(command)
                case WithdrawPlan():
                    self._end(command.plan_hash, f"withdrawn: {command.why}")
                case Return():
                    self._restart("sent home since")
                case ClimbAndHold():
                    self._void("stopped in flight since")
                case Drop():
                    self._order(command)
                case _:
                    pass

    def _on_operator(self, event: OperatorEvent) -> None:
        for known in self._plans.values():
            if known.approved is not None and _shows_presence(event, known.approved):
                known.attended_us, known.attended_host_us = event.at_us, self._host_us
        match event:
            case Approved():
                self._approve(event)
            case Rejected():
                self._end(event.plan_hash, f"rejected by {event.by}")
            case Aborted():
                self._restart(f"aborted by {event.by} since")
            case Resumed():
                self._restart("the service was restarted since")
                self._host_us = None  # the monotonic clock may have restarted
                for known in self._plans.values():
                    known.proposed_host_us = None
                for name in self._vehicles:
                    self._forget(name)
            case ChecklistAnswered():
                self._answered(event)
            case PersonReported():
                self._people[event.name] = (event.lat_deg, event.lon_deg, event.radius_m)
            case BurnUnitSet():
                self._areas["burn unit"] = _polygon(event.points)
                self._void("the burn unit was changed since")
            case _:
                pass

    def _on_vehicle(self, event: AnyEvent) -> None:
        assert not isinstance(event, OperatorEvent)
        vehicle = self._vehicles.setdefault(event.vehicle, _Vehicle())
        match event:
            case VehicleConnected() | LinkRestored():
                vehicle.linked = True
            case LinkLost():
                vehicle.linked = False
            case VehicleRebooted():
                self._forget(event.vehicle, linked=True)
                self._restart("the autopilot was restarted since")
            case Telemetry():
                vehicle.fix = event
            case ModeChanged():
                self._mode_changed(vehicle, event)
            case BatteryUpdated():
                vehicle.battery_pct = event.percent
            case GpsFixChanged():
                vehicle.fix_good = event.good
            case HostTime():
                self._host_us = event.monotonic_us
            case DropFinished() if event.refused:
                vehicle.used = max(0, vehicle.used - 1)
            case _:
                pass

    def _forget(self, name: str, linked: bool = False) -> None:
        """Reset a vehicle's state but for the spheres used; it must be reported again."""
        self._vehicles[name] = _Vehicle(linked, used=self._vehicles[name].used)

    def _mode_changed(self, vehicle: _Vehicle, event: ModeChanged) -> None:
        landed = vehicle.armed and not event.armed
        vehicle.armed, vehicle.mode = event.armed, event.mode
        airborne = vehicle.fix is not None and vehicle.fix.altitude_relative_m > AIRBORNE_M
        if landed:
            vehicle.used = 0  # it is loaded before it flies again: an item of the list
            self._restart("landed since")
        elif event.armed and airborne and event.mode in GOING_HOME:
            self._restart(f"recalled since (mode {event.mode})")

    def _answered(self, event: ChecklistAnswered) -> None:
        if not event.go:
            self._go.discard(event.item)
            self._void(f'NO-GO for "{event.item}" by {event.by} since')
        elif event.station in self._stations:
            self._go.add(event.item)

    def _propose(self, command: ProposePlan) -> None:
        self._plans[command.plan_hash] = _Plan(command.plan, self._host_us)

    def _approve(self, event: Approved) -> None:
        known = self._plans.get(event.plan_hash)
        if known is None or known.over:
            return
        known.approved = None
        if event.station not in self._stations:
            known.why_not = f'approved from "{event.station}", which is no station of the scenario'
        elif not event.by.strip() or event.by == "service":
            known.why_not = "approved by nobody who has a name"
        elif self.open_items:
            known.why_not = "approved before the GO list was complete; approve again"
        else:
            known.approved, known.approved_host_us = event, self._host_us
            known.attended_us, known.attended_host_us = event.at_us, self._host_us

    def _end(self, plan_hash: str, why: str) -> None:
        if plan_hash in self._plans:
            known = self._plans[plan_hash]
            known.approved, known.why_not, known.over = None, why, True

    def _void(self, why: str) -> None:
        """End all approvals."""
        for known in self._plans.values():
            if known.approved is not None:
                known.approved, known.why_not = None, why

    def _restart(self, why: str) -> None:
        self._go.clear()
        self._void(f"{why}; it takes a new GO list and a new approval")

    def _order(self, drop: Drop) -> None:
        self._dropped_us.append(self._at_us)
        while self._dropped_us[0] <= self._at_us - MINUTE_US:
            self._dropped_us.popleft()
        self._vehicles.setdefault(drop.vehicle, _Vehicle()).used += 1
        self._ordered.setdefault(drop.plan_hash, set()).add(drop.number)

    # Outputs -------------------------------------------------------------------------------------

    @property
    def open_items(self) -> tuple[str, ...]:
        """Items of the GO list without a GO."""
        return tuple(item for item in self._burn.go_items if item not in self._go)

    def status(self) -> dict[str, Any]:
        """Plans that can be or are approved, the GO list and the vehicles, in this lock's state."""
        return {
            "plans": [
                {
                    "plan_hash": name,
                    "plan": msgspec.to_builtins(known.plan),
                    "approved": msgspec.to_builtins(known.approved),
                    "why_not": None if known.approved else known.why_not,
                    "attended_at_s": known.attended_us / 1e6 if known.approved else None,
                    "ordered": sorted(self._ordered.get(name, ())),
                }
                for name, known in self._plans.items()
                if not known.over
            ],
            "open_items": self.open_items,
            "vehicles": {
                name: {
                    "linked": vehicle.linked,
                    "armed": vehicle.armed,
                    "mode": vehicle.mode,
                    "fix_good": vehicle.fix_good,
                    "battery_pct": vehicle.battery_pct,
                    "spheres_left": max(0, self._burn.spheres - vehicle.used),
                    "position": msgspec.to_builtins(vehicle.fix),
                }
                for name, vehicle in self._vehicles.items()
            },
        }

    def refuses(self, drop: Drop, at_us: int) -> str | None:
        """Why this drop must not be sent at ``at_us``; None if it may."""
        known = self._plans.get(drop.plan_hash)
        if known is None:
            return f"plan {drop.plan_hash[:12]} was never proposed"
        name = f"plan {drop.plan_hash[:12]}"
        return (
            self._plan_refuses(name, known, drop, at_us)
            or self._crew_refuses(name, known, at_us)
            or self._vehicle_refuses(drop.vehicle, at_us)
            or self._place_refuses(known.plan, drop)
            or self._payload_refuses(drop.vehicle, at_us)
        )

    def may_drop(self, items: Iterable[MissionItem]) -> bool:
        """Whether an item of a mission may switch an output."""
        return has_drop(items)

    def _plan_refuses(self, name: str, known: _Plan, drop: Drop, at_us: int) -> str | None:
        plan = known.plan
        if plan_hash(plan) != drop.plan_hash:
            return f"{name} is not what its hash says"
        if plan.vehicle != drop.vehicle:
            return f"{name} is for {plan.vehicle}, not for {drop.vehicle}"
        if known.approved is None:
            return f"{name}: {known.why_not}"
        passed_us = self._passed_us(known.proposed_host_us)
        if at_us > plan.valid_until_us or passed_us > plan.valid_until_us - plan.made_at_us:
            return f"{name} was good until {plan.valid_until_us / 1e6:.0f} s of mission time"
        if all(planned.number != drop.number for planned in plan.drops):
            return f"{name} has no drop {drop.number}"
        if drop.number in self._ordered.get(drop.plan_hash, ()):
            return f"{name}: drop {drop.number} was ordered before"
        return None

    def _crew_refuses(self, name: str, known: _Plan, at_us: int) -> str | None:
        approved, burn = known.approved, self._burn
        assert approved is not None
        given_us = max(at_us - approved.at_us, self._passed_us(known.approved_host_us))
        if given_us > burn.approval_s * 1e6:
            return f"{name}: its approval is older than {burn.approval_s:g} s"
        if self.open_items:
            return f"GO list: {len(self.open_items)} open, the first: {self.open_items[0]}"
        silent_us = max(at_us - known.attended_us, self._passed_us(known.attended_host_us))
        if silent_us > burn.approver_timeout_s * 1e6:
            long = f"for {silent_us / 1e6:.0f} s" if math.isfinite(silent_us) else "since a restart"
            return f"no input of an approver at {approved.station} {long}"
        return None

    def _passed_us(self, since_us: int | None) -> float:
        """Elapsed time by the host's clock; infinite if unknown."""
        return math.inf if self._host_us is None or since_us is None else self._host_us - since_us

    def _vehicle_refuses(self, name: str, at_us: int) -> str | None:
        vehicle = self._vehicles.get(name, _Vehicle())
        battery_pct = vehicle.battery_pct
        if not vehicle.linked:
            return f"{name}: link lost"
        if vehicle.fix is None or abs(at_us - vehicle.fix.at_us) > POSITION_GOOD_US:
            return f"{name}: no position of the last {POSITION_GOOD_US / 1e6:g} s"
        if not vehicle.fix_good:
            return f"{name}: no good position fix"
        if battery_pct is None or not battery_pct >= self._burn.min_battery_pct:
            level = "unknown" if battery_pct is None else f"{battery_pct:g} %"
            return f"{name}: battery {level}, at least {self._burn.min_battery_pct:g} % wanted"
        if not vehicle.armed:
            return f"{name}: not armed"
        if vehicle.mode != "mission":
            return f"{name}: in mode {vehicle.mode or 'unknown'}, not in its mission"
        return None

    def _place_refuses(self, plan: IgnitionPlan, drop: Drop) -> str | None:
        fix = self._vehicles[drop.vehicle].fix
        assert fix is not None
        planned = next(planned for planned in plan.drops if planned.number == drop.number)
        place = (planned.lat_deg, planned.lon_deg)
        ground_m = ground_amsl_m(plan, planned.after_s)
        off_m = distance_m(place, (fix.lat_deg, fix.lon_deg))
        reach_m = self._reach_m(plan)
        if not off_m <= reach_m:
            return f"{drop.vehicle} is {off_m:.0f} m off drop {drop.number} (at most {reach_m:.0f})"
        beside_m = distance_m(place, (drop.lat_deg, drop.lon_deg))
        if not beside_m <= self._burn.max_miss_m:
            return f"drop {drop.number} would fall {beside_m:.1f} m off its place"
        height_m = math.nan if ground_m is None else fix.altitude_amsl_m - ground_m
        band_m = max(MIN_BAND_M, HEIGHT_SHARE * plan.drop_height_m)
        if not abs(height_m - plan.drop_height_m) <= band_m:
            wanted = f"{plan.drop_height_m:.0f} ± {band_m:.0f} m"
            return f"{drop.vehicle} is {height_m:.0f} m over the drop's place, not {wanted}"
        for name, area in self._areas.items():
            if not shapely.contains_xy(area, place[1], place[0]):
                return f"drop {drop.number} lies outside the {name}"
        for name, (lat_deg, lon_deg, radius_m) in self._people.items():
            if radius_m > 0.0 and distance_m(place, (lat_deg, lon_deg)) <= radius_m:
                return f"drop {drop.number} lies within {radius_m:.0f} m of {name}"
        return None

    def _reach_m(self, plan: IgnitionPlan) -> float:
        """The largest distance between release and impact: a sphere flies on while it falls."""
        fall_s = math.sqrt(2.0 * plan.drop_height_m / GRAVITY_M_S2)
        on_way_s = self._burn.dropper.delay_s + fall_s + LATE_S
        fastest_m_s = max(plan.speed_m_s, plan.wind_speed_m_s)
        return fastest_m_s * on_way_s + self._burn.max_miss_m + BESIDE_M

    def _payload_refuses(self, name: str, at_us: int) -> str | None:
        burn = self._burn
        if self._vehicles[name].used >= burn.spheres:
            return f"{name}: all {burn.spheres} spheres of the load were ordered"
        of_minute = sum(at_us - dropped_us < MINUTE_US for dropped_us in self._dropped_us)
        if of_minute >= burn.max_drops_per_min:
            return f"{of_minute} drops in a minute; at most {burn.max_drops_per_min:g}"
        return None


def _shows_presence(event: OperatorEvent, approved: Approved) -> bool:
    """Whether an event counts as presence of an approver."""
    if isinstance(event, Resumed) or event.station != approved.station:
        return False
    return event.by == approved.by or event.may_approve


def ground_amsl_m(plan: IgnitionPlan, after_s: float) -> float | None:
    """The ground's altitude by a plan's path at a time; None after the end of the path."""
    for start, end in zip(plan.path, plan.path[1:], strict=False):
        if start.after_s <= after_s <= end.after_s:
            share = (after_s - start.after_s) / max(end.after_s - start.after_s, 1e-9)
            ground_m = [point.altitude_amsl_m - point.height_m for point in (start, end)]
            return ground_m[0] + share * (ground_m[1] - ground_m[0])
    return None


def _polygon(corners: Iterable[tuple[float, float]]) -> shapely.Polygon:
    return shapely.Polygon([(lon_deg, lat_deg) for lat_deg, lon_deg in corners])


def interlock_of(burn: BurnSection, landscape: Landscape) -> Interlock:
    """The independent lock of a burn, with the unit from the scenario or from its file."""
    if burn.unit_file is None:
        return Interlock(burn)

    def lon_lat(places: NDArray[np.float64]) -> NDArray[np.float64]:
        lat, lon = landscape.lat_lon_of(places[:, 0], places[:, 1])
        return np.column_stack([lon, lat])

    unit = shapely.union_all(read_shapes(burn.unit_file, landscape))
    return Interlock(burn, shapely.transform(unit, lon_lat))
