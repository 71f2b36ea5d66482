"""Places near people and values at risk: their cells, names, and invalid files."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firemodel.landscape.default import jacksboro
from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.landscape import Landscape
from mission_service.config.service_section import FireArrivalSection
from mission_service.errors import ScenarioError
from mission_service.fire_arrival.people import MAX_PEOPLE, MAX_POSITION_AGE_S, People, Person
from mission_service.fire_arrival.places import person_places, values_in
from mission_service.live.fire_arrival_watch import values_of

LAND = flat_landscape(60, 80, 30.0, 37.0, -120.0)
SHAPE = LAND.shape


def place_of(row: float, col: float, land: Landscape = LAND) -> tuple[float, float]:
    lat_deg, lon_deg = land.lat_lon_of(*land.xy_of(row, col))
    return float(lat_deg), float(lon_deg)


def person(row: float, col: float, uid: str = "p", at_unix_us: int = 0) -> Person:
    return Person(uid, uid.upper(), *place_of(row, col), at_unix_us)


def written(path: Path, *features: tuple[str | None, str, Any], land: Landscape = LAND) -> Path:
    """Write features (name, type, coordinates as rows and columns) as GeoJSON."""

    def lon_lat(places: Any) -> Any:
        if isinstance(places[0], int | float):
            lat_deg, lon_deg = place_of(places[0], places[1], land)
            return [lon_deg, lat_deg]
        return [lon_lat(each) for each in places]

    found = [
        {
            "type": "Feature",
            "properties": {} if name is None else {"name": name},
            "geometry": {"type": kind, "coordinates": lon_lat(coordinates)},
        }
        for name, kind, coordinates in features
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": found}))
    return path


def test_a_person_is_near_the_cells_within_the_distance() -> None:
    (place,) = person_places([person(20, 30)], LAND, 65.0)
    row, col = np.unravel_index(place.cells, SHAPE)
    distance_m = 30.0 * np.hypot(row - 20, col - 30)
    assert len(place.cells) == 13  # within two cells and a little: a full ring of radius 2
    assert distance_m.max() <= 65.0
    assert (place.key, place.name, place.kind, place.at_unix_us) == ("person/p", "P", "person", 0)


def test_without_a_distance_a_person_is_near_its_own_cell() -> None:
    (place,) = person_places([person(20.3, 30.4)], LAND, 0.0)
    assert 20 * SHAPE[1] + 30 in place.cells.tolist()
    assert len(place.cells) <= 2


def test_people_off_the_landscape_have_no_place() -> None:
    people = [person(-10, 5, "off"), person(59, 79, "corner")]
    assert [each.key for each in person_places(people, LAND, 50.0)] == ["person/corner"]


def test_values_are_read_with_their_names(tmp_path: Path) -> None:
    path = written(
        tmp_path / "values.geojson",
        ("Main  Street", "LineString", [(10, 5), (10, 40)]),
        (None, "Polygon", [[(30, 30), (30, 40), (40, 40), (40, 30), (30, 30)]]),
        ("far", "Point", (500, 500)),
    )
    road, area = values_in(path, LAND, 10.0)
    assert (road.key, road.name, road.kind) == ("value/values/1", "Main Street", "value")
    assert set(np.unravel_index(road.cells, SHAPE)[0].tolist()) == {10}
    assert len(road.cells) == 36
    assert area.name == "values 2"
    assert 35 * SHAPE[1] + 35 in area.cells.tolist()  # also in the middle


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("", "is not GeoJSON"),
        ('{"type": "FeatureCollection", "features": []}', "has no features"),
    ],
)
def test_files_without_values_are_refused(tmp_path: Path, content: str, problem: str) -> None:
    path = tmp_path / "bad.geojson"
    path.write_text(content)
    with pytest.raises(ScenarioError, match=problem) as error:
        values_in(path, LAND, 10.0)
    assert "\n" not in str(error.value)


def test_a_file_of_another_area_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "far.geojson", ("far", "Point", (5000, 500)))
    with pytest.raises(ScenarioError, match=r"far\.geojson: no feature lies on the landscape"):
        values_in(path, LAND, 10.0)
    with pytest.raises(ScenarioError, match="No such file"):
        values_in(tmp_path / "none.geojson", LAND, 10.0)


def test_positions_are_replaced_by_newer_ones_and_removed_after_an_hour() -> None:
    people = People()
    people.update_position(person(1, 1, at_unix_us=5))
    people.update_position(person(2, 2, at_unix_us=4))
    assert people.current(10) == [person(1, 1, at_unix_us=5)]
    assert people.current(round(MAX_POSITION_AGE_S * 1e6) + 6) == []
    for number in range(MAX_PEOPLE + 3):
        people.update_position(person(1, 1, f"p{number:05d}"))
    found = people.current(0)
    assert len(found) == MAX_PEOPLE
    assert found[0].uid == "p00003"


@pytest.mark.parametrize("where", [(0.0, 180.0), (0.0, -180.0), (90.0, 0.0), (-37.0, 60.0)])
def test_a_person_on_the_other_side_of_the_earth_has_no_place(where: tuple[float, float]) -> None:
    land = jacksboro(40, 40, 30.0)
    assert person_places([Person("p", "P", *where, 0)], land, 50.0) == []


@pytest.mark.parametrize("place", [[756000.0, 4028000.0], [1e300, 36.0], [180.0, 0.0]])
def test_coordinates_that_cannot_be_projected_are_off_the_landscape(
    tmp_path: Path, place: list[float]
) -> None:
    path = tmp_path / "utm.geojson"
    path.write_text(json.dumps({"type": "Point", "coordinates": place}))
    with pytest.raises(ScenarioError, match="no feature lies on the landscape"):
        values_in(path, jacksboro(40, 40, 30.0), 50.0)


@pytest.mark.parametrize(
    ("name", "shown"), [("\ud800", "values 1"), ("a\0\u202e b\n", "a b"), ("\u00c4 1", "\u00c4 1")]
)
def test_a_name_has_only_printable_characters(tmp_path: Path, name: str, shown: str) -> None:
    path = written(tmp_path / "values.geojson", (name, "Point", (10, 5)))
    assert [each.name for each in values_in(path, LAND, 10.0)] == [shown]


def test_points_and_lines_of_kml_are_values(tmp_path: Path) -> None:
    (south, west), (north, east) = place_of(30, 10), place_of(10, 40)
    path = tmp_path / "houses.kml"
    path.write_text(
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
        "<Placemark><name>Mill</name><Point><coordinates>"
        f"{west},{south},12</coordinates></Point></Placemark>"
        "<Placemark><name>Road</name><LineString><coordinates>"
        f"{west},{south} {east},{north}</coordinates></LineString></Placemark>"
        "</Document></kml>"
    )
    mill, road = values_in(path, LAND, 0.0)
    assert (mill.name, road.name) == ("Mill", "Road")
    assert 30 * SHAPE[1] + 10 in mill.cells
    assert len(mill.cells) <= 4 < len(road.cells)


def test_files_of_equal_names_have_different_keys(tmp_path: Path) -> None:
    paths = []
    for folder, name in (("east", "Mill"), ("west", "Farm")):
        (tmp_path / folder).mkdir()
        paths.append(written(tmp_path / folder / "houses.geojson", (name, "Point", (10, 5))))
    roads = written(tmp_path / "roads.geojson", ("Main Street", "LineString", [(10, 5), (10, 40)]))
    values = values_of(FireArrivalSection(values=(*paths, roads)), LAND)
    assert [each.key for each in values] == [
        "value/houses-1/1",
        "value/houses-2/1",
        "value/roads/1",
    ]
