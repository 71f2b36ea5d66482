"""The wind of a burn: changes that invalidate a plan, and compensation of the drift of spheres."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mission_service.config.sections import BurnSection
from mission_service.guidance.burn.line_planner import LinePlan, Situation
from mission_service.guidance.burn.recheck import plan_problem
from mission_service.guidance.burn.release import VehicleMotion, impact_point
from mission_service.ignition_plan import IgnitionPlan

SAME_PLACE_M = 0.05
MIN_DRIFT_M = 0.2  # a smaller drift is ignored
CALM_M_S = 1.0  # below it the direction of the wind does not count
WindFrom = tuple[float, float]  # speed in m/s, where it comes from in degrees from true north


def wind_differs(plan: IgnitionPlan, wind: WindFrom, burn: BurnSection) -> str | None:
    """How a wind differs from the planned one by more than is allowed; None if it does not."""
    speed_m_s, from_deg = wind
    turned_deg = abs((from_deg - plan.wind_from_deg + 180.0) % 360.0 - 180.0)
    faster = abs(speed_m_s - plan.wind_speed_m_s) > burn.wind_changes_m_s
    blows = max(speed_m_s, plan.wind_speed_m_s) > CALM_M_S
    if not faster and not (blows and turned_deg > burn.wind_changes_deg):
        return None
    return (
        f"the wind is {speed_m_s:.1f} m/s from {from_deg:.0f}°, planned for was "
        f"{plan.wind_speed_m_s:.1f} m/s from {plan.wind_from_deg:.0f}°"
    )


def mean_wind(winds: Sequence[WindFrom]) -> WindFrom:
    """The mean of winds as vectors."""
    east = sum(speed * math.sin(math.radians(from_deg)) for speed, from_deg in winds) / len(winds)
    north = sum(speed * math.cos(math.radians(from_deg)) for speed, from_deg in winds) / len(winds)
    return math.hypot(east, north), math.degrees(math.atan2(east, north)) % 360.0


def drift_compensated(plan: LinePlan, situation: Situation, burn: BurnSection) -> LinePlan:
    """The plan with its path moved against the drift of a sphere released at the drop height.

    Points above the begin stay. If the moved path is invalid (out of the unit, too near to fire)
    the plan stays as it is: spheres then fall beside their targets, or are left out.
    """
    wind = situation.wind_m_s * np.array(
        [np.cos(situation.toward_rad), np.sin(situation.toward_rad)]
    )
    dropper = burn.dropper
    hover = VehicleMotion(0.0, 0.0, burn.drop_height_m, 0.0, 0.0)
    blown = (float(wind[0]), float(wind[1]))
    falls = impact_point(hover, blown, dropper.terminal_speed_m_s, dropper.delay_s)
    drift_m = np.array([falls.x_m, falls.y_m])
    if np.hypot(*drift_m) < MIN_DRIFT_M:
        return plan
    path = plan.path.copy()
    gone = np.hypot(*(path[:, :2] - path[0, :2]).T) > SAME_PLACE_M
    path[gone, :2] -= drift_m
    moved = replace(plan, path=path)
    return plan if plan_problem(moved, situation, burn) else moved
