"""``fire wind`` and scenarios with [terrain_wind]: files, fires, snapshots and bad input."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio

from firemodel.landscape.readers.wind_files import WindFiles, read_wind
from firemodel.wind import MeasuredWind
from mission_service.config.scenario import load_scenario
from mission_service.errors import ScenarioError
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import fire_of, landscape_of, weather_of
from mission_service.fire.simulated_fire import simulated_weather
from mission_service.journal.journal_file import Rest
from mission_service.journal.snapshot import Frozen, Known, read, write
from mission_service.simulation.wind_alone import read_measured, write_wind
from tests.service.fires import CSV, LAND, POINT, TIFFS, at, write_scenario, write_site
from tests.service.test_cli import call

TABLE = "[terrain_wind]\n"
COLUMNS = "lat_deg,lon_deg,above_ground_m,speed_m_s,from_deg,sd_m_s\n"
FILES = {
    *("wind_speed.tif", "wind_speed.qml", "wind_from.tif", "wind_from.qml", "summary.json"),
    *("wind_vel.asc", "wind_vel.prj", "wind_ang.asc", "wind_ang.prj"),
}


@pytest.fixture(name="path")
def _path(tmp_path: Path) -> Path:
    write_site(tmp_path)
    return write_scenario(tmp_path, TIFFS, CSV, POINT)


def wind(path: Path, *options: str) -> tuple[Path, dict[str, object]]:
    """Return the folder and the summary of the command."""
    out = path.parent / "wind"
    result = call("fire", "wind", str(path), "-o", str(out), "--json", *options)
    assert result.exit_code == 0, result.output
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert json.loads(result.output) == summary
    return out, summary


def test_the_grids_can_be_read_as_wind_grids(path: Path) -> None:
    out, summary = wind(path, "--speed", "6", "--from", "200")
    assert {each.name for each in out.iterdir()} == FILES
    assert summary["free_wind"] == {"speed_m_s": 6.0, "from_deg": 200.0}
    assert summary["divergence"] < 1e-6  # type: ignore[operator]
    with rasterio.open(out / "wind_speed.tif") as file:
        speed = file.read(1)
    with rasterio.open(out / "wind_from.tif") as file:
        from_deg = file.read(1)
    assert summary["speed_m_s"]["max"] == pytest.approx(float(speed.max()), abs=1e-3)  # type: ignore[index]
    assert speed.max() / speed.min() > 1.2
    stack = read_wind(
        WindFiles(
            pairs=((out / "wind_vel.asc", out / "wind_ang.asc", 0.0),), unit="m_s", height="20ft"
        ),
        LAND,
    )
    north, east = stack.grids.toward[0]
    assert np.allclose(np.hypot(north, east), speed, atol=2e-3)
    read_deg = LAND.true_deg(np.rad2deg(np.arctan2(-east, -north)))
    turned = (read_deg - from_deg + 180.0) % 360.0 - 180.0
    assert np.abs(turned).max() < 0.1


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (("--speed", "6"), "specify both --speed and --from"),
        (("--speed", "0", "--from", "0", "--at", "3"), "--at has no effect"),
    ],
)
def test_contradicting_options_are_refused(
    path: Path, options: tuple[str, ...], problem: str
) -> None:
    result = call("fire", "wind", str(path), "-o", str(path.parent / "wind"), *options)
    assert result.exit_code == 2
    assert problem in result.output


def test_directions_are_from_true_north_except_in_the_ascii_grids(tmp_path: Path) -> None:
    land = replace(LAND, west_m=LAND.west_m - 2e5)
    assert abs(land.grid_convergence_deg) > 1.0
    east = np.full(land.shape, 3.0)
    write_wind(tmp_path, np.array([0.0 * east, east]), land)
    with rasterio.open(tmp_path / "wind_from.tif") as file:
        assert np.allclose(file.read(1), land.true_deg(270.0))
    with rasterio.open(tmp_path / "wind_ang.asc") as file:
        assert np.allclose(file.read(1), 270.0)
        assert file.bounds.left == land.west_m


def test_the_wind_is_that_of_the_weather_at_a_time(path: Path) -> None:
    assert wind(path)[1]["free_wind"]["speed_m_s"] == 5.0  # type: ignore[index]
    free = wind(path, "--at", "3000")[1]["free_wind"]
    assert free == {"speed_m_s": 6.0, "from_deg": 250.0}


def test_the_wind_is_fitted_to_measurements(path: Path) -> None:
    rows = [(10, 12, 8.0, 5.0, 250.0, ""), (45, 50, 9.0, 6.0, 260.0, ""), (30, 20, 120, 9, 240, 2)]
    lines = []
    for row, col, *values in rows:
        lon, lat = at(row, col)
        lines.append(",".join(map(str, (lat, lon, *values))))
    file = path.parent / "measured.csv"
    file.write_text(COLUMNS + "\n".join(lines) + "\n", encoding="utf-8")
    first, *_, last = read_measured(file, LAND)
    assert first == MeasuredWind(
        pytest.approx(10.0, abs=1e-4),  # type: ignore[arg-type]
        pytest.approx(12.0, abs=1e-4),  # type: ignore[arg-type]
        *(8.0, 5.0, pytest.approx(LAND.grid_deg(250.0))),  # type: ignore[arg-type]
    )
    assert last.sd_m_s == 2.0
    summary = wind(path, "--measured", str(file))[1]
    assert summary["measurements"] == 3
    assert 3.0 < summary["free_wind"]["speed_m_s"] < 8.0  # type: ignore[index]
    assert summary["rms_error_m_s"] < summary["left_out_rms_error_m_s"]  # type: ignore[operator]
    assert "left_out_rms_error_of_mean_m_s" in summary


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (COLUMNS, "contains no measurements"),
        ("lat_deg,lon_deg\n1,2\n", "line 2: above_ground_m = None"),
        (COLUMNS + "37,-119,8,fast,250,\n", "line 2: speed_m_s = 'fast'"),
        (COLUMNS + "1,2,8,5,250,\n", "line 2: lat 1.0, lon 2.0 is outside the landscape"),
    ],
)
def test_files_of_measurements_that_cannot_be_used(path: Path, text: str, problem: str) -> None:
    file = path.parent / "measured.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError, match=problem):
        read_measured(file, LAND)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (("--speed", "5"), "specify both --speed and --from"),
        (("--speed", "5", "--from", "5", "--at", "3"), "--at has no effect"),
        (("--slope-flow",), "--slope-flow needs time_zero"),
        (("--speed", "nan", "--from", "5"), "nan"),
    ],
)
def test_options_that_exclude_each_other(
    path: Path, options: tuple[str, ...], problem: str
) -> None:
    result = call("fire", "wind", str(path), "-o", str(path.parent / "out"), *options)
    assert result.exit_code != 0
    assert problem in result.output


def test_slope_flow_is_added(path: Path) -> None:
    options = ("--speed", "0", "--from", "0", "--slope-flow")
    change = ("--set", "time_zero=2024-07-01T00:00:00-07:00")
    summary = wind(path, *options, "--at", "46800", *change)[1]
    assert 0.1 < summary["slope_flow_m_s"]["max"] < 10.0  # type: ignore[index]
    assert summary["speed_m_s"] == summary["slope_flow_m_s"]
    assert summary["speed_up"] is None


def test_results_of_other_commands_are_not_overwritten(path: Path) -> None:
    out, _ = wind(path)
    result = call("fire", "run", str(path), "-o", str(out))
    assert result.exit_code != 0
    assert "contains results of fire wind" in result.output


def test_fires_spread_with_the_wind_over_the_terrain(path: Path) -> None:
    plain = load_scenario(str(path))
    write_scenario(path.parent, TIFFS, CSV, POINT, TABLE)
    scenario = load_scenario(str(path))
    weather, land = weather_of(scenario), landscape_of(scenario)
    fields = [entry.wind_field for entry in weather.entries]
    assert all(field is not None for field in fields)
    assert len({id(field.grids) for field in fields if field is not None}) == 1
    assert weather_of(load_scenario(str(path), ("seed=9",))).entries == weather.entries
    fires = [fire_of(each, land) for each in (plain, scenario)]
    for fire in fires:
        fire.advance(3600.0)
    assert not np.array_equal(fires[0].burned(), fires[1].burned())


def test_the_wind_at_the_station_is_that_of_the_weather(path: Path) -> None:
    lon, lat = at(20, 30)
    table = f"{TABLE}station_lat_deg = {lat!r}\nstation_lon_deg = {lon!r}\n"
    write_scenario(path.parent, TIFFS, CSV, POINT, table)
    entry = weather_of(load_scenario(str(path))).entries[0]
    assert entry.wind_field is not None
    ratio = entry.wind_field.ratio()
    assert np.allclose(ratio[:, 20, 30], [1.0, 0.0], atol=1e-5)
    assert np.abs(ratio[0] - 1.0).max() > 0.05
    out, summary = wind(path, "--speed", "6", "--from", "200")
    with rasterio.open(out / "wind_speed.tif") as file:
        assert file.read(1)[20, 30] == pytest.approx(6.0, abs=1e-4)
    assert summary["free_wind"]["speed_m_s"] != 6.0  # type: ignore[index]


def test_a_station_outside_the_landscape_is_refused(path: Path) -> None:
    table = f"{TABLE}station_lat_deg = 12.0\nstation_lon_deg = -84.0\n"
    write_scenario(path.parent, TIFFS, CSV, POINT, table)
    with pytest.raises(ScenarioError, match=r"station at lat 12\.0, lon -84\.0 is outside"):
        weather_of(load_scenario(str(path)))


def test_errors_of_the_simulated_wind_have_their_own_local_winds(path: Path) -> None:
    write_scenario(path.parent, TIFFS, CSV, POINT, TABLE)
    scenario = load_scenario(str(path), ("simulation.fire.wind_turn_deg=90",))
    (given, *_), (turned, *_) = (
        each.entries for each in (weather_of(scenario), simulated_weather(scenario))
    )
    assert given.wind_field is not None
    assert turned.wind_field is not None
    assert turned.wind_field.grids is given.wind_field.grids
    assert turned.wind_field == given.wind_field.turned(90.0)
    assert turned.wind_field.parts != given.wind_field.parts


def test_a_snapshot_names_the_winds(path: Path, tmp_path: Path) -> None:
    write_scenario(path.parent, TIFFS, CSV, POINT, TABLE)
    scenario = load_scenario(str(path))
    land = landscape_of(scenario)
    estimate = RunEstimate(scenario, land)
    known = Known(scenario, land)
    file = tmp_path / "state"
    write(file, Frozen({"estimate": estimate}, known), Rest(0, 0, 1))
    (restored, *_), (given, *_) = (
        each.entries for each in (read(file, known)["estimate"].fire.weather, weather_of(scenario))
    )
    assert given.wind_field is not None
    assert restored.wind_field == given.wind_field
    assert restored.wind_field.grids is given.wind_field.grids


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        (TABLE + "station_lat_deg = 37.0\n", "specify both station_lat_deg and station_lon_deg"),
        (
            TABLE + '[wind_grids]\npath = "dem.tif"\n',
            "specify either wind_grids or terrain_wind",
        ),
    ],
)
def test_invalid_tables_are_refused(path: Path, table: str, problem: str) -> None:
    write_scenario(path.parent, TIFFS, CSV, POINT, table)
    with pytest.raises(ScenarioError, match=problem):
        load_scenario(str(path))
