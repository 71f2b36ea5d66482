"""Computes a robust shape of an uncertain front: a shape that reduces the largest error.

A step is a jump of the front's distance from one bearing to the next. If a step is misplaced by one
bearing, the error there is the full height of the step; a point at half the height halves this
error. The fire on both sides of a hollow can close the hollow suddenly. Therefore each hollow is
partly filled; a larger fraction is filled beyond a certain depth. A front without steps or hollows
is unchanged.
"""

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.front.front_shape import hull_of

Floats = NDArray[np.float64]

# Fractions of a hollow's depth that are filled: up to DEEP_FROM_CELLS, and beyond. The fractions
# were tuned on random fires (benchmarks.random_fires); constant fractions of 0 and 0.5 are both
# worse.
SHALLOW, DEEP, DEEP_FROM_CELLS = 0.25, 0.5, 10.0


def robust_front(front: Floats) -> Floats:
    """Return the robust shape of a front; shape and front are in cells on 360 bearings."""
    before, after = np.roll(front, 1), np.roll(front, -1)
    highest = np.maximum(np.maximum(before, after), front)
    lowest = np.minimum(np.minimum(before, after), front)
    shape = np.where(front >= highest, front, (highest + lowest) / 2.0)  # tips are unchanged
    depth = hull_of(shape) - shape
    filled: Floats = (
        shape + SHALLOW * depth + (DEEP - SHALLOW) * np.maximum(depth - DEEP_FROM_CELLS, 0.0)
    )
    return filled
