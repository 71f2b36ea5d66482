"""Compiled inner loops of ``loop_path``: they widen the tips of a closed curve to a given radius.

The curve is an array (n, 2) of columns and rows. Burned ground is on the right of the direction of
travel, as seen on a map; row numbers increase southwards. At a tip of the burned ground, the curve
turns right.

The excess at a point is the angle through which the curve turns right there, less the angle through
which a circle of the given radius turns over the same length. A vehicle can fly a section if the
excess does not sum to a positive value over any part of it.
"""

import math

import numpy as np

from firemodel.compiled import kernel

MAX_ROUNDS = 50  # each round leaves fewer tips; three rounds usually suffice


@kernel
def widen_tips(curve, excess, radius, tolerance_rad):  # type: ignore[no-untyped-def]
    """Replace each tip of a curve (n, 2), in place, with an arc of a circle that contains the tip.

    The circles have the given radius. Sections with an excess up to the tolerance remain unchanged.
    ``excess`` (n) is a work array.
    """
    for place in range(len(curve)):
        excess[place] = _excess(curve, place, radius)
    for _ in range(MAX_ROUNDS):
        if _widen_once(curve, excess, radius, tolerance_rad) == 0:
            break


@kernel
def _widen_once(curve, excess, radius, tolerance_rad):  # type: ignore[no-untyped-def]
    """Widen the sharpest part of each sharp section; return the number of circles."""
    size, circles = len(curve), 0
    start = _calmest(excess)
    most, best_first, best_count = 0.0, start, 0
    total, first = 0.0, start
    for place in range(start, start + size + 1):
        if total <= 0.0 or place == start + size:
            if most > tolerance_rad:
                _widen(curve, excess, best_first, best_count, radius)
                circles += 1
            most, total, first = 0.0, 0.0, place
        total += excess[place % size]
        if total > most:
            most, best_first, best_count = total, first, place - first + 1
    return circles


@kernel
def _widen(curve, excess, first, count, radius):  # type: ignore[no-untyped-def]
    """Replace a section, or the sharpest part that a circle can contain, with an arc."""
    count = min(count, len(curve) - 1)
    found, x, y = _circle_around(curve, first, count, radius)
    while not found:  # the section turns too far for one circle
        half = (count + 1) // 2
        one, one_count, one_most = _sharpest(excess, first, half)
        other, other_count, other_most = _sharpest(excess, first + half, count - half)
        first, count = (one, one_count) if one_most >= other_most else (other, other_count)
        found, x, y = _circle_around(curve, first, count, radius)
    _follow_circle(curve, excess, first, count, x, y, radius)


@kernel
def _steps_at(curve, place):  # type: ignore[no-untyped-def]
    """Return the steps (x, y, x, y) from the previous point and to the next point."""
    size = len(curve)
    before, here, after = (place - 1) % size, place % size, (place + 1) % size
    x, y = curve[here, 0], curve[here, 1]
    return x - curve[before, 0], y - curve[before, 1], curve[after, 0] - x, curve[after, 1] - y


@kernel
def _angle_between(x0, y0, x1, y1):  # type: ignore[no-untyped-def]
    """Return the angle from one vector to another, positive to the right as seen on the map."""
    return math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)


@kernel
def _excess(curve, place, radius):  # type: ignore[no-untyped-def]
    x0, y0, x1, y1 = _steps_at(curve, place)
    length = (math.hypot(x0, y0) + math.hypot(x1, y1)) / 2.0
    return _angle_between(x0, y0, x1, y1) - length / radius


@kernel
def _calmest(excess):  # type: ignore[no-untyped-def]
    """Return a point where the closed curve can be cut without splitting a sharp section."""
    total, most, calmest = 0.0, -np.inf, 0
    for place in range(len(excess)):
        total += excess[place]
        if total > most:
            most, calmest = total, place + 1
    return calmest


@kernel
def _sharpest(excess, start, count):  # type: ignore[no-untyped-def]
    """Return the first point, the number of points and the excess of the sharpest section.

    This section has the largest sum of the excess (Kadane's algorithm) among ``count`` points from
    ``start``.
    """
    size = len(excess)
    best, best_first, best_count = -np.inf, start, 1
    total, first = 0.0, start
    for place in range(start, start + count):
        if total <= 0.0:
            total, first = 0.0, place
        total += excess[place % size]
        if total > best:
            best, best_first, best_count = total, first, place - first + 1
    return best_first, best_count, best


@kernel
def _circle_around(curve, first, count, radius):  # type: ignore[no-untyped-def]
    """Return whether a circle contains a section, and the centre farthest behind the section.

    The centre is on the section's axis, which points outwards from the chord's midpoint.
    """
    size = len(curve)
    axis_x, axis_y = 0.0, 0.0
    for place in range(first, first + count):
        x0, y0, x1, y1 = _steps_at(curve, place)
        turn = max(_angle_between(x0, y0, x1, y1), 0.0)
        length0, length1 = math.hypot(x0, y0), math.hypot(x1, y1)
        # The left normal of the direction (x, y) is (y, -x), because y increases southwards.
        axis_x += turn * (y0 / length0 + y1 / length1)
        axis_y -= turn * (x0 / length0 + x1 / length1)
    norm = math.hypot(axis_x, axis_y)
    start, end = first % size, (first + count - 1) % size
    middle_x = (curve[start, 0] + curve[end, 0]) / 2.0
    middle_y = (curve[start, 1] + curve[end, 1]) / 2.0
    if norm == 0.0:
        return False, middle_x, middle_y
    axis_x, axis_y = axis_x / norm, axis_y / norm
    nearest, farthest = -np.inf, np.inf
    for place in range(first, first + count):
        x, y = curve[place % size, 0] - middle_x, curve[place % size, 1] - middle_y
        along = x * axis_x + y * axis_y
        room = radius * radius - (x * x + y * y - along * along)
        if room < 0.0:
            return False, middle_x, middle_y
        farthest = min(farthest, math.sqrt(room) - along)
        nearest = max(nearest, -math.sqrt(room) - along)
    return farthest >= nearest, middle_x - farthest * axis_x, middle_y - farthest * axis_y


@kernel
def _follow_circle(curve, excess, first, count, x, y, radius):  # type: ignore[no-untyped-def]
    """Move a section, and adjacent points inside a circle, onto this circle."""
    size = len(curve)
    last, most = first + count - 1, size - 1  # one point stays, so that the curve remains closed
    while last - first + 1 < most and _is_inside(curve, first - 1, x, y, radius):
        first -= 1
    while last - first + 1 < most and _is_inside(curve, last + 1, x, y, radius):
        last += 1
    angle = math.atan2(curve[(first - 1) % size, 1] - y, curve[(first - 1) % size, 0] - x)
    sweep = 0.0
    for place in range(first, last + 2):
        x0, y0 = curve[(place - 1) % size, 0] - x, curve[(place - 1) % size, 1] - y
        x1, y1 = curve[place % size, 0] - x, curve[place % size, 1] - y
        sweep += _angle_between(x0, y0, x1, y1)
    step = sweep / (last - first + 2)
    for place in range(first, last + 1):
        angle += step
        curve[place % size, 0] = x + radius * math.cos(angle)
        curve[place % size, 1] = y + radius * math.sin(angle)
    for place in range(first - 1, last + 2):
        excess[place % size] = _excess(curve, place, radius)


@kernel
def _is_inside(curve, place, x, y, radius):  # type: ignore[no-untyped-def]
    here = place % len(curve)
    return math.hypot(curve[here, 0] - x, curve[here, 1] - y) < radius
