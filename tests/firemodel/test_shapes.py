"""Points, lines and polygons are placed on the landscape, or refused with a clear error."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely
from shapely.geometry import LineString, Point, Polygon, mapping
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape.info import describe
from firemodel.landscape.rasterise import cells_of
from firemodel.landscape.readers.rasters import read_landscape
from firemodel.landscape.readers.shapes import read_shapes, records_of, repairs_of
from tests.firemodel.grids import CRS, NORTH_M, WEST_M, landscape

DATA = Path("/work/shared/data")
LAND = landscape()  # 41 x 41 cells of 30 m
X_M, Y_M = LAND.xy_of(20, 20)
LAT, LON = LAND.lat_lon_of(X_M, Y_M)


def geojson(path: Path, *geometries: Any, **members: Any) -> Path:
    features = [
        {"type": "Feature", "properties": {}, "geometry": geometry} for geometry in geometries
    ]
    content = {"type": "FeatureCollection", "features": features, **members}
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def named(crs: str) -> dict[str, Any]:
    return {"type": "name", "properties": {"name": crs}}


def shapefile(path: Path, *geometries: BaseGeometry, crs: str | None = CRS) -> Path:
    pyogrio.raw.write(
        path,
        np.array([shapely.to_wkb(geometry) for geometry in geometries], dtype=object),
        field_data=[np.arange(len(geometries))],
        fields=["number"],
        geometry_type=geometries[0].geom_type,
        crs=crs,
        driver="ESRI Shapefile",
    )
    return path


AREA = Polygon([(X_M, Y_M), (X_M + 100, Y_M), (X_M + 50, Y_M + 80)])


def same(area: BaseGeometry) -> bool:
    return bool(area.normalize().equals_exact(AREA.normalize(), 1e-3))


def test_geojson_comes_from_longitude_and_latitude(tmp_path: Path) -> None:
    """The file has all kinds of geometries; one has a height, which is dropped."""
    line = {"type": "LineString", "coordinates": [[LON, LAT, 300.0], [LON + 0.001, LAT, 310.0]]}
    path = geojson(tmp_path / "a.geojson", mapping(Point(LON, LAT)), line)
    point, drawn = read_shapes(path, LAND)
    assert point.coords[0] == pytest.approx((X_M, Y_M), abs=1e-3)
    assert drawn.geom_type == "LineString"
    assert not drawn.has_z
    assert drawn.length == pytest.approx(90.0, abs=1.0)


def test_geojson_of_older_kind_keeps_its_crs(tmp_path: Path) -> None:
    path = geojson(tmp_path / "a.json", mapping(AREA), crs=named("urn:ogc:def:crs:EPSG::32616"))
    (area,) = read_shapes(path, LAND)
    assert same(area)
    path = geojson(
        tmp_path / "b.json", mapping(Point(LON, LAT)), crs=named("urn:ogc:def:crs:OGC:1.3:CRS84")
    )
    assert read_shapes(path, LAND)[0].coords[0] == pytest.approx((X_M, Y_M), abs=1e-3)
    for crs in (named("EPSG:999999"), None, {"type": "link", "properties": {"href": "x"}}):
        path = geojson(tmp_path / "c.json", mapping(Point(LON, LAT)), crs=crs)
        with pytest.raises(FireModelError, match=r"c.json: its crs member is not supported \("):
            read_shapes(path, LAND)


def test_kml_of_several_folders_zipped_or_not(tmp_path: Path) -> None:
    where = f"{LON},{LAT - 0.001},0"
    folders = "".join(
        f"<Folder><name>{name}</name><Placemark>{shape}</Placemark></Folder>"
        for name, shape in (
            ("ignition", f"<Point><coordinates>{where}</coordinates></Point>"),
            (
                "road",
                f"<LineString><coordinates>{where} {LON},{LAT}</coordinates></LineString>",
            ),
        )
    )
    text = f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{folders}</Document></kml>'
    (tmp_path / "a.kml").write_text(text)
    with zipfile.ZipFile(tmp_path / "a.kmz", "w") as archive:
        archive.writestr("doc.kml", text)
    for name in ("a.kml", "a.kmz"):
        point, road = read_shapes(tmp_path / name, LAND)
        assert (point.geom_type, road.geom_type) == ("Point", "LineString")
        assert describe(tmp_path / name)["kind"] == "shapes"
        assert road.coords[0] == point.coords[0] != road.coords[1]
        assert road.coords[1] == pytest.approx((X_M, Y_M), abs=1e-3)


def test_shapefiles_whole_and_in_parts(tmp_path: Path) -> None:
    path = shapefile(tmp_path / "a.shp", AREA)
    assert same(read_shapes(path, LAND)[0])
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for file in tmp_path.glob("a.*"):
            if file.suffix != ".zip":
                archive.write(file, file.name)
    assert same(read_shapes(tmp_path / "a.zip", LAND)[0])
    with pytest.raises(
        FireModelError, match=r"a.shp: CRS EPSG:32616 differs from EPSG:32617, specified"
    ):
        read_shapes(path, LAND, crs="EPSG:32617")
    (tmp_path / "a.prj").unlink()
    with pytest.raises(FireModelError, match=r"a.shp: has no .prj file; .* or specify it as `crs`"):
        read_shapes(path, LAND)
    assert same(read_shapes(path, LAND, crs=CRS)[0])
    with pytest.raises(FireModelError, match=r"a.shp: CRS 'nowhere' is invalid"):
        read_shapes(path, LAND, crs="nowhere")
    (tmp_path / "a.shx").unlink()
    with pytest.raises(FireModelError, match=r"a.shp: the .shx file of the Shapefile is missing"):
        read_shapes(path, LAND, crs=CRS)


BOW_TIE = Polygon([(LON, LAT), (LON + 0.002, LAT + 0.002), (LON + 0.002, LAT), (LON, LAT + 0.002)])
POINT = mapping(Point(LON, LAT))


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        (None, "feature 2 is empty; delete it, or draw it"),
        ({"type": "Polygon", "coordinates": []}, "feature 2 is empty"),
        (mapping(BOW_TIE), r"feature 2 is not a valid Polygon \(Self-intersection"),
        ({"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}, "feature 2 is not a geometry"),
        (mapping(Point(X_M, Y_M)), "feature 2 reaches from .* not longitude and latitude"),
        (mapping(Point(LAT, LON)), r"feature 2 \(at lat -8.* lies outside .*lat 36.1392"),
        (
            mapping(Point(LON + 1, LAT)),
            r"feature 2 .* lies outside the landscape \(around .*; remove",
        ),
        (mapping(Point(LON + 90, -LAT)), r"feature 2 .* (lies outside|too far away)"),
    ],
)
def test_features_that_cannot_be_used_are_refused(
    tmp_path: Path, geometry: Any, message: str
) -> None:
    path = geojson(tmp_path / "bad.geojson", POINT, geometry)
    with pytest.raises(FireModelError, match=rf"bad.geojson: {message}") as caught:
        read_shapes(path, LAND)
    assert "\n" not in str(caught.value)


def test_files_that_are_no_shapes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FireModelError, match=r"a.geojson: no such file"):
        read_shapes(tmp_path / "a.geojson", LAND)
    with pytest.raises(FireModelError, match=r"a.geojson: has no features"):
        read_shapes(geojson(tmp_path / "a.geojson"), LAND)
    (tmp_path / "b.geojson").write_text("{")
    with pytest.raises(FireModelError, match=r"b.geojson: is not JSON in UTF-8") as caught:
        read_shapes(tmp_path / "b.geojson", LAND)
    assert "\n" not in str(caught.value)
    broken = shapefile(tmp_path / "c.shp", AREA, AREA)
    broken.write_bytes(broken.read_bytes()[:250])
    with pytest.raises(FireModelError, match=r"c.shp: (cannot be read as shapes|feature 2)"):
        read_shapes(broken, LAND)
    path = geojson(tmp_path / "d.geojson", POINT)
    path.write_bytes(path.read_bytes().replace(b'"properties": {}', b'"properties": {"a": "\xe9"}'))
    with pytest.raises(FireModelError, match=r"d.geojson: is not JSON in UTF-8"):
        read_shapes(path, LAND)


def test_a_line_that_leaves_the_landscape_is_kept_whole(tmp_path: Path) -> None:
    road = LineString([(WEST_M - 5000, NORTH_M - 100), (WEST_M + 5000, NORTH_M - 100)])
    (found,) = read_shapes(shapefile(tmp_path / "a.shp", road), LAND)
    assert found.length == pytest.approx(10_000.0)


@pytest.mark.skipif(not DATA.is_dir(), reason="no real data")
def test_real_perimeters_have_the_areas_that_were_measured() -> None:
    """The file has 21 infrared perimeters of the Maria fire from 3 to 42 km², and one more."""
    files = {name: DATA / f"maria_2019/Maria2019-{name}.tif" for name in ("fuel", "elevation")}
    land = read_landscape(files)
    shapes = read_shapes(DATA / "maria_2019/firis_perimeters.shp", land)
    assert shapes[0].area / 1e6 == pytest.approx(3.0, abs=0.1)
    assert shapes[20].area / 1e6 == pytest.approx(42.2, abs=0.1)
    for shape in shapes:
        cells_m2 = len(cells_of([shape], land)) * land.cell_size_m**2
        assert cells_m2 == pytest.approx(shape.area, rel=0.01)


def test_a_field_name_cut_in_a_character_does_not_matter(tmp_path: Path) -> None:
    """Writers truncate names to ten bytes; the eleventh was the second byte of a character."""
    path = shapefile(tmp_path / "a.shp", AREA)
    table = path.with_suffix(".dbf")
    content = table.read_bytes()
    place = content.index(b"number")
    table.write_bytes(content[:place] + b"numberxxx\xc3" + content[place + 10 :])
    path.with_suffix(".cpg").write_text("UTF-8")
    assert same(read_shapes(path, LAND)[0])
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for part in tmp_path.glob("a.*"):
            if part.suffix != ".zip":
                archive.write(part, part.name)
    shapes, _, records = records_of(Path("a.zip"), (tmp_path / "a.zip").read_bytes())
    assert same(shapes[0])
    assert list(records[0].values()) == [0]


def test_a_perimeter_is_repaired_on_request_and_reported(tmp_path: Path) -> None:
    """The shapes are a figure eight of two squares of 1 ha, and a ring with an island, as lines."""
    eight = Polygon(
        [(X_M + x, Y_M + y) for x, y in ((0, 0), (100, 0), (100, 200), (200, 200), (200, 100))]
        + [(X_M, Y_M + 100)]
    )
    path = shapefile(tmp_path / "a.shp", eight)
    with pytest.raises(FireModelError, match=r"Self-intersection.*fire.repair_perimeter = true"):
        read_shapes(path, LAND)
    (found,) = read_shapes(path, LAND, repair=True)
    assert found.area == pytest.approx(2e4)
    (line,) = repairs_of(path)
    assert "feature 1 (Self-intersection" in line
    assert line.endswith("was repaired: 0.00 ha before, 2.00 ha after")

    outer = shapely.box(X_M - 300, Y_M - 300, X_M, Y_M).exterior
    inner = shapely.box(X_M - 200, Y_M - 200, X_M - 100, Y_M - 100).exterior
    drawn = shapefile(tmp_path / "b.shp", shapely.MultiLineString([outer, inner]))
    (ring,) = read_shapes(drawn, LAND, repair=True)
    assert ring.geom_type == "Polygon"
    assert ring.area == pytest.approx(8e4)
    assert repairs_of(drawn)[0].endswith(
        "(closed line) was repaired: 10.01 ha before, 8.01 ha after"
    )

    whole = shapefile(tmp_path / "c.shp", AREA)
    assert same(read_shapes(whole, LAND, repair=True)[0])
    assert repairs_of(whole) == []
    road = shapefile(tmp_path / "d.shp", LineString([(X_M, Y_M), (X_M + 90, Y_M)]))
    assert read_shapes(road, LAND, repair=True)[0].geom_type == "LineString"


def test_one_feature_of_a_file_is_read_whatever_the_others_are(tmp_path: Path) -> None:
    far = shapely.box(0.0, 0.0, 1.0, 1.0)
    path = shapefile(tmp_path / "a.shp", far, AREA)
    (found,) = read_shapes(path, LAND, feature=2)
    assert same(found)
    with pytest.raises(FireModelError, match=r"a.shp: has no feature 3; its features are 1 to 2"):
        read_shapes(path, LAND, feature=3)
