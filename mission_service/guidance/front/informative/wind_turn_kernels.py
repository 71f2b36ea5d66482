"""Compiled inner loops of ``wind_turns``: Dubins paths to a goal that moves relative to the air.

Relative to the air, the vehicle flies at constant airspeed, and the goal moves against the wind at
the wind speed. The vehicle meets the goal at the first time t at which the path to the goal's
position at time t is as long as the distance that the vehicle has flown through the air.

Headings are in radians, anticlockwise from x. Each family of paths consists of a left or right
turn, then a straight leg or an opposite turn, then another turn. A family that begins with a right
turn is computed as a mirror image: with y and headings negated, the family begins with a left turn.
``pose`` holds x and y of the goal relative to the start, and the headings at the start and at the
goal. ``air`` holds the airspeed, the turn radius, and x and y of the wind.
"""

import math

import numpy as np

from firemodel.compiled import kernel

FAMILIES = ("LSL", "LSR", "LRL", "LRL", "RSR", "RSL", "RLR", "RLR")
LSL, LSR, LONG, SHORT = range(4)  # long and short middle turn
MIRRORED = 4  # families from this number on begin with a right turn
# Families without a straight leg come last, because most of them soon exceed the best time.
ORDER = (0, 1, 4, 5, 2, 3, 6, 7)
STEPS_PER_RADIUS = 16  # number of smallest search steps per turn radius of relative motion
BISECTIONS = 60
TOLERANCE = 1e-6  # in a path's length, in turn radii
JUMP = 3.0  # in turn radii; a path's length jumps by a full circle, or to infinity


@kernel
def fastest(starts, goals, airspeed, radius, wind, found):  # type: ignore[no-untyped-def]
    """Compute the fastest paths from starts to goals (n, 3): x, y and heading.

    Each row of ``found`` (n, 5) receives the path's time, its family, and the lengths of its three
    parts through the air. ``wind`` (2) is the velocity of the air, slower than the airspeed.
    """
    for pair in range(len(starts)):
        found[pair, 0], found[pair, 1:] = np.inf, 0.0
        x, y = goals[pair, 0] - starts[pair, 0], goals[pair, 1] - starts[pair, 1]
        for family in ORDER:
            mirror = -1.0 if family >= MIRRORED else 1.0
            pose = (x, mirror * y, mirror * starts[pair, 2], mirror * goals[pair, 2])
            air = (airspeed, radius, wind[0], mirror * wind[1])
            kind = family % MIRRORED
            time = _meeting(kind, pose, air, found[pair, 0])
            if time < found[pair, 0]:
                found[pair, 0], found[pair, 1] = time, family
                found[pair, 2], found[pair, 3], found[pair, 4] = _parts(kind, pose, air, time)


@kernel
def _meeting(family, pose, air, latest):  # type: ignore[no-untyped-def]
    """Return the first time at which a path meets the goal; infinite if not before ``latest``."""
    airspeed, radius, wind_x, wind_y = air
    speed = math.hypot(wind_x, wind_y)
    least_step = radius / (STEPS_PER_RADIUS * (airspeed + speed))
    away = math.hypot(pose[0], pose[1])
    straight = family in (LSL, LSR)
    time, end = 0.0, latest
    if straight:
        # The shortest path is longer than the distance to the goal by at most 7 pi turn radii.
        end = min(latest, (away + 7.0 * math.pi * radius) / (airspeed - speed))
    elif away > 6.0 * radius:  # too far for three turns until the goal is nearer
        time = (away - 6.0 * radius) / speed if speed > 0.0 else latest
    spare = _spare(family, pose, air, time)
    while time < end:
        step = least_step
        if straight and 0.0 < spare < np.inf:
            # The length of a path with a straight leg changes no faster than the goal moves, except
            # at jumps. Near the goal, its bearing changes fast, and several jumps may follow in
            # succession. The length of a path of three turns may change faster than the goal moves.
            x, y = pose[0] - wind_x * time, pose[1] - wind_y * time
            far = max(math.hypot(x, y) - 2.0 * radius, 0.0)
            step = max(step, min(spare, far / 8.0) / (airspeed + speed))
        later = _spare(family, pose, air, time + step)
        root = _root_between(family, pose, air, time, spare, time + step, later)
        if root < end:
            return root
        time, spare = time + step, later
    return np.inf


@kernel
def _root_between(family, pose, air, early, spare_early, late, spare_late):  # type: ignore[no-untyped-def]
    """Return the time at which the path is as long as the distance flown; infinite if never.

    ``spare_early`` and ``spare_late`` are the path's length less the distance flown. This
    difference may jump once between ``early`` and ``late``, where a turn becomes a full circle or
    the path ceases to exist.
    """
    if abs(spare_early) <= TOLERANCE * air[1]:
        return early
    if abs(spare_late - spare_early) > JUMP * air[1]:
        before, after = early, late
        spare_before, spare_after = spare_early, spare_late
        for _ in range(BISECTIONS):
            time = (before + after) / 2.0
            spare = _spare(family, pose, air, time)
            if abs(spare - spare_early) > JUMP * air[1]:
                after, spare_after = time, spare
            else:
                before, spare_before = time, spare
        root = _root(family, pose, air, early, spare_early, before, spare_before)
        if root < np.inf:
            return root
        return _root(family, pose, air, after, spare_after, late, spare_late)
    return _root(family, pose, air, early, spare_early, late, spare_late)


@kernel
def _root(family, pose, air, early, spare_early, late, spare_late):  # type: ignore[no-untyped-def]
    """Return the result of ``_root_between`` for a path length without jumps."""
    falls = spare_early > 0.0
    if (spare_late > 0.0) == falls:
        return np.inf
    for _ in range(BISECTIONS):
        time = (early + late) / 2.0
        spare = _spare(family, pose, air, time)
        if abs(spare) <= TOLERANCE * air[1]:
            return time
        if (spare > 0.0) == falls:
            early = time
        else:
            late = time
    return np.inf


@kernel
def _spare(family, pose, air, time):  # type: ignore[no-untyped-def]
    """Return the length of the path to the goal's position at a time, less the distance flown."""
    first, middle, last = _parts(family, pose, air, time)
    return first + middle + last - air[0] * time


@kernel
def _parts(family, pose, air, time):  # type: ignore[no-untyped-def]
    """Return the lengths of the parts of the path to the goal; infinite if there is no path.

    ``family`` is one of the families that begin with a left turn.
    """
    _, radius, wind_x, wind_y = air
    x, y, begin, end = pose
    # The vector from the centre of the first turn circle to the centre of the last turn circle.
    last_side = -1.0 if family == LSR else 1.0
    across_x = x - wind_x * time - last_side * radius * math.sin(end) + radius * math.sin(begin)
    across_y = y - wind_y * time + last_side * radius * math.cos(end) - radius * math.cos(begin)
    distance, bearing = math.hypot(across_x, across_y), math.atan2(across_y, across_x)
    if family == LSL:
        return radius * _turn(begin, bearing), distance, radius * _turn(bearing, end)
    if family == LSR:
        if distance < 2.0 * radius:
            return np.inf, np.inf, np.inf
        straight = math.sqrt(distance * distance - 4.0 * radius * radius)
        heading = bearing + math.atan2(2.0 * radius, straight)
        return radius * _turn(begin, heading), straight, radius * _turn(end, heading)
    if distance > 4.0 * radius:
        return np.inf, np.inf, np.inf
    # The middle circle touches both other circles. If the centre of the middle circle is to the
    # left of the line from the first to the last centre, the middle turn is more than half a
    # circle, otherwise less.
    aside = math.acos(distance / (4.0 * radius))
    aside = aside if family == LONG else -aside
    leave, join = bearing + aside + math.pi / 2.0, bearing - aside - math.pi / 2.0
    return (
        radius * _turn(begin, leave),
        radius * (math.pi + 2.0 * aside),
        radius * _turn(join, end),
    )


@kernel
def _turn(begin, end):  # type: ignore[no-untyped-def]
    """Return the angle (0 to 2 pi) of a left turn from one heading to another."""
    turn = (end - begin) % math.tau
    return 0.0 if turn > math.tau - 1e-9 else turn  # a turn of 0, rounded down
