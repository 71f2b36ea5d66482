"""Whether shapes are so tangled that GEOS, which nobody can interrupt, would be at them for hours.

Its time goes with the pairs of segments that are near each other: a comb of 50,000 long teeth takes
48 s to be called valid, a scribble of 300 points 3 s to be repaired.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

MAX_PAIRS = 3_000_000  # of a whole file; perimeters as they are have some four a vertex
MAX_PAIRS_REPAIRED, MORE_A_VERTEX = 5_000, 10  # of one shape that is not valid
AT_ONCE = 16  # segments, so that pairs found together stay few


def pairs_near(shapes: Sequence[BaseGeometry], most: int) -> int:
    """How many pairs of segments of all rings have boxes that meet (each twice, and itself).

    Counted only until there are more than ``most``.
    """
    rings = shapely.get_rings(shapely.get_parts(shapely.get_parts(list(shapes))))
    places, of_ring = shapely.get_coordinates(rings, return_index=True)
    together = of_ring[1:] == of_ring[:-1]
    one, other = places[:-1][together], places[1:][together]
    if not np.isfinite(places).all() or not len(one):
        return 0
    boxes = shapely.box(*np.minimum(one, other).T, *np.maximum(one, other).T)
    tree, count = shapely.STRtree(boxes), 0
    for start in range(0, len(boxes), AT_ONCE):
        count += tree.query(boxes[start : start + AT_ONCE]).shape[1]
        if count > most:
            break
    return count


def max_repaired(shape: BaseGeometry) -> int:
    """How many pairs a shape may have to be repaired."""
    return MAX_PAIRS_REPAIRED + MORE_A_VERTEX * int(shapely.get_num_coordinates(shape))
