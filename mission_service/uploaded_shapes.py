"""Reads shapes and their attributes from the bytes of an uploaded, untrusted file.

This module parses GeoJSON and KML without GDAL, because GDAL would also follow references to other
files. Only a few members of an archive are read, and their paths are ignored.
"""

import io
import json
import re
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.parsers import expat

import shapely
from pyproj.exceptions import ProjError
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape.readers.shapes import into_crs, records_of

LARGEST_BYTES = 8_000_000  # of an upload
MAX_UNPACKED_BYTES = 32_000_000
MAX_MEMBERS = 1000  # files in an archive
MAX_FEATURES = 5000
MAX_VERTICES = 200_000
DEEPEST = 64  # limit of nested elements in KML
WGS84 = "EPSG:4326"
# Names, in the crs member of older GeoJSON, of WGS84 and of NAD83, which differs by up to 2 m.
LON_LAT = re.compile(r"(urn:ogc:def:crs:OGC:.*:CRS84|(urn:ogc:def:crs:)?EPSG:+(4326|4269))$")
EPSG = re.compile(r"(?:urn:ogc:def:crs:)?EPSG:+(\d{4,6})$")
SHAPEFILE, POLYGONS = 9994, (5, 15, 25)  # first number of a .shp; shape types that are polygons
SHAPEFILE_PARTS = (".shp", ".shx", ".dbf", ".prj", ".cpg")


class Drawn(NamedTuple):
    """One feature; its shape is in longitude and latitude."""

    shape: BaseGeometry
    attributes: dict[str, Any]


def features_in(data: bytes, name: str) -> list[Drawn]:
    """Return all features in a GeoJSON, KML, KMZ or zipped Shapefile, whose format is detected.

    The shapes may be empty, invalid or not polygons. ``name`` is for messages. Raises
    FireModelError with one line for a file that is too large or cannot be read.
    """
    if len(data) > LARGEST_BYTES:
        raise FireModelError(
            f"{name}: has {len(data)} bytes; at most {LARGEST_BYTES} are accepted: send only this "
            "fire, or fewer vertices"
        )
    start = data.removeprefix(b"\xef\xbb\xbf").lstrip()[:4]
    if start.startswith(b"PK"):
        found = _from_archive(_unpacked(data, name), name)
    elif start.startswith(b"{"):
        found = _from_geojson(data, name)
    elif start.startswith(b"<"):
        found = _from_kml(data, name)
    else:
        raise FireModelError(
            f"{name}: is not GeoJSON, KML, KMZ or a zipped Shapefile; export it in one of these "
            "formats"
        )
    if not found:
        raise FireModelError(f"{name}: has no features; send a file with at least one polygon")
    _check_count(len(found), MAX_FEATURES, "features", name)
    count = sum(int(shapely.get_num_coordinates(drawn.shape)) for drawn in found)
    _check_count(count, MAX_VERTICES, "vertices", name)
    return found


def _check_count(count: int, most: int, what: str, name: str) -> None:
    if count > most:
        raise FireModelError(
            f"{name}: has {count} {what}; at most {most} are accepted: send only this fire, "
            "simplified"
        )


def _unpacked(data: bytes, name: str) -> dict[str, bytes]:
    """Return the usable members of an archive, by file name in lower case (without folders)."""
    found: dict[str, bytes] = {}
    left, suffixes = MAX_UNPACKED_BYTES, (*SHAPEFILE_PARTS, ".kml", ".geojson", ".json")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            _check_count(len(archive.infolist()), MAX_MEMBERS, "files in the archive", name)
            for member in archive.infolist():
                inside = member.filename.replace("\\", "/").rsplit("/", 1)[-1].lower()
                # Files with metadata from macOS.
                if not inside.endswith(suffixes) or inside.startswith("._"):
                    continue
                if member.flag_bits & 1 or member.compress_type not in (0, zipfile.ZIP_DEFLATED):
                    raise FireModelError(
                        f"{name}: {inside} is encrypted or uses an unsupported compression; use a "
                        "plain ZIP"
                    )
                # Sizes stated in an archive may be false: limit the bytes that are read.
                with archive.open(member) as file:
                    found.setdefault(inside, file.read(left + 1))
                left -= len(found[inside])
                if left < 0:
                    raise FireModelError(
                        f"{name}: contains more than {MAX_UNPACKED_BYTES} bytes; send only this "
                        "fire"
                    )
    except (
        zipfile.BadZipFile,
        NotImplementedError,
        RuntimeError,
        zlib.error,
        EOFError,
        OSError,
        ValueError,
        struct.error,
    ) as error:
        raise FireModelError(
            f"{name}: is not a complete ZIP archive ({_one_line(error)}); send it again"
        ) from None
    return found


def _from_archive(members: dict[str, bytes], name: str) -> list[Drawn]:
    shp = [inside for inside in members if inside.endswith(".shp")]
    others = sorted(inside for inside in members if not inside.endswith(SHAPEFILE_PARTS))
    if "doc.kml" in others:
        others = ["doc.kml"]  # the root of a KMZ
    if len(shp) + len(others) != 1:
        raise FireModelError(
            f"{name}: the archive contains {len(shp) + len(others)} vector files; zip exactly one "
            "Shapefile (.shp, .shx, .dbf, .prj), KML or GeoJSON"
        )
    if others:
        inside = others[0]
        read = _from_kml if inside.endswith(".kml") else _from_geojson
        return read(members[inside], f"{name}: {inside}")
    return _from_shapefile(members, shp[0].removesuffix(".shp"), name)


def _from_shapefile(members: dict[str, bytes], stem: str, name: str) -> list[Drawn]:
    for suffix in (".shx", ".prj"):
        if stem + suffix not in members:
            raise FireModelError(
                f"{name}: {stem}{suffix} is missing; zip all files of the Shapefile (.shp, .shx, "
                ".dbf, .prj)"
            )
    shp = members[stem + ".shp"]
    for suffix in (".shp", ".shx"):
        if members[stem + suffix][:4] != struct.pack(">i", SHAPEFILE) or len(shp) < 100:
            raise FireModelError(f"{name}: {stem}{suffix} is not a Shapefile; export it again")
    if (kind := struct.unpack("<i", shp[32:36])[0]) not in POLYGONS:
        raise FireModelError(
            f"{name}: {stem}.shp has shape type {kind}; send the perimeter as polygons"
        )
    # The members are zipped again with fixed names, so that GDAL reads only these files.
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for suffix in SHAPEFILE_PARTS:
            if stem + suffix in members:
                archive.writestr(f"perimeter{suffix}", members[stem + suffix])
    shapes, crs, records = records_of(Path(name), packed.getvalue())
    if crs is None:
        raise FireModelError(f"{name}: {stem}.prj contains an unknown CRS; export it in WGS84")
    return [
        Drawn(_in_wgs84(shape, crs, name), record)
        for shape, record in zip(shapes, records, strict=True)
    ]


def _from_geojson(data: bytes, name: str) -> list[Drawn]:
    try:
        content = json.loads(data.decode("utf-8-sig"), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise FireModelError(
            f"{name}: is not JSON in UTF-8 ({_one_line(error)}); export it again"
        ) from None
    if not isinstance(content, dict):
        raise FireModelError(f"{name}: is JSON but not GeoJSON; export it as GeoJSON")
    crs = _crs_of(content, name)
    is_collection = content.get("type") == "FeatureCollection"
    features = content.get("features", []) if is_collection else [content]
    if not isinstance(features, list):
        raise FireModelError(f"{name}: its features are not a list; export it as GeoJSON")
    found = []
    for number, feature in enumerate(features, start=1):
        if not isinstance(feature, dict):
            raise FireModelError(f"{name}: feature {number} is not an object; export it as GeoJSON")
        is_feature = feature.get("type") == "Feature"
        geometry = feature.get("geometry") if is_feature else feature
        attributes = feature.get("properties") if is_feature else None
        shape = _geometry(geometry, f"{name}: feature {number}")
        shape = shape if crs is None else _in_wgs84(shape, crs, name)
        found.append(Drawn(shape, attributes if isinstance(attributes, dict) else {}))
    return found


def _no_constant(text: str) -> float:
    raise ValueError(f"{text} is not a number")


def _geometry(geometry: Any, feature: str) -> BaseGeometry:
    if geometry is None:
        return shapely.Point()
    try:
        return shapely.force_2d(shapely.from_geojson(json.dumps(geometry)))
    except (shapely.errors.ShapelyError, ValueError, TypeError, RecursionError) as error:
        raise FireModelError(
            f"{feature} is not a GeoJSON geometry ({_one_line(error)}); export it again"
        ) from None


def _crs_of(content: dict[str, Any], name: str) -> str | None:
    """Return the CRS in the crs member of older GeoJSON; None for longitude and latitude."""
    member = content.get("crs")
    if member is None:
        return None
    properties = member.get("properties") if isinstance(member, dict) else None
    crs = properties.get("name") if isinstance(properties, dict) else None
    if isinstance(crs, str) and LON_LAT.match(crs):
        return None
    if not (isinstance(crs, str) and (code := EPSG.match(crs))):
        raise FireModelError(
            f"{name}: its crs member is invalid ({json.dumps(member)[:80]}); export it in "
            "longitude and latitude (RFC 7946)"
        )
    return f"EPSG:{code[1]}"


def _in_wgs84(shape: BaseGeometry, crs: str, name: str) -> BaseGeometry:
    try:
        return into_crs(shape, crs, WGS84)
    except ProjError as error:
        raise FireModelError(
            f"{name}: CRS {crs[:40]} is unknown ({_one_line(error)}); export it in WGS84"
        ) from None


def _from_kml(data: bytes, name: str) -> list[Drawn]:
    _check_xml(data, name)
    root = ElementTree.fromstring(data)
    if _local(root) != "kml":
        raise FireModelError(f"{name}: is XML but not KML ({_local(root)[:40]}); export it as KML")
    return [
        Drawn(_kml_shape(placemark, f"{name}: placemark {number}"), _kml_attributes(placemark))
        for number, placemark in enumerate(_all(root, "Placemark"), start=1)
    ]


def _check_xml(data: bytes, name: str) -> None:
    """Refuse XML entity attacks (all of which need a document type) and deep nesting."""
    depth = 0

    def begins(_name: str, _attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise FireModelError(
                f"{name}: has more than {DEEPEST} nested elements; export it as KML"
            )

    def ends(_name: str) -> None:
        nonlocal depth
        depth -= 1

    def has_type(*_: Any) -> None:
        raise FireModelError(f"{name}: has a DOCTYPE, which KML does not allow; export it again")

    parser = expat.ParserCreate(namespace_separator="}")
    parser.StartElementHandler, parser.EndElementHandler = begins, ends
    parser.StartDoctypeDeclHandler = has_type
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise FireModelError(
            f"{name}: is not well-formed XML ({_one_line(error)}); export it again"
        ) from None


def _local(element: Any) -> str:
    return str(element.tag).rsplit("}", 1)[-1]


def _all(element: Any, tag: str) -> list[Any]:
    """Return all descendants with a tag, in any KML namespace."""
    return [below for below in element.iter() if _local(below) == tag]


def _kml_shape(placemark: Any, where: str) -> BaseGeometry:
    """Return the polygons of a placemark; if there are none, its lines and points.

    Points next to polygons are label positions. The shape may be an empty MultiPolygon.
    """
    polygons = []
    for polygon in _all(placemark, "Polygon"):
        outer = _rings(polygon, "outerBoundaryIs", where)
        if len(outer) != 1:
            raise FireModelError(
                f"{where} has a polygon with {len(outer)} outer boundaries; draw it again"
            )
        polygons.append(shapely.Polygon(outer[0], _rings(polygon, "innerBoundaryIs", where)))
    if polygons:
        return shapely.MultiPolygon(polygons)
    others: list[BaseGeometry] = []
    for tag, kind, least in (("LineString", shapely.LineString, 2), ("Point", shapely.Point, 1)):
        for element in _all(placemark, tag):
            places = [
                each for below in _all(element, "coordinates") for each in _places(below, where)
            ]
            if len(places) < least:
                raise FireModelError(
                    f"{where} has a {tag} with {len(places)} points; draw it again"
                )
            others.append(kind(places if least > 1 else places[0]))
    return shapely.GeometryCollection(others) if others else shapely.MultiPolygon()


def _rings(polygon: Any, side: str, where: str) -> list[list[tuple[float, float]]]:
    edges = _all(polygon, side)
    return [_ring(ring, where) for edge in edges for ring in _all(edge, "coordinates")]


def _ring(coordinates: Any, where: str) -> list[tuple[float, float]]:
    found = _places(coordinates, where)
    if len(found) < 3:
        raise FireModelError(f"{where} has an outline with {len(found)} points; draw it again")
    return found


def _places(coordinates: Any, where: str) -> list[tuple[float, float]]:
    """Return the positions (longitude, latitude) in a ``coordinates`` element."""
    found = []
    for text in (coordinates.text or "").split():
        parts = text.split(",")
        try:
            found.append((float(parts[0]), float(parts[1])))
        except (ValueError, IndexError):
            raise FireModelError(
                f"{where}: {text[:40]!r} is not lon,lat; export it again"
            ) from None
    return found


def _kml_attributes(placemark: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for child in placemark.iter():
        tag, text = _local(child), (child.text or "").strip()
        if tag in ("name", "when", "begin", "end"):
            found.setdefault(tag, text)
        elif tag == "SimpleData":
            found[str(child.get("name"))] = text
        elif tag == "Data":
            values = _all(child, "value")
            found[str(child.get("name"))] = (values[0].text or "").strip() if values else ""
    return found


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
