"""Files of fronts: KML with calendar times, and the QGIS style."""

import json
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.front_files import write_fronts
from firemodel.outputs.layer_legends import arrival_layer
from firemodel.spread.anyangle import AnyAngleFire
from tests.firemodel.grids import landscape, steady

KML = "{http://www.opengis.net/kml/2.2}"
ZERO = datetime(2026, 8, 1, 12, 0, tzinfo=UTC)
TIMES_S = [3600.0, 7200.0, 10_000.0]


def fire_round_a_rock(until_s: float = 10_000.0) -> AnyAngleFire:
    """Return a fire on 20 x 20 cells that has burned around a cell that cannot burn."""
    codes = np.full((20, 20), 1, dtype=np.int16)
    codes[9, 12] = 99
    fire = AnyAngleFire(landscape(codes), steady(), [(9, 9, 0.0)])
    fire.advance(until_s)
    return fire


def placemarks(path: Path) -> list[ElementTree.Element]:
    return ElementTree.parse(path).findall(f".//{KML}Placemark")


def text(element: ElementTree.Element, tag: str) -> str | None:
    return element.findtext(f".//{KML}{tag}")


def test_kml_has_calendar_times_that_follow_each_other(tmp_path: Path) -> None:
    write_fronts(tmp_path / "fronts.geojson", fire_round_a_rock(), TIMES_S, "rock & co", ZERO)
    found = placemarks(tmp_path / "fronts.kml")
    spans = [(text(each, "begin"), text(each, "end")) for each in found]
    assert spans == [
        ("2026-08-01T13:00:00+00:00", "2026-08-01T14:00:00+00:00"),
        ("2026-08-01T14:00:00+00:00", "2026-08-01T14:46:40+00:00"),
        ("2026-08-01T14:46:40+00:00", None),
    ]
    assert (text(found[0], "name") or "").startswith("2026-08-01 13:00 (1 h): ")
    root = ElementTree.parse(tmp_path / "fronts.kml").getroot()
    assert text(root, "name") == "rock & co"
    assert "Not for navigation" in (text(root, "description") or "")


def test_kml_without_a_date_has_no_times_and_states_why(tmp_path: Path) -> None:
    write_fronts(tmp_path / "fronts.geojson", fire_round_a_rock(), TIMES_S, "rock")
    found = placemarks(tmp_path / "fronts.kml")
    assert [text(each, "begin") for each in found] == [None] * 3
    assert "1970" not in (tmp_path / "fronts.kml").read_text(encoding="utf-8")
    root = ElementTree.parse(tmp_path / "fronts.kml").getroot()
    assert "no calendar date" in (text(root, "description") or "")


def test_kml_has_the_rings_of_the_geojson(tmp_path: Path) -> None:
    write_fronts(tmp_path / "fronts.geojson", fire_round_a_rock(), TIMES_S, "rock")
    features = json.loads((tmp_path / "fronts.geojson").read_text(encoding="utf-8"))["features"]
    for feature, placemark in zip(features, placemarks(tmp_path / "fronts.kml"), strict=True):
        rings = [ring for polygon in feature["geometry"]["coordinates"] for ring in polygon]
        edges = placemark.findall(f".//{KML}coordinates")
        assert [
            [[float(number) for number in pair.split(",")] for pair in (edge.text or "").split()]
            for edge in edges
        ] == rings
    assert len(placemark.findall(f".//{KML}innerBoundaryIs")) == 1  # the cell that cannot burn


def test_the_style_draws_later_areas_first_in_the_colours_of_the_raster(tmp_path: Path) -> None:
    write_fronts(tmp_path / "fronts.geojson", fire_round_a_rock(), TIMES_S, "rock")
    root = ElementTree.parse(tmp_path / "fronts.qml").getroot()
    (renderer,) = root.iter("renderer-v2")
    assert (renderer.get("attr"), renderer.get("enableorderby")) == ("time_s", "1")
    (order,) = root.iter("orderByClause")
    assert (order.text, order.get("asc")) == ('"time_s"', "0")
    classes = arrival_layer(0.0, TIMES_S[-1], None).classes
    assert [each.get("label") for each in root.iter("range")] == [each.label for each in classes]
    colours = [each.get("value") for each in root.iter("Option") if each.get("name") == "color"]
    assert colours == ["{},{},{},255".format(*each.rgb) for each in classes]


def test_the_origin_of_times_is_in_each_feature(tmp_path: Path) -> None:
    for zero, words in ((ZERO, "2026-08-01T12:00:00+00:00"), (None, "no calendar date")):
        write_fronts(tmp_path / "fronts.geojson", fire_round_a_rock(), TIMES_S, "rock", zero)
        for feature in json.loads((tmp_path / "fronts.geojson").read_text())["features"]:
            assert words in feature["properties"]["time_s_origin"]


def test_equal_fires_give_equal_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_fronts(tmp_path / f"{name}.geojson", fire_round_a_rock(), TIMES_S, "rock", ZERO)
    for suffix in ("geojson", "kml", "qml"):
        assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()


def test_a_folder_under_the_name_is_refused_without_remains(tmp_path: Path) -> None:
    (tmp_path / "fronts.geojson").mkdir()
    with pytest.raises(FireModelError, match=r"fronts\.geojson: cannot be written: "):
        write_fronts(tmp_path / "fronts.geojson", fire_round_a_rock(), TIMES_S, "rock")
    assert [each.name for each in tmp_path.iterdir()] == ["fronts.geojson"]


def test_a_front_has_the_class_of_the_cells_that_burn_until_its_time(tmp_path: Path) -> None:
    fire = AnyAngleFire(landscape(shape=(20, 20)), steady(), [(9, 9, 0.0)])
    fire.advance(4 * 3600.0)
    write_fronts(tmp_path / "fronts.geojson", fire, [3600.0, 14_400.0], "flat")
    found = [text(each, "styleUrl") for each in placemarks(tmp_path / "fronts.kml")]
    assert found == ["#class0", "#class3"]
    root = ElementTree.parse(tmp_path / "fronts.qml").getroot()
    labels = [each.get("label") for each in root.iter("range")]
    assert labels == ["0–1 h", "1–2 h", "2–3 h", "3–4 h"]


def test_a_fire_across_the_antimeridian_is_cut_there(tmp_path: Path) -> None:
    land = flat_landscape(60, 60, 30.0, 10.0, 179.9999)
    fire = AnyAngleFire(land, steady(), [(30, 30, 0.0)])
    fire.advance(3600.0)
    write_fronts(tmp_path / "fronts.geojson", fire, [3600.0], "date line")
    (feature,) = json.loads((tmp_path / "fronts.geojson").read_text())["features"]
    rings = [np.array(polygon[0]) for polygon in feature["geometry"]["coordinates"]]
    assert sorted(np.sign(ring[:, 0]).mean() for ring in rings) == [-1.0, 1.0]
    metres = [shapely.Polygon(land_xy(land, ring)).area for ring in rings]
    assert sum(metres) == pytest.approx(fire.front(3600.0).area, rel=1e-4)


def land_xy(land: Landscape, ring: Floats) -> Floats:
    return np.column_stack(land.xy_of_lat_lon(ring[:, 1], ring[:, 0]))
