"""Predicts the impact point of a sphere, and decides when to release it.

Positions are metres east and north (x, y) in the landscape's CRS. Wind and velocity have the same
axes and are in m/s.
"""

import math
from typing import Literal, NamedTuple

GRAVITY_M_S2 = 9.80665
STEP_S = 0.05
SLOW_M_S = 0.5  # below this speed the course is undefined
NEAR_S = 1.0  # a target more than this flight time away may still be passed on another leg

ReleaseDecision = Literal["release", "wait", "missed"]


class VehicleMotion(NamedTuple):
    """A vehicle's position and velocity; ``height_m`` is above the ground at the impact point."""

    x_m: float
    y_m: float
    height_m: float
    east_m_s: float
    north_m_s: float
    climb_m_s: float = 0.0


class ImpactPoint(NamedTuple):
    """The impact point of a sphere, and the time from the order to the impact."""

    x_m: float
    y_m: float
    after_s: float


def impact_point(
    vehicle: VehicleMotion, wind_m_s: tuple[float, float], terminal_speed_m_s: float, delay_s: float
) -> ImpactPoint:
    """Predict the impact point of a sphere whose drop is ordered now.

    The sphere leaves the vehicle ``delay_s`` after the order, with the vehicle's velocity.
    Two accelerations then act on the sphere: gravity g, and drag g (v/vt)^2 opposite to the
    sphere's velocity relative to the air. Here v is the airspeed of the sphere, and vt is its
    terminal speed. The air moves with ``wind_m_s`` (east, north). This drag law holds for spheres
    at Reynolds numbers of 1e4 to 2e5, where the drag coefficient is almost constant. If the release
    point is on or below the ground, the result is the release point.
    """
    drag_per_m = GRAVITY_M_S2 / terminal_speed_m_s**2
    east, north = vehicle.east_m_s - wind_m_s[0], vehicle.north_m_s - wind_m_s[1]
    velocity = (east, north, vehicle.climb_m_s)  # velocity relative to the air
    x = vehicle.x_m + delay_s * vehicle.east_m_s
    y = vehicle.y_m + delay_s * vehicle.north_m_s
    z = vehicle.height_m + delay_s * vehicle.climb_m_s
    fall_s = 0.0
    while z > 0.0:
        step_s = STEP_S
        moved, after = _fall_step(velocity, drag_per_m, step_s)
        if z + moved[2] <= 0.0:  # this step ends on the ground
            for _ in range(4):
                step_s *= z / -moved[2]
                moved, after = _fall_step(velocity, drag_per_m, step_s)
            z = 0.0
        else:
            z += moved[2]
        x += moved[0] + wind_m_s[0] * step_s
        y += moved[1] + wind_m_s[1] * step_s
        fall_s += step_s
        velocity = after
    return ImpactPoint(x, y, delay_s + fall_s)


Vector = tuple[float, float, float]


def _fall_step(velocity: Vector, drag_per_m: float, step_s: float) -> tuple[Vector, Vector]:
    """Return the displacement in a step, and the velocity at its end (fourth-order Runge-Kutta).

    Displacement and velocity are relative to the air.
    """
    half_s = step_s / 2.0
    first = _acceleration(velocity, drag_per_m)
    second_at = _integrated(velocity, first, half_s)
    second = _acceleration(second_at, drag_per_m)
    third_at = _integrated(velocity, second, half_s)
    third = _acceleration(third_at, drag_per_m)
    fourth_at = _integrated(velocity, third, step_s)
    fourth = _acceleration(fourth_at, drag_per_m)
    mean_velocity = _mean(velocity, second_at, third_at, fourth_at)
    mean_acceleration = _mean(first, second, third, fourth)
    moved = _integrated((0.0, 0.0, 0.0), mean_velocity, step_s)
    return moved, _integrated(velocity, mean_acceleration, step_s)


def _mean(*stages: Vector) -> Vector:
    """Return the weighted mean of the four stages of a Runge-Kutta step."""
    x, y, z = ((a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(*stages, strict=True))
    return x, y, z


def _integrated(start: Vector, rate: Vector, step_s: float) -> Vector:
    x, y, z = (value + step_s * slope for value, slope in zip(start, rate, strict=True))
    return x, y, z


def _acceleration(velocity: Vector, drag_per_m: float) -> Vector:
    east, north, up = velocity
    drag = drag_per_m * math.sqrt(east * east + north * north + up * up)
    return -drag * east, -drag * north, -drag * up - GRAVITY_M_S2


def release_decision(
    vehicle: VehicleMotion,
    impact: ImpactPoint,
    target_m: tuple[float, float],
    step_s: float,
    max_miss_m: float,
) -> ReleaseDecision:
    """Decide whether to order the release now, given the predicted impact point.

    The decision is ``wait`` until the impact point, which moves with the vehicle, is nearest to the
    target, within half a telemetry step (``step_s``). At that time the decision is ``release``, or
    ``missed`` if the impact point is farther than ``max_miss_m`` from the target.

    The decision is also ``wait`` in two other cases. If the impact point is farther from the target
    than ``max_miss_m`` plus the distance flown in ``NEAR_S``, the vehicle may still pass the target
    on another leg. A vehicle too slow to have a defined course must wait while the impact point is
    farther than ``max_miss_m`` from the target.
    """
    east, north = target_m[0] - impact.x_m, target_m[1] - impact.y_m
    off_m = math.hypot(east, north)
    speed_m_s = math.hypot(vehicle.east_m_s, vehicle.north_m_s)
    if off_m > max_miss_m + NEAR_S * speed_m_s:
        return "wait"
    if speed_m_s < SLOW_M_S:
        return "release" if off_m <= max_miss_m else "wait"
    ahead_m = (east * vehicle.east_m_s + north * vehicle.north_m_s) / speed_m_s
    if ahead_m > 0.5 * step_s * speed_m_s:
        return "wait"
    return "release" if off_m <= max_miss_m else "missed"
