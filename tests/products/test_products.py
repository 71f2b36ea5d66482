"""The products of a short run: each file is read back by the libraries that its users have."""

import json
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast
from xml.etree.ElementTree import Element, fromstring
from zipfile import ZipFile

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from click.testing import CliRunner
from pyogrio.errors import DataSourceError
from pypdf import PdfReader
from rio_cogeo.cogeo import cog_validate
from shapely.geometry import shape

from firemodel.errors import FireModelError
from firemodel.landscape.flat import flat_landscape
from mission_service.cli.main import main
from mission_service.config.scenario import load_scenario
from mission_service.products.geospatial_pdf import CORNERS
from mission_service.products.incident import Incident
from mission_service.products.stac_item import stac_item
from mission_service.products.vector_files import write_geopackage
from mission_service.simulation.sim import simulate

ZERO = "2026-08-01T14:00-04:00"
KML = "{http://www.opengis.net/kml/2.2}"
FILES = {
    *("incident.gpkg", "incident.kmz", "perimeter.zip", "interpreter-log.txt", "stac-item.json"),
    *("map-letter.pdf", "map-a4.pdf", "map.png", "map.png.aux.xml"),
    *(f"{name}.{ending}" for name in ("arrival_time_s", "burn_probability", "flame_length_m")
      for ending in ("tif", "qml")),
}  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    changes = ("duration_s=5400", "deploy_at_s=2400", "start_s=2400", "estimate.members=10")
    simulate(load_scenario("default", changes), folder / "journal.jsonl", "today")
    return folder


def _products(run: Path, out: Path, *more: str) -> str:
    done = CliRunner().invoke(main, ["products", str(run), "--out", str(out), *more])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture(scope="module")
def made(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("products")
    with _no_warning():
        _products(run, out, "--time-zero", ZERO, "--forecast", "1")
    return out


@contextmanager
def _no_warning() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def _attributes(made: Path, layer: str) -> dict[str, list[Any]]:
    with _no_warning():
        meta, _, _, values = pyogrio.raw.read(made / "incident.gpkg", layer=layer)
    return dict(zip(meta["fields"], (list(column) for column in values), strict=True))


def _perimeter(made: Path) -> dict[str, Any]:
    return {name: column[0] for name, column in _attributes(made, "perimeter").items()}


def _acres_in(text: str) -> float:
    """Return the first area with one decimal; the attributes have two."""
    (acres,) = re.findall(r"([\d,]+\.\d) acres", text)[:1]
    return float(acres.replace(",", ""))


def test_the_products_are_those_listed_and_a_second_run_writes_the_same_bytes(
    run: Path, made: Path, tmp_path: Path
) -> None:
    assert {path.name for path in made.iterdir()} == FILES
    _products(run, tmp_path, "--time-zero", ZERO, "--forecast", "1")
    for path in made.iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name


def test_a_run_without_a_date_is_refused_in_one_line(run: Path, tmp_path: Path) -> None:
    for more in ((), ("--time-zero", "2026-08-01T14:00")):
        done = CliRunner().invoke(main, ["products", str(run), "--out", str(tmp_path), *more])
        assert done.exit_code != 0
        assert "2026-08-01T14:00-06:00" in done.output.splitlines()[-1]
    assert not list(tmp_path.iterdir())


def test_times_outside_the_journal_are_refused(run: Path, tmp_path: Path) -> None:
    for at, words in (("1000", "begins at mission time 2400 s"), ("9000", "ends at mission time")):
        arguments = ["products", str(run), "--out", str(tmp_path), "--time-zero", ZERO, "--at", at]
        done = CliRunner().invoke(main, arguments)
        assert done.exit_code == 1
        assert words in done.output


def test_the_perimeter_has_the_fields_of_the_agencies_and_its_geodesic_area(made: Path) -> None:
    fields = _perimeter(made)
    assert fields["poly_IncidentName"] == "default"
    assert fields["poly_FeatureCategory"] == "Wildfire Daily Fire Perimeter"
    assert fields["poly_MapMethod"] == "Modeled"
    assert fields["poly_FeatureStatus"] == "Proposed"
    assert str(fields["poly_PolygonDateTime"]).startswith("2026-08-01T19:30")
    meta, _, shapes, values = pyogrio.raw.read(f"/vsizip/{made}/perimeter.zip/perimeter.shp")
    short = dict(zip(meta["fields"], (column[0] for column in values), strict=True))
    assert short["IncidentNa"] == "default"
    assert short["DateCurren"].startswith("2026-08-01T19:30")
    assert short["GISAcres"] == fields["poly_GISAcres"]
    assert meta["crs"] == "EPSG:4326"
    # The landscape is in UTM, in which areas are smaller by at most 0.08 % near the middle of a
    # zone, and larger by about 0.1 % at its edge.
    from shapely import from_wkb, transform

    from firemodel.landscape.landscape import transformers

    planar = transform(
        from_wkb(shapes[0]),
        lambda places: np.stack(transformers("EPSG:32616")[1].transform(*places.T), axis=1),
    )
    assert short["GISAcres"] == pytest.approx(planar.area / 4046.8564224, rel=2e-3)
    assert short["GISAcres"] > 5.0


def test_the_shapefile_is_complete(made: Path) -> None:
    with ZipFile(made / "perimeter.zip") as archive:
        names = {Path(name).suffix for name in archive.namelist()}
        assert {".shp", ".shx", ".dbf", ".prj", ".cpg"} <= names
        assert archive.testzip() is None


def test_every_layer_of_the_geopackage_has_valid_shapes(made: Path) -> None:
    from shapely import from_wkb, is_valid

    layers = [name for name, _ in pyogrio.list_layers(made / "incident.gpkg")]
    assert layers[:4] == ["perimeter", "fronts", "forecast_isochrones", "burn_probability"]
    assert "heat_areas" in layers
    for layer in layers:
        _, _, shapes, _ = pyogrio.raw.read(made / "incident.gpkg", layer=layer)
        assert is_valid(from_wkb(shapes)).all(), layer


def _document(path: Path) -> Element:
    with ZipFile(path) as archive:
        assert "circle.png" in archive.namelist()
        return fromstring(archive.read("doc.kml"))


def test_an_error_of_gdal_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*arguments: object, **options: object) -> None:
        raise DataSourceError("sqlite3_exec failed:\n disk full")

    monkeypatch.setattr(pyogrio.raw, "write", fails)
    place = {"type": "Point", "coordinates": [0.0, 0.0]}
    layer = [{"type": "Feature", "geometry": place, "properties": {"name": "a"}}]
    words = r"incident\.gpkg: cannot be written: sqlite3_exec failed: disk full"
    with pytest.raises(FireModelError, match=words):
        write_geopackage(tmp_path / "incident.gpkg", {"points": layer}, datetime.now(UTC))


def test_the_leftover_of_a_killed_call_is_not_in_the_geopackage(tmp_path: Path) -> None:
    def points(at_s: float) -> list[dict[str, Any]]:
        geometry = {"type": "Point", "coordinates": [-84.0, 36.0]}
        return [{"type": "Feature", "properties": {"at_s": at_s}, "geometry": geometry}]

    path, part = tmp_path / "incident.gpkg", tmp_path / ".incident.part.gpkg"
    write_geopackage(path, {name: points(1.0) for name in ("a", "b", "drops")}, datetime.now(UTC))
    path.rename(part)
    part.with_name(f"{part.name}-journal").write_bytes(b"of another file")
    write_geopackage(path, {name: points(2.0) for name in ("a", "b")}, datetime.now(UTC))
    assert [name for name, _ in pyogrio.list_layers(path)] == ["a", "b"]
    for name in ("a", "b"):
        assert pyogrio.raw.read(path, layer=name)[3][0].tolist() == [2.0]
    assert [each.name for each in tmp_path.iterdir()] == ["incident.gpkg"]


def test_the_times_of_the_kmz_are_calendar_times_in_order(made: Path) -> None:
    root = _document(made / "incident.kmz")
    folders = {each.findtext(f"{KML}name"): each for each in root.iter(f"{KML}Folder")}
    fronts = folders["Fire perimeter by time"]
    spans = [
        (datetime.fromisoformat(str(span.findtext(f"{KML}begin"))), span.findtext(f"{KML}end"))
        for span in fronts.iter(f"{KML}TimeSpan")
    ]
    zero = datetime.fromisoformat(ZERO)
    assert [(begin - zero).total_seconds() for begin, _ in spans] == [3600.0, 5400.0]
    assert [end for _, end in spans] == [spans[1][0].isoformat(), None]
    styles = {f"#{each.get('id')}" for each in root.iter(f"{KML}Style")}
    used = {each.text for each in root.iter(f"{KML}styleUrl")}
    assert used <= styles
    assert {"#ahead", "#likely", "#hot"} <= used
    assert all(each.text == "circle.png" for each in root.iter(f"{KML}href"))


def test_the_rasters_are_cloud_optimised_and_agree_with_the_perimeter(made: Path) -> None:
    for name in ("arrival_time_s", "burn_probability", "flame_length_m"):
        valid, errors, problems = cog_validate(made / f"{name}.tif", strict=True, quiet=True)
        assert valid, (errors, problems)
    with rasterio.open(made / "arrival_time_s.tif") as file:
        arrival_s = file.read(1, masked=True)
    acres = np.count_nonzero((arrival_s <= 5400.0).filled(False)) * 900.0 / 4046.8564224
    assert acres == pytest.approx(_perimeter(made)["poly_GISAcres"], rel=0.1)
    with rasterio.open(made / "burn_probability.tif") as file:
        probability = file.read(1)
    assert (probability[(arrival_s <= 5400.0).filled(False)] == 1.0).all()


@pytest.mark.parametrize(("size", "points"), [("letter", (792.0, 612.0)), ("a4", (841.9, 595.3))])
def test_the_pdf_carries_the_coordinates_of_its_frame(
    made: Path, size: str, points: tuple[float, float]
) -> None:
    page: Any = PdfReader(made / f"map-{size}.pdf").pages[0]
    assert (float(page.mediabox.width), float(page.mediabox.height)) == pytest.approx(
        points, abs=0.1
    )
    (viewport,) = (each.get_object() for each in page["/VP"])
    measure = viewport["/Measure"]
    assert measure["/Subtype"] == "/GEO"
    assert [float(each) for each in measure["/LPTS"]] == list(np.ravel(CORNERS))
    assert "UTM" in measure["/GCS"]["/WKT"]
    corners = np.reshape([float(each) for each in measure["/GPTS"]], (4, 2))
    found = pyogrio.read_info(made / "incident.gpkg", layer="perimeter")
    west, south, east, north = found["total_bounds"]
    assert corners[0, 0] < south < north < corners[1, 0]
    assert corners[0, 1] < west < east < corners[3, 1]
    # The scale that the page states is that of the frame.
    scale = int(re.findall(r"1:([\d,]+)", page.extract_text())[0].replace(",", ""))
    height_m = (corners[1, 0] - corners[0, 0]) * 111_000.0
    box = [float(each) for each in viewport["/BBox"]]
    assert height_m / ((box[3] - box[1]) / 72.0 * 0.0254) == pytest.approx(scale, rel=0.03)


def test_the_map_states_what_a_briefing_needs(made: Path) -> None:
    text = PdfReader(made / "map-letter.pdf").pages[0].extract_text()
    assert _acres_in(text) == pytest.approx(_perimeter(made)["poly_GISAcres"], abs=0.056)
    for words in (
        *("2026-08-01 15:30 EDT (19:30 UTC)", "UTM zone 16N", "16S GF"),
        *("WGS84", "Scale 1:", "true north", "not approved", "10 % probability", "Fuel", "km"),
    ):
        assert words in text, words


def test_the_png_has_the_same_georeference_as_the_pdf(made: Path) -> None:
    with rasterio.open(made / "map.png") as file:
        assert file.crs.to_epsg() == 32616
        x_m, y_m = file.transform.a, -file.transform.e
        west, north = file.transform.c, file.transform.f
    assert x_m == pytest.approx(y_m, rel=1e-3)
    page: Any = PdfReader(made / "map-letter.pdf").pages[0]
    viewport = page["/VP"][0].get_object()
    box = [float(each) * 200.0 / 72.0 for each in viewport["/BBox"]]
    lat, lon = (float(each) for each in viewport["/Measure"]["/GPTS"][:2])
    from firemodel.landscape.landscape import transformers

    x, y = transformers("EPSG:32616")[1].transform(lon, lat)
    assert x == pytest.approx(west + box[0] * x_m, abs=1.0)
    assert y == pytest.approx(north - (1700.0 - box[1]) * y_m, abs=1.0)


def test_the_stac_item_across_the_antimeridian_has_two_polygons() -> None:
    land, none = flat_landscape(200, 200, 30.0, -16.8, 180.0), cast(Any, None)
    at = datetime.fromisoformat(ZERO)
    incident = Incident("fire", land, 0.0, at, False, none, 0.0, none, none, none, none, none)
    item = stac_item(incident, {})
    west, south, east, north = item["bbox"]
    assert (west > 179.0, east < -179.0) == (True, True)
    area = shape(item["geometry"])
    assert area.is_valid
    assert [each.bounds for each in shapely.get_parts(area)] == [
        (west, south, 180.0, north),
        (-180.0, south, east, north),
    ]


def test_the_stac_item_lists_every_file(made: Path) -> None:
    item = json.loads((made / "stac-item.json").read_text())
    assert item["stac_version"] == "1.1.0"
    listed = {asset["href"].removeprefix("./") for asset in item["assets"].values()}
    assert listed == FILES - {"stac-item.json"}
    assert item["properties"]["datetime"] == "2026-08-01T19:30:00Z"
    west, south, east, north = item["bbox"]
    with rasterio.open(made / "arrival_time_s.tif") as file:
        from rasterio.warp import transform_bounds

        assert transform_bounds(file.crs, "EPSG:4326", *file.bounds) == pytest.approx(
            (west, south, east, north), abs=1e-4
        )


def test_the_log_has_the_facts_of_an_interpreter(made: Path) -> None:
    text = (made / "interpreter-log.txt").read_text()
    size = text[text.index("Interpreted size:") :]
    assert _acres_in(size) == pytest.approx(_perimeter(made)["poly_GISAcres"], abs=0.056)
    likely = _attributes(made, "burn_probability")
    for level, likely_acres in zip(likely["probability"], likely["poly_GISAcres"], strict=True):
        assert f"{level:.0%}".replace("%", f" %: {likely_acres:,.0f} acres") in text
    assert "not reviewed by a person" in text
    assert re.search(r"hawk \(camera\): [\d,]+ observations, 0 not used", text)
    assert "Growth in 1 h:" in text
    assert "start mission: accepted" in text


def test_products_of_an_earlier_time_without_a_forecast(run: Path, tmp_path: Path) -> None:
    for name in ("burn_probability.tif", "burn_probability.qml"):
        (tmp_path / name).write_bytes(b"an earlier forecast")
    output = _products(run, tmp_path, "--time-zero", ZERO, "--at", "3600", "--forecast", "0")
    assert "2026-08-01 15:00 EDT" in output
    assert not list(tmp_path.glob("burn_probability.*"))
    layers = [name for name, _ in pyogrio.list_layers(tmp_path / "incident.gpkg")]
    assert layers[:2] == ["perimeter", "fronts"]
    assert "forecast_isochrones" not in layers


def test_a_journal_that_still_grows_ends_with_its_last_whole_line(
    run: Path, tmp_path: Path
) -> None:
    whole = (run / "journal.jsonl").read_bytes()
    (tmp_path / "journal.jsonl").write_bytes(whole[: len(whole) // 2])
    output = _products(tmp_path, tmp_path / "out", "--time-zero", ZERO, "--forecast", "0")
    assert re.search(r"15:0\d EDT", output)


def test_an_altered_journal_is_refused(run: Path, tmp_path: Path) -> None:
    lines = (run / "journal.jsonl").read_bytes().splitlines(keepends=True)
    place = next(at for at, line in enumerate(lines) if b'"Observed"' in line and b"b" in line)
    lines[place] = lines[place].replace(b'"hawk"', b'"hawl"', 1)
    (tmp_path / "journal.jsonl").write_bytes(b"".join(lines))
    arguments = ["products", str(tmp_path), "--out", str(tmp_path / "out"), "--time-zero", ZERO]
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 1
    assert f"line {place + 1} was altered" in done.output
    assert not (tmp_path / "out").exists()


def test_a_folder_without_a_journal_is_refused(tmp_path: Path) -> None:
    arguments = ["products", str(tmp_path), "--out", str(tmp_path / "out"), "--time-zero", ZERO]
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 1
    assert "contains no journal.jsonl" in done.output


@pytest.mark.parametrize("command", ["replay", "report", "log export"])
@pytest.mark.parametrize("by_folder", [True, False])
def test_no_command_replaces_the_results_of_the_run_that_it_reads(
    run: Path, command: str, by_folder: bool
) -> None:
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    source = run if by_folder else run / "journal.jsonl"
    done = CliRunner().invoke(main, [*command.split(), str(source), "--out", f"{run}/."])
    assert done.exit_code == 1
    assert "is the folder of the run, and its files could be replaced" in done.output
    assert {path.name: path.read_bytes() for path in run.iterdir()} == before


def test_the_folder_of_the_run_is_refused(run: Path) -> None:
    before = {path.name for path in run.iterdir()}
    arguments = ["products", str(run), "--out", str(run / "." / ".." / run.name)]
    done = CliRunner().invoke(main, [*arguments, "--time-zero", ZERO, "--forecast", "0"])
    assert done.exit_code == 1
    assert "is the folder of the run" in done.output
    assert {path.name for path in run.iterdir()} == before


@pytest.mark.parametrize("zero", ["0001-01-01T00:00+14:00", "9999-12-31T23:59-04:00"])
def test_years_that_no_fire_has_are_refused(run: Path, tmp_path: Path, zero: str) -> None:
    arguments = ["products", str(run), "--out", str(tmp_path / "out"), "--time-zero", zero]
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 1
    assert done.output.splitlines()[-1].endswith("must be from 1900 to 2999")
    assert not (tmp_path / "out").exists()
