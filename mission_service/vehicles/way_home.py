"""Computes the duration of a vehicle's flight home in a steady wind. Pure.

Positions and velocities are (x, y) on the map: metres east and north. The wind is the velocity of
the air.

A plane flies one turn of constant radius (through the air) and then straight. In the frame of the
air, home moves against the wind, and the plane reaches it when the length of the shortest such path
equals the distance flown through the air by then. A copter turns on the spot and keeps its ground
speed as far as its maximum airspeed permits. A PX4 plane that must climb flies a circle first.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from autopilot_bridge.stacks.return_flight import PX4_CLIMB_RADIUS_M, PX4_CLIMB_WITHIN_M

Vector = tuple[float, float]

ITERATIONS = 50
STEPS = 400  # of the search in a wind faster than the vehicle
CIRCLE_STEP_S = 0.5
GUIDANCE_S = 7.0  # NPFG_PERIOD times NPFG_DAMPING: how far ahead PX4 turns towards its circle
MAX_WAIT_S = 600.0  # after the climb, for a place near the centre
WHOLE_TURN_RAD = math.tau - 1e-9  # a longer turn results from rounding: the turn is 0


def plane_home_s(
    home_m: Vector, through_air_m_s: Vector, wind_m_s: Vector, airspeed_m_s: float, radius_m: float
) -> float:
    """Return the seconds until a plane is at home; infinity if the wind prevents this.

    ``home_m`` is the position of home relative to the plane. Only the direction of
    ``through_air_m_s``, the plane's velocity relative to the air, is used. If home lies inside both
    turning circles, the longer turn is assumed to reach it.
    """
    wind_speed_m_s = math.hypot(*wind_m_s)
    distance_m = math.hypot(*home_m)

    def excess_m(after_s: float) -> float:
        """Return the length of the path home at this time minus the distance flown."""
        place_m = (home_m[0] - wind_m_s[0] * after_s, home_m[1] - wind_m_s[1] * after_s)
        return _turn_and_line_m(place_m, through_air_m_s, radius_m) - airspeed_m_s * after_s

    if distance_m == 0.0:
        return 0.0
    if wind_speed_m_s < airspeed_m_s:
        longest_s = (distance_m + (2.0 + math.tau) * radius_m) / (airspeed_m_s - wind_speed_m_s)
        return _root(excess_m, 0.0, longest_s)
    first_s, last_s = _reachable_s(home_m, wind_m_s, airspeed_m_s)
    before_s = first_s
    for step in range(STEPS + 1) if first_s < math.inf else ():
        after_s = first_s + (last_s - first_s) * step / STEPS
        if excess_m(after_s) <= 0.0:
            return _root(excess_m, before_s, after_s)
        before_s = after_s
    return math.inf


class AfterClimb(NamedTuple):
    """The end of a climb in a circle.

    Attributes:
        after_s: Duration of the climb.
        place_m: Position (x, y) relative to the beginning of the climb.
        through_air_m_s: Velocity relative to the air.
    """

    after_s: float
    place_m: Vector
    through_air_m_s: Vector


def circle_climb(
    through_air_m_s: Vector,
    wind_m_s: Vector,
    airspeed_m_s: float,
    turn_radius_m: float,
    climb_s: float,
) -> AfterClimb:
    """Return where a PX4 plane ends the climb with which its return begins.

    The plane flies outwards from the centre of a circle, joins the circle clockwise and leaves it
    after ``climb_s``, as soon as it is near enough to the centre. Only the direction of
    ``through_air_m_s``, its velocity at the beginning, is used. The duration is infinite if the
    plane is not near enough within ``MAX_WAIT_S`` after the climb. Source: ``rtl_direct.cpp`` and
    ``mission_block.cpp`` of PX4 1.17; the way to the circle approximates its guidance (NPFG).
    """
    x_m, y_m, after_s = 0.0, 0.0, 0.0
    heading_rad = math.atan2(through_air_m_s[1], through_air_m_s[0])
    max_turn_rad = airspeed_m_s / max(turn_radius_m, 1.0) * CIRCLE_STEP_S
    while after_s < climb_s or math.hypot(x_m, y_m) > PX4_CLIMB_WITHIN_M:
        if after_s >= climb_s + MAX_WAIT_S or math.isinf(climb_s):
            return AfterClimb(math.inf, (x_m, y_m), through_air_m_s)
        east_m_s = airspeed_m_s * math.cos(heading_rad) + wind_m_s[0]
        north_m_s = airspeed_m_s * math.sin(heading_rad) + wind_m_s[1]
        course_rad = _course_to_circle_rad((x_m, y_m), (east_m_s, north_m_s))
        wanted_rad = _heading_rad(course_rad, wind_m_s, airspeed_m_s)
        turn_rad = (wanted_rad - heading_rad + math.pi) % math.tau - math.pi
        heading_rad += max(-max_turn_rad, min(max_turn_rad, turn_rad))
        x_m += (airspeed_m_s * math.cos(heading_rad) + wind_m_s[0]) * CIRCLE_STEP_S
        y_m += (airspeed_m_s * math.sin(heading_rad) + wind_m_s[1]) * CIRCLE_STEP_S
        after_s += CIRCLE_STEP_S
    end_m_s = (airspeed_m_s * math.cos(heading_rad), airspeed_m_s * math.sin(heading_rad))
    return AfterClimb(after_s, (x_m, y_m), end_m_s)


def _course_to_circle_rad(place_m: Vector, over_ground_m_s: Vector) -> float:
    """Return the course to the circle, anticlockwise from x, at a place relative to its centre."""
    off_m, speed_m_s = math.hypot(*place_m), max(math.hypot(*over_ground_m_s), 1.0)
    east, north = place_m if off_m > 1.0 else over_ground_m_s
    outwards_rad = math.atan2(north, east)
    away = min(abs(off_m - PX4_CLIMB_RADIUS_M) / (GUIDANCE_S * speed_m_s), 1.0)
    turned_rad = (1.0 - away) ** 2 * math.pi / 2.0  # towards the direction of the circle
    return outwards_rad - (turned_rad if off_m <= PX4_CLIMB_RADIUS_M else math.pi - turned_rad)


def _heading_rad(course_rad: float, wind_m_s: Vector, airspeed_m_s: float) -> float:
    """Return the heading for a course; the nose points into a wind that exceeds the airspeed."""
    to_left_m_s = wind_m_s[1] * math.cos(course_rad) - wind_m_s[0] * math.sin(course_rad)
    return course_rad - math.asin(max(-1.0, min(1.0, to_left_m_s / airspeed_m_s)))


def copter_home_s(
    home_m: Vector, wind_m_s: Vector, speed_m_s: float, max_airspeed_m_s: float
) -> float:
    """Return the seconds until a copter is at home; infinity if the wind prevents this.

    ``speed_m_s`` is its ground speed.
    """
    distance_m = math.hypot(*home_m)
    if distance_m == 0.0:
        return 0.0
    along_m_s = (wind_m_s[0] * home_m[0] + wind_m_s[1] * home_m[1]) / distance_m
    across_m_s = (wind_m_s[0] * home_m[1] - wind_m_s[1] * home_m[0]) / distance_m
    if abs(across_m_s) >= max_airspeed_m_s:
        return math.inf
    fastest_m_s = along_m_s + math.sqrt(max_airspeed_m_s**2 - across_m_s**2)
    return distance_m / min(speed_m_s, fastest_m_s) if fastest_m_s > 0.0 else math.inf


def _turn_and_line_m(place_m: Vector, heading: Vector, radius_m: float) -> float:
    """Return the length of the shortest path to a position: one turn and a straight line."""
    return min(_one_side_m(place_m, heading, radius_m, side) for side in (1.0, -1.0))


def _one_side_m(place_m: Vector, heading: Vector, radius_m: float, side: float) -> float:
    """Return the length of a left (``side`` 1) or right (-1) turn and the line to a position.

    The result is infinite for a position inside the turn.
    """
    start_rad = math.atan2(heading[1], heading[0]) - side * math.pi / 2.0  # seen from the centre
    x_m = place_m[0] + radius_m * math.cos(start_rad)
    y_m = place_m[1] + radius_m * math.sin(start_rad)
    off_m = math.hypot(x_m, y_m)
    if off_m < radius_m:
        return math.inf
    line_m = math.sqrt(off_m**2 - radius_m**2)
    leaves_rad = math.atan2(y_m, x_m) - side * math.atan2(line_m, radius_m)
    turn_rad = side * (leaves_rad - start_rad) % math.tau
    return (turn_rad if turn_rad < WHOLE_TURN_RAD else 0.0) * radius_m + line_m


def _reachable_s(home_m: Vector, wind_m_s: Vector, airspeed_m_s: float) -> tuple[float, float]:
    """Return the first and last time at which a straight flight can reach home in a faster wind."""
    excess = max(wind_m_s[0] ** 2 + wind_m_s[1] ** 2 - airspeed_m_s**2, 1e-6)
    along = wind_m_s[0] * home_m[0] + wind_m_s[1] * home_m[1]
    square = along**2 - excess * (home_m[0] ** 2 + home_m[1] ** 2)
    if along <= 0.0 or square < 0.0:
        return math.inf, math.inf
    root = math.sqrt(square)
    return (along - root) / excess, (along + root) / excess


def _root(excess_m: Callable[[float], float], low_s: float, high_s: float) -> float:
    """Return the time at which the excess falls to 0, found by bisection between two times."""
    for _ in range(ITERATIONS):
        middle_s = (low_s + high_s) / 2.0
        if excess_m(middle_s) > 0.0:
            low_s = middle_s
        else:
            high_s = middle_s
    return high_s
