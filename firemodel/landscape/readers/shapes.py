"""Read points, lines and polygons from vector files into a landscape's CRS."""

import math
import warnings
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape, crs_label, same_crs
from firemodel.landscape.readers.bands import check_file, refuse
from firemodel.landscape.readers.formats import OFFLINE, check_shapes
from firemodel.landscape.readers.repairs import area_ha, repaired

Record = dict[str, Any]


def read_shapes(
    path: Path,
    landscape: Landscape,
    *,
    crs: str | None = None,
    repair: bool = False,
    feature: int | None = None,
) -> list[BaseGeometry]:
    """Read the geometries of a file's features into the landscape's CRS, without z.

    The file is GeoJSON, KML, KMZ, GeoPackage or a Shapefile (zipped or not). Coordinates in GeoJSON
    are longitude and latitude (RFC 7946), unless the file has a ``crs`` member, as older files do.

    Args:
        path: The file.
        landscape: The landscape. The geometries are projected to its CRS, and each geometry must
            touch its grid.
        crs: The CRS of a file that has none.
        repair: True to convert closed lines and invalid polygons to valid polygons (``repairs``).
        feature: The number of the feature to read, from 1; by default all features are read.

    Returns:
        A shapely geometry for each feature, in file order.

    Raises:
        FireModelError: The CRS is missing or unknown, there are no features, or a feature is empty,
            invalid or off the landscape. The message names the file and the feature (from 1).
    """
    shapes, found = features_of(path)
    refuse(crs_problems(path, found, crs))
    if not shapes:
        raise FireModelError(f"{path}: has no features; use a file with at least one")
    their_crs = str(found or crs)
    moved = []
    for number, read in _selected(path, shapes, feature):
        shape = repaired(read) if repair else read
        refuse(shape_problems(path, number, shape, their_crs))
        moved.append(into_crs(shape, their_crs, landscape.crs))
        refuse(place_problems(path, number, moved[-1], landscape))
    return moved


def _selected(
    path: Path, shapes: list[BaseGeometry], feature: int | None
) -> list[tuple[int, BaseGeometry]]:
    """Return the number and geometry of one or all features. Raises FireModelError if missing."""
    found = [
        (number, shape) for number, shape in enumerate(shapes, start=1) if feature in (None, number)
    ]
    if not found:
        raise FireModelError(
            f"{path}: has no feature {feature}; its features are 1 to {len(shapes)}"
        )
    return found


def repairs_of(path: Path, feature: int | None = None) -> list[str]:
    """Return a line of text for each feature that ``read_shapes`` changes if ``repair`` is True.

    The line contains the areas before and after the repair in hectares. ``feature`` has the same
    meaning as in ``read_shapes``. Raises FireModelError if the file cannot be read as shapes.
    """
    shapes, crs = features_of(path)
    lines = []
    for number, shape in _selected(path, shapes, feature):
        found = repaired(shape)
        if found is not shape:
            lines.append(repair_note(path, number, shape, found, crs))
    return lines


def repair_note(
    path: Path, number: int, shape: BaseGeometry, found: BaseGeometry, crs: str | None
) -> str:
    """Return a line about the repair of a feature's ``shape`` to ``found``, both in ``crs``.

    The line contains both areas in hectares if the CRS is known.
    """
    both = (into_crs(one, crs, "EPSG:4326") for one in (shape, found)) if crs else ()
    areas = " before, ".join(f"{area_ha(one):.2f} ha" for one in both)
    reason = "closed line" if shape.is_valid else shapely.is_valid_reason(shape)
    return f"{path}: feature {number} ({reason}) was repaired" + (areas and f": {areas} after")


def features_of(path: Path) -> tuple[list[BaseGeometry], str | None]:
    """Read the unchanged geometries in all layers of a file, and the file's CRS.

    A feature without geometry yields an empty geometry. Raises FireModelError if the file cannot be
    read as shapes.
    """
    shapes, crs, _ = records_of(path, columns=[])
    return shapes, crs


def records_of(
    path: Path, data: bytes | None = None, **options: Any
) -> tuple[list[BaseGeometry], str | None, list[Record]]:
    """Read the unchanged geometries, the CRS and the attributes of all layers of a file.

    Layers without geometry are left out.

    Args:
        path: The file, or its name in messages if ``data`` is given.
        data: A zipped Shapefile in memory, which is read without the file checks.
        options: Options of ``pyogrio.raw.read``.

    Returns:
        The geometries (empty for a feature without geometry), the CRS, and a record of attributes
        for each feature. Dates and times are ISO 8601 text.

    Raises:
        FireModelError: The file cannot be read as shapes.
    """
    if data is None:
        _check_source(path)
    layers = _layers(path, path if data is None else data, **options)
    used = [layer for layer in layers if layer[2] is not None]
    if layers and not used:
        raise FireModelError(f"{path}: contains a table without geometries; add geometries")
    names = {meta["crs"] for meta, *_ in used}
    if len(names) > 1:
        raise FireModelError(
            f"{path}: its layers have different CRSs; write each layer to a separate file"
        )
    shapes: list[BaseGeometry] = []
    records: list[Record] = []
    for meta, _, geometries, columns in used:
        for wkb in geometries:
            shapes.append(_from_wkb(path, len(shapes) + 1, wkb))
        fields = [str(field) for field in meta["fields"]]
        rows = zip(*columns, strict=True) if columns else ((),) * len(geometries)
        records += [dict(zip(fields, values, strict=True)) for values in rows]
    return shapes, next(iter(names), None), records


def _check_source(path: Path) -> None:
    check_file(path)
    if path.suffix.lower() == ".shp" and not _has_companion(path, ".shx"):
        raise FireModelError(
            f"{path}: the .shx file of the Shapefile is missing; copy all its files (.shp, .shx, "
            ".dbf, .prj) into one folder"
        )
    check_shapes(path)


def _layers(path: Path, source: Path | bytes, **options: Any) -> list[Any]:
    """Return pyogrio's data of each layer: metadata, ids, WKB of each feature, columns."""
    import pyogrio
    from pyogrio.errors import CRSError as LayerCRSError
    from pyogrio.errors import DataLayerError, DataSourceError, FeatureError, GeometryError

    pyogrio.set_gdal_config_options(OFFLINE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # invalid dates, geometries
            names = [name for name, _ in pyogrio.list_layers(source)]
            return [_raw(source, layer=name, **options) for name in names]
    except (
        DataSourceError,
        DataLayerError,
        FeatureError,
        GeometryError,
        LayerCRSError,
        ValueError,
        LookupError,  # pyogrio 0.13 raises these two exceptions for some damaged files
        NameError,
    ) as error:
        raise FireModelError(f"{path}: cannot be read as shapes ({_first_line(error)})") from None


def _raw(source: Path | bytes, **options: Any) -> Any:
    """Return the result of ``pyogrio.raw.read``, also for a .dbf with invalid UTF-8.

    Field names in a Shapefile are truncated to ten bytes, possibly in the middle of a UTF-8
    character. In this case the text is read as Latin-1, in which every byte is a character.
    """
    import pyogrio

    options |= {"force_2d": True, "datetime_as_string": True}
    try:
        return pyogrio.raw.read(source, **options)
    except UnicodeDecodeError:
        return pyogrio.raw.read(source, ENCODING="ISO-8859-1", **options)


def _from_wkb(path: Path, number: int, wkb: bytes | None) -> BaseGeometry:
    try:
        return shapely.Point() if wkb is None else shapely.from_wkb(wkb)
    except shapely.errors.ShapelyError as error:
        raise FireModelError(
            f"{path}: feature {number} is not a geometry ({error}); draw it again"
        ) from None


def _first_line(error: Exception) -> str:
    """Return the text of an error without pyogrio's advice on drivers."""
    return " ".join(str(error).split(".;")[0].split())


def _has_companion(path: Path, suffix: str) -> bool:
    return any(path.with_suffix(end).is_file() for end in (suffix, suffix.upper()))


def crs_problems(path: Path, found: str | None, given: str | None) -> Iterator[str]:
    """Yield the problems of a file's CRS, or of the CRS given for it, one line each."""
    if found is None and given is None:
        yield f"{no_crs(path)}, or specify it as `crs`"
        return
    for name in (found, given):
        try:
            CRS.from_user_input(name or "EPSG:4326")
        except CRSError as error:
            yield f"{path}: CRS {name!r} is invalid: {error}"
            return
    if found and given and not same_crs(found, given):
        yield (
            f"{path}: CRS {crs_label(found)} differs from {crs_label(given)}, specified as `crs`; "
            "omit `crs`, or correct the CRS in the file"
        )


def no_crs(path: Path) -> str:
    """Return the text of the error for a file without a CRS."""
    lost = "has no .prj file" if path.suffix.lower() == ".shp" else "has no CRS"
    return f"{path}: {lost}; add its projection"


def shape_problems(path: Path, number: int, shape: BaseGeometry, crs: str | None) -> Iterator[str]:
    """Yield the problems of a feature's geometry, except those of its position, one line each."""
    where = f"{path}: feature {number}"
    if shape.is_empty:
        yield f"{where} is empty; delete it, or draw it again"
        return
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        yield f"{where} has a coordinate that is not a number; draw it again"
        return
    if not shape.is_valid:
        reason = shapely.is_valid_reason(shape)
        yield (
            f"{where} is not a valid {shape.geom_type} ({reason}); repair it, for example with "
            "QGIS (a perimeter also with fire.repair_perimeter = true)"
        )
    west, south, east, north = shape.bounds
    if (
        crs is not None
        and CRS.from_user_input(crs).is_geographic
        and (max(-west, east) > 360.0 or max(-south, north) > 90.0)
    ):
        yield (
            f"{where} reaches from ({west:g}, {south:g}) to ({east:g}, {north:g}), which are not "
            "longitude and latitude in degrees; reproject the file, or swap its axes"
        )


def place_problems(
    path: Path, number: int, shape: BaseGeometry, landscape: Landscape
) -> Iterator[str]:
    """Yield a problem if a geometry in the landscape's CRS does not touch the landscape."""
    if not all(map(math.isfinite, shape.bounds)):
        yield (
            f"{path}: feature {number} is too far away to be projected onto the landscape; "
            "remove it"
        )
    elif not shape.intersects(box_of(landscape)):
        x_m, y_m = shape.representative_point().coords[0]
        lat, lon = landscape.lat_lon_of(x_m, y_m)
        mid_lat, mid_lon = landscape.centre_lat_lon
        yield (
            f"{path}: feature {number} (at lat {lat:.4f}, lon {lon:.4f}) lies outside the "
            f"landscape (around lat {mid_lat:.4f}, lon {mid_lon:.4f}); remove it, or use a larger "
            "landscape"
        )


def box_of(landscape: Landscape) -> BaseGeometry:
    """Return the landscape's outline in its CRS."""
    rows, cols = landscape.shape
    west_m, north_m, cell_m = landscape.west_m, landscape.north_m, landscape.cell_size_m
    return shapely.box(west_m, north_m - rows * cell_m, west_m + cols * cell_m, north_m)


def into_crs(shape: BaseGeometry, crs: str, to_crs: str) -> BaseGeometry:
    """Transform the vertices of a geometry to another CRS; x is easting or longitude in both."""
    transformer = _transformer(crs, to_crs)

    def moved(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack(transformer.transform(*xy.T), axis=1)

    found: BaseGeometry = shapely.transform(shape, moved)
    return found


@lru_cache(maxsize=8)
def _transformer(crs: str, to_crs: str) -> Any:
    return Transformer.from_crs(CRS.from_user_input(crs).to_2d(), to_crs, always_xy=True)
