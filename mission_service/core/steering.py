"""From events to decisions: availability of the vehicles and decisions of their planners.

The core turns decisions into missions. ``decide`` runs this part alone on a journal.
"""

import math
from collections.abc import Mapping

from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    AnyCommand,
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
    Ordered,
    SystemStateChanged,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleEvent,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.guidance.protocol import Decision, Steered
from mission_service.position_fix import Here
from mission_service.vehicles.availability import (
    AIRBORNE_M,
    ANSWERS,
    GOING_HOME,
    LEADS_TO,
    MISSION,
    UNANSWERED_S,
    Presence,
)


class Steering:
    """Updates the availability of vehicles by events and asks their planners for decisions."""

    def __init__(
        self,
        scenario: Scenario,
        landscape: Landscape,
        planners: Mapping[str, Steered],
        presence: dict[str, Presence],
    ) -> None:
        self.planners = planners
        self.presence = presence
        self._landscape = landscape
        self._deploy_at_s = scenario.deploy_at_s
        burn = scenario.burn
        self._airborne_m = AIRBORNE_M if burn is None else burn.drop_height_m / 2.0

    def take(self, event: VehicleEvent) -> Decision | None:
        """Apply one event; returns the planner's decision, if any."""
        name, at_s = event.vehicle, event.at_us / 1e6
        presence = self.presence[name]
        match event:
            case Telemetry():
                return self._moved(presence, event)
            case Observed(corrects=True):
                self.planners[name].correct(event)
            case Observed():
                self.planners[name].observe(event)
            case WindMeasured() if presence.airborne:  # on the ground the estimate is unreliable
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
        """Record an order to return; given on the ground it stands until takeoff."""
        presence = self.presence[name]
        presence.recalled, presence.recalled_on_ground = True, not presence.airborne
        self.planners[name].left(at_s)

    def sent(self, command: AnyCommand, at_s: float) -> None:
        """Record a command that is sent: the modes that it leads to are expected from now on."""
        if type(command) in LEADS_TO:
            presence = self.presence[command.vehicle]
            presence.expected_until_s[type(command)] = at_s + UNANSWERED_S

    def ordered(self, name: str, event: Ordered) -> bool:
        """Apply an order; returns whether it is carried out. Its mode then counts as ordered."""
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
        """Apply an abort; returns whether the vehicle is ordered to hold now.

        In a mode that autopilot or pilot selected, it is ordered to hold when that mode ends.
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
        elif event.mode == MISSION:  # under control, whatever changed the mode
            if (event.mode, event.armed) != before:  # not only reported again
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
            leading.add(StartMission)  # it arms first, before the mode changes
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
        """Record whether positions are reliable; if not, the vehicle leaves its planner."""
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
        # Home may lie on a hill: after takeoff a vehicle counts as airborne until it is disarmed.
        if not presence.airborne and told.altitude_relative_m >= self._airborne_m:
            presence.airborne, presence.took_off_at_s = True, at_s
            presence.recalled_on_ground = False
            if presence.mode in GOING_HOME:  # the mode was reported before the takeoff
                self.recall(told.vehicle, at_s)
        if not presence.flies or at_s < self._deploy_at_s:
            return None
        return self.planners[told.vehicle].at(row, col, at_s)
