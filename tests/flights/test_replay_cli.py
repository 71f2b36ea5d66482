"""``replay`` and ``report`` on the command line."""

import json
from pathlib import Path

import pytest

from mission_service.simulation.sim import simulate
from tests.bridge.log_writers import round_flight
from tests.flights.test_open_loop_replay import lit, scenario
from tests.service.test_cli import call


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "round.bin"
    path.write_bytes(round_flight())
    return path


@pytest.fixture
def fire(tmp_path: Path) -> Path:
    """Return a scenario file with the fire of this test."""
    path = tmp_path / "level.toml"
    ignitions = "".join(
        f"[[ignition]]\nlat_deg = {lat}\nlon_deg = {lon}\n" for lat, lon in lit(36.35, -84.16)
    )
    path.write_text(
        'name = "level"\nduration_s = 7200\ndeploy_at_s = 3600\n'
        '[landscape]\nsource = "flat"\nrows = 120\ncols = 120\nlat_deg = 36.35\n'
        "lon_deg = -84.16\nelevation_m = 300\n"
        "[[weather]]\nat_s = 0\nwind_speed_m_s = 1\nwind_from_deg = 200\n"
        f"{ignitions}"
        '[[vehicles]]\nname = "hawk"\nhome_lat_deg = 36.35\nhome_lon_deg = -84.16\n'
    )
    return path


def test_a_log_alone_in_figures(log: Path) -> None:
    result = call("replay", f"hawk={log}")
    assert result.exit_code == 0
    assert "ardupilot plane" in result.output
    assert "hawk turned back at 100." in result.output
    report = json.loads(call("replay", str(log), "--json").output)
    assert report["fire"] is None
    assert report["vehicles"][0]["positions"] == 640


def test_a_log_near_a_fire_leaves_a_report_and_a_journal(
    log: Path, fire: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    words = ("replay", f"hawk={log}", "--scenario", str(fire), "--out", str(out))
    result = call(*words, "--planner", "circling", "--set", "planner.alpha=2")
    assert result.exit_code == 0, result.output
    assert "report.html" in result.output
    assert call("replay", str(out), "--verify").exit_code == 0
    header = json.loads((out / "journal.jsonl").read_text().partition("\n")[0])["header"]
    assert header["scenario"]["planner"]["rule"] == "circling"
    assert header["scenario"]["planner"]["alpha"] == 2
    # The output folder can be used like that of any other run.
    report = json.loads(call("replay", str(out), "--json").output)
    assert report["vehicles"][0]["name"] == "hawk"
    assert report["fire"]["rule"] == "circling"


@pytest.mark.long
def test_a_journal_has_a_scenario_of_its_own(tmp_path: Path) -> None:
    run, out = tmp_path / "run", tmp_path / "out"
    run.mkdir()
    home = {"home_lat_deg": 36.346, "home_lon_deg": -84.16, "autostart": True}
    changed = scenario(duration_s=3800.0, vehicles=[{"name": "hawk", **home}])
    simulate(changed, run / "journal.jsonl", "today")
    result = call("replay", str(run), "--planner", "islam_hu", "--out", str(out))
    assert result.exit_code == 0, result.output
    sides = tmp_path / "sides"
    result = call("report", str(run), str(out), "--out", str(sides), "--json")
    assert result.exit_code == 0, result.output
    one, other = json.loads(result.output)
    assert (one["name"], other["name"]) == ("run", "out")
    assert one["vehicles"][0]["flown_m"] == other["vehicles"][0]["flown_m"]
    assert (one["fire"]["rule"], other["fire"]["rule"]) == ("circling", "islam_hu")
    assert len(one["vehicles"][0]["missions"]) > 1
    assert other["vehicles"][0]["missions"] == []  # a replay sends no missions
    assert "map-run.png" in {path.name for path in sides.iterdir()}


@pytest.mark.long
def test_what_if_leaves_both_runs_on_one_page(tmp_path: Path) -> None:
    home = {"home_lat_deg": 36.346, "home_lon_deg": -84.16, "autostart": True}
    changed = scenario(duration_s=3700.0, vehicles=[{"name": "hawk", **home}])
    simulate(changed, tmp_path / "journal.jsonl", "today")
    out = tmp_path / "out"
    result = call(
        "replay", str(tmp_path), "--what-if", "planner=islam_hu_damped", "--out", str(out)
    )
    assert result.exit_code == 0, result.output
    page = (out / "report.html").read_text()
    assert "<th>recorded</th><th>what-if</th>" in page


def test_settings_in_the_environment_change_no_replay_without_a_scenario(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MISSION_SERVICE_SET", "planner.alpha=2")
    assert call("replay", str(log)).exit_code == 0
    for words in (("--verify",), ("--what-if", "planner=circling", "--out", str(log.parent))):
        result = call("replay", str(log), *words)
        assert result.exit_code == 1
        assert "not a journal" in result.stderr
    assert call("replay", str(log), "--verify", "--set", "planner.alpha=2").exit_code == 2


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (("LOG", "--planner", "circling"), 1, "specify one with --scenario"),
        (("LOG", "--from", "1e6"), 1, "no vehicle in this part of the logs"),
        (("LOG", "--scenario", "demo", "--planner", "sideways"), 2, "no such rule"),
        (("LOG", "--verify"), 1, "not a journal"),
        (("LOG", "LOG", "--verify"), 2, "one journal"),
        (("LOG", "--verify", "--at", "3"), 2, "a complete journal"),
        (("LOG", "--what-if", "planner=islam_hu_damped"), 2, "--out"),
        (("LOG", "--stage", "core"), 2, "--verify"),
        (("LOG", "--from", "nan"), 2, "must be 0 s or more"),
        (("LOG", "--to", "inf"), 2, "must be 0 s or more"),
        (("LOG", "--at", "-50"), 2, "must be 0 s or more"),
        (("nowhere.tlog",), 1, "nowhere.tlog"),
        (("notes.txt",), 1, "not a supported log"),
    ],
)
def test_invalid_input_is_reported_in_one_line(
    log: Path, words: tuple[str, ...], code: int, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(log.parent)
    Path("notes.txt").write_text("nothing")
    result = call("replay", *(str(log) if word == "LOG" else word for word in words))
    assert result.exit_code == code
    assert expected in result.stderr
    if code == 1:
        assert result.stderr.count("\n") == 1
