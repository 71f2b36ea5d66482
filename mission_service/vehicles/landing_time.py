"""Predicts how long a landing takes after the arrival over its loiter or over home. Pure."""

import math

from mission_service.config.sections import VehicleSection
from mission_service.missions.landing import (
    APPROACH_HEIGHTS_M,
    Approach,
    glide_m,
    px4_glide_airspeed_m_s,
)

# Planes: sink rate in the approach loiter; minimum speed over the ground on the glide.
PLANE_SINK_M_S, MIN_GLIDE_M_S = 3.0, 3.0
VTOL_SINK_M_S = 1.0
# Multirotors: default sink rates of both stacks.
COPTER_SINK_M_S, SLOW_BELOW_M, TOUCHDOWN_M_S = 1.5, 10.0, 0.5


def landing_s(
    section: VehicleSection, approach: Approach | None, height_m: float, wind_m_s: float
) -> float:
    """Return the seconds from the arrival to the touchdown of a landing that has not begun.

    A plane flies a whole circle in its approach loiter and glides into the wind.

    Args:
        section: The vehicle.
        approach: The approach of a winged vehicle; None if it is not planned.
        height_m: Height above home at the arrival.
        wind_m_s: Wind speed.
    """
    if section.kind == "copter":
        return copter_descent_s(height_m)
    approach_m = APPROACH_HEIGHTS_M[-1] if approach is None else approach.height_m
    line_m = glide_m(approach_m) if approach is None else approach.length_m
    circle_s = math.tau * section.loiter_radius_m / section.airspeed_m_s
    return circle_s + plane_descent_s(section, height_m, approach_m, line_m, wind_m_s)


def plane_descent_s(
    section: VehicleSection,
    height_m: float,
    approach_height_m: float,
    line_m: float,
    headwind_m_s: float,
) -> float:
    """Return the seconds of a winged vehicle's descent from its approach loiter to touchdown.

    Args:
        section: The vehicle. A VTOL descends vertically at the end of the line.
        height_m: Height above home at which the descent in the loiter begins.
        approach_height_m: Height above home at which the vehicle leaves the loiter.
        line_m: Horizontal length of the straight flight from the loiter to home.
        headwind_m_s: Headwind on this line; negative for a tailwind.
    """
    down_s = max(height_m - approach_height_m, 0.0) / PLANE_SINK_M_S
    vertical_s = approach_height_m / VTOL_SINK_M_S if section.kind == "vtol" else 0.0
    return down_s + line_m / _approach_m_s(section, headwind_m_s) + vertical_s


def _approach_m_s(section: VehicleSection, headwind_m_s: float) -> float:
    """Return the ground speed of an approach.

    By their default parameters, PX4 planes approach at their minimum airspeed, ArduPlane at the
    mean of this and its usual airspeed. VTOLs approach at their usual airspeed.
    """
    if section.kind == "vtol":
        return max(section.airspeed_m_s - headwind_m_s, MIN_GLIDE_M_S)
    if section.stack == "px4":
        return px4_glide_airspeed_m_s(section, headwind_m_s) - headwind_m_s
    airspeed_m_s = (section.airspeed_m_s + section.min_airspeed_m_s) / 2.0
    return max(airspeed_m_s - headwind_m_s, MIN_GLIDE_M_S)


def copter_descent_s(height_m: float) -> float:
    """Return the seconds of a multirotor's descent from a height above home to the ground."""
    fast_m = max(height_m - SLOW_BELOW_M, 0.0)
    return fast_m / COPTER_SINK_M_S + SLOW_BELOW_M / TOUCHDOWN_M_S
