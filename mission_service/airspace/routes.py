"""Routes paths around and out of closed volumes, as short as possible."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from mission_service.visibility_graph import Vertex, VisibilityGraph

Floats = NDArray[np.float64]
FAR_M = 5_000.0  # search range for a way around, beyond the path and the volumes
EXIT_BEARINGS = 36


@dataclass
class Detours:
    """Shortest ways around a blocked area (x, y in metres), which may be empty."""

    blocked: BaseGeometry
    _graph: VisibilityGraph | None = field(default=None, repr=False)
    _box: BaseGeometry | None = field(default=None, repr=False)  # area that ``_graph`` covers

    def __post_init__(self) -> None:
        """Prepare the area for many queries."""
        shapely.prepare(self.blocked)

    def around(self, path_m: Floats) -> Floats | None:
        """Return a path (m, 2) that keeps out of the blocked area; None if there is no way.

        Parts of ``path_m`` (n, 2) inside the area are replaced by the shortest way around. If the
        path ends inside, the result ends where it would enter. If the path begins inside, the
        result first leaves the area. A path that does not touch the area is unchanged.
        """
        if self.blocked.is_empty or not self.blocked.intersects(_line(path_m)):
            return path_m
        inside = shapely.intersects_xy(self.blocked, path_m[:, 0], path_m[:, 1])
        route: list[Vertex] = [(float(path_m[0, 0]), float(path_m[0, 1]))]
        if inside[0]:
            route.append(self.nearest_outside(route[0]))
        for index in np.flatnonzero(~inside).tolist():
            target = (float(path_m[index, 0]), float(path_m[index, 1]))
            if target == route[-1]:
                continue
            way = self._way(route[-1], target, path_m)
            if way is None:
                break  # the rest of the path is beyond the volumes
            route += way[1:]
        if inside[-1] and len(path_m) > 1:
            entry = self._entry(path_m, inside)
            way = None if entry is None else self._way(route[-1], entry, path_m)
            if way is not None:
                route += way[1:]
        return np.array(route) if len(route) > 1 else None

    def nearest_outside(self, place: Vertex) -> Vertex:
        """Return the nearest position outside the blocked area."""
        point = shapely.Point(place)
        if not self.blocked.intersects(point):
            return place
        edge, _ = shapely.get_coordinates(shapely.shortest_line(self.blocked.boundary, point))
        away = edge - np.asarray(place)
        length_m = float(np.hypot(*away))
        beyond = edge + (away / length_m if length_m > 0.0 else np.zeros(2))
        return float(beyond[0]), float(beyond[1])

    def _way(self, begin: Vertex, end: Vertex, path_m: Floats) -> list[Vertex] | None:
        return self._graph_around(path_m).shortest_path(begin, end)

    def _graph_around(self, path_m: Floats) -> VisibilityGraph:
        """Return the graph of the free area around the volumes and the path."""
        if self._box is None or not self._box.covers(_line(path_m)):
            west_m, south_m, east_m, north_m = shapely.union(
                self.blocked.envelope, _line(path_m)
            ).bounds
            self._box = shapely.box(
                west_m - FAR_M, south_m - FAR_M, east_m + FAR_M, north_m + FAR_M
            )
            self._graph = VisibilityGraph(self._box.difference(self.blocked))
        assert self._graph is not None
        return self._graph

    def _entry(self, path_m: Floats, inside: NDArray[np.bool_]) -> Vertex | None:
        """Return the position 1 m before the path's last entry into the blocked area."""
        last_outside = np.flatnonzero(~inside)
        if not len(last_outside):
            return None
        first = int(last_outside[-1])
        leg = shapely.LineString(path_m[first : first + 2])
        if leg.length < 2.0:
            return None
        distance_m = float(leg.project(shapely.Point(_first_hit(leg, self.blocked)))) - 1.0
        if distance_m <= 0.0:
            return None
        point = leg.interpolate(distance_m)
        return float(point.x), float(point.y)


def _line(path_m: Floats) -> BaseGeometry:
    return shapely.Point(path_m[0]) if len(path_m) == 1 else shapely.LineString(path_m)


def _first_hit(leg: BaseGeometry, area: BaseGeometry) -> Floats:
    """Return the first position on a leg inside an area."""
    hits = shapely.get_coordinates(leg.intersection(area))
    start = shapely.get_coordinates(leg)[0]
    return np.asarray(hits[int(np.argmin(np.hypot(*(hits - start).T)))])


def exits_from(place: Vertex, blocked: BaseGeometry, beyond_m: float) -> Sequence[Vertex]:
    """Return positions outside a blocked area, ``beyond_m`` from its edge, nearest first.

    The positions lie on straight lines from ``place`` in all directions.
    """
    west_m, south_m, east_m, north_m = shapely.union(blocked.envelope, shapely.Point(place)).bounds
    reach_m = math.hypot(east_m - west_m, north_m - south_m) + 2.0 * beyond_m + 1.0
    wide = blocked.buffer(beyond_m, quad_segs=4)
    found: list[tuple[float, Vertex]] = []
    for number in range(EXIT_BEARINGS):
        bearing_rad = math.tau * number / EXIT_BEARINGS
        ahead = (math.sin(bearing_rad), math.cos(bearing_rad))
        ray = shapely.LineString(
            [place, (place[0] + reach_m * ahead[0], place[1] + reach_m * ahead[1])]
        )
        free = ray.difference(wide)
        if free.is_empty:
            continue
        points = shapely.get_coordinates(free)
        distance_m = float(np.min(np.hypot(*(points - np.asarray(place)).T))) + 1.0
        target = (place[0] + distance_m * ahead[0], place[1] + distance_m * ahead[1])
        found.append((distance_m, target))
    return [target for _, target in sorted(found)]
