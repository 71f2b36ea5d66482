"""``mission-service log``: figures, damage, and files for other programs."""

import csv
import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from autopilot_bridge.logs.reading import open_log
from autopilot_bridge.missions.plan_file import read_any
from mission_service.replay.flights.flown_vehicle import info_of
from tests.bridge.log_writers import bin_flight, ulg_flight
from tests.service.test_cli import call


@pytest.fixture
def logs(tmp_path: Path) -> tuple[Path, Path]:
    """Return a plane's .bin with a truncated end, and a PX4's .ulg."""
    one, other = tmp_path / "hawk.bin", tmp_path / "kite.ulg"
    one.write_bytes(bin_flight()[:-5])
    other.write_bytes(ulg_flight())
    return one, other


def test_a_flight_in_figures(logs: tuple[Path, Path]) -> None:
    info = info_of(open_log(logs[0]))
    (flown,) = info["vehicles"]
    assert len(info["damage"]) == 1
    assert flown["autopilot"] == "ardupilot plane"
    assert flown["positions"] == 40
    assert flown["flown_m"] == pytest.approx(39 * 8.96, abs=2.0)  # each 1e-4 deg of longitude
    assert flown["highest_above_start_m"] == 39.0
    assert flown["max_speed_m_s"] == pytest.approx(14.6, abs=0.1)
    assert flown["missions"] == [{"at_s": 0.0, "items": 2}]
    assert [(each["mode"], each["armed"]) for each in flown["modes"]][:2] == [
        ("mission", False),
        ("mission", True),
    ]
    (other,) = info_of(open_log(logs[1]))["vehicles"]
    assert other["vehicle"] == 3
    assert other["gripper_releases"] == 1
    assert other["begin_utc"].startswith("2026-09-21T")


def test_a_turn_back_and_what_servos_let_go_are_found(tmp_path: Path) -> None:
    from tests.bridge.log_writers import dataflash

    path = tmp_path / "drops.bin"
    messages = [("MSG", 1_000_000, "ArduCopter V4.6.2"), ("MODE", 1_000_000, 3, 3)]
    messages += [("MISE", 2_000_000 + seq * 1_000_000, 9, seq) for seq in (1, 2, 3)]
    messages += [("MISE", 6_500_000, 9, 2)]
    path.write_bytes(dataflash(messages))
    (flown,) = info_of(open_log(path))["vehicles"]
    assert flown["turned_back_at_s"] == [5.5]
    assert flown["items_reached"] == 2


def test_info_prints_all_logs_and_reports_damage(logs: tuple[Path, Path]) -> None:
    result = call("log", "info", *map(str, logs))
    assert result.exit_code == 0
    assert "DAMAGED:" in result.output
    assert "vehicle 1 (hawk-1), ardupilot plane" in result.output
    assert "vehicle 3 (kite-3), px4 plane: from 2026-" in result.output
    assert "mission, armed" in result.output
    info = json.loads(call("log", "info", "--json", str(logs[1])).output)
    assert info[0]["vehicles"][0]["autopilot"] == "px4 plane"


def test_export_writes_what_other_programs_read(logs: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = call("log", "export", *map(str, logs), "-o", str(out))
    assert result.exit_code == 0
    assert "DAMAGED" in result.stderr
    with (out / "positions.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 80
    assert rows[0]["log"] == "hawk.bin"
    assert float(rows[1]["lon_deg"]) == pytest.approx(-84.1999)
    assert rows[40]["utc"].endswith("+00:00")
    features = json.loads((out / "tracks.geojson").read_text())["features"]
    assert [each["properties"]["vehicle"] for each in features] == ["hawk-1", "kite-3"]
    assert len(features[0]["geometry"]["coordinates"]) >= 4  # once a second
    tree = ElementTree.parse(out / "tracks.kml")
    tracks = tree.findall(".//{http://www.google.com/kml/ext/2.2}Track")
    assert len(tracks) == 2
    assert len(tracks[0]) == 1 + 2 * len(features[0]["geometry"]["coordinates"])
    plan = read_any(out / "hawk-1-mission-1.plan")
    assert [item.command for item in plan.mission] == [22, 16]


def test_what_is_no_log_gets_one_line_and_exit_code_1(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("nothing")
    for words in (("info", str(path)), ("export", str(path), "-o", str(tmp_path / "out"))):
        result = call("log", *words)
        assert result.exit_code == 1
        assert result.stderr.count("\n") == 1
        assert "not a supported log" in result.stderr
