"""Reads the polygons and attributes of fire perimeters from other organisations."""

import math
import re
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from pyproj import Geod
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.agency_fields import attribute
from firemodel.landscape.readers.bands import refuse
from firemodel.landscape.readers.shapes import shape_problems
from firemodel.outputs.event_polygon import M2_PER_ACRE
from firemodel.spread.front import multipolygon
from mission_service.interfaces.maps.geometry_limits import MAX_PAIRS, max_repaired, pairs_near
from mission_service.interfaces.maps.mercator import outline_of
from mission_service.uploaded_shapes import LARGEST_BYTES, WGS84, Drawn, features_in

__all__ = ["LARGEST_BYTES", "Perimeter", "read_perimeter"]

# Attributes of a feature, and their names in WFIGS (with the prefix poly_ or attr_), FIRIS and KML.
FIELDS = {
    "incident_name": ("IncidentName", "incident_name", "name"),
    "feature_category": ("FeatureCategory", "type"),
    "map_method": ("MapMethod",),
    "feature_status": ("FeatureStatus",),
    "source": ("Source",),
    "irwin_id": ("IRWINID",),
    "gis_acres": ("GISAcres",),
    "polygon_unix_ms": ("PolygonDateTime", "when", "end", "begin"),
    "current_unix_ms": ("DateCurrent", "modify_date"),
    "created_unix_ms": ("CreateDate", "created_date"),
}
FAR_APART_MS = 24 * 3600 * 1000  # a larger difference between two times in one record causes a note
AREAS_DIFFER = 0.1
SMALL_SHARE = 0.001
LONGEST_TEXT = 200
EARLIEST_MS, LATEST_MS = 0, 4_102_444_800_000  # 1970 to 2100

Record = dict[str, Any]


class Perimeter(NamedTuple):
    """A perimeter of a fire from another organisation."""

    area: Any  # union of all features: shapely MultiPolygon, WGS84 longitude and latitude
    area_ha: float
    vertices: int
    records: list[Record]  # one per feature, with the keys of FIELDS; None is a missing value
    notes: list[str]  # irregularities, one line for each

    def geojson(self) -> dict[str, Any]:
        """Return a Feature with all attributes as properties."""
        return {
            "type": "Feature",
            "properties": {
                "area_ha": round(self.area_ha, 3),
                "vertices": self.vertices,
                "records": self.records,
                "notes": self.notes,
            },
            "geometry": shapely.geometry.mapping(self.area),
        }


def read_perimeter(data: bytes, file_name: str, landscape: Landscape) -> Perimeter:
    """Return the perimeter in a GeoJSON, KML, KMZ or zipped Shapefile (see ``uploaded_shapes``).

    The perimeter omits features without polygons and features outside the landscape; invalid
    features are repaired. ``notes`` lists all these features. Raises FireModelError with a
    one-line text that names the file and the feature.
    """
    return read_perimeter_in(data, file_name, shapely.Polygon(outline_of(landscape)))


def read_perimeter_in(data: bytes, file_name: str, extent: BaseGeometry) -> Perimeter:
    """Return the result of ``read_perimeter``, for a landscape with this outline (lon, lat).

    The longitudes of the outline, and those of the perimeter, may continue beyond -180 or 180.
    """
    name = printable(file_name)
    polygons, records, notes = [], [], []
    off: list[tuple[int, BaseGeometry]] = []
    features = features_in(data, name)
    if pairs_near([drawn.shape for drawn in features], MAX_PAIRS) > MAX_PAIRS:
        raise FireModelError(f"{name}: its lines cross or overlap too often; simplify it")
    for number, drawn in enumerate(features, start=1):
        area, odd = _polygons_of(drawn, number, name)
        notes += odd
        if area is None:
            continue
        area = _near_longitude_of(area, extent)
        if not area.intersects(extent):
            off.append((number, area))
            continue
        record = _record(drawn)
        notes += _odd_record(record, area, number)
        polygons.append(area)
        records.append(record)
    if not polygons and off:
        number, area = off[0]
        raise FireModelError(
            f"{name}: feature {number} (at {_place(area)}) lies outside the landscape (around "
            f"{_place(extent)}); send the perimeter of this fire"
        )
    if not polygons:
        raise FireModelError(f"{name}: contains no polygon; draw the perimeter as a polygon")
    if off:
        notes.append(f"{len(off)} features were ignored: they are outside the landscape")
    area = multipolygon(shapely.orient_polygons(shapely.union_all(polygons)))
    outside = 1.0 - area.intersection(extent).area / area.area
    if outside > SMALL_SHARE:
        notes.append(f"{100 * outside:.1f} % of the area lies outside the landscape")
    notes += _odd_times(records)
    vertices = int(shapely.get_num_coordinates(area))
    return Perimeter(area, area_m2(area) / 1e4, vertices, records, notes)


def _near_longitude_of(area: Any, extent: BaseGeometry) -> Any:
    """Return polygons, each part shifted by a multiple of 360 degrees to the landscape's side."""
    middle_deg, parts = extent.centroid.x, shapely.get_parts(area)
    turns = [round((middle_deg - part.centroid.x) / 360.0) for part in parts]
    if not any(turns):
        return area
    pairs = zip(parts, turns, strict=True)
    shifted = [translate(part, 360.0 * turn) if turn else part for part, turn in pairs]
    return multipolygon(shapely.union_all(shifted))


def area_m2(area: Any) -> float:
    """Return the area of polygons (longitude, latitude) on the ellipsoid, in square metres."""
    return abs(float(Geod(ellps="WGS84").geometry_area_perimeter(area)[0]))


def _place(area: BaseGeometry) -> str:
    (lon, lat) = area.representative_point().coords[0]
    return f"lat {lat:.4f}, lon {lon:.4f}"


def printable(file_name: str) -> str:
    """Return a file's name for use in messages, without its folders and control characters."""
    name = re.split(r"[/\\]", file_name)[-1]
    return "".join(c if c.isprintable() else "?" for c in name)[:80] or "upload"


def _polygons_of(drawn: Drawn, number: int, name: str) -> tuple[BaseGeometry | None, list[str]]:
    """Return a feature's valid polygons (None if it has none), and notes on irregularities."""
    shape, feature = drawn.shape, f"feature {number}"
    if shape.is_empty:
        return None, [f"{feature} was ignored: it has no polygon"]
    if not np.isfinite(shapely.get_coordinates(shape)).all() or shape.is_valid:
        refuse(shape_problems(Path(name), number, shape, WGS84))
        repaired = []
    else:
        reason = shapely.is_valid_reason(shape)
        if pairs_near([shape], max_repaired(shape)) > max_repaired(shape):
            raise FireModelError(f"{name}: {feature} is not valid ({reason}); draw it again")
        shape = shapely.make_valid(shape, method="structure", keep_collapsed=False)
        repaired = [f"{feature} was not valid and was repaired ({reason})"]
        if not shape.is_empty:
            refuse(shape_problems(Path(name), number, shape, WGS84))
    parts = shapely.get_parts(shapely.get_parts(shape))
    area = multipolygon(shapely.union_all([part for part in parts if part.area > 0.0]))
    if area.is_empty:
        return None, [f"{feature} was ignored: it is a {drawn.shape.geom_type} without area"]
    return area, repaired


def _record(drawn: Drawn) -> Record:
    found: Record = {}
    for key, names in FIELDS.items():
        value = attribute(drawn.attributes, names)
        if key.endswith("_unix_ms"):
            found[key] = _unix_ms(value)
        elif key == "gis_acres":
            found[key] = _number(value)
        else:
            text = None if value is None else str(value).strip()[:LONGEST_TEXT]
            found[key] = text or None
    return found


def _number(value: Any) -> float | None:
    try:
        found = float(value)
    except (TypeError, ValueError):
        return None
    return found if math.isfinite(found) else None


def _unix_ms(value: Any) -> int | None:
    """Return ms since 1970 UTC, from a number or text (ISO 8601, RFC 1123), or None."""
    if value is None or isinstance(value, bool):
        return None
    if isinstance(value, np.datetime64):
        found = None if np.isnat(value) else float(value.astype("datetime64[ms]").astype(np.int64))
    elif (found := _number(value)) is None:
        found = _parsed_ms(str(value).strip())
    return None if found is None or not EARLIEST_MS < found < LATEST_MS else round(found)


def _parsed_ms(text: str) -> float | None:
    for parse in (datetime.fromisoformat, parsedate_to_datetime):
        try:
            when = parse(text)
            when = when if when.tzinfo else when.replace(tzinfo=UTC)
            return when.timestamp() * 1000.0
        except (ValueError, TypeError, OverflowError, IndexError):
            continue
    return None


def _utc(unix_ms: int) -> str:
    return f"{np.datetime64(unix_ms, 'ms').astype('datetime64[m]')}Z"


def _odd_record(record: Record, area: BaseGeometry, number: int) -> list[str]:
    """Return notes on contradictions within one record."""
    notes = []
    drawn_ms, current_ms = record["polygon_unix_ms"], record["current_unix_ms"]
    if drawn_ms and current_ms and abs(drawn_ms - current_ms) > FAR_APART_MS:
        notes.append(
            f"feature {number}: the date of the polygon is {_utc(drawn_ms)}, the date of the last "
            f"change is {_utc(current_ms)}; the outline may be from either time"
        )
    acres = area_m2(area) / M2_PER_ACRE
    recorded = record["gis_acres"]
    if recorded is not None and abs(recorded - acres) > AREAS_DIFFER * max(acres, recorded):
        notes.append(
            f"feature {number}: the recorded area is {recorded:.1f} acres, the area of the outline "
            f"{acres:.1f}; one of them is older"
        )
    return notes


def _odd_times(records: list[Record]) -> list[str]:
    times = sorted(
        {record["polygon_unix_ms"] or record["created_unix_ms"] or 0 for record in records}
    )
    if len(times) < 2:
        return []
    first = _utc(times[0]) if times[0] else "unknown"
    return [f"the features have {len(times)} different times, {first} to {_utc(times[-1])}"]
