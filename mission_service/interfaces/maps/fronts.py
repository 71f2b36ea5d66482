"""Encodes fronts, forecast contours and bands of uncertainty as GeoJSON (RFC 7946)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from firemodel.outputs.event_polygon import M2_PER_ACRE
from firemodel.outputs.front_files import area_geometry
from firemodel.spread.fire_scheme import StartArea, burned_area
from firemodel.spread.front import front_polygons

LEVELS = (0.1, 0.5, 0.9)

Floats = NDArray[np.float64]


def front_geojson(
    arrival_s: Floats,
    landscape: Landscape,
    at_s: float,
    now_s: float,
    *,
    start_area: StartArea | None = None,
    **props: Any,
) -> dict[str, Any]:
    """Return the area burned at the given time (see ``burned_area``) as a GeoJSON Feature.

    ``props`` are additional properties. The Feature has no coordinates if nothing has burned.
    """
    area = burned_area(arrival_s, landscape, at_s, start_area)
    return _feature(area, landscape, at_s, now_s, props)


def contours_geojson(
    arrival_s: Floats,
    landscape: Landscape,
    times_s: Sequence[float],
    now_s: float,
    *,
    start_area: StartArea | None = None,
    **props: Any,
) -> dict[str, Any]:
    """Return a FeatureCollection with ``front_geojson`` for each time, the latest first."""
    return _collection(
        [
            front_geojson(arrival_s, landscape, at_s, now_s, start_area=start_area, **props)
            for at_s in sorted(set(times_s), reverse=True)
        ]
    )


def probability_geojson(
    probability: Floats,
    landscape: Landscape,
    at_s: float,
    now_s: float,
    levels: Sequence[float] = LEVELS,
    **props: Any,
) -> dict[str, Any]:
    """Return a FeatureCollection: for each level, the area burned with at least this probability.

    The lowest level (the largest area) comes first, which is the order for drawing. ``probability``
    (y, x) is the probability, from 0 to 1, that a cell is burned at ``at_s``.
    """
    features = []
    for level in sorted(set(levels)):
        area = front_polygons(1.0 - probability, 1.0 - level, landscape)
        features.append(_feature(area, landscape, at_s, now_s, {"probability": level, **props}))
    return _collection(features)


def _feature(
    area: Any, landscape: Landscape, at_s: float, now_s: float, props: dict[str, Any]
) -> dict[str, Any]:
    properties = {
        "at_s": at_s,
        "at_us": round(at_s * 1e6),
        "in_s": at_s - now_s,
        "area_ha": round(area.area / 1e4, 3),
        "area_acres": round(area.area / M2_PER_ACRE, 2),
        "perimeter_m": round(area.length, 1),
        **props,
    }
    geometry = area_geometry(area, landscape)
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _collection(features: list[dict[str, Any]]) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": features}
