"""Compiled inner loops of ``loop_path``: they widen the tips of a closed curve to a given radius.

The curve is an array (n, 2) of columns and rows. Burned ground is at the right of the direction of
travel, as seen on a map whose rows grow southwards, so a tip of the burned ground is a right turn.

The excess of a place is the angle by which the curve turns right there, less the angle by which a
circle of the given radius turns on the same length. A section is flyable if no part of it has a
positive sum of the excess.
"""

import math

import numpy as np

from firemodel.compiled import compiled

MAX_ROUNDS = 50  # each round leaves fewer tips; three are usual


@compiled
def widen_tips(curve, radius, tolerance_rad):  # type: ignore[no-untyped-def]
    """Return the curve (n, 2) with each tip replaced by an arc of a circle that contains the tip.

    The circles have the given radius. Sections with an excess up to the tolerance are not changed.
    """
    curve = curve.copy()
    size = len(curve)
    excess = np.empty(size)
    for place in range(size):
        excess[place] = _excess(curve, place, radius)
    for _ in range(MAX_ROUNDS):
        if _widen_once(curve, excess, radius, tolerance_rad) == 0:
            break
    return curve


@compiled
def _widen_once(curve, excess, radius, tolerance_rad):  # type: ignore[no-untyped-def]
    """Widen the sharpest part of each section between flat ones; return the number of circles."""
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


@compiled
def _widen(curve, excess, first, count, radius):  # type: ignore[no-untyped-def]
    """Replace a section, or its sharpest part that a circle can contain, by an arc."""
    found, x, y = _circle_around(curve, first, count, radius)
    while not found:  # the section turns too far for one circle
        half = (count + 1) // 2
        one, one_count, one_most = _sharpest(excess, first, half)
        other, other_count, other_most = _sharpest(excess, first + half, count - half)
        first, count = (one, one_count) if one_most >= other_most else (other, other_count)
        found, x, y = _circle_around(curve, first, count, radius)
    _follow_circle(curve, excess, first, count, x, y, radius)


@compiled
def _excess(curve, place, radius):  # type: ignore[no-untyped-def]
    size = len(curve)
    before, after = curve[(place - 1) % size], curve[(place + 1) % size]
    x, y = curve[place % size]
    in_x, in_y = x - before[0], y - before[1]
    out_x, out_y = after[0] - x, after[1] - y
    turn = math.atan2(in_x * out_y - in_y * out_x, in_x * out_x + in_y * out_y)
    return turn - (math.hypot(in_x, in_y) + math.hypot(out_x, out_y)) / (2.0 * radius)


@compiled
def _calmest(excess):  # type: ignore[no-untyped-def]
    """Return the place at which no sharp section of the closed curve is cut in two."""
    total, most, calmest = 0.0, -np.inf, 0
    for place in range(len(excess)):
        total += excess[place]
        if total > most:
            most, calmest = total, place + 1
    return calmest


@compiled
def _sharpest(excess, start, count):  # type: ignore[no-untyped-def]
    """Return the first place, the number of places and the excess of the sharpest section.

    The section is the one with the largest sum (Kadane) among ``count`` places from ``start``.
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


@compiled
def _circle_around(curve, first, count, radius):  # type: ignore[no-untyped-def]
    """Return whether a circle contains a section, and the centre that is farthest behind it.

    The centre is on the section's axis, which points outwards from the middle of its chord.
    """
    size = len(curve)
    axis_x, axis_y = 0.0, 0.0
    for place in range(first, first + count):
        before, after = curve[(place - 1) % size], curve[(place + 1) % size]
        x, y = curve[place % size]
        in_x, in_y, out_x, out_y = x - before[0], y - before[1], after[0] - x, after[1] - y
        in_m, out_m = math.hypot(in_x, in_y), math.hypot(out_x, out_y)
        turn = math.atan2(in_x * out_y - in_y * out_x, in_x * out_x + in_y * out_y)
        weight = max(turn, 0.0)
        # The left normal of the direction (x, y) is (y, -x), because y grows southwards.
        axis_x += weight * (in_y / in_m + out_y / out_m)
        axis_y -= weight * (in_x / in_m + out_x / out_m)
    norm = math.hypot(axis_x, axis_y)
    start, end = curve[first % size], curve[(first + count - 1) % size]
    middle_x, middle_y = (start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0
    if norm == 0.0:
        return False, middle_x, middle_y
    axis_x, axis_y = axis_x / norm, axis_y / norm
    nearest, farthest = -np.inf, np.inf
    for place in range(first, first + count):
        x, y = curve[place % size][0] - middle_x, curve[place % size][1] - middle_y
        along = x * axis_x + y * axis_y
        room = radius * radius - (x * x + y * y - along * along)
        if room < 0.0:
            return False, middle_x, middle_y
        farthest = min(farthest, math.sqrt(room) - along)
        nearest = max(nearest, -math.sqrt(room) - along)
    return farthest >= nearest, middle_x - farthest * axis_x, middle_y - farthest * axis_y


@compiled
def _follow_circle(curve, excess, first, count, x, y, radius):  # type: ignore[no-untyped-def]
    """Move a section to a circle, with the places before and after it inside the circle."""
    size = len(curve)
    last = first + count - 1
    while last - first < size - 1 and _is_inside(curve[(first - 1) % size], x, y, radius):
        first -= 1
    while last - first < size - 1 and _is_inside(curve[(last + 1) % size], x, y, radius):
        last += 1
    angle = math.atan2(curve[(first - 1) % size, 1] - y, curve[(first - 1) % size, 0] - x)
    sweep = 0.0
    for place in range(first, last + 2):
        x0, y0 = curve[(place - 1) % size, 0] - x, curve[(place - 1) % size, 1] - y
        x1, y1 = curve[place % size, 0] - x, curve[place % size, 1] - y
        sweep += math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
    step = sweep / (last - first + 2)
    for place in range(first, last + 1):
        angle += step
        curve[place % size, 0] = x + radius * math.cos(angle)
        curve[place % size, 1] = y + radius * math.sin(angle)
    for place in range(first - 1, last + 2):
        excess[place % size] = _excess(curve, place, radius)


@compiled
def _is_inside(place, x, y, radius):  # type: ignore[no-untyped-def]
    return math.hypot(place[0] - x, place[1] - y) < radius
