"""``fire assimilate``: scores of forecasts from perimeter to perimeter, and bad input."""

import json
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from shapely.affinity import scale, translate
from shapely.geometry import box, mapping
from shapely.geometry.base import BaseGeometry

from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.readers.shapes import into_crs
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from tests.service.test_cli import call
from tests.service.test_fire_refusals import refused

CELLS, CELL_M = 80, 30.0
LAND = flat_landscape(CELLS, CELLS, CELL_M, 37.0, -120.0, 100.0, 2)
MIDDLE_M = LAND.xy_of(CELLS / 2, CELLS / 2)
RATE = 0.4  # of the simulated fire, relative to the model
ZERO = datetime(2021, 7, 1, 20, tzinfo=UTC)
TIMES_S = tuple(1800.0 + 1200.0 * number for number in range(4))
SCENARIO = """\
name = "a"
duration_s = 20000
[landscape]
source = "flat"
lat_deg = 37.0
lon_deg = -120.0
rows = 80
cols = 80
fuel_model = 2
[estimate]
members = 8
[[weather]]
at_s = 0
wind_speed_m_s = 3.0
wind_from_deg = 270
dead_1h_pct = 6
dead_10h_pct = 7
dead_100h_pct = 8
live_herb_pct = 60
live_woody_pct = 90
"""
KEYS = {"from", "to", "iou_estimate", "iou_free", "iou_persistence", "coverage_80"}
KEYS |= {"mean_distance_m_estimate", "mean_distance_m_persistence"}
Timed = tuple[float, BaseGeometry]  # time in s, area in the landscape's CRS


@cache
def mapped() -> tuple[Timed, ...]:
    """The perimeters of a fire that spreads more slowly than the model expects."""
    wind = WeatherStream([Weather(0.0, 3.0, 270.0, 6.0, 7.0, 8.0, 60.0, 90.0)])
    fire = AnyAngleFire(LAND, wind, [(CELLS // 2, CELLS // 3, 0.0)])
    fire.perturb(1.0, 0.0, RATE)
    fire.advance(TIMES_S[-1])
    return tuple((at_s, fire.front(at_s)) for at_s in TIMES_S)


def written(folder: Path, perimeters: tuple[Timed, ...], scenario: str = SCENARIO) -> list[str]:
    """Write the files of a command, and return its first arguments."""
    features = [
        {
            "type": "Feature",
            "properties": {"PolygonDateTime": (ZERO + timedelta(seconds=at_s)).isoformat()},
            "geometry": mapping(into_crs(area, LAND.crs, "EPSG:4326")),
        }
        for at_s, area in perimeters
    ]
    path, observed = folder / "a.toml", folder / "p.geojson"
    path.write_text(scenario)
    observed.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return ["assimilate", str(path), "--observations", str(observed)]


def run(
    folder: Path, perimeters: tuple[Timed, ...], *options: str, scenario: str = SCENARIO
) -> Result:
    result = call("fire", *written(folder, perimeters, scenario), "--json", *options)
    assert result.exit_code == 0, result.output
    return result


def scores(
    folder: Path, perimeters: tuple[Timed, ...], scenario: str = SCENARIO
) -> tuple[list[dict[str, Any]], str]:
    """The scores of the forecasts, and the warnings."""
    result = run(folder, perimeters, scenario=scenario)
    return json.loads(result.stdout)["intervals"], result.stderr


def test_the_estimate_beats_persistence_and_the_model_alone(tmp_path: Path) -> None:
    found, warnings = scores(tmp_path, mapped())
    assert len(found) == len(TIMES_S) - 1
    assert not warnings
    for each in found:
        assert each.keys() >= KEYS
        assert each["iou_estimate"] > max(each["iou_persistence"], each["iou_free"])
        assert each["mean_distance_m_estimate"] < each["mean_distance_m_persistence"]
        assert 0.0 <= each["coverage_80"] <= 1.0
    assert found[0]["from"] == (ZERO + timedelta(seconds=TIMES_S[0])).isoformat()
    assert found[-1]["to"] == (ZERO + timedelta(seconds=TIMES_S[-1])).isoformat()


def test_a_later_perimeter_changes_no_earlier_forecast(tmp_path: Path) -> None:
    fire = mapped()
    at_s, area = fire[-1]
    changed = (*fire[:-1], (at_s, scale(area, 1.7, 1.7)))
    one, other = scores(tmp_path, fire)[0], scores(tmp_path, changed)[0]
    assert one[:-1] == other[:-1]
    assert one[-1] != other[-1]


def test_pictures_and_geotiffs_are_written(tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    result = run(tmp_path, mapped()[:3], "-o", str(out))
    names = {each.name for each in out.iterdir()}
    assert {"assimilation.json", "forecast_01.png", "forecast_02.png"} <= names
    assert {f"burn_probability_{hours}h.tif" for hours in (1, 3, 6)} <= names
    assert not {"forecast_03.png"} & names
    assert json.loads((out / "assimilation.json").read_text()) == json.loads(result.stdout)


def test_threads_and_repetition_do_not_change_the_result(tmp_path: Path) -> None:
    found = {run(tmp_path, mapped()[:3], "--workers", n).stdout for n in ("1", "2", "2")}
    assert len(found) == 1
