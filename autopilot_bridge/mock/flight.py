"""Flight of the mock: modes, and the execution of a mission's items."""

import math
from dataclasses import dataclass, field, replace
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.mock.kinematics import (
    Limits,
    Motion,
    course_along,
    course_around,
    step_copter,
    step_copter_around,
    step_plane,
)
from autopilot_bridge.stacks import Stack

Mode = Literal["idle", "mission", "hold", "rtl", "guided", "takeoff", "land", "orbit"]

DEFAULT_RADIUS_M = 80.0
APPROACH_M = 60.0
RELATIVE_FRAMES = (
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
)
LOITERS = (
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_NAV_LOITER_TURNS,
    mavlink.MAV_CMD_NAV_LOITER_TIME,
)
NAVIGATION = (mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_TAKEOFF, *LOITERS)


@dataclass(slots=True)
class LocalFrame:
    """Metres north and east of home by the WGS84 radii of curvature there."""

    lat_deg: float
    lon_deg: float
    altitude_m: float
    north_m_per_deg: float = field(init=False)
    east_m_per_deg: float = field(init=False)

    def __post_init__(self) -> None:
        sine = math.sin(math.radians(self.lat_deg))
        first = 1.0 - 6.69437999014e-3 * sine * sine
        meridian = 6378137.0 * (1.0 - 6.69437999014e-3) / first**1.5
        normal = 6378137.0 / math.sqrt(first)
        self.north_m_per_deg = math.radians(meridian)
        self.east_m_per_deg = math.radians(normal) * math.cos(math.radians(self.lat_deg))

    def local(self, item: MissionItem) -> tuple[float, float]:
        """(north, east) of an item."""
        return self.local_of(item.x / 1e7, item.y / 1e7)

    def local_of(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """(north, east) of a place."""
        return (
            (lat_deg - self.lat_deg) * self.north_m_per_deg,
            (lon_deg - self.lon_deg) * self.east_m_per_deg,
        )

    def global_position(self, motion: Motion) -> tuple[float, float]:
        """(latitude, longitude) in degrees."""
        return (
            self.lat_deg + motion.north_m / self.north_m_per_deg,
            self.lon_deg + motion.east_m / self.east_m_per_deg,
        )

    def altitude_amsl_m(self, item: MissionItem) -> float:
        """Altitude of an item above mean sea level."""
        return item.z + (self.altitude_m if item.frame in RELATIVE_FRAMES else 0.0)


@dataclass(slots=True)
class Target:
    """What is being flown: an item, and the leg that leads to it."""

    item: MissionItem
    leg_start: tuple[float, float]
    begun_at_s: float
    turned_rad: float = 0.0
    last_bearing: float | None = None


class Flight:
    """Moves one vehicle through its mission. ``current`` is a wire sequence number."""

    def __init__(self, stack: Stack, frame: LocalFrame, limits: Limits) -> None:
        self.motion = Motion(0.0, 0.0, frame.altitude_m)
        self.frame = frame
        self.limits = limits
        self.mode: Mode = "idle"
        self.armed = False
        self.items: tuple[MissionItem, ...] = ()
        self.current = 0
        self.reached: list[int] = []
        self.begun: list[tuple[int, int]] = []  # items and their commands
        self.target: Target | None = None
        self._stack = stack
        self.radius_m = DEFAULT_RADIUS_M  # of a hold, negative anticlockwise
        self.orbit_m_s = 1.0  # of PX4 multirotors, once they are on the circle
        self._hold_at: tuple[float, float, float] = (0.0, 0.0, frame.altitude_m)
        self._finished = False

    @property
    def airborne(self) -> bool:
        """Off the ground."""
        return self.motion.altitude_m > self.frame.altitude_m + 0.5

    def set_mode(self, mode: Mode, now_s: float) -> None:
        """Change mode; holding happens where the vehicle is."""
        motion = self.motion
        if mode != self.mode:
            self._hold_at = (motion.north_m, motion.east_m, motion.altitude_m)
            self.radius_m = DEFAULT_RADIUS_M
        if mode == "mission" and self.mode != "mission":
            self.go_to(self.current, now_s)
        self.mode = mode

    def fly_around(self, place: tuple[float, float], altitude_m: float, radius_m: float) -> None:
        """Where to hold, and how wide; by this a vehicle leaves the ground too."""
        self._hold_at = (*place, altitude_m)
        self.radius_m = radius_m

    def make_current(self, seq: int, now_s: float) -> None:
        """Make an item the current one; PX4 leaves a DO item there until it flies the mission."""
        if self._stack.item_0_is_home or self.mode == "mission":
            self.go_to(seq, now_s)
        else:
            self.current = seq

    def go_to(self, seq: int, now_s: float) -> None:
        """Make an item the current one and fly it; DO items are passed over."""
        seq = max(seq, 1 if self._stack.item_0_is_home else 0)
        asked = seq
        while seq < len(self.items) and self.items[seq].command not in NAVIGATION:
            seq += 1
        begun = enumerate(self.items[asked : seq + 1], start=asked)
        self.begun.extend((number, item.command) for number, item in begun)
        self.current = min(seq, max(len(self.items) - 1, 0))
        self._finished = seq >= len(self.items)
        if self._finished:
            self.target = None
            self._hold_at = (self.motion.north_m, self.motion.east_m, self.motion.altitude_m)
            return
        here = (self.motion.north_m, self.motion.east_m)
        self.target = Target(self.items[seq], here, now_s)

    def step(self, now_s: float) -> None:
        """One time step."""
        if not self.armed or self.mode == "idle":
            return
        if self.mode == "mission" and self.target is not None:
            self._fly(self.target, now_s)
        elif self.mode == "rtl":
            self._loiter((0.0, 0.0), self.frame.altitude_m + 100.0, DEFAULT_RADIUS_M)
        elif self.mode == "land":
            self._land()
        elif self.airborne or self._hold_at[2] > self.frame.altitude_m + 0.5:
            north, east, altitude_m = self._hold_at
            self._hold((north, east), altitude_m)

    def _hold(self, place: tuple[float, float], altitude_m: float) -> None:
        if self.mode == "orbit":
            on_circle = abs(self._distance(place) - abs(self.radius_m)) < 5.0
            speed_m_s = self.orbit_m_s if on_circle else self.limits.airspeed_m_s
            limits = replace(self.limits, airspeed_m_s=speed_m_s)
            step_copter_around(self.motion, place, altitude_m, limits, self.radius_m)
        else:
            self._loiter(place, altitude_m, self.radius_m)
        taken_off = self.mode == "takeoff" and self.motion.altitude_m > altitude_m - 2.0
        if taken_off and not self._stack.item_0_is_home:
            self.mode = "hold"  # PX4 loiters after its takeoff, ArduPlane's mode stays

    def _land(self) -> None:
        """Straight down (a plane on its circle), then disarm."""
        north, east, _ = self._hold_at
        self._loiter((north, east), self.frame.altitude_m, self.radius_m)
        if not self.airborne:
            self.armed = False
            self.motion.speed_m_s = self.motion.climb_m_s = 0.0

    def _fly(self, target: Target, now_s: float) -> None:
        item = target.item
        altitude_m = self.frame.altitude_amsl_m(item)
        place = self.frame.local(item)
        if item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            self._loiter((0.0, 0.0), altitude_m, DEFAULT_RADIUS_M)
            if self.motion.altitude_m >= altitude_m - 2.0:
                self._advance(now_s)
        elif item.command in LOITERS:
            self._loiter(place, altitude_m, item.param3 or DEFAULT_RADIUS_M)
            if self._loitered(target, place, now_s):
                self._advance(now_s)
        elif self._stack.vehicle == "copter":
            step_copter(self.motion, place, altitude_m, self.limits, stop=False)
            if self._distance(place) <= max(item.param2, 5.0):
                self._advance(now_s)
        else:
            course = course_along(self.motion, target.leg_start, place, APPROACH_M)
            step_plane(self.motion, course, altitude_m, self.limits)
            if self._passed(target, place):
                self._advance(now_s)

    def _advance(self, now_s: float) -> None:
        assert self.target is not None
        self.reached.append(self._told_reached())
        ended_at = self.frame.local(self.target.item)
        was_takeoff = self.target.item.command == mavlink.MAV_CMD_NAV_TAKEOFF
        if self.current + 1 >= len(self.items):
            self.target = None
            self._finished = True
            self._hold_at = (*ended_at, self.motion.altitude_m)
            if self._stack.keeps_target and self._stack.vehicle == "plane":
                self.mode = "rtl"  # ArduPlane goes home after its last item
            return
        self.go_to(self.current + 1, now_s)
        if self.target is not None and not was_takeoff:
            self.target.leg_start = ended_at

    def _told_reached(self) -> int:
        """PX4 tells of the DO items after a waypoint in the waypoint's place."""
        seq = self.current
        if not self._stack.item_0_is_home:
            while seq + 1 < len(self.items) and self.items[seq + 1].command not in NAVIGATION:
                seq += 1
        return seq

    def _loiter(self, centre: tuple[float, float], altitude_m: float, radius_m: float) -> None:
        if self._stack.vehicle == "copter":
            step_copter(self.motion, centre, altitude_m, self.limits, stop=True)
            return
        clockwise, radius_m = radius_m > 0.0, abs(radius_m)
        course = course_around(self.motion, centre, radius_m, clockwise)
        near = abs(self._distance(centre) - radius_m) < 0.2 * radius_m
        turn = self.limits.airspeed_m_s / radius_m if near else 0.0
        step_plane(self.motion, course, altitude_m, self.limits, turn if clockwise else -turn)

    def _loitered(self, target: Target, centre: tuple[float, float], now_s: float) -> bool:
        """Whether a loiter with an end has come to it."""
        if target.item.command == mavlink.MAV_CMD_NAV_LOITER_TIME:
            return now_s - target.begun_at_s >= target.item.param1
        if target.item.command == mavlink.MAV_CMD_NAV_LOITER_TURNS:
            bearing = math.atan2(self.motion.east_m - centre[1], self.motion.north_m - centre[0])
            if target.last_bearing is not None:
                change = (bearing - target.last_bearing + math.pi) % math.tau - math.pi
                target.turned_rad += abs(change)
            target.last_bearing = bearing
            return target.turned_rad >= target.item.param1 * math.tau
        return False

    def _distance(self, place: tuple[float, float]) -> float:
        return math.hypot(place[0] - self.motion.north_m, place[1] - self.motion.east_m)

    def _passed(self, target: Target, place: tuple[float, float]) -> bool:
        """Within the acceptance radius, or past the end of the leg."""
        turn_radius_m = self.limits.airspeed_m_s / self.limits.turn_rate_rad_s
        if self._distance(place) <= max(target.item.param2, 0.7 * turn_radius_m):
            return True
        leg = (place[0] - target.leg_start[0], place[1] - target.leg_start[1])
        beyond = (self.motion.north_m - place[0]) * leg[0] + (self.motion.east_m - place[1]) * leg[
            1
        ]
        return beyond > 0.0 and self._distance(place) < 3.0 * turn_radius_m
