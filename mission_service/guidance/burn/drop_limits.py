"""Checks a drop's position for the interlock: near its target, in the unit, far from people.

This module is part of the interlock, and shares no code with the controller that orders drops.
A drop is refused if information is missing.
"""

import math
from collections.abc import Mapping
from itertools import pairwise

import shapely
from shapely.geometry.base import BaseGeometry

from mission_service.commands import Drop
from mission_service.config.sections import BurnSection
from mission_service.events import Telemetry
from mission_service.ground_distance import distance_m
from mission_service.ignition_plan import IgnitionPlan, PlannedDrop

# Tolerances for the position and height of a drop. The tolerances exclude gross errors only, since
# the controller computes the exact impact point (drop_release.py).
LATE_S = 1.0
OFF_PATH_M = 5.0
HEIGHT_SHARE, MIN_BAND_M = 0.5, 5.0
GRAVITY_M_S2 = 9.81

Circle = tuple[float, float, float]  # lat_deg, lon_deg, radius_m


def planned_drop(plan: IgnitionPlan, drop: Drop) -> PlannedDrop:
    """Return the planned drop with the same number as a commanded drop."""
    return next(planned for planned in plan.drops if planned.number == drop.number)


def target_problem(burn: BurnSection, plan: IgnitionPlan, drop: Drop, fix: Telemetry) -> str | None:
    """Return why a drop from ``fix`` would miss its target; None if the drop would hit it."""
    planned = planned_drop(plan, drop)
    place = (planned.lat_deg, planned.lon_deg)
    ground_m = ground_amsl_m(plan, planned.after_s)
    away_m = distance_m(place, (fix.lat_deg, fix.lon_deg))
    max_m = reach_m(burn, plan)
    if not away_m <= max_m:
        target = f"the target of drop {drop.number}"
        return f"{drop.vehicle} is {away_m:.0f} m from {target} (max {max_m:.0f} m)"
    miss_m = distance_m(place, (drop.lat_deg, drop.lon_deg))
    if not miss_m <= burn.max_miss_m:
        return f"drop {drop.number} would fall {miss_m:.1f} m off its target"
    height_m = math.nan if ground_m is None else fix.altitude_amsl_m - ground_m
    band_m = max(MIN_BAND_M, HEIGHT_SHARE * plan.drop_height_m)
    if not abs(height_m - plan.drop_height_m) <= band_m:
        required = f"{plan.drop_height_m:.0f} ± {band_m:.0f} m"
        return f"{drop.vehicle} is {height_m:.0f} m above the drop's target, not {required}"
    return None


def place_problem(
    planned: PlannedDrop, areas: Mapping[str, BaseGeometry], people: Mapping[str, Circle]
) -> str | None:
    """Return why a drop is outside the areas (lon, lat) or too close to people, or None."""
    place = (planned.lat_deg, planned.lon_deg)
    for name, area in areas.items():
        if not shapely.contains_xy(area, place[1], place[0]):
            return f"drop {planned.number} lies outside the {name}"
    for name, (lat_deg, lon_deg, radius_m) in people.items():
        if radius_m > 0.0 and distance_m(place, (lat_deg, lon_deg)) <= radius_m:
            return f"drop {planned.number} lies within {radius_m:.0f} m of {name}"
    return None


def reach_m(burn: BurnSection, plan: IgnitionPlan) -> float:
    """Return the largest horizontal distance allowed between a vehicle and a drop's target."""
    fall_s = math.sqrt(2.0 * plan.drop_height_m / GRAVITY_M_S2)
    duration_s = burn.dropper.delay_s + fall_s + LATE_S
    max_speed_m_s = max(plan.speed_m_s, plan.wind_speed_m_s)
    return max_speed_m_s * duration_s + burn.max_miss_m + OFF_PATH_M


def ground_amsl_m(plan: IgnitionPlan, after_s: float) -> float | None:
    """Return the ground altitude under a plan's path at a time; None outside the path's times."""
    for start, end in pairwise(plan.path):
        if start.after_s <= after_s <= end.after_s:
            share = (after_s - start.after_s) / max(end.after_s - start.after_s, 1e-9)
            ground_m = [point.altitude_amsl_m - point.height_m for point in (start, end)]
            return ground_m[0] + share * (ground_m[1] - ground_m[0])
    return None
