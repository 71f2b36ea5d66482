"""Finds legs from one place to another that lead round burned ground if the detour is short.

Positions are rows and columns of the landscape's grid, as floats; lengths are in cells.
"""

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from mission_service.guidance.visibility_graph import Vertex, VisibilityGraph

Floats = NDArray[np.float64]

# Ground so near to unburned ground does not count as burned: paths along a front touch it.
EDGE_CELLS = 0.25
CLEAR_CELLS = 1.0  # distance between legs and the burned ground without its edge, at corners
BEYOND_CELLS = 1e-3  # distance from the edge, where rounding cannot lead back over burned ground
AROUND_CELLS = 10_000.0  # width of the unburned ground around all fires


def unburned_ground(loops: Sequence[Floats]) -> VisibilityGraph:
    """Return the unburned ground for ``leg``; x is the column and y the row.

    Args:
        loops: All fronts, outer and inner ones in any order and direction. Each is an array (n, 2)
            of rows and columns without repeated end point. Ground is burned if it is inside an odd
            number of loops.
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
    """Return the points (n, 2) of the leg from one place to another, rows and columns.

    The leg is straight, unless it then crosses burned ground and the shortest way round is at most
    ``max_detour`` longer. A leg that begins or ends over burned ground enters or leaves this ground
    by the shortest way, if the leg is then within the same limit. Legs bend at corners; turns are
    not taken into account.
    """
    straight = np.array([start, goal], dtype=np.float64)
    begin, end = (_vertex(place) for place in straight)
    if unburned.is_straight_clear(begin, end):
        return straight
    leave, enter = _nearest_unburned(begin, unburned), _nearest_unburned(end, unburned)
    allowed = (1.0 + max_detour) * math.dist(begin, end)
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
    """Return the place itself over unburned ground, or a place just outside the burned ground."""
    point = shapely.Point(place)
    if unburned.area.covers(point):
        return place
    _, edge = shapely.get_coordinates(shapely.shortest_line(point, unburned.area))
    beyond = 1.0 + BEYOND_CELLS / max(math.dist(place, edge), BEYOND_CELLS)
    return _vertex((place + (edge - place) * beyond)[::-1])
