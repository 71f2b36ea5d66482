"""``incident new`` makes scenario files that the service accepts."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from click.testing import CliRunner, Result

from firemodel.physics.fuels import NON_BURNABLE
from mission_service.cli.incident import incident_commands
from mission_service.cli.main import main
from mission_service.config.scenario import load_scenario
from mission_service.fire.scenario_fire import landscape_of
from tests.service.fires import LAND, LIT, at, write_site
from tests.service.test_cli import call

BOX = ("--box=-84.2,36.32,-84.1,36.4",)
WIND = ("--wind", "5,225")
FIRE = ("--ignition", "36.35,-84.15")
HAWK = ("--vehicle", "hawk,px4,plane,36.36,-84.14")
KITE = ("--vehicle", "kite,ardupilot,copter,36.361,-84.141")


def new(path: Path, *options: str) -> Result:
    return call("incident", "new", str(path), *options)


def test_an_area_a_wind_an_ignition_and_aircraft_make_a_scenario(tmp_path: Path) -> None:
    path = tmp_path / "made" / "ridge.toml"
    result = new(path, *BOX, *WIND, *FIRE, *HAWK, *KITE, "--fuel-model", "4", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["file"] == str(path)
    loaded = load_scenario(str(path))
    assert (loaded.name, loaded.duration_s) == ("ridge", 21_600)
    assert (loaded.weather[0].wind_speed_m_s, loaded.weather[0].wind_from_deg) == (5.0, 225.0)
    assert [each.name for each in loaded.vehicles] == ["hawk", "kite"]
    assert [each.kind for each in loaded.vehicles] == ["plane", "copter"]
    assert len({each.link for each in loaded.vehicles}) == 2
    assert abs(loaded.vehicles[0].altitude_agl_m - loaded.vehicles[1].altitude_agl_m) >= 50
    assert loaded.simulation.fire is not None
    landscape = landscape_of(loaded)
    assert (landscape.fuel_model == 4).all()
    for lat in (36.32, 36.4):  # the grid is turned from true north and contains the whole area
        for lon in (-84.2, -84.1):
            assert landscape.contains(*landscape.xy_of_lat_lon(lat, lon))
    assert landscape.shape[0] * 30 < 1.06 * 8_900
    assert landscape.shape[1] * 30 < 1.06 * 8_970
    assert [each.name for each in path.parent.iterdir()] == ["ridge.toml"]


def test_rasters_and_a_weather_file_make_a_scenario_of_a_real_fire(tmp_path: Path) -> None:
    site = write_site(tmp_path)
    lon, lat = at(*LIT)
    path = tmp_path / "scenarios" / "real.toml"
    options = (
        *("--layer", f"fuel={site / 'fuel.tif'}", "--layer", f"elevation={site / 'dem.tif'}"),
        *("--weather", str(site / "weather.csv"), "--start", "2024-07-01T12:00:00"),
        *("--ignition", f"{lat},{lon}", "--vehicle", f"hawk,px4,plane,{lat},{lon}"),
        *("--hours", "1", "--real"),
    )
    result = new(path, *options)
    assert result.exit_code == 0, result.output
    assert f"mission-service run {path} --out out/live" in result.output
    assert "../fuel.tif" in path.read_text(encoding="utf-8"), "the folder can be moved as a whole"
    loaded = load_scenario(str(path))
    assert loaded.simulation.fire is None
    assert landscape_of(loaded).shape == LAND.shape


def test_rasters_with_cells_without_data_and_a_slope_of_unknown_unit(tmp_path: Path) -> None:
    """A usual crop of LANDFIRE, which also has a calendar time for the products."""
    site = write_site(tmp_path)
    with rasterio.open(site / "fuel.tif") as source:
        profile, codes = source.profile, source.read(1)
    codes[0, :3] = 32767
    with rasterio.open(site / "crop.tif", "w", **{**profile, "nodata": 32767}) as target:
        target.write(codes, 1)
    for name, value in (("slope", 12.0), ("aspect", 90.0)):
        kind = {**profile, "dtype": "float32"}
        with rasterio.open(site / f"{name}.tif", "w", **kind) as target:
            target.write(np.full((1, *codes.shape), value, dtype=np.float32))
    lon, lat = at(*LIT)
    layers = ("fuel=crop.tif", "elevation=dem.tif", "slope=slope.tif", "aspect=aspect.tif")
    options = [
        *(each for layer in layers for each in ("--layer", layer.replace("=", f"={site}/"))),
        *("--ignition", f"{lat},{lon}", "--vehicle", f"hawk,px4,plane,{lat},{lon}", *WIND),
    ]
    path = tmp_path / "crop.toml"
    refused = new(path, *options)
    assert refused.exit_code == 1
    assert "unit of slope" in refused.output
    options += ["--unit", "slope=percent", "--missing", "unburnable"]
    options += ["--time-zero", "2026-08-01T14:00-07:00"]
    result = new(path, *options)
    assert result.exit_code == 0, result.output
    assert f"mission-service sim {path} --set vehicles.0.autostart=true" in result.output
    loaded = load_scenario(str(path))
    assert loaded.time_zero is not None
    assert loaded.time_zero.isoformat() == "2026-08-01T14:00:00-07:00"
    landscape = landscape_of(loaded)
    assert set(landscape.fuel_model[0, :3].tolist()) <= set(NON_BURNABLE)


def test_an_aircraft_may_have_a_link_and_a_system_id(tmp_path: Path) -> None:
    path = tmp_path / "fire.toml"
    owl = ("--vehicle", "owl,px4,copter,36.362,-84.142,serial:/dev/ttyUSB0:57600,7")
    result = new(path, *BOX, *WIND, *FIRE, *HAWK, f"{KITE[0]}={KITE[1]},tcp:127.0.0.1:5760", *owl)
    assert result.exit_code == 0, result.output
    found = [(each.link, each.system_id) for each in load_scenario(str(path)).vehicles]
    assert found == [
        ("udpin:127.0.0.1:14550", 1),
        ("tcp:127.0.0.1:5760", 2),
        ("serial:/dev/ttyUSB0:57600", 7),
    ]


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        ((*WIND, *FIRE, *HAWK), 2, "specify --box, --landscape or --layer"),
        ((*BOX, *FIRE, *HAWK), 2, "specify --wind or --weather"),
        ((*BOX, *WIND, *HAWK), 2, "specify --ignition or --perimeter"),
        ((*BOX, *WIND, *FIRE), 2, "specify --vehicle"),
        ((*BOX, "--wind", "5", *FIRE, *HAWK), 2, "write it as SPEED,FROM in m/s and degrees"),
        ((*BOX, *WIND, "--ignition", "x,y", *HAWK), 2, "write it as LAT,LON"),
        ((*BOX, *WIND, *FIRE, "--vehicle", "hawk,px5,plane,1,2"), 2, "px4|ardupilot"),
        ((*BOX, *WIND, *FIRE, f"{HAWK[0]}={HAWK[1]},udpin:127.0.0.1:14550,x"), 2, "[,LINK"),
        ((*BOX, *WIND, *FIRE, f"{HAWK[0]}={HAWK[1]},radio:7"), 1, "link"),
        (("--box=-84.2,36.32,-84.199,36.4", *WIND, *FIRE, *HAWK), 2, "600 m to 120 km"),
        ((*BOX, *WIND, "--ignition", "37.35,-84.15", *HAWK), 1, "lies outside the landscape"),
        ((*BOX, "--wind", "nan,225", *FIRE, *HAWK), 2, "write it as SPEED,FROM"),
        ((*BOX, *WIND, "--ignition", "inf,-84.15", *HAWK), 2, "write it as LAT,LON"),
        ((*BOX, *WIND, *FIRE, "--vehicle", "hawk,px4,plane,36.36,nan"), 2, "write it as LAT,LON"),
        ((*BOX, *WIND, *FIRE, *HAWK, "--start", "2024-07-01"), 2, "--start requires --weather"),
        ((*BOX, *WIND, *FIRE, *HAWK, "--missing", "unburnable"), 2, "--missing requires"),
        ((*BOX, *WIND, *FIRE, *HAWK, "--unit", "slope=percent"), 2, "--unit requires --landscape"),
        (
            ("--landscape", __file__, "--fuel-model", "4", *WIND, *FIRE, *HAWK),
            *(2, "--fuel-model requires --box"),
        ),
        ((*BOX, "--wind", "500,225", *FIRE, *HAWK), 1, "wind_speed_m_s"),
    ],
)
def test_what_is_missing_or_wrong_is_refused_and_nothing_is_written(
    tmp_path: Path, options: tuple[str, ...], code: int, words: str
) -> None:
    path = tmp_path / "fire.toml"
    result = new(path, *options)
    assert (result.exit_code, words in result.output) == (code, True), result.output
    assert ".new" not in result.output
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_not_overwritten_and_a_source_is_given_once(tmp_path: Path) -> None:
    path = tmp_path / "fire.toml"
    path.write_text("mine", encoding="utf-8")
    assert "exists; choose another name" in new(path, *BOX, *WIND, *FIRE, *HAWK).output
    assert path.read_text(encoding="utf-8") == "mine"
    both = new(tmp_path / "b.toml", *BOX, "--landscape", str(path), *WIND, *FIRE, *HAWK)
    assert "specify only one of --box and --landscape" in both.output


def test_on_a_terminal_questions_are_asked_until_the_answers_are_valid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(incident_commands, "is_terminal", lambda: True)
    answers = ["1,2", "-84.2,36.32,-84.1,36.4", "5,225", "36.35,-84.15", HAWK[1]]
    path = tmp_path / "asked.toml"
    words: list[Any] = ["incident", "new", str(path)]
    result = CliRunner().invoke(main, words, input="\n".join([*answers, ""]))
    assert result.exit_code == 0, result.output
    assert "specify WEST,SOUTH,EAST,NORTH" in result.output
    assert load_scenario(str(path)).vehicles[0].name == "hawk"
