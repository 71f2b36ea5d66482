"""MAVFTP sessions: idle and active ones of other stations, lost and stray replies, refusals."""

from dataclasses import replace

import pytest

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.missions import ftp_packet as ftp
from autopilot_bridge.missions.ftp import leaves_old_tail, next_session
from autopilot_bridge.missions.ftp_packet import Packet, packet_of
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.stacks.stacks import stack_named
from tests.bridge.ftp_helpers import (
    NEW,
    OLD,
    STATION,
    THEIRS,
    VEHICLE,
    Bench,
    Losing,
    download_of,
    holding,
    upload_of,
    wire,
)
from tests.bridge.helpers import SECOND, line_of, mock_of


@pytest.mark.parametrize("session", [3, 77], ids=["other id", "same id"])
def test_a_dead_session_is_waited_out(session: int) -> None:
    bench = holding()
    bench.ask(THEIRS)
    began_us = bench.now_us
    assert bench.run(upload_of(wire(NEW), session=session)).outcome == "accepted"
    assert 3 * SECOND < bench.now_us - began_us < 5 * SECOND
    assert bench.held() == NEW


def test_two_stations_that_wait_for_a_dead_session_do_not_keep_each_other_out() -> None:
    bench = holding()
    bench.ask(THEIRS)
    first, second = upload_of(wire(NEW), session=3), download_of(session=40)
    asking = replace(THEIRS, session=40)
    bench.begin(first)
    # Another client of this program.
    due_us = [bench.now_us + SECOND, bench.now_us + round(4.2 * SECOND)]
    while first.result is None:
        bench.step(first)
        if due_us and bench.now_us >= due_us[0]:
            due_us.pop(0)
            (reply,) = bench.ask(replace(asking, seq=300 + len(due_us)))
            assert reply.opcode == ftp.NAK
    assert first.result.outcome == "accepted"
    assert not due_us
    assert bench.run(second).outcome == "accepted"


def test_a_session_in_use_is_left_alone() -> None:
    bench = holding()
    bench.ask(THEIRS)
    upload = upload_of(wire(NEW), session=3)
    bench.begin(upload)
    next_poll_us, polls = bench.now_us, 0
    while upload.result is None:
        bench.step(upload)
        if bench.now_us >= next_poll_us and upload.result is None:
            polls += 1
            next_poll_us += SECOND
            piece = Packet(10 + polls, 77, ftp.WRITE, 4, offset=4 * polls, data=b"held")
            assert [reply.opcode for reply in bench.ask(piece)] == [ftp.ACK]
    assert upload.result.outcome == "rejected"
    assert "another session is open" in upload.result.reason
    assert bench.mock.ftp.session is not None
    assert bench.mock.ftp.session.session == 77
    assert bench.held() == OLD


@pytest.mark.parametrize("lost", [ftp.CREATE, ftp.WRITE, ftp.TERMINATE])
@pytest.mark.parametrize("way", ["up", "down"])
def test_any_one_message_may_get_lost(lost: int, way: str) -> None:
    seen = []

    def first(packet: Packet) -> bool:
        if lost in (packet.opcode, packet.asked):
            seen.append(packet)
            return len(seen) == 1
        return False

    bench = holding()
    setattr(bench, way, Losing(first))
    began_us = bench.now_us
    assert bench.run(upload_of(wire(NEW))).outcome == "accepted"
    assert bench.held() == NEW
    assert bench.now_us - began_us < 2 * SECOND


def test_an_autopilot_without_ftp_is_a_failure_in_bounded_time() -> None:
    bench = holding()
    bench.up = Losing(lambda packet: True)
    began_us = bench.now_us
    timing = TransferTiming(timeout_us=500_000, retries=3)
    result = bench.run(upload_of(wire(NEW), timing=timing))
    assert (result.outcome, result.reason) == (
        "failed",
        "the autopilot did not reply to FTP requests",
    )
    assert bench.now_us - began_us == 2 * SECOND


def test_a_reply_to_another_client_or_to_another_request_ends_nothing() -> None:
    bench = holding()
    upload = upload_of(wire(NEW), session=3)
    (opening,) = upload.start(bench.now_us)
    seq = packet_of(opening).seq
    right = Packet(seq + 1, 3, ftp.ACK, asked=ftp.CREATE)
    for source, target, packet in (
        ((9, 1), STATION, right),
        ((1, 5), STATION, right),
        (VEHICLE, (254, 190), right),
        (VEHICLE, (255, 191), right),
        (VEHICLE, STATION, replace(right, seq=seq)),
        (VEHICLE, STATION, replace(right, session=4)),
        (VEHICLE, STATION, replace(right, asked=ftp.OPEN_TO_READ)),
        (VEHICLE, STATION, replace(right, opcode=ftp.CREATE)),
    ):
        (message,) = Codec(1, 1).decode(Codec(*source).encode(packet.message(target)))
        assert upload.receive(message, bench.now_us) == []
    (message,) = Codec(1, 1).decode(Codec(*VEHICLE).encode(right.message(STATION)))
    assert len(upload.receive(message, bench.now_us)) == 5
    assert upload.receive(message, bench.now_us) == []  # duplicated by the link


def test_items_that_would_be_refused_midway_are_not_sent_at_all() -> None:
    bench = holding()
    result = bench.run(upload_of((*wire(NEW), MissionItem(31000, 0, 0, 0, 0.0))))
    assert (result.outcome, result.seq) == ("rejected", 41)
    assert "command 31000" in result.reason
    result = bench.run(upload_of(line_of(656)))
    assert (result.outcome, result.seq) == ("rejected", 655)
    assert bench.sent == []
    assert bench.held() == OLD


def test_a_list_that_changes_while_it_is_read_is_reported() -> None:
    bench = holding(line_of(200))
    download = download_of()
    bench.begin(download)
    while len(bench.sent) < 12:
        bench.step(download)
    del bench.mock.missions.items[90:]
    while download.result is None:
        bench.step(download)
    assert download.result.outcome == "failed"
    assert download.result.items is None


def test_session_ids_differ_from_one_transfer_to_the_next_and_are_never_zero() -> None:
    session, seen = 1, set()
    for _ in range(255):
        seen.add(session)
        session = next_session(session)
    assert seen == set(range(1, 256))
    assert session == 1


def test_limits_that_the_client_cannot_change_are_reported_beforehand() -> None:
    assert leaves_old_tail(True, held_items=31, new_items=30)
    assert not leaves_old_tail(True, held_items=31, new_items=31)
    assert not leaves_old_tail(False, held_items=31, new_items=2)


def test_px4_has_no_such_file() -> None:
    bench = Bench(mock_of(stack_named("px4", "plane")))
    result = bench.run(upload_of(line_of(5)))
    assert result.outcome == "rejected"
    assert "the file does not exist (FTP error 10)" in result.reason
    assert bench.run(download_of()).outcome == "rejected"
