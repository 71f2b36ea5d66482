"""Files for other programs."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from shapely.geometry import shape

from firemodel.writers import perimeters_geojson, write_geotiff, write_perimeters
from tests.firemodel.grids import CRS, landscape

LAND = landscape(shape=(6, 7))
ARRIVAL_S = np.full((6, 7), np.inf)
ARRIVAL_S[1:4, 1:4] = 100.0
ARRIVAL_S[2, 2] = 300.0  # burns later than all around it
ARRIVAL_S[2, 4] = 200.0


def test_a_geotiff_lies_on_the_grid(tmp_path: Path) -> None:
    values = np.where(np.isinf(ARRIVAL_S), -1.0, ARRIVAL_S)
    write_geotiff(tmp_path / "arrival.tif", values, LAND, nodata=-1.0)
    with rasterio.open(tmp_path / "arrival.tif") as file:
        assert (file.crs.to_string(), file.nodata) == (CRS, -1.0)
        assert file.transform == LAND.transform()
        assert np.array_equal(file.read(1), values)


def rings(feature: dict[str, Any]) -> list[Any]:
    return [ring for polygon in feature["geometry"]["coordinates"] for ring in polygon]


def signed_area(ring: Any) -> float:
    x, y = np.array(ring).T
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def test_perimeters_are_rfc_7946(tmp_path: Path) -> None:
    path = tmp_path / "perimeters.geojson"
    write_perimeters(path, ARRIVAL_S, LAND, [0.0, 100.0, 300.0])
    found = json.loads(path.read_text(encoding="utf-8"))
    assert found["type"] == "FeatureCollection"
    nothing, ring, all_burned = found["features"]
    assert nothing["geometry"] == {"type": "MultiPolygon", "coordinates": []}
    outer, hole = rings(ring)
    assert signed_area(outer) > 0 > signed_area(hole)  # right-hand rule
    assert outer[0] == outer[-1]
    assert len(rings(all_burned)) == 1
    for feature in (ring, all_burned):
        assert shape(feature["geometry"]).is_valid
    lon_deg, lat_deg = outer[0]
    assert (lon_deg, lat_deg) == pytest.approx((-87.0, 36.14), abs=0.01)


def test_perimeters_tell_time_and_area() -> None:
    ten_cells = perimeters_geojson(ARRIVAL_S, LAND, [300.0])["features"][0]["properties"]
    assert ten_cells == {"time_s": 300.0, "area_ha": 0.9, "GISAcres": 2.22}
