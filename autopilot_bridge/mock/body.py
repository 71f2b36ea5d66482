"""Computes the motion of a mock vehicle; ``flight_model.py`` selects its manoeuvres."""

import math
from dataclasses import dataclass, field, replace

from autopilot_bridge.mock.kinematics import (
    CALM,
    STEP_S,
    Limits,
    Motion,
    Wind,
    course_along,
    course_around,
    step_copter,
    step_copter_around,
    step_plane,
)
from autopilot_bridge.mock.local_frame import LocalFrame, Terrain
from autopilot_bridge.stacks.stacks import Stack

Place = tuple[float, float]  # metres north and east of home

APPROACH_M = 60.0
LAST_DESCENT_M, LAST_DESCENT_M_S = 10.0, 0.6  # the final, slow part of a copter's landing
GLIDE = math.tan(math.radians(6.0))
IN_PLACE_M = 2.0  # at a shorter horizontal distance, a copter climbs or descends vertically
HIGH_ENOUGH_M = 1.5
WIDER_M = 12.0  # observed with radii of 100 and 150 m: 11 m at 12.6 m/s, 13 m at 22 m/s
SHORT_S = 0.7  # ArduPlane: distance short of the point per m/s of headwind or tailwind
# How far beyond its landing point a PX4 plane comes to rest: a time over the ground, a constant,
# and a time multiplied by the reduction of its airspeed for the approach, up to a maximum.
BEYOND_S, BEYOND_M = 4.5, -9.0
SLOWING_S, MAX_SLOWING_M_S = 5.0, 5.0
MIN_GROUND_SPEED_M_S = 5.0  # PX4: FW_GND_SPD_MIN, which a plane keeps in any wind
FALL_M_S = 8.0  # speed of a copter without power
CIRCLE_RATE_RAD_S = math.radians(20.0)  # ArduCopter's CIRCLE_RATE


def wider_m(stack: Stack) -> float:
    """Return by how many metres the radius of a plane's circle exceeds the commanded one."""
    return WIDER_M if stack.name == "ardupilot" else 0.0


@dataclass(slots=True)
class Body:
    """One vehicle with wind and terrain; each manoeuvre method computes one time step."""

    stack: Stack
    frame: LocalFrame
    limits: Limits
    wind: Wind = CALM
    terrain: Terrain | None = None
    airborne: bool = False
    hovers: bool = False  # whether a VTOL flies as a multirotor
    motion: Motion = field(init=False)
    _stood_amsl_m: float = field(init=False)

    def __post_init__(self) -> None:
        self.hovers = self.stack.vtol
        self.motion = Motion(0.0, 0.0, self.frame.altitude_m)
        self._stood_amsl_m = self.frame.altitude_m

    # State ------------------------------------------------------------------------------------

    @property
    def ground_amsl_m(self) -> float:
        """The altitude of the ground below; without terrain data, where the vehicle last stood."""
        if self.terrain is None:
            return self._stood_amsl_m
        return self.terrain(*self.frame.global_position(self.motion))

    # Manoeuvres -------------------------------------------------------------------------------

    def follow(self, start: Place, end: Place, altitude_m: float) -> None:
        """Move a plane one step along a line."""
        course = course_along(self.motion, start, end, APPROACH_M)
        step_plane(self.motion, course, altitude_m, self.limits, wind=self.wind)

    def approach(self, place: Place, altitude_m: float, stop: bool) -> None:
        """Move a copter one step towards a position."""
        step_copter(self.motion, place, altitude_m, self.limits, stop, self.wind)

    def straight(
        self,
        start: Place,
        place: Place,
        altitude_m: float,
        rise_m: float,
        stop: bool,
        near_m: float,
    ) -> bool:
        """Move a copter one step along a line that rises by ``rise_m``; return whether it arrived.

        The climb rate or the sink rate limits the speed along the line. If the end is directly
        above or below the start, the copter moves vertically.
        """
        length_m, left_m, limits = math.dist(start, place), self.distance(place), self.limits
        target_m = altitude_m
        in_place = length_m <= IN_PLACE_M
        if not in_place:
            rate = limits.climb_m_s if rise_m > 0.0 else limits.sink_m_s
            fastest = rate * length_m / max(abs(rise_m), 1e-6)
            self.limits = replace(limits, airspeed_m_s=min(limits.airspeed_m_s, fastest))
            target_m -= rise_m * min(left_m / length_m, 1.0)
        self.approach(place, target_m, stop or in_place)
        self.limits = limits
        high = abs(self.motion.altitude_m - target_m) <= HIGH_ENOUGH_M
        return high and self.distance(place) <= near_m

    def loiter(self, centre: Place, altitude_m: float, radius_m: float) -> None:
        """Circle for one step (anticlockwise if the radius is negative).

        Copters, and VTOLs flying as multirotors, hover instead.
        """
        if self.stack.vehicle == "copter" or self.hovers:
            step_copter(self.motion, centre, altitude_m, self.limits, stop=True, wind=self.wind)
            return
        clockwise, radius_m = radius_m > 0.0, abs(radius_m)
        radius_m += wider_m(self.stack)
        course = course_around(self.motion, centre, radius_m, clockwise)
        near = abs(self.distance(centre) - radius_m) < 0.2 * radius_m
        turn = self.limits.airspeed_m_s / radius_m if near else 0.0
        turn = turn if clockwise else -turn
        step_plane(self.motion, course, altitude_m, self.limits, turn, self.wind)

    def circle(self, centre: Place, altitude_m: float, radius_m: float) -> None:
        """Move an ArduCopter one step along a circle."""
        motion, limits, size = self.motion, self.limits, abs(radius_m)
        bearing = math.atan2(motion.east_m - centre[1], motion.north_m - centre[0])
        fastest = math.sqrt(limits.acceleration_m_s2 * size)
        speed = min(limits.airspeed_m_s, CIRCLE_RATE_RAD_S * size, fastest)
        ahead = bearing + math.copysign(2.0 * speed * STEP_S / size, radius_m)
        on = (centre[0] + size * math.cos(ahead), centre[1] + size * math.sin(ahead))
        slow = replace(limits, airspeed_m_s=speed)
        step_copter(motion, on, altitude_m, slow, stop=False, wind=self.wind)

    def orbit(self, centre: Place, altitude_m: float, radius_m: float, speed_m_s: float) -> None:
        """Move a PX4 multirotor one step along its orbit, or at cruise speed towards the orbit."""
        on_circle = abs(self.distance(centre) - abs(radius_m)) < 5.0
        speed_m_s = speed_m_s if on_circle else self.limits.airspeed_m_s
        limits = replace(self.limits, airspeed_m_s=speed_m_s)
        step_copter_around(self.motion, centre, altitude_m, limits, radius_m)

    def descend(self, place: Place) -> bool:
        """Compute one step of a copter's landing; return True when it has landed.

        The copter first moves over the position, then descends.
        """
        height_m = self.motion.altitude_m - self.ground_amsl_m
        rate = 0.0
        if self.distance(place) < 1.0:
            rate = self.limits.sink_m_s if height_m > LAST_DESCENT_M else LAST_DESCENT_M_S
        target_m = self.motion.altitude_m - min(rate * STEP_S, max(height_m, 0.0))
        self.approach(place, target_m, stop=True)
        if height_m > rate * STEP_S or rate == 0.0:
            return False
        self.touch(self.ground_amsl_m)
        return True

    def glide(self, start: Place, place: Place, ground_m: float) -> bool:
        """Move a plane one step along a landing approach; return True when it has landed."""
        leg = (place[0] - start[0], place[1] - start[1])
        left = (place[0] - self.motion.north_m, place[1] - self.motion.east_m)
        length = max(math.hypot(*leg), 1.0)
        ahead_m = (left[0] * leg[0] + left[1] * leg[1]) / length
        ahead_m = max(ahead_m + self._beyond_m(leg[0] / length, leg[1] / length), 0.0)
        self.follow(start, place, min(ground_m + ahead_m * GLIDE, self.motion.altitude_m))
        if self.motion.altitude_m > ground_m + 0.1:
            return False
        self.touch(ground_m)
        return True

    def _beyond_m(self, north: float, east: float) -> float:
        """Return how far beyond its landing point a plane comes to rest on this course.

        A PX4 plane in simulation glides above the line to the point, at about its minimum airspeed,
        but never slower than its minimum speed over the ground.
        ArduPlane stops short of the point in a headwind or tailwind, and at the point without wind.
        """
        along_m_s = self.wind.north_m_s * north + self.wind.east_m_s * east
        if self.stack.name != "px4":
            return -SHORT_S * abs(along_m_s)
        across_m_s = self.wind.north_m_s * east - self.wind.east_m_s * north
        needed_m_s = math.hypot(max(MIN_GROUND_SPEED_M_S - along_m_s, 0.0), across_m_s)
        airspeed_m_s = max(self.limits.min_airspeed_m_s, needed_m_s)
        airspeed_m_s = min(airspeed_m_s, self.limits.max_airspeed_m_s)
        ahead_m_s = math.sqrt(max(airspeed_m_s**2 - across_m_s**2, 0.0))
        over_ground_m_s = max(ahead_m_s + along_m_s, 0.0)
        slows_by_m_s = max(self.limits.airspeed_m_s - airspeed_m_s, 0.0)
        slowing_m = SLOWING_S * min(slows_by_m_s, MAX_SLOWING_M_S)
        return max(BEYOND_S * over_ground_m_s + slowing_m + BEYOND_M, 0.0)

    def climb(self, place: Place, altitude_m: float) -> bool:
        """Compute one step of a VTOL's vertical climb; return whether it now flies as a plane."""
        self.approach(place, altitude_m, stop=True)
        self.hovers = self.motion.altitude_m < altitude_m - HIGH_ENOUGH_M
        return not self.hovers

    def land_vertically(self, start: Place, place: Place) -> bool:
        """Compute one step of a VTOL's landing: in level flight as a plane, then down in hover."""
        if not self.hovers:
            brakes_m = self.motion.speed_m_s**2 / (2.0 * self.limits.acceleration_m_s2)
            self.follow(start, place, self.motion.altitude_m)
            self.hovers = self.distance(place) <= brakes_m
            return False
        return self.descend(place)

    def fall(self) -> None:
        """Compute one step without power: a plane sinks at its maximum rate, a copter falls."""
        motion = self.motion
        if self.stack.vehicle == "plane":
            step_plane(motion, motion.course_rad, -math.inf, self.limits, wind=self.wind)
        else:
            motion.climb_m_s = -FALL_M_S
            motion.altitude_m -= FALL_M_S * STEP_S

    def touch(self, ground_m: float) -> None:
        """Put the vehicle on the ground and stop it."""
        self.motion.stop()
        self.motion.altitude_m = self._stood_amsl_m = ground_m
        self.airborne = False

    def distance(self, place: Place) -> float:
        """Return the horizontal distance in metres to a position."""
        return math.hypot(place[0] - self.motion.north_m, place[1] - self.motion.east_m)
