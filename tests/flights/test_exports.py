"""``mission-service log export``: tables, and the contents of files for Foxglove."""

import csv
import json
import math
import sys
from collections import Counter
from datetime import datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jsonschema
import pyarrow.parquet
import pytest
from mcap.reader import make_reader
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.tlog_writer import Tlog
from autopilot_bridge.logs.entries import MissionLoaded, Outputs
from autopilot_bridge.logs.reading import open_log
from autopilot_bridge.vehicle.client_events import Attitude, Position, Wind
from mission_service.replay.flights import table_files
from mission_service.replay.flights.exports import WRITTEN, export
from mission_service.replay.flights.flight_tables import OWN, TABLES, Rows
from mission_service.replay.flights.foxglove import messages_of, mission_geojson, quaternion
from tests.bridge.log_writers import BEGIN_US, bin_flight, dataflash, ulg_flight
from tests.service.test_cli import call

BIN_TABLES = {
    *("positions", "attitudes", "speeds", "winds", "batteries", "fixes", "modes", "missions"),
    *("progress", "outputs", "events"),
}
POSITION = Position(7, 7, 36.3, -84.2, 300.0, 10.0, 1.0, 2.0, math.nan, 90.0)


@pytest.fixture
def logs(tmp_path: Path) -> list[Path]:
    one, other = tmp_path / "hawk.bin", tmp_path / "kite.ulg"
    one.write_bytes(bin_flight())
    other.write_bytes(ulg_flight())
    return [one, other]


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


def exported(logs: list[Path], out: Path, *formats: str) -> list[str]:
    return export([open_log(path) for path in logs], out, formats)


def csv_rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def messages(path: Path) -> list[tuple[str, str, int, dict[str, Any]]]:
    """Yield topic, schema, time and content of each message, validated by its schema."""
    found = []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            content = json.loads(message.data)
            jsonschema.validate(content, json.loads(schema.data))
            assert message.publish_time == message.log_time
            found.append((channel.topic, schema.name, message.log_time, content))
    return found


def test_each_table_that_has_rows_is_a_csv(logs: list[Path], out: Path) -> None:
    files = exported(logs[:1], out, "csv")
    assert set(files) == {f"{table}.csv" for table in BIN_TABLES}
    assert {path.name for path in out.iterdir()} == {*files, WRITTEN}
    for table in BIN_TABLES:
        assert list(csv_rows(out / f"{table}.csv")[0]) == list(TABLES[table])
    first, *_, last = csv_rows(out / "attitudes.csv")
    assert (first["log"], first["vehicle"], first["at_us"]) == ("hawk.bin", "1", "1100000")
    assert (first["roll_deg"], first["pitch_deg"], first["yaw_deg"]) == ("1.5", "12.25", "271.5")
    gps_began = datetime.fromisoformat(first["utc"])
    assert (datetime.fromisoformat(last["utc"]) - gps_began).total_seconds() == 3.9
    items = csv_rows(out / "missions.csv")
    assert [(row["mission"], row["seq"], row["command_name"]) for row in items] == [
        ("1", "0", "NAV_TAKEOFF"),
        ("1", "1", "NAV_WAYPOINT"),
    ]
    assert (items[1]["lat_deg"], items[1]["altitude_m"]) == ("36.31", "90.0")
    pulses = [(row["servo2_us"], row["servo4_us"]) for row in csv_rows(out / "outputs.csv")]
    assert pulses == [("1100", ""), ("1900", "")]  # only the new ones of 40 items
    progress = [(row["kind"], row["seq"]) for row in csv_rows(out / "progress.csv")]
    assert progress == [("begun", "0"), ("reached", "0"), ("begun", "1")]
    events = [(row["kind"], row["text"]) for row in csv_rows(out / "events.csv")]
    assert ("connected", "ardupilot plane") in events
    assert ("text", "ArduPlane V4.6.2 (deadbeef)") in events


def test_a_table_without_rows_is_not_written(logs: list[Path], out: Path) -> None:
    files = exported(logs[1:], out, "csv", "parquet")
    assert "missions.csv" not in files
    assert not (out / "missions.csv").exists()
    assert not (out / "missions.parquet").exists()
    assert ("gripper", "release") in [
        (row["kind"], row["text"]) for row in csv_rows(out / "events.csv")
    ]


def test_parquet_has_the_rows_of_csv_with_types(logs: list[Path], out: Path) -> None:
    exported(logs, out, "csv", "parquet")
    for table in BIN_TABLES:
        read = pyarrow.parquet.read_table(out / f"{table}.parquet")
        assert read.column_names == list(TABLES[table])
        rows = csv_rows(out / f"{table}.csv")
        assert read.num_rows == len(rows) > 0
        for typed, written in zip(read.to_pylist(), rows, strict=True):
            at = typed.pop("utc")
            assert written.pop("utc") == (
                "" if at is None else at.isoformat(timespec="milliseconds")
            )
            assert {
                name: "" if value is None else str(value) for name, value in typed.items()
            } == written
    schema = pyarrow.parquet.read_schema(out / "positions.parquet")
    assert [str(field.type) for field in schema][:5] == [
        *("string", "int64", "int64", "timestamp[us, tz=UTC]"),
        "double",
    ]
    kite = pyarrow.parquet.read_table(out / "positions.parquet").to_pylist()[40]
    assert kite["utc"].timestamp() == (BEGIN_US + kite["at_us"]) / 1e6


def test_parquet_holds_back_one_group_of_rows(
    logs: list[Path], out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_files, "GROUP_ROWS", 12)
    exported(logs, out, "parquet")
    metadata = pyarrow.parquet.ParquetFile(out / "positions.parquet").metadata
    assert [metadata.row_group(at).num_rows for at in range(metadata.num_row_groups)] == [
        12
    ] * 6 + [8]


def test_mcap_has_all_logs_on_one_clock(logs: list[Path], out: Path) -> None:
    assert exported(logs, out, "mcap") == ["flight.mcap"]
    found = messages(out / "flight.mcap")
    with (out / "flight.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(found)
    counts = Counter((topic, schema) for topic, schema, _, _ in found)
    assert counts["/hawk-1/location", "foxglove.LocationFix"] == 40
    assert counts["/hawk-1/pose", "foxglove.PoseInFrame"] == 40
    assert counts["/hawk-1/mission", "foxglove.GeoJSON"] == 1
    assert counts["/hawk-1/speeds", "mission_service.speeds"] == 40
    assert counts["/hawk-1/outputs", "mission_service.outputs"] == 2
    assert counts["/kite-3/location", "foxglove.LocationFix"] == 40
    assert counts["/kite-3/log", "foxglove.Log"] > 2
    kite = [each for each in found if each[0] == "/kite-3/location"]
    assert [at_ns for _, _, at_ns, _ in kite] == [
        (BEGIN_US + 2_100_000 + 100_000 * number) * 1000 for number in range(40)
    ]
    stamp = kite[1][3]["timestamp"]
    assert stamp == {"sec": (BEGIN_US + 2_200_000) // 1_000_000, "nsec": 200_000_000}
    assert kite[1][3]["latitude"] == pytest.approx(36.3001)
    hawk = next(each for each in found if each[0] == "/hawk-1/mission")
    points = json.loads(hawk[3]["geojson"])["features"]
    assert [each["properties"]["name"] for each in points] == [
        *("mission", "0 NAV_TAKEOFF", "1 NAV_WAYPOINT"),
    ]


def test_mcap_keeps_the_logs_own_clocks_if_there_is_no_other(tmp_path: Path, out: Path) -> None:
    from tests.bridge.log_writers import ulog

    dated, undated = tmp_path / "kite.ulg", tmp_path / "crow.ulg"
    dated.write_bytes(ulg_flight())
    undated.write_bytes(ulog([("L", ord("4"), 1_000_000, "no fix")]))
    exported([dated, undated], out, "mcap")
    found = messages(out / "flight.mcap")
    crow = [each for each in found if each[0] == "/crow-3/log"]
    assert [(at_ns, content["level"], content["message"]) for _, _, at_ns, content in crow] == [
        (1_000_000_000, 3, "no fix")  # a warning
    ]
    kite = next(each for each in found if each[0] == "/kite-3/location")
    assert kite[2] == 2_100_000_000


def test_a_track_without_a_date_is_a_line_without_times(tmp_path: Path, out: Path) -> None:
    path = tmp_path / "crow.bin"
    places = [(1_000_000 * at, 36.3, -84.2 + at / 1e4, 300.0, 0.0, 0.0) for at in range(3)]
    path.write_bytes(dataflash([("POS", *place) for place in places]))
    exported([path], out, "kml")
    text = (out / "tracks.kml").read_text(encoding="utf-8")
    assert "1970" not in text
    assert "no calendar date" in text
    line = ElementTree.fromstring(text).find(".//{http://www.opengis.net/kml/2.2}coordinates")
    assert line is not None
    assert line.text is not None
    assert line.text.split()[:2] == [
        "-84.2000000,36.3000000,300.00",
        "-84.1999000,36.3000000,300.00",
    ]


def test_the_same_logs_make_the_same_bytes(logs: list[Path], tmp_path: Path) -> None:
    formats = ("geojson", "kml", "csv", "plan", "parquet", "mcap")
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        folder.mkdir()
        files = exported(logs, folder, *formats)
    assert len(files) == 2 * len(BIN_TABLES) + 4  # two files of tracks, flight.mcap, and a mission
    for name in files:
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name


def test_logs_of_one_name_stay_apart(tmp_path: Path, out: Path) -> None:
    paths = [tmp_path / "hawk.bin", tmp_path / "other" / "hawk.bin", tmp_path / "hawk.ulg"]
    paths[1].parent.mkdir()
    for path in paths[:2]:
        path.write_bytes(bin_flight())
    paths[2].write_bytes(ulg_flight())
    files = exported(paths, out, "plan", "mcap")
    assert files[1:] == ["hawk-1-mission-1.plan", "hawk-1.bin-mission-1.plan"]
    names = {topic.split("/")[1] for topic, *_ in messages(out / "flight.mcap")}
    assert names == {"hawk-1", "hawk-1.bin", "hawk-3"}


@pytest.mark.parametrize(("each", "library"), [("parquet", "pyarrow"), ("mcap", "mcap")])
def test_without_its_library_a_format_gets_one_line(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, each: str, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    out = tmp_path / "none"
    words = ("log", "export", str(logs[0]), "-o", str(out))
    result = call(*words, "--format", "csv", "--format", each)
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert f"{each} needs {library}" in result.stderr
    assert "pip install 'mission-service[export]'" in result.stderr
    assert not out.exists()
    assert call(*words).exit_code == 0  # no other part needs the library


def test_only_what_is_asked_for_is_written(logs: list[Path], out: Path) -> None:
    words = ("log", "export", str(logs[0]), "-o", str(out), "--format", "kml", "--format", "mcap")
    result = call(*words)
    assert result.exit_code == 0
    assert {path.name for path in out.iterdir()} == {"tracks.kml", "flight.mcap"}


def test_files_of_an_earlier_export_are_removed(logs: list[Path], out: Path) -> None:
    mine = ("notes.txt", "hawk-mission-9.plan", "winds.csv")
    out.mkdir(exist_ok=True)
    for name in mine:
        (out / name).write_text("mine")
    for log in logs:
        assert call("log", "export", str(log), "-o", str(out)).exit_code == 0
    alone = out.with_name("alone")
    assert call("log", "export", str(logs[1]), "-o", str(alone)).exit_code == 0
    names = {path.name for path in alone.iterdir()}
    assert {path.name for path in out.iterdir()} == names.union(mine)
    call("log", "export", str(logs[0]), "-o", str(out), "--format", "kml")
    assert {path.name for path in out.iterdir()} == names.union(mine)


def test_a_log_without_a_vehicle_gets_one_line(tmp_path: Path) -> None:
    log = tmp_path / "station.tlog"
    station = (mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
    with Tlog(log, lambda: 1_790_000_000_000_000, pytest.fail) as tlog:
        tlog.record([Codec(255, 190).encode(mavlink.MAVLink_heartbeat_message(*station, 3))] * 3)
    result = call("log", "export", str(log), "-o", str(tmp_path / "out"))
    assert result.exit_code == 1
    assert f"no vehicle in {log}" in result.stderr
    assert not (tmp_path / "out").exists()


def test_missing_values_are_left_empty() -> None:
    rows = list(Rows("a.tlog", None).of(1, POSITION))
    ((table, row),) = rows
    assert table == "positions"
    assert row == ("a.tlog", 1, 7, None, 36.3, -84.2, 300.0, 10.0, 1.0, 2.0, None, 90.0)
    shown = {each.topic: each.content for each in messages_of("a", 7000, POSITION, rows)}
    assert "velocity_down_m_s" not in shown["positions"]
    assert shown["location"]["heading"] == pytest.approx(math.pi / 2)
    assert shown["location"]["timestamp"] == {"sec": 0, "nsec": 7000}


def test_noise_has_no_time_and_numbers_are_of_their_columns_kind() -> None:
    rows = Rows("a.ulg", 0)
    assert not list(rows.of(1, Wind(1 << 63, 10.0, 3.0)))
    ((_, row),) = rows.of(1, Wind(5, 10, 3.0))
    assert isinstance(row[4], float)
    assert len(next(iter(rows.of(1, Outputs(6, tuple(range(20))))))[1]) == len(TABLES["outputs"])
    assert list(rows.of(2, Outputs(7, tuple(range(20)))))  # the first item of another vehicle
    assert not list(rows.of(1, Outputs(8, tuple(range(20)))))


def test_places_of_items_are_only_those_in_degrees() -> None:
    jump = MissionItem(177, 2, 0, 0, 0.0, 1.0, 2.0)
    fix = MissionItem(22, 3, 0, 0, 50.0)
    local = MissionItem(16, 1, 100_000, 200_000, -5.0)
    roi = MissionItem(201, 0, 363000000, -842000000, 300.0)
    items = (jump, fix, local, roi, MissionItem(16, 3, 363100000, -842000000, 40.0))
    rows = [row for _, row in Rows("a.tlog", 0).of(1, MissionLoaded(5, items))]
    own = [dict(zip(OWN["missions"], row[4:], strict=True)) for row in rows]
    places = [(each["lat_deg"], each["lon_deg"], each["altitude_m"]) for each in own]
    assert places == [
        *((None, None, None), (None, None, 50.0), (None, None, None)),
        *((36.3, -84.2, 300.0), (36.31, -84.2, 40.0)),
    ]
    assert own[2]["param5"] == 10.0  # metres
    names = [each["properties"]["name"] for each in mission_geojson(items)["features"]]
    assert names == ["3 DO_SET_ROI", "4 NAV_WAYPOINT"]  # there is one destination and no line


@pytest.mark.parametrize(
    ("attitude", "forward", "up"),
    [
        ((0.0, 0.0, 0.0), (0, 1, 0), (0, 0, 1)),  # north
        ((0.0, 0.0, 90.0), (1, 0, 0), (0, 0, 1)),  # east
        ((0.0, 90.0, 0.0), (0, 0, 1), (0, -1, 0)),  # nose up
        ((90.0, 0.0, 0.0), (0, 1, 0), (1, 0, 0)),  # right wing down
    ],
)
def test_a_pose_turns_the_vehicles_axes_to_east_north_up(
    attitude: tuple[float, float, float], forward: tuple[int, ...], up: tuple[int, ...]
) -> None:
    turn = quaternion(Attitude(0, 0, *attitude))
    x, y, z, w = (turn[axis] for axis in "xyzw")
    turned_x = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    turned_z = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    assert turned_x == pytest.approx(forward, abs=1e-12)
    assert turned_z == pytest.approx(up, abs=1e-12)
