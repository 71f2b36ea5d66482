"""A robust shape of an uncertain front, which minimises the largest error.

A step of the front between two bearings that is misplaced by one bearing is an error of its full
height; a point at half height halves the error. The fire on both sides overruns a hollow at once as
seen from the centre. Therefore a part of each hollow is filled, a larger part of a deep hollow. A
front without steps and hollows does not change.
"""

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.front.front_shape import hull_of

Floats = NDArray[np.float64]

# Filled shares of a hollow up to and beyond a depth in cells, tuned on random fires
# (benchmarks.random_fires); constant shares of 0 and of 0.5 are both worse.
SHALLOW, DEEP, DEEP_FROM_CELLS = 0.25, 0.5, 10.0


def robust_front(front: Floats) -> Floats:
    """Return the robust shape of a front (cells on 360 bearings)."""
    before, after = np.roll(front, 1), np.roll(front, -1)
    highest = np.maximum(np.maximum(before, after), front)
    lowest = np.minimum(np.minimum(before, after), front)
    shape = np.where(front >= highest, front, (highest + lowest) / 2.0)  # a tip does not change
    depth = hull_of(shape) - shape
    filled: Floats = (
        shape + SHALLOW * depth + (DEEP - SHALLOW) * np.maximum(depth - DEEP_FROM_CELLS, 0.0)
    )
    return filled
