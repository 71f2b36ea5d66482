"""Convert ignition lines to point sources of ellipses."""

import math
from itertools import pairwise

import numpy as np

from firemodel.arrays import Floats
from firemodel.errors import FireModelError


def line_sources(points_m: Floats, at_s: float | Floats, spacing_m: float) -> Floats:
    """Convert a line with vertices (n, 2) to sources (k, 3), at most ``spacing_m`` apart.

    A source is x, y, at_s, and each vertex is a source. ``at_s`` is one time for the whole line or,
    for a line lit on foot, one time for each vertex (n,). Let s be the spacing and r the half-width
    of the ellipses (``flank_m_s`` times the time since ignition). The front midway between two
    sources then lags behind that of a continuous line by about s²/(8 r), which is 3 % of r if r is
    twice s. If r is less than s/2, the two ellipses do not touch. Raises FireModelError if there
    are no points or the spacing is not positive.
    """
    points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
    if len(points) == 0 or not spacing_m > 0.0:
        raise FireModelError(
            f"line of {len(points)} points, spacing {spacing_m} m: specify at least one point and "
            "a spacing of more than 0 m"
        )
    times = np.broadcast_to(np.asarray(at_s, dtype=np.float64), len(points))
    corners = np.column_stack([points, times])
    parts = [corners[:1]]
    for one, other in pairwise(corners):
        count = math.ceil(math.hypot(*(other - one)[:2]) / spacing_m - 1e-9)
        parts.append(one + (other - one) * (np.arange(1, count + 1) / max(count, 1))[:, None])
    return np.concatenate(parts)
