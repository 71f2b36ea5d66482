"""Computes a robust shape of an uncertain front, which reduces the largest error.

If a step of the front is misplaced by one bearing, the error there is the step's full height; a
point at half the height halves this error. The fire on both sides of a hollow can close the hollow
at once, as seen from the centre. Therefore a part of each hollow is filled, and a larger part if
the hollow is deep. A front without steps and hollows does not change.
"""

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.front.front_shape import hull_of

Floats = NDArray[np.float64]

# Shares of a hollow that are filled up to a depth (in cells) and beyond it. The shares were tuned
# on random fires (benchmarks.random_fires); constant shares of 0 and of 0.5 are both worse.
SHALLOW, DEEP, DEEP_FROM_CELLS = 0.25, 0.5, 10.0


def robust_front(front: Floats) -> Floats:
    """Return the robust shape of a front; shape and front are in cells on 360 bearings."""
    before, after = np.roll(front, 1), np.roll(front, -1)
    highest = np.maximum(np.maximum(before, after), front)
    lowest = np.minimum(np.minimum(before, after), front)
    shape = np.where(front >= highest, front, (highest + lowest) / 2.0)  # a tip does not change
    depth = hull_of(shape) - shape
    filled: Floats = (
        shape + SHALLOW * depth + (DEEP - SHALLOW) * np.maximum(depth - DEEP_FROM_CELLS, 0.0)
    )
    return filled
