"""``fire run --members``: probabilities in files, with equal bytes for any number of threads."""

import json
import os
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.patience import PATIENCE_S, wait_until
from tests.service.dask_cluster import ROOT, cluster
from tests.service.fires import (
    CSV,
    HEAD,
    LAND,
    TIFFS,
    write_flat,
    write_scenario,
    write_site,
)
from tests.service.test_cli import call
from tests.service.test_fire_cli import NAMES as PLAIN_NAMES
from tests.service.test_fire_cli import arrival_s, burn, raster
from tests.service.test_fire_sweep import sweep
from tests.service.test_live import CLI

MAPS = {
    "burn_probability.tif",
    "arrival_time_p10_s.tif",
    "arrival_time_p50_s.tif",
    "arrival_time_p90_s.tif",
    "flame_length_m.tif",
}
STYLES = {name.replace(".tif", ".qml") for name in MAPS}
NAMES = {*MAPS, *STYLES, "map.png", "summary.json", "members"}


def files_in(out: Path) -> dict[str, bytes]:
    """Return the content of each member's file and of each map."""
    paths = [*sorted((out / "members").glob("*.npz")), *(out / name for name in sorted(MAPS))]
    return {path.name: path.read_bytes() for path in paths}


def refused(*options: str) -> str:
    """Return the only line that a refused command prints."""
    result = call("fire", "run", *options)
    assert result.exit_code in (1, 2)
    assert "Traceback" not in result.output
    line: str = result.output.strip().splitlines()[-1]
    return line


def test_members_of_files_give_maps_that_agree_with_each_other(tmp_path: Path) -> None:
    site, out = write_site(tmp_path), tmp_path / "out"
    point = '[[ignition]]\nfile = "lit.geojson"\n[ensemble]\nignition_sd_m = 90\n'
    scenario = write_scenario(site, TIFFS, CSV, point)
    summary = burn(scenario, out, "--members", "21")
    assert {path.name for path in out.iterdir()} == NAMES
    share = raster(out / "burn_probability.tif")
    assert share.shape == LAND.shape
    assert np.allclose(share * 21, np.rint(share * 21), atol=1e-4)
    assert 0.9 < share.max() <= 1.0
    first, median, late = (raster(out / f"arrival_time_p{p}_s.tif") for p in (10, 50, 90))
    assert np.array_equal(first >= 0, np.rint(share * 21) >= 3)  # burned in at least 2.1 members
    assert np.array_equal(median >= 0, np.rint(share * 21) >= 11)
    assert np.array_equal(late >= 0, np.rint(share * 21) >= 19)
    assert (first[late >= 0] <= median[late >= 0]).all()
    assert (median[late >= 0] <= late[late >= 0]).all()
    flame_m = raster(out / "flame_length_m.tif")
    assert np.array_equal(flame_m >= 0.0, share > 0.0)
    assert 0.3 < np.median(flame_m[flame_m >= 0]) < 10.0
    cell_ha = LAND.cell_size_m**2 / 1e4
    assert summary["burned_area_mean_ha"] == pytest.approx(share.sum() * cell_ha, abs=0.01)
    assert json.loads((out / "summary.json").read_text()) == summary


def test_a_member_without_errors_is_the_plain_run(tmp_path: Path) -> None:
    flat = write_flat(tmp_path)
    none = [
        f"ensemble.{key}=0"
        for key in (
            "wind_log_sd",
            "wind_turn_sd_deg",
            "spread_log_sd",
            "fuel_log_sd",
            "moisture_log_sd",
            "ignition_sd_m",
        )
    ]
    options = [text for key in none for text in ("--set", key)]
    burn(flat, tmp_path / "one", "--members", "2", *options)
    burn(flat, tmp_path / "plain")
    assert {path.name for path in (tmp_path / "plain").iterdir()} == PLAIN_NAMES
    expected = arrival_s(tmp_path / "plain")
    assert np.array_equal(raster(tmp_path / "one" / "arrival_time_p50_s.tif"), expected)
    assert np.array_equal(raster(tmp_path / "one" / "burn_probability.tif"), expected >= 0.0)
    flame_m = raster(tmp_path / "one" / "flame_length_m.tif")
    assert flame_m == pytest.approx(raster(tmp_path / "plain" / "flame_length_m.tif"), rel=1e-6)


def test_a_killed_run_is_resumed_and_gives_the_same_bytes(tmp_path: Path) -> None:
    flat = write_flat(tmp_path)
    out, count = tmp_path / "killed", "400"
    command = [*CLI, "fire", "run", str(flat), "-o", str(out), "--members", count]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
    wait_until(lambda: len([*out.glob("members/0*.npz")]) >= 5)
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = {path.name: path.stat().st_mtime_ns for path in out.glob("members/0*.npz")}
    assert 5 <= len(before) < 400
    assert not [path for path in out.iterdir() if path.name != "members"]
    burn(flat, out, "--members", count)
    after = {path.name: path.stat().st_mtime_ns for path in out.glob("members/0*.npz")}
    assert len(after) == 400
    assert {name: after[name] for name in before} == before
    burn(flat, tmp_path / "whole", "--members", count, "--workers", "1")
    assert files_in(out) == files_in(tmp_path / "whole")


@pytest.mark.long
def test_a_dask_cluster_that_dies_is_one_line(tmp_path: Path) -> None:
    out = tmp_path / "dask"
    with cluster(1) as dask:
        options = ["--members", "2000", "--scheduler", dask.address]
        command = [*CLI, "fire", "run", str(write_flat(tmp_path)), "-o", str(out), *options]
        process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
        wait_until(lambda: len([*out.glob("members/0*.npz")]) >= 5)
    _, errors = process.communicate(timeout=4 * PATIENCE_S)
    assert process.returncode == 1
    (line,) = errors.splitlines()
    assert line.startswith(f"Error: fire run: {dask.address}: a task failed on the cluster: ")
    assert "check the cluster and run the command again" in line


@pytest.mark.long
def test_a_dask_worker_that_dies_costs_only_time(tmp_path: Path) -> None:
    flat = write_flat(tmp_path)
    out = tmp_path / "dask"
    with cluster(2) as dask:
        options = ["--members", "100", "--scheduler", dask.address]
        command = [*CLI, "fire", "run", str(flat), "-o", str(out), *options]
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)
        wait_until(lambda: len([*out.glob("members/0*.npz")]) >= 5)
        os.kill(dask.workers[0].pid, signal.SIGKILL)
        assert len([*out.glob("members/0*.npz")]) < 100
        assert process.wait(4 * PATIENCE_S) == 0
        vary = ["--vary", "weather.0.wind_speed_m_s=1,2"]
        remote = sweep(flat, tmp_path / "dask-sweep", *vary, "--scheduler", dask.address)
    burn(flat, tmp_path / "here", "--members", "100")
    assert files_in(out) == files_in(tmp_path / "here")
    assert remote == sweep(flat, tmp_path / "sweep", *vary)
    for name in ("sweep.csv", "fronts.geojson"):
        expected = (tmp_path / "sweep" / name).read_bytes()
        assert (tmp_path / "dask-sweep" / name).read_bytes() == expected


def test_other_settings_are_refused_and_name_the_difference(tmp_path: Path) -> None:
    flat = write_flat(tmp_path)
    out = tmp_path / "out"
    burn(flat, out, "--members", "2")
    before = files_in(out)
    base = [str(flat), "-o", str(out), "--members"]
    key = "scenario.weather.0.wind_speed_m_s: before 2.0, now 3.0"
    assert key in refused(*base, "2", "--set", "weather.0.wind_speed_m_s=3")
    assert "members: before 2, now 3" in refused(*base, "3")
    assert "scenario.ensemble.wind_log_sd" in refused(*base, "2", "--set", "ensemble.wind_log_sd=1")
    assert files_in(out) == before


def test_a_damaged_result_is_named(tmp_path: Path) -> None:
    flat, out = write_flat(tmp_path), tmp_path / "out"
    burn(flat, out, "--members", "2")
    damaged = out / "members" / "000001.npz"
    for content in (b"", damaged.read_bytes()[:-30], b"text"):
        damaged.write_bytes(content)
        line = refused(str(flat), "-o", str(out), "--members", "2")
        assert f"{damaged}: is corrupt" in line
        assert "delete it and repeat" in line
    damaged.unlink()
    burn(flat, out, "--members", "2")


def test_changed_input_files_are_refused(tmp_path: Path) -> None:
    site, out = write_site(tmp_path), tmp_path / "out"
    scenario = write_scenario(site, head=HEAD)
    burn(scenario, out, "--members", "2")
    weather = site / "weather.csv"
    weather.write_text(weather.read_text().replace(",5,270,", ",6,270,"), encoding="utf-8")
    assert "weather.csv: before" in refused(str(scenario), "-o", str(out), "--members", "2")


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--members", "2", "--front-every", "60"], "--front-every has no effect with --members"),
        (["--workers", "2"], "--workers has no effect without --members"),
        (["--scheduler", "tcp://x:1"], "--scheduler has no effect without --members"),
        (["--members", "0"], "0 is not in the range"),
        (["--members", "2", "--set", "ensemble.wind_log_sd=-1"], "ensemble.wind_log_sd"),
        (["--members", "2", "--set", "ensemble.wind_log_sd=1000"], "ensemble.wind_log_sd"),
        (["--set", "time_zero=9999-12-31T23:59:00Z"], "use a year from 1900 to 2200"),
        (["--members", "2", "--set", "ignition.0.at_s=9000"], "must be before"),
        (["--members", "2", "--set", "ignition.0.lat_deg=10"], "outside the landscape"),
    ],
)
def test_wrong_options_are_refused(tmp_path: Path, options: list[str], text: str) -> None:
    flat = write_flat(tmp_path)
    assert text in refused(str(flat), "-o", str(tmp_path / "out"), *options)
    assert not [*(tmp_path / "out").glob("members/0*")]


def test_a_folder_holds_the_results_of_one_command(tmp_path: Path) -> None:
    flat, out = write_flat(tmp_path), tmp_path / "out"
    burn(flat, out, "--netcdf")
    assert (out / "fire.nc").exists()
    line = refused(str(flat), "-o", str(out), "--members", "2")
    assert "contains results of fire run (arrival_time_s.tif); choose another folder" in line
    burn(flat, out)
    assert not (out / "fire.nc").exists()
    many = tmp_path / "many"
    burn(flat, many, "--members", "2")
    line = refused(str(flat), "-o", str(many))
    assert "contains results of fire run --members (members)" in line


def test_members_that_reach_the_edge_give_a_warning(tmp_path: Path) -> None:
    flat = write_flat(tmp_path)
    summary = burn(flat, tmp_path / "out", "--members", "2", "--set", "duration_s=20000")
    assert summary["reached_edge"]
    assert "one or more members reached the edge" in summary["warnings"][-1]
