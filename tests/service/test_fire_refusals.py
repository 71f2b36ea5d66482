"""Invalid input and interruptions of fire commands: one line, an exit code, and no lost result."""

import json
from pathlib import Path
from typing import Any

import pytest

from mission_service.simulation import fire_members, fire_sweep
from mission_service.simulation.fire_sweep import sweep_of
from tests.service.fires import write_flat, write_scenario, write_site
from tests.service.test_cli import call

WIND = "weather.0.wind_speed_m_s"


def refused(exit_code: int, *arguments: str) -> str:
    """Return the only line of a command's error (after the usage, if an option is wrong)."""
    result = call("fire", *arguments)
    assert result.exit_code == exit_code, result.output
    lines = [line for line in result.stderr.splitlines() if not line.startswith("Warning: ")]
    if lines[0].startswith("Usage: "):
        lines = lines[3:]
    (line,) = lines
    assert line.startswith("Error: ")
    return line


@pytest.mark.parametrize("address", ["", "localhost", "tcp://", "foo://localhost:8786", "a b:1"])
def test_an_address_without_a_port_is_refused(tmp_path: Path, address: str) -> None:
    command = ["run", str(write_flat(tmp_path)), "--members", "2", "-o", str(tmp_path / "out")]
    line = refused(2, *command, "--scheduler", address)
    assert "must be HOST:PORT, as in tcp://10.0.0.1:8786" in line
    assert not (tmp_path / "out").exists()


def test_tls_without_certificates_is_refused(tmp_path: Path) -> None:
    command = ["run", str(write_flat(tmp_path)), "--members", "2", "-o", str(tmp_path / "out")]
    line = refused(1, *command, "--scheduler", "tls://127.0.0.1:1")
    assert "tls://127.0.0.1:1: no certificates; set distributed.comm.tls" in line


def test_an_empty_folder_name_is_refused(tmp_path: Path) -> None:
    assert "is empty; specify a folder" in refused(2, "run", str(write_flat(tmp_path)), "-o", "")


@pytest.mark.parametrize(
    ("values", "exit_code", "text"),
    [
        ("weather", 2, "--vary weather: write it as KEY=VALUES"),
        ("weather.9.at_s=1,2", 2, "--vary weather.9.at_s=1: the scenario has no such key"),
        ("fire.no=1,2", 2, "--vary: fire.no: unknown key"),
        (f"{WIND}=1,-2", 2, f"--vary: {WIND}: must be a number from 0 to 100 (got -2)"),
        ("mission.layer_m=10,20", 2, "--vary mission.layer_m: has no effect on these fires"),
        ("name=a,b", 2, "--vary name: has no effect"),
        ("seed=1,2", 2, "--vary seed: has no effect"),
        ("fire.p_spread=0.1,0.2", 2, "--vary fire.p_spread: has no effect"),
        ("landscape.barriers=[],['a','b']", 2, "--vary: landscape.barriers.0: no such file"),
        ("landscape.barriers=['a", 2, "a quote or bracket is not closed"),
        ("landscape.fuel_model=1,99", 1, "run 1 (landscape.fuel_model=99): ignition at row 30"),
    ],
)
def test_a_sweep_is_refused_before_its_folder_exists(
    tmp_path: Path, values: str, exit_code: int, text: str
) -> None:
    out = tmp_path / "new" / "out"
    line = refused(exit_code, "sweep", str(write_flat(tmp_path)), "-o", str(out), "--vary", values)
    assert text in line
    assert not out.parent.exists()


def test_keys_with_an_effect_in_one_run_can_be_varied(tmp_path: Path) -> None:
    options = ["--vary", "fire.scheme=anyangle,probabilistic", "--vary", "fire.p_spread=0.1,0.2"]
    out = tmp_path / "out"
    result = call("fire", "sweep", str(write_flat(tmp_path)), "-o", str(out), *options)
    assert result.exit_code == 0, result.output


def test_lists_are_values_too() -> None:
    found = sweep_of("x", (), ["a=[1, 2],[{b = 3, c = 4}],'x,y',5"]).values
    assert found == (("[1, 2]",), ("[{b = 3, c = 4}]",), ("'x,y'",), ("5",))


def test_a_sweep_gives_each_warning_once(tmp_path: Path) -> None:
    options = ["--vary", "duration_s=20000,21000", "--set", "weather.0.dead_1h_pct=0.05"]
    out = tmp_path / "out"
    result = call("fire", "sweep", str(write_flat(tmp_path)), "-o", str(out), "--json", *options)
    assert result.exit_code == 0, result.output
    first, edge = result.stderr.splitlines()
    assert first.startswith("Warning: weather entry 0: dead_1h_pct = 0.05 %: probably a fraction")
    assert edge.startswith("Warning: the fire reached the edge of the landscape in 2 of 2 runs; ")
    assert json.loads(result.stdout)["warnings"] == [
        line.removeprefix("Warning: ") for line in (first, edge)
    ]


@pytest.mark.parametrize(
    ("time_zero", "warned"),
    [("2024-07-01T12:00:00-07:00", False), ("2023-07-01T12:00:00-07:00", True)],
)
def test_a_date_that_differs_from_the_weather_is_noted(
    tmp_path: Path, time_zero: str, warned: bool
) -> None:
    scenario = str(write_scenario(write_site(tmp_path)))
    commands = [
        ["fire", "run", scenario, "-o", str(tmp_path / "out")],
        ["config", "check", scenario],
    ]
    for command in commands:
        result = call(*command, "--set", f"time_zero={time_zero}")
        assert result.exit_code == 0, result.output
        line = "weather.csv: 0 s is 2024-07-01T12:00:00 in the weather, but time_zero = 2023-07-01"
        assert result.stderr.count(line) == warned


def test_files_of_a_killed_run_are_removed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / ".fire.part.nc").write_bytes(b"half")
    (out / "notes.txt").write_bytes(b"mine")
    assert call("fire", "run", str(write_flat(tmp_path)), "-o", str(out)).exit_code == 0
    assert {".fire.part.nc"}.isdisjoint(path.name for path in out.iterdir())
    assert (out / "notes.txt").read_bytes() == b"mine"


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("recipe.json", b"{", "recipe.json: is missing or corrupt, so the settings of the"),
        ("recipe.json", b"[1]", "recipe.json: is missing or corrupt"),
        ("recipe.json", b"{}", 'other settings (files: before "missing", now {'),
        ("000001.npz", b"", "000001.npz: is corrupt"),
        ("000001.npz", b"PK\x03\x04 and more", "000001.npz: is corrupt"),
        ("000001.geojson", b"[1]", "000001.geojson: is corrupt"),
        ("000001.geojson", b'{"properties": {}}', "000001.geojson: is corrupt"),
        ("000001.geojson", b"\xff", "000001.geojson: is corrupt"),
    ],
)
def test_damaged_results_are_named(tmp_path: Path, name: str, content: bytes, text: str) -> None:
    flat, out = str(write_flat(tmp_path)), tmp_path / "out"
    sweep = name.endswith("geojson")
    command = ["sweep", flat, "--vary", f"{WIND}=1,2"] if sweep else ["run", flat, "--members", "2"]
    assert call("fire", *command, "-o", str(out)).exit_code == 0
    (out / ("runs" if sweep else "members") / name).write_bytes(content)
    assert text in refused(1, *command, "-o", str(out))


@pytest.mark.parametrize("sweep", [False, True])
def test_an_interrupted_run_keeps_its_results(
    tmp_path: Path, sweep: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C arrives when the third of six results is written."""
    flat, out = str(write_flat(tmp_path)), tmp_path / "out"
    vary = ["sweep", flat, "--vary", f"{WIND}=1:6:1"]
    command = vary if sweep else ["run", flat, "--members", "6"]
    module: Any = fire_sweep if sweep else fire_members
    complete, saved = module.complete, []

    def interrupted(*arguments: Any) -> int:
        *others, save, progress = arguments

        def save_or_stop(result: Any, path: Path) -> None:
            save(result, path)
            saved.append(path)
            if len(saved) == 3:
                raise KeyboardInterrupt

        done: int = complete(*others, save_or_stop, progress)
        return done

    monkeypatch.setattr(module, "complete", interrupted)
    folder = out / ("runs" if sweep else "members")
    line = refused(130, *command, "-o", str(out))
    assert f"are kept in {folder}" in line
    assert 2 <= len([*folder.glob("0*")]) < 6
    monkeypatch.undo()
    assert call("fire", *command, "-o", str(out)).exit_code == 0


def test_an_interrupted_fire_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mission_service.simulation import fire_alone

    def interrupt(*arguments: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(fire_alone, "fire_of", interrupt)
    out = tmp_path / "out"
    line = refused(130, "run", str(write_flat(tmp_path)), "-o", str(out))
    assert line == "Error: interrupted; repeat the command"
    assert not out.exists()


def test_ctrl_c_before_the_simulation_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*arguments: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mission_service.config.scenario.load_scenario", interrupt)
    line = refused(130, "run", str(write_flat(tmp_path)), "-o", str(tmp_path / "out"))
    assert line == "Error: interrupted"
