"""Write the vector layers of an incident as GeoPackage and as zipped Shapefile.

Equal incidents give equal files: the dates that GDAL writes into files are those of the incident.
"""

import errno
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from firemodel.outputs.whole_file import whole_file
from mission_service.products.features import Feature

CRS = "EPSG:4326"
DATES = ("CreateDate", "DateCurrent", "PolygonDateTime", "DateTime")
GPKG_VERSION = "1.2"  # GDAL before 3.7 warns of newer versions
GDAL_UTC = 100  # GDAL's code of the time zone UTC
EARLIEST_ZIP = (1980, 1, 1, 0, 0, 0)
# Names of at most ten characters, as in the Shapefiles that the agencies publish.
SHORT = {
    "IncidentName": "IncidentNa",
    "FeatureCategory": "FeatureCat",
    "DateCurrent": "DateCurren",
    "PolygonDateTime": "PolygonDat",
    "FeatureAccess": "FeatureAcc",
    "FeatureStatus": "FeatureSta",
}


def write_geopackage(path: Path, layers: dict[str, list[Feature]], written: datetime) -> None:
    """Write layers of features (WGS84), each to a table with its name; times are UTC.

    ``written`` is the date of modification in the file's table of contents.
    """
    with whole_file(path) as part, _dated(written):
        for number, (name, features) in enumerate(layers.items()):
            _write(part, name, features, "GPKG", append=number > 0)


def write_shapefile(path: Path, layer: str, features: Sequence[Feature], written: datetime) -> None:
    """Write a layer as a zipped Shapefile with .prj and .cpg; field names up to 10 characters."""
    renamed = [{**each, "properties": _short(each["properties"])} for each in features]
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / f"{layer}.shp"
        _write(
            target, layer, renamed, "ESRI Shapefile", ENCODING="UTF-8",
            DBF_DATE_LAST_UPDATE=f"{written:%Y-%m-%d}",
        )  # fmt: skip
        files = sorted(Path(folder).iterdir())
        write_zip(path, {each.name: each.read_bytes() for each in files}, written)


def write_zip(path: Path, contents: dict[str, bytes], written: datetime) -> None:
    """Write a zip archive; all files have the date ``written``."""
    date = max(EARLIEST_ZIP, written.timetuple()[:6])
    with whole_file(path) as part, ZipFile(part, "w") as archive:
        for name, data in contents.items():
            info = ZipInfo(name, (*date[:5], date[5]))
            info.compress_type, info.external_attr = ZIP_DEFLATED, 0o644 << 16
            archive.writestr(info, data)


def _short(properties: dict[str, Any]) -> dict[str, Any]:
    """Return attributes with Shapefile field names; dates with times become text."""
    found = {}
    for name, value in properties.items():
        bare = name.removeprefix("poly_")
        if bare in DATES and value is not None:
            value = str(_date(value)) + "Z"
        found[SHORT.get(bare, bare)] = value
    return found


def _write(
    path: Path,
    layer: str,
    features: Sequence[Feature],
    driver: str,
    append: bool = False,
    **options: str,
) -> None:
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError, FeatureError
    from shapely import to_wkb
    from shapely.geometry import shape

    geometry = np.array([to_wkb(shape(each["geometry"])) for each in features], dtype=object)
    names = list(features[0]["properties"])
    columns = [_column(name, [each["properties"][name] for each in features]) for name in names]
    try:
        pyogrio.raw.write(
            path,
            geometry,
            columns,
            names,
            field_mask=[_missing(each) for each in columns],
            layer=layer,
            driver=driver,
            geometry_type=features[0]["geometry"]["type"],
            crs=CRS,
            append=append,
            dataset_options=None if append or driver != "GPKG" else {"VERSION": GPKG_VERSION},
            layer_options=options,
            gdal_tz_offsets={
                name: np.full(len(features), GDAL_UTC)
                for name, column in zip(names, columns, strict=True)
                if column.dtype.kind == "M"
            },
        )
    except (DataSourceError, DataLayerError, FeatureError) as error:
        raise OSError(errno.EIO, " ".join(str(error).split()), str(path)) from None


def _column(name: str, values: list[Any]) -> NDArray[Any]:
    bare = name.removeprefix("poly_")
    if bare in DATES and not isinstance(values[0], str):
        return np.array([_date(value) for value in values], dtype="datetime64[ms]")
    if any(isinstance(value, float) for value in values):
        return np.array(values, dtype=np.float64)
    return np.array(values, dtype=object)


def _missing(column: NDArray[Any]) -> NDArray[np.bool_] | None:
    if column.dtype != object:
        return None
    return np.array([value is None for value in column])


def _date(unix_ms: int) -> np.datetime64:
    return np.datetime64(unix_ms, "ms")


@contextmanager
def _dated(written: datetime) -> Iterator[None]:
    """Set the date that GDAL writes into GeoPackages."""
    import pyogrio

    name = "OGR_CURRENT_DATE"
    pyogrio.set_gdal_config_options({name: f"{written:%Y-%m-%dT%H:%M:%S.000Z}"})
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options({name: None})
