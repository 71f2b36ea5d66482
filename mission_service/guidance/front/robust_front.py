"""The shape to report of a front that is not sure: the one whose largest error is the least.

Where a front leaps outwards from one bearing to the next, the leap is as long an error as it is
high if it is one bearing off; half-way up it is half of that. Where it is hollow, fire beside the
hollow runs into it sooner or later, all at once as seen from the centre: part of the hollow is
filled, more of a deep one. On a front without leaps and hollows nothing changes.
"""

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.front.front_shape import hull_of

Floats = NDArray[np.float64]

# Shares of a hollow that are filled, up to and beyond a depth in cells. Found on fires of chance
# (benchmarks.random_fires): 0 and 0.5 throughout are both worse.
SHALLOW, DEEP, DEEP_FROM_CELLS = 0.25, 0.5, 10.0


def robust_front(front: Floats) -> Floats:
    """A front (cells on 360 bearings) with leaps and hollows as above."""
    before, after = np.roll(front, 1), np.roll(front, -1)
    highest = np.maximum(np.maximum(before, after), front)
    lowest = np.minimum(np.minimum(before, after), front)
    shape = np.where(front >= highest, front, (highest + lowest) / 2.0)  # a tip stays
    depth = hull_of(shape) - shape
    filled: Floats = (
        shape + SHALLOW * depth + (DEEP - SHALLOW) * np.maximum(depth - DEEP_FROM_CELLS, 0.0)
    )
    return filled
