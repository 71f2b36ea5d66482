"""Shortest paths inside an area, over the visibility graph of its corners."""

import heapq
import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

Floats = NDArray[np.float64]
Vertex = tuple[float, float]

CLEAR_M = 1.0  # distance to corners where there is room


class VisibilityGraph:
    """Paths inside ``area``; the graph of its corners is built at the first use."""

    def __init__(self, area: BaseGeometry) -> None:
        self.area = area
        shapely.prepare(area)
        self._corners: Floats | None = None
        self._lengths: Floats = np.empty((0, 0))

    def is_straight_clear(self, begin: Vertex, end: Vertex) -> bool:
        """Whether the straight line between two points is inside the area."""
        if begin == end:
            return bool(self.area.covers(shapely.Point(begin)))
        return bool(self.area.covers(shapely.LineString([begin, end])))

    def shortest_path(self, begin: Vertex, end: Vertex) -> list[Vertex] | None:
        """Points of the shortest path, ``begin`` and ``end`` included; None without a path."""
        if self.is_straight_clear(begin, end):
            return [begin, end]
        if not self.area.covers(shapely.MultiPoint([begin, end])):
            return None
        corners, lengths = self._known()
        if not len(corners):
            return None
        from_begin, to_end = self._seen(begin, corners), self._seen(end, corners)
        # Dijkstra from begin over the corners.
        best = from_begin.copy()
        before = np.full(len(corners), -1)
        queue = [(float(best[n]), n) for n in np.flatnonzero(np.isfinite(best)).tolist()]
        heapq.heapify(queue)
        while queue:
            far, here = heapq.heappop(queue)
            if far > best[here]:
                continue
            for there in np.flatnonzero(best > far + lengths[here]).tolist():
                best[there] = far + lengths[here, there]
                before[there] = here
                heapq.heappush(queue, (float(best[there]), there))
        last = int(np.argmin(best + to_end))
        if not math.isfinite(best[last] + to_end[last]):
            return None
        back = [end]
        while last >= 0:
            back.append((float(corners[last, 0]), float(corners[last, 1])))
            last = int(before[last])
        return [*back, begin][::-1]

    def _known(self) -> tuple[Floats, Floats]:
        if self._corners is None:
            inner: BaseGeometry = self.area.buffer(-CLEAR_M, join_style="mitre")
            # Fewer corners of circles; visibility is tested in the area itself.
            inner = (self.area if inner.is_empty else inner).simplify(CLEAR_M / 2.0)
            self._corners = _bends(inner)
            count = len(self._corners)
            self._lengths = np.full((count, count), np.inf)
            for number in range(count):
                self._lengths[number] = self._seen(
                    (self._corners[number, 0], self._corners[number, 1]), self._corners
                )
        return self._corners, self._lengths

    def _seen(self, place: Vertex, corners: Floats) -> Floats:
        """Distances of the corners visible from a place; infinity for the others."""
        ends = np.empty((len(corners), 2, 2))
        ends[:, 0], ends[:, 1] = place, corners
        inside = shapely.covers(self.area, shapely.linestrings(ends))
        return np.where(inside, np.hypot(*(corners - np.asarray(place)).T), np.inf)


def _bends(area: BaseGeometry) -> Floats:
    """Corners (n, 2) that a shortest path can bend around: those that point into the area."""
    found = []
    # Outlines clockwise, holes the other way.
    for ring in shapely.get_rings(shapely.get_parts(shapely.normalize(area))):
        corners = shapely.get_coordinates(ring)[:-1]
        before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
        one, other = corners - before, after - corners
        turn = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
        found.append(corners[turn > 1e-9])
    return np.concatenate(found) if found else np.empty((0, 2))
