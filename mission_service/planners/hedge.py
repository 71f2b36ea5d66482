"""The shape to report of a front that is not sure: the one whose largest error is the least.

Where a front leaps outwards from one bearing to the next, the leap is as long an error as it is
high if it is one bearing off; half-way up it is half of that. Where it is hollow, fire beside the
hollow runs into it sooner or later, all at once as seen from the centre: part of the hollow is
filled, more of a deep one. On a front without leaps and hollows nothing changes.
"""

import math

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import compiled

Floats = NDArray[np.float64]

# Shares of a hollow that are filled, up to and beyond a depth in cells. Found on fires of chance
# (benchmarks.random_fires): 0 and 0.5 throughout are both worse.
SHALLOW, DEEP, DEEP_FROM_CELLS = 0.25, 0.5, 10.0


def hedged(front: Floats) -> Floats:
    """A front (cells on 360 bearings) with leaps and hollows as above."""
    before, after = np.roll(front, 1), np.roll(front, -1)
    highest = np.maximum(np.maximum(before, after), front)
    lowest = np.minimum(np.minimum(before, after), front)
    shape = np.where(front >= highest, front, (highest + lowest) / 2.0)  # a tip stays
    depth = hull(shape) - shape
    filled: Floats = (
        shape + SHALLOW * depth + (DEEP - SHALLOW) * np.maximum(depth - DEEP_FROM_CELLS, 0.0)
    )
    return filled


def hull(shape: Floats) -> Floats:
    """The convex hull of a shape around its centre, as distances on the same bearings."""
    found = np.empty(shape.size)
    _hull(shape, found)
    return found


@compiled
def _hull(shape, found):  # type: ignore[no-untyped-def]
    """Graham's scan, clockwise from the farthest point."""
    n = shape.size
    turn = 2.0 * math.pi / n
    first = np.argmax(shape)
    corners = np.empty(n + 1, np.int64)
    count = 0
    for place in range(first, first + n + 1):
        north, east = (
            shape[place % n] * math.cos(place * turn),
            shape[place % n] * math.sin(place * turn),
        )
        while count >= 2:
            b, a = corners[count - 1], corners[count - 2]
            b_north, b_east = shape[b % n] * math.cos(b * turn), shape[b % n] * math.sin(b * turn)
            a_north, a_east = shape[a % n] * math.cos(a * turn), shape[a % n] * math.sin(a * turn)
            right = (b_north - a_north) * (east - b_east) - (b_east - a_east) * (north - b_north)
            if right > 0.0:
                break
            count -= 1
        corners[count] = place
        count += 1
    for corner in range(count - 1):
        a, b = corners[corner], corners[corner + 1]
        angle = (b - a) * turn
        near, far = shape[a % n], shape[b % n]
        for place in range(a, b):
            along = (place - a) * turn
            across = near * math.sin(along) + far * math.sin(angle - along)
            chord = near * far * math.sin(angle) / across if across > 0.0 else 0.0
            found[place % n] = max(shape[place % n], chord)
