"""Files for other programs."""

import json
import math
import warnings
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from pyproj import Proj
from shapely.geometry import shape

from firemodel.errors import FireModelError
from firemodel.outputs.arrival_map import draw_map
from firemodel.outputs.front_files import fronts_geojson, write_fronts
from firemodel.outputs.geotiff import write_rasters
from firemodel.outputs.netcdf import write_netcdf
from tests.firemodel.test_front_files import fire_round_a_rock


def signed_area(ring: Any) -> float:
    x, y = np.array(ring).T
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def test_fronts_are_rfc_7946(tmp_path: Path) -> None:
    path = tmp_path / "fronts.geojson"
    write_fronts(path, fire_round_a_rock(15_000.0), [0.0, 15_000.0], "rock")
    found = json.loads(path.read_text(encoding="utf-8"))
    assert found["type"] == "FeatureCollection"
    for feature in found["features"]:
        assert shape(feature["geometry"]).is_valid
    (polygon,) = found["features"][1]["geometry"]["coordinates"]
    outer, hole = polygon
    assert signed_area(outer) > 0 > signed_area(hole)  # right-hand rule
    assert outer[0] == outer[-1]
    lon_deg, lat_deg = outer[0]
    assert (lon_deg, lat_deg) == pytest.approx((-87.0, 36.14), abs=0.01)


def test_fronts_have_time_area_and_a_note_that_they_are_not_approved() -> None:
    fire = fire_round_a_rock(15_000.0)
    zero = datetime(2026, 8, 1, 12, 0, tzinfo=UTC)
    (feature,) = fronts_geojson(fire, [15_000.0], "rock", zero)["features"]
    area_m2 = fire.front(15_000.0).area
    lat, lon = fire.landscape.centre_lat_lon
    projected = Proj(fire.landscape.crs).get_factors(lon, lat).areal_scale
    properties = feature["properties"]
    acres = properties.pop("GISAcres")  # on the ellipsoid
    assert acres == pytest.approx(area_m2 / projected / 4046.8564224, abs=0.006)
    assert properties == {
        "IncidentName": "rock",
        "FeatureCategory": "Wildfire Daily Fire Perimeter",
        "MapMethod": "Modeled",
        "FeatureStatus": "Proposed",
        "area_ha": round(area_m2 / 1e4, 2),
        "time_s": 15_000.0,
        "time_s_origin": "seconds after mission time 0, 2026-08-01T12:00:00+00:00",
        "PolygonDateTime": 1_785_585_600_000 + 15_000_000,
    }
    assert area_m2 == pytest.approx(np.count_nonzero(fire.burned()) * 900.0, rel=0.05)
    assert "PolygonDateTime" not in fronts_geojson(fire, [0.0], "rock")["features"][0]["properties"]


def test_rasters_hold_what_burned(tmp_path: Path) -> None:
    fire = fire_round_a_rock(15_000.0)
    paths = write_rasters(tmp_path, fire)
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{name}.{suffix}" for name in paths for suffix in ("tif", "qml")
    }
    for name in paths.keys() - {"state", "fuel_model"}:
        with rasterio.open(paths[name]) as file:
            assert np.array_equal(file.read_masks(1) > 0, fire.burned())
    with rasterio.open(paths["arrival_time_s"]) as file:
        burned = fire.burned()
        np.testing.assert_allclose(file.read(1)[burned], fire.arrival_time_s[burned], rtol=1e-6)
    with rasterio.open(paths["state"]) as file:
        assert np.array_equal(file.read(1), fire.state_at(fire.time_s))


def test_fronts_are_written_to_a_path_given_as_text_or_fail_in_one_line(tmp_path: Path) -> None:
    path, fire = tmp_path / "fronts.geojson", fire_round_a_rock(15_000.0)
    write_fronts(str(path), fire, [0.0], "rock")
    assert json.loads(path.read_text(encoding="utf-8"))["features"]
    with pytest.raises(FireModelError, match=r"fronts: cannot be written: No such file .*; use"):
        write_fronts(tmp_path / "missing" / "fronts", fire, [0.0], "rock")


@pytest.mark.parametrize(
    ("times_s", "text"),
    [
        ([math.nan], r"times_s\[0\] is nan; it must be a number"),
        ([600.0, math.inf], r"times_s\[1\] is inf"),
        ([600.0, 300.0], r"times_s\[1\] = 300.0 is not later than 600.0; sort the times"),
        ([600.0, 600.0], "remove duplicates"),
    ],
)
def test_times_must_be_finite_and_increase(tmp_path: Path, times_s: list[float], text: str) -> None:
    fire = fire_round_a_rock()
    for write, name in ((write_fronts, "fronts.geojson"), (write_netcdf, "fire.nc")):
        with pytest.raises(FireModelError, match=text):
            write(tmp_path / name, fire, times_s, "rock")
    assert not list(tmp_path.iterdir())


def test_each_writer_names_the_file_that_it_cannot_write(tmp_path: Path) -> None:
    fire, missing = fire_round_a_rock(), tmp_path / "missing"
    for name, write in (
        ("arrival_time_s.tif", lambda: write_rasters(missing, fire)),
        ("fronts.geojson", lambda: write_fronts(missing / "fronts.geojson", fire, [60.0], "x")),
        ("fire.nc", lambda: write_netcdf(missing / "fire.nc", fire, [60.0], "x")),
        ("map.png", lambda: draw_map(missing / "map.png", fire, "x")),
    ):
        with pytest.raises(FireModelError, match=f"missing/{name}: cannot be written: "):
            write()
    (tmp_path / "map.png").mkdir()
    with pytest.raises(FireModelError, match=r"map.png: cannot be written: Is a directory"):
        draw_map(tmp_path / "map.png", fire, "x")


@pytest.mark.parametrize("title", ["火災 🔥 नमस्ते", "long " * 200, "m\tx", "$x_1$ \\frac"])
def test_unusual_titles_give_no_warnings(tmp_path: Path, title: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw_map(tmp_path / "map.png", fire_round_a_rock(), title)
