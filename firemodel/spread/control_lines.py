"""Build control lines over time: cells that cannot burn once construction has crossed them.

Construction advances at a constant rate and is not interrupted by the fire. A line is one cell
wide, and fire never burns across it; firebrands fly over it.
"""

import math
from collections.abc import Iterable

import numpy as np
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import cells_along
from firemodel.spread.fire_scheme import Closing

SECONDS_PER_H = 3600.0
MAX_LENGTH_CELLS = 1e6  # longer lines would need much memory


def closings_along(
    lines: Iterable[BaseGeometry], landscape: Landscape, at_s: float, rate_m_h: float = math.inf
) -> list[Closing]:
    """Return the closings of lines that are built one after another.

    Args:
        lines: shapely lines or polygons (their outlines), alone or in collections, in the
            landscape's CRS.
        landscape: The grid.
        at_s: The start of construction in s.
        rate_m_h: Metres of line per hour, on the map; by default the lines are complete at
            ``at_s``.

    Returns:
        The closings, in order of time.

    Raises:
        FireModelError: A geometry is a point, no line is on the landscape, or a line is extremely
            long.
    """
    found: dict[float, list[int]] = {}
    built_m = 0.0
    for line in _lines(lines):
        if not line.length < MAX_LENGTH_CELLS * landscape.cell_size_m:
            raise FireModelError("control line: extends far from the landscape; check the points")
        cells, lengths_m = cells_along(line, landscape)
        for cell, length_m in zip(cells.tolist(), lengths_m.tolist(), strict=True):
            closes_s = at_s + SECONDS_PER_H * (built_m + length_m) / rate_m_h
            found.setdefault(closes_s, []).append(cell)
        built_m += line.length
    if not found:
        raise FireModelError("control line: no part of it is on the landscape; check the points")
    return [Closing(time_s, np.array(cells)) for time_s, cells in sorted(found.items())]


def _lines(geometries: Iterable[BaseGeometry]) -> Iterable[BaseGeometry]:
    """Yield the lines of geometries, and the outlines of polygons."""
    for geometry in geometries:
        if geometry.is_empty:
            continue
        if geometry.geom_type == "Polygon":
            yield from _lines([geometry.boundary])
        elif geometry.geom_type in ("LineString", "LinearRing"):
            yield geometry
        elif hasattr(geometry, "geoms"):
            yield from _lines(geometry.geoms)
        else:
            raise FireModelError(f"the control line is a {geometry.geom_type}, not a line")
