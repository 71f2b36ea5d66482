"""Mission files over MAVFTP between client and mock, over good, lossy and failing links."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.missions import ftp_packet as ftp
from autopilot_bridge.missions.ftp_packet import Packet
from autopilot_bridge.missions.read_back import as_read_back
from tests.bridge.ftp_helpers import (
    ARDUPILOT,
    NEW,
    OLD,
    STATION,
    THEIRS,
    Bench,
    Cut,
    Losing,
    download_of,
    holding,
    upload_of,
    wire,
)
from tests.bridge.helpers import SECOND, line_of


def test_650_items_go_up_and_come_down_in_less_than_a_second_each() -> None:
    bench, sent = Bench(), line_of(649)
    began_us = bench.now_us
    assert bench.run(upload_of(wire(sent))).outcome == "accepted"
    assert bench.held() == sent
    assert bench.now_us - began_us < SECOND
    began_us = bench.now_us
    read = bench.run(download_of())
    assert read.items is not None
    assert read.items[1:] == sent
    assert bench.now_us - began_us < SECOND
    # The autopilot's queue of five dropped nothing, so nothing was sent twice.
    assert len(bench.sent) == 2 * (1 + 109 + 1)


def test_pieces_are_small_enough_and_cut_between_items() -> None:
    bench = Bench()
    bench.run(upload_of(wire(line_of(100))))
    writes = [packet for packet in bench.sent if packet.opcode == ftp.WRITE]
    assert [packet.size for packet in writes[:3]] == [238, 228, 228]
    for packet in writes:
        assert packet.size <= 239
        assert (packet.offset + packet.size - 10) % 38 == 0


@pytest.mark.parametrize("count", [0, 1, 5, 6, 7, 12, 13])
def test_missions_of_any_length_round_trip(count: int) -> None:
    bench, sent = holding(), line_of(60)[:count]
    assert bench.run(upload_of(sent)).outcome == "accepted"
    assert bench.held() == sent[1:]
    read = bench.run(download_of())
    assert read.items is not None
    assert read.items[1:] == sent[1:]


@pytest.mark.parametrize(("mission_type", "command"), [(1, 5003), (2, 5100)])
def test_fence_and_rally_points_round_trip(mission_type: int, command: int) -> None:
    bench = Bench()
    sent = tuple(replace(item, command=command, param1=50.0) for item in line_of(9))
    points = tuple(as_read_back(item, ARDUPILOT, mission_type) for item in sent)
    assert bench.run(upload_of(sent, mission_type=mission_type)).outcome == "accepted"
    assert tuple(bench.mock.missions.lists[mission_type]) == points
    assert bench.run(download_of(mission_type=mission_type)).items == points
    assert bench.held() == ()


@pytest.mark.parametrize(("loss", "seeds"), [(0.05, 40), (0.3, 60)])
def test_over_bad_links_transfers_end_and_success_means_the_mission_is_held(
    loss: float, seeds: int
) -> None:
    succeeded = 0
    for seed in range(seeds):
        bench = holding()
        bad: dict[str, Any] = {"loss": loss, "jitter_us": 120_000, "duplication": 0.2}
        bench.up = MemoryLink(**bad, delay_us=seed * 5_000, seed=seed)
        bench.down = MemoryLink(**bad, delay_us=seed * 3_000, seed=1000 + seed)
        sent = line_of(150, first=3)
        result = bench.run(upload_of(wire(sent), session=seed + 1), within_s=250.0)
        if result.outcome == "accepted":
            succeeded += 1
            assert bench.held() == sent
        read = bench.run(download_of(session=seed + 2), within_s=250.0)
        assert bench.held() in (OLD, sent)
        assert read.items is None or read.items[1:] == bench.held()
    assert succeeded >= 0.95 * seeds


@pytest.mark.parametrize("loss", [0.05, 0.3])
def test_650_items_over_bad_links(loss: float) -> None:
    bench = holding()
    bad: dict[str, Any] = {"loss": loss, "delay_us": 20_000, "jitter_us": 60_000}
    bench.up = MemoryLink(**bad, duplication=0.1, seed=1)
    bench.down = MemoryLink(**bad, duplication=0.1, seed=2)
    began_us, sent = bench.now_us, line_of(649)
    assert bench.run(upload_of(wire(sent))).outcome == "accepted"
    assert bench.held() == sent
    read = bench.run(download_of())
    assert read.items is not None
    assert read.items[1:] == sent
    assert bench.now_us - began_us < 30 * SECOND


# Wherever the link dies ---------------------------------------------------------------------------


def messages_of_an_upload() -> int:
    counter, bench = [0], holding()
    bench.up, bench.down = Cut(counter, 10**9), Cut(counter, 10**9)
    bench.run(upload_of(wire(NEW)))
    return counter[0]


def test_a_link_cut_at_any_message_leaves_the_old_mission_or_the_new_one() -> None:
    outcomes = []
    for after in range(messages_of_an_upload() + 1):
        counter, bench = [0], holding()
        bench.up, bench.down = Cut(counter, after), Cut(counter, after)
        result = bench.run(upload_of(wire(NEW)), within_s=30.0)
        outcomes.append(result.outcome)
        assert bench.held() == (NEW if result.outcome == "accepted" else OLD) or (
            result.outcome == "unknown" and bench.held() == NEW
        )
        # When any client next opens a file, the autopilot closes the dead session and applies its
        # data.
        bench.idle(4.0)
        assert bench.ask(Packet(5, 77, ftp.OPEN_TO_READ, 20, data=b"@MISSION/mission.dat"))
        if result.outcome == "unknown":
            assert bench.held() in (OLD, NEW)
        else:
            assert bench.held() == (NEW if result.outcome == "accepted" else OLD)
    assert set(outcomes) == {"failed", "unknown", "accepted"}


def test_a_link_that_comes_back_after_another_station_took_over_mixes_nothing() -> None:
    total = messages_of_an_upload()
    for after in range(total):
        counter, bench = [0], holding()
        up, down = Cut(counter, after), Cut(counter, after)
        bench.up, bench.down = up, down
        upload = upload_of(wire(NEW))
        bench.begin(upload)
        end_us, asked = bench.now_us + 4 * SECOND, False
        while upload.result is None:
            bench.step(upload)
            if bench.now_us > end_us and not asked:
                asked = True
                bench.ask(Packet(5, 77, ftp.OPEN_TO_READ, 20, data=b"@MISSION/mission.dat"))
                bench.ask(Packet(6, 77, ftp.TERMINATE))
                bench.up, bench.down = MemoryLink(), MemoryLink()
        assert bench.held() in (OLD, NEW)
        if upload.result.outcome == "accepted":
            assert bench.held() == NEW
        if upload.result.outcome == "failed":
            assert bench.held() == OLD
        read = bench.run(download_of(session=9))
        assert read.items is not None
        assert read.items[1:] == bench.held()


def pieces_of_an_upload() -> list[Packet]:
    bench = Bench()
    bench.run(upload_of(wire(NEW)))
    return [packet for packet in bench.sent if packet.opcode == ftp.WRITE]


PARTS = pieces_of_an_upload()


@settings(max_examples=60)
@given(st.lists(st.sampled_from(PARTS), max_size=14))
def test_whichever_pieces_arrived_in_whatever_order_the_mission_is_old_or_new(
    arrived: list[Packet],
) -> None:
    bench = holding()
    bench.ask(replace(THEIRS, session=1, data=b"@MISSION/mission.dat", size=20))
    for packet in arrived:
        bench.ask(packet, station=STATION)
    bench.ask(Packet(9, 1, ftp.TERMINATE))
    assert bench.held() == (NEW if len(set(arrived)) == len(PARTS) else OLD)


@given(st.permutations(PARTS))
@settings(max_examples=20)
def test_pieces_may_arrive_in_any_order(arrived: list[Packet]) -> None:
    bench = holding()
    bench.ask(replace(THEIRS, session=1, data=b"@MISSION/mission.dat", size=20))
    for packet in arrived:
        bench.ask(packet, station=STATION)
    bench.ask(Packet(9, 1, ftp.TERMINATE))
    assert bench.held() == NEW


def test_the_result_of_an_upload_shows_whether_all_was_sent() -> None:
    for after, outcome in ((1, "failed"), (4, "failed"), (7, "failed"), (14, "unknown")):
        counter, bench = [0], holding()
        bench.up, bench.down = Cut(counter, after), Cut(counter, after)
        assert bench.run(upload_of(wire(NEW))).outcome == outcome


def test_a_session_taken_over_by_another_station_is_not_ended_by_us() -> None:
    bench = holding()
    bench.up = Cut([0], 2)
    upload = upload_of(wire(line_of(80)))
    bench.begin(upload)
    end_us, asked = bench.now_us + 4 * SECOND, False
    while upload.result is None:
        bench.step(upload)
        if bench.now_us > end_us and not asked:
            asked = True
            bench.ask(THEIRS)
            bench.up = MemoryLink()
    assert upload.result.outcome == "failed"
    assert "another session is open" in upload.result.reason
    bench.idle(0.1)
    assert ftp.TERMINATE not in [packet.opcode for packet in bench.sent]
    assert bench.mock.ftp.session is not None
    assert bench.mock.ftp.session.session == 77


@pytest.mark.parametrize("piece", range(7))
def test_a_piece_that_never_arrives_leaves_the_old_mission(piece: int) -> None:
    offset = 0 if piece == 0 else 238 + (piece - 1) * 228
    bench = holding()
    bench.up = Losing(lambda packet: packet.opcode == ftp.WRITE and packet.offset == offset)
    result = bench.run(upload_of(wire(NEW)), within_s=30.0)
    assert result.outcome in ("failed", "unknown")
    bench.idle(1.0)
    # The request to close arrived: the session is closed and the file refused.
    assert bench.mock.ftp.session is None
    assert bench.held() == OLD


def test_an_upload_whose_answers_are_all_lost_is_settled_by_reading_back() -> None:
    bench = holding()
    bench.down = Losing(lambda packet: packet.asked in (ftp.WRITE, ftp.TERMINATE))
    result = bench.run(upload_of(wire(NEW[:20])), within_s=30.0)
    assert result.outcome == "unknown"
    bench.down = MemoryLink()
    read = bench.run(download_of())
    assert read.items is not None
    assert read.items[1:] == NEW[:20] == bench.held()
