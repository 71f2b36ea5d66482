"""What files of perimeters, detections and rasters contribute, and files that are refused."""

import json
import zipfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import shapely
from click.testing import CliRunner

from benchmarks.observation_samples import (
    VIIRS,
    kml_of,
    ring_of,
    viirs_line,
    write_geojson,
    write_layer,
    write_mask,
    write_samples,
)
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.cli.main import main
from mission_service.config.scenario import load_scenario
from mission_service.errors import MissionServiceError, ScenarioError
from mission_service.fire.observed_window import states_in
from mission_service.fire.scenario_fire import landscape_of
from mission_service.sensors.files import observation_file
from mission_service.sensors.files.file_contents import FileCells, FileReport, FileSettings
from mission_service.sensors.files.observation_file import (
    check_file,
    contents_of,
    read_observation_file,
)
from mission_service.sensors.files.observation_picture import states_of

AT = datetime(2026, 7, 4, 19, 37, 11, tzinfo=UTC)
EPOCH_MS = round(AT.timestamp() * 1000)
SETTINGS = FileSettings("UTC", 20.0, (1.0,), (0.0,))


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


def area(land: Landscape) -> shapely.Polygon:
    return shapely.Polygon(ring_of(land, 50, 50, 90, 90))


def reports(path: Path, land: Landscape, settings: FileSettings = SETTINGS) -> list[FileReport]:
    check_file(path)
    found = contents_of(path, land, settings).observations
    assert all(isinstance(each, FileReport) for each in found)
    return [each for each in found if isinstance(each, FileReport)]


def one(
    tmp_path: Path, land: Landscape, shape: Any, settings: Any = SETTINGS, **fields: Any
) -> Any:
    """Return the only report of a GeoJSON file with one feature."""
    path = tmp_path / "a.geojson"
    write_geojson(path, [(shape, fields)])
    (found,) = reports(path, land, settings)
    return found


AGENCIES: dict[str, tuple[dict[str, Any], tuple[str, float]]] = {
    "WFIGS": (
        {
            "poly_PolygonDateTime": EPOCH_MS,
            "poly_DateCurrent": EPOCH_MS + 900_000,
            "poly_Source": "NIFC",
            "poly_IncidentName": "Jones",
            "poly_MapMethod": "GPS-Walked",
            "poly_FeatureCategory": "Wildfire Daily Fire Perimeter",
        },
        ("NIFC, Jones, GPS-Walked", 10.0),
    ),
    "FIRIS": (
        {
            "type": "Heat Perimeter",
            "source": "FIRIS",
            "poly_DateCurrent": EPOCH_MS,
            "mission": "CA-LNU-Jones-N40Y",
            "incident_name": "Jones",
            "area_acres": 330.0,
        },
        ("FIRIS, Jones, CA-LNU-Jones-N40Y", 20.0),
    ),
    "GeoMAC": (
        {
            "incidentname": "Jones",
            "perimeterdatetime": "2026-07-04T19:37:11Z",
            "agency": "USFS",
            "mapmethod": "Hand Sketch",
        },
        ("USFS, Jones, Hand Sketch", 100.0),
    ),
}


@pytest.mark.parametrize("agency", AGENCIES)
def test_perimeters_of_three_agencies_keep_time_source_and_method(
    agency: str, tmp_path: Path, land: Landscape
) -> None:
    fields, (source, position_sd_m) = AGENCIES[agency]
    found = one(tmp_path, land, area(land), **fields)
    assert (found.state, found.shape, found.seen_unix_s) == ("burned", "polygon", AT.timestamp())
    assert (found.source, found.position_sd_m) == (source, position_sd_m)


def test_polygons_burned_and_lines_and_points_burn(tmp_path: Path, land: Landscape) -> None:
    path = tmp_path / "a.geojson"
    when = {"PolygonDateTime": EPOCH_MS}
    holed = shapely.Polygon(ring_of(land, 50, 50, 90, 90), [ring_of(land, 60, 60, 70, 70)])
    line = shapely.LineString(ring_of(land, 20, 20, 30, 60)[:2])
    spots = shapely.MultiPoint(ring_of(land, 5, 5, 8, 8)[:3])
    stated = when | {"state": "unburned", "position_sd_m": 7.5}
    write_geojson(
        path, [(holed, when), (line, when), (spots, when), (area(land).buffer(-0.005), stated)]
    )
    found = reports(path, land)
    assert sorted((each.state, each.shape, len(each.points)) for each in found) == [
        ("burned", "polygon", 4),
        ("burning", "line", 2),
        ("burning", "points", 3),
        ("unburned", "polygon", 4),
    ]
    assert {each.position_sd_m for each in found} == {20.0, 7.5}
    (holes,) = (each.islands for each in found if each.state == "burned")
    assert len(holes) == 1
    state = states_of(contents_of(path, land, SETTINGS), land)
    assert state[55, 55] == 2
    assert state[65, 65] == 0, "nothing is stated about an island"


def test_each_kind_of_file_shows_the_same_area(tmp_path: Path, land: Landscape) -> None:
    seen = {}
    for path in write_samples(tmp_path, land, AT):
        contents = contents_of(path, land, SETTINGS)
        assert {round(each.seen_unix_s) // 60 for each in contents.observations} == {
            round(AT.timestamp()) // 60
        }
        seen[path.name] = np.count_nonzero(states_of(contents, land) == 2)
    for name in ("perimeter.kml", "perimeter.kmz", "perimeter.zip", "perimeter.gpkg"):
        assert abs(seen[name] - seen["perimeter.shp"]) <= 2
    assert seen["perimeter.shp"] == pytest.approx(1600, abs=80)


def test_times_without_an_offset_are_of_the_stated_zone(tmp_path: Path, land: Landscape) -> None:
    pacific = msgspec.structs.replace(SETTINGS, time_zone="America/Los_Angeles")
    found = one(tmp_path, land, area(land), pacific, PolygonDateTime="2026-07-04 12:37:11")
    assert found.seen_unix_s == AT.timestamp()
    found = one(tmp_path, land, area(land), pacific, PolygonDateTime="2026-07-04T19:37:11Z")
    assert found.seen_unix_s == AT.timestamp()
    for name in ("20260704_1237_Jones_HeatPerimeter.geojson", "x-20260704T193700Z.geojson"):
        path = tmp_path / name
        write_geojson(path, [(area(land), {})])
        (named,) = reports(path, land, pacific)
        assert named.seen_unix_s == AT.timestamp() - 11.0
    with pytest.raises(ScenarioError, match="unknown time zone 'Mars/Olympus'"):
        load_scenario("default", ('estimate.observation_files.time_zone="Mars/Olympus"',))


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({}, "has no time; add PolygonDateTime"),
        ({"PolygonDateTime": "2026-07-04"}, "has a date (2026-07-04) without a time of day"),
        ({"PolygonDateTime": "noon"}, "feature 1 has no time in PolygonDateTime: 'noon'"),
        ({"PolygonDateTime": EPOCH_MS, "MapMethod": "Modeled"}, "was modeled, not observed"),
        (
            {"PolygonDateTime": EPOCH_MS, "FeatureCategory": "Temporary Flight Restriction"},
            "is a 'Temporary Flight Restriction', which does not show the fire",
        ),
    ],
)
def test_a_feature_that_shows_no_fire_at_a_time_is_refused(
    fields: dict[str, Any], words: str, tmp_path: Path, land: Landscape
) -> None:
    path = tmp_path / "a.geojson"
    write_geojson(path, [(area(land), fields)])
    with pytest.raises(FireModelError) as raised:
        contents_of(path, land, SETTINGS)
    assert words in str(raised.value)
    write_geojson(path, [(area(land), fields), (area(land), {"PolygonDateTime": EPOCH_MS})])
    if "MapMethod" in fields or "FeatureCategory" in fields:
        contents = contents_of(path, land, SETTINGS)
        assert len(contents.observations) == 1
        assert words in contents.notes[0]


def _bad_files(folder: Path, land: Landscape) -> Iterator[tuple[Path, str]]:
    elsewhere = shapely.box(-110.0, 40.0, -109.9, 40.1)
    write_geojson(folder / "off.geojson", [(elsewhere, {"PolygonDateTime": EPOCH_MS})])
    yield folder / "off.geojson", "feature 1 lies outside the landscape"
    (folder / "half.kml").write_text(kml_of(ring_of(land, 1, 1, 9, 9), AT)[:300])
    yield folder / "half.kml", "half.kml"
    with zipfile.ZipFile(folder / "bomb.kmz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", b"<kml>" + b" " * 70_000_000)
    yield folder / "bomb.kmz", "contains 70 MB; the maximum is 64 MB"
    (folder / "off.csv").write_text(VIIRS + viirs_line(10.0, 10.0, AT))
    yield folder / "off.csv", "no pixel lies on the landscape"
    (folder / "any.csv").write_text("a,b\n1,2\n")
    yield folder / "any.csv", "use a CSV file of FIRMS"
    with (folder / "huge.tif").open("wb") as file:
        file.truncate(4 * 1024**3)
    yield folder / "huge.tif", "4295 MB; the maximum is 64 MB"
    (folder / "photo.jpg").write_bytes(b"any")
    yield folder / "photo.jpg", "a picture does not state where fire is"
    (folder / "a.docx").write_bytes(b"any")
    yield folder / "a.docx", "has none of the suffixes"
    write_layer(folder / "alone.shp", ring_of(land, 1, 1, 9, 9), AT, "ESRI Shapefile")
    (folder / "alone.shx").unlink()
    yield folder / "alone.shp", ".shx file of the Shapefile is missing"
    write_mask(folder / "coarse.tif", land, np.eye(9), AT, 375.0)
    yield folder / "coarse.tif", "its cells are 375 m wide, but those of the landscape are 30 m"
    write_mask(folder / "other.tif", land, np.full((9, 9), 7), AT, 30.0)
    yield folder / "other.tif", "no cell with a value of burned_values"


def test_files_that_cannot_be_used_are_refused_with_the_reason(
    tmp_path: Path, land: Landscape
) -> None:
    for path, words in _bad_files(tmp_path, land):
        with pytest.raises((MissionServiceError, FireModelError)) as raised:
            reports(path, land)
        assert words in str(raised.value)
        assert path.name in str(raised.value)


def test_a_raster_becomes_cells_of_the_grid(tmp_path: Path, land: Landscape) -> None:
    path = tmp_path / "mask.tif"
    burned = np.zeros((300, 300), dtype=np.uint8)  # cells of 10 m
    burned[30:60, 60:120] = 1
    burned[200:] = 255  # not seen
    write_mask(path, land, burned, AT, 10.0)
    (found,) = contents_of(path, land, SETTINGS).observations
    assert isinstance(found, FileCells)
    assert (found.row, found.col, found.seen_unix_s) == (0, 0, AT.timestamp())
    state = states_in(found.cells)
    assert state.shape == (67, 100)
    expected = np.ones((66, 100), dtype=np.uint8)
    expected[10:20, 20:40] = 2
    assert np.array_equal(state[:66], expected)
    assert found.position_sd_m == pytest.approx(np.hypot(20.0, 10.0 / np.sqrt(12.0)), abs=0.01)


def test_a_separate_process_reads_the_file_and_may_crash(
    tmp_path: Path, land: Landscape, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.geojson"
    write_geojson(path, [(area(land), {"PolygonDateTime": EPOCH_MS})])
    assert read_observation_file(path, land, SETTINGS) == contents_of(path, land, SETTINGS)
    path.write_text("{}")
    with pytest.raises(MissionServiceError, match=r"a\.geojson: is JSON, but not GeoJSON"):
        read_observation_file(path, land, SETTINGS)
    monkeypatch.setattr(observation_file, "MODULE", "no_module_has_this_name")
    with pytest.raises(MissionServiceError, match="process that read it ended with status 1"):
        read_observation_file(path, land, SETTINGS)


def test_the_command_shows_what_a_file_contributes(
    tmp_path: Path, land: Landscape, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(observation_file, "read_observation_file", contents_of)
    good, mask, bad = (tmp_path / name for name in ("a.geojson", "mask.tif", "none.csv"))
    write_geojson(good, [(area(land), {"PolygonDateTime": EPOCH_MS, "Source": "WFIGS"})])
    write_mask(mask, land, np.eye(60), AT, 30.0)
    out = tmp_path / "out"
    common = ["--scenario", "default", "--out", str(out), "--json"]
    done = CliRunner().invoke(main, ["observe", str(good), str(mask), str(bad), *common])
    assert done.exit_code == 1
    first, second, third = json.loads(done.stdout)["files"]
    assert first["burned_cells"] == pytest.approx(1600, abs=80)
    assert first["observations"] == [
        {"state": "burned", "seen": AT.isoformat(), "source": "WFIGS", "position_sd_m": 20.0}
    ]
    assert (second["kind"], second["burned_cells"]) == ("raster", 60)
    assert "No such file" in third["error"]
    for each in (first, second):
        assert (out / each["picture"]).read_bytes().startswith(b"\x89PNG")
