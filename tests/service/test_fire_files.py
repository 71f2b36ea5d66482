"""``fire run`` and ``fire info`` with original files of FARSITE, Cell2Fire and of perimeters."""

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely

from mission_service.config.scenario import Scenario, load_scenario
from mission_service.errors import ScenarioError
from mission_service.fire.run_ensemble import new_estimate
from mission_service.fire.scenario_fire import (
    fire_of,
    landscape_of,
    reported_fire,
    weather_of,
)
from tests.firemodel.grids import write_raster
from tests.firemodel.test_fuel_files import ENGLISH
from tests.firemodel.test_perimeter_files import written
from tests.firemodel.test_shapes import shapefile
from tests.service.fires import (
    CSV,
    LAND,
    LIT,
    POINT,
    SIZE,
    TIFFS,
    WEATHER,
    write_scenario,
    write_site,
)
from tests.service.test_cli import call
from tests.service.test_fire_cli import arrival_s, burn

INPUTS = """FARSITE INPUTS FILE VERSION 1.0
FARSITE_START_TIME: 07 01 1200
FARSITE_END_TIME: 07 01 1300
FARSITE_TIMESTEP: 30
FUEL_MOISTURES_DATA: 1
0 6 7 8 70 100
RAWS_UNITS: English
RAWS: 2
2024 7 1 1100 77 25 0 11.2 270 0
2024 7 1 1300 68 40 0 11.2 240 0
"""
WIND = '[weather_file]\npath = "case.input"\n'


def test_custom_fuel_rate_factors_and_an_inputs_file_change_the_fire(tmp_path: Path) -> None:
    """Code 20 replaces 2; the same model burns the same area, and less with the factor 0.5."""
    site = write_site(tmp_path)
    (site / "case.input").write_text(INPUTS, encoding="utf-8")
    (site / "own.fmd").write_text(ENGLISH, encoding="utf-8")
    (site / "half.adj").write_text("20 0.5\n", encoding="utf-8")
    (site / "dry.fms").write_text("0 6 7 8 70 100\n20 3 4 5 40 70\n", encoding="utf-8")
    fuel = "fuel_codes = {1 = 20, 2 = 20}\n"
    own = TIFFS + fuel + 'custom_fuels = "own.fmd"\n'
    gs2 = TIFFS + "fuel_codes = {1 = 122, 2 = 122}\n"
    areas = [
        burn(write_scenario(site, *parts), tmp_path / f"out{number}")["burned_cells"]
        for number, parts in enumerate(
            (
                (gs2, WIND, POINT),
                (own, WIND, POINT),
                (own + 'rate_factors = "half.adj"\n', WIND, POINT),
                (own, WIND + 'fuel_moistures = "dry.fms"\n', POINT),
            )
        )
    ]
    assert areas[0] == areas[1] > 10
    assert areas[2] < 0.5 * areas[1]
    assert areas[3] > 1.2 * areas[1]
    result = call("fire", "run", str(write_scenario(site, own, WIND, POINT)), "-o", str(tmp_path))
    assert "case.input: the run ignores FARSITE_TIMESTEP\n" in result.stderr


def test_wind_of_a_file_may_be_given_from_grid_north(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    (site / "case.input").write_text(INPUTS, encoding="utf-8")
    convergence_deg = LAND.grid_convergence_deg
    assert abs(convergence_deg) > 0.005
    found = {}
    for north in ("true", "grid"):
        scenario = write_scenario(site, TIFFS, f'{WIND}north = "{north}"\n', POINT)
        stream = weather_of(load_scenario(str(scenario)))
        found[north] = [entry.wind_from_deg for entry in stream.entries]
        assert stream.source is not None
    assert found["true"] == [270.0, 240.0]
    turned = [270.0 + convergence_deg, 240.0 + convergence_deg]
    assert found["grid"] == pytest.approx(turned, abs=1e-6)
    assert LAND.grid_deg(found["grid"][0]) == pytest.approx(270.0)


def test_dead_fuel_by_zones_changes_the_fire_and_needs_conditioning(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    earlier = INPUTS.replace("RAWS: 2\n", "RAWS: 3\n2024 7 1 0800 77 25 0 11.2 270 0\n")
    (site / "case.input").write_text(earlier, encoding="utf-8")
    nelson = WIND + 'dead_fuel_model = "nelson"\n'
    for out, weather in (("same", WIND), ("zones", nelson)):
        scenario = write_scenario(site, TIFFS, weather + "conditioned = true\n", POINT)
        assert burn(scenario, tmp_path / out)["burned_cells"] > 10
    assert not np.array_equal(arrival_s(tmp_path / "same"), arrival_s(tmp_path / "zones"))
    result = call("config", "check", str(write_scenario(site, TIFFS, nelson, POINT)))
    assert result.exit_code != 0
    assert "requires conditioned = true" in result.stderr
    station = WIND + "conditioned = true\nstation_elevation_m = 100\n"
    result = call("config", "check", str(write_scenario(site, TIFFS, station, POINT)))
    assert "station_elevation_m has no effect" in result.stderr


def test_crowns_burn_and_light_spot_fires_behind_a_barrier(tmp_path: Path) -> None:
    fuel = np.full((SIZE, SIZE), 10)
    fuel[:, 26:31] = 98
    site = write_site(tmp_path, fuel=fuel)
    canopy = {"cover": 0.2, "height": 20.0, "base": 0.5, "bulk_density": 0.15}
    for name, value in canopy.items():
        write_raster(site / f"{name}.tif", np.full((SIZE, SIZE), value, dtype=np.float32))
    layers = "".join(f'canopy_{name} = "{name}.tif"\n' for name in canopy)
    units = 'units = {canopy_cover = "fraction", canopy_height = "m", canopy_base = "m", '
    trees = TIFFS + layers + units + 'canopy_bulk_density = "kg/m3"}\n'
    windy = CSV + "live_herb_pct = 60\nlive_woody_pct = 90\n"
    (site / "weather.csv").write_text(WEATHER.replace(",5,270", ",15,270"), encoding="utf-8")
    crown = '[fire]\ncrown = "scott_reinhardt"\n'
    over = []
    for number, fire in enumerate((crown, crown + "spotting = true\nfirebrands_per_ha = 50\n")):
        out = tmp_path / f"out{number}"
        burn(write_scenario(site, trees, windy, POINT, fire), out)
        over.append(int(np.count_nonzero(arrival_s(out)[:, 31:] >= 0)))
    assert over[0] == 0 < over[1]


def test_new_fires_accelerate_but_not_in_the_estimate(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    burned_ha = []
    for number, keys in enumerate(("", "[fire]\nacceleration = true\n")):
        path = write_scenario(site, TIFFS, CSV, POINT, keys)
        burned_ha.append(burn(path, tmp_path / f"out{number}")["burned_area_ha"])
    assert 0.0 < burned_ha[1] < 0.9 * burned_ha[0]
    scenario = load_scenario(str(path))
    ground = landscape_of(scenario)
    reported = reported_fire(scenario, ground)
    reported.advance(scenario.duration_s)
    simulated = fire_of(scenario, ground)
    simulated.advance(scenario.duration_s)
    assert [round(each.front(each.time_s).area / 1e4, 2) for each in (reported, simulated)] == (
        burned_ha
    )
    with pytest.raises(ScenarioError, match=r"fire.acceleration cannot be combined with \[burn\]"):
        load_scenario("burn", ("fire.acceleration=true",))


def test_control_lines_hold_the_fire_and_its_estimate(tmp_path: Path) -> None:
    """A line across the way of the fire, from a file and from points; the rate decides."""
    site = write_site(tmp_path)
    middle = LIT[1] + 8
    wall = _column(middle)
    (site / "line.geojson").write_text(shapely.to_geojson(wall), encoding="utf-8")
    ends = ", ".join(f"[{lat}, {lon}]" for lon, lat in wall.coords)
    beyond = []
    for number, keys in enumerate(
        (
            "",
            f"[[suppression]]\npoints = [{ends}]\n",
            '[[suppression]]\nfile = "line.geojson"\nrate_m_h = 100000\n',
            '[[suppression]]\nfile = "line.geojson"\nrate_m_h = 100\n',
        )
    ):
        path = write_scenario(site, TIFFS, CSV, POINT, keys)
        burn(path, tmp_path / f"out{number}")
        beyond.append(int((arrival_s(tmp_path / f"out{number}")[:, middle:] >= 0).sum()))
    assert beyond[0] > 20
    assert beyond[1] == beyond[2] == 0
    assert 0 < beyond[3] <= beyond[0]
    scenario = load_scenario(str(path), ("suppression.0.rate_m_h=100000",))
    ground = landscape_of(scenario)
    estimate = new_estimate(scenario, ground, weather_of(scenario))
    estimate.light([LIT], 0.0)
    estimate.advance(scenario.duration_s)
    assert not estimate.burned()[:, middle:].any()
    assert estimate.burned().sum() > 20
    members = tmp_path / "members"
    held = ("--set", "suppression.0.rate_m_h=100000")
    assert (
        call("fire", "run", str(path), "-o", str(members), "--members", "2", *held).exit_code == 0
    )
    with rasterio.open(members / "burn_probability.tif") as file:
        assert (file.read(1)[:, middle:] <= 0.0).all()
    slow = ("--set", "suppression.0.rate_m_h=100")  # other members than those in the folder
    assert (
        call("fire", "run", str(path), "-o", str(members), "--members", "2", *slow).exit_code == 1
    )
    lat, lon = wall.coords[0][::-1]
    off = f"[[suppression]]\npoints = [[{lat + 1}, {lon}], [{lat + 1}, {lon + 0.1}]]\n"
    result = call("config", "check", str(write_scenario(site, TIFFS, CSV, POINT, off)))
    assert result.exit_code == 1
    assert "suppression.0: control line: no part of it is on the landscape" in result.stderr


def _column(col: int) -> shapely.LineString:
    """Return a line in WGS84 along a column of cells, beyond both edges of the grid."""
    lons_lats = [LAND.lat_lon_of(*LAND.xy_of(row, col))[::-1] for row in (-3, LAND.shape[0] + 3)]
    return shapely.LineString([tuple(float(each) for each in place) for place in lons_lats])


def test_a_daily_weather_file_needs_and_uses_its_wind(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    (site / "a.wtr").write_text("7 1 0 500 1500 50 90 60 20 1200\n", encoding="utf-8")
    weather = '[weather_file]\npath = "a.wtr"\nstart = 2024-07-01T12:00:00\nconditioned = true\n'
    scenario = write_scenario(site, TIFFS, weather, POINT)
    result = call("fire", "run", str(scenario), "-o", str(tmp_path / "out"))
    assert result.exit_code == 1
    assert "a.wtr: contains no wind, and its folder contains no a.wnd" in result.stderr
    assert not (tmp_path / "out" / "summary.json").exists()
    (site / "b.wnd").write_text("7 1 0 10 270 0\n", encoding="utf-8")
    scenario = write_scenario(site, TIFFS, weather + 'wind = "b.wnd"\n', POINT)
    assert burn(scenario, tmp_path / "out")["burned_cells"] > 10


def test_a_self_intersecting_perimeter_is_repaired_on_request(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    x_m, y_m = LAND.xy_of(*LIT)
    corners = ((0, 0), (150, 0), (150, 300), (300, 300), (300, 150), (0, 150))
    bow = shapely.Polygon([(x_m + x, y_m - y) for x, y in corners])
    shapefile(site / "mapped.shp", shapely.box(0, 0, 1, 1), bow, crs=LAND.crs)
    fire = '[fire]\nperimeter = "mapped.shp"\nperimeter_feature = 2\n'
    broken = write_scenario(site, TIFFS, CSV, fire)
    result = call("fire", "run", str(broken), "-o", str(tmp_path / "out"))
    assert result.exit_code == 1
    assert "mapped.shp: feature 2 is not a valid Polygon (Self-intersection" in result.stderr
    assert "fire.repair_perimeter = true" in result.stderr
    mended = write_scenario(site, TIFFS, CSV, fire + "repair_perimeter = true\n")
    result = call("fire", "run", str(mended), "-o", str(tmp_path / "out"))
    assert result.exit_code == 0, result.output
    assert "was repaired: 0.00 ha before, 4.50 ha after" in result.stderr


def test_foreign_codes_are_refused_by_name_and_without_files(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    table = "grid_value,fuel_type\n1,C-1\n2,C-2\n"
    (site / "fbp_lookup_table.csv").write_text(table, encoding="utf-8")
    result = call("fire", "run", str(write_scenario(site)), "-o", str(tmp_path / "out"))
    assert result.exit_code == 1
    assert "Traceback" not in result.output
    assert (
        "fbp_lookup_table.csv in the same folder uses fuel codes of the system Canadian FBP"
        in result.stderr
    )
    assert not (tmp_path / "out" / "summary.json").exists()
    translated = TIFFS + "fuel_codes = {1 = 1, 2 = 2}\n"
    assert burn(write_scenario(site, translated, CSV, POINT), tmp_path / "out")["burned_cells"]


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (('[landscape]\nrate_factors = "x.adj"\n', CSV, POINT), "`rate_factors` has no effect"),
        (
            (TIFFS, CSV, POINT + "[fire]\nrepair_perimeter = true\n"),
            "no effect without `perimeter`",
        ),
        ((TIFFS + "fuel_codes = {1 = 0}\n", CSV, POINT), "fuel_codes"),
        ((TIFFS, CSV + 'wind = "fuel.tif"\n', POINT), "only a .wtr file has a separate wind file"),
    ],
)
def test_keys_without_effect_are_refused(
    tmp_path: Path, parts: tuple[str, ...], message: str
) -> None:
    scenario = write_scenario(write_site(tmp_path), *parts)
    result = call("fire", "run", str(scenario), "-o", str(tmp_path / "out"))
    assert result.exit_code == 1
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


def test_fuel_codes_survive_a_journal(tmp_path: Path) -> None:
    """A journal contains the scenario as JSON, in which keys are texts."""
    fuel = TIFFS + "fuel_codes = {256 = 91}\n"
    scenario = load_scenario(str(write_scenario(write_site(tmp_path), fuel, CSV, POINT)))
    again = Scenario.model_validate(json.loads(scenario.model_dump_json()))
    assert again.landscape.fuel_codes == {256: 91}


def test_info_describes_a_weather_file_and_exits_by_its_problems(tmp_path: Path) -> None:
    path = tmp_path / "case.input"
    path.write_text(INPUTS, encoding="utf-8")
    result = call("fire", "info", str(path))
    assert result.exit_code == 0
    assert "note: a run ignores FARSITE_TIMESTEP" in result.stdout
    path.write_text(INPUTS.replace("RAWS: 2", "RAWS: 5"), encoding="utf-8")
    result = call("fire", "info", str(path), "--json")
    assert result.exit_code == 1
    assert "RAWS = 5, but 2 rows follow" in json.loads(result.stdout)["problems"][0]


def test_codes_of_canada_are_named_by_info(tmp_path: Path) -> None:
    path = write_raster(tmp_path / "fuels.tif", np.array([[1, 31], [425, 101]], dtype=np.int16))
    dem = write_raster(tmp_path / "dem.tif", np.zeros((2, 2), dtype=np.float32))
    result = call("fire", "info", f"fuel={path}", f"elevation={dem}")
    assert result.exit_code == 1
    assert "these codes belong to the system Canadian FBP" in result.stdout


def test_a_geopackage_on_a_projection_without_a_code(tmp_path: Path) -> None:
    """The summary of ``config check`` contains a short label of the projection, not its WKT."""
    crs = "+proj=lcc +lat_1=33 +lat_2=45 +lat_0=36 +lon_0=-87 +datum=WGS84 +units=m"
    grid = {"crs": crs, "transform": rasterio.Affine(30.0, 0.0, 0.0, 0.0, -30.0, 600.0)}
    write_site(tmp_path)
    write_raster(tmp_path / "fuel.tif", np.ones((20, 20), dtype=np.int16), **grid)
    write_raster(tmp_path / "dem.tif", np.zeros((20, 20), dtype=np.float32), **grid)
    mapped = shapely.box(200.0, 200.0, 400.0, 400.0)
    written(tmp_path / "mapped.gpkg", mapped, driver="GPKG", crs=crs, number=np.arange(1))
    fire = '[fire]\nperimeter = "mapped.gpkg"\n'
    result = call("config", "check", str(write_scenario(tmp_path, TIFFS, CSV, fire)))
    assert result.exit_code == 0, result.output
    assert "20 x 20 cells of 30 m, Lambert Conic Conformal" in result.stdout
