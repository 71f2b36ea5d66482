"""Compensation of the wind's drift of falling spheres: the path is moved upwind."""

from dataclasses import replace

import numpy as np

from mission_service.config.sections import BurnSection
from mission_service.guidance.burn.line_planner import LinePlan, Situation
from mission_service.guidance.burn.recheck import plan_problem
from mission_service.guidance.burn.release import VehicleMotion, impact_point

SAME_PLACE_M = 0.05
MIN_DRIFT_M = 0.2  # a smaller drift is ignored


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
