"""When to release a sphere: its impact point if it were released now, and the release decision.

Metres east and north (x, y) of the landscape's CRS, wind and velocity in the same directions.
"""

import math
from typing import Literal, NamedTuple

GRAVITY_M_S2 = 9.80665
STEP_S = 0.05
SLOW_M_S = 0.5  # below it the course is undefined
NEAR_S = 1.0  # of flight: farther from its target than that, the vehicle is not near it yet

ReleaseDecision = Literal["release", "wait", "missed"]


class VehicleMotion(NamedTuple):
    """A vehicle and its motion; ``height_m`` is above the ground where the sphere will lie."""

    x_m: float
    y_m: float
    height_m: float
    east_m_s: float
    north_m_s: float
    climb_m_s: float = 0.0


class ImpactPoint(NamedTuple):
    """The impact point of a sphere, and its time after the order."""

    x_m: float
    y_m: float
    after_s: float


def impact_point(
    vehicle: VehicleMotion, wind_m_s: tuple[float, float], terminal_speed_m_s: float, delay_s: float
) -> ImpactPoint:
    """The impact point of a sphere that is ordered now.

    ``delay_s`` after the order it leaves with the vehicle's velocity; then gravity g acts, and a
    drag g (v/vt)^2 against its motion v in the wind (east, north), vt being its terminal speed:
    a sphere's at Reynolds numbers of 1e4 to 2e5, where its drag coefficient hardly changes.
    On or below the ground it is the point of release.
    """
    drag_per_m = GRAVITY_M_S2 / terminal_speed_m_s**2
    east, north = vehicle.east_m_s - wind_m_s[0], vehicle.north_m_s - wind_m_s[1]
    velocity = (east, north, vehicle.climb_m_s)  # in the wind
    x = vehicle.x_m + delay_s * vehicle.east_m_s
    y = vehicle.y_m + delay_s * vehicle.north_m_s
    z = vehicle.height_m + delay_s * vehicle.climb_m_s
    fall_s = 0.0
    while z > 0.0:
        step_s = STEP_S
        way, after = _fallen(velocity, drag_per_m, step_s)
        if z + way[2] <= 0.0:  # the step that ends on the ground
            for _ in range(4):
                step_s *= z / -way[2]
                way, after = _fallen(velocity, drag_per_m, step_s)
            z = 0.0
        else:
            z += way[2]
        x += way[0] + wind_m_s[0] * step_s
        y += way[1] + wind_m_s[1] * step_s
        fall_s += step_s
        velocity = after
    return ImpactPoint(x, y, delay_s + fall_s)


Vector = tuple[float, float, float]


def _fallen(velocity: Vector, drag_per_m: float, step_s: float) -> tuple[Vector, Vector]:
    """Displacement in the air and velocity after a step (fourth-order Runge-Kutta)."""
    half_s = step_s / 2.0
    first = _pull(velocity, drag_per_m)
    second_at = _after(velocity, first, half_s)
    second = _pull(second_at, drag_per_m)
    third_at = _after(velocity, second, half_s)
    third = _pull(third_at, drag_per_m)
    fourth_at = _after(velocity, third, step_s)
    fourth = _pull(fourth_at, drag_per_m)
    way = _mean(velocity, second_at, third_at, fourth_at)
    pull = _mean(first, second, third, fourth)
    return _after((0.0, 0.0, 0.0), way, step_s), _after(velocity, pull, step_s)


def _mean(first: Vector, second: Vector, third: Vector, fourth: Vector) -> Vector:
    return (
        (first[0] + 2.0 * (second[0] + third[0]) + fourth[0]) / 6.0,
        (first[1] + 2.0 * (second[1] + third[1]) + fourth[1]) / 6.0,
        (first[2] + 2.0 * (second[2] + third[2]) + fourth[2]) / 6.0,
    )


def _after(velocity: Vector, pull: Vector, step_s: float) -> Vector:
    return (
        velocity[0] + step_s * pull[0],
        velocity[1] + step_s * pull[1],
        velocity[2] + step_s * pull[2],
    )


def _pull(velocity: Vector, drag_per_m: float) -> Vector:
    east, north, up = velocity
    drag = drag_per_m * math.sqrt(east * east + north * north + up * up)
    return -drag * east, -drag * north, -drag * up - GRAVITY_M_S2


def release_decision(
    vehicle: VehicleMotion,
    there: ImpactPoint,
    target_m: tuple[float, float],
    step_s: float,
    max_miss_m: float,
) -> ReleaseDecision:
    """Whether to order the release now; ``there`` is the impact point.

    ``wait`` until the impact point, which moves with the vehicle, is nearest to the target, to half
    a telemetry step. Then ``release``, or ``missed`` if it is farther away than ``max_miss_m``. The
    decision is also ``wait`` far from the target (more than ``max_miss_m`` and ``NEAR_S`` of
    flight), where the vehicle may have passed on another leg, and without a course while the impact
    point is farther away than ``max_miss_m``.
    """
    east, north = target_m[0] - there.x_m, target_m[1] - there.y_m
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
