"""Exports the fire's perimeter with WFIGS field names, not marked as approved."""

from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from firemodel.outputs.event_polygon import event_polygon, feature_category, geodesic_acres
from firemodel.outputs.front_files import area_geometry
from firemodel.spread.fire_scheme import StartArea, burned_area

Floats = NDArray[np.float64]


def perimeter_geojson(
    arrival_s: Floats,
    landscape: Landscape,
    at_s: float,
    *,
    name: str,
    written_unix_ms: int,
    prescribed: bool = False,
    time_zero: datetime | None = None,
    start_area: StartArea | None = None,
) -> dict[str, Any]:
    """Return a FeatureCollection of the perimeter at the given time.

    The properties are those of the US interagency perimeters (WFIGS), without the prefix ``poly_``.
    Times are in ms since 1970 UTC.

    Args:
        arrival_s, landscape, at_s, start_area: As in ``burned_area``.
        name: The value of IncidentName.
        written_unix_ms: The current time.
        prescribed: Whether the fire is a prescribed burn.
        time_zero: The date and time of mission time 0; if None, PolygonDateTime is None.
    """
    area = burned_area(arrival_s, landscape, at_s, start_area)
    at_unix_ms = None if time_zero is None else round((time_zero.timestamp() + at_s) * 1000)
    geometry = area_geometry(area, landscape)
    properties = {
        **event_polygon(
            name,
            feature_category(prescribed),
            geodesic_acres(geometry),
            written_unix_ms,
            at_unix_ms,
        ),
        "at_s": at_s,
        "at_us": round(at_s * 1e6),
        "area_ha": round(area.area / 1e4, 3),
    }
    feature = {"type": "Feature", "properties": properties, "geometry": geometry}
    return {"type": "FeatureCollection", "features": [feature]}
