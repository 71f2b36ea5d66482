"""The independent interlock, which keeps its own state of the burn and refuses unsafe drops.

The interlock shares neither state nor decisions with the controller that orders drops, so that a
fault in the controller cannot release the interlock. A drop is refused if information is missing.
Pure.
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
    ClearingOrdered,
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
from mission_service.guidance.burn.drop_limits import (
    Circle,
    place_problem,
    planned_drop,
    target_problem,
)
from mission_service.guidance.burn.plan_mission import has_drop
from mission_service.ignition_plan import IgnitionPlan, plan_hash
from mission_service.vehicles.availability import named_mode

POSITION_GOOD_US = 1_500_000
MINUTE_US = 60_000_000
GOING_HOME = ("return", "land")  # the bridge's names for these modes
AIRBORNE_M = 2.0


@dataclass
class _Vehicle:
    """The state that a vehicle has reported; unknown after the autopilot or service restarts."""

    linked: bool = False
    armed: bool = False
    mode: str = ""
    fix: Telemetry | None = None
    battery_pct: float | None = None
    fix_good: bool = False
    used: int = 0  # spheres of the current load whose drops were ordered


@dataclass
class _Plan:
    """A proposed plan and its approval."""

    plan: IgnitionPlan
    proposed_host_us: int | None = None  # time of the proposal on the host's clock
    approved: Approved | None = None
    approved_host_us: int | None = None
    attended_us: int = 0  # time of the last input that shows an approver's presence
    attended_host_us: int | None = None
    why_not: str = "it has no approval"
    over: bool = False  # withdrawn or rejected; can be approved only after a new proposal


class Interlock:
    """The interlock, which checks each drop immediately before it is sent.

    The interlock must receive all events and commands in order. An approval is accepted only if the
    plan was proposed, the station is in the scenario, and the GO/NO-GO checklist is complete. The
    approval remains valid as long as input arrives, at the station of the approval, from its
    operator or from another operator with the role approve. Time limits apply both to mission time
    and to the host's clock. A NO-GO ends the approval.

    An abort, a restart of the service or autopilot, a return home, and a landing also end the
    approval, and reset every item of the GO/NO-GO checklist. Drops are then refused until all items
    are GO and a plan is approved again. Each drop is allowed only once, regardless of its outcome.
    """

    def __init__(self, burn: BurnSection, unit: BaseGeometry | None = None) -> None:
        """Create an interlock; ``unit`` (lon, lat) is the burn unit if a file defines it."""
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
        self._unfinished: dict[tuple[str, int], Drop] = {}
        self._dropped_us: deque[int] = deque()
        self._at_us = 0

    # Inputs --------------------------------------------------------------------------------------

    def apply(self, event: AnyEvent) -> None:
        """Update the state from an event; call ``on_commands`` for the same event afterwards."""
        self._at_us = max(self._at_us, event.at_us)
        if isinstance(event, OperatorEvent):
            self._on_operator(event)
        else:
            self._on_vehicle(event)

    def on_commands(self, commands: Iterable[AnyCommand]) -> None:
        """Update the state from commands.

        Call ``refuses`` for a drop first, and pass the drop to this method afterwards, whatever the
        result.
        """
        for command in commands:
            match command:
                case ProposePlan():
                    self._plans[command.plan_hash] = _Plan(command.plan, self._host_us)
                case WithdrawPlan():
                    self._end(command.plan_hash, f"it was withdrawn: {command.why}")
                case Return():
                    self._restart("the vehicle was sent home")
                case ClimbAndHold():
                    self._void("the vehicle was stopped in flight")
                case Drop():
                    self._order(command)

    def _on_operator(self, event: OperatorEvent) -> None:
        for entry in self._plans.values():
            if entry.approved is not None and _shows_presence(event, entry.approved):
                entry.attended_us, entry.attended_host_us = event.at_us, self._host_us
        match event:
            case Approved():
                self._approve(event)
            case Rejected():
                self._end(event.plan_hash, f"it was rejected by {event.by}")
            case Aborted() | ClearingOrdered():
                cleared = isinstance(event, ClearingOrdered)
                what = "airspace clearing was ordered" if cleared else "the burn was aborted"
                self._restart(f"{what} by {event.by}")
            case Resumed():
                self._restart("the service was restarted")
                self._host_us = None  # the monotonic clock may have restarted
                for entry in self._plans.values():
                    entry.proposed_host_us = None
                for name in self._vehicles:
                    self._forget(name)
            case ChecklistAnswered():
                self._answered(event)
            case PersonReported():
                self._people[event.name] = (event.lat_deg, event.lon_deg, event.radius_m)
            case BurnUnitSet():
                self._areas["burn unit"] = _polygon(event.points)
                self._void("the burn unit was changed")

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
                self._restart("the autopilot was restarted")
            case Telemetry():
                vehicle.fix = event
            case ModeChanged():
                self._mode_changed(vehicle, event)
            case BatteryUpdated(percent=percent) if percent is not None:
                vehicle.battery_pct = percent
            case GpsFixChanged():
                vehicle.fix_good = event.good
            case HostTime():
                self._host_us = event.monotonic_us
            case DropFinished():
                self._unfinished.pop((event.plan_hash, event.number), None)
                if event.refused:
                    vehicle.used = max(0, vehicle.used - 1)

    def _forget(self, name: str, linked: bool = False) -> None:
        """Discard the state that a vehicle has reported; keep the number of spheres used."""
        self._vehicles[name] = _Vehicle(linked, used=self._vehicles[name].used)

    def _mode_changed(self, vehicle: _Vehicle, event: ModeChanged) -> None:
        landed = vehicle.armed and not event.armed
        vehicle.armed, vehicle.mode = event.armed, event.mode
        airborne = vehicle.fix is not None and vehicle.fix.altitude_relative_m > AIRBORNE_M
        if landed:
            vehicle.used = 0  # the GO/NO-GO checklist requires a reload before the next flight
            self._restart("the vehicle has landed")
        elif event.armed and airborne and event.mode in GOING_HOME:
            self._restart(f"the vehicle was recalled (mode {event.mode})")

    def _answered(self, event: ChecklistAnswered) -> None:
        if not event.go:
            self._go.discard(event.item)
            self._void(f'NO-GO for "{event.item}" by {event.by}')
        elif event.station in self._stations:
            self._go.add(event.item)

    def _approve(self, event: Approved) -> None:
        entry = self._plans.get(event.plan_hash)
        if entry is None or entry.over:
            return
        entry.approved = None
        if event.station not in self._stations:
            entry.why_not = f'approved from "{event.station}", which is not an approval station'
        elif not event.by.strip() or event.by == "service":
            entry.why_not = "its approval does not name an operator"
        elif self.open_items:
            entry.why_not = "approved before the GO/NO-GO checklist was complete; approve again"
        else:
            entry.approved, entry.approved_host_us = event, self._host_us
            entry.attended_us, entry.attended_host_us = event.at_us, self._host_us

    def _end(self, plan_hash: str, why: str) -> None:
        """End a plan, so that the plan can no longer be approved."""
        if plan_hash in self._plans:
            entry = self._plans[plan_hash]
            entry.approved, entry.why_not, entry.over = None, why, True

    def _void(self, why: str) -> None:
        """End all approvals."""
        for entry in self._plans.values():
            if entry.approved is not None:
                entry.approved, entry.why_not = None, why

    def _restart(self, why: str) -> None:
        """End all approvals and reset every item of the GO/NO-GO checklist."""
        self._go.clear()
        self._void(f"{why}; answer the GO/NO-GO checklist and approve a plan again")

    def _order(self, drop: Drop) -> None:
        self._dropped_us.append(self._at_us)
        while self._dropped_us[0] <= self._at_us - MINUTE_US:
            self._dropped_us.popleft()
        self._vehicles.setdefault(drop.vehicle, _Vehicle()).used += 1
        self._ordered.setdefault(drop.plan_hash, set()).add(drop.number)
        self._unfinished[drop.plan_hash, drop.number] = drop

    # Outputs -------------------------------------------------------------------------------------

    @property
    def open_items(self) -> tuple[str, ...]:
        """Return the items of the GO/NO-GO checklist that are not GO."""
        return tuple(item for item in self._burn.go_items if item not in self._go)

    def status(self) -> dict[str, Any]:
        """Return the plans that are or can be approved, the open items, and the vehicle states."""
        return {
            "plans": [
                {
                    "plan_hash": name,
                    "plan": msgspec.to_builtins(entry.plan),
                    "approved": msgspec.to_builtins(entry.approved),
                    "why_not": None if entry.approved else entry.why_not,
                    "attended_at_s": entry.attended_us / 1e6 if entry.approved else None,
                    "ordered": sorted(self._ordered.get(name, ())),
                }
                for name, entry in self._plans.items()
                if not entry.over
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

    def unfinished_drops(self) -> list[Drop]:
        """Return the ordered drops that have no reported outcome."""
        return list(self._unfinished.values())

    def refuses(self, drop: Drop, at_us: int) -> str | None:
        """Return why a drop must not be sent at ``at_us``, or None if the drop is allowed."""
        name, entry = f"plan {drop.plan_hash[:12]}", self._plans.get(drop.plan_hash)
        if entry is None:
            return f"{name} was never proposed"
        return (
            self._plan_refuses(name, entry, drop, at_us)
            or self._crew_refuses(name, entry, at_us)
            or self._vehicle_refuses(drop.vehicle, at_us)
            or self._place_refuses(entry.plan, drop)
            or self._payload_refuses(drop.vehicle, at_us)
        )

    def may_drop(self, items: Iterable[MissionItem]) -> bool:
        """Return whether any item of a mission could switch an output."""
        return has_drop(items)

    def _plan_refuses(self, name: str, entry: _Plan, drop: Drop, at_us: int) -> str | None:
        plan = entry.plan
        if plan_hash(plan) != drop.plan_hash:
            return f"{name} does not match the hash in the drop"
        if plan.vehicle != drop.vehicle:
            return f"{name} is for {plan.vehicle}, not for {drop.vehicle}"
        if entry.approved is None:
            return f"{name}: {entry.why_not}"
        elapsed_us = self._elapsed_us(entry.proposed_host_us)
        if at_us > plan.valid_until_us or elapsed_us > plan.valid_until_us - plan.made_at_us:
            return f"{name} was valid until {plan.valid_until_us / 1e6:.0f} s of mission time"
        if all(planned.number != drop.number for planned in plan.drops):
            return f"{name} has no drop {drop.number}"
        if drop.number in self._ordered.get(drop.plan_hash, ()):
            return f"{name}: drop {drop.number} was already ordered"
        return None

    def _crew_refuses(self, name: str, entry: _Plan, at_us: int) -> str | None:
        approved, burn = entry.approved, self._burn
        assert approved is not None
        age_us = max(at_us - approved.at_us, self._elapsed_us(entry.approved_host_us))
        if age_us > burn.approval_s * 1e6:
            return f"{name}: its approval is older than {burn.approval_s:g} s"
        if self.open_items:
            count, first = len(self.open_items), self.open_items[0]
            return f"GO/NO-GO checklist: {count} items open; the first is: {first}"
        absent_us = max(at_us - entry.attended_us, self._elapsed_us(entry.attended_host_us))
        if absent_us > burn.approver_timeout_s * 1e6:
            since = (
                f"for {absent_us / 1e6:.0f} s" if math.isfinite(absent_us) else "since a restart"
            )
            return f"no input from an approver at {approved.station} {since}"
        return None

    def _elapsed_us(self, since_us: int | None) -> float:
        """Return the time elapsed on the host's clock since ``since_us``; infinity if unknown."""
        return math.inf if self._host_us is None or since_us is None else self._host_us - since_us

    def _vehicle_refuses(self, name: str, at_us: int) -> str | None:
        vehicle = self._vehicles.get(name, _Vehicle())
        battery_pct = vehicle.battery_pct
        if not vehicle.linked:
            return f"{name}: link lost"
        if vehicle.fix is None or abs(at_us - vehicle.fix.at_us) > POSITION_GOOD_US:
            return f"{name}: no position in the last {POSITION_GOOD_US / 1e6:g} s"
        if not vehicle.fix_good:
            return f"{name}: no good position fix"
        if battery_pct is None or not battery_pct >= self._burn.min_battery_pct:
            level = "unknown" if battery_pct is None else f"{battery_pct:g} %"
            return f"{name}: battery {level}, at least {self._burn.min_battery_pct:g} % required"
        if not vehicle.armed:
            return f"{name}: not armed"
        if vehicle.mode != "mission":
            return f"{name}: in {named_mode(vehicle.mode)}, not in mode mission"
        return None

    def _place_refuses(self, plan: IgnitionPlan, drop: Drop) -> str | None:
        fix = self._vehicles[drop.vehicle].fix
        assert fix is not None
        return target_problem(self._burn, plan, drop, fix) or place_problem(
            planned_drop(plan, drop), self._areas, self._people
        )

    def _payload_refuses(self, name: str, at_us: int) -> str | None:
        burn = self._burn
        if self._vehicles[name].used >= burn.spheres:
            return f"{name}: all {burn.spheres} spheres of the load are used"
        in_minute = sum(at_us - dropped_us < MINUTE_US for dropped_us in self._dropped_us)
        if in_minute >= burn.max_drops_per_min:
            return f"{in_minute} drops in a minute; at most {burn.max_drops_per_min:g} are allowed"
        return None


def _shows_presence(event: OperatorEvent, approved: Approved) -> bool:
    """Return whether an event shows that an approver is present at the approval's station."""
    if isinstance(event, Resumed) or event.station != approved.station:
        return False
    return event.by == approved.by or event.may_approve


def _polygon(corners: Iterable[tuple[float, float]]) -> shapely.Polygon:
    return shapely.Polygon([(lon_deg, lat_deg) for lat_deg, lon_deg in corners])


def interlock_of(burn: BurnSection, landscape: Landscape) -> Interlock:
    """Return the interlock for a burn, with the unit from the scenario or from the unit's file."""
    if burn.unit_file is None:
        return Interlock(burn)

    def lon_lat(places: NDArray[np.float64]) -> NDArray[np.float64]:
        lat, lon = landscape.lat_lon_of(places[:, 0], places[:, 1])
        return np.column_stack([lon, lat])

    unit = shapely.union_all(read_shapes(burn.unit_file, landscape))
    return Interlock(burn, shapely.transform(unit, lon_lat))
