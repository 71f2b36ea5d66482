"""Create observations from the points, lines and polygons that an operator draws on a map."""

from typing import Literal

import numpy as np
import shapely

from firemodel.arrays import Floats
from firemodel.ellipses.point_observations import BURNED, BURNING, UNBURNED
from firemodel.errors import FireModelError

Shape = Literal["point", "line", "polygon"]
MIN_POINTS = {"point": 1, "line": 2, "polygon": 3}


def observations_of(
    shape: Shape, points_m: Floats, at_s: float, state: int, spacing_m: float
) -> Floats:
    """Return the observations (n, 4) for a drawn shape with corners (k, 2) in metres.

    The columns of the observations are x, y, at_s and state. A line, or the outline of a polygon,
    gives observations at its corners and at points between the corners, at most ``spacing_m``
    apart. The outline of a burning polygon is the front, and points inside the polygon give no
    observations. A burned or unburned polygon also gives observations at the points of a grid
    inside the polygon, ``spacing_m`` apart.

    Raises FireModelError for too few points, values that are not finite, an unknown state, a
    spacing that is not positive, or a polygon whose outline crosses itself.
    """
    points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
    if shape not in MIN_POINTS or len(points) < MIN_POINTS[shape]:
        raise FireModelError(
            f"{shape} of {len(points)} points: draw a point, a line of 2 or more points, or a "
            "polygon of 3 or more"
        )
    if not np.isfinite(points).all() or not np.isfinite(at_s):
        raise FireModelError(f"{shape} at {at_s} s: positions and time must be finite numbers")
    if state not in (BURNED, BURNING, UNBURNED):
        raise FireModelError(
            f"{shape}: state {state}: must be -1 (burned), 0 (burning) or 1 (unburned)"
        )
    if not 0.0 < spacing_m < np.inf:
        raise FireModelError(f"{shape}: spacing_m = {spacing_m} must be more than 0")
    if shape == "line":
        points = _along(shapely.LineString(points), spacing_m)
    elif shape == "polygon":
        polygon = shapely.Polygon(points)
        if not polygon.is_valid:
            raise FireModelError("polygon: its outline crosses itself; draw it again, or as a line")
        points = _along(polygon.exterior, spacing_m)[:-1]
        if state != BURNING:
            points = np.concatenate([points, _inside(polygon, spacing_m)])
    return np.column_stack([points, np.full(len(points), at_s), np.full(len(points), state)])


def _along(line: shapely.LineString, spacing_m: float) -> Floats:
    if line.length == 0.0:  # all points coincide
        return shapely.get_coordinates(line)[:1]
    found: Floats = shapely.get_coordinates(shapely.segmentize(line, spacing_m))
    return found


def _inside(polygon: shapely.Polygon, spacing_m: float) -> Floats:
    """Return grid points (n, 2) in a polygon, at least half the spacing from its outline."""
    west, south, east, north = polygon.bounds
    x_m, y_m = np.meshgrid(
        np.arange(west + 0.5 * spacing_m, east, spacing_m),
        np.arange(south + 0.5 * spacing_m, north, spacing_m),
    )
    inner = polygon.buffer(-0.5 * spacing_m)
    within = shapely.contains_xy(inner, x_m, y_m)
    return np.column_stack([x_m[within], y_m[within]])
