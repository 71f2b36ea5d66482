"""``fire sweep``: simulations for all combinations of values."""

import csv
import json
from pathlib import Path

import pytest

from mission_service.errors import ScenarioError
from mission_service.simulation.fire_sweep import sweep_of
from tests.service.fires import write_flat
from tests.service.test_cli import call
from tests.service.test_fire_cli import burn

WIND, FUEL = "weather.0.wind_speed_m_s", "landscape.fuel_model"


def sweep(scenario: Path, out: Path, *options: str) -> dict[str, object]:
    result = call("fire", "sweep", str(scenario), "-o", str(out), "--json", *options)
    assert result.exit_code == 0, result.output
    found: dict[str, object] = json.loads(result.stdout)
    return found


def table(out: Path) -> list[dict[str, str]]:
    with (out / "sweep.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def contents(out: Path) -> dict[str, bytes]:
    return {
        path.name: path.read_bytes() for path in sorted(out.rglob("*")) if path.name[0] in "0fs"
    }


def test_each_combination_is_the_run_with_these_values(tmp_path: Path) -> None:
    flat = write_flat(tmp_path)
    out = tmp_path / "out"
    summary = sweep(flat, out, "--vary", f"{WIND}=1:3:2", "--vary", f"{FUEL}=1,2")
    rows = table(out)
    assert [(row[WIND], row[FUEL]) for row in rows] == [
        ("1", "1"),
        ("1", "2"),
        ("3", "1"),
        ("3", "2"),
    ]
    for row in rows:
        keys = [text for key in (WIND, FUEL) for text in ("--set", f"{key}={row[key]}")]
        alone = burn(flat, tmp_path / f"alone-{row['run']}", *keys)
        assert int(row["burned_cells"]) == alone["burned_cells"]
        assert float(row["area_ha"]) == alone["burned_area_ha"]
    assert summary["runs"] == summary["burned_now"] == 4
    assert summary["max_area_ha"] == max(float(row["area_ha"]) for row in rows)
    features = json.loads((out / "fronts.geojson").read_text())["features"]
    assert [each["properties"]["run"] for each in features] == [0, 1, 2, 3]
    assert features[3]["properties"][WIND] == "3"
    assert {path.name for path in out.iterdir()} == {"runs", "sweep.csv", "fronts.geojson"}


def test_only_missing_runs_are_burned_and_other_settings_refused(tmp_path: Path) -> None:
    flat = write_flat(tmp_path)
    out, vary = tmp_path / "out", ["--vary", f"{WIND}=1,2,3"]
    sweep(flat, out, *vary)
    before = contents(out)
    (out / "runs" / "000001.geojson").unlink()
    assert sweep(flat, out, *vary, "--workers", "1")["burned_now"] == 1
    assert contents(out) == before
    for options, text in [
        ([*vary, "--set", "seed=4"], "scenario.seed: before 3, now 4"),
        (["--vary", f"{WIND}=1,2"], "before"),
    ]:
        result = call("fire", "sweep", str(flat), "-o", str(out), *options)
        assert result.exit_code == 1
        assert "contains results with other settings" in result.output
        assert text in result.output
    assert contents(out) == before


def test_a_failed_sweep_names_the_run_and_can_be_corrected(tmp_path: Path) -> None:
    flat = write_flat(tmp_path)
    out, key = tmp_path / "out", "ignition.0.lat_deg"
    result = call("fire", "sweep", str(flat), "-o", str(out), "--vary", f"{key}=10,37.0")
    assert result.exit_code == 1
    assert result.output.count("\n") == 1
    assert f"run 0 ({key}=10): ignition at lat 10.0" in result.output
    assert sweep(flat, out, "--vary", f"{key}=37.0,37.001")["runs"] == 2


def test_an_unknown_key_is_refused(tmp_path: Path) -> None:
    flat = write_flat(tmp_path)
    for key, text in [("weather.9.at_s", "--vary weather.9.at_s=1: "), ("fire.no", "fire.no")]:
        result = call("fire", "sweep", str(flat), "-o", str(tmp_path), "--vary", f"{key}=1,2")
        assert result.exit_code == 2
        assert text in result.output


def test_ranges_contain_their_ends_and_are_exact() -> None:
    assert sweep_of("x", (), ["a=0.1:0.5:0.1"]).values == (
        ("0.1",),
        ("0.2",),
        ("0.3",),
        ("0.4",),
        ("0.5",),
    )
    assert sweep_of("x", (), ["a=1:4:2", "b=x,y"]).values == (
        ("1", "x"),
        ("1", "y"),
        ("3", "x"),
        ("3", "y"),
    )
    assert sweep_of("x", (), ["a=2026-08-01T12:00:00"]).values == (("2026-08-01T12:00:00",),)


@pytest.mark.parametrize(
    ("varied", "text"),
    [
        (["a"], "write it as KEY=VALUES"),
        (["a="], "write it as KEY=VALUES"),
        (["a=1", "a=2"], "appears twice"),
        (["a=1,1"], "appears twice"),
        (["a=1,,2"], "is empty"),
        (["a=1:2:0"], "positive step"),
        (["a=nan:2:1"], "positive step"),
        (["a=2:1:1"], "swap them"),
        (["a=0:1e9:1"], "1000000001 values"),
        (["a=1:200:1", "b=1:200:1"], "40000 runs"),
    ],
)
def test_wrong_values_are_refused(varied: list[str], text: str) -> None:
    with pytest.raises(ScenarioError, match=text):
        sweep_of("x", (), varied)
