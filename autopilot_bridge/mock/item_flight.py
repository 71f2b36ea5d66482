"""Moves the mock along the leg to a loiter or a waypoint of its mission."""

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.mock.body import Body, Place, wider_m
from autopilot_bridge.mock.kinematics import wrap
from autopilot_bridge.mock.mission_sequencer import DEFAULT_RADIUS_M, acceptance_m, loiter_radius_m
from autopilot_bridge.stacks.item_treatment import TERRAIN_FRAMES

NEAR_M = 5.0  # acceptance radius of a copter that does not stop
EXIT_RAD = math.radians(8.0)  # a plane leaves a loiter within this angle of its next leg
AHEAD_M = 10_000.0
STOP_WITHIN_M = 2.0  # acceptance radius of a copter that stops


@dataclass(slots=True)
class Target:
    """The current item, and the leg that leads to it."""

    item: MissionItem
    leg_start: Place
    begun_amsl_m: float
    begun_at_s: float
    arrived_at_s: float | None = None
    turned_rad: float = 0.0
    last_bearing: float | None = None
    leg_course_rad: float | None = None  # course of a leg without an end


def loitered(
    body: Body,
    target: Target,
    centre: Place,
    altitude_m: float,
    now_s: float,
    following: Place | None = None,
) -> bool:
    """Fly one step of a loiter; return True at its end. Time and turns count from the arrival.

    A plane leaves a loiter to an altitude when it heads for the next item, at ``following``.
    """
    item = target.item
    radius_m = loiter_radius_m(item, body.stack)
    turns = item.command == mavlink.MAV_CMD_NAV_LOITER_TURNS
    if turns and body.stack.vehicle == "copter":
        body.circle(centre, altitude_m, radius_m)
    else:
        body.loiter(centre, altitude_m, radius_m)
    if item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
        return False
    if target.arrived_at_s is None:
        on_circle = turns or body.stack.vehicle == "plane"
        circle_m = abs(radius_m) * 1.1 + wider_m(body.stack) if on_circle else 0.0
        if body.distance(centre) > circle_m + NEAR_M:
            return False
        target.arrived_at_s = now_s
    if item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT:
        return abs(body.motion.altitude_m - altitude_m) < 2.0 and _heads_for(body, following)
    if not turns:
        return now_s - target.arrived_at_s >= item.param1
    bearing = math.atan2(body.motion.east_m - centre[1], body.motion.north_m - centre[0])
    if target.last_bearing is not None:
        change = (bearing - target.last_bearing + math.pi) % math.tau - math.pi
        target.turned_rad += abs(change)
    target.last_bearing = bearing
    return target.turned_rad >= item.param1 * math.tau


def _heads_for(body: Body, following: Place | None) -> bool:
    """Return whether a plane heads for a position, within the turn of one time step."""
    if following is None or body.stack.vehicle == "copter":
        return True
    motion = body.motion
    course = math.atan2(following[1] - motion.east_m, following[0] - motion.north_m)
    return abs(wrap(course - motion.course_rad)) < EXIT_RAD


def climbed_ahead(body: Body, target: Target, altitude_m: float) -> bool:
    """Fly one step of CONTINUE_AND_CHANGE_ALT: straight ahead, until the altitude is reached."""
    motion = body.motion
    if target.leg_course_rad is None:
        target.leg_course_rad = motion.course_rad
    north, east = math.cos(target.leg_course_rad), math.sin(target.leg_course_rad)
    ahead = (target.leg_start[0] + AHEAD_M * north, target.leg_start[1] + AHEAD_M * east)
    body.follow(target.leg_start, ahead, altitude_m)
    return abs(motion.altitude_m - altitude_m) < 2.0


def passed(body: Body, target: Target, place: Place, altitude_m: float, now_s: float) -> bool:
    """Fly one step towards a waypoint; return True when it is reached and the hold is over."""
    item = target.item
    # ArduPlane does not store the holding time.
    hold_s = 0.0 if math.isnan(item.param1) else item.param1
    if target.arrived_at_s is not None:
        body.loiter(place, altitude_m, DEFAULT_RADIUS_M)
        return now_s - target.arrived_at_s >= hold_s
    if body.stack.vehicle == "copter" or body.hovers:
        stop = hold_s > 0.0
        near_m = acceptance_m(item, body.stack, STOP_WITHIN_M if stop else NEAR_M)
        rise_m = altitude_m - target.begun_amsl_m
        rise_m = 0.0 if item.frame in TERRAIN_FRAMES else rise_m
        arrived = body.straight(target.leg_start, place, altitude_m, rise_m, stop, near_m)
    else:
        body.follow(target.leg_start, place, altitude_m)
        arrived = _is_past(body, target, place)
    if arrived and hold_s > 0.0:
        target.arrived_at_s = now_s
        return False
    return arrived


def _is_past(body: Body, target: Target, place: Place) -> bool:
    """Return whether the vehicle is inside the acceptance radius or past the end of the leg."""
    turn_radius_m = body.limits.airspeed_m_s / body.limits.turn_rate_rad_s
    if body.distance(place) <= acceptance_m(target.item, body.stack, 0.7 * turn_radius_m):
        return True
    leg = (place[0] - target.leg_start[0], place[1] - target.leg_start[1])
    beyond = (body.motion.north_m - place[0]) * leg[0] + (body.motion.east_m - place[1]) * leg[1]
    return beyond > 0.0 and body.distance(place) < 3.0 * turn_radius_m
