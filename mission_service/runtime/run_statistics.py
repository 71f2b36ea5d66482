"""Keeps the statistics of a run in memory: tracks (at most 1 Hz), decisions and uploads."""

import math
from collections import Counter, deque
from dataclasses import dataclass, field

from mission_service.commands import (
    AnyCommand,
    ChangeSpeed,
    DirectionDecision,
    Drop,
    Orbit,
    ProposePlan,
    UploadMission,
)
from mission_service.events import (
    AnyEvent,
    DropFinished,
    FireReachedEdge,
    Observed,
    OperatorEvent,
    Resumed,
    Telemetry,
    UploadFinished,
    VehicleEvent,
)
from mission_service.ground_distance import offset_m
from mission_service.ignition_plan import IgnitionPlan
from mission_service.runtime.observation_sources import ObservationSources
from mission_service.runtime.published_states import DropState
from mission_service.runtime.sortie import Sortie
from mission_service.runtime.track import Track
from mission_service.vehicles.availability import AIRBORNE_M

MAX_REVERSALS = 5_000  # latest reversals stored for each vehicle; the journal contains all
# Distinct mission reasons, which may contain user names; further reasons count as OTHER.
MAX_REASONS = 100
OTHER = "other"
RECEIVED_WITHIN_US = 2_000_000  # older positions are not used for the minimum distance


@dataclass
class VehicleStatistics:
    """One vehicle's statistics. A track point is (at_us, lat_deg, lon_deg, altitude_amsl_m)."""

    track: Track = field(default_factory=Track)
    reversals: deque[tuple[int, float, float]] = field(  # at_us, lat_deg, lon_deg
        default_factory=lambda: deque(maxlen=MAX_REVERSALS)
    )
    reversal_count: int = 0
    decisions: int = 0
    direction: str = ""
    uploads: Counter[str] = field(default_factory=Counter)
    upload_reasons: Counter[str] = field(default_factory=Counter)
    orders: Counter[str] = field(default_factory=Counter)  # orbit and speed orders, by kind
    fix: tuple[int, float, float, float] | None = None
    plans: dict[str, IgnitionPlan] = field(default_factory=dict)  # proposed plans by hash
    drops: list[DropState] = field(default_factory=list)
    sortie: Sortie = field(default_factory=Sortie)


@dataclass(frozen=True, slots=True)
class ClosestPair:
    """The minimum 3-D distance between two airborne vehicles."""

    distance_m: float
    at_us: int
    vehicles: tuple[str, str]


class RunStatistics:
    """The statistics of a run, computed from its events and commands."""

    def __init__(self, names: tuple[str, ...], start_us: int, sources: ObservationSources) -> None:
        self.vehicles = {name: VehicleStatistics() for name in names}
        self.at_us = start_us
        self.telemetry = 0
        self.observations = 0
        self.sources = sources
        self.closest: ClosestPair | None = None
        self._in_air: dict[str, Telemetry] = {}
        self.requests: Counter[str] = Counter()  # operators' requests, by event name
        self.restarts = 0  # restarts of the service
        self.alarms: Counter[str] = Counter()  # alarms raised, by kind; the state view counts them

    def apply(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        """Process an event and its commands."""
        self.at_us = max(self.at_us, event.at_us)
        self.sources.apply(event)
        if isinstance(event, Resumed):
            self.restarts += 1
        elif isinstance(event, FireReachedEdge):
            pass  # not an operator's request; the alarm is counted instead
        elif isinstance(event, OperatorEvent):
            self.requests[type(event).__name__] += 1
        else:
            self._happened(self.vehicles[event.vehicle], event)
        for command in commands:
            self._commanded(self.vehicles[command.vehicle], command)

    def _happened(self, vehicle: VehicleStatistics, event: VehicleEvent) -> None:
        vehicle.sortie.on_event(event)
        match event:
            case Telemetry():
                self.telemetry += 1
                fix = (event.at_us, event.lat_deg, event.lon_deg, event.altitude_amsl_m)
                vehicle.fix = fix
                self._compare(event)
                vehicle.track.append_point(fix)
            case Observed():
                self.observations += 1
            case UploadFinished():
                vehicle.uploads[event.outcome] += 1
            case DropFinished():
                for drop in reversed(vehicle.drops):
                    if (drop.plan_hash, drop.number) == (event.plan_hash, event.number):
                        drop.outcome = event.outcome
                        break
            case _:
                pass

    def is_in_air(self, name: str) -> bool:
        """Return whether the vehicle was in the air at its last position."""
        return name in self._in_air

    def _compare(self, fix: Telemetry) -> None:
        """Update the minimum distance; other vehicles are extrapolated by their velocity."""
        self._in_air.pop(fix.vehicle, None)
        if fix.altitude_relative_m < AIRBORNE_M:
            return
        for other in self._in_air.values():
            late_us = fix.at_us - other.at_us
            if late_us > RECEIVED_WITHIN_US:
                continue
            distance_m = _distance_m(fix, other, late_us / 1e6)
            if self.closest is None or distance_m < self.closest.distance_m:
                pair = (other.vehicle, fix.vehicle)
                self.closest = ClosestPair(distance_m, fix.at_us, pair)
        self._in_air[fix.vehicle] = fix

    def _commanded(self, vehicle: VehicleStatistics, command: AnyCommand) -> None:
        vehicle.sortie.on_commands(command)
        match command:
            case DirectionDecision():
                vehicle.decisions += 1
                vehicle.direction = command.direction
                vehicle.reversal_count += command.reversed
                if command.reversed and vehicle.fix is not None:
                    vehicle.reversals.append(vehicle.fix[:3])
            case UploadMission():
                reasons = vehicle.upload_reasons
                known = command.why in reasons or len(reasons) < MAX_REASONS
                reasons[command.why if known else OTHER] += 1
            case Orbit() | ChangeSpeed():
                vehicle.orders[type(command).__name__] += 1
            case ProposePlan():
                vehicle.plans[command.plan_hash] = command.plan
            case Drop():
                named = (command.vehicle, command.plan_hash, command.number)
                place = (command.lat_deg, command.lon_deg)
                vehicle.drops.append(DropState(self.at_us, *named, *place))
            case _:
                pass


def _distance_m(fix: Telemetry, other: Telemetry, later_s: float) -> float:
    """Return the distance between two vehicles, the second extrapolated by ``later_s``."""
    places = (fix.lat_deg, fix.lon_deg), (other.lat_deg, other.lon_deg)
    north_m, east_m = offset_m(*places)
    north_m += later_s * other.velocity_north_m_s
    east_m += later_s * other.velocity_east_m_s
    return math.hypot(north_m, east_m, other.altitude_amsl_m - fix.altitude_amsl_m)
