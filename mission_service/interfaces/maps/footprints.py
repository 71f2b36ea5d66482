"""Encodes the latest observations as GeoJSON (RFC 7946): the ground that each source has seen."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from firemodel.arrays import Mask
from firemodel.assimilation.observation import BURNED, UNSEEN
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.front_files import area_geometry
from mission_service.events import FireObserved, Observed
from mission_service.fire.observed_window import states_in
from mission_service.runtime.observation_sources import Footprint


def footprints_geojson(footprints: Iterable[Footprint], landscape: Landscape) -> dict[str, Any]:
    """Return a FeatureCollection of footprints.

    The property ``part`` of a Feature is ``seen`` for the cells that an image shows, ``burned`` for
    the burned cells in an image, if there are any, and ``reported`` for a report. A report keeps
    the shape in which it was sent.
    """
    found = [
        {
            "type": "Feature",
            "geometry": geometry,
            "properties": {**_properties(each), "part": part},
        }
        for each in footprints
        for part, geometry in _parts(each.event, landscape)
    ]
    return {"type": "FeatureCollection", "features": found}


def _properties(footprint: Footprint) -> dict[str, Any]:
    event = footprint.event
    return {
        "number": footprint.number,
        "source": footprint.source,
        "at_us": footprint.at_us,
        "position_sd_m": event.position_sd_m,
        "distrusted": isinstance(event, Observed) and event.distrusted,
        "state": event.state if isinstance(event, FireObserved) else None,
    }


def _parts(
    event: Observed | FireObserved, landscape: Landscape
) -> list[tuple[str, dict[str, Any]]]:
    if isinstance(event, FireObserved):
        return [("reported", _drawn(event))]
    state = states_in(event.cells)
    burned = state == BURNED
    parts = [("seen", state != UNSEEN), *([("burned", burned)] if burned.any() else [])]
    return [
        (part, area_geometry(_area_of(mask, event.row, event.col, landscape), landscape))
        for part, mask in parts
    ]


def _drawn(report: FireObserved) -> dict[str, Any]:
    """Return the geometry of a report, with its points in order."""
    places = [[lon_deg, lat_deg] for lat_deg, lon_deg in report.points]
    match report.shape:
        case "points":
            return {"type": "MultiPoint", "coordinates": places}
        case "line":
            return {"type": "LineString", "coordinates": places}
        case _:
            return {"type": "Polygon", "coordinates": [[*places, places[0]]]}


def _area_of(cells: Mask, top: int, left: int, landscape: Landscape) -> BaseGeometry:
    """Return the area of the cells of a mask (y, x) whose north-west cell is (``top``, ``left``).

    The result is in the landscape's CRS, and is empty for a mask without cells.
    """
    from rasterio import Affine
    from rasterio.features import shapes

    cell_m = landscape.cell_size_m
    west_m, north_m = landscape.west_m + left * cell_m, landscape.north_m - top * cell_m
    placed = Affine(cell_m, 0.0, west_m, 0.0, -cell_m, north_m)
    found = shapes(cells.astype(np.uint8), mask=cells, transform=placed)
    return shapely.union_all([shapely.geometry.shape(shape) for shape, _ in found])
