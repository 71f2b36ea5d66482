"""Finds legs from one position to another, around burned ground if the detour is short.

Positions are rows and columns of the landscape's grid, as floats; lengths are in cells.
"""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from mission_service.visibility_graph import Vertex, VisibilityGraph

Floats = NDArray[np.float64]

# Burned ground this close to unburned ground does not count as burned: paths along a front touch
# such ground.
EDGE_CELLS = 0.25
CLEAR_CELLS = 1.0  # distance of a leg's corners from the ground that counts as burned
# Extra length of a path around a convex fire due to this distance: at most half a circle. The
# detour limit is increased by this length.
HALF_CIRCLE_CELLS = math.pi * CLEAR_CELLS
BEYOND_CELLS = 1e-3  # distance beyond the edge, so that rounding does not undo the crossing
AROUND_CELLS = 10_000.0  # width of the unburned ground around all fires


def unburned_ground(loops: Sequence[Floats]) -> VisibilityGraph:
    """Return the visibility graph of the unburned ground; x is the column and y the row.

    Args:
        loops: All outer and inner fronts, in any order and direction. Each front is an array
            (n, 2) of rows and columns without a repeated end point. Ground inside an odd number of
            loops is burned.
    """
    burned: BaseGeometry = shapely.Polygon()
    for loop in sorted(loops, key=len):
        area = shapely.Polygon(loop[:, ::-1]).simplify(EDGE_CELLS / 2.0)
        burned = burned.symmetric_difference(area if area.is_valid else shapely.make_valid(area))
    burned = burned.buffer(-EDGE_CELLS, quad_segs=2).simplify(EDGE_CELLS / 2.0)
    around = shapely.box(-AROUND_CELLS, -AROUND_CELLS, AROUND_CELLS, AROUND_CELLS)
    if not burned.is_empty:
        around = shapely.box(*burned.bounds).buffer(AROUND_CELLS, join_style="mitre")
    return VisibilityGraph(around.difference(burned), CLEAR_CELLS, only_tangents=True)


def leg(start: Floats, goal: Floats, unburned: VisibilityGraph, max_detour: float = 0.2) -> Floats:
    """Return the points (n, 2) of the leg from one position to another, as rows and columns.

    The leg is straight, unless a straight leg crosses burned ground and the shortest way around is
    at most (1 + ``max_detour``) times as long, plus ``HALF_CIRCLE_CELLS``. A leg that begins or
    ends over burned ground leaves or enters this ground by the shortest way, if the leg then stays
    within the same limit. Legs have sharp corners; the turn radius is not taken into account.
    """
    straight = np.array([start, goal], dtype=np.float64)
    begin, end = (_vertex(place) for place in straight)
    if unburned.is_straight_clear(begin, end):
        return straight
    leave, enter = _nearest_unburned(begin, unburned), _nearest_unburned(end, unburned)
    allowed = (1.0 + max_detour) * math.dist(begin, end) + HALF_CIRCLE_CELLS
    between = unburned.shortest_path(
        leave, enter, allowed - math.dist(begin, leave) - math.dist(enter, end)
    )
    if between is None:
        return straight
    way = [*([begin] if leave != begin else []), *between, *([end] if enter != end else [])]
    return np.array(way)[:, ::-1]


def _vertex(place: Floats) -> Vertex:
    return float(place[1]), float(place[0])


def _nearest_unburned(place: Vertex, unburned: VisibilityGraph) -> Vertex:
    """Return ``place`` if it is over unburned ground, or else the nearest position just outside."""
    point = shapely.Point(place)
    if unburned.area.covers(point):
        return place
    _, edge = shapely.get_coordinates(shapely.shortest_line(point, unburned.area))
    beyond = 1.0 + BEYOND_CELLS / max(math.dist(place, edge), BEYOND_CELLS)
    return _vertex((place + (edge - place) * beyond)[::-1])
