"""Convert self-intersecting polygons and closed lines to valid polygons."""

from functools import reduce

import numpy as np
import shapely
from pyproj import Geod
from shapely.geometry.base import BaseGeometry

WGS84 = Geod(ellps="WGS84")


def repaired(shape: BaseGeometry) -> BaseGeometry:
    """Return a valid polygon for closed lines or an invalid polygon, else the shape itself.

    The area of several closed lines consists of the points inside an odd number of these lines, so
    that a line inside another line is the edge of an island. The result for a self-intersecting
    polygon contains the areas of all its loops. Parts without area are removed. A shape with a
    coordinate that is not finite is returned unchanged.
    """
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        return shape
    lines = [part for part in shapely.get_parts(shape) if part.geom_type == "LineString"]
    if lines and all(line.is_closed and len(line.coords) > 3 for line in lines):
        areas = [_valid(shapely.Polygon(line.coords)) for line in lines]
        return reduce(shapely.symmetric_difference, areas)
    return shape if shape.is_valid or shape.is_empty else _valid(shape)


def area_ha(shape: BaseGeometry) -> float:
    """Return the area in hectares, on the WGS84 ellipsoid, of a shape in longitude and latitude.

    The areas of loops with opposite orientation have opposite signs, as in GIS software.
    """
    found_m2, _ = WGS84.geometry_area_perimeter(shape)
    return abs(found_m2) / 1e4


def _valid(shape: BaseGeometry) -> BaseGeometry:
    found: BaseGeometry = shapely.make_valid(shape, method="structure", keep_collapsed=False)
    return found
