"""Checks whether an earlier plan is still valid in the current fire, unit and wind."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from mission_service.config.sections import BurnSection
from mission_service.guidance.burn.drop_release import VehicleMotion, impact_point
from mission_service.guidance.burn.lines.flight_constraints import (
    FlightConstraints,
    FlightPoint,
    Leg,
    point_on_leg,
)
from mission_service.guidance.burn.lines.line_planner import LinePlan, Situation, constraints_of
from mission_service.guidance.burn.lines.sphere_fires import SphereFires
from mission_service.ignition_plan import IgnitionPlan

ROUNDED_S = 1e-6


def plan_problem(
    plan: LinePlan, situation: Situation, settings: BurnSection, flown_s: float = 0.0
) -> str:
    """Return why the rest of a plan after ``flown_s`` must not be flown; "" if the rest is valid.

    The rest of the plan begins at ``situation.at_s``, with the situation's wind and unit. The
    situation's fire must not contain the drops of this plan, because this function adds each drop
    at its own time.
    """
    air = constraints_of(situation, settings)
    begin_s = situation.at_s - flown_s
    places = [
        FlightPoint(x, y, height, begin_s + after) for x, y, height, after in plan.path.tolist()
    ]
    own, number = SphereFires(air), 0
    for leg in pairwise(places):
        while number < len(plan.drops) and _dropped_by(plan, number, leg[0].at_s - begin_s):
            x_m, y_m, after_s = plan.drops[number].tolist()
            own.add_drop(x_m, y_m, begin_s + after_s)
            number += 1
        if leg[1].at_s <= situation.at_s:
            continue
        rest = (_later(leg, situation.at_s), leg[1])
        after_s = rest[0].at_s - begin_s
        problem = _airspace_problem(air, rest, places[0])
        if problem:
            return f"{problem} {after_s:.0f} s after the start"
        # Use the larger margin: that of the whole leg, as in planning, or of the remaining part.
        margin_s = max(
            min(air.margin_s(part), own.margin_s(part)) for part in dict.fromkeys((leg, rest))
        )
        first = plan.climbs_first and leg[0] == places[0]
        if margin_s < settings.time_margin_s and not first:
            near = f"comes within {margin_s:.0f} s" if margin_s > 0.0 else "burns within reach"
            return f"fire {near} of the path {after_s:.0f} s after the start"
    return _drop_problem(plan, air, begin_s, flown_s) or _load_problem(
        plan, situation, settings, flown_s
    )


def _dropped_by(plan: LinePlan, number: int, after_s: float) -> bool:
    return bool(plan.drops[number, 2] <= after_s + ROUNDED_S)


def _later(leg: Leg, at_s: float) -> FlightPoint:
    """Return the point on a leg at the time ``at_s``, or the leg's start if ``at_s`` is earlier."""
    begin, end = leg
    if at_s <= begin.at_s:
        return begin
    return point_on_leg(leg, (at_s - begin.at_s) / (end.at_s - begin.at_s))


def _airspace_problem(air: FlightConstraints, leg: Leg, start: FlightPoint) -> str:
    begin, end = leg[0][:2], leg[1][:2]
    if air.high is not None and not air.high.is_straight_clear(begin, end):
        return "the path leaves the fence"
    vertical_at_start = begin == end == start[:2]
    if not air.is_high(leg) and not vertical_at_start and not air.low.is_straight_clear(begin, end):
        return "the path is low outside the unit, or over people,"
    return ""


def _drop_problem(plan: LinePlan, air: FlightConstraints, begin_s: float, flown_s: float) -> str:
    left = plan.drops[plan.drops[:, 2] > flown_s + ROUNDED_S]
    if not len(left):
        return ""
    if not air.unit.may_drop(left[:, :2]).all():
        return "a drop is outside the unit, in a no-drop area or near people"
    lands_s = begin_s + left[:, 2] + air.settings.ignition_delay_s
    if (np.asarray(air.fire.ignition_time_s(left[:, :2])) <= lands_s).any():
        return "a drop is on ground that will have burned"
    return ""


def _load_problem(
    plan: LinePlan, situation: Situation, settings: BurnSection, flown_s: float
) -> str:
    left = int((plan.drops[:, 2] > flown_s + ROUNDED_S).sum())
    if left > situation.spheres:
        return f"the plan has {left} more drops, but only {situation.spheres} spheres are left"
    needs_s = plan.duration_s - flown_s + plan.home_s + settings.battery_reserve_s
    if needs_s > situation.battery_s + ROUNDED_S:
        return (
            f"the plan needs {needs_s:.0f} s of flight time, but the battery lasts "
            f"{situation.battery_s:.0f} s"
        )
    return ""


SAME_PLACE_M = 0.05
MIN_DRIFT_M = 0.2  # smaller drifts are ignored
CALM_M_S = 1.0  # the direction of a weaker wind is ignored
# Speed in m/s, and direction from which the wind blows, in degrees clockwise from true north.
WindFrom = tuple[float, float]


def wind_differs(plan: IgnitionPlan, wind: WindFrom, burn: BurnSection) -> str | None:
    """Describe how the wind differs from the planned wind; None if the difference is small."""
    speed_m_s, from_deg = wind
    turned_deg = abs((from_deg - plan.wind_from_deg + 180.0) % 360.0 - 180.0)
    faster = abs(speed_m_s - plan.wind_speed_m_s) > burn.wind_changes_m_s
    blows = max(speed_m_s, plan.wind_speed_m_s) > CALM_M_S
    if not faster and not (blows and turned_deg > burn.wind_changes_deg):
        return None
    return (
        f"the wind is {speed_m_s:.1f} m/s from {from_deg:.0f}°, but the plan assumes "
        f"{plan.wind_speed_m_s:.1f} m/s from {plan.wind_from_deg:.0f}°"
    )


def mean_wind(winds: Sequence[WindFrom]) -> WindFrom:
    """Return the vector mean of several winds."""
    east = sum(speed * math.sin(math.radians(from_deg)) for speed, from_deg in winds) / len(winds)
    north = sum(speed * math.cos(math.radians(from_deg)) for speed, from_deg in winds) / len(winds)
    return math.hypot(east, north), math.degrees(math.atan2(east, north)) % 360.0


def drift_compensated(plan: LinePlan, situation: Situation, burn: BurnSection) -> LinePlan:
    """Return the plan with its path moved upwind by the drift of a falling sphere.

    The drift is computed for a fall from the drop height. Points vertically above the path's start
    are not moved. If the moved path is invalid, for example outside the unit or too close to fire,
    the plan is returned unchanged; its spheres then miss their targets or are skipped.
    """
    speed_m_s, toward_rad, dropper = situation.wind_m_s, situation.toward_rad, burn.dropper
    wind = (float(speed_m_s * np.cos(toward_rad)), float(speed_m_s * np.sin(toward_rad)))
    hover = VehicleMotion(0.0, 0.0, burn.drop_height_m, 0.0, 0.0)
    falls = impact_point(hover, wind, dropper.terminal_speed_m_s, dropper.delay_s)
    drift_m = np.array([falls.x_m, falls.y_m])
    if np.hypot(*drift_m) < MIN_DRIFT_M:
        return plan
    path = plan.path.copy()
    away = np.hypot(*(path[:, :2] - path[0, :2]).T) > SAME_PLACE_M
    path[away, :2] -= drift_m
    moved = replace(plan, path=path)
    return plan if plan_problem(moved, situation, burn) else moved
