"""Perimeters from and for other programs, and malicious files."""

import io
import json
import struct
import tracemalloc
import zipfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely
from pyproj import Proj

from firemodel.errors import FireModelError
from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.rasters import read_landscape
from mission_service import uploaded_shapes
from mission_service.interfaces.maps.mercator import mercator_box, outline_of
from mission_service.interfaces.maps.perimeter_export import perimeter_geojson
from mission_service.interfaces.maps.perimeter_import import (
    LARGEST_BYTES,
    Perimeter,
    read_perimeter,
)
from mission_service.interfaces.maps.upload_worker import corrections_of
from tests.maps.fires import NOW_S, fire, land
from tests.maps.kml import perimeter_kml

MARIA = Path("/work/shared/data/maria_2019")
LON, LAT = -84.16, 36.35
TIME_ZERO = datetime(2026, 8, 1, 18, 0, tzinfo=UTC)
DRAWN_MS = 1_785_607_200_000 + round(NOW_S * 1000)  # TIME_ZERO and NOW_S
WRITTEN_MS = 1_785_620_000_000
SQUARE = [
    [LON, LAT],
    [LON + 0.005, LAT],
    [LON + 0.005, LAT + 0.004],
    [LON, LAT + 0.004],
    [LON, LAT],
]
HOLE = [[LON + 0.001, LAT + 0.001], [LON + 0.001, LAT + 0.002], [LON + 0.002, LAT + 0.002],
        [LON + 0.001, LAT + 0.001]]  # fmt: skip
AREA = shapely.Polygon(SQUARE, [HOLE])


def out(**changes: Any) -> dict[str, Any]:
    burning = fire()
    properties: dict[str, Any] = {"name": "Jacks <& Boro", "written_unix_ms": WRITTEN_MS, **changes}
    return perimeter_geojson(burning.expected_s(), land(), NOW_S, **properties)


def geojson(*geometries: Any, properties: dict[str, Any] | None = None, **more: Any) -> bytes:
    features = [
        {"type": "Feature", "properties": properties, "geometry": geometry}
        for geometry in geometries
    ]
    return json.dumps({"type": "FeatureCollection", "features": features, **more}).encode()


def polygon(*rings: Any) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": list(rings)}


def kml(body: str, head: str = "") -> bytes:
    text = f'<?xml version="1.0"?>{head}<kml xmlns="http://www.opengis.net/kml/2.2">{body}</kml>'
    return text.encode()


def zipped(**members: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name.replace("__", "."), data)
    return file.getvalue()


def shapefile(folder: Path, crs: str = "EPSG:4326", **fields: Any) -> dict[str, bytes]:
    """Return the parts of a Shapefile with one polygon, by suffix."""
    pyogrio.raw.write(
        folder / "a.shp",
        shapely.to_wkb(np.array([AREA])),
        [np.array([value], dtype=object) for value in fields.values()],
        list(fields),
        geometry_type="Polygon",
        crs=crs,
    )
    return {path.suffix: path.read_bytes() for path in folder.glob("a.*")}


def read(data: bytes, name: str = "upload") -> Perimeter:
    return read_perimeter(data, name, land())


def same(found: Perimeter, area: Any = AREA) -> bool:
    apart = found.area.symmetric_difference(area).area
    return bool(apart < 1e-5 * area.area)


def test_what_is_written_has_the_names_of_wfigs_and_is_honest() -> None:
    (feature,) = out(time_zero=TIME_ZERO)["features"]
    area = fire().front(NOW_S)
    properties = feature["properties"]
    assert properties["IncidentName"] == "Jacks <& Boro"
    assert properties["FeatureCategory"] == "Wildfire Daily Fire Perimeter"
    assert (properties["MapMethod"], properties["FeatureStatus"]) == ("Modeled", "Proposed")
    # The area on the ellipsoid; the map projection scales areas by this factor.
    lat, lon = land().centre_lat_lon
    projected = Proj(land().crs).get_factors(lon, lat).areal_scale
    assert properties["GISAcres"] == pytest.approx(area.area / projected / 4046.856, abs=0.01)
    assert properties["GISAcres"] != pytest.approx(area.area / 4046.856, abs=0.01)
    assert properties["PolygonDateTime"] == DRAWN_MS
    assert properties["CreateDate"] == properties["DateCurrent"] == WRITTEN_MS
    assert properties["IRWINID"] is None
    (unknown,) = out(prescribed=True)["features"]
    assert unknown["properties"]["PolygonDateTime"] is None
    assert unknown["properties"]["FeatureCategory"] == "Prescribed Fire"


@pytest.mark.parametrize("kind", ["geojson", "kml", "kmz"])
def test_what_is_written_reads_back(kind: str) -> None:
    written = out(time_zero=TIME_ZERO)
    data = json.dumps(written).encode()
    if kind != "geojson":
        data = perimeter_kml(written)
        data = data if kind == "kml" else zipped(doc__kml=data)
    found = read(data, f"mine.{kind}")
    area = shapely.geometry.shape(written["features"][0]["geometry"])
    assert same(found, area)
    # The area on the ground; in the grid it is larger by the scale.
    assert found.area_ha == pytest.approx(fire().front(NOW_S).area / 1e4, rel=2e-3)
    assert not found.notes
    (record,) = found.records
    assert record["incident_name"] == "Jacks <& Boro"
    assert record["polygon_unix_ms"] == DRAWN_MS
    assert (record["map_method"], record["feature_status"]) == ("Modeled", "Proposed")
    assert record["gis_acres"] == written["features"][0]["properties"]["GISAcres"]
    x_m, y_m = land().xy_of_lat_lon(*shapely.get_coordinates(found.area).T[::-1])
    distance_m = shapely.distance(shapely.points(x_m, y_m), fire().front(NOW_S).boundary)
    assert distance_m.max() < 0.02
    assert json.dumps(found.geojson())


def test_wfigs_with_an_old_time_on_a_new_outline() -> None:
    """Both times are reported; features elsewhere or without polygons are left out with a note."""
    properties = {
        "poly_IncidentName": "NEEDLES",
        "poly_MapMethod": "IR Image Interpretation",
        "poly_PolygonDateTime": 1_785_000_000_000,
        "poly_DateCurrent": 1_785_600_000_000,
        "poly_GISAcres": 1.5,
        "attr_UniqueFireIdentifier": "2026-TNTNF-000017",
    }
    off = polygon([[LON + 2, LAT], [LON + 2.1, LAT], [LON + 2, LAT + 0.1], [LON + 2, LAT]])
    line = {"type": "LineString", "coordinates": SQUARE[:2]}
    found = read(geojson(polygon(SQUARE, HOLE), off, line, None, properties=properties))
    assert same(found)
    (record,) = found.records
    assert record["incident_name"] == "NEEDLES"
    assert record["polygon_unix_ms"] == 1_785_000_000_000
    assert record["current_unix_ms"] == 1_785_600_000_000
    notes = "\n".join(found.notes)
    assert "is 2026-07-25T17:20Z, the date of the last change is 2026-08-01T16:00Z" in notes
    assert "the recorded area is 1.5 acres, the area of the outline 48." in notes
    assert "feature 3 was ignored: it is a LineString without area" in notes
    assert "feature 4 was ignored: it has no polygon" in notes
    assert "1 features were ignored: they are outside the landscape" in notes
    assert all(len(note.splitlines()) == 1 for note in found.notes)


@pytest.mark.parametrize("value", [
    1_785_000_000_000, "1785000000000", "2026-07-25T17:20:00Z", "2026-07-25T19:20:00+02:00",
    "Sat, 25 Jul 2026 17:20:00 GMT",
])  # fmt: skip
def test_times_are_read_as_they_come(value: Any) -> None:
    found = read(geojson(polygon(SQUARE), properties={"PolygonDateTime": value}))
    assert found.records[0]["polygon_unix_ms"] == 1_785_000_000_000


@pytest.mark.parametrize("value", ["yesterday", -1, 1e99, True, "", [1], {"a": 1}, "9" * 400])
def test_times_that_are_none_are_none(value: Any) -> None:
    found = read(geojson(polygon(SQUARE), properties={"PolygonDateTime": value}))
    assert found.records[0]["polygon_unix_ms"] is None


def test_a_bow_tie_is_repaired_and_reported() -> None:
    crossed = [SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3], SQUARE[0]]
    found = read(geojson(polygon(crossed)))
    assert found.area.is_valid
    assert found.area_ha > 1.0
    assert "feature 1 was not valid and was repaired (Self-intersection" in found.notes[0]


def test_older_geojson_with_a_crs() -> None:
    x_m, y_m = land().xy_of_lat_lon(*np.array(SQUARE).T[::-1])
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32616"}}
    ring = np.stack([x_m, y_m], axis=1).tolist()
    assert same(read(geojson(polygon(ring), crs=crs)), shapely.Polygon(SQUARE))
    crs["properties"] = {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}
    assert same(read(geojson(polygon(SQUARE), crs=crs)), shapely.Polygon(SQUARE))


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:4269"])
def test_zipped_shapefiles_with_names_cut_off(tmp_path: Path, crs: str) -> None:
    parts = shapefile(
        tmp_path, crs, poly_Incid="PINE", poly_Polyg="2026-07-25T17:20:00Z", poly_Featu="Wildfire"
    )
    data = zipped(**{f"../../folder/Pine{suffix}": data for suffix, data in parts.items()})
    found = read(data, "C:\\maps\\pine.zip")
    assert same(found)
    (record,) = found.records
    assert (record["incident_name"], record["feature_category"]) == ("PINE", "Wildfire")
    assert record["feature_status"] is None  # poly_Featu can stand for any of three names
    assert record["polygon_unix_ms"] == 1_785_000_000_000


def test_a_national_file_is_refused_with_what_to_do() -> None:
    with pytest.raises(FireModelError, match=r"us.json: has 8000001 bytes; .* send only this fire"):
        read(b" " * (LARGEST_BYTES + 1), "us.json")


def ring_of(count: int) -> list[list[float]]:
    turn = np.linspace(0.0, 2.0 * np.pi, count + 1)
    ring = np.stack([LON + 0.01 * np.cos(turn), LAT + 0.01 * np.sin(turn)], axis=1)
    ring[-1] = ring[0]
    return [[float(lon), float(lat)] for lon, lat in np.round(ring, 6)]


def comb(teeth: int) -> list[list[float]]:
    """Return a valid comb whose teeth all have the full length."""
    k = np.arange(teeth)[:, None]
    up, down = (np.hstack([LON + 1e-7 * k + at, LAT + 0 * k + 0.02 - at]) for at in (0.0, 0.02))
    ring = np.stack([up, down], axis=1).reshape(-1, 2)
    places = [[float(lon), float(lat)] for lon, lat in ring]
    return [*places, [LON + 0.03, LAT + 0.03], places[0]]


SCRIBBLE = np.random.default_rng(1).uniform([LON, LAT], [LON + 0.01, LAT + 0.01], (400, 2)).tolist()
SCRIBBLE.append(SCRIBBLE[0])
BILLION = '<!DOCTYPE k [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
OUTSIDE = '<!DOCTYPE k [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
PLACEMARK = "<Placemark><name>&x;</name></Placemark>"
BAD_RING = (
    "<Placemark><Polygon><outerBoundaryIs><coordinates>{}</coordinates></outerBoundaryIs></Polygon>"
    "</Placemark>"
)
VRT = (
    b'<OGRVRTDataSource><OGRVRTLayer name="x"><SrcDataSource>/etc/passwd</SrcDataSource>'
    b"</OGRVRTLayer></OGRVRTDataSource>"
)
SHP = struct.pack(">8i", 9994, 0, 0, 0, 0, 0, 50, 0)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            geojson(*[polygon(SQUARE)] * 31),
            "31 features; at most 30 are accepted: send only this fire",
        ),
        (geojson(polygon(ring_of(400))), "401 vertices; at most 400 are accepted"),
        (b"{" + b" " * 30_000, "30001 bytes; at most 30000 are accepted"),
    ],
)
def test_the_error_for_files_that_are_too_large_gives_a_remedy(
    data: bytes, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = {"LARGEST_BYTES": 30_000, "MAX_FEATURES": 30, "MAX_VERTICES": 400}
    for name, most in limits.items():
        assert getattr(uploaded_shapes, name) > 100 * most
        monkeypatch.setattr(uploaded_shapes, name, most)
    with pytest.raises(FireModelError, match=message):
        read(data)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is not GeoJSON, KML, KMZ or a zipped Shapefile"),
        (b"\x89PNG\r\n", "is not GeoJSON"),
        (b"{", r"is not JSON in UTF-8 \(Expecting"),
        (b"\xff\xfe{\x00}\x00", "is not GeoJSON"),
        (b"{}", "feature 1 is not a GeoJSON geometry"),
        (b'{"a":' + b"[" * 100_000, "is not JSON"),
        (b'{"type":"FeatureCollection","features":[]}', "has no features"),
        (b'{"type":"FeatureCollection","features":{}}', "its features are not a list"),
        (b'{"type":"FeatureCollection","features":[7]}', "feature 1 is not an object"),
        (geojson({"type": "Point", "coordinates": [LON, LAT]}), "contains no polygon"),
        (geojson({"type": "Polygon", "coordinates": [[1, 2]]}), "1 is not a GeoJSON geometry"),
        (geojson({"type": "Polygon", "coordinates": "x"}), "feature 1 is not a GeoJSON geometry"),
        (geojson(polygon([[LON, LAT], [LON, LAT]])), "feature 1"),
        (geojson(polygon(SQUARE)).replace(b"36.35", b"NaN"), "NaN is not a number"),
        (geojson(polygon(SQUARE)).replace(b"36.35", b"1e999"), "feature 1"),
        (geojson(polygon(SQUARE)).replace(b"36.35", b"9" * 5000), "is not JSON"),
        (geojson(polygon([[500.0, 4e6], [900.0, 4e6], [900.0, 5e6], [500.0, 4e6]])),
         "feature 1 reaches from .* not longitude and latitude"),
        (geojson(polygon([[10, 50], [11, 50], [11, 51], [10, 50]])), "lies outside the landscape"),
        (geojson(polygon(SQUARE), crs={"properties": {"name": "+proj=x +nadgrids=/etc/passwd"}}),
         "its crs member is invalid"),
        (geojson(polygon(SQUARE), crs={"properties": {"name": "EPSG:999999"}}), "is unknown"),
        (geojson(polygon(comb(2_000))), "its lines cross or overlap too often"),
        (geojson(polygon(SCRIBBLE)), "feature 1 is not valid .*; draw it again"),
        (VRT, r"is XML but not KML \(OGRVRTDataSource\)"),
        (b"<kml", "is not well-formed XML"),
        (b"<x:kml/>", "is not well-formed XML"),
        (kml(PLACEMARK, BILLION), "has a DOCTYPE"),
        (kml(PLACEMARK, OUTSIDE), "has a DOCTYPE"),
        (kml(PLACEMARK, OUTSIDE).decode().encode("utf-16"), "is not GeoJSON"),
        (kml(PLACEMARK), "is not well-formed XML"),
        (b'<?xml version="1.0" encoding="klingon"?><kml/>', "is not well-formed XML"),
        (kml("<Folder>" * 100_000), "has more than 64 nested elements"),
        (kml("<Document/>"), "has no features"),
        (kml("<Placemark/>"), "contains no polygon"),
        (kml(BAD_RING.format("1,2 3,4 5;6")), "placemark 1: '5;6' is not lon,lat"),
        (kml(BAD_RING.format("1,2")), "placemark 1 has an outline with 1 points"),
        (kml("<Placemark><Polygon/></Placemark>"), "1 has a polygon with 0 outer boundaries"),
        (b"PK\x03\x04" + b"\x00" * 40, "is not a complete ZIP archive"),
        (zipped(a__kml=kml("<Document/>"))[:-30], "is not a complete ZIP archive"),
        (zipped(a__txt=b"x"), "the archive contains 0 vector files"),
        (zipped(a__kml=b"<kml/>", b__kml=b"<kml/>"), "the archive contains 2 vector files"),
        (zipped(a__zip=zipped(a__kml=b"<kml/>")), "the archive contains 0 vector files"),
        (zipped(doc__kml=b" " * 33_000_000), "contains more than 32000000 bytes"),
        (zipped(**{f"a{n}__txt": b"" for n in range(1001)}), "1001 files in the archive"),
        (zipped(a__shp=SHP), "a.shx is missing"),
        (zipped(a__shp=SHP, a__shx=SHP), "a.prj is missing"),
        (zipped(a__shp=VRT, a__shx=VRT, a__prj=b"x"), "a.shp is not a Shapefile"),
        (zipped(a__shp=SHP + struct.pack("<17i", *[1] * 17), a__shx=SHP, a__prj=b""),
         "has shape type 1"),
        (zipped(a__shp=SHP + struct.pack("<17i", *[5] * 17), a__shx=SHP, a__prj=b"x"), "upload: "),
    ],
)  # fmt: skip
def test_malformed_and_hostile_files_are_one_line(data: bytes, message: str) -> None:
    with pytest.raises(FireModelError, match=message) as error:
        read(data)
    assert len(str(error.value).splitlines()) == 1
    assert len(str(error.value)) < 400


def test_a_bomb_is_not_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploaded_shapes, "MAX_UNPACKED_BYTES", 100_000)
    bomb, _ = zipped(doc__kml=b" " * 20_000_000), land()
    tracemalloc.start()
    try:
        with pytest.raises(FireModelError, match="contains more than 100000 bytes"):
            read(bomb)
        assert tracemalloc.get_traced_memory()[1] < 3_000_000
    finally:
        tracemalloc.stop()


def test_names_of_files_are_only_names() -> None:
    with pytest.raises(FireModelError, match=r"^evil\?\[31m\.kml: is not GeoJSON"):
        read(b"?", "../../x\\evil\x1b[31m.kml")
    with pytest.raises(FireModelError, match=r"^upload: is not GeoJSON"):
        read(b"?", "")


def error_text(data: bytes, name: str) -> str:
    """Return the error for a refused file; empty if the file is read."""
    try:
        read(data, name)
    except FireModelError as error:
        return str(error)
    return ""


def test_files_with_bytes_changed_are_read_or_refused(tmp_path: Path) -> None:
    """A changed file is read as a perimeter or refused with one clear line."""
    rng = np.random.default_rng(11)
    parts = shapefile(tmp_path, poly_Incid="PINE")
    whole = {
        "a.json": geojson(polygon(SQUARE, HOLE), properties={"name": "x"}),
        "a.kml": perimeter_kml(out(time_zero=TIME_ZERO)),
        "a.zip": zipped(**{f"a{suffix}": data for suffix, data in parts.items()}),
    }
    outcomes = []
    for name, data in whole.items():
        for _ in range(60):
            changed = bytearray(data)
            lowest, highest = (0, 256) if rng.random() < 0.4 else (ord("0"), ord("9") + 1)
            for place in rng.integers(0, len(data), rng.integers(1, 4)):
                changed[place] = rng.integers(lowest, highest)
            cut = changed[: rng.integers(1, len(data))] if rng.random() < 0.2 else changed
            outcomes.append(error_text(bytes(cut), name))
    assert all(len(each.splitlines()) <= 1 for each in outcomes)
    assert 10 < outcomes.count("") < len(outcomes) - 10


def test_shapefiles_with_parts_changed_are_read_or_refused(tmp_path: Path) -> None:
    """The parts inside the archive are changed; its checksums are valid."""
    rng = np.random.default_rng(12)
    parts = shapefile(tmp_path, poly_Incid="PINE", poly_Polyg="2026-07-25T17:20:00Z")
    outcomes = []
    for _ in range(80):
        suffix = str(rng.choice([".shp", ".shx", ".dbf", ".prj"]))
        changed = bytearray(parts[suffix])
        for place in rng.integers(0, len(changed), 3):
            changed[place] = rng.integers(0, 256)
        inside = {**parts, suffix: bytes(changed)}
        outcomes.append(
            error_text(zipped(**{f"a{end}": data for end, data in inside.items()}), "a.zip")
        )
    assert all(len(each.splitlines()) <= 1 for each in outcomes)
    assert 10 < outcomes.count("") < len(outcomes) - 10


@pytest.mark.skipif(not MARIA.is_dir(), reason="no shared data")
def test_the_perimeters_flown_at_the_maria_fire() -> None:
    names = {"fuel": MARIA / "Maria2019-fuel.tif", "elevation": MARIA / "Maria2019-elevation.tif"}
    there = read_landscape(names, missing="unburnable")
    parts = {f"x{path.suffix}": path.read_bytes() for path in MARIA.glob("firis_perimeters.*")}
    found = read_perimeter(zipped(**parts), "firis.zip", there)
    assert len(found.records) == 22
    assert {record["source"] for record in found.records} == {"FIRISMaria", "vnc manual"}
    assert found.records[0]["created_unix_ms"] == 1_572_575_831_000  # 2019-11-01T02:37 UTC
    assert 3800.0 < found.area_ha < 4400.0  # 9,999 acres in the records of the fire
    assert any("21 different times" in note for note in found.notes)


def across_180() -> Landscape:
    """Return a landscape from longitude 179.95 to -179.97."""
    return flat_landscape(300, 300, 30.0, -16.8, 179.99)


def _square(west_deg: float, east_deg: float) -> dict[str, Any]:
    return polygon(
        [
            [west_deg, -16.81],
            [east_deg, -16.81],
            [east_deg, -16.80],
            [west_deg, -16.80],
            [west_deg, -16.81],
        ]
    )


def test_a_perimeter_across_the_antimeridian_is_one_area() -> None:
    assert mercator_box(across_180())[2] - mercator_box(across_180())[0] < 20_000.0
    halves = [_square(179.99, 180.0)["coordinates"], _square(-180.0, -179.995)["coordinates"]]
    data = geojson({"type": "MultiPolygon", "coordinates": halves})
    found = read_perimeter(data, "p.geojson", across_180())
    assert found.notes == []
    assert found.area.bounds == pytest.approx((179.99, -16.81, 180.005, -16.80))
    assert len(found.area.geoms) == 1
    (request,) = corrections_of(found, shapely.Polygon(outline_of(across_180())))
    lons_deg = {round(lon_deg, 6) for _, lon_deg in request["points"]}
    assert {179.99, -179.995} <= lons_deg
    assert all(-180.0 <= each <= 180.0 for each in lons_deg)


@pytest.mark.parametrize("west_deg", [179.97, -179.99])
def test_a_perimeter_on_either_side_of_the_antimeridian_is_on_the_landscape(
    west_deg: float,
) -> None:
    data = geojson(_square(west_deg, west_deg + 0.005))
    assert read_perimeter(data, "p.geojson", across_180()).notes == []
    with pytest.raises(FireModelError, match="lies outside the landscape"):
        read_perimeter(geojson(_square(20.0, 20.1)), "p.geojson", across_180())
