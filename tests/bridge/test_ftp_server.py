"""The mock's MAVFTP server behaves like ArduPilot's where clients depend on it."""

from dataclasses import replace

import pytest

from autopilot_bridge.items import MissionItem
from autopilot_bridge.missions import ftp_packet as ftp
from autopilot_bridge.missions.ftp_packet import Packet
from autopilot_bridge.missions.mission_file import encode_mission_file
from tests.bridge.ftp_helpers import NEW, OLD, Bench, download_of, holding, upload_of, wire
from tests.bridge.helpers import line_of

MISSION = b"@MISSION/mission.dat"
CREATE = Packet(0, 7, ftp.CREATE, len(MISSION), data=MISSION)
READ_OPEN = replace(CREATE, seq=100, session=8, opcode=ftp.OPEN_TO_READ)
CLOSE = Packet(99, 7, ftp.TERMINATE)


def write(bench: Bench, data: bytes, step: int = 239) -> None:
    """Open the file and write all data with explicit requests."""
    assert [reply.opcode for reply in bench.ask(CREATE)] == [ftp.ACK]
    for seq, begin in enumerate(range(0, len(data), step), start=1):
        piece = data[begin : begin + step]
        packet = Packet(seq, 7, ftp.WRITE, len(piece), offset=begin, data=piece)
        assert [reply.opcode for reply in bench.ask(packet)] == [ftp.ACK]


def file_of(items: tuple[MissionItem, ...]) -> bytes:
    return encode_mission_file(wire(items), 0, (1, 1))


def test_a_file_is_applied_when_its_session_is_closed_and_not_before() -> None:
    bench = holding()
    write(bench, file_of(NEW))
    assert bench.held() == OLD
    bench.ask(CLOSE)
    assert bench.held() == NEW


@pytest.mark.parametrize("close", [CLOSE, READ_OPEN], ids=["by its owner", "by another's opening"])
def test_a_file_that_lacks_its_last_bytes_is_applied_with_zeros(close: Packet) -> None:
    bench = holding()
    relative = tuple(replace(item, frame=3) for item in NEW)
    write(bench, file_of(relative)[:-5])
    bench.idle(4.0)
    bench.ask(close)
    assert bench.held()[:-1] == relative[:-1]
    assert bench.held()[-1] == replace(relative[-1], frame=0)


def test_a_file_that_lacks_whole_items_is_refused_and_the_closing_acknowledged() -> None:
    bench = holding()
    write(bench, file_of(NEW)[:-38])
    assert [reply.opcode for reply in bench.ask(CLOSE)] == [ftp.ACK]
    assert bench.held() == OLD


def test_a_bad_item_leaves_a_half_written_mission_and_the_closing_is_acknowledged() -> None:
    bench = holding()
    bad = MissionItem(31000, 0, 0, 0, 0.0)
    write(bench, file_of((*NEW[:10], bad, *NEW[10:])))
    assert [reply.opcode for reply in bench.ask(CLOSE)] == [ftp.ACK]
    assert bench.held() == NEW[:10]


def test_a_mission_being_flown_is_not_cleared_so_a_shorter_file_leaves_the_old_tail() -> None:
    bench = holding(line_of(40, first=1))
    bench.mock.flight.armed, bench.mock.flight.mode = True, "mission"
    assert bench.run(upload_of(wire(line_of(20)))).outcome == "accepted"
    assert bench.held() == (*line_of(20), *line_of(40, first=1)[20:])
    read = bench.run(download_of())  # a client detects the limit in this way
    assert read.items is not None
    assert len(read.items) == 41
    longer = line_of(50, first=2)
    bench.run(upload_of(wire(longer), session=3))
    assert bench.held() == longer
    bench.mock.flight.mode = "hold"
    bench.run(upload_of(wire(line_of(20)), session=4))
    assert bench.held() == line_of(20)


def test_a_sixth_request_is_dropped_without_a_word() -> None:
    bench = holding()
    bench.ask(CREATE)
    for seq in range(1, 7):
        bench.push(Packet(seq, 7, ftp.WRITE, 1, offset=1000 + seq, data=b"x"))
    assert [reply.seq for reply in bench.replies()] == [2, 3, 4, 5, 6]


def test_240_bytes_are_refused() -> None:
    bench = holding()
    bench.ask(CREATE)
    (reply,) = bench.ask(Packet(1, 7, ftp.WRITE, 240, data=b"x" * 239))
    assert (reply.opcode, reply.data) == (ftp.NAK, bytes([ftp.INVALID_SIZE]))


def test_a_session_can_be_taken_over_after_three_seconds_of_silence_or_when_ended() -> None:
    bench = holding()
    bench.ask(CREATE)
    for seq in range(100, 103):  # a request keeps the session active
        bench.idle(2.0)
        (reply,) = bench.ask(replace(READ_OPEN, seq=seq))
        assert (reply.opcode, reply.data) == (ftp.NAK, bytes([ftp.INVALID_SESSION]))
    bench.idle(3.1)
    assert bench.ask(replace(READ_OPEN, seq=110))[0].opcode == ftp.ACK
    assert bench.ask(replace(CLOSE, session=8))[0].opcode == ftp.ACK
    assert bench.ask(replace(CREATE, seq=120, session=9))[0].opcode == ftp.ACK


def test_a_request_repeated_gets_the_same_reply_again() -> None:
    bench = holding()
    first = bench.ask(CREATE)
    assert bench.ask(CREATE) == first
    (other,) = bench.ask(replace(CREATE, seq=50))
    assert (other.opcode, other.data) == (ftp.NAK, bytes([ftp.FAIL]))


def test_a_plane_flies_its_old_target_on_after_a_file() -> None:
    bench = holding()
    flight = bench.mock.flight
    flight.items = tuple(bench.mock.missions.items)
    flight.armed = True
    flight.set_mode("mission", 0.0)
    flight.go_to(3, 0.0)
    target = flight.target
    bench.run(upload_of(wire(NEW)))
    assert flight.items[1:] == NEW
    assert flight.target is target
