"""Computes the kinematics of mock vehicles, in metres north and east of home.

One time step (``STEP_US``) is so short that Euler steps are accurate enough. Courses (over the
ground) and headings (of the nose) are in radians clockwise from north.
"""

import math
from dataclasses import dataclass
from functools import cached_property

STEP_US = 125_000
STEP_S = STEP_US / 1e6
GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of the airframe; ``airspeed_m_s`` is the default airspeed."""

    airspeed_m_s: float = 18.0
    min_airspeed_m_s: float = 9.0  # fixed wing
    max_airspeed_m_s: float = 30.0
    bank_deg: float = 40.0
    climb_m_s: float = 4.0
    sink_m_s: float = 4.0
    acceleration_m_s2: float = 3.0
    yaw_rate_deg_s: float = 90.0  # multirotor

    @property
    def turn_rate_rad_s(self) -> float:
        """The maximum turn rate in level flight, at the bank limit."""
        return GRAVITY_M_S2 * math.tan(math.radians(self.bank_deg)) / self.airspeed_m_s


@dataclass(frozen=True)
class Wind:
    """A steady wind: the speed, and the direction from which the wind blows."""

    from_deg: float = 0.0
    speed_m_s: float = 0.0

    @cached_property
    def north_m_s(self) -> float:
        """The north component of the velocity of the air."""
        return -self.speed_m_s * math.cos(math.radians(self.from_deg))

    @cached_property
    def east_m_s(self) -> float:
        """The east component of the velocity of the air."""
        return -self.speed_m_s * math.sin(math.radians(self.from_deg))


CALM = Wind()


@dataclass(slots=True)
class Motion:
    """The position and velocity of a vehicle.

    ``altitude_m`` is above mean sea level; ``course_rad`` and ``speed_m_s`` are over the ground,
    ``heading_rad`` and ``airspeed_m_s`` through the air.
    """

    north_m: float
    east_m: float
    altitude_m: float
    course_rad: float = 0.0
    speed_m_s: float = 0.0
    climb_m_s: float = 0.0
    heading_rad: float = 0.0
    airspeed_m_s: float = 0.0
    roll_rad: float = 0.0

    def stop(self) -> None:
        """Set all speeds to 0."""
        self.speed_m_s = self.climb_m_s = self.airspeed_m_s = self.roll_rad = 0.0


def wrap(angle_rad: float) -> float:
    """Return the equivalent angle from -pi to pi."""
    return (angle_rad + math.pi) % math.tau - math.pi


def course_along(
    motion: Motion, start: tuple[float, float], end: tuple[float, float], approach_m: float
) -> float:
    """Return the course that joins the line from ``start`` to ``end`` and follows it.

    The course follows a vector field; at the distance ``approach_m`` from the line, the angle
    between the course and the line is 45 degrees.
    """
    leg_north, leg_east = end[0] - start[0], end[1] - start[1]
    length = math.hypot(leg_north, leg_east)
    if length < 1.0:
        return math.atan2(end[1] - motion.east_m, end[0] - motion.north_m)
    off_north, off_east = motion.north_m - start[0], motion.east_m - start[1]
    right_m = (leg_north * off_east - leg_east * off_north) / length
    return math.atan2(leg_east, leg_north) - math.atan(right_m / approach_m)


def course_around(
    motion: Motion, centre: tuple[float, float], radius_m: float, clockwise: bool
) -> float:
    """Return the course that joins a circle and follows it (vector field)."""
    north, east = motion.north_m - centre[0], motion.east_m - centre[1]
    distance = math.hypot(north, east)
    outward = math.atan2(east, north)
    inwards = math.atan(3.0 * (distance - radius_m) / radius_m)
    quarter = math.pi / 2.0
    return outward + (quarter + inwards if clockwise else -quarter - inwards)


def climb_towards(motion: Motion, altitude_m: float, limits: Limits) -> None:
    """Move the altitude one step towards the target altitude."""
    climb_m_s = (altitude_m - motion.altitude_m) / STEP_S
    motion.climb_m_s = max(-limits.sink_m_s, min(limits.climb_m_s, climb_m_s))
    motion.altitude_m += motion.climb_m_s * STEP_S


def crab(course_rad: float, airspeed_m_s: float, wind: Wind) -> tuple[float, float]:
    """Return the heading and the ground speed for a course in a wind (wind triangle).

    If the crosswind exceeds the airspeed, the nose points into the crosswind.
    """
    north, east = math.cos(course_rad), math.sin(course_rad)
    # Positive if the wind comes from the left.
    across = wind.east_m_s * north - wind.north_m_s * east
    along = wind.north_m_s * north + wind.east_m_s * east
    sine = max(-1.0, min(1.0, across / airspeed_m_s))
    speed = airspeed_m_s * math.sqrt(1.0 - sine * sine) + along
    return course_rad - math.asin(sine), speed


def step_plane(
    motion: Motion,
    course_rad: float,
    altitude_m: float,
    limits: Limits,
    feed_rad_s: float = 0.0,
    wind: Wind = CALM,
) -> None:
    """Move a fixed wing one step at its airspeed, with the turn rate within the bank limit.

    ``feed_rad_s`` is the turn rate that keeps the vehicle exactly on a circular path without wind.
    """
    airspeed = limits.airspeed_m_s
    if motion.airspeed_m_s > 0.0:  # otherwise the vehicle is launched at its airspeed
        gain = limits.acceleration_m_s2 * STEP_S
        airspeed = max(motion.airspeed_m_s - gain, min(motion.airspeed_m_s + gain, airspeed))
    heading_rad = course_rad
    if wind.speed_m_s > 0.0:
        heading_rad, ground = crab(course_rad, airspeed, wind)
        ahead = max(airspeed * math.cos(heading_rad - course_rad), 0.1 * airspeed)
        feed_rad_s *= ground * ground / (airspeed * ahead)  # d(heading)/d(course) is ground / ahead
    most = limits.turn_rate_rad_s
    turn = feed_rad_s + wrap(heading_rad - motion.heading_rad) / (2.0 * STEP_S)
    turn = max(-most, min(most, turn))
    middle = motion.heading_rad + turn * STEP_S / 2.0
    north, east = airspeed * math.cos(middle), airspeed * math.sin(middle)
    motion.heading_rad = (motion.heading_rad + turn * STEP_S) % math.tau
    if wind.speed_m_s > 0.0:
        north, east = north + wind.north_m_s, east + wind.east_m_s
        motion.speed_m_s, motion.course_rad = math.hypot(north, east), math.atan2(east, north)
    else:
        motion.speed_m_s, motion.course_rad = airspeed, motion.heading_rad
    motion.north_m += north * STEP_S
    motion.east_m += east * STEP_S
    motion.airspeed_m_s = airspeed
    motion.roll_rad = math.atan(airspeed * turn / GRAVITY_M_S2)
    climb_towards(motion, altitude_m, limits)


def step_copter(
    motion: Motion,
    target: tuple[float, float],
    altitude_m: float,
    limits: Limits,
    stop: bool,
    wind: Wind = CALM,
) -> None:
    """Move a multirotor one step towards a point; with ``stop`` it slows down to hover there.

    The vehicle keeps its ground speed unless this would require more than the maximum airspeed. The
    nose turns to the course at the maximum yaw rate.
    """
    north, east = target[0] - motion.north_m, target[1] - motion.east_m
    distance = math.hypot(north, east)
    fastest = limits.airspeed_m_s
    if stop:
        fastest = min(fastest, math.sqrt(2.0 * limits.acceleration_m_s2 * distance))
    gain = limits.acceleration_m_s2 * STEP_S
    speed = max(min(fastest, motion.speed_m_s + gain), motion.speed_m_s - gain)
    speed = min(speed, distance / STEP_S) if stop else speed
    north_m_s = east_m_s = 0.0
    if distance > 1e-6:
        north_m_s, east_m_s = speed * north / distance, speed * east / distance
    motion.airspeed_m_s = speed
    if wind.speed_m_s > 0.0:
        air_north, air_east = north_m_s - wind.north_m_s, east_m_s - wind.east_m_s
        motion.airspeed_m_s = math.hypot(air_north, air_east)
        if motion.airspeed_m_s > limits.max_airspeed_m_s:  # the wind exceeds the airspeed
            share = limits.max_airspeed_m_s / motion.airspeed_m_s
            north_m_s = air_north * share + wind.north_m_s
            east_m_s = air_east * share + wind.east_m_s
            motion.airspeed_m_s = limits.max_airspeed_m_s
            north, east, distance = north_m_s, east_m_s, math.hypot(north_m_s, east_m_s)
            speed = distance
    if distance > 1e-6:
        motion.course_rad = math.atan2(east, north) % math.tau
    motion.north_m += north_m_s * STEP_S
    motion.east_m += east_m_s * STEP_S
    motion.speed_m_s = speed
    if speed > 0.5:
        most = math.radians(limits.yaw_rate_deg_s) * STEP_S
        turn = max(-most, min(most, wrap(motion.course_rad - motion.heading_rad)))
        motion.heading_rad = (motion.heading_rad + turn) % math.tau
    climb_towards(motion, altitude_m, limits)


def step_copter_around(
    motion: Motion,
    centre: tuple[float, float],
    altitude_m: float,
    limits: Limits,
    radius_m: float,
) -> None:
    """Move a multirotor one step to or along a circle, anticlockwise if the radius is negative."""
    course = course_around(motion, centre, abs(radius_m), radius_m > 0.0)
    ahead_m = max(limits.airspeed_m_s * STEP_S, 1e-3)
    north_m = motion.north_m + ahead_m * math.cos(course)
    east_m = motion.east_m + ahead_m * math.sin(course)
    distance_m = math.hypot(north_m - centre[0], east_m - centre[1])
    # The vehicle is on the circle, so correct for the chord.
    if abs(distance_m - abs(radius_m)) < ahead_m:
        scale = abs(radius_m) / distance_m
        north_m = centre[0] + (north_m - centre[0]) * scale
        east_m = centre[1] + (east_m - centre[1]) * scale
    step_copter(motion, (north_m, east_m), altitude_m, limits, stop=False)
