"""Scenarios with [wind_grids]: fires, ensembles, flights, replays and snapshots."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firemodel.physics.weather import WeatherStream
from firemodel.physics.wind_field import WindGrids
from mission_service.config.input_files import input_files
from mission_service.config.scenario import load_scenario
from mission_service.errors import ScenarioError
from mission_service.fire.run_ensemble import (
    Images,
    Input,
    Lit,
    WeatherSet,
    new_estimate,
    processed,
)
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import fire_of, landscape_of, weather_of
from mission_service.fire.simulated_fire import simulated_weather
from mission_service.journal.journal_file import Rest
from mission_service.journal.snapshot import Frozen, Known, header_of, read, write
from mission_service.replay.verification import verify
from mission_service.simulation.sim import simulate
from tests.firemodel.grids import write_raster
from tests.service.fires import CSV, LAND, LIT, POINT, TIFFS, write_scenario, write_site
from tests.service.test_cli import call

GRIDS = '[wind_grids]\npath = "wind.tif"\nunit = "m_s"\nheight = "20ft"\n'
NAMES = ("u 2024-07-01T12:00", "v 2024-07-01T12:00", "u 2024-07-01T13:00", "v 2024-07-01T13:00")


def write_wind(folder: Path, factor: float = 1.0) -> None:
    """Write winds from the west at first, which are faster in the east, and turn by an hour."""
    east = np.linspace(3.0, 9.0, LAND.shape[1]) * factor
    along, across = np.broadcast_to(east, LAND.shape), np.zeros(LAND.shape)
    bands = np.stack([along, across, across, along]).astype(np.float32)
    write_raster(folder / "wind.tif", bands, NAMES)


@pytest.fixture(name="path")
def _path(tmp_path: Path) -> Path:
    write_wind(write_site(tmp_path))
    return write_scenario(tmp_path, TIFFS, CSV, POINT, GRIDS)


def test_the_weather_has_the_wind_of_the_grids(path: Path) -> None:
    stream = weather_of(load_scenario(str(path)))
    assert [entry.at_s for entry in stream.entries] == [0, 900, 1800, 2700, 3600, 7200]
    begin, half, end = (stream.weather_at(at_s) for at_s in (0.0, 1800.0, 3600.0))
    assert begin.wind_speed_m_s == pytest.approx(6.0)
    assert LAND.grid_deg(begin.wind_from_deg) % 360.0 == pytest.approx(270.0)
    assert half.wind_speed_m_s == pytest.approx(6.0 / np.sqrt(2.0))
    assert LAND.grid_deg(end.wind_from_deg) % 360.0 == pytest.approx(180.0)
    assert (begin.dead_1h_pct, half.dead_1h_pct) == (6.0, 5.0)  # of the weather file


def test_fire_is_slower_where_the_wind_is_slower(path: Path) -> None:
    scenario = load_scenario(str(path))
    land = landscape_of(scenario)
    local, mean = fire_of(scenario, land), fire_of(scenario, land, _of_mean(weather_of(scenario)))
    for fire in (local, mean):
        fire.advance(2400.0)
    assert local.burned()[30, 10:26].any()  # in the west
    assert np.count_nonzero(local.burned()) < 0.9 * np.count_nonzero(mean.burned())


def _of_mean(weather: WeatherStream) -> WeatherStream:
    return WeatherStream([replace(entry, wind_field=None) for entry in weather.entries])


def test_the_weather_is_computed_again_only_after_a_change_of_the_files(path: Path) -> None:
    scenario = load_scenario(str(path))
    first = weather_of(scenario)
    assert weather_of(load_scenario(str(path))) is first
    assert weather_of(load_scenario(str(path), ("seed=9",))) is first
    write_wind(path.parent, 2.0)
    os.utime(path.parent / "wind.tif", ns=(1, 1))
    assert weather_of(scenario).entries[0].wind_speed_m_s == pytest.approx(12.0)


def test_the_grids_of_an_atm_file_are_input_files(path: Path) -> None:
    (path.parent / "wind.atm").write_text("WINDS\n7 1 1200 a_vel.asc a_ang.asc\n", encoding="ascii")
    write_scenario(path.parent, TIFFS, CSV, POINT, '[wind_grids]\npath = "wind.atm"\n')
    found = input_files(load_scenario(str(path)), {"wind_grids"})
    assert [each.name for each in found] == ["wind.atm", "a_vel.asc", "a_ang.asc"]


def test_errors_of_the_simulated_wind_apply_on_top_of_the_grids(path: Path) -> None:
    changes = ("simulation.fire.wind_factor=0.5", "simulation.fire.wind_turn_deg=90")
    entry = simulated_weather(load_scenario(str(path), changes)).entries[0]
    assert entry.wind_speed_m_s == pytest.approx(3.0)
    assert LAND.grid_deg(entry.wind_from_deg) % 360.0 == pytest.approx(0.0, abs=1e-6)
    assert entry.wind_field is not None


def test_an_ensemble_burns_in_the_grids(path: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = call("fire", "run", str(path), "-o", str(out), "--members", "3", "--json")
    assert result.exit_code == 0, result.output
    recipe = json.loads((out / "members" / "recipe.json").read_text(encoding="utf-8"))
    assert str(path.parent / "wind.tif") in recipe["files"]


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ("[wind_grids]\n", "wind_grids: specify either `path` or `pairs`"),
        (GRIDS + "interval_s = 5\n", "wind_grids.interval_s"),
        ('[wind_grids]\npath = "none.tif"\n', "wind_grids.path: no such file"),
        (
            '[wind_grids]\nat_s = [0]\n[[wind_grids.pairs]]\nspeed = "wind.tif"\n'
            'direction = "wind.tif"\n',
            "wind_grids: at_s has no effect with `pairs`",
        ),
        (
            '[[wind_grids.pairs]]\nspeed = "wind.tif"\ndirection = "wind.tif"\nat_s = 0\n'
            "time = 2024-07-01T12:00:00\n",
            "wind_grids.pairs.0: specify either at_s or `time`",
        ),
    ],
)
def test_invalid_tables_are_refused(path: Path, table: str, problem: str) -> None:
    write_scenario(path.parent, TIFFS, CSV, POINT, table)
    with pytest.raises(ScenarioError, match=problem):
        load_scenario(str(path))


def test_the_ensemble_of_the_estimate_burns_in_the_grids(path: Path) -> None:
    """A report of the wind replaces the mean, and keeps the local differences."""
    scenario = load_scenario(str(path), ("estimate.members=4",))
    land, weather = landscape_of(scenario), weather_of(scenario)
    blown = weather.blown(8.0, 200.0, 1200.0)
    found = []
    for streams in ((weather, blown), (_of_mean(weather), _of_mean(blown))):
        images = Images(900.0, ())
        inputs: list[Input] = [Lit(0.0, 0.0, [LIT]), images, WeatherSet(1200.0, streams[1])]
        estimate = processed(new_estimate(scenario, land, streams[0]), inputs)
        forecast = estimate.forecast(3600.0)
        found.append(forecast.burn_probability(3600.0))
    assert (found[0] > 0.5).sum() > 10
    assert not np.array_equal(found[0], found[1])


def test_a_file_that_cannot_be_used_is_one_line(path: Path, tmp_path: Path) -> None:
    write_scenario(path.parent, TIFFS, CSV, POINT, GRIDS.replace('unit = "m_s"\n', ""))
    result = call("fire", "run", str(path), "-o", str(tmp_path / "out"))
    assert result.exit_code != 0
    assert "has no unit; specify" in result.output


def test_a_snapshot_names_the_grids(path: Path, tmp_path: Path) -> None:
    """The grids are not in the state, and a state of other grids is not used."""
    scenario = load_scenario(str(path))
    land = landscape_of(scenario)
    estimate = RunEstimate(scenario, land)
    estimate.advance(600_000_000)
    known = Known(scenario, land)
    file, grids = tmp_path / "state", _grids(weather_of(scenario))
    frozen = Frozen({"estimate": estimate}, known)
    sizes = [len(part) for part in frozen.parts]
    assert grids.toward.nbytes not in sizes
    write(file, frozen, Rest(0, 0, 1))
    restored = read(file, known)["estimate"]
    assert _grids(restored.fire.weather) is grids
    for each in (estimate, restored):
        each.advance(2_000_000_000)
    np.testing.assert_array_equal(restored.fire.arrival_time_s, estimate.fire.arrival_time_s)
    write_wind(path.parent, 2.0)
    os.utime(path.parent / "wind.tif", ns=(1, 1))
    with pytest.raises(Exception, match="was written with another scenario"):
        header_of(file, Known(scenario, land))


def _grids(weather: WeatherStream) -> WindGrids:
    field = weather.entries[0].wind_field
    assert field is not None
    return field.grids


def test_a_simulated_flight_is_verified(tmp_path: Path) -> None:
    default = load_scenario("default")
    land = landscape_of(default)
    rows, cols = land.shape
    speed = np.broadcast_to(np.linspace(3.0, 9.0, cols), (rows, cols))
    direction = np.broadcast_to(np.linspace(20.0, 80.0, rows)[:, None], (rows, cols))
    write_raster(
        tmp_path / "wind.tif",
        np.stack([speed, direction]).astype(np.float32),
        ("speed", "direction"),
        crs=land.crs,
        transform=land.transform(),
    )
    text = Path(__file__).parents[2] / "mission_service/scenarios/default.toml"
    path = tmp_path / "scenario.toml"
    path.write_text(text.read_text(encoding="utf-8") + "\n" + GRIDS, encoding="utf-8")
    changes = ("start_s=3500", "duration_s=4500", "deploy_at_s=3500")
    scenario = load_scenario(str(path), changes)
    journal = tmp_path / "journal.jsonl"
    record, fire = simulate(scenario, journal, created="2026-01-01")
    assert record.vehicles["hawk"].decisions > 50
    assert fire.weather.entries[0].wind_field is not None
    assert verify(journal).difference is None
