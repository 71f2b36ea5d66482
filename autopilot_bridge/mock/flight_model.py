"""Simulates the flight of the mock: its modes, and the execution of a mission's items."""

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import LANDINGS, TAKEOFFS, MissionItem, params_of
from autopilot_bridge.mock.body import HIGH_ENOUGH_M, Body, Place
from autopilot_bridge.mock.failsafe_causes import Battery, FailsafeReaction
from autopilot_bridge.mock.item_flight import Target, climbed_ahead, loitered, passed
from autopilot_bridge.mock.kinematics import Limits
from autopilot_bridge.mock.mission_sequencer import (
    DEFAULT_RADIUS_M,
    LOITERS,
    NAVIGATION,
    WAYPOINTS,
    next_of,
)
from autopilot_bridge.mock.mock_camera import MockCamera
from autopilot_bridge.mock.payload import Payload
from autopilot_bridge.mock.stack_constants import stack_constants_of
from autopilot_bridge.stacks.return_flight import (
    MULTIROTOR_BEGIN_S,
    PX4_CLIMB_ENDS_BELOW_M,
    PX4_CLIMB_WITHIN_M,
    UNREAD,
    ReturnFlight,
    true_airspeed_factor,
)

Mode = Literal[
    "idle",
    "mission",
    "hold",
    "rtl",
    "guided",
    "takeoff",
    "land",
    "orbit",
    "glide",
    "termination",
]

GLIDES_AT_M_S = 3.0  # minimum sink rate of a vehicle whose engine has failed
GLIDES_BY = 0.7  # airspeed after an engine failure, as a fraction of the airspeed before
TAKEOFF_REACHED_M = 30.0
FLARES_BELOW_M = 3.0  # below this height ArduPlane refuses a go-around
# After these items a plane continues from its position, not from that of the item.
LEFT_ON_COURSE = (
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
    mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT,
)
# A copter lands at its estimated position after this time without satellites, with the default
# parameters of the stacks (FS_EKF_ACTION = 1; PX4 without a remote control).
BLIND_AFTER_S = {("ardupilot", "copter"): 8.0, ("px4", "copter"): 5.0}
# Time on the ground until the vehicle disarms (LAND_DISARMDELAY, COM_DISARM_LAND).
DISARM_AFTER_S = {("ardupilot", "plane"): 20.0, ("ardupilot", "copter"): 0.0}


@dataclass(slots=True)
class FlightModel(Body):
    """The flight of one vehicle; ``current`` is a sequence number as transmitted.

    The telemetry sender sends the contents of ``reached`` and ``texts``, and clears both.
    """

    battery: Battery = field(default_factory=Battery)
    gps: bool = True
    mode: Mode = "idle"
    armed: bool = False
    crashed: bool = False
    falls: bool = False  # without power, after a failsafe that stops the motors
    blind: bool = False  # no position is available; modes that need one are rejected
    failsafe: bool = False  # whether a failsafe is active
    engine_failed: bool = False
    fence: bool | None = None  # whether a fence is breached; None if no fence is enabled
    items: tuple[MissionItem, ...] = ()
    current: int = 0
    reached: list[int] = field(default_factory=list)
    texts: list[tuple[int, str]] = field(default_factory=list)  # severity and text
    target: Target | None = None
    payload: Payload = field(init=False)
    radius_m: float = DEFAULT_RADIUS_M  # radius of a hold, negative if anticlockwise
    returns: ReturnFlight = UNREAD  # read from the parameters
    orbit_m_s: float = 1.0  # speed of PX4 multirotors on the circle
    _hold_at: tuple[float, float, float] = field(init=False)
    _cruise_m_s: float = field(init=False)
    _powered: Limits = field(init=False)  # the limits while the engine runs
    _return_amsl_m: float = field(init=False)
    _in_return_climb: bool = False  # of a PX4 plane
    _stops: bool = False  # a multirotor stops before it flies home
    _flies_home_at_s: float = math.inf  # after it has stopped
    _disarm_at_s: float = math.inf
    _descended_from_m: float = 0.0  # altitude at which a VTOL's vertical landing began
    _climbs_to_m: float | None = None  # altitude to which a VTOL climbs after a go-around
    _fix_s: float = 0.0  # time of the last fix
    _jumps: dict[int, int] = field(default_factory=dict)
    _waiting: deque[int] = field(default_factory=deque)  # ArduPilot's DO items to execute
    _wait_until_s: float = 0.0
    _wait_within_m: float = math.inf

    def __post_init__(self) -> None:
        Body.__post_init__(self)
        self.payload = Payload(self.stack)
        self.texts = self.payload.texts
        self._hold_at = (0.0, 0.0, self.frame.altitude_m)
        self._cruise_m_s = self.limits.airspeed_m_s
        self._powered = self.limits
        self._return_amsl_m = self.frame.altitude_m

    def rebooted(self) -> "FlightModel":
        """Return the same vehicle at the same position, disarmed, with a restarted autopilot."""
        cruise = replace(self.limits, airspeed_m_s=self._cruise_m_s)
        fresh = FlightModel(
            self.stack, self.frame, cruise, self.wind, self.terrain, battery=self.battery
        )
        fresh.motion, fresh.items, fresh.gps = self.motion, self.items, self.gps
        fresh.airborne, fresh.crashed = self.airborne, self.crashed
        fresh.falls, fresh.hovers = self.falls, self.hovers
        fresh.fence, fresh.engine_failed = self.fence, self.engine_failed
        if self.engine_failed:
            fresh._powered = replace(self._powered, airspeed_m_s=self._cruise_m_s)
        fresh._stood_amsl_m = self._stood_amsl_m
        fresh.payload.outputs = self.payload.outputs
        if self.payload.camera is not None:
            fresh.payload.camera = MockCamera(self.stack, self.payload.camera.on_image)
        return fresh

    def blind_s(self, now_s: float) -> float:
        """Return the seconds since the last fix; 0 with satellites.

        On the ground without satellites, the result is infinite.
        """
        if self.gps:
            return 0.0
        return now_s - self._fix_s if self.airborne else math.inf

    # Commands ---------------------------------------------------------------------------------

    def set_mode(self, mode: Mode, now_s: float) -> None:
        """Change the mode; a hold is at the current position."""
        motion, before = self.motion, self.mode
        self.mode = mode
        self.falls &= before != "glide"
        if mode != before:
            self._hold_at = (motion.north_m, motion.east_m, motion.altitude_m)
            self.radius_m = DEFAULT_RADIUS_M
            self._return_amsl_m = self._return_altitude_amsl_m()
            self._climbs_to_m = None
            self._become_plane(mode != "mission")
            if mode == "rtl":
                self._begin_return()
            elif self.stack.vehicle == "plane":  # a mode change cancels a commanded speed
                self.limits = replace(self.limits, airspeed_m_s=self._cruise_m_s)
        if mode == "mission" and before != "mission":
            self.go_to(self.current, now_s)

    def _become_plane(self, flies_as_plane: bool) -> None:
        """End the hover of an airborne ArduPlane VTOL if it flies its mode or item as a plane."""
        if self.stack.item_0_is_home and self.airborne and flies_as_plane:
            self.hovers = False

    def fly_around(self, place: Place, altitude_m: float, radius_m: float) -> None:
        """Set the position, altitude and radius of the hold; a vehicle on the ground takes off."""
        self._hold_at = (*place, altitude_m)
        self.radius_m = radius_m

    def make_current(self, seq: int, now_s: float) -> None:
        """Set the current item; PX4 executes the item only in mission mode."""
        if seq <= 1:
            self._jumps.clear()
        if self.stack.item_0_is_home or self.mode == "mission":
            self.go_to(seq, now_s)
        else:
            self.current = seq

    @property
    def lands(self) -> bool:
        """Whether the vehicle executes a landing item of its mission."""
        item = None if self.target is None else self.target.item
        return self.mode == "mission" and item is not None and item.command in LANDINGS

    @property
    def throttle_percent(self) -> int:
        """The throttle that VFR_HUD reports, in percent."""
        if not self.armed:
            return 0
        return 100 if self.engine_failed else 60

    def fail_engine(self, failed: bool) -> None:
        """Stop or restart the engine; without its engine the vehicle sinks and sends no report."""
        if failed == self.engine_failed:
            return
        self.engine_failed = failed
        if failed:
            self._powered = self.limits
            glide_m_s = self.limits.airspeed_m_s * GLIDES_BY
            self.limits = replace(self.limits, climb_m_s=-GLIDES_AT_M_S, airspeed_m_s=glide_m_s)
        else:
            self.limits = self._powered

    def change_cruise(self, airspeed_m_s: float) -> None:
        """Set the default airspeed."""
        self._cruise_m_s = airspeed_m_s
        self.limits = replace(self.limits, airspeed_m_s=airspeed_m_s)

    def change_speed(self, kind: int, speed_m_s: float) -> bool:
        """Execute DO_CHANGE_SPEED, and return whether the command is accepted.

        ``kind`` is 0 for airspeed and 1 for ground speed; a speed of -2 resets the speed. Planes
        accept an airspeed within their limits and ignore a ground speed. ArduCopter also accepts
        kinds 2 (climb rate) and 3 (sink rate).
        """
        if kind in (2, 3) and self.stack.name == "ardupilot" and speed_m_s > 0.0:
            change = {"climb_m_s" if kind == 2 else "sink_m_s": speed_m_s}
            self.limits = replace(self.limits, **change)
            return True
        if speed_m_s == -2.0:
            speed_m_s = self._cruise_m_s
        plane = self.stack.vehicle == "plane"
        if plane and kind != 0:
            return True
        minimum = self.limits.min_airspeed_m_s if plane else 0.1
        if not minimum <= speed_m_s <= self.limits.max_airspeed_m_s:
            return False
        self.limits = replace(self.limits, airspeed_m_s=speed_m_s)
        return True

    def go_to(self, seq: int, now_s: float) -> None:
        """Fly the next NAV item from ``seq`` on, and execute the DO items before it.

        ArduPilot executes the first DO item, begins the NAV item, and executes the other DO items
        one by one in flight. After the last NAV item, ArduPilot executes only the first DO item.
        PX4 executes all DO items in sequence.
        """
        seq = max(seq, 1 if self.stack.item_0_is_home else 0)
        if self._skips(seq):
            seq += 1
        do_items, nav = next_of(self.items, seq, self._jumps)
        ardupilot = self.stack.item_0_is_home
        first = do_items[:1] if ardupilot else do_items
        self._waiting = deque(do_items[1:] if ardupilot and nav is not None else ())
        self._wait_until_s, self._wait_within_m = now_s, math.inf
        for number in first:
            self._run(number, now_s)
        if nav is None:
            self.current = max(len(self.items) - 1, 0)
            self.target = None
            self._hold_at = (self.motion.north_m, self.motion.east_m, self.motion.altitude_m)
            return
        self.current = nav
        self._become_plane(self.items[nav].command not in (*TAKEOFFS, *LANDINGS))
        self._send_name(nav)
        position = (self.motion.north_m, self.motion.east_m)
        self.target = Target(self.items[nav], position, self.motion.altitude_m, now_s)

    def _skips(self, seq: int) -> bool:
        """Return whether an item is skipped; airborne PX4 planes skip a takeoff.

        Source: PX4 1.17 ``setActiveMissionItems``.
        """
        px4_plane = (self.stack.name, self.stack.vehicle) == ("px4", "plane")
        flies = px4_plane and self.airborne and self.mode == "mission"
        return flies and seq < len(self.items) and self.items[seq].command in TAKEOFFS

    def step(self, now_s: float) -> None:
        """Compute one time step."""
        if self.falls and self.airborne:
            self.fall()
            self._detect_crash()
            return
        if self.crashed or not self.armed or self.mode == "idle":
            self.armed = self.armed and not self.crashed
            return
        if now_s >= self._disarm_at_s:
            self._disarm_at_s = math.inf
            self.armed = self.airborne
            return
        if self.battery.percent is not None and self.airborne and self._out_of_power(now_s):
            return
        self._land_blind(now_s)
        if self.mode == "mission" and self.target is not None:
            self._fly(self.target, now_s)
            if self._waiting and self.mode == "mission":
                self._run_waiting(now_s)
        elif self.mode == "rtl":
            self._return(now_s)
        elif self.mode == "land":
            self._land_at_position(now_s)
        elif self.airborne or self._hold_at[2] > self._stood_amsl_m + 0.5:
            self._hold()
        if not self.airborne:
            self.airborne = self.motion.altitude_m > self._stood_amsl_m + 0.5
        if self.terrain is not None and self.airborne:
            self._detect_crash()

    # Items ------------------------------------------------------------------------------------

    def _run(self, seq: int, now_s: float) -> None:
        """Execute a DO item if the vehicle is in mission mode."""
        item = self.items[seq]
        if self.mode != "mission":
            return
        self._send_name(seq)
        match item.command:
            case mavlink.MAV_CMD_DO_CHANGE_SPEED:
                self.change_speed(int(item.param1), item.param2)
            case mavlink.MAV_CMD_DO_VTOL_TRANSITION if self.stack.vtol:
                self.hovers = item.param1 == mavlink.MAV_VTOL_STATE_MC
            case mavlink.MAV_CMD_CONDITION_DELAY:
                self._wait_until_s = now_s + item.param1
            case mavlink.MAV_CMD_CONDITION_DISTANCE:
                self._wait_within_m = item.param1
            case command:
                self.payload.execute(command, params_of(item), round(now_s * 1e6))

    def _send_name(self, seq: int) -> None:
        """Send the name of an item, as ArduPilot does for each item in AUTO."""
        names, command = stack_constants_of(self.stack).mission_names, self.items[seq].command
        if names and self.mode == "mission":
            self.texts.append((6, f"Mission: {seq} {names.get(command, command)}"))

    def _run_waiting(self, now_s: float) -> None:
        """Execute the queued DO items in sequence, up to an item that causes a delay."""
        assert self.target is not None
        left_m = self.distance(self.frame.local(self.target.item))
        may_run = self._wait_until_s < now_s
        while self._waiting and may_run and left_m <= self._wait_within_m:
            self._wait_within_m = math.inf
            self._run(self._waiting.popleft(), now_s)
            may_run = self._wait_until_s <= now_s

    def _fly(self, target: Target, now_s: float) -> None:
        item = target.item
        place = self._place(target)
        if item.command in TAKEOFFS and self.stack.vtol:
            done = self._take_off_vertically(target, place)
        elif item.command in TAKEOFFS:
            altitude_m = self._altitude(item)
            self.loiter(target.leg_start, altitude_m, DEFAULT_RADIUS_M)
            done = self.motion.altitude_m >= altitude_m - 2.0
        elif item.command in LOITERS:
            following = self._following()
            done = loitered(self, target, place, self._altitude(item), now_s, following)
        elif item.command in WAYPOINTS:
            done = passed(self, target, place, self._altitude(item), now_s)
        elif item.command == mavlink.MAV_CMD_NAV_DELAY:
            self.loiter(target.leg_start, target.begun_amsl_m, DEFAULT_RADIUS_M)
            done = now_s - target.begun_at_s >= item.param1
        elif item.command == mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT:
            done = climbed_ahead(self, target, self._altitude(item))
        elif item.command in LANDINGS:
            done = self.airborne and self._land(target, place, now_s)
        elif item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            done = self._return_item(now_s)
        else:
            done = True
        if done:
            self._advance(now_s)

    def _take_off_vertically(self, target: Target, place: Place) -> bool:
        """Climb in hover, then fly as a plane to the item's position (PX4) or onwards (ArduPlane).

        ArduPlane climbs to the item's altitude above its starting position, in every frame.
        """
        px4, item = self.stack.name == "px4", target.item
        altitude_m = self._altitude(item) if px4 else target.begun_amsl_m + item.z
        if self.hovers and not self.climb(target.leg_start, altitude_m):
            return False
        if not px4:
            return True
        self.follow(target.leg_start, place, altitude_m)
        return self.distance(place) <= TAKEOFF_REACHED_M

    def _place(self, target: Target) -> Place:
        """Return the position of an item; an item at 0, 0 is at the start of its leg."""
        item = target.item
        return self.frame.local(item) if item.x or item.y else target.leg_start

    def _following(self) -> Place | None:
        """Return the position of the next NAV item, if it has one."""
        _, seq = next_of(self.items, self.current + 1, dict(self._jumps))
        item = None if seq is None else self.items[seq]
        return self.frame.local(item) if item is not None and (item.x or item.y) else None

    def go_around(self, now_s: float) -> bool:
        """Execute DO_GO_AROUND as ArduPlane does; return whether it is accepted.

        The plane must be flying a landing and must not have begun its flare.
        """
        lands = self.mode == "mission" and self.target is not None
        lands = lands and self.airborne and self.items[self.current].command in LANDINGS
        if not lands or self.motion.altitude_m - self.ground_amsl_m < FLARES_BELOW_M:
            return False
        following = self.current + 1
        if self.stack.vtol:  # climbs to the height at which the descent began
            self._climbs_to_m = self._descended_from_m
            return self.hovers
        ahead = mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT
        climbs = following < len(self.items) and self.items[following].command == ahead
        self.go_to(following if climbs else self.current - 1, now_s)
        return True

    def _altitude(self, item: MissionItem) -> float:
        return self.frame.altitude_amsl_m(item, self.ground_amsl_m)

    def _advance(self, now_s: float) -> None:
        assert self.target is not None
        self.reached.append(self._reached_seq())
        ended, flown = self.target, self.current
        self._hold_at = (*self._place(ended), self.motion.altitude_m)
        self.go_to(flown + 1, now_s)
        if self.target is not None:
            plane_down = ended.item.command in LEFT_ON_COURSE and self.stack.vehicle == "plane"
            if ended.item.command not in TAKEOFFS and not plane_down:
                self.target.leg_start = self._place(ended)
            return
        self.current = flown
        self._hold_at = (*self._place(ended), self.motion.altitude_m)
        if self.stack.keeps_target and self.stack.vehicle == "plane":
            self.set_mode("rtl", now_s)  # ArduPlane returns after its last item
            self.texts.append((6, "Mission complete, changing mode to RTL"))

    def _reached_seq(self) -> int:
        """Return the item to report as reached; PX4 reports the last DO item after a waypoint."""
        seq = self.current
        if not self.stack.item_0_is_home:
            while seq + 1 < len(self.items) and self.items[seq + 1].command not in NAVIGATION:
                seq += 1
        return seq

    # Manoeuvres -------------------------------------------------------------------------------

    def _hold(self) -> None:
        """Hover, circle or orbit at the commanded position; PX4 loiters after its takeoff."""
        north, east, altitude_m = self._hold_at
        self._become_plane(self.motion.altitude_m > altitude_m - HIGH_ENOUGH_M)
        if self.mode == "orbit":
            self.orbit((north, east), altitude_m, self.radius_m, self.orbit_m_s)
        else:
            self.loiter((north, east), altitude_m, self.radius_m)
        up = self.mode == "takeoff" and self.motion.altitude_m > altitude_m - 2.0
        if up and not self.stack.item_0_is_home:
            self.mode = "hold"

    def _land_at_position(self, now_s: float) -> None:
        """Descend vertically; a plane circles while it descends."""
        north, east, _ = self._hold_at
        if self.stack.vehicle == "copter":
            if self.airborne:
                self._down((north, east), now_s)
            return
        self.loiter((north, east), self.ground_amsl_m, self.radius_m)
        if self.airborne and self.motion.altitude_m <= self.ground_amsl_m + 0.5:
            self.touch(self.ground_amsl_m)
            self._disarm_later(now_s)

    def _land(self, target: Target, place: Place, now_s: float) -> bool:
        """Land at an item's position; without terrain data a plane lands at the item's altitude."""
        if self.stack.vehicle == "copter":
            return self._down(place, now_s)
        if self.stack.vtol:
            return self._land_vertically(target, place, now_s)
        ground_m = self._altitude(target.item) if self.terrain is None else self.ground_amsl_m
        if not self.glide(target.leg_start, place, ground_m):
            return False
        self._disarm_later(now_s)
        return self.stack.name == "px4"  # ArduPlane does not report its landing as reached

    def _land_vertically(self, target: Target, place: Place, now_s: float) -> bool:
        """Land a VTOL, or climb after a go-around; return whether the next item is due."""
        if self._climbs_to_m is not None:
            if not self.climb((self.motion.north_m, self.motion.east_m), self._climbs_to_m):
                return False
            self._climbs_to_m = None
            return True
        if not self.hovers:
            self._descended_from_m = self.motion.altitude_m
        if not self.land_vertically(target.leg_start, place):
            return False
        self._disarm_later(now_s)
        return self.stack.name == "px4"

    def _down(self, place: Place, now_s: float) -> bool:
        down = self.descend(place)
        if down:
            self._disarm_later(now_s)
        return down

    def _disarm_later(self, now_s: float) -> None:
        self._disarm_at_s = now_s + DISARM_AFTER_S.get((self.stack.name, self.stack.vehicle), 2.0)

    def _return_altitude_amsl_m(self) -> float:
        if (self.stack.name, self.stack.vehicle) == ("ardupilot", "plane"):
            height_m = self.returns.height_m
            return self._hold_at[2] if height_m is None else self.frame.altitude_m + height_m
        return max(self.motion.altitude_m, self.frame.altitude_m + (self.returns.height_m or 0.0))

    def _begin_return(self) -> None:
        """Set the return speed from the parameters, and the point where a multirotor will stop.

        Planes keep the calibrated airspeed; the limits contain the true airspeed.
        """
        motion, speed_m_s = self.motion, self.returns.speed_m_s or self._cruise_m_s
        self._in_return_climb = (self.stack.name, self.stack.vehicle) == ("px4", "plane")
        if self.stack.vehicle == "plane":
            speed_m_s *= true_airspeed_factor(motion.altitude_m)
        else:
            ahead_m = motion.speed_m_s**2 / (2.0 * self.limits.acceleration_m_s2)
            north_m = motion.north_m + ahead_m * math.cos(motion.course_rad)
            east_m = motion.east_m + ahead_m * math.sin(motion.course_rad)
            self._hold_at, self._stops = (north_m, east_m, motion.altitude_m), True
            self._flies_home_at_s = math.inf
        self.limits = replace(self.limits, airspeed_m_s=speed_m_s)

    def _return(self, now_s: float) -> bool:
        """Fly home; a plane circles there, a copter lands. Return True when it has landed.

        Copters stop first. Copters, and planes with PX4, climb to their return height before they
        fly home (ArduCopter 4.6, PX4 1.17).
        """
        if self.stack.vehicle == "plane" and not self.hovers:
            place = self._hold_at[:2] if self._climbs_to_return() else (0.0, 0.0)
            self.loiter(place, self._return_amsl_m, DEFAULT_RADIUS_M)
            return False
        low = self.motion.altitude_m < self._return_amsl_m - HIGH_ENOUGH_M
        if not self.airborne:
            return True
        if self._stops:
            if self.motion.speed_m_s <= 0.5 and math.isinf(self._flies_home_at_s):
                self._flies_home_at_s = now_s + MULTIROTOR_BEGIN_S[self.stack.name]
            self._stops = now_s < self._flies_home_at_s
            self.loiter(self._hold_at[:2], self._hold_at[2], 0.0)
            return False
        if self.distance((0.0, 0.0)) < 1.0:
            return self._down((0.0, 0.0), now_s)
        place = (self.motion.north_m, self.motion.east_m) if low else (0.0, 0.0)
        self.loiter(place, self._return_amsl_m, 0.0)
        return False

    def _climbs_to_return(self) -> bool:
        """Return whether a PX4 plane still climbs in a circle; at its end, keep the altitude."""
        if not self._in_return_climb:
            return False
        near = self.distance(self._hold_at[:2]) <= PX4_CLIMB_WITHIN_M
        if self.motion.altitude_m >= self._return_amsl_m - PX4_CLIMB_ENDS_BELOW_M and near:
            self._in_return_climb = False
            self._return_amsl_m = self.motion.altitude_m
        return self._in_return_climb

    def _return_item(self, now_s: float) -> bool:
        """Execute NAV_RETURN_TO_LAUNCH: a leg on ArduCopter, a mode change on other vehicles."""
        if self.stack.name == "ardupilot" and self.stack.vehicle == "copter":
            return self._return(now_s)
        self.set_mode("rtl", now_s)
        return False

    # Failures ---------------------------------------------------------------------------------

    def _out_of_power(self, now_s: float) -> bool:
        """Drain the battery; if it is low, fly home; if it is empty, fall and return True."""
        ardupilot = self.stack.name == "ardupilot"
        if self.battery.drain():
            self.texts.append(self.battery.low_text(ardupilot))
            self.failsafe_to("rtl", now_s)
        if self.battery.emergency() and not ardupilot:
            self.texts.append((0, "Emergency battery level\t"))
        if not self.battery.empty:
            return False
        self.fall()
        self._detect_crash()
        return True

    def failsafe_to(self, mode: Mode, now_s: float) -> None:
        """Execute a failsafe: return, hold or land."""
        self.failsafe = True
        if self.mode != mode:
            self.set_mode(mode, now_s)
            if self.stack.name == "px4":
                self.texts.append((2, "Failsafe activated\t"))

    def react(self, reaction: FailsafeReaction, now_s: float) -> None:
        """Execute the reaction to the loss of the ground station."""
        self.texts.append(reaction.text)
        ardupilot = self.stack.name == "ardupilot"
        self.failsafe = reaction.active or (ardupilot and (self.battery.acted or self.blind))
        if reaction.mode == "disarm":
            self.armed = False
        elif reaction.mode is not None and reaction.mode != self.mode:
            self.set_mode(reaction.mode, now_s)
        self.falls |= self.airborne and reaction.mode in ("disarm", "glide", "termination")

    def breach(self, breached: bool, now_s: float) -> None:
        """Set whether the fence is breached.

        After a breach, PX4 holds and ArduPilot returns by default. ArduPlane's heartbeat does not
        report a breach as a failsafe (source: 4.6.2 ``any_failsafe_triggered``).
        """
        self.fence = breached
        if not breached or not self.armed:
            return
        if self.stack.name == "px4":
            self.texts.append((2, "Geofence: approaching or outside geofence"))
            self.failsafe_to("hold", now_s)
        else:
            self.texts.append((5, "Polygon fence breached"))
            if self.mode != "rtl":
                self.set_mode("rtl", now_s)

    def _land_blind(self, now_s: float) -> None:
        """Land at the current position after a long loss of satellites."""
        if self.gps or not self.airborne:
            self._fix_s, self.blind = now_s, False
        after_s = BLIND_AFTER_S.get((self.stack.name, self.stack.vehicle), math.inf)
        if self.blind or now_s - self._fix_s < after_s:
            return
        self.blind = True
        ardupilot = self.stack.name == "ardupilot"
        if ardupilot:
            self.texts.append((2, "EKF Failsafe: changed to LAND Mode"))
        self.failsafe_to("land", now_s)

    def _detect_crash(self) -> None:
        """Detect a crash into the ground; a crashed vehicle remains on the ground."""
        ground_m = self.ground_amsl_m
        if self.motion.altitude_m > ground_m - 0.5:
            return
        hit = math.hypot(self.motion.climb_m_s, self.motion.speed_m_s)
        self.texts.append((6, f"SIM Hit ground at {hit:.1f} m/s"))
        self.texts.append((0, "Crash: Disarming"))
        self.touch(ground_m)
        self.target = None
        self.crashed, self.armed = True, False
