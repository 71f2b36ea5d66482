"""Computes the pre-flight checks of a vehicle on the ground. Pure.

Each check passes, fails, or is unknown because its data are missing. A failing check prevents a
takeoff until a person overrides the check; the checks in ``NEVER_OVERRIDDEN`` always prevent it. A
start that nobody ordered (``autostart``) is delayed by failing checks in ``DELAY_AUTOSTART``; other
failing checks are announced when the vehicle starts.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from mission_service.commands import CheckState, PreflightCheck
from mission_service.config.sections import VehicleSection
from mission_service.vehicles.endurance import (
    expected_performance,
    landing_after_return_s,
    outbound_s,
    return_s,
)
from mission_service.vehicles.energy import times_left
from mission_service.vehicles.vehicle_state import MissionPhase, Vehicle
from mission_service.vehicles.way_home import Vector

POSITION, ESTIMATOR, AIRSPACE, KIND = "position", "estimator", "airspace", "kind"
BATTERY, WIND, REMOTE_ID = "battery", "wind", "Remote ID"
NEVER_OVERRIDDEN = (POSITION, ESTIMATOR, AIRSPACE, KIND, REMOTE_ID)
DELAY_AUTOSTART = (*NEVER_OVERRIDDEN, BATTERY, WIND)

POSITION_AGE_S = 10.0
HOME_NEAR_M = 150.0  # a vehicle farther from the scenario's home fails the check
HEIGHT_DIFFERENCE_M = 40.0  # between the reported altitude and the terrain
AIRCRAFT_NEAR_M, AIRCRAFT_ABOVE_M = 2000.0, 450.0


class NearestAircraft(NamedTuple):
    """Another aircraft, relative to the vehicle."""

    name: str
    distance_m: float  # horizontal
    above_m: float


@dataclass(frozen=True, slots=True)
class Departure:
    """The data for the checks that are not part of the vehicle's own state.

    Attributes:
        at_s: Mission time.
        wind_m_s: Velocity of the air (x, y) on the map.
        return_height_m: Return height above home.
        arrival_height_m: Greatest height above home at the end of a return from the mission.
        ground_amsl_m: Elevation of the terrain at the vehicle; None if it is unknown.
        airspace: The closed airspace that the takeoff or the mission on board would enter, or "".
        has_surveillance: Whether the run receives other aircraft.
        nearest: The nearest other aircraft, or None.
        requires_remote_id: Whether the scenario requires Remote ID.
        return_clearance_m: Least height above the ground on a return from any position of the
            mission on board; None if it is unknown.
        return_remedy: The clearance and its remedy if it is too small, or "".
    """

    at_s: float
    wind_m_s: Vector
    return_height_m: float
    arrival_height_m: float
    ground_amsl_m: float | None
    airspace: str = ""
    has_surveillance: bool = False
    nearest: NearestAircraft | None = None
    requires_remote_id: bool = False
    return_clearance_m: float | None = None
    return_remedy: str = ""


def checks_of(vehicle: Vehicle, departure: Departure) -> tuple[PreflightCheck, ...]:
    """Return the checks of a vehicle on the ground, in a fixed order."""
    checks: tuple[PreflightCheck, ...] = (
        _battery(vehicle, departure),
        _position(vehicle, departure),
        _estimator(vehicle),
        _link(vehicle),
        _autopilot(vehicle),
        _kind(vehicle),
        _home(vehicle, departure),
        _mission(vehicle),
        _airspace(departure),
        _return(departure),
        _wind(vehicle, departure),
        _lost_link(vehicle),
    )
    if departure.requires_remote_id or vehicle.remote_id.state:
        checks = (*checks, _remote_id(vehicle, departure.requires_remote_id))
    return (*checks, _aircraft(departure)) if departure.has_surveillance else checks


def failing(checks: Iterable[PreflightCheck]) -> list[PreflightCheck]:
    """Return the checks that fail."""
    return [check for check in checks if check.state == "fail"]


def in_words(checks: Iterable[PreflightCheck], limit: int = 2) -> str:
    """Return the first checks in one line, with the number of further checks."""
    listed = list(checks)
    words = "; ".join(f"{check.name}: {check.text}" for check in listed[:limit])
    return f"{words}; and {len(listed) - limit} more" if len(listed) > limit else words


def max_wind_m_s(section: VehicleSection) -> float:
    """Return the wind in which a vehicle may take off: as given, or its return airspeed."""
    if section.max_wind_m_s is not None:
        return section.max_wind_m_s
    if section.kind == "copter":
        return section.max_airspeed_m_s
    return section.return_speed_m_s or section.airspeed_m_s


def _battery(vehicle: Vehicle, departure: Departure) -> PreflightCheck:
    """Compare the energy with the reserve and with the need of the flight to the task and back.

    A reported charge below the one in use counts at once; a higher one only after it has lasted.
    """
    section, at_s = vehicle.section, departure.at_s
    charges_pct = (vehicle.battery.level_pct(at_s), vehicle.battery.reported_pct)
    level_pct = min((each for each in charges_pct if each is not None), default=None)
    level = "no charge reported" if level_pct is None else f"{level_pct:.0f} %"
    reserve = f"the reserve is {section.battery_reserve_pct:.0f} %"
    if level_pct is not None and level_pct <= section.battery_reserve_pct:
        return PreflightCheck(BATTERY, "fail", f"{level}, {reserve}: replace the battery")
    lands_s = landing_after_return_s(vehicle, departure.arrival_height_m, departure.wind_m_s, at_s)
    times = times_left(section, vehicle.battery, 0.0, lands_s, at_s)
    if not times:
        if level_pct is None:
            return PreflightCheck(BATTERY, "unknown", level)
        return PreflightCheck(BATTERY, "pass", f"{level}, {reserve}")
    least = min(times, key=lambda each: each.until_home_s)
    if least.until_home_s <= 0.0:
        words = f"{level}, no time left in the air (source: {least.source}): replace the battery"
        return PreflightCheck(BATTERY, "fail", words)
    lasts = f"{level}, {least.until_home_s / 60.0:.0f} min in the air (source: {least.source})"
    flights = _flight_s(vehicle, departure)
    if flights is None:
        return PreflightCheck(BATTERY, "pass", lasts)
    out_s, home_s = flights
    if math.isinf(out_s + home_s):
        words = "the wind prevents the flight to the task or home: wait for less wind"
        return PreflightCheck(BATTERY, "fail", words)
    needs = f"{out_s / 60.0:.0f} min to the task, {home_s / 60.0:.0f} min home"
    if out_s + home_s >= least.until_home_s:
        return PreflightCheck(BATTERY, "fail", f"{lasts}; {needs}: replace the battery")
    return PreflightCheck(BATTERY, "pass", f"{lasts}; {needs}")


def _flight_s(vehicle: Vehicle, departure: Departure) -> tuple[float, float] | None:
    """Return the seconds to the farthest point of the mission on board, and home from there."""
    if vehicle.flown_line is None:
        return None
    home_m = vehicle.home_m
    points = (point[:2] for point in vehicle.flown_line.coords)
    far_m = max(points, key=lambda point: math.dist(point, home_m))
    task_m = (far_m[0] - home_m[0], far_m[1] - home_m[1])
    section, wind_m_s = vehicle.section, departure.wind_m_s
    out_s = outbound_s(section, task_m, wind_m_s, section.altitude_agl_m)
    climb_m = max(departure.return_height_m - section.altitude_agl_m, 0.0)
    back_m = (-task_m[0], -task_m[1])
    fix = vehicle.availability.fix
    ground_amsl_m = 0.0 if fix is None else fix.altitude_m
    performance = expected_performance(vehicle, ground_amsl_m + section.altitude_agl_m)
    return out_s, return_s(section, performance, back_m, wind_m_s, wind_m_s, climb_m)


def _position(vehicle: Vehicle, departure: Departure) -> PreflightCheck:
    fix = vehicle.availability.fix
    if fix is None:
        return PreflightCheck(POSITION, "fail", "no position reported: wait for the fix")
    age_s = departure.at_s - fix.at_s
    if age_s > POSITION_AGE_S:
        return PreflightCheck(
            POSITION, "fail", f"the last position is {age_s:.0f} s old: check the link"
        )
    if not vehicle.availability.fix_good:
        return PreflightCheck(POSITION, "fail", "no 3-D fix: wait for the fix")
    return PreflightCheck(POSITION, "pass", "3-D fix")


def _estimator(vehicle: Vehicle) -> PreflightCheck:
    if not vehicle.availability.estimator_healthy:
        words = "the autopilot's estimator is unhealthy: wait until it is ready, or restart it"
        return PreflightCheck(ESTIMATOR, "fail", words)
    return PreflightCheck(ESTIMATOR, "pass", "no problem reported")


def _link(vehicle: Vehicle) -> PreflightCheck:
    if not vehicle.availability.online:
        return PreflightCheck("link", "fail", "no heartbeat: check its power and its radio")
    return PreflightCheck("link", "pass", "heartbeats received")


def _autopilot(vehicle: Vehicle) -> PreflightCheck:
    availability = vehicle.availability
    if availability.fence_breached:
        words = "it reports a breached fence: correct the fence, or move the vehicle"
        return PreflightCheck("autopilot", "fail", words)
    if availability.in_failsafe:
        words = f"it reports the state {availability.system_state}: end the failsafe"
        return PreflightCheck("autopilot", "fail", words)
    return PreflightCheck("autopilot", "pass", "no failsafe, no breached fence")


def _kind(vehicle: Vehicle) -> PreflightCheck:
    """Compare the stack and the kind with the scenario.

    A VTOL would climb vertically to a plane's altitude, and landings differ between the stacks.
    """
    reported, kind = vehicle.reported_kind, vehicle.section.kind
    stack, own = vehicle.reported_stack, vehicle.section.stack
    if stack and stack != own:
        words = f'its stack is {stack}: set stack = "{stack}" in the scenario, which has "{own}"'
        return PreflightCheck(KIND, "fail", words)
    if not reported:
        return PreflightCheck(KIND, "unknown", "its parameters have not been read")
    if reported != kind:
        words = f'it is a {reported}: set kind = "{reported}" in the scenario, which has "{kind}"'
        return PreflightCheck(KIND, "fail", words)
    return PreflightCheck(KIND, "pass", reported)


def _home(vehicle: Vehicle, departure: Departure) -> PreflightCheck:
    """Compare the position and altitude with the scenario's home and the terrain."""
    fix = vehicle.availability.fix
    if fix is None:
        return PreflightCheck("home", "unknown", "no position reported")
    away_m = math.dist((fix.x_m, fix.y_m), vehicle.home_m)
    words, remedies = f"{away_m:.0f} m from the home in the scenario", []
    if away_m > HOME_NEAR_M:
        remedies.append("move it there, or correct home_lat_deg and home_lon_deg")
    if departure.ground_amsl_m is not None:
        above_m = fix.altitude_m - departure.ground_amsl_m
        side = "above" if above_m >= 0.0 else "below"
        words += f", {abs(above_m):.0f} m {side} the terrain"
        if abs(above_m) > HEIGHT_DIFFERENCE_M:
            remedies.append("compare the autopilot's altitude with the terrain of the scenario")
    if remedies:
        return PreflightCheck("home", "fail", f"{words}: {', and '.join(remedies)}")
    return PreflightCheck("home", "pass", words)


def _mission(vehicle: Vehicle) -> PreflightCheck:
    """Check that a mission that begins with a takeoff was accepted."""
    accepted = vehicle.accepted
    state: CheckState = "unknown"
    if vehicle.unconfirmed is not None:
        words = "it is being read back after a restart of the service"
    elif vehicle.flown_line is not None and accepted is not None:
        words, state = f"mission {accepted.mission_id} accepted", "pass"
        if not accepted.takes_off:
            words, state = f"{words}, but without a takeoff: order renew", "fail"
    elif vehicle.pending is not None:
        words = f"mission {vehicle.pending.mission_id} is being sent"
    elif vehicle.proposed is not None:
        words = f"mission {vehicle.proposed.mission_id} waits for an operator's acceptance"
    elif vehicle.mission_phases[-1] is MissionPhase.FAILED:
        words = "the last upload failed and is being repeated"
    elif vehicle.refusal is not None:
        words = f"refused by {vehicle.refusal.by}: order renew"
    else:
        words = "none on board yet"
    return PreflightCheck("mission", state, words)


def _airspace(departure: Departure) -> PreflightCheck:
    if departure.airspace:
        words = f"it would enter {departure.airspace}: wait until it is open"
        return PreflightCheck(AIRSPACE, "fail", words)
    return PreflightCheck(AIRSPACE, "pass", "home and mission are clear of closed airspace")


def _return(departure: Departure) -> PreflightCheck:
    """Compare the autopilot's own return with the ground along its path."""
    if departure.return_remedy:
        words = f"a return from the mission would be {departure.return_remedy}"
        return PreflightCheck("return", "fail", words)
    if departure.return_clearance_m is None:
        return PreflightCheck(
            "return", "unknown", "no mission with a takeoff, no position or no elevation"
        )
    words = f"a return from the mission is {departure.return_clearance_m:.0f} m above the ground"
    return PreflightCheck("return", "pass", words)


def _wind(vehicle: Vehicle, departure: Departure) -> PreflightCheck:
    speed_m_s, limit_m_s = math.hypot(*departure.wind_m_s), max_wind_m_s(vehicle.section)
    words = f"{speed_m_s:.0f} m/s; the limit is {limit_m_s:.0f} m/s"
    if speed_m_s >= limit_m_s:
        return PreflightCheck(WIND, "fail", f"{words}: wait for less wind")
    return PreflightCheck(WIND, "pass", words)


def _lost_link(vehicle: Vehicle) -> PreflightCheck:
    name, wanted = "lost link", vehicle.section.lost_link
    if vehicle.lost_link_problem:
        return PreflightCheck(name, "fail", vehicle.lost_link_problem)
    if not vehicle.lost_link:
        return PreflightCheck(name, "unknown", "its parameters have not been read")
    if wanted is None:
        return PreflightCheck(name, "pass", f"if the link is lost, it {vehicle.lost_link}")
    words = f"if the link is lost, it {vehicle.lost_link}, as in the scenario ({wanted})"
    return PreflightCheck(name, "pass", words)


def _aircraft(departure: Departure) -> PreflightCheck:
    name, nearest = "other aircraft", departure.nearest
    if nearest is None:
        return PreflightCheck(name, "pass", "none received")
    side = "above" if nearest.above_m >= 0.0 else "below"
    height = f"{abs(nearest.above_m):.0f} m {side}"
    words = f"{nearest.name} {nearest.distance_m / 1e3:.1f} km away, {height}"
    if nearest.distance_m < AIRCRAFT_NEAR_M and abs(nearest.above_m) < AIRCRAFT_ABOVE_M:
        return PreflightCheck(name, "fail", f"{words}: wait until it has passed")
    return PreflightCheck(name, "pass", words)


def _remote_id(vehicle: Vehicle, required: bool) -> PreflightCheck:
    """Check that the Remote ID module is ready; only a required module can fail."""
    report = vehicle.remote_id
    if report.state == "ready":
        return PreflightCheck(REMOTE_ID, "pass", report.state_in_words)
    if not required:
        words = f"{report.state_in_words}; the scenario does not require it"
        return PreflightCheck(REMOTE_ID, "unknown", words)
    remedy = "check its power and its wiring" if report.state != "fails" else "correct its error"
    return PreflightCheck(REMOTE_ID, "fail", f"{report.state_in_words}: {remedy}")
