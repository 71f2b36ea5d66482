"""Predicts how long a landing takes. Pure."""

import math

from mission_service.config.sections import VehicleSection
from mission_service.missions.landing import (
    APPROACH_HEIGHTS_M,
    Approach,
    glide_m,
    px4_approach_speeds,
    vtol_leg_m,
)
from mission_service.vehicles.way_home import Vector

# Planes: sink rate in the approach loiter; minimum speed over the ground.
PLANE_SINK_M_S, MIN_GLIDE_M_S = 3.0, 3.0
VTOL_SINK_M_S = 1.0
# Multirotors: default sink rates of both stacks; the default RTL_LOIT_TIME of ArduCopter.
WAITS_S = {"px4": 0.0, "ardupilot": 5.0}
COPTER_SINK_M_S, SLOW_BELOW_M, TOUCHDOWN_M_S = 1.5, 10.0, 0.5


def landing_s(
    section: VehicleSection,
    approach: Approach | None,
    home_m: Vector | None,
    height_m: float,
    wind_m_s: Vector,
) -> float:
    """Return the seconds from the end of a flight home to the touchdown, before the landing begins.

    A plane flies to its approach loiter, a whole circle there, and glides against the wind.

    Args:
        section: The vehicle.
        approach: The approach of a winged vehicle; None if it is not planned. The highest approach
            is then assumed.
        home_m: Position of home (x, y), where the flight home ends; None if it ends over the
            approach loiter.
        height_m: Height above home at the end of the flight home.
        wind_m_s: Velocity of the air (x, y).
    """
    if section.kind == "copter":
        return WAITS_S[section.stack] + copter_descent_s(height_m)
    if approach is None:
        approach_m = APPROACH_HEIGHTS_M[-1]
        line_m = vtol_leg_m(section) if section.kind == "vtol" else glide_m(approach_m)
    else:
        approach_m, line_m = approach.height_m, approach.length_m
    to_loiter_s = 0.0
    if home_m is not None:
        to_m = (line_m, 0.0)  # the direction is unknown if no approach is planned
        if approach is not None:
            to_m = (
                float(approach.centre_m[0]) - home_m[0],
                float(approach.centre_m[1]) - home_m[1],
            )
        to_loiter_s = _straight_s(section, to_m, wind_m_s)
    circle_s = math.tau * section.loiter_radius_m / section.airspeed_m_s
    headwind_m_s = math.hypot(*wind_m_s)
    descent_s = plane_descent_s(section, height_m, approach_m, line_m, headwind_m_s)
    return to_loiter_s + circle_s + descent_s


def _straight_s(section: VehicleSection, to_m: Vector, wind_m_s: Vector) -> float:
    """Return the seconds of a straight flight along a vector (x, y); crosswind is ignored."""
    distance_m = math.hypot(*to_m)
    tailwind_m_s = (wind_m_s[0] * to_m[0] + wind_m_s[1] * to_m[1]) / max(distance_m, 1.0)
    return distance_m / max(section.airspeed_m_s + tailwind_m_s, MIN_GLIDE_M_S)


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
        return max(px4_approach_speeds(section, headwind_m_s).ground_speed_m_s, MIN_GLIDE_M_S)
    airspeed_m_s = (section.airspeed_m_s + section.min_airspeed_m_s) / 2.0
    return max(airspeed_m_s - headwind_m_s, MIN_GLIDE_M_S)


def copter_descent_s(height_m: float) -> float:
    """Return the seconds of a multirotor's descent from a height above home to the ground."""
    fast_m = max(height_m - SLOW_BELOW_M, 0.0)
    return fast_m / COPTER_SINK_M_S + SLOW_BELOW_M / TOUCHDOWN_M_S
