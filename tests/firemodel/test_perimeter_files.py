"""Mapped perimeters with times are read from each format, or left out with a reason."""

import json
import shutil
import sqlite3
import zipfile
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pyogrio
import pytest
import shapely
from shapely.geometry import LineString, Point, Polygon, mapping
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape.readers.feature_times import time_column, time_in
from firemodel.landscape.readers.perimeter_files import Perimeter, read_perimeters
from firemodel.landscape.readers.rasters import read_landscape
from firemodel.landscape.readers.shapes import into_crs, read_shapes
from tests.firemodel.grids import CRS, landscape

DATA = Path("/work/shared/data")
LAND = landscape()  # 41 x 41 cells of 30 m
X_M, Y_M = LAND.xy_of(20, 20)
PDT = ZoneInfo("America/Los_Angeles")
NOON, LATER = "2019-10-31T12:00:00Z", "2019-10-31T13:30:00Z"
NOON_AT, LATER_AT = (
    datetime(2019, 10, 31, 12, tzinfo=UTC),
    datetime(2019, 10, 31, 13, 30, tzinfo=UTC),
)


def square(size_m: float, east_m: float = 0.0) -> Polygon:
    west_m, south_m = X_M + east_m, Y_M
    corners = [(0.0, 0.0), (size_m, 0.0), (size_m, size_m), (0.0, size_m)]
    return Polygon([(west_m + x_m, south_m + y_m) for x_m, y_m in corners])


SMALL, LARGE = square(100.0), square(200.0)


def lon_lat(shape: BaseGeometry) -> BaseGeometry:
    return into_crs(shape, CRS, "EPSG:4326")


def geojson(path: Path, *features: tuple[BaseGeometry | None, dict[str, Any]]) -> Path:
    """Write shapes in the landscape's CRS, with their attributes, as GeoJSON."""
    content = [
        {
            "type": "Feature",
            "properties": attributes,
            "geometry": None if shape is None else mapping(lon_lat(shape)),
        }
        for shape, attributes in features
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": content}))
    return path


def written(
    path: Path, *shapes: BaseGeometry, driver: str, crs: str | None = CRS, **fields: Any
) -> Path:
    """Write shapes with these columns of attributes as a Shapefile or a GeoPackage."""
    pyogrio.raw.write(
        path,
        np.array([shapely.to_wkb(shape) for shape in shapes], dtype=object),
        field_data=[np.asarray(column) for column in fields.values()],
        fields=list(fields),
        geometry_type=shapes[0].geom_type,
        crs=crs,
        driver=driver,
    )
    return path


def shapefile(path: Path, *shapes: BaseGeometry, crs: str | None = CRS, **fields: Any) -> Path:
    return written(path, *shapes, driver="ESRI Shapefile", crs=crs, **fields)


def texts(*values: str | None) -> Any:
    return np.array(values, dtype=object)


def both(path: Path) -> None:
    """Check the perimeters SMALL at noon and LARGE 90 minutes later."""
    (first, second), warnings = read_perimeters(path, LAND)
    assert warnings == []
    assert (first.at, second.at) == (NOON_AT, LATER_AT)
    for found, area in ((first, SMALL), (second, LARGE)):
        assert found.area.symmetric_difference(area).area < 1.0
        assert found.area.is_valid
    assert first.source.endswith(" at 2019-10-31 12:00:00 UTC")


def test_geojson_in_order_of_time(tmp_path: Path) -> None:
    """The order in the file does not matter; UTC offsets and slashes are accepted."""
    noon = (SMALL, {"PolygonDateTime": "2019/10/31 12:00:00+00"})
    for later in (LATER, "2019-10-31T06:30:00-07:00", "2019/10/31 13:30:00+00"):
        both(geojson(tmp_path / "a.geojson", (LARGE, {"PolygonDateTime": later}), noon))


def test_shapefiles_zipped_or_not(tmp_path: Path) -> None:
    path = shapefile(tmp_path / "a.shp", SMALL, LARGE, PolygonDat=texts(NOON, LATER))
    both(path)
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for part in tmp_path.glob("a.*"):
            if part.suffix != ".zip":
                archive.write(part, part.name)
    both(tmp_path / "a.zip")
    (tmp_path / "a.prj").unlink()
    with pytest.raises(FireModelError, match=r"a.shp: has no .prj file; add its projection"):
        read_perimeters(path, LAND)


def placemark(time: str, shape: BaseGeometry, more: str = "") -> str:
    ring = " ".join(f"{lon},{lat},0" for lon, lat in shapely.get_coordinates(lon_lat(shape)))
    return (
        f"<Placemark>{time}<MultiGeometry>{more}<Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon></MultiGeometry></Placemark>"
    )


def kml(*placemarks: str) -> str:
    """Return a document with one folder, which is a layer, for each placemark."""
    folders = "".join(
        f"<Folder><name>{number}</name>{each}</Folder>" for number, each in enumerate(placemarks)
    )
    return f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{folders}</Document></kml>'


def test_kml_with_times_and_spans(tmp_path: Path) -> None:
    content = kml(
        placemark(f"<TimeStamp><when>{LATER}</when></TimeStamp>", LARGE),
        placemark(f"<TimeSpan><begin>{NOON}</begin><end>{LATER}</end></TimeSpan>", SMALL),
    )
    (tmp_path / "a.kml").write_text(content)
    both(tmp_path / "a.kml")
    with zipfile.ZipFile(tmp_path / "a.kmz", "w") as archive:
        archive.writestr("doc.kml", content)
    both(tmp_path / "a.kmz")


def test_a_label_in_kml_is_no_part_of_the_perimeter(tmp_path: Path) -> None:
    """The time of the label is a date, which GDAL converts to midnight."""
    lon, lat = lon_lat(Point(X_M, Y_M)).coords[0]
    label = f"<Point><coordinates>{lon},{lat}</coordinates></Point>"
    mark = placemark("<TimeStamp><when>2019-10-31</when></TimeStamp>", SMALL, label)
    (tmp_path / "a.kml").write_text(kml(mark))
    (found,), warnings = read_perimeters(tmp_path / "a.kml", LAND, PDT)
    assert found.at == datetime(2019, 10, 31, tzinfo=PDT)
    assert found.area.area == pytest.approx(1e4, rel=1e-3)
    assert "feature 1 is a collection; only its polygons are used" in warnings[0]
    assert "1 of 1 perimeters have a date without a time of day; 00:00 (America/" in warnings[1]


def test_a_geopackage_with_layers_and_a_table(tmp_path: Path) -> None:
    """The table of styles, which QGIS adds, is not a layer of perimeters."""
    path = tmp_path / "a.gpkg"
    times = np.array(["2019-10-31T12:00:00", "2019-10-31T13:30:00"], dtype="M8[ms]")
    written(path, SMALL, LARGE, driver="GPKG", time=times)
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE layer_styles (id INTEGER PRIMARY KEY, styleQML TEXT)")
        database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier)"
            " VALUES ('layer_styles', 'attributes', 'layer_styles')"
        )
    database.close()
    both(path)
    assert len(read_shapes(path, LAND)) == 2


def test_a_folder_and_features_of_one_time(tmp_path: Path) -> None:
    """Features with equal times are united, including those of different files."""
    parts = square(100.0), square(100.0, east_m=50.0), square(100.0, east_m=200.0)
    shapefile(tmp_path / "b.shp", *parts[1:], datetime=texts(NOON, NOON))
    geojson(tmp_path / "a.geojson", (parts[0], {"DateTime": NOON}), (LARGE, {"DateTime": LATER}))
    (tmp_path / "notes.txt").write_text("no perimeters")
    (tmp_path / "._c.shp").write_text("of macOS")
    (first, second), warnings = read_perimeters(tmp_path, LAND)
    assert warnings == []
    assert first.area.area == pytest.approx(2.5e4, rel=1e-3)
    assert first.source == (
        f"{tmp_path / 'a.geojson'}, {tmp_path / 'b.shp'} at 2019-10-31 12:00:00 UTC"
    )
    assert isinstance(second, Perimeter)


@pytest.mark.parametrize(
    "name",
    [
        *("PolygonDateTime", "poly_PolygonDateTime", "poly_Polyg", "POLYGONDAT", "DateCurren"),
        *("poly_DateCurrent", "perimeterdatetime", "perDatTime", "DateTime", "date_time", "when"),
    ],
)
def test_names_of_fields_with_times(name: str) -> None:
    column = time_column([{"name": "x", name: None}, {"name": "y", name: NOON}])
    assert column is not None
    assert column.field == name
    assert column.values == [None, NOON]


def test_the_time_of_the_polygon_comes_before_that_of_the_last_change() -> None:
    record = {"DateCurrent": LATER, "poly_PolygonDateTime": NOON, "time": LATER}
    column = time_column([record])
    assert column is not None
    assert column.values == [NOON]
    empty = time_column([{**record, "poly_PolygonDateTime": float("nan")}])
    assert empty is not None
    assert empty.field == "DateCurrent"
    assert time_column([{"ALARM_DATE": NOON}]) is None
    assert time_column([]) is None


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("2019-10-31T19:37:11Z", datetime(2019, 10, 31, 19, 37, 11, tzinfo=UTC)),
        ("2019-10-31T19:37:11", datetime(2019, 10, 31, 19, 37, 11, tzinfo=PDT)),
        ("2019/10/31 19:37:11+00", datetime(2019, 10, 31, 19, 37, 11, tzinfo=UTC)),
        ("2019/10/31 19:37:11", datetime(2019, 10, 31, 19, 37, 11, tzinfo=PDT)),
        ("7/14/2018 10:30:00 PM", datetime(2018, 7, 14, 22, 30, tzinfo=PDT)),
        (1572575831000, datetime(2019, 11, 1, 2, 37, 11, tzinfo=UTC)),
        ("1572575831000", datetime(2019, 11, 1, 2, 37, 11, tzinfo=UTC)),
        (np.float64(1572575831.0), datetime(2019, 11, 1, 2, 37, 11, tzinfo=UTC)),
        (np.datetime64("2019-10-31T19:37", "ms"), datetime(2019, 10, 31, 19, 37, tzinfo=PDT)),
        (np.datetime64("2019-10-31"), date(2019, 10, 31)),
        ("2019-10-31", date(2019, 10, 31)),
        ("2019/10/31", date(2019, 10, 31)),
    ],
)
def test_values_of_times(value: Any, expected: date) -> None:
    found = time_in(value, PDT)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    "value",
    [
        *("soon", "1899-12-30T00:00:00Z", "2201-01-01", "20191031", 20191031193711, "1e400", 0),
        *(-1.0, "2019-02-30T00:00:00", "10:30 AM", float("inf")),
    ],
)
def test_values_that_are_no_times(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^'.*' is not a date and time from 1900 to 2200$"):
        time_in(value, UTC)


def test_firis_pair_of_date_and_time(tmp_path: Path) -> None:
    """The column type is used only with this pair of fields; a missing type is not a perimeter."""
    fields = {
        "YYYYMMDD": np.array([20191031] * 4, dtype=np.int64),
        "24_HHMMSS": texts("05:00:00", "6:30:00", "07:00:00", "08:00:00"),
        "type": texts("perim", "perim", "intense", None),
    }
    path = shapefile(tmp_path / "a.shp", SMALL, LARGE, SMALL, SMALL, **fields)
    found, warnings = read_perimeters(path, LAND, PDT)
    assert [each.at for each in found] == [NOON_AT, LATER_AT]
    assert warnings == [
        f"{path}: feature 3 has the type 'intense', not 'perim'; the feature is left out",
        f"{path}: feature 4 has the type '', not 'perim'; the feature is left out",
    ]
    other = geojson(tmp_path / "b.geojson", (SMALL, {"type": "intense", "time": NOON}))
    assert len(read_perimeters(other, LAND)[0]) == 1
    numbers = time_column([{"YYYYMMDD": 20191031.0, "24_HHMMSS": 93711}, {"YYYYMMDD": None}])
    assert numbers is not None
    assert numbers.values == ["20191031T093711", None]


BOW_TIE = Polygon([(X_M, Y_M), (X_M + 100, Y_M + 100), (X_M + 100, Y_M), (X_M, Y_M + 100)])
FAR = shapely.transform(SMALL, lambda xy: xy + np.array([300_000.0, 0.0]))


def test_features_that_are_left_out_or_repaired(tmp_path: Path) -> None:
    path = geojson(
        tmp_path / "a.geojson",
        (SMALL, {"time": NOON}),
        (LARGE, {"time": None}),
        (LARGE, {"time": "soon"}),
        (LARGE, {"time": "1815-06-18T12:00:00Z"}),
        (None, {"time": LATER}),
        (Point(X_M, Y_M), {"time": LATER}),
        (LineString([(X_M, Y_M), (X_M + 9, Y_M)]), {"time": LATER}),
        (FAR, {"time": LATER}),
        (BOW_TIE, {"time": "2019-10-31T14:00:00Z"}),
        (LineString(SMALL.exterior.coords), {"time": "2019-10-31T15:00:00Z"}),
    )
    found, warnings = read_perimeters(path, LAND)
    assert [each.at.hour for each in found] == [12, 14, 15]
    assert [each.area.geom_type for each in found] == ["Polygon", "MultiPolygon", "Polygon"]
    start = f"{path}: feature"
    for line, words in zip(
        warnings,
        [
            f"{start} 2 has no time in time; the feature is left out",
            f"{start} 3 has no time in time: 'soon' is not a date and time from 1900 to 2200; the",
            f"{start} 4 has no time in time: '1815-06-18T12:00:00Z' is not a date and time",
            f"{start} 5 is empty; the feature is left out",
            f"{start} 6 is a Point; the feature is left out",
            f"{start} 7 is a LineString; the feature is left out",
            f"{start} 8 (at lat 36.",
            f"{start} 9 (Self-intersection",
            f"{start} 10 (closed line) was repaired: 1.00 ha before, 1.00 ha after",
        ],
        strict=True,
    ):
        assert line.startswith(words)
        assert "\n" not in line
    assert "lies outside the landscape (around lat 36.1" in warnings[6]
    assert warnings[7].endswith("was repaired: 0.00 ha before, 0.50 ha after")


def test_thirty_degrees_away(tmp_path: Path) -> None:
    """The feature is left out; if it is the only one, the error states its position."""
    lon, lat = lon_lat(SMALL).centroid.coords[0]
    away = {"type": "Polygon", "coordinates": [[[lon + 30 + x, lat + y] for x, y in CORNERS]]}
    feature = {"type": "Feature", "properties": {"time": NOON}, "geometry": away}
    path = tmp_path / "a.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    with pytest.raises(FireModelError, match=r"no usable perimeter \(feature 1 \(at") as error:
        read_perimeters(path, LAND)
    assert "lon -56.98" in str(error.value)
    assert str(error.value).endswith("); use polygons of burned areas with their times")


CORNERS = ((0.0, 0.0), (0.01, 0.0), (0.01, 0.01), (0.0, 0.0))


def test_dates_without_time_of_day(tmp_path: Path) -> None:
    """Such dates count as 00:00 if they differ, and are refused otherwise."""
    days = np.array(["2019-10-31", "2019-11-01"], dtype="M8[D]")
    path = shapefile(tmp_path / "a.shp", SMALL, LARGE, DateCurren=days)
    found, warnings = read_perimeters(path, LAND, PDT)
    assert [each.at for each in found] == [
        datetime(2019, 10, 31, tzinfo=PDT),
        datetime(2019, 11, 1, tzinfo=PDT),
    ]
    assert warnings == [
        f"{path}: 2 of 2 perimeters have a date without a time of day; 00:00 "
        "(America/Los_Angeles) is used"
    ]
    geojson(tmp_path / "b.geojson", (SMALL, {"time": "2019-11-01T20:00:00Z"}))
    with pytest.raises(FireModelError, match=r"a.shp: feature 1 has a date \(2019-10-31\) without"):
        read_perimeters(tmp_path, LAND, PDT)


def test_files_that_cannot_be_used(tmp_path: Path) -> None:
    with pytest.raises(FireModelError, match=r"none.geojson: no such file"):
        read_perimeters(tmp_path / "none.geojson", LAND)
    with pytest.raises(FireModelError, match=r"contains no perimeter file; add a GeoJSON, KML"):
        read_perimeters(tmp_path, LAND)
    path = geojson(tmp_path / "a.geojson")
    with pytest.raises(
        FireModelError, match=r"a.geojson: contains no usable perimeter \(has no features\); "
    ):
        read_perimeters(path, LAND)
    geojson(path, (SMALL, {"name": "x", "ALARM_DATE": NOON}))
    with pytest.raises(
        FireModelError, match=r"no field contains the times .* \(fields: name, ALARM_DAT"
    ):
        read_perimeters(path, LAND)
    geojson(path, (SMALL, {}))
    with pytest.raises(FireModelError, match=r"\(fields: none\); add PolygonDateTime, for example"):
        read_perimeters(path, LAND)
    (tmp_path / "a.geojson").write_text("{")
    with pytest.raises(FireModelError, match=r"a.geojson: is not JSON in UTF-8"):
        read_perimeters(tmp_path, LAND)


def geopackage_with_view(path: Path, expression: str) -> Path:
    """Write a GeoPackage with the layer ``computed``, a view with a computed column."""
    written(path, SMALL, driver="GPKG", time=texts(NOON))
    with sqlite3.connect(path) as database:
        database.execute(
            f"CREATE VIEW computed AS SELECT fid, geom, {expression} AS time FROM {path.stem}"
        )
        code = database.execute("SELECT srs_id FROM gpkg_geometry_columns").fetchone()[0]
        database.execute(
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id)"
            f" VALUES ('computed', 'features', 'computed', {code})"
        )
        database.execute(
            "INSERT INTO gpkg_geometry_columns"
            f" VALUES ('computed', 'geom', 'POLYGON', {code}, 0, 0)"
        )
    database.close()
    return path


def test_views_in_a_geopackage_open_no_files(tmp_path: Path) -> None:
    """The function in the view would read a raster, possibly from an address."""
    plain = geopackage_with_view(tmp_path / "a.gpkg", f"'{LATER}'")
    assert len(read_perimeters(plain, LAND)[0]) == 2
    call = "gdal_get_pixel_value('/vsicurl/http://127.0.0.1:9/x.tif', 1, 'georef', 0, 0)"
    path = geopackage_with_view(tmp_path / "b.gpkg", call)
    with pytest.raises(FireModelError, match="unsafe use of gdal_get_pixel_value") as error:
        read_perimeters(path, LAND)
    assert "\n" not in str(error.value)


@pytest.mark.filterwarnings("ignore:'crs' was not provided")
def test_databases_that_are_no_geopackages(tmp_path: Path) -> None:
    """SpatiaLite and a truncated GeoPackage are refused, whatever the extension of the file."""
    other = written(tmp_path / "a.sqlite", SMALL, driver="SQLite", time=texts(NOON))
    path = tmp_path / "b.gpkg"
    shutil.copy(other, path)
    with pytest.raises(FireModelError, match=r"b.gpkg: .* SQLite database, but not a GeoPackage"):
        read_perimeters(path, LAND)
    whole = written(tmp_path / "c.gpkg", SMALL, driver="GPKG", time=texts(NOON))
    assert len(read_perimeters(whole.rename(tmp_path / "c.dat"), LAND)[0]) == 1
    content = (tmp_path / "c.dat").read_bytes()
    for count in (100, 5000, len(content) // 2):
        whole.write_bytes(content[:count])
        with pytest.raises(FireModelError, match=r"c.gpkg: cannot be read as shapes \(") as error:
            read_perimeters(whole, LAND)
        assert "\n" not in str(error.value)
    unknown = written(tmp_path / "d.gpkg", SMALL, driver="GPKG", crs=None, time=texts(NOON))
    with pytest.raises(FireModelError, match=r"d.gpkg: (has no CRS|CRS)"):
        read_perimeters(unknown, LAND)


@pytest.mark.skipif(not DATA.is_dir(), reason="no real data")
def test_real_perimeters_of_maria() -> None:
    """The file has perimeters of 21 flights, two of them at the same time, and one mark."""
    files = {name: DATA / f"maria_2019/Maria2019-{name}.tif" for name in ("fuel", "elevation")}
    found, warnings = read_perimeters(DATA / "maria_2019", read_landscape(files), PDT)
    assert len(found) == 20
    assert found[0].at == datetime(2019, 10, 31, 19, 37, 11, tzinfo=PDT)
    assert found[0].area.area / 1e6 == pytest.approx(3.0, abs=0.1)
    assert found[-1].area.area / 1e6 == pytest.approx(42.2, abs=0.1)
    assert len(warnings) == 1
    assert "feature 22 has the type ''" in warnings[0]
