"""The space that a vehicle occupies while executing a command, for checks against volumes.

A leg occupies all altitudes between its ends, because autopilots differ as to where on a leg they
climb. A loiter occupies its whole disc.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from shapely.geometry.base import BaseGeometry

from autopilot_bridge.items import RELATIVE_FRAMES, MissionItem, has_position
from firemodel.landscape.landscape import Landscape

Point = tuple[float, float]  # x, y in metres
Position = tuple[float, float, float]  # x, y, altitude above mean sea level, in metres

LOITER_RADIUS_FACTOR = 1.3  # multiple of the radius, because loiters are flown wider
BEHIND_RAD = math.radians(120.0)  # beyond this angle, the turn to a target may go to either side
TURN_STEP_RAD = math.radians(15.0)
RETURN_ABOVE_M = 150.0  # returns are checked up to this height above home, or a higher known one


@dataclass(frozen=True, slots=True)
class Part:
    """A part of the occupied space: a horizontal shape (x, y in metres) and its altitudes.

    The altitude limit above ground does not apply to a part ``beside`` the expected path.
    """

    shape: BaseGeometry
    lowest_m: float
    highest_m: float
    beside: bool = False


class MissionPlace(NamedTuple):
    """A position in a mission, the radius of the loiter there (0: none) and the item's index."""

    position: Position
    radius_m: float
    seq: int


def disc(x_m: float, y_m: float, radius_m: float, lowest_m: float, highest_m: float) -> Part:
    """Return the space of a loiter."""
    return Part(shapely.Point(x_m, y_m).buffer(radius_m), lowest_m, highest_m)


def turns_towards(
    start_m: Point, velocity_m_s: Point, target_m: Point, radius_m: float
) -> list[list[Point]]:
    """Return the points (x, y) of the turns from the current course towards a target.

    There are two turns, one to either side, if the target is behind; otherwise there is one. A turn
    consists only of its start if the vehicle is slower than 1 m/s or already flies towards the
    target. A target inside the turning circle is not reached; the turn then ends after a full
    circle.

    Args:
        start_m: Position (x, y) in metres.
        velocity_m_s: Ground velocity (east, north).
        target_m: Position (x, y) in metres.
        radius_m: Radius of the turn.
    """
    if math.hypot(*velocity_m_s) < 1.0 or radius_m <= 0.0:
        return [[start_m]]
    course_rad = math.atan2(*velocity_m_s)  # clockwise from north
    bearing_rad = math.atan2(target_m[0] - start_m[0], target_m[1] - start_m[1])
    turn_rad = _wrapped_rad(bearing_rad - course_rad)
    sides = (1.0, -1.0) if abs(turn_rad) > BEHIND_RAD else (math.copysign(1.0, turn_rad),)
    return [_turn(start_m, course_rad, target_m, radius_m, side) for side in sides]


def held_turn(
    start_m: Point, velocity_m_s: Point, radius_m: float, for_s: float
) -> tuple[list[Point], Point]:
    """Return the points (x, y) of a turn to the right, as in a hold, and the velocity at its end.

    Args:
        start_m: Position (x, y) in metres.
        velocity_m_s: Ground velocity (east, north).
        radius_m: Radius of the turn.
        for_s: Duration of the turn in seconds.
    """
    speed_m_s = math.hypot(*velocity_m_s)
    if speed_m_s < 1.0 or radius_m <= 0.0:
        return [start_m], velocity_m_s
    course_rad = math.atan2(*velocity_m_s)
    turn_rad = min(speed_m_s * for_s / radius_m, math.pi)
    count = math.ceil(turn_rad / TURN_STEP_RAD)
    courses_rad = [course_rad + turn_rad * step / count for step in range(count + 1)]
    points = [
        (
            start_m[0] + radius_m * (math.cos(course_rad) - math.cos(ahead_rad)),
            start_m[1] - radius_m * (math.sin(course_rad) - math.sin(ahead_rad)),
        )
        for ahead_rad in courses_rad
    ]
    ahead = (math.sin(courses_rad[-1]), math.cos(courses_rad[-1]))
    return points, (speed_m_s * ahead[0], speed_m_s * ahead[1])


def _turn(
    start_m: Point, course_rad: float, target_m: Point, radius_m: float, side: float
) -> list[Point]:
    """Return the points of a turn to the right (``side`` = 1) or left (-1)."""
    points = [start_m]
    centre_m = (
        start_m[0] + side * radius_m * math.cos(course_rad),
        start_m[1] - side * radius_m * math.sin(course_rad),
    )
    for step in range(round(math.tau / TURN_STEP_RAD)):
        ahead_rad = course_rad + side * step * TURN_STEP_RAD
        point_m = (
            centre_m[0] - side * radius_m * math.cos(ahead_rad),
            centre_m[1] + side * radius_m * math.sin(ahead_rad),
        )
        if step > 0:
            points.append(point_m)
        bearing_rad = math.atan2(target_m[0] - point_m[0], target_m[1] - point_m[1])
        if abs(_wrapped_rad(bearing_rad - ahead_rad)) <= TURN_STEP_RAD:
            break
    return points


def _wrapped_rad(angle_rad: float) -> float:
    return (angle_rad + math.pi) % math.tau - math.pi


def path_parts(points: Sequence[Position]) -> list[Part]:
    """Return the space of a path through positions."""
    if len(points) < 2:
        return []
    places = np.array([point[:2] for point in points])
    lines = np.array(shapely.linestrings(np.stack([places[:-1], places[1:]], axis=1)))
    parts: list[Part] = []
    for line, start, end in zip(lines, points[:-1], points[1:], strict=True):
        low_m, high_m = sorted((start[2], end[2]))
        shape = line if start[:2] != end[:2] else shapely.Point(start[:2])
        parts.append(Part(shape, low_m, high_m))
    return parts


def turn_area(points: Sequence[Position]) -> Part:
    """Return the convex hull of a turn and the straight flight after it.

    The turn may begin earlier, or be tighter, than along the points.
    """
    altitudes_m = [point[2] for point in points]
    shape = shapely.LineString([point[:2] for point in points]).convex_hull
    return Part(shape, min(altitudes_m), max(altitudes_m), beside=True)


def mission_places(
    items: Sequence[MissionItem], landscape: Landscape, home_altitude_m: float
) -> tuple[MissionPlace, ...]:
    """Return the positions of a mission in the order flown.

    The last one is the first unlimited loiter, because no item after it is flown without a command.
    """
    found: list[MissionPlace] = []
    for seq, item in enumerate(items):
        if not has_position(item.command) or item.command == mavlink.MAV_CMD_DO_LAND_START:
            continue
        x_m, y_m = landscape.xy_of_lat_lon(item.x / 1e7, item.y / 1e7)
        altitude_m = item.z + (home_altitude_m if item.frame in RELATIVE_FRAMES else 0.0)
        position = (float(x_m), float(y_m), altitude_m)
        found.append(MissionPlace(position, _radius_m(item), seq))
        if item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            break
    return tuple(found)


def landing_places(
    items: Sequence[MissionItem], landscape: Landscape, home_altitude_m: float
) -> tuple[MissionPlace, ...]:
    """Return the positions after DO_LAND_START, to which PX4's return leads; () without it."""
    starts = (n for n, item in enumerate(items, 1) if item.command == mavlink.MAV_CMD_DO_LAND_START)
    first = next(starts, len(items))
    return mission_places(items[first:], landscape, home_altitude_m)


def _radius_m(item: MissionItem) -> float:
    if item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
        return abs(item.param3)
    return abs(item.param2) if item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT else 0.0


def corner_parts(points: Sequence[Position], turn_radius_m: float) -> list[Part]:
    """Return the space beside the legs of a path in which a plane turns after each corner.

    The plane flies over the corner, turns with ``turn_radius_m``, and flies straight to the next
    point; in the turn it may be at any altitude between those of the corner and the next point. A
    vehicle with a radius of 0 turns on the spot.
    """
    if turn_radius_m <= 0.0:
        return []
    parts = []
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        leg = (corner[0] - before[0], corner[1] - before[1])
        low_m, high_m = sorted((corner[2], after[2]))
        for turn in turns_towards(corner[:2], leg, after[:2], turn_radius_m):
            if len(turn) > 1:
                parts.append(Part(shapely.LineString([*turn, after[:2]]), low_m, high_m))
    return parts


def mission_parts(places: Sequence[MissionPlace], start: Sequence[Position] = ()) -> list[Part]:
    """Return the space of a mission that is joined along the positions ``start``.

    The parts cover the straight legs and the loiters. ``turning_parts`` covers the space beside
    them.
    """
    positions = [*start, *(place.position for place in places)]
    loiters = [
        _loiter(place, positions[max(number - 1, 0)])
        for number, place in enumerate(places, start=len(start))
        if place.radius_m > 0.0
    ]
    return path_parts(positions) + loiters


def late_places(
    places: Sequence[MissionPlace], start: Position, climb: float, sink: float
) -> tuple[MissionPlace, ...]:
    """Return the places of a mission with the altitudes that a plane has reached there by then.

    At a loiter, the plane circles until it has reached the altitude.

    Args:
        places: The positions of the mission.
        start: Position of the plane.
        climb: Gradient of climbs: altitude per distance over the ground.
        sink: Gradient of descents.
    """
    found: list[MissionPlace] = []
    for place in places:
        x_m, y_m, altitude_m = place.position
        if place.radius_m == 0.0:
            flown_m = math.dist(start[:2], (x_m, y_m))
            altitude_m = max(altitude_m, start[2] - sink * flown_m)
            altitude_m = min(altitude_m, start[2] + climb * flown_m)
        start = (x_m, y_m, altitude_m)
        found.append(place._replace(position=start))
    return tuple(found)


def between_altitudes(parts: Sequence[Part], late: Sequence[Part]) -> list[Part]:
    """Return the space between the parts of a mission and the same parts reached late."""
    return [
        Part(
            part.shape,
            min(part.lowest_m, other.lowest_m),
            max(part.highest_m, other.highest_m),
            beside=True,
        )
        for part, other in zip(parts, late, strict=True)
        if (part.lowest_m, part.highest_m) != (other.lowest_m, other.highest_m)
    ]


def turning_parts(
    places: Sequence[MissionPlace], turn_radius_m: float, from_seq: int = 0
) -> list[Part]:
    """Return the space beside the legs of a plane's mission: at corners, and on the way to loiters.

    Args:
        places: The positions of the mission.
        turn_radius_m: Radius of the turns; 0 for a vehicle that turns on the spot.
        from_seq: Index of the current item; corners and loiters of earlier items are omitted.
    """
    if turn_radius_m <= 0.0:
        return []
    parts = []
    for number, place in enumerate(places):
        if number == 0 or place.seq < from_seq:
            continue
        before = places[number - 1].position
        if place.radius_m > 0.0:
            parts.append(approach_part(before, _loiter(place, before)))
        after = [each.position for each in places[number + 1 : number + 2]]
        parts += corner_parts([before, place.position, *after], turn_radius_m)
    return parts


def _loiter(place: MissionPlace, before: Position) -> Part:
    """Return the space of a loiter, from the altitude at ``before`` to that of the loiter."""
    x_m, y_m, altitude_m = place.position
    low_m, high_m = sorted((before[2], altitude_m))
    return disc(x_m, y_m, LOITER_RADIUS_FACTOR * place.radius_m, low_m, high_m)


def approach_part(start: Position, loiter: Part) -> Part:
    """Return the space in which a plane flies from a position to either side of a circle."""
    hull = shapely.union(shapely.Point(start[:2]), loiter.shape).convex_hull
    return Part(hull, min(start[2], loiter.lowest_m), max(start[2], loiter.highest_m))
