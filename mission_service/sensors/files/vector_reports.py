"""Convert the features of a vector file to reports: burned areas, and burning lines and points.

The time of a feature is in one of the fields of ``feature_times`` (WFIGS, GeoMAC, FIRIS, KML), or
in the name of the file. The fields are defined in the NWCG standard "Wildland Fire Event"
(FeatureCategory, MapMethod) and in the layers of WFIGS, GeoMAC and FIRIS.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, tzinfo
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import parts_of
from firemodel.landscape.readers.agency_fields import attribute
from firemodel.landscape.readers.bands import refuse
from firemodel.landscape.readers.feature_times import time_column, time_in
from firemodel.landscape.readers.repairs import repaired
from firemodel.landscape.readers.shapes import (
    box_of,
    crs_problems,
    into_crs,
    no_crs,
    records_of,
    shape_problems,
)
from mission_service.events import Place
from mission_service.sensors.files.file_contents import FileContents, FileReport, FileSettings
from mission_service.sensors.files.file_names import time_in_name
from mission_service.sensors.files.satellite_pixels import (
    PixelGroup,
    groups_of,
    is_satellite,
    pixel_of,
)
from mission_service.sensors.one_line import one_line

MAX_FEATURES, MAX_VERTICES = 5000, 200_000  # per file
MAX_REPORTS = 100
MAX_POINTS = 1000  # per report of points
MAX_CORNERS = 5000  # per polygon or line
SHIFT_CELLS = 0.1  # largest deviation of a simplified outline
MAX_SOURCE = 80  # characters
CATEGORY = ("FeatureCategory", "type")
SOURCE = (
    ("Source",),
    ("agency",),
    ("IncidentName", "incident_name", "fireName", "name"),
    ("mission",),
)
# Words in the categories of features that show where fire is or was. Other categories are, for
# example, control lines, closures and the origin of a fire.
OF_FIRE = ("perim", "heat", "burn", "hot", "spot fire", "fire edge", "front", "wildfire")
MODELED = "modeled"
# Assumed standard deviations in metres, by the first words of MapMethod.
POSITION_SD_M = {"hand sketch": 100.0, "digitized": 50.0, "gps-flight": 30.0, "gps": 10.0}
STATES = ("burned", "burning", "unburned", "smoke")
STATE_OF = {"Polygon": "burned", "LineString": "burning", "Point": "burning"}


class _Feature(NamedTuple):
    """A feature that shows fire; its parts are clipped to the landscape and in its CRS."""

    parts: Sequence[BaseGeometry]
    seen: datetime
    state: str
    position_sd_m: float
    source: str


def vector_contents(path: Path, landscape: Landscape, settings: FileSettings) -> FileContents:
    """Return the reports in a GeoJSON, KML, KMZ, GeoPackage or Shapefile.

    Raises FireModelError or MissionServiceError for a file without a usable feature; the one-line
    text names the file and the feature.
    """
    shapes, crs, records = records_of(path)
    _check_size(path, shapes)
    if crs is None:
        raise FireModelError(no_crs(path))
    refuse(crs_problems(path, crs, None))
    lower = [{key.lower(): value for key, value in record.items()} for record in records]
    if all(map(is_satellite, lower)):
        pixels = [
            pixel_of(values, f"{path}: feature {number}")
            for number, values in enumerate(lower, start=1)
        ]
        return pixel_contents(path, groups_on(pixels, landscape))
    found, notes = [], []
    zone = settings.zone
    for number, (shape, at) in enumerate(
        zip(shapes, _times(path, records, zone), strict=True), start=1
    ):
        try:
            record = records[number - 1]
            found.append(_feature(path, number, shape, crs, record, at, landscape, settings))
        except FireModelError as error:
            notes.append(str(error))
    reports = sorted(_reports(found, landscape), key=lambda each: each.seen_unix_s)
    if not reports:
        raise FireModelError(notes[0])
    if len(reports) > MAX_REPORTS:
        raise FireModelError(
            f"{path}: has {len(reports)} separate areas and lines; the maximum is {MAX_REPORTS}: "
            "send only this fire, simplified"
        )
    return FileContents("shapes", tuple(reports), tuple(notes))


def groups_on(pixels: Sequence[Any], landscape: Landscape) -> list[PixelGroup]:
    """Return the groups of the pixels whose centre is on the landscape."""
    inside = [
        each
        for each in pixels
        if landscape.contains(*landscape.xy_of_lat_lon(each.lat_deg, each.lon_deg))
    ]
    return list(groups_of(inside))


def pixel_contents(path: Path, groups: Sequence[PixelGroup]) -> FileContents:
    """Return the reports of satellite pixels. Raises FireModelError if there are none."""
    if not groups:
        raise FireModelError(f"{path}: no pixel lies on the landscape")
    reports = [
        FileReport(
            "burning",
            "points",
            tuple(each.points),
            each.seen.timestamp(),
            each.position_sd_m,
            each.source,
            each.false_alarms_pct / 100.0,
        )
        for each in groups
    ]
    return FileContents("satellite pixels", tuple(reports))


def _check_size(path: Path, shapes: Sequence[BaseGeometry]) -> None:
    if not shapes:
        raise FireModelError(f"{path}: has no features; send a file with at least one")
    vertices = sum(int(shapely.get_num_coordinates(shape)) for shape in shapes)
    for count, most, what in (
        (len(shapes), MAX_FEATURES, "features"),
        (vertices, MAX_VERTICES, "vertices"),
    ):
        if count > most:
            raise FireModelError(
                f"{path}: {count} {what}; the maximum is {most}: send only this fire, simplified"
            )


def _times(path: Path, records: Sequence[Mapping[str, Any]], zone: tzinfo) -> list[Any]:
    """Return each feature's time, or a text with the reason why it has no time."""
    named = time_in_name(path.name, zone)
    column = time_column([dict(record) for record in records])
    if column is None:
        missing = "has no time; add PolygonDateTime, for example 2026-07-04T19:37:11Z"
        return [named or missing] * len(records)
    found: list[Any] = []
    for value in column.values:
        try:
            at = named if value is None else time_in(value, zone)
        except ValueError as error:
            found.append(f"has no time in {column.field}: {error}")
            continue
        if at is None:
            found.append(f"has no time in {column.field}; add it")
        elif isinstance(at, datetime):
            found.append(at)
        else:
            found.append(named or f"has a date ({at}) without a time of day; add the time")
    return found


def _feature(
    path: Path,
    number: int,
    shape: BaseGeometry,
    crs: str,
    record: Mapping[str, Any],
    at: datetime | str,
    landscape: Landscape,
    settings: FileSettings,
) -> _Feature:
    """Return a feature. Raises FireModelError, whose text names a feature that is not used."""
    where = f"{path}: feature {number}"
    category = str(attribute(record, CATEGORY) or "")[:40]
    if category and not any(word in category.lower() for word in OF_FIRE):
        raise FireModelError(f"{where} is a {category!r}, which does not show the fire")
    method = str(attribute(record, ("MapMethod",)) or "").strip()
    if MODELED in method.lower():
        raise FireModelError(f"{where} was modeled, not observed (MapMethod)")
    if isinstance(at, str):
        raise FireModelError(f"{where} {at}")
    drawn = repaired(shape) if "Polygon" in shape.geom_type else shape
    refuse(shape_problems(path, number, drawn, crs))
    moved = into_crs(drawn, crs, landscape.crs)
    if not np.isfinite(shapely.get_coordinates(moved)).all():
        raise FireModelError(f"{where} is too far away to be projected onto the landscape")
    parts = list(parts_of([repaired(moved).intersection(box_of(landscape))])) if moved else []
    if not parts:
        raise FireModelError(f"{where} lies outside the landscape")
    state = str(attribute(record, ("state",)) or "").lower()
    return _Feature(
        parts,
        at,
        state if state in STATES else "",
        _position_sd_m(record, method, settings),
        _source(path, record, method),
    )


def _position_sd_m(record: Mapping[str, Any], method: str, settings: FileSettings) -> float:
    """Return the standard deviation that the feature states, or else that of its map method."""
    try:
        stated_m = float(attribute(record, ("position_sd_m",)))
        if math.isfinite(stated_m) and 0.0 <= stated_m <= 10_000.0:
            return stated_m
    except (TypeError, ValueError):
        pass
    assumed = (sd_m for name, sd_m in POSITION_SD_M.items() if method.lower().startswith(name))
    return next(assumed, settings.position_sd_m)


def _source(path: Path, record: Mapping[str, Any], method: str) -> str:
    """Return the agency, incident, mission and method of a feature, or else the file's name."""
    words = [str(attribute(record, names) or "").strip() for names in SOURCE]
    text = ", ".join(dict.fromkeys(word for word in (*words, method) if word)) or path.name
    return one_line(text)[:MAX_SOURCE]


def _reports(features: Sequence[_Feature], landscape: Landscape) -> Iterator[FileReport]:
    """Yield a report for each polygon and line, and one for all points with equal attributes."""
    points: dict[tuple[Any, ...], list[Place]] = {}
    for each in features:
        attributes = (each.seen.timestamp(), each.position_sd_m, each.source)
        for part in each.parts:
            state: Any = each.state or STATE_OF[part.geom_type]
            if part.geom_type == "Polygon" and part.area < landscape.cell_size_m**2:
                part = part.representative_point()
            if part.geom_type == "Point":
                points.setdefault((state, attributes), []).extend(_places(part, landscape))
            elif part.geom_type == "LineString":
                line = _simplified(part, landscape)
                yield FileReport(state, "line", _places(line, landscape), *attributes)
            else:
                area = _simplified(part, landscape)
                islands = tuple(_places(ring, landscape)[:-1] for ring in area.interiors)
                corners = _places(area.exterior, landscape)[:-1]
                yield FileReport(state, "polygon", corners, *attributes, islands=islands)
    for (state, attributes), places in points.items():
        for first in range(0, len(places), MAX_POINTS):
            some = tuple(places[first : first + MAX_POINTS])
            yield FileReport(state, "points", some, *attributes)


def _simplified(part: BaseGeometry, landscape: Landscape) -> Any:
    found = part.simplify(SHIFT_CELLS * landscape.cell_size_m)
    count = int(shapely.get_num_coordinates(found))
    if count > MAX_CORNERS:
        raise FireModelError(f"an outline has {count} corners; the maximum is {MAX_CORNERS}")
    return found


def _places(part: Any, landscape: Landscape) -> tuple[Place, ...]:
    x_m, y_m = shapely.get_coordinates(part).T
    lat, lon = landscape.lat_lon_of(x_m, y_m)
    return tuple((round(float(a), 7), round(float(b), 7)) for a, b in zip(lat, lon, strict=True))
