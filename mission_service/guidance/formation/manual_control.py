"""Estimates the orbits of UAVs under manual control, so that the formation can avoid them.

Such a UAV (held, recalled or flown by a pilot) has no virtual agent and does not avoid other UAVs.
Its state is sent with an orbit estimated from its motion, so that the other UAVs avoid it.
"""

import math

MEASURED_OVER_S = 1.0  # duration over which a turn rate is measured
STRAIGHT_RAD_S = 0.02  # a lower turn rate counts as straight flight
AHEAD_S = 60.0
MIN_SPEED_M_S = 1.0

# at_s, x_m, y_m, velocity_x_m_s, velocity_y_m_s
ObservedMotion = tuple[float, float, float, float, float]


def expected_orbit(
    before: ObservedMotion, now: ObservedMotion, radius_m: float
) -> tuple[float, float, float]:
    """Estimate the circle that a UAV flies from the change of course between two observations.

    Returns the circle's x, y and radius; a negative radius means anticlockwise. In straight flight
    the circle has the radius ``radius_m`` (> 0), and its centre is a minute ahead.
    """
    at_s, x_m, y_m, vx_m_s, vy_m_s = now
    speed_m_s = math.hypot(vx_m_s, vy_m_s)
    if speed_m_s < MIN_SPEED_M_S:
        return x_m, y_m, -radius_m
    turned_rad = math.atan2(
        before[3] * vy_m_s - before[4] * vx_m_s, before[3] * vx_m_s + before[4] * vy_m_s
    )
    rate_rad_s = turned_rad / (at_s - before[0]) if at_s > before[0] else 0.0
    if abs(rate_rad_s) < STRAIGHT_RAD_S:
        return x_m + AHEAD_S * vx_m_s, y_m + AHEAD_S * vy_m_s, -radius_m
    turn_m = speed_m_s / rate_rad_s  # turn radius; positive for a left turn
    return x_m - vy_m_s / speed_m_s * turn_m, y_m + vx_m_s / speed_m_s * turn_m, -turn_m
