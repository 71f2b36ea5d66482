"""A robust shape of an uncertain front: the one with the smallest largest error.

A step of the front from one bearing to the next is an error of its full height if it is one bearing
off; a point half-way up halves that. A hollow is overrun by the fire beside it sooner or later,
at once as seen from the centre: part of a hollow is filled, a larger part of a deep one. A front
without steps and hollows stays as it is.
"""

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.front.front_shape import hull_of

Floats = NDArray[np.float64]

# Shares of a hollow that are filled, up to and beyond a depth in cells, tuned on random fires
# (benchmarks.random_fires): 0 and 0.5 throughout are both worse.
SHALLOW, DEEP, DEEP_FROM_CELLS = 0.25, 0.5, 10.0


def robust_front(front: Floats) -> Floats:
    """Return the robust shape of a front (cells on 360 bearings)."""
    before, after = np.roll(front, 1), np.roll(front, -1)
    highest = np.maximum(np.maximum(before, after), front)
    lowest = np.minimum(np.minimum(before, after), front)
    shape = np.where(front >= highest, front, (highest + lowest) / 2.0)  # a tip stays
    depth = hull_of(shape) - shape
    filled: Floats = (
        shape + SHALLOW * depth + (DEEP - SHALLOW) * np.maximum(depth - DEEP_FROM_CELLS, 0.0)
    )
    return filled
