"""Recordings as pymavlink reads them; missions over every kind of link."""

import asyncio
import contextlib
import resource
import signal
import socket
import struct
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import Plan
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.link_address import other_end
from autopilot_bridge.links.tlog_writer import Tlog
from autopilot_bridge.mock.serving import serve
from autopilot_bridge.stacks.stacks import stack_named
from mission_service.cli.mission_transfers import Line, download, upload
from tests.bridge.helpers import line_of, mock_of
from tests.bridge.transport_helpers import (
    Peer,
    clock_us,
    free_port,
    receive_exactly,
    run,
    text,
    udp_socket,
)
from tests.patience import PATIENCE_S

BEGIN_US = 1_790_000_000_000_000


def wall_clock() -> Any:
    """Return a wall clock that advances by a third of a second at each reading."""
    looks = iter(range(1_000_000))
    return lambda: BEGIN_US + 333_333 * next(looks)


def read(path: Path) -> list[tuple[float, int, str]]:
    """Return time in s, system and message of each record, read by pymavlink."""
    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    found = []
    while (message := log.recv_match()) is not None:
        words = getattr(message, "text", message.get_type())
        found.append((message._timestamp, message.get_srcSystem(), words))
    log.close()
    return found


def test_a_record_is_the_time_and_the_frame(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    with Tlog(path, lambda: BEGIN_US + 7, pytest.fail) as tlog:
        tlog.record([text("a"), text("bc")])
    stamp = struct.pack(">Q", BEGIN_US + 4)  # the two lowest bits are the link number: 0
    assert path.read_bytes() == stamp + text("a") + stamp + text("bc")


def test_both_directions_are_recorded_and_pymavlink_reads_them_back(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"

    async def exchange(tlog: Tlog) -> None:
        port, peer = free_port(), Peer()
        link = f"udpin:127.0.0.1:{port}"
        async with Connection(link, peer, clock_us, tlog=tlog) as connection:
            # The frame was not sent and therefore not recorded.
            peer.outgoing = [text("without a target")]
            connection.flush()
            with udp_socket() as other:
                other.sendto(b"\x00noise" + text("in") + text("and in"), ("127.0.0.1", port))
                await receive_exactly(connection, peer, "in", "and in")
                answer = Codec(255, 190).encode(mavlink.MAVLink_statustext_message(6, b"out"))
                peer.outgoing = [answer]
                connection.flush()

    with Tlog(path, wall_clock(), pytest.fail) as tlog:
        run(lambda: exchange(tlog))
    found = read(path)
    assert [(system, words) for _, system, words in found] == [
        *((1, "in"), (1, "and in")),
        (255, "out"),
    ]
    times_s = [at_s - BEGIN_US / 1e6 for at_s, _, _ in found]
    assert times_s == pytest.approx([0.0, 0.0, 0.333333], abs=5e-6)


def test_a_recording_is_added_to_and_readable_without_being_closed(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    with Tlog(path, wall_clock(), pytest.fail) as first:
        first.record([text("one")])
    with Tlog(path, wall_clock(), pytest.fail) as second:
        second.record([text("two")])
        assert [words for _, _, words in read(path)] == ["one", "two"]


def test_an_invalid_recording_is_reported_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(BridgeError, match=r"none/flight\.tlog.*No such"):
        Tlog(tmp_path / "none" / "flight.tlog", wall_clock(), pytest.fail)


@pytest.mark.parametrize("content", [b"seed = 1\nduration_s = 60\n", b"short"])
def test_a_file_that_is_not_a_recording_remains_unchanged(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "scenario.toml"
    path.write_bytes(content)
    with pytest.raises(BridgeError, match=r"scenario\.toml: is not a \.tlog file; choose another"):
        Tlog(path, wall_clock(), pytest.fail)
    assert path.read_bytes() == content


@pytest.mark.parametrize("clock_step_us", [10_000_000, -7_200_000_000])
def test_a_full_disk_is_reported_once_and_the_recording_continues_later(
    tmp_path: Path, clock_step_us: int
) -> None:
    path, now_us = tmp_path / "flight.tlog", [BEGIN_US]
    reported: list[str] = []
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with Tlog(path, lambda: now_us[0], reported.append) as tlog:
        tlog.record([text("a")])
        size = path.stat().st_size
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size + 20, unlimited[1]))
            for _ in range(30):
                tlog.record([text("b"), text("c")])
                now_us[0] += 1_000_000
            assert path.stat().st_size == size
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
            signal.signal(signal.SIGXFSZ, ignored)
        now_us[0] += clock_step_us  # a negative step: the clock was set back
        tlog.record([text("d")])
    assert [words for _, _, words in read(path)] == ["a", "d"]
    assert reported == [
        f"{path}: cannot be written: the disk is full; frames are not recorded",
        f"{path}: is written again; 60 frames are missing",
    ]


# Missions over every kind of link ---------------------------------------------------------------


@contextlib.contextmanager
def autopilot_on(link: str) -> Iterator[Any]:
    """Run a mock autopilot in a thread."""
    mock = mock_of(stack_named("ardupilot", "plane"))
    loop = asyncio.new_event_loop()
    flight = loop.create_task(serve(mock, link, 10.0, clock_us))

    def fly() -> None:
        with contextlib.suppress(asyncio.CancelledError):
            loop.run_until_complete(flight)

    thread = threading.Thread(target=fly)
    thread.start()
    try:
        yield mock
    finally:
        loop.call_soon_threadsafe(flight.cancel)
        thread.join(timeout=PATIENCE_S)
        loop.close()


@pytest.mark.parametrize("kind", ["udpin", "udpout", "tcp", "tcpin"])
def test_a_mission_goes_up_and_down_over_every_kind_of_link(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "transfer.tlog"
    ours = f"{kind}:127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    with autopilot_on(other_end(ours)) as mock:
        line = Line(ours, 8.0, path)
        assert upload(Plan(line_of(20)), line)["result"] == "accepted"
        assert tuple(mock.missions.items[1:]) == line_of(20)
        assert download(tmp_path / "back.plan", line)["items"] == 20
    recorded = [(system, words) for _, system, words in read(path)]
    for system in (255, 1):  # 20 items in 4 blocks: uploaded, read back and downloaded
        assert recorded.count((system, "FILE_TRANSFER_PROTOCOL")) >= 3 * 4
