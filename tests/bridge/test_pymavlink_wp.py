"""pymavlink's waypoint code (mavwp, mavftp, mavutil) with the mock, as in its examples."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavftp, mavutil, mavwp

from autopilot_bridge.items import Items
from autopilot_bridge.missions.mission_file import encode_mission_file
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.stacks.stacks import Stack, Step, stack_named
from tests.bridge.mock_process import mock_process, short_mission
from tests.patience import PATIENCE_S

mavlink = mavutil.mavlink
SPEEDUP = 20.0
TIMEOUT_S = 15.0
TRIES = 40


@contextmanager
def vehicle(name: str, kind: str = "plane", speedup: float = SPEEDUP) -> Iterator[Any]:
    """Return a connection that has received the mock's heartbeat."""
    with closing(mavutil.mavlink_connection("udpin:127.0.0.1:0")) as connection:
        port = connection.port.getsockname()[1]
        with mock_process(port, name, kind, speedup=speedup):
            assert connection.wait_heartbeat(timeout=PATIENCE_S) is not None
            yield connection


def received(connection: Any, *kinds: str) -> Any:
    message = connection.recv_match(type=list(kinds), blocking=True, timeout=PATIENCE_S)
    assert message is not None, f"no {' or '.join(kinds)}"
    return message


def asked(connection: Any, ask: Callable[[], Any], *kinds: str) -> Any:
    """Return the reply to a message; repeat it in case a full socket buffer dropped a datagram."""
    for _ in range(TRIES):
        ask()
        message = connection.recv_match(type=list(kinds), blocking=True, timeout=TIMEOUT_S)
        if message is not None:
            return message
    raise AssertionError(f"no {' or '.join(kinds)}")


def loader_of(items: Items) -> mavwp.MAVWPLoader:
    """Return the waypoints as pymavlink stores them, with degrees as floats."""
    loader = mavwp.MAVWPLoader(1, 1)
    for item in items:
        loader.add(
            mavlink.MAVLink_mission_item_message(
                *(1, 1, 0, item.frame, item.command, 0, item.autocontinue),
                *(item.param1, item.param2, item.param3, item.param4),
                *(item.x / 1e7, item.y / 1e7, item.z),
            )
        )
    return loader


def uploaded(connection: Any, loader: mavwp.MAVWPLoader, as_int: bool) -> int:
    """Upload with the classic loop; return the MISSION_ACK."""
    cleared = asked(connection, connection.waypoint_clear_all_send, "MISSION_ACK")
    assert cleared.type == mavlink.MAV_MISSION_ACCEPTED
    send = partial(connection.waypoint_count_send, loader.count())
    while True:
        message = asked(connection, send, "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK")
        if message.get_type() == "MISSION_ACK":
            return int(message.type)
        item = loader.wp(message.seq)
        send = partial(
            connection.mav.send,
            mavutil.mavlink.MAVLink_mission_item_int_message(
                *(1, 1, item.seq, item.frame, item.command, item.current, item.autocontinue),
                *(item.param1, item.param2, item.param3, item.param4),
                *(round(item.x * 1e7), round(item.y * 1e7), item.z),
            )
            if as_int
            else item,
        )


def downloaded(connection: Any) -> mavwp.MAVWPLoader:
    """Download with the classic loop, by MISSION_REQUEST and floats."""
    loader = mavwp.MAVWPLoader(1, 1)
    listed = asked(connection, connection.waypoint_request_list_send, "MISSION_COUNT")
    for seq in range(listed.count):
        request = partial(connection.waypoint_request_send, seq)
        loader.add(asked(connection, request, "MISSION_ITEM"))
    connection.mav.mission_ack_send(1, 1, mavlink.MAV_MISSION_ACCEPTED)
    return loader


def rows(loader: mavwp.MAVWPLoader) -> list[tuple[int, ...]]:
    """Return command, latitude, longitude (1e-5 deg, because of floats) and altitude (m).

    Frames are left out, because PX4 returns another frame for floats.
    """
    items = [loader.wp(index) for index in range(loader.count())]
    return [
        (item.command, round(item.x * 1e5), round(item.y * 1e5), round(item.z)) for item in items
    ]


def expected(items: Items, stack: Stack) -> list[tuple[int, ...]]:
    return rows(loader_of(tuple(as_read_back(item, stack) for item in items)))


def start(connection: Any, stack: Stack) -> None:
    for step in stack.start:
        carry_out(connection, stack, step)


def carry_out(connection: Any, stack: Stack, step: Step) -> None:
    values = [*step.params, *[0.0] * (7 - len(step.params))]
    send = partial(connection.mav.command_long_send, 1, 1, step.command, 0, *values)
    acks = [asked(connection, send, "COMMAND_ACK")]
    if stack.acks_of(step.command) > 1:
        acks.append(connection.recv_match(type="COMMAND_ACK", blocking=True, timeout=TIMEOUT_S))
    for ack in acks:
        assert (ack.command, ack.result) == (step.command, mavlink.MAV_RESULT_ACCEPTED)


def until_current(connection: Any, seq: int) -> list[int]:
    """Return the items reported as current up to this one, each once."""
    seqs: list[int] = []
    end = time.monotonic() + PATIENCE_S
    while not seqs or seqs[-1] != seq:
        assert time.monotonic() < end, f"item {seq} was never current, but {seqs} were"
        current = received(connection, "MISSION_CURRENT").seq
        if not seqs or seqs[-1] != current:
            seqs.append(current)
    return seqs


@pytest.mark.parametrize(
    ("name", "kind", "as_int"),
    [("px4", "plane", True), ("ardupilot", "plane", False)],
)
def test_the_classic_waypoint_loop_uploads_downloads_flies_and_clears(
    name: str, kind: str, as_int: bool
) -> None:
    stack = stack_named(name, kind)
    hidden = 1 if stack.item_0_is_home else 0
    mission = short_mission()
    items = (*mission[:hidden], *mission)
    with vehicle(name, kind) as connection:
        asked_at = connection.messages
        assert uploaded(connection, loader_of(items), as_int) == mavlink.MAV_MISSION_ACCEPTED
        assert stack.request_message in asked_at
        assert rows(downloaded(connection))[hidden:] == expected(mission, stack)
        start(connection, stack)
        seqs = until_current(connection, len(items) - 1)
        assert seqs[-3:] == [len(items) - 3, len(items) - 2, len(items) - 1]
        connection.waypoint_set_current_send(hidden + 1)
        assert until_current(connection, hidden + 1)
        carry_out(connection, stack, stack.set_mode(stack.rtl_mode))
        cleared = asked(connection, connection.waypoint_clear_all_send, "MISSION_ACK")
        assert cleared.type == mavlink.MAV_MISSION_ACCEPTED
        assert downloaded(connection).count() == 0


def test_pymavlinks_ftp_reads_and_writes_the_mission_file(tmp_path: Path) -> None:
    stack = stack_named("ardupilot", "plane")
    mission = short_mission(legs=60)
    items = (*mission[:1], *mission)
    sent, read = tmp_path / "sent.dat", tmp_path / "read.dat"
    sent.write_bytes(encode_mission_file(items, 0, (1, 1)))
    with vehicle("ardupilot") as connection:
        files = mavftp.MAVFTP(connection, 1, 1)
        files.ftp_settings.idle_detection_time = 1.2  # the delay of pymavlink after a put
        files.cmd_put([str(sent), "@MISSION/mission.dat"])
        put = files.process_ftp_reply("CreateFile", timeout=TIMEOUT_S)
        assert put.error_code == mavftp.FtpError.Success
        files.cmd_get(["@MISSION/mission.dat", str(read)])
        got = files.process_ftp_reply("OpenFileRO", timeout=TIMEOUT_S)
        assert got.error_code == mavftp.FtpError.Success
        assert len(read.read_bytes()) == len(sent.read_bytes())
        assert rows(downloaded(connection))[1:] == expected(mission, stack)
