"""Events to decisions: who can be counted on, and what the planners decide. No missions yet.

The core flies by this, and ``decide`` runs it alone on a journal.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from firemodel.landscape import Landscape
from mission_service.commands import (
    AnyCommand,
    ClimbAndHold,
    Decided,
    Hold,
    Orbit,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import Scenario
from mission_service.events import (
    SERVICE,
    CommandFinished,
    EstimatorStatusChanged,
    FenceStatusChanged,
    FixTold,
    LinkLost,
    LinkRestored,
    ModeChanged,
    Observed,
    Order,
    Ordered,
    SystemStateChanged,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleEvent,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.guidance.protocol import Decision, Planner, Steered

AIRBORNE_M = 15.0
GOING_HOME = ("return", "land")  # by the bridge's names of modes
MISSION = "mission"
# Modes that our commands lead to, by the bridge's names: any other change of mode in flight was
# made by the autopilot or by its pilot. During an upload ArduPilot is ordered to hold, and PX4
# holds when it finds the new mission unfit.
LEADS_TO: dict[type[AnyCommand], tuple[str, ...]] = {
    StartMission: (MISSION, "guided", "takeoff", "ready"),
    UploadMission: (MISSION, "hold"),
    Hold: ("hold", "guided"),
    Return: ("return",),
    Orbit: ("guided", "orbit", "hold"),
    ClimbAndHold: ("guided", "hold"),
}
ANSWERS: dict[str, type[AnyCommand]] = {
    "start mission": StartMission,
    "hold": Hold,
    "return": Return,
    "orbit": Orbit,
    "climb and hold": ClimbAndHold,
}
UNANSWERED_S = 60.0  # an unanswered command may still change the mode for so long
TAKES_EFFECT_S = 5.0  # and an answered one for so long after its answer
FAILSAFE_STATES = ("critical", "emergency", "flight termination")  # HEARTBEAT.system_status


@dataclass(frozen=True, slots=True)
class Here:
    """Where a vehicle is: on the grid, in metres, and how it moves over the ground."""

    at_s: float
    row: float
    col: float
    x_m: float
    y_m: float
    altitude_m: float
    east_m_s: float
    north_m_s: float


@dataclass(slots=True)
class Presence:
    """Whether a vehicle can be counted on."""

    online: bool = False
    airborne: bool = False
    recalled: bool = False  # on its way home, or told to go
    recalled_on_ground: bool = False  # and not in the air since
    took_off_at_s: float = np.inf
    wind_m_s: float = 0.0
    mode: str = ""  # as told last
    armed: bool = False
    mode_is_ordered: bool = True  # False: its autopilot or its pilot chose the mode
    held_by_upload: bool = False  # nothing but an upload explains why it holds
    system_state: str = ""  # HEARTBEAT.system_status
    fence_breached: bool = False
    fix_good: bool = True
    estimator_healthy: bool = True
    here: Here | None = None
    expected_until_s: dict[type[AnyCommand], float] = field(default_factory=dict)

    @property
    def position_good(self) -> bool:
        """Whether its positions are measured: a fix in three dimensions, a healthy estimator."""
        return self.fix_good and self.estimator_healthy

    @property
    def in_failsafe(self) -> bool:
        """Whether its autopilot reports a failsafe or a breached fence."""
        return self.system_state in FAILSAFE_STATES or self.fence_breached

    @property
    def taken_over(self) -> bool:
        """Its autopilot or its pilot chose the mode: only an operator's order may change it."""
        return self.armed and not self.mode_is_ordered

    @property
    def flies(self) -> bool:
        """Online, in the air at a measured position, in a mode that was ordered, not returning."""
        counted_on = self.online and self.airborne and not self.recalled
        return counted_on and self.position_good and not self.taken_over

    def leading_to(self, mode: str, at_s: float) -> set[type[AnyCommand]]:
        """The kinds of commands under way that lead to this mode."""
        kinds = [kind for kind in self.expected_until_s if self.is_expected(kind, at_s)]
        return {kind for kind in kinds if mode in LEADS_TO[kind]}

    def is_expected(self, kind: type[AnyCommand], at_s: float) -> bool:
        """Whether a command of this kind may still take effect."""
        return at_s <= self.expected_until_s.get(kind, -math.inf)

    def answered(self, kind: type[AnyCommand], at_s: float) -> None:
        """Note an acknowledged command: its mode change follows soon or not at all."""
        if kind in self.expected_until_s:
            self.expected_until_s[kind] = at_s + TAKES_EFFECT_S

    def restart(self) -> None:
        """Reset after a restart of the autopilot; in flight its mode then counts as not ordered.

        The mode stays the last one until another is reported, and an order home stays in force
        while the vehicle is armed. Watchdogs restart autopilots in flight too.
        """
        ordered = self.mode_is_ordered and not self.airborne
        fresh = Presence(self.online, wind_m_s=self.wind_m_s, here=self.here)
        fresh.mode, fresh.armed, fresh.mode_is_ordered = self.mode, self.armed, ordered
        fresh.recalled = self.recalled and self.armed
        fresh.recalled_on_ground = fresh.recalled and self.recalled_on_ground
        for each in fields(self):
            setattr(self, each.name, getattr(fresh, each.name))

    def needs_confirmation(self, order: Order) -> bool:
        """Whether an order would end a mode that the vehicle's autopilot or pilot selected."""
        if not (self.armed and self.airborne):
            return False
        chosen = self.taken_over or (self.in_failsafe and self.mode in GOING_HOME)
        return chosen and (order != "return" or self.mode == "land")


class Steering:
    """What steers a scenario's vehicles, fed with events."""

    def __init__(
        self, scenario: Scenario, landscape: Landscape, planners: Mapping[str, Steered]
    ) -> None:
        self.planners = planners
        self.presence = {section.name: Presence() for section in scenario.vehicles}
        self._landscape = landscape
        self._deploy_at_s = scenario.deploy_at_s
        burn = scenario.burn
        self._airborne_m = AIRBORNE_M if burn is None else burn.drop_height_m / 2.0

    def take(self, event: VehicleEvent) -> Decision | None:
        """Take in one event; the decision it leads to, if any."""
        name, at_s = event.vehicle, event.at_us / 1e6
        presence = self.presence[name]
        match event:
            case Telemetry():
                return self._moved(presence, event)
            case Observed(corrects=True):
                self.planners[name].correct(event)
            case Observed():
                self.planners[name].observe(event)
            case WindMeasured() if presence.airborne:  # on the ground it is a guess
                presence.wind_m_s = event.speed_m_s
                self.planners[name].wind(event.speed_m_s, event.from_deg, at_s)
            case VehicleConnected() | LinkRestored():
                presence.online = True
            case LinkLost():
                presence.online = False
                self.planners[name].left(at_s)
            case VehicleRebooted():
                self.presence[name].restart()
                self.planners[name].left(at_s)
            case ModeChanged():
                self._mode_changed(presence, event)
            case CommandFinished() if event.command in ANSWERS:
                presence.answered(ANSWERS[event.command], at_s)
            case UploadFinished():
                presence.answered(UploadMission, at_s)
            case SystemStateChanged():
                presence.system_state = event.state
                self._look_for_failsafe(name, at_s)
            case FenceStatusChanged():
                presence.fence_breached = event.breached
                self._look_for_failsafe(name, at_s)
            case FixTold():
                self._measured(name, at_s, fix_good=event.good)
            case EstimatorStatusChanged():
                self._measured(name, at_s, estimator_healthy=event.healthy)
            case _:
                pass
        return None

    def recall(self, name: str, at_s: float) -> None:
        """Note an order to return; on the ground it stands until the vehicle is in the air."""
        presence = self.presence[name]
        presence.recalled, presence.recalled_on_ground = True, not presence.airborne
        self.planners[name].left(at_s)

    def sent(self, command: AnyCommand, at_s: float) -> None:
        """Note a command that is sent: the modes that it leads to are expected from now on."""
        if type(command) in LEADS_TO:
            presence = self.presence[command.vehicle]
            presence.expected_until_s[type(command)] = at_s + UNANSWERED_S

    def ordered(self, name: str, event: Ordered) -> bool:
        """Take in an order; whether it is carried out. The mode then counts as ordered."""
        presence = self.presence[name]
        if event.by == SERVICE and not presence.flies:
            return False
        if presence.needs_confirmation(event.order) and not event.confirmed:
            return False
        presence.mode_is_ordered = True
        if event.order == "return":
            self.recall(name, event.at_us / 1e6)
        else:
            presence.recalled = False
        return True

    def aborted(self, name: str) -> bool:
        """Take in an abort; whether the vehicle is ordered to hold now.

        In a mode that its autopilot or pilot selected it holds once that has ended.
        """
        presence = self.presence[name]
        holds_now = not presence.needs_confirmation("hold")
        presence.recalled &= not holds_now
        return holds_now

    def _mode_changed(self, presence: Presence, event: ModeChanged) -> None:
        at_s, before = event.at_us / 1e6, (presence.mode, presence.armed)
        presence.mode, presence.armed = event.mode, event.armed
        if not event.armed:
            presence.airborne = presence.recalled = presence.held_by_upload = False
            presence.recalled_on_ground = False
            presence.mode_is_ordered = True
            presence.expected_until_s.clear()
            self.planners[event.vehicle].left(at_s)
        elif event.mode == MISSION:  # flown by its mission, whatever changed the mode
            if (event.mode, event.armed) != before:  # and not only reported once more
                presence.recalled &= presence.recalled_on_ground
            presence.held_by_upload, presence.mode_is_ordered = False, True
        else:
            changed = (event.mode, event.armed) != before
            if changed:
                self._mode_chosen(presence, event, armed_now=not before[1])
            if event.mode in GOING_HOME and presence.airborne:
                self.recall(event.vehicle, at_s)
            elif changed and presence.taken_over:
                self.planners[event.vehicle].left(at_s)

    def _mode_chosen(self, presence: Presence, event: ModeChanged, armed_now: bool) -> None:
        """Classify a mode of an armed vehicle, other than its mission, as ordered or not."""
        at_s = event.at_us / 1e6
        leading = presence.leading_to(event.mode, at_s)
        arms = armed_now and not presence.airborne and event.mode not in GOING_HOME
        if arms and presence.is_expected(StartMission, at_s):
            leading.add(StartMission)  # it arms first, in the mode in which it stands
        presence.held_by_upload = leading == {UploadMission}
        presence.mode_is_ordered = bool(leading)
        self._look_for_failsafe(event.vehicle, at_s)

    def _look_for_failsafe(self, name: str, at_s: float) -> None:
        """Attribute a hold during an upload to the failsafe that the vehicle reports."""
        presence = self.presence[name]
        if presence.held_by_upload and presence.in_failsafe:
            presence.mode_is_ordered = presence.held_by_upload = False
            self.planners[name].left(at_s)

    def _measured(
        self,
        name: str,
        at_s: float,
        fix_good: bool | None = None,
        estimator_healthy: bool | None = None,
    ) -> None:
        """Note whether positions are measured; if not, the vehicle leaves its planner."""
        presence = self.presence[name]
        was_good = presence.position_good
        if fix_good is not None:
            presence.fix_good = fix_good
        if estimator_healthy is not None:
            presence.estimator_healthy = estimator_healthy
        if was_good and not presence.position_good:
            self.planners[name].left(at_s)

    def _moved(self, presence: Presence, told: Telemetry) -> Decision | None:
        x_m, y_m = self._landscape.xy_of_lat_lon(told.lat_deg, told.lon_deg)
        if not math.isfinite(x_m + y_m):  # too far from the landscape for its projection
            return None
        row, col = (float(value) for value in self._landscape.row_col_of(x_m, y_m))
        at_s = told.at_us / 1e6
        velocity = (told.velocity_east_m_s, told.velocity_north_m_s)
        presence.here = Here(at_s, row, col, x_m, y_m, told.altitude_amsl_m, *velocity)
        # Home may lie on a hill: once up, a vehicle flies until it disarms.
        if not presence.airborne and told.altitude_relative_m >= self._airborne_m:
            presence.airborne, presence.took_off_at_s = True, at_s
            presence.recalled_on_ground = False
            if presence.mode in GOING_HOME:  # told before it was known to be in the air
                self.recall(told.vehicle, at_s)
        if not presence.flies or at_s < self._deploy_at_s:
            return None
        return self.planners[told.vehicle].at(row, col, at_s)


def decided(name: str, planner: Planner, decision: Decision) -> Decided:
    """A decision as it is told and recorded."""
    return Decided(
        name,
        "clockwise" if decision.clockwise else "anticlockwise",
        decision.reversed,
        planner.reversals,
        decision.importance_back,
        decision.importance_front,
        decision.front_cells,
    )
