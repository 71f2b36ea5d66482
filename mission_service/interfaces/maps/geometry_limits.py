"""Limits the complexity of shapes: GEOS cannot be interrupted, and could compute for hours.

The computing time of GEOS grows with the number of pairs of segments that are near each other. The
validation of a comb-shaped polygon with 50,000 long teeth takes 48 s, and the repair of a scribble
with 300 points takes 3 s.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

MAX_PAIRS = 3_000_000  # pairs in one file; real perimeters have about four per vertex
# Pairs in one invalid shape, and additional pairs for each of its vertices.
MAX_PAIRS_REPAIRED, MORE_A_VERTEX = 5_000, 10
AT_ONCE = 16  # segments per query, to limit the pairs that one query returns


def pairs_near(shapes: Sequence[BaseGeometry], most: int) -> int:
    """Return the number of ordered pairs of segments with intersecting bounding boxes.

    Each segment also forms a pair with itself. Counting stops above ``most``.
    """
    rings = shapely.get_rings(shapely.get_parts(shapely.get_parts(list(shapes))))
    points, of_ring = shapely.get_coordinates(rings, return_index=True)
    same_ring = of_ring[1:] == of_ring[:-1]
    one, other = points[:-1][same_ring], points[1:][same_ring]
    if not np.isfinite(points).all() or not len(one):
        return 0
    boxes = shapely.box(*np.minimum(one, other).T, *np.maximum(one, other).T)
    tree, count = shapely.STRtree(boxes), 0
    for start in range(0, len(boxes), AT_ONCE):
        count += tree.query(boxes[start : start + AT_ONCE]).shape[1]
        if count > most:
            break
    return count


def max_repaired(shape: BaseGeometry) -> int:
    """Return the limit of ``pairs_near`` above which a shape is not repaired."""
    return MAX_PAIRS_REPAIRED + MORE_A_VERTEX * int(shapely.get_num_coordinates(shape))
