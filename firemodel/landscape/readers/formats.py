"""Detect a file's format from its contents before GDAL opens the file.

GDAL also detects formats from contents. Files of some formats (VRT, OGR-VRT, GDALG, web services)
contain file names and URLs, which GDAL opens regardless of the file's extension. Therefore only the
few formats that this module checks are accepted.
"""

import json
import struct
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from pyproj import CRS
from pyproj.exceptions import CRSError

from firemodel.errors import FireModelError

TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
GRID = (b"ncols", b"nrows", b"xllcorner", b"yllcorner", b"xllcenter", b"yllcenter", b"cellsize")
IMAGINE = b"EHFA_HEADER_TAG"
GRIDDED = {"netCDF": (b"CDF\x01", b"CDF\x02", b"CDF\x05", b"\x89HDF\r\n"), "GRIB": (b"GRIB",)}
LCP_FLAGS = (20, 21)  # an .lcp file begins with two of these numbers
SHAPEFILE = struct.pack(">i", 9994)
SQLITE = b"SQLite format 3\x00"
GEOPACKAGE = (b"GP10", b"GP11", b"GPKG")  # application ids in the database header
GEOJSON = (
    *("FeatureCollection", "Feature", "GeometryCollection", "Point", "MultiPoint", "LineString"),
    *("MultiLineString", "Polygon", "MultiPolygon"),
)
# The files that a zipped Shapefile or a KMZ may contain, including files that GIS programs add.
IN_ARCHIVES = (
    *(".shp", ".shx", ".dbf", ".prj", ".cpg", ".sbn", ".sbx", ".qix", ".qpj", ".qmd", ".shp.xml"),
    *(".txt", ".kml", ".png", ".jpg", ".jpeg", ".gif"),
)
OFFLINE = {  # GDAL's options against network access, in case an accepted file contains an address
    "CPL_VSIL_CURL_ALLOWED_EXTENSIONS": "{none}",
    "CPL_CURL_ENABLE_VSIMEM": "NO",
    "GDAL_HTTP_MAX_RETRY": "0",
    "GDAL_HTTP_PROXY": "127.0.0.1:1",
    # Views in a GeoPackage cannot call GDAL's functions that open files and addresses.
    "OGR_SQLITE_PRAGMA": "trusted_schema=OFF",
}


def raster_driver(path: Path) -> str:
    """Return the GDAL driver for a raster. Raises FireModelError if the format is not accepted."""
    start = _start(path)
    if start.startswith(TIFF):
        return "GTiff"
    if start.lstrip().lower().startswith(GRID):
        return "AAIGrid"
    if start.startswith(IMAGINE):
        return "HFA"
    if len(start) >= 8 and all(flag in LCP_FLAGS for flag in struct.unpack("<2i", start[:8])):
        return "LCP"
    raise FireModelError(
        f"{path}: cannot be read as a raster (it is not a GeoTIFF, .lcp, .asc grid or .img); "
        "convert "
        "it to GeoTIFF"
    )


def wind_driver(path: Path) -> str:
    """Return the GDAL driver for a wind raster, which may also be a NetCDF or GRIB file.

    Raises FireModelError if the format is not accepted, or if this GDAL build has no driver for it.
    """
    start = _start(path)
    found = next((driver for driver, magic in GRIDDED.items() if start.startswith(magic)), None)
    if found is None:
        return raster_driver(path)
    import rasterio

    with rasterio.Env() as env:
        if found not in env.drivers():
            raise FireModelError(
                f"{path}: is a {found} file, for which the installed GDAL has no driver; convert "
                "it to GeoTIFF"
            )
    return found


def check_shapes(path: Path) -> None:
    """Raise FireModelError unless a file is in one of the formats for shapes.

    The formats are GeoJSON, KML, KMZ, GeoPackage and Shapefile (zipped or not).
    """
    start = _start(path).removeprefix(b"\xef\xbb\xbf").lstrip()
    if start.startswith(b"{"):
        _check_geojson(path)
    elif start.startswith(b"<"):
        with path.open("rb") as file:
            _check_kml(path, file, path.name)
    elif start.startswith(b"PK"):
        _check_archive(path)
    elif start.startswith(SQLITE):
        _check_geopackage(path, start)
    elif not start.startswith(SHAPEFILE):
        raise FireModelError(
            f"{path}: cannot be read as shapes (it is not a GeoJSON, KML, KMZ, GeoPackage or "
            "Shapefile); export it in one of these formats"
        )


def _start(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(256)
    except OSError as error:
        raise FireModelError(f"{path}: cannot be read: {error.strerror}") from None


def _check_geojson(path: Path) -> None:
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FireModelError(f"{path}: is not JSON in UTF-8 ({error}); export it again") from None
    if content.get("type") not in GEOJSON:
        kind = str(content.get("type"))[:40]
        raise FireModelError(
            f"{path}: is JSON, but not GeoJSON (type {kind}); export it as GeoJSON"
        )
    for part in (content, *_objects(content.get("features"))):
        crs = part.get("crs")
        if isinstance(crs, dict) and crs.get("type") not in ("name", "EPSG", None):
            raise _crs_error(path, crs)
    if "crs" in content:  # with an invalid crs, GDAL would assume longitude and latitude
        try:
            CRS.from_user_input(content["crs"]["properties"]["name"])
        except (TypeError, KeyError, CRSError):
            raise _crs_error(path, content["crs"]) from None


def _crs_error(path: Path, crs: Any) -> FireModelError:
    return FireModelError(
        f"{path}: its crs member is not supported ({json.dumps(crs)[:80]}); write the file in "
        "longitude and latitude, without that member (RFC 7946)"
    )


def _objects(features: Any) -> list[dict[str, Any]]:
    return (
        [each for each in features if isinstance(each, dict)] if isinstance(features, list) else []
    )


def _check_kml(path: Path, file: Any, name: str) -> None:
    try:
        _, root = next(ElementTree.iterparse(file, events=("start",)))
    except (ElementTree.ParseError, StopIteration, ValueError, LookupError) as error:
        raise FireModelError(
            f"{path}: cannot be read as shapes ({name} is not well-formed XML: {error})"
        ) from None
    kind = str(root.tag).rsplit("}", 1)[-1]
    if kind != "kml":
        raise FireModelError(
            f"{path}: cannot be read as shapes ({name} is XML, but not KML: {kind[:40]}); export "
            "it "
            "as KML"
        )


def _check_geopackage(path: Path, start: bytes) -> None:
    """Reject SQLite databases that are not GeoPackages; GDAL checks the same application ids."""
    if start[68:72] not in GEOPACKAGE:
        raise FireModelError(
            f"{path}: cannot be read as shapes (it is an SQLite database, but not a GeoPackage); "
            "export it as GeoPackage"
        )


def _check_archive(path: Path) -> None:
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if not name.endswith("/")]
            for name in names:
                if not name.lower().endswith(IN_ARCHIVES):
                    raise FireModelError(
                        f"{path}: contains {name[:60]!r}, which is not part of a Shapefile or KMZ; "
                        "zip only the files of one"
                    )
                if name.lower().endswith(".kml"):
                    with archive.open(name) as file:
                        _check_kml(path, file, name[:60])
            if not any(name.lower().endswith((".shp", ".kml")) for name in names):
                raise FireModelError(
                    f"{path}: contains no Shapefile or KML; add one to the archive"
                )
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, OSError) as error:
        raise FireModelError(
            f"{path}: is not a complete ZIP archive ({error}); create it again"
        ) from None
