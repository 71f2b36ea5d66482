"""The geometry of ignition lines across the wind (algorithm 1 of Beachly et al.).

The coordinate ``along`` increases downwind. The coordinate ``across`` increases to the left as seen
when looking downwind. Both coordinates are in metres from the origin of the landscape's CRS.
"""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

Floats = NDArray[np.float64]

SLIVER_M2 = 0.01  # smaller pieces of a cut area are rounding errors


@dataclass(frozen=True)
class IgnitionLine:
    """The line across the wind that lies ``along_m`` downwind of the origin.

    The wind blows towards ``toward_rad``, anticlockwise from east.
    """

    toward_rad: float
    along_m: float

    @property
    def downwind(self) -> Floats:
        """Return the unit vector that points downwind."""
        return np.array([math.cos(self.toward_rad), math.sin(self.toward_rad)])

    @property
    def left_unit(self) -> Floats:
        """Return the unit vector along the line, to the left as seen when looking downwind."""
        return np.array([-math.sin(self.toward_rad), math.cos(self.toward_rad)])

    def places_at(self, across_m: Floats) -> Floats:
        """Return the positions (n, 2) on the line at across coordinates (n,)."""
        found: Floats = self.along_m * self.downwind + np.outer(across_m, self.left_unit)
        return found

    def across(self, places_m: Floats) -> Floats:
        """Return the across coordinates (n,) of positions (n, 2)."""
        return np.asarray(places_m @ self.left_unit)


def line_across(area: BaseGeometry, toward_rad: float, spacing_m: float) -> IgnitionLine:
    """Return the line ``spacing_m`` upwind of an area's most downwind vertex (algorithm line 1)."""
    flat = IgnitionLine(toward_rad, 0.0)
    downwind_m = float(np.max(shapely.get_coordinates(area) @ flat.downwind))
    return IgnitionLine(toward_rad, downwind_m - spacing_m)


def upwind_of(area: BaseGeometry, line: IgnitionLine) -> BaseGeometry:
    """Return the part of an area upwind of a line, as a Polygon (may be empty) or MultiPolygon."""
    if area.is_empty:
        return area
    corners = shapely.get_coordinates(area)
    along, across = corners @ line.downwind, corners @ line.left_unit
    back, low, high = along.min() - 1.0, across.min() - 1.0, across.max() + 1.0
    if line.along_m <= back:
        return shapely.Polygon()
    box = np.array([[back, low], [line.along_m, low], [line.along_m, high], [back, high]])
    upwind = shapely.Polygon(box @ np.stack([line.downwind, line.left_unit]))
    return only_areas(area.intersection(upwind))


def only_areas(shape: BaseGeometry) -> BaseGeometry:
    """Return the polygons in a geometry, without slivers."""
    parts = [
        part
        for part in shapely.get_parts(shapely.get_parts(shape))
        if part.geom_type == "Polygon" and part.area > SLIVER_M2
    ]
    if not parts:
        return shapely.Polygon()
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)


def extent_across(area: BaseGeometry, line: IgnitionLine) -> tuple[float, float] | None:
    """Return the across coordinates of a line's two ends in an area.

    The area may have gaps between the ends. The result is None if the line misses the area.
    """
    across = line.across(shapely.get_coordinates(area))
    ends = line.places_at(np.array([across.min() - 1.0, across.max() + 1.0]))
    inside = shapely.LineString(ends).intersection(area)
    if inside.length <= 0.0:
        return None
    found = line.across(shapely.get_coordinates(inside))
    return float(found.min()), float(found.max())


def alignment_m(
    line: IgnitionLine,
    ends_m: tuple[float, float],
    earlier_m: Floats,
    area: BaseGeometry,
    near_m: float,
) -> float:
    """Return the across coordinate with which one drop of a new line is aligned (algorithm line 5).

    The result is the across coordinate of the earlier drop closest to the line's centre. An earlier
    drop (n, 2) counts only if its distance from ``area`` exceeds the smallest of these distances by
    at most ``near_m``. Without earlier drops the result is the line's centre.
    """
    centre = (ends_m[0] + ends_m[1]) / 2.0
    if len(earlier_m):
        away_m = shapely.distance(shapely.points(earlier_m), area)
        across = line.across(earlier_m[away_m <= away_m.min() + near_m])
        return float(across[np.argmin(np.abs(across - centre))])
    return centre


def drop_points(
    line: IgnitionLine, ends_m: tuple[float, float], through_m: float, spacing_m: float
) -> Floats:
    """Return positions (n, 2) every ``spacing_m`` on a line between its ends, from right to left.

    The positions are aligned with the across coordinate ``through_m`` (algorithm line 6).
    """
    first = math.ceil((ends_m[0] - through_m) / spacing_m - 1e-9)
    last = math.floor((ends_m[1] - through_m) / spacing_m + 1e-9)
    return line.places_at(through_m + spacing_m * np.arange(first, last + 1, dtype=np.float64))
