"""How mock vehicles move. Pure functions of floats, in metres north and east of home.

One step is short (``STEP_US``), so that plain Euler steps serve. Courses are radians clockwise
from north.
"""

import math
from dataclasses import dataclass

STEP_US = 125_000
STEP_S = STEP_US / 1e6
GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True)
class Limits:
    """What the airframe can do."""

    airspeed_m_s: float = 18.0
    bank_deg: float = 40.0
    climb_m_s: float = 4.0
    acceleration_m_s2: float = 3.0  # multirotor

    @property
    def turn_rate_rad_s(self) -> float:
        """Largest turn rate at the bank limit in level flight."""
        return GRAVITY_M_S2 * math.tan(math.radians(self.bank_deg)) / self.airspeed_m_s


@dataclass(slots=True)
class Motion:
    """Where a vehicle is and how it moves; ``altitude_m`` is above mean sea level."""

    north_m: float
    east_m: float
    altitude_m: float
    course_rad: float = 0.0
    speed_m_s: float = 0.0
    climb_m_s: float = 0.0


def wrap(angle_rad: float) -> float:
    """To -pi ... pi."""
    return (angle_rad + math.pi) % math.tau - math.pi


def course_along(
    motion: Motion, start: tuple[float, float], end: tuple[float, float], approach_m: float
) -> float:
    """Course that joins the line from start to end and follows it (vector field).

    ``approach_m`` off the line the course cuts in at 45 degrees.
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
    """Course that joins a circle and follows it (vector field)."""
    north, east = motion.north_m - centre[0], motion.east_m - centre[1]
    distance = math.hypot(north, east)
    outward = math.atan2(east, north)
    inwards = math.atan(3.0 * (distance - radius_m) / radius_m)
    quarter = math.pi / 2.0
    return outward + (quarter + inwards if clockwise else -quarter - inwards)


def climb_towards(motion: Motion, altitude_m: float, limits: Limits) -> None:
    """Move the altitude one step towards the wished one."""
    wanted = (altitude_m - motion.altitude_m) / STEP_S
    motion.climb_m_s = max(-limits.climb_m_s, min(limits.climb_m_s, wanted))
    motion.altitude_m += motion.climb_m_s * STEP_S


def step_plane(
    motion: Motion, course_rad: float, altitude_m: float, limits: Limits, feed_rad_s: float = 0.0
) -> None:
    """One step of a fixed wing: constant airspeed, turn rate within the bank limit.

    ``feed_rad_s`` is the turn rate the path itself has (on a circle), so that it is held exactly.
    """
    most = limits.turn_rate_rad_s
    turn = feed_rad_s + wrap(course_rad - motion.course_rad) / (2.0 * STEP_S)
    turn = max(-most, min(most, turn))
    middle = motion.course_rad + turn * STEP_S / 2.0
    motion.speed_m_s = limits.airspeed_m_s
    motion.north_m += motion.speed_m_s * math.cos(middle) * STEP_S
    motion.east_m += motion.speed_m_s * math.sin(middle) * STEP_S
    motion.course_rad = (motion.course_rad + turn * STEP_S) % math.tau
    climb_towards(motion, altitude_m, limits)


def step_copter(
    motion: Motion, target: tuple[float, float], altitude_m: float, limits: Limits, stop: bool
) -> None:
    """One step of a multirotor towards a point; with ``stop`` it slows down to hover there."""
    north, east = target[0] - motion.north_m, target[1] - motion.east_m
    distance = math.hypot(north, east)
    fastest = limits.airspeed_m_s
    if stop:
        fastest = min(fastest, math.sqrt(2.0 * limits.acceleration_m_s2 * distance))
    gain = limits.acceleration_m_s2 * STEP_S
    speed = max(min(fastest, motion.speed_m_s + gain), motion.speed_m_s - gain)
    speed = min(speed, distance / STEP_S) if stop else speed
    if distance > 1e-6:
        motion.course_rad = math.atan2(east, north) % math.tau
        motion.north_m += speed * north / distance * STEP_S
        motion.east_m += speed * east / distance * STEP_S
    motion.speed_m_s = speed
    climb_towards(motion, altitude_m, limits)


def step_copter_around(
    motion: Motion,
    centre: tuple[float, float],
    altitude_m: float,
    limits: Limits,
    radius_m: float,
) -> None:
    """One step of a multirotor on its way to a circle and along it; negative is anticlockwise."""
    course = course_around(motion, centre, abs(radius_m), radius_m > 0.0)
    ahead_m = max(limits.airspeed_m_s * STEP_S, 1e-3)
    north_m = motion.north_m + ahead_m * math.cos(course)
    east_m = motion.east_m + ahead_m * math.sin(course)
    distance_m = math.hypot(north_m - centre[0], east_m - centre[1])
    if abs(distance_m - abs(radius_m)) < ahead_m:  # on it: the chord must not lead outwards
        scale = abs(radius_m) / distance_m
        north_m = centre[0] + (north_m - centre[0]) * scale
        east_m = centre[1] + (east_m - centre[1]) * scale
    step_copter(motion, (north_m, east_m), altitude_m, limits, stop=False)
