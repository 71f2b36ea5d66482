"""Updates the vehicles' availability from events, and runs their planners.

The core converts decisions to missions. The command ``mission-service decide`` runs only the
planners, on a journal.
"""

import math
from collections.abc import Callable, Mapping
from typing import ClassVar

from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.commands import AnyCommand, ShowLanding, ShowRelief, UploadMission
from mission_service.config.scenario import Scenario
from mission_service.fire.observed_window import without_speckles
from mission_service.guidance.protocol import Decision, ReadsFronts, Steered
from mission_service.position_fix import PositionFix
from mission_service.vehicles.availability import (
    AIRBORNE_M,
    ANSWERS,
    GOING_HOME,
    LEADS_TO,
    MISSION,
    MeasuredWind,
    VehicleAvailability,
)

STANDS_M_S = 1.0  # a slower vehicle stands on the ground


class DecisionEngine:
    """The part of the core that updates availability and runs the planners."""

    def __init__(
        self,
        scenario: Scenario,
        landscape: Landscape,
        planners: Mapping[str, Steered],
        availability: dict[str, VehicleAvailability],
    ) -> None:
        self.planners = planners
        self.availability = availability
        self._landscape = landscape
        self._deploy_at_s = scenario.deploy_at_s
        burn = scenario.burn
        if scenario.relief is not None:
            for name in scenario.relief.vehicles:
                availability[name].off_task = True
        self._airborne_m = AIRBORNE_M if burn is None else burn.drop_height_m / 2.0

    def apply(self, event: events.VehicleEvent) -> Decision | None:
        """Apply one event and return the planner's decision, or None."""
        availability = self.availability[event.vehicle]
        if isinstance(event, events.Telemetry):
            return self._moved(availability, event)
        change = self._CHANGES.get(type(event))
        if change is not None:
            change(self, availability, event)
        return None

    def recall(self, name: str, at_s: float) -> None:
        """Record an order to return; an order given on the ground is valid until takeoff."""
        availability = self.availability[name]
        availability.recalled, availability.recalled_on_ground = True, not availability.airborne
        self.planners[name].left(at_s)

    def on_command(self, command: AnyCommand, at_s: float) -> None:
        """Record a command that is sent; from now on, the modes that it causes are expected."""
        if type(command) in LEADS_TO:
            self.availability[command.vehicle].on_sent(type(command), at_s)
        elif isinstance(command, ShowLanding):
            self.show_landing(command, at_s)
        elif isinstance(command, ShowRelief):
            self._show_relief(command)

    def show_landing(self, shown: ShowLanding, at_s: float) -> None:
        """Record the phase of a landing; no effect if it is already recorded.

        When a landing begins, the mode counts as commanded, and planners no longer use the vehicle.
        """
        availability = self.availability[shown.vehicle]
        if shown.phase != "none" and availability.landing == "none":
            availability.mode_is_ordered, availability.hold_is_ordered = True, False
            self.planners[shown.vehicle].left(at_s)
        availability.landing = shown.phase

    def _show_relief(self, shown: ShowRelief) -> None:
        """Record a role; a vehicle that takes over a task swaps its planner for the task's."""
        self.availability[shown.vehicle].off_task = shown.role != "on task"
        other, planners = shown.takes_over_from, self.planners
        if other and other != shown.vehicle:
            assert isinstance(planners, dict)  # of a rule with ``relieves``
            planners[shown.vehicle], planners[other] = planners[other], planners[shown.vehicle]

    def apply_restart(self, event: events.Resumed) -> None:
        """Apply a restart of the service, after which no vehicle is connected."""
        for availability in self.availability.values():
            availability.on_service_restart(event.at_us / 1e6 - event.down_s)

    def apply_order(self, name: str, event: events.OrderGiven) -> bool:
        """Apply an order and return whether it is executed; the mode then counts as commanded."""
        availability = self.availability[name]
        if event.by == events.SERVICE and not availability.flies:
            return False
        if availability.needs_confirmation(event.order) and not event.confirmed:
            return False
        if event.order == "land":  # it takes effect when the landing begins
            return True
        availability.mode_is_ordered = True
        availability.hold_is_ordered = event.order in ("hold", "go-around")
        if event.order == "return":
            self.recall(name, event.at_us / 1e6)
        else:
            availability.recalled = False
        return True

    def apply_abort(self, name: str) -> bool:
        """Apply an abort and return whether a hold is commanded now.

        If the autopilot or the pilot has selected the mode, the hold is commanded when that mode
        ends.
        """
        availability = self.availability[name]
        availability.hold_is_ordered = True
        holds_now = not availability.needs_confirmation("hold")
        availability.recalled &= not holds_now
        return holds_now

    def _observed(self, availability: VehicleAvailability, event: events.Observed) -> None:
        planner = self.planners[event.vehicle]
        if event.corrects:
            planner.correct(event)
        elif not (event.distrusted or availability.off_task):
            planner.observe(without_speckles(event))

    def _fronts_estimated(
        self, availability: VehicleAvailability, event: events.FrontsEstimated
    ) -> None:
        planner = self.planners[event.vehicle]
        if isinstance(planner, ReadsFronts):
            planner.on_fronts(event)

    def _wind_measured(self, availability: VehicleAvailability, event: events.WindMeasured) -> None:
        if availability.airborne:  # on the ground the estimate is unreliable
            at_s = event.at_us / 1e6
            availability.measured_wind = MeasuredWind(at_s, event.speed_m_s, event.from_deg)
            if not availability.off_task:
                self.planners[event.vehicle].wind(event.speed_m_s, event.from_deg, at_s)

    def _on_link(
        self,
        availability: VehicleAvailability,
        event: events.VehicleConnected | events.LinkRestored | events.LinkLost,
    ) -> None:
        availability.online = not isinstance(event, events.LinkLost)
        if not availability.online:
            self.planners[event.vehicle].left(event.at_us / 1e6)

    def _rebooted(self, availability: VehicleAvailability, event: events.VehicleRebooted) -> None:
        availability.restart()
        self.planners[event.vehicle].left(event.at_us / 1e6)

    def _answered(
        self,
        availability: VehicleAvailability,
        event: events.CommandFinished | events.UploadFinished,
    ) -> None:
        at_s = event.at_us / 1e6
        if isinstance(event, events.UploadFinished):
            availability.on_acknowledged(UploadMission, event.outcome == "accepted", at_s)
        elif (kind := ANSWERS.get(event.command)) is not None:
            availability.on_acknowledged(kind, event.accepted, at_s)

    def _status_changed(
        self,
        availability: VehicleAvailability,
        event: events.SystemStateChanged | events.FenceStatusChanged,
    ) -> None:
        if isinstance(event, events.SystemStateChanged):
            availability.system_state = event.state
        else:
            availability.fence_breached = event.breached
        self._look_for_override(event.vehicle, event.at_us / 1e6)

    def _mode_changed(self, availability: VehicleAvailability, event: events.ModeChanged) -> None:
        at_s, before = event.at_us / 1e6, (availability.mode, availability.armed)
        availability.mode, availability.armed = event.mode, event.armed
        if not event.armed:
            availability.airborne = availability.recalled = availability.held_by_upload = False
            availability.recalled_on_ground = False
            availability.restarted_in_air = False
            availability.mode_is_ordered = True
            availability.expected_until_s.clear()
            availability.unacknowledged.clear()
            self.planners[event.vehicle].left(at_s)
        elif event.mode == MISSION:  # ordered, even if a pilot selected the mode
            if (event.mode, event.armed) != before:  # not a repeated report
                availability.recalled &= availability.recalled_on_ground
            availability.held_by_upload, availability.mode_is_ordered = False, True
        else:
            changed = (event.mode, event.armed) != before
            ends_return = event.mode == "qrtl" and before[0] == "return"  # by Q_RTL_MODE
            if changed and not ends_return:
                self._mode_chosen(availability, event)
            if event.mode in GOING_HOME and availability.airborne:
                self.recall(event.vehicle, at_s)
            elif changed and availability.taken_over:
                self.planners[event.vehicle].left(at_s)
        availability.accepted_mode = ""

    def _mode_chosen(self, availability: VehicleAvailability, event: events.ModeChanged) -> None:
        """Classify an armed vehicle's mode, other than its mission, as commanded or not."""
        at_s = event.at_us / 1e6
        leading = availability.leading_to(event.mode, at_s)
        availability.held_by_upload = leading == {UploadMission}
        availability.ordered_before_restart &= event.mode == availability.accepted_mode
        availability.mode_is_ordered = bool(leading) or availability.ordered_before_restart
        self._look_for_override(event.vehicle, at_s)

    def _look_for_override(self, name: str, at_s: float) -> None:
        """Attribute a mode to a failsafe or a landing reported by the vehicle.

        The mode is a hold during an upload, or a mode that was ordered before a restart of the
        service.
        """
        availability = self.availability[name]
        landed = availability.ordered_before_restart and availability.on_ground
        landed &= availability.mode not in GOING_HOME  # after these, the vehicle disarms
        if availability.may_be_overridden and (availability.in_failsafe or landed):
            availability.mode_is_ordered = availability.held_by_upload = False
            availability.ordered_before_restart = False
            self.planners[name].left(at_s)

    def _landed_state_changed(
        self, availability: VehicleAvailability, event: events.LandedStateChanged
    ) -> None:
        availability.on_ground = event.state == "on ground"
        self._look_for_override(event.vehicle, event.at_us / 1e6)

    def _position_measured(
        self,
        availability: VehicleAvailability,
        event: events.GpsFixChanged | events.EstimatorStatusChanged,
    ) -> None:
        """Record whether positions are reliable; otherwise exclude the vehicle from planning."""
        was_good = availability.position_good
        if isinstance(event, events.GpsFixChanged):
            availability.fix_good = event.good
        else:
            availability.estimator_healthy = event.healthy
        if was_good and not availability.position_good:
            self.planners[event.vehicle].left(event.at_us / 1e6)

    def _moved(
        self, availability: VehicleAvailability, telemetry: events.Telemetry
    ) -> Decision | None:
        x_m, y_m = self._landscape.xy_of_lat_lon(telemetry.lat_deg, telemetry.lon_deg)
        if not math.isfinite(x_m + y_m):  # too far from the landscape for its projection
            return None
        row, col = (float(value) for value in self._landscape.row_col_of(x_m, y_m))
        at_s = telemetry.at_us / 1e6
        availability.height_m = telemetry.altitude_relative_m
        velocity = (telemetry.velocity_east_m_s, telemetry.velocity_north_m_s)
        availability.fix = PositionFix(
            at_s, row, col, x_m, y_m, telemetry.altitude_amsl_m, *velocity
        )
        stands = not (availability.armed or availability.airborne) and availability.position_good
        if stands and math.hypot(*velocity) < STANDS_M_S:
            availability.ground.include((x_m, y_m), telemetry.altitude_amsl_m, at_s)
        # Home may lie on a hill, so a vehicle counts as airborne from takeoff until it is disarmed.
        # The altitude of a disarmed vehicle may change too, by drift or by transport to a hill.
        is_high = telemetry.altitude_relative_m >= self._airborne_m
        flies = availability.armed and (is_high or availability.restarted_in_air)
        if flies and not availability.airborne:
            if not availability.restarted_in_air:
                availability.took_off_at_s = at_s
            availability.airborne, availability.restarted_in_air = True, False
            availability.recalled_on_ground = False
            if availability.mode in GOING_HOME:  # the mode was reported before the takeoff
                self.recall(telemetry.vehicle, at_s)
        if not availability.flies or availability.off_task or at_s < self._deploy_at_s:
            return None
        return self.planners[telemetry.vehicle].at(row, col, at_s)

    _CHANGES: ClassVar[dict[type[events.VehicleEvent], Callable[..., None]]] = {
        events.Observed: _observed,
        events.FrontsEstimated: _fronts_estimated,
        events.WindMeasured: _wind_measured,
        events.VehicleConnected: _on_link,
        events.LinkRestored: _on_link,
        events.LinkLost: _on_link,
        events.VehicleRebooted: _rebooted,
        events.ModeChanged: _mode_changed,
        events.CommandFinished: _answered,
        events.UploadFinished: _answered,
        events.SystemStateChanged: _status_changed,
        events.FenceStatusChanged: _status_changed,
        events.LandedStateChanged: _landed_state_changed,
        events.GpsFixChanged: _position_measured,
        events.EstimatorStatusChanged: _position_measured,
    }
