"""Write the fronts of a fire as GeoJSON and KML, with a QGIS style."""

import json
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.event_polygon import (
    MAP_METHOD,
    STATUS,
    feature_category,
    geodesic_acres,
)
from firemodel.outputs.fronts_kml import fronts_kml
from firemodel.outputs.layer_legends import after_zero, arrival_layer_of
from firemodel.outputs.qgis_style_files import fronts_qml
from firemodel.outputs.whole_file import write_whole
from firemodel.spread.fire_scheme import Fire

MIN_DEG, DECIMALS = 1e-7, 7  # about a centimetre


def area_geometry(area: Any, landscape: Landscape) -> dict[str, Any]:
    """Convert polygons in the landscape's CRS to a MultiPolygon of RFC 7946.

    Coordinates are WGS84 [lon, lat], rounded to a centimetre; outer rings are anticlockwise.
    Polygons are cut at the antimeridian.
    """
    from shapely import get_parts, set_precision, transform
    from shapely.geometry.polygon import orient

    def to_lon_lat(xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        lat, lon = landscape.lat_lon_of(*xy_m.T)
        return np.stack([landscape.unwrapped_deg(lon), lat], axis=1)

    rounded = _within_180_deg(set_precision(transform(area, to_lon_lat), MIN_DEG))
    shapes = [orient(part) for part in get_parts(rounded) if part.geom_type == "Polygon"]
    # Rounded again, because shapely's multiples of 1e-7 degrees have more decimals as floats.
    return {
        "type": "MultiPolygon",
        "coordinates": [
            [
                np.round(np.asarray(ring.coords), DECIMALS).tolist()
                for ring in (shape.exterior, *shape.interiors)
            ]
            for shape in shapes
        ],
    }


def _within_180_deg(area: Any) -> Any:
    """Return an area in degrees cut at the antimeridian, with longitudes from -180 to 180."""
    from shapely import box, union_all
    from shapely.affinity import translate

    if area.is_empty or (area.bounds[0] >= -180.0 and area.bounds[2] <= 180.0):
        return area
    parts = [
        translate(area.intersection(box(turn - 180.0, -90.0, turn + 180.0, 90.0)), -turn)
        for turn in (-360.0, 0.0, 360.0)
    ]
    return union_all(parts)


def fronts_geojson(
    fire: Fire,
    times_s: Sequence[float],
    name: str,
    time_zero: datetime | None = None,
    prescribed: bool = False,
) -> dict[str, Any]:
    """Return GeoJSON (RFC 7946, WGS84) with the burned area at each time as a MultiPolygon.

    The names of the properties are those of the US interagency perimeters (WFIGS); calendar times
    are in ms since 1970 UTC. The features have the status of an unapproved perimeter. ``time_zero``
    is the calendar time of 0 s, if there is one; ``prescribed`` states whether the fire is a
    prescribed burn. Raises FireModelError if the times do not increase or the fire has not been
    advanced to one of them.
    """
    check_increasing(times_s)
    features = []
    for time_s in times_s:
        area = fire.front(time_s)
        geometry = area_geometry(area, fire.landscape)
        properties = {
            "IncidentName": name,
            "FeatureCategory": feature_category(prescribed),
            "MapMethod": MAP_METHOD,
            "FeatureStatus": STATUS,
            "GISAcres": round(geodesic_acres(geometry), 2),
            "area_ha": round(area.area / 1e4, 2),
            "time_s": time_s,
            "time_s_origin": after_zero(time_zero),
        }
        if time_zero is not None:
            properties["PolygonDateTime"] = round((time_zero.timestamp() + time_s) * 1000)
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return {"type": "FeatureCollection", "features": features}


def check_increasing(times_s: Sequence[float]) -> None:
    """Raise FireModelError unless times are finite and increase."""
    for number, time_s in enumerate(times_s):
        if not np.isfinite(time_s):
            raise FireModelError(f"times_s[{number}] is {time_s}; it must be a number of seconds")
        if number and not time_s > times_s[number - 1]:
            raise FireModelError(
                f"times_s[{number}] = {time_s} is not later than {times_s[number - 1]}; sort the "
                "times and remove duplicates"
            )


def write_fronts(
    path: Path | str,
    fire: Fire,
    times_s: Sequence[float],
    name: str,
    time_zero: datetime | None = None,
    prescribed: bool = False,
) -> None:
    """Write the burned area at each time as GeoJSON (RFC 7946; see ``fronts_geojson``).

    Two files of the same name are written next to the GeoJSON: a QGIS style (.qml), and KML (.kml)
    with the calendar times, if ``time_zero`` is given.

    Args:
        path: The GeoJSON file to write.
        fire: A fire that has been advanced at least to the last of the times.
        times_s: Increasing times in seconds; each yields one feature.
        name: The incident's name.
        time_zero: The calendar time of 0 s, if there is one.
        prescribed: Whether the fire is a prescribed burn.

    Raises:
        FireModelError: The times do not increase, the fire has not been advanced to one of them, or
            a file cannot be written.
    """
    path = Path(path)
    found = fronts_geojson(fire, times_s, name, time_zero, prescribed)
    layer = arrival_layer_of(fire, time_zero)
    write_whole(path, json.dumps(found) + "\n")
    write_whole(path.with_suffix(".qml"), fronts_qml(layer))
    write_whole(path.with_suffix(".kml"), fronts_kml(found, name, layer, time_zero))
