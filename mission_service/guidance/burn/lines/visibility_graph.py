"""Finds shortest paths inside an area by the visibility graph of its corners."""

import heapq
import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

Floats = NDArray[np.float64]
Vertex = tuple[float, float]

CLEAR_M = 1.0  # distance between paths and corners if the area is wide enough


class VisibilityGraph:
    """The visibility graph of an area's corners, for shortest paths inside the area.

    The graph is built when it is first used.
    """

    def __init__(self, area: BaseGeometry) -> None:
        self.area = area
        shapely.prepare(area)
        self._corners: Floats | None = None
        self._lengths: Floats = np.empty((0, 0))

    def is_straight_clear(self, begin: Vertex, end: Vertex) -> bool:
        """Return whether the straight line between two points is inside the area."""
        if begin == end:
            return bool(self.area.covers(shapely.Point(begin)))
        return bool(self.area.covers(shapely.LineString([begin, end])))

    def shortest_path(self, begin: Vertex, end: Vertex) -> list[Vertex] | None:
        """Return the points of the shortest path from ``begin`` to ``end``, or None."""
        if self.is_straight_clear(begin, end):
            return [begin, end]
        if not self.area.covers(shapely.MultiPoint([begin, end])):
            return None
        corners, lengths = self._graph()
        if not len(corners):
            return None
        from_begin, to_end = self._visible_m(begin, corners), self._visible_m(end, corners)
        # Dijkstra from begin over the corners.
        best = from_begin.copy()
        before = np.full(len(corners), -1)
        queue = [(float(best[n]), n) for n in np.flatnonzero(np.isfinite(best)).tolist()]
        heapq.heapify(queue)
        while queue:
            length, corner = heapq.heappop(queue)
            if length > best[corner]:
                continue
            for other in np.flatnonzero(best > length + lengths[corner]).tolist():
                best[other] = length + lengths[corner, other]
                before[other] = corner
                heapq.heappush(queue, (float(best[other]), other))
        last = int(np.argmin(best + to_end))
        if not math.isfinite(best[last] + to_end[last]):
            return None
        back = [end]
        while last >= 0:
            back.append((float(corners[last, 0]), float(corners[last, 1])))
            last = int(before[last])
        return [*back, begin][::-1]

    def _graph(self) -> tuple[Floats, Floats]:
        if self._corners is None:
            inner: BaseGeometry = self.area.buffer(-CLEAR_M, join_style="mitre")
            # Reduces the corners of circles; visibility is tested in the area itself.
            inner = (self.area if inner.is_empty else inner).simplify(CLEAR_M / 2.0)
            self._corners = _bends(inner)
            rows = [self._visible_m((x, y), self._corners) for x, y in self._corners]
            self._lengths = np.array(rows).reshape(len(rows), len(rows))
        return self._corners, self._lengths

    def _visible_m(self, place: Vertex, corners: Floats) -> Floats:
        """Return the distances from a place to the corners; infinity to hidden corners."""
        ends = np.empty((len(corners), 2, 2))
        ends[:, 0], ends[:, 1] = place, corners
        inside = shapely.covers(self.area, shapely.linestrings(ends))
        return np.where(inside, np.hypot(*(corners - np.asarray(place)).T), np.inf)


def _bends(area: BaseGeometry) -> Floats:
    """Return the corners (n, 2) that point into the area; shortest paths bend only at these."""
    found = []
    # ``normalize`` orients outlines clockwise and holes anticlockwise.
    for ring in shapely.get_rings(shapely.get_parts(shapely.normalize(area))):
        corners = shapely.get_coordinates(ring)[:-1]
        before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
        one, other = corners - before, after - corners
        turn = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
        found.append(corners[turn > 1e-9])
    return np.concatenate(found) if found else np.empty((0, 2))
