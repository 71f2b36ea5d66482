"""Finds shortest paths inside an area using the visibility graph of its corners."""

import heapq
import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]
Vertex = tuple[float, float]

CLEAR_M = 1.0  # distance between paths and corners if the area is wide enough
ROUNDING = 1e-9  # positions within this distance of a line count as on the line


class VisibilityGraph:
    """The visibility graph of an area's corners, for shortest paths inside the area.

    The visibility between two corners is computed when a search first needs it.

    Args:
        area: The area, whose units apply to the paths.
        clear: The distance between paths and corners if the area is wide enough.
        only_tangents: Whether the graph contains only tangents to the outlines. A search then takes
            a fraction of the time, but may find no path through a passage narrower than twice the
            distance ``clear``.
    """

    def __init__(
        self, area: BaseGeometry, clear: float = CLEAR_M, only_tangents: bool = False
    ) -> None:
        self.area = area
        shapely.prepare(area)
        self._clear = clear
        self._only_tangents = only_tangents
        self._bends: Floats | None = None
        self._lengths: Floats = np.empty((0, 0))  # between bends: NaN if unknown, inf if hidden

    def is_straight_clear(self, begin: Vertex, end: Vertex) -> bool:
        """Return whether the straight line between two points is inside the area."""
        if begin == end:
            return bool(self.area.covers(shapely.Point(begin)))
        return bool(self.area.covers(shapely.LineString([begin, end])))

    def shortest_path(
        self, begin: Vertex, end: Vertex, max_length: float = math.inf
    ) -> list[Vertex] | None:
        """Return the points of the shortest path from ``begin`` to ``end``.

        The result is None if there is no path, or only a path longer than ``max_length``.
        """
        if self.is_straight_clear(begin, end):
            return [begin, end] if math.dist(begin, end) <= max_length else None
        if not self.area.covers(shapely.MultiPoint([begin, end])):
            return None
        bends = self._bends_inside()
        corners = bends[:, 0]
        ahead = np.hypot(*(corners - np.asarray(end)).T)
        # A*: ``best`` holds the lengths from ``begin``, and ``ahead`` the distances to ``end``.
        near = np.hypot(*(corners - np.asarray(begin)).T) + ahead <= max_length
        best, before = self._visible_from(begin, bends, near), np.full(len(corners), -1)
        to_end = self._visible_from(end, bends, near)
        queue = [(float(best[n] + ahead[n]), n) for n in np.flatnonzero(np.isfinite(best)).tolist()]
        heapq.heapify(queue)
        shortest = min(max_length, float(np.min(best + to_end, initial=math.inf)))
        while queue:
            through, corner = heapq.heappop(queue)
            if through > shortest:
                break
            if through > best[corner] + ahead[corner]:
                continue
            straight = np.hypot(*(corners - corners[corner]).T)
            useful = best[corner] + straight + ahead <= shortest
            useful &= best[corner] + straight < best
            others = np.flatnonzero(useful)
            lengths = best[corner] + self._between(corner, others)
            shorter = lengths < best[others]
            others, lengths = others[shorter], lengths[shorter]
            best[others], before[others] = lengths, corner
            shortest = min(shortest, float(np.min(lengths + to_end[others], initial=math.inf)))
            for other in others.tolist():
                heapq.heappush(queue, (float(best[other] + ahead[other]), other))
        if not np.any(np.isfinite(best + to_end) & (best + to_end <= max_length)):
            return None
        last = int(np.argmin(best + to_end))
        back = [end]
        while last >= 0:
            back.append((float(corners[last, 0]), float(corners[last, 1])))
            last = int(before[last])
        return [*back, begin][::-1]

    def _bends_inside(self) -> Floats:
        """Return the possible bends (n, 3, 2) of paths that stay clear of the outlines."""
        if self._bends is None:
            inner: BaseGeometry = self.area.buffer(-self._clear, join_style="mitre")
            # Circles are given fewer corners; visibility is tested in the area itself.
            inner = (self.area if inner.is_empty else inner).simplify(self._clear / 2.0)
            self._bends = _bends(inner)
            self._lengths = np.full((len(self._bends), len(self._bends)), np.nan)
        return self._bends

    def _between(self, corner: int, others: Integers) -> Floats:
        """Return the distances from a corner to others; infinity for hidden corners."""
        assert self._bends is not None
        unknown = others[np.isnan(self._lengths[corner, others])]
        if len(unknown):
            here, there = self._bends[corner], self._bends[unknown]
            useful = np.ones(len(there), dtype=bool)
            if self._only_tangents:
                useful = _is_tangent(here, there[:, 0], ROUNDING)
                useful &= _is_tangent(there, here[0], ROUNDING)
            found = self._visible((here[0, 0], here[0, 1]), there, useful)
            self._lengths[corner, unknown] = self._lengths[unknown, corner] = found
        lengths: Floats = self._lengths[corner, others]
        return lengths

    def _visible_from(self, place: Vertex, bends: Floats, useful: Booleans) -> Floats:
        """Return the distances from either end of a path to bends, as ``_visible`` does."""
        if self._only_tangents:
            # An end of a path may be closer to an outline than the bends are.
            useful = useful & _is_tangent(bends, np.asarray(place), 2.0 * self._clear)
        return self._visible(place, bends, useful)

    def _visible(self, place: Vertex, bends: Floats, useful: Booleans) -> Floats:
        """Return the distances from a position to bends (n, 3, 2).

        The distance is infinite for a bend that is hidden, or for which ``useful`` (n) is False.
        """
        corners = bends[useful, 0]
        ends = np.empty((len(corners), 2, 2))
        ends[:, 0], ends[:, 1] = place, corners
        inside = shapely.covers(self.area, shapely.linestrings(ends))
        found = np.full(len(bends), np.inf)
        found[useful] = np.where(inside, np.hypot(*(corners - np.asarray(place)).T), np.inf)
        return found


def _bends(area: BaseGeometry) -> Floats:
    """Return the corners that point into the area; shortest paths bend only at these corners.

    The array (n, 3, 2) holds each corner, the preceding corner and the following corner.
    """
    found = [np.empty((0, 3, 2))]
    # ``normalize`` orients outlines clockwise and holes anticlockwise.
    for ring in shapely.get_rings(shapely.get_parts(shapely.normalize(area))):
        corners = shapely.get_coordinates(ring)[:-1]
        before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
        turn = _cross(corners - before, after - corners)
        found.append(np.stack([corners, before, after], axis=1)[turn > 1e-9])
    return np.concatenate(found)


def _is_tangent(bend: Floats, place: Floats, slack: float) -> Booleans:
    """Return whether the line from a position to a bend (..., 3, 2) is a tangent at the bend.

    Both sides of the bend are then on the same side of the line. The line also counts as a tangent
    if the position is within ``slack`` of the straight line along a side of the bend.
    """
    line = bend[..., 0, :] - place
    sides = bend[..., 1:, :] - bend[..., :1, :]
    beside = _cross(line[..., None, :], sides) / np.hypot(sides[..., 0], sides[..., 1])
    tangent: Booleans = np.prod(beside, axis=-1) >= 0.0
    tangent |= np.min(np.abs(beside), axis=-1) <= slack
    return tangent


def _cross(one: Floats, other: Floats) -> Floats:
    product: Floats = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    return product
