"""Create initial fires from a mapped perimeter or from arrival times."""

from collections.abc import Iterable

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import mask_of
from firemodel.spread.fire_scheme import Burning, check_shape
from firemodel.spread.front import front_polygons

APART_CELLS = 0.5  # maximum distance between neighbouring points on a front
EDGE_CELLS = 1e-6  # an outline this close to the edge of the grid is not a front


def burning_from_perimeter(
    polygons: Iterable[BaseGeometry], landscape: Landscape, at_s: float
) -> Burning:
    """Return the fire whose burned area at ``at_s`` is given by polygons.

    The polygons are in the landscape's CRS.

    Each cell whose centre is inside burns at ``at_s``; if a polygon contains no centre, one cell
    burns. The front consists of all outlines on the grid, including those of unburned islands but
    not the boundaries between polygons. Raises FireModelError if no front is on the grid.
    """
    area = shapely.union_all(list(polygons))
    front = _front_on(area, landscape)
    if front.size == 0:
        raise FireModelError(
            "burning: no outline of the perimeter is on the landscape; check the CRS, or use a "
            "larger landscape"
        )
    arrival_s = np.full(landscape.shape, np.inf)
    arrival_s[mask_of([area], landscape)] = at_s
    return Burning(at_s, arrival_s, front, area)


def burning_from_arrival(arrival_s: Floats, landscape: Landscape, at_s: float) -> Burning:
    """Return the state of a fire at ``at_s`` from its arrival times (y, x).

    Unburned cells have an arrival time of infinity. Arrival times after ``at_s`` are used only to
    locate the front between two cells (``front.front_polygons``). Raises FireModelError if no cell
    or every cell has burned by ``at_s``.
    """
    check_shape(arrival_s, landscape)
    burned = arrival_s <= at_s
    if not burned.any():
        raise FireModelError(
            f"burning: no cell has an arrival by {at_s} s (the first is at {arrival_s.min()} s); "
            "use a later time"
        )
    if burned.all():
        raise FireModelError(
            f"burning: every cell has an arrival by {at_s} s; use an earlier time, and store no "
            "value in unburned cells"
        )
    area = front_polygons(arrival_s, at_s, landscape)
    extended = shapely.MultiPolygon([part for part in area.geoms if part.area > 0.0])
    return Burning(at_s, np.where(burned, arrival_s, np.inf), _front_on(area, landscape), extended)


def _front_on(area: BaseGeometry, landscape: Landscape) -> Floats:
    """Return points (k, 2), as float (row, column), on the outlines of an area within the grid."""
    rings = shapely.get_parts(area.boundary)
    drawn = shapely.length(rings) > 0.0  # the others are points: cells that have just ignited
    rings[drawn] = shapely.segmentize(rings[drawn], APART_CELLS * landscape.cell_size_m)
    x_m, y_m = shapely.get_coordinates(rings).T
    row, col = landscape.row_col_of(x_m, y_m)
    rows, cols = landscape.shape
    low, high_row, high_col = EDGE_CELLS - 0.5, rows - 0.5 - EDGE_CELLS, cols - 0.5 - EDGE_CELLS
    on = (row > low) & (row < high_row) & (col > low) & (col < high_col)
    return np.stack([row[on], col[on]], axis=1)
