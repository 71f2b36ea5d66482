"""Computes the distance error of a planner's estimated front (Islam & Hu, VI.E).

The estimated and the true front are given by their distances in cells from the ignition on 360
whole-degree bearings.
"""

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import compiled
from mission_service.guidance.fire_map import EAST, NORTH

Floats = NDArray[np.float64]

SAMPLES_PER_CELL = 2


class TrueShape:
    """The distance from the centre to the front on each bearing, from arrival times (y, x) in s."""

    def __init__(self, arrival_s: Floats, centre: tuple[int, int]) -> None:
        reach = int(np.hypot(*arrival_s.shape)) * SAMPLES_PER_CELL
        distance = np.arange(reach) / SAMPLES_PER_CELL
        rows = np.rint(centre[0] - NORTH[:, None] * distance).astype(np.int64)
        cols = np.rint(centre[1] + EAST[:, None] * distance).astype(np.int64)
        inside = (rows >= 0) & (cols >= 0) & (rows < arrival_s.shape[0])
        inside &= cols < arrival_s.shape[1]
        along = np.full(rows.shape, np.inf)
        along[inside] = arrival_s[rows[inside], cols[inside]]
        # Time at which ground at this or a larger distance first burned; increases with distance.
        self._reached_s = np.minimum.accumulate(along[:, ::-1], axis=1)[:, ::-1]

    def distances_at(self, at_s: float) -> Floats:
        """Return the distance to the front on 360 bearings, in cells, accurate to half a cell."""
        reached: NDArray[np.int64] = _reached(self._reached_s, at_s)
        distance: Floats = np.maximum(reached - 1, 0) / SAMPLES_PER_CELL
        return distance


@compiled
def _reached(reached_s, at_s):  # type: ignore[no-untyped-def]
    """Return the number of samples on each bearing that burned by ``at_s``; rows are sorted."""
    found = np.empty(reached_s.shape[0], dtype=np.int64)
    for bearing in range(found.size):
        found[bearing] = np.searchsorted(reached_s[bearing], at_s, side="right")
    return found
