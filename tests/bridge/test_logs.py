"""Flight logs: their contents, truncated files and damaged files."""

import json
import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import DFReader, mavutil
from pyulog import ULog

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.links.tlog_writer import Tlog
from autopilot_bridge.logs import record_scanner
from autopilot_bridge.logs.dataflash import DataFlashLog
from autopilot_bridge.logs.entries import (
    Entry,
    GripperMoved,
    Log,
    MissionLoaded,
    MissionReplaced,
    Outputs,
)
from autopilot_bridge.logs.reading import merged, open_log
from autopilot_bridge.logs.tlog import TlogLog
from autopilot_bridge.logs.ulog import UlogLog
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.client_events import (
    Attitude,
    Connected,
    GpsFix,
    ItemReached,
    LinkLost,
    LinkRestored,
    MissionProgress,
    ModeChanged,
    Position,
    Speed,
    Text,
    Wind,
)
from tests.bridge import log_writers
from tests.bridge.helpers import SECOND, Pair, flight_of, mock_of
from tests.bridge.log_writers import BEGIN_US, FORMATS, bin_flight, dataflash, ulg_flight, ulog

FLIGHTS = Path(__file__).parents[3] / "shared" / "data" / "flights"


# Flights that are read -----------------------------------------------------------------------


class JournalReader(MemoryLink):
    """A link whose frames are written to a .tlog when they are sent."""

    def __init__(self, tlog: list[tuple[int, bytes]]) -> None:
        super().__init__()
        self._frames = tlog

    def send(self, datagram: bytes, now_us: int) -> None:
        self._frames.append((now_us, datagram))
        super().send(datagram, now_us)


@pytest.fixture(scope="module", params=["ardupilot", "px4"])
def recorded(request: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Pair]:
    """Record half a minute of a mock's flight with its upload, followed by a period of silence."""
    path = tmp_path_factory.mktemp("log") / f"{request.param}.tlog"
    frames: list[tuple[int, bytes]] = []
    up, down = JournalReader(frames), JournalReader(frames)
    pair = Pair(mock_of(stack_named(request.param, "plane")), up=up, down=down)
    pair.run_for(3.0)
    assert pair.result_of(pair.client.upload(flight_of(), pair.now_us)).outcome == "accepted"
    pair.client.command("start mission", pair.now_us)
    pair.run_for(30.0)
    pair.mock_alive = False
    pair.run_for(5.0)
    pair.mock_alive = True
    pair.run_for(5.0)
    now = [0]
    with Tlog(path, lambda: BEGIN_US + now[0], pytest.fail) as tlog:
        for at_us, frame in frames:
            now[0] = at_us
            tlog.record([frame])
    return path, pair


def of(entries: list[Entry], kind: type) -> list[Any]:
    return [entry.event for entry in entries if isinstance(entry.event, kind)]


def test_a_tlog_holds_the_events_of_the_client_and_the_missions_of_both_directions(
    recorded: tuple[Path, Pair],
) -> None:
    path, pair = recorded
    log = open_log(path)
    entries = list(log.entries())
    assert log.damage == []
    assert {entry.system_id for entry in entries} == {pair.mock.system_id}
    # Times in the log equal those of the client, apart from the two bits of the link number.
    flown, reported = of(entries, Position), pair.of(Position)
    assert len(flown) == len(reported) > 100
    for mine, client in zip(flown, reported, strict=True):
        assert 0 <= client.at_us + BEGIN_US - mine.at_us < 4
        assert (mine.lat_deg, mine.lon_deg) == (client.lat_deg, client.lon_deg)
    (loaded,) = of(entries, MissionLoaded)
    assert loaded.items == flight_of()
    assert [each.current_seq for each in of(entries, MissionProgress)] == [
        each.current_seq for each in pair.of(MissionProgress)
    ]
    modes = [(each.name, each.armed) for each in of(entries, ModeChanged)]
    assert modes == [(each.name, each.armed) for each in pair.of(ModeChanged)]
    assert len(of(entries, LinkLost)) == len(of(entries, LinkRestored)) == 1
    assert len(of(entries, Outputs)) > 10
    assert log.unix_offset_us() == 0


def test_a_dataflash_log_reproduces_the_flight(tmp_path: Path) -> None:
    path = tmp_path / "flight.bin"
    path.write_bytes(bin_flight())
    log = open_log(path)
    entries = list(log.entries())
    assert log.damage == []
    assert log.messages == 15 + 1 + 3 + 2 + 40 * 10 + 3
    place = of(entries, Position)[7]
    assert (place.at_us, place.lat_deg, place.altitude_amsl_m) == (1_800_000, 36.3, 307.0)
    assert place.lon_deg == pytest.approx(-84.2 + 7e-4, abs=1e-7)
    # Value of the first EKF.
    assert (place.velocity_north_m_s, place.velocity_east_m_s) == (0.5, 14.5)
    assert (place.altitude_relative_m, place.heading_deg) == (7.0, 271.5)
    assert of(entries, Attitude)[0].pitch_deg == 12.25
    wind = of(entries, Wind)[0]
    assert (wind.speed_m_s, wind.from_deg) == (5.0, pytest.approx(126.87, abs=0.01))
    assert of(entries, Speed)[1] == Speed(1_200_000, 17.0, 15.0, 2.0, 60)
    (loaded,) = of(entries, MissionLoaded)
    assert [(item.command, item.x, item.z) for item in loaded.items] == [
        (22, 363_000_000, 50.0),
        (16, 363_100_000, 90.0),
    ]
    assert [each.current_seq for each in of(entries, MissionProgress)] == [0, 1]
    assert [each.seq for each in of(entries, ItemReached)] == [0]
    modes = [(each.name, each.armed) for each in of(entries, ModeChanged)]
    assert modes == [("mission", False), ("mission", True), ("mission", False)]
    assert of(entries, Connected)[0].stack.vehicle == "plane"
    assert [each.pulse_us[1] for each in of(entries, Outputs)].count(1900) == 19
    # 100.1 s after the beginning of GPS week 2445.
    offset = log.unix_offset_us()
    assert offset is not None
    assert offset + 1_100_000 == (315_964_800 + 2445 * 604_800 + 100 - 18) * SECOND


def test_a_ulog_reproduces_the_flight(tmp_path: Path) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(ulg_flight())
    log = open_log(path)
    entries = list(log.entries())
    assert log.damage == []
    assert {entry.system_id for entry in entries} == {3}
    places = of(entries, Position)
    assert len(places) == 40  # invalid values become None
    assert (places[5].lat_deg, places[5].altitude_relative_m) == (pytest.approx(36.3005), 50.0)
    assert places[5].heading_deg == pytest.approx(math.degrees(1.0))
    assert places[5].velocity_down_m_s == -1.0
    assert of(entries, Wind)[0] == Wind(2_100_000, 90.0, 4.0)
    modes = [(each.name, each.armed) for each in of(entries, ModeChanged)]
    assert modes == [("hold", False), ("mission", True), ("mission", False)]
    assert [each.current_seq for each in of(entries, MissionProgress)] == [0, 1]
    assert [each.seq for each in of(entries, ItemReached)] == [0]
    assert of(entries, GripperMoved) == [GripperMoved(5_500_000, True)]
    assert of(entries, Text) == [Text(1_000_000, 6, "logging")]
    assert of(entries, GpsFix)[0].fix == "3d"
    assert log.unix_offset_us() == BEGIN_US


def test_the_libraries_read_the_same_of_them(tmp_path: Path) -> None:
    binary, other = tmp_path / "flight.bin", tmp_path / "flight.ulg"
    binary.write_bytes(bin_flight())
    other.write_bytes(ulg_flight())
    compare_dataflash(binary)
    compare_ulog(other)


def compare_dataflash(path: Path) -> int:
    """Compare each position with pymavlink's; return the number of positions."""
    reader = DFReader.DFReader_binary(str(path))
    theirs = []
    while (message := reader.recv_match(type=["POS"])) is not None:
        theirs.append((message.TimeUS, message.Lat, message.Lng, message.Alt))
    reader.filehandle.close()
    mine = of(list(DataFlashLog(path).entries()), Position)
    assert theirs == [(p.at_us, p.lat_deg, p.lon_deg, p.altitude_amsl_m) for p in mine]
    return len(mine)


def compare_ulog(path: Path) -> int:
    """Compare each position with pyulog's; return the number of positions."""
    data = ULog(str(path), ["vehicle_global_position"]).data_list[0].data
    valid = data["lat_lon_valid"].astype(bool)
    columns = [data[name][valid].tolist() for name in ("timestamp", "lat", "lon", "alt")]
    mine = of(list(UlogLog(path).entries()), Position)
    assert list(zip(*columns, strict=True)) == [
        (p.at_us, p.lat_deg, p.lon_deg, p.altitude_amsl_m) for p in mine
    ]
    return len(mine)


# Logs that are cut off, damaged, or several ---------------------------------------------------


READERS: dict[str, tuple[Callable[[Path], Log], Callable[[], bytes]]] = {
    "bin": (DataFlashLog, bin_flight),
    "ulg": (UlogLog, ulg_flight),
}


def tlog_at(path: Path, frames: list[tuple[int, bytes]], rate: float) -> Path:
    """Return the frames of a simulation that ran at this speed relative to the recorder's clock."""
    now = [0]
    with Tlog(path, lambda: BEGIN_US + now[0], pytest.fail) as tlog:
        for at_us, frame in frames:
            now[0] = round(at_us / rate)
            tlog.record([frame])
    return path


@pytest.mark.parametrize("rate", [10.0, 0.2])
def test_a_flight_of_a_fast_simulator_goes_on_by_the_autopilots_clock(
    tmp_path: Path, rate: float
) -> None:
    frames: list[tuple[int, bytes]] = []
    pair = Pair(mock_of(stack_named("ardupilot", "plane")), down=JournalReader(frames))
    pair.run_for(48.0)
    frames = [each for each in frames if not 20_000_000 < each[0] < 28_000_000]  # lost
    as_flown = list(TlogLog(tlog_at(tmp_path / "real.tlog", frames, 1.0)).entries())
    fast = list(TlogLog(tlog_at(tmp_path / "fast.tlog", frames, rate)).entries())
    assert [type(entry.event) for entry in fast] == [type(entry.event) for entry in as_flown]
    assert of(fast, LinkLost)
    began_us, fast_began_us = (each[0].event.at_us for each in (as_flown, fast))
    for one, other in zip(as_flown, fast, strict=True):
        flown_us = other.event.at_us - fast_began_us
        assert flown_us == pytest.approx(one.event.at_us - began_us, abs=1_000_000)
    at_us = [entry.event.at_us for entry in fast]
    assert at_us == sorted(at_us)
    positions = of(fast, Position)
    assert len({each.at_us - each.boot_us for each in positions}) == 1
    assert len(positions) > 150


def test_stamps_hold_where_the_autopilots_clock_is_only_inexact(tmp_path: Path) -> None:
    frames: list[tuple[int, bytes]] = []
    pair = Pair(mock_of(stack_named("ardupilot", "plane")), down=JournalReader(frames))
    pair.run_for(20.0)
    log = TlogLog(tlog_at(tmp_path / "late.tlog", frames, 1.05))
    stamps = {BEGIN_US + (round(at_us / 1.05) & ~3) for at_us, _ in frames}
    assert {each.at_us for each in of(list(log.entries()), Position)} <= stamps


@pytest.fixture(scope="module", params=["tlog", "bin", "ulg"])
def written(request: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes, Any]:
    """Return a log's path, its bytes and its reader."""
    path = tmp_path_factory.mktemp("cut") / f"flight.{request.param}"
    if request.param == "tlog":
        pair = Pair(mock_of(stack_named("ardupilot", "plane")), down=JournalReader([]))
        frames = pair.down._frames  # type: ignore[attr-defined]
        pair.run_for(8.0)
        now = [0]
        with Tlog(path, lambda: BEGIN_US + now[0], pytest.fail) as tlog:
            for now[0], frame in frames:
                tlog.record([frame])
        return path, path.read_bytes(), TlogLog
    reader, flight = READERS[request.param]
    return path, flight(), reader


def entries_of(path: Path, data: bytes, reader: Callable[[Path], Log]) -> tuple[list[Entry], Log]:
    path.write_bytes(data)
    log = reader(path)
    return list(log.entries()), log


@pytest.mark.parametrize("piece_bytes", [1 << 19, 700])
def test_a_log_cut_at_any_byte_is_read_up_to_the_cut(
    written: tuple[Path, bytes, Any], piece_bytes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, data, reader = written
    whole, log = entries_of(path, data, reader)
    assert len(whole) > 50
    monkeypatch.setattr(record_scanner, "CHUNK_BYTES", piece_bytes)
    assert entries_of(path, data, reader)[0] == whole
    messages = log.messages
    cuts = sorted({*range(40), *random.Random(1).sample(range(len(data)), 150), len(data) - 1})
    before = 0
    for cut in cuts:
        found, log = entries_of(path, data[:cut], reader)
        assert found == whole[: len(found)]
        assert before <= len(found) + 1
        assert sum(each.skipped_bytes for each in log.damage) < 300 or log.messages == 0
        before = len(found)
    assert log.messages >= messages - 2


@settings(max_examples=60)
@given(st.data())
def test_noise_in_a_log_costs_what_it_covers_and_is_reported(
    written: tuple[Path, bytes, Any], data: st.DataObject
) -> None:
    path, good, reader = written
    whole, _ = entries_of(path, good, reader)
    begin = len(good) // 3
    at = data.draw(st.integers(begin, len(good) - 200))
    noise = data.draw(st.binary(min_size=1, max_size=150))
    replaces = data.draw(st.booleans())
    behind = at + len(noise) if replaces else at
    found, log = entries_of(path, good[:at] + noise + good[behind:], reader)
    assert found[-1] == whole[-1] or log.damage
    texts = [repr(entry) for entry in found]
    expected = {repr(entry) for entry in whole}
    # In formats without checksums noise may look like a message (in a .tlog, like a time).
    assert sum(text not in expected for text in texts) <= (4 if reader is TlogLog else 6)
    assert len(found) >= len(whole) - 40


def test_noise_is_reported_as_damage(written: tuple[Path, bytes, Any]) -> None:
    """Noise rarely looks like a message that is skipped, such as one of another dialect."""
    path, good, reader = written
    chance, damaged = random.Random(5), 0
    for _ in range(40):
        at = chance.randrange(len(good) // 3, len(good) - 200)
        _, log = entries_of(path, good[:at] + chance.randbytes(90) + good[at:], reader)
        damaged += bool(log.damage)
    assert damaged >= 36


def test_noise_that_looks_like_a_subscription_ends_no_topic(tmp_path: Path) -> None:
    good = ulg_flight()
    noise = b"\x00J\x05A\x00\x00\x00"  # found by the property test above
    whole, _ = entries_of(tmp_path / "good.ulg", good, UlogLog)
    found, log = entries_of(tmp_path / "bad.ulg", good[:4096] + noise + good[4096:], UlogLog)
    assert log.damage
    assert len(found) >= len(whole) - 40
    assert of(found, Position)[-1] == of(whole, Position)[-1]


@pytest.mark.parametrize("share", [0.0, 0.5, 0.97])
def test_a_time_that_is_noise_moves_no_clock(
    written: tuple[Path, bytes, Any], share: float
) -> None:
    path, good, reader = written
    whole, _ = entries_of(path, good, reader)
    times = [entry.event.at_us for entry in whole]
    at = good.index(_stamp(reader, times[round(share * (len(times) - 1))]))
    noise = _stamp(reader, times[0] + 86_400_000_000)  # a day later
    found, _ = entries_of(path, good[:at] + noise + good[at + 8 :], reader)
    assert len(found) >= len(whole) - 6
    assert {entry.event.at_us for entry in found} <= set(times)


def _stamp(reader: Any, at_us: int) -> bytes:
    return at_us.to_bytes(8, "big" if reader is TlogLog else "little")


def test_a_log_that_begins_again_is_read_on(written: tuple[Path, bytes, Any]) -> None:
    path, good, reader = written
    if reader is not TlogLog:
        return  # the others begin once
    whole, _ = entries_of(path, good, reader)
    later = bytearray(good)
    for each in {entry.event.at_us for entry in whole}:
        old, new = _stamp(reader, each), _stamp(reader, each + 3_600_000_000)
        later = later.replace(old, new)
    found, _ = entries_of(path, good + bytes(later), reader)
    assert found[-1].event.at_us == whole[-1].event.at_us + 3_600_000_000
    assert len(found) > 1.5 * len(whole)


def test_a_mission_that_is_replaced_unseen_is_no_way_back(tmp_path: Path) -> None:
    """ArduPilot does not log missions that were uploaded as files, and PX4 logs no items."""
    bin_path, ulg_path = tmp_path / "file.bin", tmp_path / "file.ulg"
    messages: list[tuple[Any, ...]] = [("MSG", 1, "ArduPlane V4.6.2 (deadbeef)")]
    messages += [("MISE", 1_000_000 * n, 9, n) for n in range(1, 6)]
    messages += [("MISE", 7_000_000, 6, 1), ("MISE", 8_000_000, 6, 2), ("MISE", 9_000_000, 6, 1)]
    bin_path.write_bytes(dataflash(messages))
    results = [(1, 7, 3), (2, 7, 4), (3, 8, 1), (4, 8, 2), (5, 8, 1)]
    ulg_path.write_bytes(
        ulog(("mission_result", 1_000_000 * at, number, -1, seq) for at, number, seq in results)
    )
    for path, replaced_us in ((bin_path, 7_000_000), (ulg_path, 3_000_000)):
        entries = list(open_log(path).entries())
        assert [each.at_us for each in of(entries, MissionReplaced)] == [replaced_us]
        # The last return to an earlier item is within one mission.
        seqs = [each.current_seq for each in of(entries, MissionProgress)]
        assert seqs[-2:] in ([1, 0], [2, 1])


def test_columns_that_are_missing_are_reported_and_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = {**FORMATS, "POS": ("QLfff", "TimeUS,Lng,Alt,RelHomeAlt,RelOriginAlt")}
    monkeypatch.setattr(log_writers, "FORMATS", other)
    path = tmp_path / "other.bin"
    messages: list[tuple[Any, ...]] = [("MSG", 1, "ArduPlane V4.6.2 (deadbeef)")]
    messages += [("POS", 1_000_000, -84.2, 300.0, 0.0, 0.0), ("MODE", 2_000_000, 10, 10)]
    path.write_bytes(dataflash(messages))
    log = open_log(path)
    assert len(of(list(log.entries()), ModeChanged)) == 1
    assert [str(each) for each in log.damage] == [
        "0 bytes at 0: POS has no field 'Lat' and is omitted"
    ]


def test_a_mode_has_a_name_when_the_firmware_is_known(tmp_path: Path) -> None:
    path = tmp_path / "late.bin"
    messages = [("MODE", 1_000_000, 10, 10), ("MSG", 2_000_000, "ArduPlane V4.6.2 (deadbeef)")]
    path.write_bytes(dataflash([*messages, ("ARM", 3_000_000, 1)]))
    modes = of(list(open_log(path).entries()), ModeChanged)
    assert [(each.name, each.armed) for each in modes] == [
        ("", False),
        ("mission", False),
        ("mission", True),
    ]


def test_a_file_that_is_no_log_is_reported_in_one_line(tmp_path: Path) -> None:
    other = tmp_path / "notes.txt"
    other.write_text("nothing")
    empty = tmp_path / "empty.bin"
    empty.write_bytes(b"")
    for path, words in (
        (other, "not a supported log; supported are .tlog, .bin, .ulg"),
        (empty, "is empty"),
        (tmp_path / "none.tlog", "cannot be read: No such file"),
    ):
        with pytest.raises(BridgeError, match=words):
            open_log(path)
    other = tmp_path / "notes.tlog"
    other.write_text("nothing that has a frame in it " * 100)
    log = open_log(other)
    assert list(log.entries()) == []
    assert log.damage[0].skipped_bytes == 3100


def test_several_logs_are_one_by_time(tmp_path: Path, recorded: tuple[Path, Pair]) -> None:
    flight = tmp_path / "flight.ulg"
    flight.write_bytes(ulg_flight())
    logs = [open_log(flight), open_log(recorded[0])]
    entries = list(merged(logs))
    assert [each.log for each in entries].count(0) == len(list(logs[0].entries()))
    assert [each.log for each in entries].count(1) == len(list(logs[1].entries()))
    times = [each.at_us for each in entries]
    assert times == sorted(times)
    assert {each.log for each in entries[:60]} == {0, 1}  # the flights were simultaneous
    alone = next(merged([logs[0]]))
    assert alone.at_us == alone.entry.event.at_us  # each log has its own clock


# Real flights ---------------------------------------------------------------------------------


real = pytest.mark.skipif(not FLIGHTS.exists(), reason="no shared flights")


@real
@pytest.mark.parametrize("name", ["arduplane_perimeter", "arducopter_drops"])
def test_real_dataflash_logs(name: str) -> None:
    path = FLIGHTS / f"{name}.BIN"
    assert compare_dataflash(path) > 500
    recorded = json.loads((FLIGHTS / f"{name}.mission.json").read_text())
    loaded = of(list(open_log(path).entries()), MissionLoaded)
    assert len(loaded) == len(recorded["missions"])
    for mine, mission in zip(loaded, recorded["missions"], strict=True):
        expected = [(item["command"], item["x"], item["y"], item["z"]) for item in mission["items"]]
        found = [(item.command, item.x, item.y, item.z) for item in mine.items]
        assert found == [pytest.approx(item) for item in expected[1:]]


@real
def test_a_real_ulog() -> None:
    path = FLIGHTS / "px4_fixedwing_perimeter.ulg"
    assert compare_ulog(path) > 1500
    entries = list(open_log(path).entries())
    assert [each.releases for each in of(entries, GripperMoved)] == [False, True]
    reached = [each.seq for each in of(entries, ItemReached)]
    assert reached == sorted(set(reached))


@real
@pytest.mark.parametrize(
    "name", ["arduplane_perimeter", "arducopter_drops", "px4_fixedwing_perimeter"]
)
def test_real_tlogs(name: str) -> None:
    path = FLIGHTS / f"{name}.tlog"
    theirs = []
    reader = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    while (message := reader.recv_match(type=["GLOBAL_POSITION_INT"])) is not None:
        if abs(message.lat) > 1_000_000:
            theirs.append((message.lat / 1e7, message.lon / 1e7, message.alt / 1e3))
    reader.close()
    log = open_log(path)
    entries = list(log.entries())
    mine = of(entries, Position)
    assert log.damage == []
    assert [(p.lat_deg, p.lon_deg, p.altitude_amsl_m) for p in mine] == theirs
    if name == "arduplane_perimeter":  # it was ordered back at 134 s
        begin_us = json.loads((FLIGHTS / f"{name}.mission.json").read_text())["tlog_start_unix_us"]
        back = [
            (each.at_us - begin_us) / 1e6
            for before, each in zip(
                of(entries, MissionProgress), of(entries, MissionProgress)[1:], strict=False
            )
            if each.current_seq < before.current_seq
        ]
        assert back == [pytest.approx(134.3, abs=2.0)]
