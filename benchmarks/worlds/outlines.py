"""Closed volumes for the checker: distances from outlines, by geometry of its own."""

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.worlds.ground import Place, Terrain

GRID_POINTS = 40  # along each side of a volume's extent


@dataclass
class Closed:
    """A volume that is closed between two times.

    With ``inverted`` the volume is everything outside the outline (the allowed area). Limits with
    ``agl`` are above the ground at each position, otherwise above mean sea level.
    """

    name: str
    corners_m: list[Place]
    floor_m: float = -math.inf
    ceiling_m: float = math.inf
    floor_agl: bool = False
    ceiling_agl: bool = False
    from_s: float = 0.0
    until_s: float = math.inf
    known_s: float = 0.0  # time from which the service counts the volume as closed
    inverted: bool = False

    def counts(self, at_s: float) -> bool:
        """Return whether the service must count the volume as closed."""
        return self.known_s <= at_s < self.until_s

    def is_closed(self, at_s: float) -> bool:
        """Return whether the volume is closed."""
        return self.from_s <= at_s < self.until_s

    def limits_m(self, terrain: Terrain, place: Place) -> tuple[float, float]:
        """Return the lower and the upper limit above mean sea level at a position."""
        if not (self.floor_agl or self.ceiling_agl):
            return self.floor_m, self.ceiling_m
        ground_m = float(terrain.ground_m(*place))
        floor_m = self.floor_m + ground_m if self.floor_agl else self.floor_m
        return floor_m, self.ceiling_m + ground_m if self.ceiling_agl else self.ceiling_m

    def least_floor_m(self, terrain: Terrain) -> float:
        """Return the floor as the service defines it: above the lowest ground in the area."""
        if not self.floor_agl:
            return self.floor_m
        east_m, north_m = np.array(self.corners_m).T
        side_m = np.linspace(0.0, 1.0, GRID_POINTS)
        places = [
            (east_m.min() + x * np.ptp(east_m), north_m.min() + y * np.ptp(north_m))
            for x in side_m
            for y in side_m
        ]
        inside = [*self.corners_m, *(place for place in places if self.covers(place))]
        return self.floor_m + min(float(terrain.ground_m(*place)) for place in inside)

    def covers(self, place: Place) -> bool:
        """Return whether a position is in the area of the volume."""
        return is_inside(self.corners_m, place) != self.inverted

    def edge_m(self, place: Place) -> float:
        """Return the distance of a position from the outline."""
        return min(from_side_m(place, *side) for side in self.sides())

    def off_m(self, place: Place) -> float:
        """Return the distance of a position from the area; 0 inside."""
        return 0.0 if self.covers(place) else self.edge_m(place)

    def sides(self) -> list[tuple[Place, Place]]:
        """Return the sides of the outline."""
        return list(zip(self.corners_m, [*self.corners_m[1:], self.corners_m[0]], strict=True))

    def leg_off_m(self, start: Place, end: Place) -> float:
        """Return the least distance of a straight leg from the area; 0 if it enters."""
        if self.covers(start) or self.covers(end):
            return 0.0
        return min(_between_m(start, end, *side) for side in self.sides())


def is_inside(corners: list[Place], place: Place) -> bool:
    """Return whether a position is in a polygon: the number of sides to its east is odd."""
    x_m, y_m = place
    inside = False
    for (x1, y1), (x2, y2) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (y1 > y_m) != (y2 > y_m) and x_m < x1 + (y_m - y1) * (x2 - x1) / (y2 - y1):
            inside = not inside
    return inside


def from_side_m(place: Place, one: Place, other: Place) -> float:
    """Return the distance of a position from a straight line between two positions."""
    along = (other[0] - one[0], other[1] - one[1])
    square = along[0] ** 2 + along[1] ** 2
    share = 0.0
    if square > 0.0:
        share = ((place[0] - one[0]) * along[0] + (place[1] - one[1]) * along[1]) / square
        share = min(max(share, 0.0), 1.0)
    return math.hypot(place[0] - one[0] - share * along[0], place[1] - one[1] - share * along[1])


def _between_m(start: Place, end: Place, one: Place, other: Place) -> float:
    """Return the least distance between two straight lines; 0 if they cross."""
    if _side(start, end, one) != _side(start, end, other) and _side(one, other, start) != _side(
        one, other, end
    ):
        return 0.0
    return min(
        from_side_m(start, one, other),
        from_side_m(end, one, other),
        from_side_m(one, start, end),
        from_side_m(other, start, end),
    )


def _side(one: Place, other: Place, place: Place) -> bool:
    across = (other[0] - one[0]) * (place[1] - one[1]) - (other[1] - one[1]) * (place[0] - one[0])
    return across > 0.0
