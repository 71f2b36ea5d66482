"""Fronts, contours and bands as GeoJSON."""

import json
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry import shape

from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival, burning_from_perimeter
from mission_service.fire.run_ensemble import processed
from mission_service.interfaces.maps.fronts import (
    contours_geojson,
    front_geojson,
    probability_geojson,
)
from tests.maps.fires import NOW_S, WEATHER, estimated, fire, land, signed_area

TOUCH_DEG2 = 1e-11  # 0.1 m², because coordinates are rounded to a centimetre


def areas(collection: dict[str, Any]) -> list[Any]:
    return [shape(feature["geometry"]) for feature in collection["features"]]


def check_rfc_7946(feature: dict[str, Any]) -> None:
    """Check lon and lat with 7 decimals, closed rings, the right-hand rule, and valid JSON."""
    assert json.loads(json.dumps(feature, allow_nan=False)) == feature
    assert shape(feature["geometry"]).is_valid
    for outer, *holes in feature["geometry"]["coordinates"]:
        assert signed_area(outer) > 0.0 > max([signed_area(hole) for hole in holes], default=-1.0)
        for ring in (outer, *holes):
            assert ring[0] == ring[-1]
            assert all(round(value, 7) == value for place in ring for value in place)
        assert outer[0] == pytest.approx([-84.16, 36.35], abs=0.05)


def test_the_front_now_is_the_fires() -> None:
    burning = fire()
    found = front_geojson(burning.expected_s(), land(), NOW_S, NOW_S + 60.0, scheme="anyangle")
    check_rfc_7946(found)
    area = burning.front(NOW_S)
    assert found["properties"] == {
        "at_s": NOW_S,
        "at_us": 5_400_000_000,
        "in_s": -60.0,
        "area_ha": pytest.approx(area.area / 1e4, abs=1e-3),
        "area_acres": pytest.approx(area.area / 4046.856, rel=1e-3),
        "perimeter_m": pytest.approx(area.length, abs=0.1),
        "scheme": "anyangle",
    }
    outer = np.array(found["geometry"]["coordinates"][0][0])
    x_m, y_m = land().xy_of_lat_lon(outer[:, 1], outer[:, 0])
    assert shapely.distance(shapely.points(x_m, y_m), area.boundary).max() < 0.02


def test_contours_nest_the_latest_first() -> None:
    ahead = fire()
    ahead.advance(NOW_S + 5400.0)
    times = [NOW_S + 1800.0, NOW_S, NOW_S + 3600.0, 1000.0, NOW_S + 1800.0]
    collection = contours_geojson(ahead.expected_s(), land(), times, NOW_S)
    for feature in collection["features"]:
        check_rfc_7946(feature)
    hours = [feature["properties"]["in_s"] for feature in collection["features"]]
    assert hours == [3600.0, 1800.0, 0.0, 1000.0 - NOW_S]
    wide_to_narrow = areas(collection)
    for wide, narrow in pairwise(wide_to_narrow):
        assert narrow.difference(wide).area < TOUCH_DEG2
        assert wide.area > 1.2 * narrow.area


def test_bands_of_probability_nest_around_what_burns_now() -> None:
    ensemble = estimated().ensemble
    estimate = processed(ensemble.processed, ensemble.inputs_until(NOW_S))
    estimate.advance(NOW_S)
    share = estimate.forecast(NOW_S + 3600.0).burn_probability(NOW_S + 3600.0)
    collection = probability_geojson(share, land(), NOW_S + 3600.0, NOW_S)
    for feature in collection["features"]:
        check_rfc_7946(feature)
    levels = [feature["properties"]["probability"] for feature in collection["features"]]
    assert levels == [0.1, 0.5, 0.9]
    tenth, half, nine = areas(collection)
    assert half.difference(tenth).area < TOUCH_DEG2
    assert nine.difference(half).area < TOUCH_DEG2
    assert tenth.area > 1.2 * half.area > 1.2 * 1.1 * nine.area
    inside = shapely.contains_xy(nine, -84.16, 36.35)
    row, col = land().row_col_of(*land().xy_of_lat_lon(36.35, -84.16))
    assert bool(inside) == bool(share[round(float(row)), round(float(col))] >= 0.9)


def test_before_it_burns_there_is_no_front() -> None:
    found = front_geojson(fire().expected_s(), land(), -1.0, NOW_S)
    assert found["geometry"] == {"type": "MultiPolygon", "coordinates": []}
    assert found["properties"]["area_ha"] == 0.0


def test_a_fire_taken_over_keeps_its_outline() -> None:
    x_m, y_m = land().xy_of(50.0, 40.0)
    drawn = shapely.Point(x_m, y_m).buffer(200.0)
    burning = AnyAngleFire(land(), WEATHER, [], burning_from_perimeter([drawn], land(), 100.0))
    found = front_geojson(burning.expected_s(), land(), 100.0, 100.0, start_area=burning.start_area)
    assert found["properties"]["area_ha"] == pytest.approx(
        burning.front(100.0).area / 1e4, rel=1e-4
    )
    assert found["properties"]["area_ha"] > drawn.area / 1e4 - 1e-3
    before = front_geojson(burning.expected_s(), land(), 99.0, 100.0, start_area=burning.start_area)
    assert before["properties"]["area_ha"] == 0.0
    assert burning.front(99.0).is_empty


def test_a_fire_set_right_is_not_drawn_larger_in_its_past() -> None:
    """After a correction the fire restarts from arrival times, and its past is observed."""
    old = fire()
    begun = AnyAngleFire(
        land(), WEATHER, [], burning_from_arrival(old.arrival_time_s, land(), NOW_S)
    )
    for at_s in (2000.0, 4000.0):
        found = front_geojson(begun.expected_s(), land(), at_s, NOW_S, start_area=begun.start_area)[
            "properties"
        ]
        assert found["area_ha"] == pytest.approx(old.front(at_s).area / 1e4, rel=0.01)
        assert begun.front(at_s).area / 1e4 == pytest.approx(found["area_ha"], abs=1e-3)
