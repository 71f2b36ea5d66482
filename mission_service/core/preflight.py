"""Decides from the pre-flight checks whether a vehicle may take off, and reports the checks.

A person's order to start a vehicle on the ground is a sign-off of its checks. The sign-off ends
when a check fails that the person has not overridden, when the vehicle is held, ordered home or
disarmed, and when its autopilot or the service is restarted. The vehicle then waits for another
order. Burns have no sign-off: their checklist and the approval of the plan take its place.
"""

from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.airspace.occupied_space import MissionPlace
from mission_service.commands import (
    AnyCommand,
    ClearAlarm,
    PreflightCheck,
    RaiseAlarm,
    ReportChecks,
)
from mission_service.config.scenario import Scenario
from mission_service.core.airspace_guard import AirspaceGuard
from mission_service.core.energy_watch import EnergyWatch
from mission_service.core.other_aircraft import OtherAircraft
from mission_service.core.return_ground import ReturnGround
from mission_service.vehicles.preflight_checks import (
    BATTERY,
    DELAY_AUTOSTART,
    NEVER_OVERRIDDEN,
    Departure,
    checks_of,
    failing,
    in_words,
)
from mission_service.vehicles.preflight_state import SignOff
from mission_service.vehicles.vehicle_state import Vehicle, announce

PREFLIGHT = "preflight"
EVERY_S, REPORT_EVERY_S = 1.0, 10.0
# The events that cause an immediate computation of the checks.
CHANGES = (
    events.VehicleConnected,
    events.LinkLost,
    events.LinkRestored,
    events.VehicleRebooted,
    events.ModeChanged,
    events.BatteryUpdated,
    events.GpsFixChanged,
    events.EstimatorStatusChanged,
    events.SystemStateChanged,
    events.FenceStatusChanged,
    events.RemoteIdChanged,
    events.ParametersReported,
    events.UploadFinished,
    events.MissionReadBack,
)


class Preflight:
    """The pre-flight checks of all vehicles; the vehicles store the state."""

    def __init__(
        self,
        scenario: Scenario,
        landscape: Landscape,
        energy: EnergyWatch,
        airspace: AirspaceGuard,
        return_ground: ReturnGround,
        aircraft: OtherAircraft | None,
    ) -> None:
        self._applies = not scenario.way.prescribed
        self._requires_remote_id = scenario.preflight.remote_id
        self._landscape = landscape
        self._energy = energy
        self._airspace = airspace
        self._return_ground = return_ground
        self._aircraft = aircraft

    def watch(self, vehicle: Vehicle, event: events.VehicleEvent) -> list[AnyCommand]:
        """Update and report the checks after an event; end a sign-off if a check fails."""
        state, at_s = vehicle.preflight, event.at_us / 1e6
        if not self._applies:
            return []
        if vehicle.availability.airborne:
            vehicle.signed_off, state.checks = None, ()  # the takeoff has begun
            return [*self._alarm(vehicle, ""), *_reported(vehicle, at_s)]
        if isinstance(event, events.Telemetry):
            if 0.0 <= at_s - state.computed_at_s < EVERY_S:
                return []
        elif not isinstance(event, CHANGES):
            return []
        self._compute(vehicle, at_s)
        ended = [] if vehicle.availability.armed else self._end_sign_off(vehicle)
        if not vehicle.start_is_pending and not vehicle.availability.armed:
            ended += self._alarm(vehicle, "")
        return [*ended, *_reported(vehicle, at_s)]

    def obstacle(self, vehicle: Vehicle, event: events.OrderGiven) -> str:
        """Return why an order does not start a vehicle on the ground; "" if it is a sign-off."""
        if not self._applies:
            return ""
        failed = failing(self._compute(vehicle, event.at_us / 1e6))
        final = [check for check in failed if check.name in NEVER_OVERRIDDEN]
        if final:
            return f"{in_words(final)}; this check cannot be overridden"
        if failed and not event.override:
            return f"{in_words(failed)}; or order takeoff with a reason to override the checks"
        return ""

    def sign_off(self, vehicle: Vehicle, event: events.OrderGiven) -> list[AnyCommand]:
        """Record that a person signs off the checks of a vehicle on the ground."""
        vehicle.waits_for_operator = False
        if not self._applies:
            return []
        overridden = tuple(check.name for check in failing(vehicle.preflight.checks))
        vehicle.signed_off = SignOff(event.by, overridden)
        vehicle.energy.flies_on = BATTERY in overridden
        if not overridden:
            return []
        words = f"{', '.join(overridden)} overridden by {event.by}: {event.override}"
        return [announce(vehicle, words, warning=True)]

    def permits_start(self, vehicle: Vehicle, at_s: float) -> tuple[bool, list[AnyCommand]]:
        """Return whether a vehicle on the ground may start now, and what is announced."""
        if not self._applies:
            return True, []
        failed = failing(self._compute(vehicle, at_s))
        if vehicle.signed_off is not None:
            ended = self._end_sign_off(vehicle)
            return not ended, ended
        delaying = [check for check in failed if check.name in DELAY_AUTOSTART]
        if delaying:
            return False, self._alarm(vehicle, f"start delayed: {in_words(delaying)}")
        words = f"started by the scenario although a check fails: {in_words(failed)}"
        return True, self._alarm(vehicle, words if failed else "")

    def _compute(self, vehicle: Vehicle, at_s: float) -> tuple[PreflightCheck, ...]:
        state, fix, aircraft = vehicle.preflight, vehicle.availability.fix, self._aircraft
        ground_amsl_m = None
        if fix is not None and self._landscape.elevation_m is not None:
            ground_amsl_m = float(self._landscape.elevation_at(fix.x_m, fix.y_m))
        places, goal_m = self._airspace.mission_and_return(vehicle)
        over_ground = self._return_ground.from_mission(vehicle, places, goal_m)
        return_height_m = self._energy.return_height_m(vehicle)
        departure = Departure(
            at_s,
            self._energy.wind_m_s(vehicle, at_s),
            return_height_m,
            max(return_height_m, self._greatest_height_m(vehicle, places)),
            ground_amsl_m,
            self._airspace.departure_obstacle(vehicle, at_s),
            aircraft is not None,
            None if aircraft is None else aircraft.nearest(vehicle.name),
            self._requires_remote_id,
            None if over_ground is None else over_ground.clearance_m,
            "" if over_ground is None else over_ground.remedy,
        )
        state.checks, state.computed_at_s = checks_of(vehicle, departure), at_s
        return state.checks

    def _greatest_height_m(self, vehicle: Vehicle, places: tuple[MissionPlace, ...]) -> float:
        """Return the greatest height above home in a mission, or else the planned altitude."""
        if not places or self._landscape.elevation_m is None:
            return vehicle.section.altitude_agl_m
        home_amsl_m = float(self._landscape.elevation_at(*vehicle.home_m))
        return max(place.position[2] for place in places) - home_amsl_m

    def _end_sign_off(self, vehicle: Vehicle) -> list[AnyCommand]:
        """End a sign-off if a check fails that was not overridden."""
        signed_off = vehicle.signed_off
        if signed_off is None:
            return []
        failed = failing(vehicle.preflight.checks)
        new = [check for check in failed if check.name not in signed_off.overridden]
        if not new:
            return []
        vehicle.end_intentions()
        words = f"the sign-off by {signed_off.by} is void, and a new one is needed: {in_words(new)}"
        return [announce(vehicle, words, warning=True)]

    @staticmethod
    def _alarm(vehicle: Vehicle, words: str) -> list[AnyCommand]:
        """Raise and announce the alarm about an automatic start, or clear it."""
        state = vehicle.preflight
        if words == state.alarm:
            return []
        state.alarm = words
        if not words:
            return [ClearAlarm(vehicle.name, PREFLIGHT)]
        alarm = RaiseAlarm(vehicle.name, PREFLIGHT, words)
        return [announce(vehicle, words, warning=True), alarm]


def _reported(vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
    """Report the checks when a result changes, and changed figures every few seconds."""
    state = vehicle.preflight
    signed_off_by = "" if vehicle.signed_off is None else vehicle.signed_off.by
    waits = vehicle.waits_for_operator and not vehicle.availability.airborne
    now = (state.checks, waits, signed_off_by)
    if now == state.reported:
        return []
    same = _results(now[0]) == _results(state.reported[0]) and now[1:] == state.reported[1:]
    if same and 0.0 <= at_s - state.reported_at_s < REPORT_EVERY_S:
        return []
    state.reported, state.reported_at_s = now, at_s
    return [ReportChecks(vehicle.name, *now)]


def _results(checks: tuple[PreflightCheck, ...]) -> list[tuple[str, str]]:
    return [(check.name, check.state) for check in checks]
