"""``fire assimilate``: scores of forecasts between perimeters, and invalid input."""

import json
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from shapely.affinity import scale, translate
from shapely.geometry import box, mapping
from shapely.geometry.base import BaseGeometry

from firemodel.assimilation.fire_estimate import EstimateSettings, FireEstimate
from firemodel.assimilation.observation import mapped_perimeter
from firemodel.errors import FireModelError
from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.readers.shapes import into_crs
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from tests.service.test_cli import call
from tests.service.test_fire_refusals import refused

CELLS, CELL_M = 80, 30.0
LAND = flat_landscape(CELLS, CELLS, CELL_M, 37.0, -120.0, 100.0, 2)
WIND = WeatherStream([Weather(0.0, 3.0, 270.0, 6.0, 7.0, 8.0, 60.0, 90.0)])
MIDDLE_M = LAND.xy_of(CELLS / 2, CELLS / 2)
WHOLE = box(*(LAND.xy_of(100, -20)), *(LAND.xy_of(-20, 100)))  # larger than the landscape
RATE = 0.4  # spread rate of the simulated fire, relative to the model
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
    """Return the perimeters of a fire that spreads more slowly than the model expects."""
    fire = AnyAngleFire(LAND, WIND, [(CELLS // 2, CELLS // 3, 0.0)])
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
    """Return the scores of the forecasts, and the warnings."""
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


def test_a_forecast_does_not_learn_from_later_perimeters() -> None:
    estimate = FireEstimate(LAND, WIND, settings=EstimateSettings(8, 5))
    first, second, third = (mapped_perimeter(area, LAND, at_s) for at_s, area in mapped()[:3])
    estimate.assimilate(first)
    estimate.assimilate(second)
    forecast = estimate.forecast(third.at_s)
    before = forecast.burn_probability(third.at_s)
    estimate.assimilate(third)
    np.testing.assert_array_equal(forecast.burn_probability(third.at_s), before)


def test_a_refused_perimeter_changes_no_rates() -> None:
    one, other = (FireEstimate(LAND, WIND, settings=EstimateSettings(8, 5)) for _ in range(2))
    for each in (one, other):
        for at_s, area in mapped()[:2]:
            each.assimilate(mapped_perimeter(area, LAND, at_s))
    whole = mapped_perimeter(WHOLE, LAND, TIMES_S[2], source="map 3")
    with pytest.raises(FireModelError, match="map 3: burning: no outline"):
        one.assimilate(whole)
    until_s = TIMES_S[3]
    np.testing.assert_array_equal(
        one.forecast(until_s).burn_probability(until_s),
        other.forecast(until_s).burn_probability(until_s),
    )


def test_without_a_usable_perimeter_the_command_ends_in_one_line(tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = written(tmp_path, tuple((at_s, WHOLE) for at_s in TIMES_S))
    assert "contains no usable perimeter" in refused(1, *command, "-o", str(out))
    assert not out.exists()


def test_a_perimeter_without_a_cell_is_left_out(tmp_path: Path) -> None:
    west_m = LAND.west_m
    sliver = box(west_m - 500.0, MIDDLE_M[1] - 90.0, west_m + 5.0, MIDDLE_M[1] + 90.0)
    fire = mapped()[:3]
    found, warnings = scores(tmp_path, ((0.0, sliver), *fire))
    assert len(found) == 2
    assert "contains no cell of the landscape; check its position; it is skipped" in warnings


def test_distances_are_measured_on_the_landscape(tmp_path: Path) -> None:
    x_m, y_m = LAND.west_m, MIDDLE_M[1]
    large = tuple(
        (at_s, box(x_m - 9000.0, y_m - 9000.0, x_m + 200.0 + number * 60.0, y_m + 9000.0))
        for number, at_s in enumerate(TIMES_S[:2])
    )
    (found,) = scores(tmp_path, large)[0]
    assert found["observed_ha"] < (CELLS * CELL_M) ** 2 / 1e4
    assert found["mean_distance_m_estimate"] < 200.0


def test_pictures_of_an_earlier_run_are_removed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    stale = out / "forecast_07.png"
    stale.write_bytes(b"")
    run(tmp_path, mapped()[:2], "-o", str(out))
    assert (out / "forecast_01.png").exists()
    assert not stale.exists()


def test_unused_keys_and_early_perimeters_are_warned_of(tmp_path: Path) -> None:
    (tmp_path / "lit.geojson").write_text("{}")
    head = f"time_zero = {(ZERO + timedelta(hours=8)).isoformat()}\n"
    scenario = head + SCENARIO + '[fire]\nperimeter = "lit.geojson"\n'
    warnings = scores(tmp_path, mapped()[:2], scenario)[1]
    assert "fire.perimeter is not used" in warnings
    assert "2 of 2 perimeters are before time_zero" in warnings


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda area: translate(area, 3e6, 0.0), "lies outside the landscape"),
        (lambda area: scale(area, -1.0, 1.0, origin=MIDDLE_M), "of the area that had burned"),
        (lambda area: WHOLE, "no outline of the perimeter"),
    ],
)
def test_an_implausible_perimeter_is_left_out(tmp_path: Path, change: Any, words: str) -> None:
    fire = mapped()[:4]
    wrong = (*fire[:2], (fire[2][0], change(fire[2][1])), fire[3])
    found, warnings = scores(tmp_path, wrong)
    assert words in warnings
    assert len(found) == 2
    assert found[1]["from"] == (ZERO + timedelta(seconds=TIMES_S[1])).isoformat()


def test_a_wrong_first_perimeter_is_named(tmp_path: Path) -> None:
    first, *others = mapped()[:3]
    mirrored = first[0], scale(first[1], -1.0, 1.0, origin=MIDDLE_M)
    found, warnings = scores(tmp_path, (mirrored, *others))
    assert not found
    assert "no perimeter agrees with the first" in warnings


def test_the_date_of_the_scenario_may_be_years_wrong(tmp_path: Path) -> None:
    head = f"time_zero = {ZERO.replace(year=2011).isoformat()}\n"
    lit = "[[ignition]]\nlat_deg = 37.0\nlon_deg = -120.0045\n"
    result = run(tmp_path, mapped()[:3], scenario=head + SCENARIO + lit)
    assert "NaN" not in result.stdout
    assert "RuntimeWarning" not in result.stderr


def test_errors_of_the_wind_are_wide_unless_the_scenario_states_them(tmp_path: Path) -> None:
    stated = "\n[ensemble]\nwind_log_sd = 0.5\nwind_turn_sd_deg = 30\nspread_log_sd = 0.3\n"
    narrow = "\n[ensemble]\nwind_log_sd = 0.05\nspread_log_sd = 0.05\n"
    default, wide, other = (
        scores(tmp_path, mapped()[:2], SCENARIO + added)[0] for added in ("", stated, narrow)
    )
    assert default == wide
    assert default != other
