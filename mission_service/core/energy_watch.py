"""Updates and reports the estimate of each vehicle's energy, and raises alarms about it. Pure.

Alarms: ``energy`` if little time is left, severe if the energy does not suffice for the flight
home; ``overdue`` (severe) if the vehicle should fly home but does not because an operator's hold, a
mode that its autopilot or pilot selected, or a missing position prevents the order to return.
"""

import math

from autopilot_bridge.stacks.return_flight import true_airspeed_factor
from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.commands import AnyCommand, ClearAlarm, RaiseAlarm, ReportEnergy
from mission_service.config.scenario import Scenario
from mission_service.fire.scenario_fire import weather_of
from mission_service.guidance.registry import way_of
from mission_service.vehicles.availability import (
    GOING_HOME,
    WIND_IS_FRESH_S,
    MeasuredWind,
    VehicleAirData,
    named_mode,
)
from mission_service.vehicles.endurance import (
    air_velocity_m_s,
    home_s,
    landing_after_return_s,
    usual_return_height_m,
)
from mission_service.vehicles.energy import EnergyEstimate, estimate, times_left
from mission_service.vehicles.vehicle_state import Vehicle, announce
from mission_service.vehicles.way_home import Vector

ENERGY, OVERDUE = "energy", "overdue"
EVERY_S, REPORT_EVERY_S = 1.0, 10.0
LITTLE_S, ENOUGH_S = 180.0, 240.0  # time on task at which the alarm is raised, and cleared
OVERDUE_AFTER_S = 15.0  # the order to return takes effect within this time


class EnergyWatch:
    """The energy estimates of all vehicles; the vehicles store the state."""

    def __init__(self, scenario: Scenario, landscape: Landscape) -> None:
        self._weather = weather_of(scenario)
        self._landscape = landscape
        self._ordered_height_m = way_of(scenario).return_height_m(scenario, landscape)

    def battery(self, vehicle: Vehicle, event: events.BatteryUpdated) -> None:
        """Apply a battery report."""
        min_v, availability = vehicle.section.battery_min_voltage_v, vehicle.availability
        flies = availability.airborne or availability.restarted_in_air
        vehicle.battery.apply(event, flies, min_v)

    def air_measured(self, vehicle: Vehicle, event: events.AirDataMeasured) -> None:
        """Apply the wind and the true airspeed derived from flight on several headings."""
        fix = vehicle.availability.fix
        if fix is None:
            return
        factor = event.true_airspeed_factor / true_airspeed_factor(fix.altitude_m)
        wind = MeasuredWind(event.at_us / 1e6, event.wind_speed_m_s, event.wind_from_deg)
        vehicle.air_data = VehicleAirData(factor, wind)

    def moved(
        self, vehicle: Vehicle, event: events.Telemetry, was_airborne: bool, led_home: bool
    ) -> list[AnyCommand]:
        """Update the estimate of a vehicle that has reported its position.

        ``led_home`` states whether the vehicle flies a mission home.
        """
        state, at_s = vehicle.energy, event.at_us / 1e6
        vehicle.battery.settle(at_s)
        if not vehicle.availability.airborne:
            return self.ended(vehicle) if was_airborne else []
        before = state.estimate
        if before is not None and 0.0 <= at_s - before.at_s < EVERY_S:
            return []
        state.estimate = self._estimate(vehicle, event)
        return [
            *_report(vehicle, at_s),
            *_low(vehicle, state.estimate),
            *_overdue(vehicle, at_s, led_home),
        ]

    def ended(self, vehicle: Vehicle) -> list[AnyCommand]:
        """End the estimate of a flight; the learned rates are kept."""
        state = vehicle.energy
        vehicle.battery.end_flight()
        state.flies_on, state.time_up_since_s = False, None
        shown, state.estimate = state.estimate is not None, None
        commands = [*_low(vehicle, None), *_overdue(vehicle, 0.0, led_home=False)]
        return [*commands, ReportEnergy(vehicle.name, None, None, None, "")] if shown else commands

    def _estimate(self, vehicle: Vehicle, event: events.Telemetry) -> EnergyEstimate | None:
        at_s, fix = event.at_us / 1e6, vehicle.availability.fix
        flown_s = at_s - vehicle.availability.took_off_at_s
        wind_m_s, return_height_m = self.wind_m_s(vehicle, at_s), self.return_height_m(vehicle)
        arrives_m = max(return_height_m, event.altitude_relative_m)
        lands_s = landing_after_return_s(vehicle, arrives_m, wind_m_s, at_s)
        times = times_left(vehicle.section, vehicle.battery, flown_s, lands_s, at_s)
        if not times or fix is None:
            return None
        home_amsl_m = event.altitude_amsl_m - event.altitude_relative_m
        found_s = home_s(vehicle, fix, wind_m_s, home_amsl_m + return_height_m)
        return estimate(times, found_s, lands_s, at_s)

    def return_height_m(self, vehicle: Vehicle) -> float:
        """Return the return height above home in m; if unknown, the stack's usual one."""
        height_m = self.known_return_height_m(vehicle)
        return usual_return_height_m(vehicle.section) if height_m is None else height_m

    def known_return_height_m(self, vehicle: Vehicle) -> float | None:
        """Return the return height above home in m, or None.

        It is the height that the service orders, or else the autopilot's parameter, or else the
        scenario's value.
        """
        given = (vehicle.return_flight.height_m, vehicle.section.return_height_m)
        heights_m = (self._ordered_height_m, *given)
        return next((height_m for height_m in heights_m if height_m is not None), None)

    def wind_m_s(self, vehicle: Vehicle, at_s: float) -> Vector:
        """Return the velocity of the air (x, y) on the map, measured or from the scenario."""
        air_data = vehicle.air_data
        measured = (air_data and air_data.wind, vehicle.availability.measured_wind)
        fresh = (
            each for each in measured if each is not None and at_s - each.at_s <= WIND_IS_FRESH_S
        )
        wind = next(fresh, None)
        if wind is not None:
            speed_m_s, from_deg = wind.speed_m_s, wind.from_deg
        else:
            entry = self._weather.weather_at(at_s)
            speed_m_s, from_deg = entry.wind_speed_m_s, entry.wind_from_deg
        return air_velocity_m_s(self._landscape, speed_m_s, from_deg)


def _report(vehicle: Vehicle, at_s: float) -> list[AnyCommand]:
    """Report the estimate every ``REPORT_EVERY_S``, and its end."""
    state, found = vehicle.energy, vehicle.energy.estimate
    if found is None:
        was_reported, state.reported_at_s = state.reported_at_s > -math.inf, -math.inf
        return [ReportEnergy(vehicle.name, None, None, None, "")] if was_reported else []
    if 0.0 <= at_s - state.reported_at_s < REPORT_EVERY_S:
        return []
    state.reported_at_s = at_s
    reachable = math.isfinite(found.time_home_s)
    home = round(found.time_home_s) if reachable else None
    on_task = round(found.time_on_task_s) if reachable else -1
    landing = round(found.time_landing_s)
    return [ReportEnergy(vehicle.name, on_task, home, landing, found.source)]


def _low(vehicle: Vehicle, found: EnergyEstimate | None) -> list[AnyCommand]:
    """Raise or clear the alarm about low energy."""
    state, before = vehicle.energy, vehicle.energy.low
    if found is None:
        state.low = ""
    elif found.runs_out or (before == "severe" and found.time_on_task_s <= 0.0):
        state.low = "severe"  # also while the time home varies during a circle
    elif found.time_on_task_s < LITTLE_S or (before and found.time_on_task_s < ENOUGH_S):
        state.low = "warning"
    else:
        state.low = ""
    if state.low == before or found is None or not state.low:
        return [ClearAlarm(vehicle.name, ENERGY)] if before and not state.low else []
    if state.low == "warning":
        return [RaiseAlarm(vehicle.name, ENERGY, f"low energy: {found.words}", "warning")]
    words = f"it does not have enough energy for the flight home: {found.words}"
    return [
        announce(vehicle, words, warning=True),
        RaiseAlarm(vehicle.name, ENERGY, words, "severe"),
    ]


def _overdue(vehicle: Vehicle, at_s: float, led_home: bool) -> list[AnyCommand]:
    """Raise or clear the alarm about a vehicle that should fly home and does not."""
    state, found = vehicle.energy, vehicle.energy.estimate
    goes_home = led_home or vehicle.going_home or vehicle.availability.mode in GOING_HOME
    goes_home |= vehicle.landing_state.uses_field
    if found is None or found.time_on_task_s > 0.0 or goes_home:
        state.time_up_since_s = None
        was_overdue, state.overdue = state.overdue, False
        return [ClearAlarm(vehicle.name, OVERDUE)] if was_overdue else []
    if state.time_up_since_s is None:
        state.time_up_since_s = at_s
    if state.overdue or at_s - state.time_up_since_s < OVERDUE_AFTER_S:
        return []
    state.overdue = True
    words = f"must fly home, but {_obstacle(vehicle)}: {found.words}; order its return"
    return [
        announce(vehicle, words, warning=True),
        RaiseAlarm(vehicle.name, OVERDUE, words, "severe"),
    ]


def _obstacle(vehicle: Vehicle) -> str:
    """Return why a vehicle that should fly home does not."""
    availability = vehicle.availability
    mode = named_mode(availability.mode)
    if availability.taken_over:
        return f"its autopilot or pilot selected {mode}"
    if vehicle.ordered == "hold":
        return "an operator ordered a hold"
    if vehicle.energy.flies_on:
        return "an operator confirmed that it continues"
    if not availability.position_good:
        return "it has no position fix"
    if vehicle.sent_home:
        return f"it stays in {mode}"
    return f"no return is ordered in {mode}"
