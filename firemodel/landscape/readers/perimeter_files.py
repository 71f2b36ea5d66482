"""Read mapped fire perimeters and their times from vector files."""

from collections.abc import Iterator
from datetime import UTC, date, datetime, time, tzinfo
from pathlib import Path
from typing import Any, NamedTuple

import shapely
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.bands import refuse
from firemodel.landscape.readers.feature_times import is_firis, time_column, time_in
from firemodel.landscape.readers.repairs import repaired
from firemodel.landscape.readers.shapes import (
    Record,
    crs_problems,
    into_crs,
    no_crs,
    place_problems,
    records_of,
    repair_note,
    shape_problems,
)

SUFFIXES = (".geojson", ".json", ".shp", ".zip", ".kml", ".kmz", ".gpkg")
KINDS = "GeoJSON, KML, KMZ, GeoPackage or Shapefile"
AREAS = ("Polygon", "MultiPolygon")
LEFT_OUT = "; the feature is left out"
FIRIS_KIND, FIRIS_PERIMETER = "type", "perim"  # field with a feature's kind; value for a perimeter


class Perimeter(NamedTuple):
    """A mapped burned area and its time."""

    at: datetime  # with a UTC offset
    area: BaseGeometry  # Polygon or MultiPolygon in the landscape's CRS, valid
    source: str  # file and time, for messages


class Mapped(NamedTuple):
    """The area of one feature, and its time or only its date."""

    at: datetime | date
    area: BaseGeometry
    file: Path
    number: int  # feature number, from 1


def read_perimeters(
    path: Path, landscape: Landscape, zone: tzinfo = UTC
) -> tuple[list[Perimeter], list[str]]:
    """Read the perimeters of a fire at several times from a file, or from the files in a folder.

    The files are GeoJSON, KML, KMZ, GeoPackages or Shapefiles (zipped or not). Each feature's date
    and time are in one of the fields of ``feature_times``. A date without a time of day counts as
    00:00 if the dates of all features differ. Closed lines and invalid polygons are repaired.

    Args:
        path: The file or the folder. Subfolders, and files of other kinds in the folder, are
            ignored.
        landscape: The landscape. The perimeters are projected to its CRS, and each perimeter must
            touch its grid.
        zone: The time zone of dates and of times without a UTC offset.

    Returns:
        The perimeters in order of time; features with the same time are merged. In addition, a line
        of text for each feature that was left out or repaired, and for dates without a time of day.

    Raises:
        FireModelError: A file cannot be read, or has no CRS or time field; no feature can be used;
            or features of the same date have no time of day. The message is one line.
    """
    warnings: list[str] = []
    found: list[Mapped] = []
    for file in _files(path):
        found += _features_in(file, landscape, zone, warnings)
    if not found:
        reason = warnings[0].removesuffix(LEFT_OUT).removeprefix(f"{path}: ")
        raise FireModelError(
            f"{path}: contains no usable perimeter ({reason}); use polygons of burned areas with "
            "their times"
        )
    return _united(_with_times(path, found, zone, warnings)), warnings


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    try:
        files = sorted(path.iterdir())
    except OSError as error:
        raise FireModelError(f"{path}: cannot be read: {error.strerror}") from None
    found = [
        file
        for file in files
        if file.suffix.lower() in SUFFIXES and not file.name.startswith(".") and file.is_file()
    ]
    if not found:
        raise FireModelError(f"{path}: contains no perimeter file; add a {KINDS}")
    return found


def _features_in(
    path: Path, landscape: Landscape, zone: tzinfo, warnings: list[str]
) -> Iterator[Mapped]:
    """Yield the usable features of a file; append a line to ``warnings`` for each other feature."""
    shapes, crs, records = records_of(path)
    if not shapes:
        warnings.append(f"{path}: has no features")
        return
    if crs is None:
        raise FireModelError(no_crs(path))
    refuse(crs_problems(path, crs, None))
    column = time_column(records)
    if column is None:
        fields = list(dict.fromkeys(key for record in records for key in record))
        raise FireModelError(
            f"{path}: no field contains the times of the perimeters (fields: "
            f"{', '.join(fields[:12]) or 'none'}); add PolygonDateTime, for example "
            "2019-10-31T19:37:11Z, to each feature"
        )
    for number, (shape, value) in enumerate(zip(shapes, column.values, strict=True), start=1):
        try:
            if is_firis(column):
                _check_firis(path, number, records[number - 1])
            at = _time(path, number, column.field, value, zone)
            area, notes = _area(path, number, shape, crs, landscape)
        except FireModelError as error:
            warnings.append(f"{str(error).rpartition('; ')[0]}{LEFT_OUT}")
            continue
        warnings += notes
        yield Mapped(at, area, path, number)


def _check_firis(path: Path, number: int, record: Record) -> None:
    """Raise FireModelError for a feature that is not the perimeter of one flight."""
    kinds = [str(value or "") for key, value in record.items() if key.lower() == FIRIS_KIND]
    if kinds and kinds[0].strip().lower() != FIRIS_PERIMETER:
        raise FireModelError(
            f"{path}: feature {number} has the type {kinds[0][:40]!r}, not {FIRIS_PERIMETER!r}; "
            "correct it"
        )


def _time(path: Path, number: int, field: str, value: Any, zone: tzinfo) -> datetime | date:
    if value is None:
        raise FireModelError(f"{path}: feature {number} has no time in {field}; add it")
    try:
        return time_in(value, zone)
    except ValueError as error:
        raise FireModelError(
            f"{path}: feature {number} has no time in {field}: {error}; correct it"
        ) from None


def _area(
    path: Path, number: int, shape: BaseGeometry, crs: str, landscape: Landscape
) -> tuple[BaseGeometry, list[str]]:
    """Return a feature's area in the landscape's CRS, and lines of text about changes to the area.

    Raises FireModelError if the feature has no area on the landscape.
    """
    drawn, notes = shape, []
    if shape.geom_type == "GeometryCollection" and not shape.is_empty:
        parts = shapely.get_parts(shapely.get_parts(shape))
        drawn = shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon"])
        notes = [f"{path}: feature {number} is a collection; only its polygons are used"]
    area = repaired(drawn)
    refuse(shape_problems(path, number, area, crs))
    if area.geom_type not in AREAS:
        raise FireModelError(f"{path}: feature {number} is a {area.geom_type}; draw a polygon")
    if area is not drawn:
        notes.append(repair_note(path, number, drawn, area, crs))
    moved = repaired(into_crs(area, crs, landscape.crs))
    refuse(place_problems(path, number, moved, landscape))
    return moved, notes


def _with_times(
    path: Path, found: list[Mapped], zone: tzinfo, warnings: list[str]
) -> list[tuple[datetime, Mapped]]:
    """Return each feature with its time, which is 00:00 for a feature with only a date.

    Raises FireModelError if two features have the same date and one of them has no time of day.
    """
    dates = [each for each in found if not isinstance(each.at, datetime)]
    if dates:
        days = {_day(each.at, zone) for each in found}
        if len(days) < len(found):
            first = dates[0]
            raise FireModelError(
                f"{first.file}: feature {first.number} has a date ({first.at}) without a time of "
                "day, and the dates of the features do not all differ; specify the date and time "
                "of each feature"
            )
        warnings.append(
            f"{path}: {len(dates)} of {len(found)} perimeters have a date without a time of day; "
            f"00:00 ({zone}) is used"
        )
    return [(_moment(each.at, zone), each) for each in found]


def _day(at: datetime | date, zone: tzinfo) -> date:
    return at.astimezone(zone).date() if isinstance(at, datetime) else at


def _moment(at: datetime | date, zone: tzinfo) -> datetime:
    if isinstance(at, datetime):
        return at
    return datetime.combine(at, time(), zone).astimezone(UTC)


def _united(found: list[tuple[datetime, Mapped]]) -> list[Perimeter]:
    """Return a perimeter for each time, in order of time."""
    by_time: dict[datetime, list[Mapped]] = {}
    for at, each in sorted(found, key=lambda pair: pair[0]):
        by_time.setdefault(at, []).append(each)
    return [
        Perimeter(at, shapely.union_all([each.area for each in group]), _source(at, group))
        for at, group in by_time.items()
    ]


def _source(at: datetime, group: list[Mapped]) -> str:
    files = ", ".join(dict.fromkeys(str(each.file) for each in group))
    return f"{files} at {at:%Y-%m-%d %H:%M:%S} UTC"
