"""``fire run``, ``fire info`` and ``bench fire``: from input files to output files."""

import json
import math
import shutil
from itertools import pairwise
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from shapely.geometry import LineString, shape

from tests.firemodel.grids import CELL_M, CRS, write_raster
from tests.firemodel.test_rasters import ascii_grid
from tests.service.fires import (
    COL,
    CSV,
    FILES,
    HEIGHTS,
    LAND,
    LIT,
    POINT,
    ROW,
    SIZE,
    TIFFS,
    drawn,
    on_grid,
    write_scenario,
    write_site,
)
from tests.service.test_cli import call

RASTERS = (
    "arrival_time_s",
    "spread_rate_m_s",
    "spread_toward_deg",
    "flame_length_m",
    "fireline_intensity_kw_m",
)
NAMES = {"fronts.geojson", "fronts.kml", "fronts.qml", "map.png", "summary.json"}.union(
    *({f"{name}.tif", f"{name}.qml"} for name in (*RASTERS, "state", "fuel_model"))
)
WALL = TIFFS + 'barriers = ["wall.geojson"]\n'


def burn(scenario: Path, out: Path, *options: str) -> dict[str, Any]:
    """Return the summary of a run that must succeed."""
    result = call("fire", "run", str(scenario), "-o", str(out), "--json", *options)
    assert result.exit_code == 0, result.output
    found: dict[str, Any] = json.loads(result.stdout)
    return found


def raster(path: Path) -> NDArray[np.float32]:
    with rasterio.open(path) as file:
        values: NDArray[np.float32] = file.read(1)
    return values


def arrival_s(out: Path) -> NDArray[np.float32]:
    """Return the arrival times; -1 in unburned cells."""
    return raster(out / "arrival_time_s.tif")


def fronts(out: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((out / "fronts.geojson").read_text())["features"]
    return found


def test_two_geotiffs_weather_ignition_and_a_barrier_give_all_files(tmp_path: Path) -> None:
    site, out = write_site(tmp_path), tmp_path / "deep" / "out"
    wall = LineString([on_grid(-5, 26), on_grid(SIZE + 5, 30)])
    drawn(site / "wall.geojson", wall)
    scenario = write_scenario(site, WALL, CSV, POINT)
    summary = burn(scenario, out, "--front-every", "600")
    assert {path.name for path in out.iterdir()} == NAMES
    for name in RASTERS:
        with rasterio.open(out / f"{name}.tif") as file:
            assert (file.crs.to_string(), file.shape) == (CRS, (SIZE, SIZE))
            assert file.transform == LAND.transform()
            assert (file.dtypes, file.nodata) == (("float32",), -1.0)
    arrival = arrival_s(out)
    assert arrival[LIT] == 0.0
    assert (arrival[COL > 30] == -1).all()
    assert (arrival[(COL > 22) & (COL < 27)] > 0).any()
    found = fronts(out)
    assert [front["properties"]["time_s"] for front in found] == list(range(600, 3601, 600))
    areas = [shape(front["geometry"]) for front in found]
    for before, after in pairwise(areas):
        assert after.area > before.area
        assert before.difference(after).area < 1e-4 * before.area
    assert summary == json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["cells"] == SIZE * SIZE
    assert summary["burned_cells"] == np.count_nonzero(arrival >= 0)
    assert summary["burned_area_ha"] == found[-1]["properties"]["area_ha"]
    for area in ("burned_area_ha", "interpolated_area_ha"):
        assert summary[area] == pytest.approx(summary["burned_cells"] * 0.09, rel=0.05)
    assert (summary["scenario"], summary["scheme"], summary["time_s"]) == (
        "small",
        "anyangle",
        3600.0,
    )
    burn(write_scenario(site, TIFFS, CSV, POINT), tmp_path / "open")
    assert (arrival_s(tmp_path / "open")[COL > 30] > 0).any()


def test_a_stack_by_its_bands_and_units(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    percent = np.round(100.0 * LAND.slope_tan).astype(np.int16)
    aspect = np.round(LAND.aspect_deg).astype(np.int16)
    write_raster(site / "stack.tif", np.stack([aspect, percent, LAND.fuel_model]))
    stack = FILES + 'file = "stack.tif"\nbands = {fuel = 3, slope = 2, aspect = 1}\n'
    scenario = write_scenario(site, stack + 'units = {slope = "percent"}\n', CSV, POINT)
    stacked = burn(scenario, tmp_path / "stacked")
    two = burn(write_scenario(site), tmp_path / "two")
    assert stacked["burned_cells"] == pytest.approx(two["burned_cells"], rel=0.02)
    steeper = write_scenario(site, stack + 'units = {slope = "degrees"}\n', CSV, POINT)
    # Most of the burned area is downhill of the ignition.
    assert burn(steeper, tmp_path / "steeper")["burned_cells"] < 0.95 * two["burned_cells"]


def test_ascii_grids_with_a_crs_given(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    ascii_grid(site / "fuel.asc", LAND.fuel_model)
    ascii_grid(site / "dem.asc", HEIGHTS)
    pair = FILES + 'fuel = "fuel.asc"\nelevation = "dem.asc"\n'
    refused = call("fire", "run", str(write_scenario(site, pair, CSV, POINT)), "-o", str(site))
    assert refused.exit_code == 1
    assert "fuel.asc: has no CRS" in refused.stderr
    scenario = write_scenario(site, pair + f'crs = "{CRS}"\n', CSV, POINT)
    burn(scenario, tmp_path / "ascii")
    burn(write_scenario(site), tmp_path / "tiff")
    assert np.array_equal(arrival_s(tmp_path / "ascii"), arrival_s(tmp_path / "tiff"))


def kml(path: Path, ring: list[tuple[float, float]]) -> Path:
    text = " ".join(f"{lon},{lat},0" for lon, lat in ring)
    path.write_text(
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><Polygon>'
        f"<outerBoundaryIs><LinearRing><coordinates>{text}</coordinates></LinearRing>"
        "</outerBoundaryIs></Polygon></Placemark></Document></kml>",
        encoding="utf-8",
    )
    return path


@pytest.mark.parametrize("kind", ["geojson", "kml"])
def test_a_fire_taken_over_from_a_perimeter(tmp_path: Path, kind: str) -> None:
    site, out = write_site(tmp_path), tmp_path / "out"
    area = on_grid(30, 20).buffer(6 * CELL_M)
    drawn(site / "area.geojson", area)
    kml(
        site / "area.kml",
        json.loads((site / "area.geojson").read_text())["features"][0]["geometry"]["coordinates"][
            0
        ],
    )
    taken = f'[fire]\nperimeter = "area.{kind}"\nburning_at_s = 1800\n'
    burn(write_scenario(site, TIFFS, CSV, taken), out, "--front-every", "600")
    arrival = arrival_s(out)
    inside = np.hypot(ROW - 30, COL - 20) < 5.9
    assert (arrival[inside] == 1800).all()
    assert (arrival[(arrival >= 0) & (np.hypot(ROW - 30, COL - 20) > 6.1)] > 1800).all()
    assert [front["properties"]["time_s"] for front in fronts(out)] == [2400, 3000, 3600]
    assert fronts(out)[0]["properties"]["area_ha"] > area.area / 1e4


def test_a_fire_taken_over_from_arrival_in_hours_goes_on_as_the_first(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    whole = burn(write_scenario(site), tmp_path / "whole")
    first = arrival_s(tmp_path / "whole")
    hours = np.where(first < 0, -9999.0, first / 3600.0)
    write_raster(site / "arrival.tif", hours, nodata=-9999.0)
    taken = '[fire]\narrival = "arrival.tif"\narrival_unit = "hours"\nburning_at_s = 1800\n'
    rest = burn(write_scenario(site, TIFFS, CSV, taken), tmp_path / "rest")
    before = (first >= 0) & (first <= 1800)
    assert arrival_s(tmp_path / "rest")[before] == pytest.approx(first[before], abs=0.01)
    assert rest["burned_area_ha"] == pytest.approx(whole["burned_area_ha"], rel=0.02)


@pytest.mark.parametrize("scheme", ["anyangle", "devs8", "probabilistic"])
def test_the_same_scenario_gives_the_same_files_by_every_scheme(
    tmp_path: Path, scheme: str
) -> None:
    scenario = write_scenario(write_site(tmp_path))
    options = ("--set", f"fire.scheme={scheme}", "--set", "fire.p_spread=0.3")
    summaries = [burn(scenario, tmp_path / name, *options) for name in "ab"]
    assert summaries[0] == summaries[1]
    assert summaries[0]["scheme"] == scheme
    assert summaries[0]["burned_cells"] > 20
    for name in RASTERS:
        one, other = (raster(tmp_path / run / f"{name}.tif") for run in "ab")
        assert one.tobytes() == other.tobytes()
    for name in ("fronts.geojson", "summary.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    if scheme == "probabilistic":
        burn(scenario, tmp_path / "c", *options, "--set", "seed=6")
        assert not np.array_equal(arrival_s(tmp_path / "a"), arrival_s(tmp_path / "c"))


def test_what_is_printed_without_json(tmp_path: Path) -> None:
    scenario, out = write_scenario(write_site(tmp_path)), tmp_path / "out"
    options = ("--set", "duration_s=1200", "--front-every", "500")
    result = call("fire", "run", str(scenario), "-o", str(out), *options)
    assert result.exit_code == 0, result.output
    assert "burned_area_ha: " in result.stdout
    assert f"summary.json to {out}/" in result.stdout
    assert [front["properties"]["time_s"] for front in fronts(out)] == [500, 1000, 1200]


@pytest.mark.parametrize(
    "command",
    [
        ("sim", "FIRE", "--out", "OUT"),
        ("run", "FIRE"),
        ("plan", "FIRE", "-o", "OUT/x.plan"),
        ("mock", "FIRE"),
    ],
)
def test_nothing_flies_in_a_scenario_without_vehicles(
    tmp_path: Path, command: tuple[str, ...]
) -> None:
    scenario = write_scenario(write_site(tmp_path))
    names = {"FIRE": str(scenario), "OUT": str(tmp_path), "OUT/x.plan": str(tmp_path / "x.plan")}
    result = call(*(names.get(word, word) for word in command))
    assert result.exit_code == 1
    assert "small has no vehicles" in result.stderr
    assert result.stderr.count("\n") == 1


def test_info_reports_good_files_and_exits_with_zero(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    words = (f"fuel={site / 'fuel.tif'}", f"elevation={site / 'dem.tif'}")
    for files in ((str(site / "fuel.tif"),), (str(site / "lit.geojson"),), words):
        result = call("fire", "info", *files)
        assert result.exit_code == 0, result.output
        assert "no problems" in result.stdout
    found = json.loads(call("fire", "info", *words, "--json").stdout)
    assert [band["layer"] for band in found["bands"]] == ["fuel", "elevation"]
    assert (found["rows"], found["cols"], found["problems"]) == (SIZE, SIZE, [])


def test_info_lists_every_problem_and_ends_badly(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    fuel = LAND.fuel_model.copy()
    fuel[3, 4] = 77
    write_raster(site / "bad.tif", fuel, crs="EPSG:4326")
    words = (f"fuel={site / 'bad.tif'}", f"elevation={site / 'dem.tif'}")
    result = call("fire", "info", *words)
    assert result.exit_code == 1
    for part in ("unknown fuel code 77 at row 3, column 4", "not a projection in metres"):
        assert part in result.stdout
    found = json.loads(call("fire", "info", *words, "--json").stdout)
    assert len(found["problems"]) >= 2
    assert call("fire", "info", *words, "--json").exit_code == 1


def test_info_in_json_has_null_for_nan(tmp_path: Path) -> None:
    elevation_m = np.full(LAND.fuel_model.shape, 100.0, dtype=np.float32)
    elevation_m[3, 4] = np.nan
    write_raster(tmp_path / "dem.tif", elevation_m, nodata=math.nan)
    text = call("fire", "info", str(tmp_path / "dem.tif"), "--json").stdout
    (band,) = json.loads(text, parse_constant=pytest.fail)["bands"]
    assert (band["nodata"], band["no_data_cells"]) == (None, 1)


def test_info_takes_units_crs_and_nodata(tmp_path: Path) -> None:
    gap = LAND.fuel_model.copy()
    gap[0, 0] = 77
    slope, aspect = np.rad2deg(np.arctan(LAND.slope_tan)), LAND.aspect_deg
    words = []
    for layer, values in (("fuel", gap), ("slope", slope), ("aspect", aspect)):
        words.append(f"{layer}={ascii_grid(tmp_path / f'{layer}.asc', values)}")
    bare = json.loads(call("fire", "info", *words, "--json").stdout)["problems"]
    for part in ("has no CRS", "unit of slope is unknown", "unknown fuel code 77"):
        assert any(part in problem for problem in bare)
    options = ("--crs", CRS, "--unit", "slope=degrees", "--nodata", "77")
    found = json.loads(call("fire", "info", *words, *options, "--json").stdout)
    assert found["crs"] == CRS
    assert [band["unit"] for band in found["bands"]] == ["", "degrees", "degrees"]
    (problem,) = found["problems"]
    assert "fuel.asc: cells without data" in problem


def test_the_bench_gives_json() -> None:
    result = call("bench", "fire", "--largest", "200", "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert [burn["fuel"] for burn in found["whole_burn"]] == ["uniform", "mixed"]
    assert {"cells", "burned_cells", "seconds", "cells_per_s", "peak_memory_mib"} <= set(
        found["whole_burn"][0]
    )
    assert {"step_s", "median_ms", "p99_ms", "burned_cells_per_step"} <= set(
        found["closed_loop"][0]
    )


@pytest.mark.parametrize(
    "command", ["fire", "fire run", "fire info", "bench fire", "sim", "run", "plan", "mock"]
)
def test_every_command_explains_itself(command: str) -> None:
    result = call(*command.split(), "--help")
    assert result.exit_code == 0
    assert "Usage:" in result.output


def refused(scenario: Path, *options: str) -> str:
    """Return the only line of ``fire run`` when it ends with exit code 1."""
    out = ("-o", str(scenario.parent / "out"))
    result = call("fire", "run", str(scenario), *out, *options)
    assert result.exit_code == 1, result.output
    assert isinstance(result.exception, SystemExit)
    (line,) = result.stderr.splitlines()
    assert line.startswith("Error: ")
    return line


@pytest.mark.parametrize(
    ("landscape", "words"),
    [
        ("rows = 50", 'landscape: `rows` has no effect with source = "files"'),
        ('units = {slop = "percent"}', "units: layer 'slop' is unknown"),
        ('units = {slope = "percent"}', "units: slope has a unit, but no band contains this layer"),
        ('units = {fuel = "m"}', "units: the layer fuel is dimensionless"),
        ("nodata = inf", "landscape.nodata"),
        ('fuel = "."', "landscape.fuel: is a folder, not a file"),
    ],
)
def test_a_landscape_that_is_not_as_meant_is_refused(
    tmp_path: Path, landscape: str, words: str
) -> None:
    tables = TIFFS.replace('fuel = "fuel.tif"\n', "") if "fuel = " in landscape[:7] else TIFFS
    assert words in refused(write_scenario(write_site(tmp_path), tables + landscape, CSV, POINT))


def test_what_cannot_be_a_perimeter_is_refused(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    scenario = write_scenario(site, TIFFS, CSV, '[fire]\nperimeter = "area.geojson"\n')
    drawn(site / "area.geojson", on_grid(30, 20).buffer(100.0), on_grid(30, 20))
    assert (
        "area.geojson: feature 2 contains Point; a perimeter must contain only polygons"
        in refused(scenario)
    )
    drawn(site / "area.geojson", on_grid(30, 20).buffer(9000.0))
    assert "no outline of the perimeter is on the landscape" in refused(scenario)


def test_times_that_lead_nowhere_are_refused(tmp_path: Path) -> None:
    scenario = write_scenario(write_site(tmp_path))
    late = refused(scenario, "--set", "ignition.0.at_s=3600")
    assert "the first ignition is at_s = 3600, which must be before duration_s = 3600" in late
    many = refused(scenario, "--set", "duration_s=10080", "--front-every", "1")
    assert "10080 fronts until 10080 s, more than 10000; specify 2 or more" in many


def test_fronts_come_often_or_only_at_the_end(tmp_path: Path) -> None:
    scenario = write_scenario(write_site(tmp_path))
    burn(scenario, tmp_path / "out", "--front-every", "1e9")
    assert [front["properties"]["time_s"] for front in fronts(tmp_path / "out")] == [3600]


def test_weather_that_ends_early_is_noted(tmp_path: Path) -> None:
    scenario = write_scenario(write_site(tmp_path))
    options = ("-o", str(tmp_path / "out"), "--set")
    quiet = call("fire", "run", str(scenario), *options, "duration_s=10800")
    assert "weather.csv" not in quiet.stderr
    result = call("fire", "run", str(scenario), *options, "duration_s=14400")
    assert result.exit_code == 0
    assert "weather.csv: ends at 7200 s; its last record is used until" in result.stderr


def test_a_folder_that_cannot_be_written_to_is_reported_before_the_simulation(
    tmp_path: Path,
) -> None:
    scenario = write_scenario(write_site(tmp_path))
    result = call("fire", "run", str(scenario), "-o", "/proc")
    assert result.exit_code == 1
    assert "/proc: cannot be written to: " in result.stderr
    for name in ("map.png", "arrival_time_s.tif", "fronts.geojson"):
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        (tmp_path / "out" / name).mkdir(parents=True)
        line = refused(scenario)
        assert f"{tmp_path / 'out'}" in line
        assert "cannot be written: " in line


def test_any_name_can_stand_on_the_map(tmp_path: Path) -> None:
    burn(write_scenario(write_site(tmp_path)), tmp_path / "out", "--set", "name=costs $x_{$")


def test_info_refuses_words_it_would_not_use(tmp_path: Path) -> None:
    fuel, none = str(write_site(tmp_path) / "fuel.tif"), tmp_path / "none.geojson"
    for words, message in (
        ((fuel, fuel), "specify one file, or the layers of a landscape, each as LAYER=FILE"),
        ((f"fuel={fuel}", f"fuel={fuel}"), "fuel is specified twice"),
        (("fuel=", f"elevation={fuel}"), "files: fuel="),
        ((fuel, "--unit", "slope"), "--unit: slope: write it as LAYER=UNIT"),
    ):
        result = call("fire", "info", *words)
        assert result.exit_code == 1
        assert message in result.stderr
    unused = call("fire", "info", fuel, "--unit", "slop=percent")
    assert unused.exit_code == 1
    assert "problem: units: layer 'slop' is unknown" in unused.stdout
    none.write_text('{"type": "FeatureCollection", "features": []}', encoding="utf-8")
    empty = call("fire", "info", str(none))
    assert "none.geojson: has no features" in empty.stdout
    assert "is a folder, not a file" in call("fire", "info", str(tmp_path)).stdout
    write_raster(tmp_path / "c.tif", HEIGHTS.astype(np.complex64))
    assert "c.tif: contains complex numbers" in call("fire", "info", str(tmp_path / "c.tif")).stdout


def test_netcdf_is_written_on_request(tmp_path: Path) -> None:
    zero = ("--set", "time_zero=2026-08-01T12:00:00-07:00")
    summary = burn(write_scenario(write_site(tmp_path)), tmp_path / "out", "--netcdf", *zero)
    assert summary["time_zero"] == "2026-08-01T12:00:00-07:00"
    with netCDF4.Dataset(tmp_path / "out" / "fire.nc") as file:
        assert file["state"].shape == (1, SIZE, SIZE)
        assert file["time"].units == "seconds since 2026-08-01T19:00:00Z"
        burned = ~np.ma.getmaskarray(file["arrival_time"][:])
    assert np.array_equal(burned, arrival_s(tmp_path / "out") >= 0)


def test_the_height_of_warm_air_and_the_altitudes_of_vehicles(tmp_path: Path) -> None:
    lat, lon = LAND.lat_lon_of(*LAND.xy_of(*LIT))
    vehicle = (
        f'[[vehicles]]\nname = "hawk"\naltitude_agl_m = 10\nhome_lat_deg = {lat}\n'
        f"home_lon_deg = {lon}\n"
    )
    path = write_scenario(write_site(tmp_path), TIFFS, CSV, POINT, vehicle)
    out = tmp_path / "out"
    summary = burn(path, out, "--set", "mission.max_warming_k=20")
    intensity = raster(out / "fireline_intensity_kw_m.tif")
    height_m = raster(out / "warm_height_m.tif")
    burned = intensity > 0.0
    expected_m = 0.74183 / 0.025574**0.5 * intensity[burned] ** (2 / 3) / 20.0
    assert height_m[burned] == pytest.approx(expected_m, rel=1e-4)
    assert (height_m[intensity < 0.0] == -1.0).all()
    (line,) = (line for line in summary["warnings"] if "K warmer" in line)
    hot = np.count_nonzero(height_m > 10.0)
    assert line.startswith(f"hawk: altitude_agl_m = 10: the air above {hot} of {burned.sum()} ")
    assert line.endswith(f"up to {height_m.max():.0f} m above the ground")
    assert (out / "warm_height_m.qml").exists()
    high = ("--set", "mission.max_warming_k=20", "--set", "vehicles.0.altitude_agl_m=500")
    assert burn(path, out, *high)["warnings"] == []
    assert burn(path, out)["warnings"] == []
    assert not (out / "warm_height_m.tif").exists()
