"""Signed links: accepted frames, counts, and that no key is logged."""

import asyncio
import base64
import contextlib
import hashlib
import socket
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.framing import frames_of, message_id_of
from autopilot_bridge.links.signing import (
    EPOCH_US,
    MAX_AHEAD_S,
    TICKS_PER_S,
    Counts,
    Key,
    Signing,
    Timestamps,
    key_of,
    key_warning,
    read_key,
    ticks_of,
)
from autopilot_bridge.links.tlog_writer import Tlog
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.client_events import TransferFinished
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

NOW_US = 1_790_000_000_000_000
NOW = ticks_of(NOW_US)
KEY, OTHER_KEY = Key(bytes(range(32))), Key(bytes(range(1, 33)))


class Clock:
    """A wall clock that does not advance by itself."""

    def __init__(self) -> None:
        self.now_us = NOW_US

    def __call__(self) -> int:
        return self.now_us


def signing(clock: Clock | None = None, key: Key = KEY, file: Path | None = None) -> Signing:
    return Signing(key, Timestamps(clock or Clock(), file))


def by_pymavlink(words: str, ticks: int, key: Key = KEY, link_id: int = 3) -> bytes:
    """Return a frame of a signing vehicle, made by pymavlink."""
    mav = mavlink.MAVLink(None, 1, 1)
    mav.signing.secret_key, mav.signing.sign_outgoing = key.secret, True
    mav.signing.timestamp, mav.signing.link_id = ticks, link_id
    return bytes(mavlink.MAVLink_statustext_message(6, words.encode()).pack(mav))


def stamp_of(frame: bytes) -> int:
    return int.from_bytes(frame[-12:-6], "little")


# Frames ---------------------------------------------------------------------------------------


def test_pymavlink_accepts_our_signatures_and_we_accept_its() -> None:
    ours = signing()
    vehicle = mavlink.MAVLink(None, 1, 1)
    vehicle.signing.secret_key, vehicle.signing.timestamp = KEY.secret, NOW
    frame = ours.sign(text("signed"), link_id=7)
    assert frames_of(frame) == [frame]
    (message,) = vehicle.parse_buffer(frame)
    assert (message.text, message.get_signed(), message.get_link_id()) == ("signed", True, 7)
    assert ours.accepts(by_pymavlink("back", NOW))
    assert ours.counts == Counts(good=1)


def test_each_frame_has_a_later_timestamp_however_the_clock_goes() -> None:
    clock = Clock()
    ours = signing(clock)
    stamps = []
    for moved_us in (0, 0, 0, 50, -3_600_000_000, 0, 7_200_000_000):
        clock.now_us += moved_us
        stamps.append(stamp_of(ours.sign(text("x"), 0)))
    assert stamps == sorted(set(stamps))
    assert stamps[:4] == [NOW, NOW + 1, NOW + 2, NOW + 5]
    assert stamps[-1] == ticks_of(clock.now_us)


def test_every_change_of_a_signed_frame_is_noticed() -> None:
    frame = by_pymavlink("a", NOW)
    for place in range(len(frame)):
        for bit in range(8):
            changed = bytearray(frame)
            changed[place] ^= 1 << bit
            ours = signing()
            accepted = [f for f in frames_of(bytes(changed)) if ours.accepts(f)]
            assert accepted == [], (place, bit)
            assert ours.accepts(frame)  # the forged frame has changed no timestamp


def test_another_key_is_counted_and_rejected() -> None:
    ours = signing()
    assert not ours.accepts(by_pymavlink("x", NOW, OTHER_KEY))
    assert ours.counts == Counts(wrong=1)


def test_unsigned_frames_are_refused_but_those_of_radios() -> None:
    ours = signing()
    radio = Codec(51, 68).encode(mavlink.MAVLink_radio_status_message(*range(7)))
    old = mavlink.MAVLink_statustext_message(6, b"MAVLink 1")
    old_frame = bytes(old.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True))
    assert [ours.accepts(frame) for frame in (text("x"), old_frame, radio)] == [False, False, True]
    assert ours.counts == Counts(unsigned=2, unsigned_allowed=1)
    strict = Signing(KEY, Timestamps(Clock()), allow_unsigned=frozenset())
    assert not strict.accepts(radio)


def test_a_radio_report_with_a_wrong_signature_is_refused_all_the_same() -> None:
    radio = Codec(51, 68).encode(mavlink.MAVLink_radio_status_message(*range(7)))
    assert not signing().accepts(signing(key=OTHER_KEY).sign(radio, 0))


def test_replays_are_refused_on_every_link() -> None:
    ours, frame = signing(), by_pymavlink("once", NOW)
    assert ours.accepts(frame)
    assert not ours.accepts(frame)
    assert not ours.accepts(by_pymavlink("earlier", NOW - 1))
    assert ours.accepts(by_pymavlink("later", NOW + 1))
    assert ours.accepts(by_pymavlink("another stream", NOW, link_id=4))
    assert ours.counts == Counts(good=3, repeated=2)


def test_a_stream_may_begin_a_minute_back_and_no_earlier() -> None:
    minute = 60 * TICKS_PER_S
    assert signing().accepts(by_pymavlink("x", NOW - minute))
    ours = signing()
    assert not ours.accepts(by_pymavlink("x", NOW - minute - 1))
    assert ours.counts == Counts(old=1)


def test_a_forged_frame_from_the_future_locks_no_sender_out() -> None:
    """pymavlink stores the forged timestamp and then refuses every genuine frame."""
    far = NOW + 10**9
    forged = by_pymavlink("forged", far, OTHER_KEY)
    theirs = mavlink.MAVLink(None, 255, 190)
    theirs.robust_parsing, theirs.signing.secret_key = True, KEY.secret
    theirs.parse_buffer(forged)
    assert theirs.parse_buffer(by_pymavlink("genuine", NOW))[0].get_type() == "BAD_DATA"
    ours = signing()
    assert not ours.accepts(forged)
    assert ours.accepts(by_pymavlink("genuine", NOW))


def test_a_key_holder_whose_clock_is_wrong_moves_neither_our_clock_nor_a_stream() -> None:
    ours, most = signing(), MAX_AHEAD_S * TICKS_PER_S
    assert not ours.accepts(by_pymavlink("from the future", NOW + most + 1))
    assert ours.counts == Counts(ahead=1)
    assert ours.accepts(by_pymavlink("right again", NOW))
    assert ours.accepts(by_pymavlink("a lead like ArduPilot's", NOW + most, link_id=9))
    assert stamp_of(ours.sign(text("x"), 0)) == NOW
    assert ours.lead_s() == MAX_AHEAD_S


# Restarts -------------------------------------------------------------------------------------


def test_no_timestamp_is_used_twice_though_the_clock_was_set_back(tmp_path: Path) -> None:
    file, clock = tmp_path / "signing", Clock()
    before = Timestamps(clock, file)
    for _ in range(3):
        clock.now_us += 60_000_000
        last = before.next()
    clock.now_us -= 86_400_000_000
    assert Timestamps(clock, file).next() > last  # after a crash
    before.close()
    assert Timestamps(clock, file).next() == last + 1  # after a normal shutdown


def test_a_crash_costs_less_than_the_lead_receivers_allow(tmp_path: Path) -> None:
    file, clock = tmp_path / "signing", Clock()
    Timestamps(clock, file).next()
    assert Timestamps(clock, file).next() < NOW + 6 * TICKS_PER_S


def test_a_clock_before_2015_or_a_spoilt_file_is_reported(tmp_path: Path) -> None:
    file = tmp_path / "signing"
    with pytest.raises(BridgeError, match="clock is set to a time before 2015"):
        Timestamps(lambda: EPOCH_US - 1, file)
    file.write_text("no number")
    with pytest.raises(BridgeError, match="contains no timestamp"):
        Timestamps(Clock(), file)
    file.write_text(str(NOW))
    assert Timestamps(lambda: 0, file).next() == NOW + 1


# Keys -----------------------------------------------------------------------------------------


def test_keys_come_as_digits_base64_or_passphrase() -> None:
    secret = bytes(range(32))
    assert key_of(secret.hex()) == key_of("hex:" + secret.hex()) == Key(secret)
    assert key_of("base64:" + base64.b64encode(secret).decode()) == Key(secret)
    assert key_of("correct horse") == Key(hashlib.sha256(b"correct horse").digest())


@pytest.mark.parametrize("bad", ["", "hex:12", "hex:xyz", "base64:!", "base64:AAAA", "0" * 64])
def test_an_invalid_key_is_reported_without_quoting_it(bad: str) -> None:
    with pytest.raises(BridgeError, match="signing key: ") as raised:
        key_of(bad)
    assert len(bad) < 8 or bad not in str(raised.value)


def test_keys_are_read_where_they_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "key"
    file.write_text("correct horse\r\nand a second line\n")
    monkeypatch.setenv("SIGNING", "correct horse")
    assert read_key(f"file:{file}") == read_key("env:SIGNING") == key_of("correct horse")
    file.chmod(0o600)
    assert key_warning(f"file:{file}") is None
    file.chmod(0o640)
    assert "chmod 600" in (key_warning(f"file:{file}") or "")
    for missing in ("env:NOT_THERE", f"file:{tmp_path / 'none'}", "correct horse"):
        with pytest.raises(BridgeError, match="signing key: "):
            read_key(missing)


def test_nothing_shows_a_key() -> None:
    assert "secret" not in repr(KEY)
    assert KEY.secret.hex() not in repr(signing())


# Connections ----------------------------------------------------------------------------------


def test_a_connection_signs_all_and_accepts_only_what_verifies(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"

    async def exchange() -> list[bytes]:
        port, peer, ours = free_port(), Peer(), signing()
        with Tlog(path, lambda: NOW_US, pytest.fail) as tlog:
            async with Connection(
                f"udpin:127.0.0.1:{port}", peer, clock_us, tlog=tlog, signing=ours, link_id=5
            ) as connection:
                with udp_socket() as vehicle:
                    for frame in (text("unsigned"), by_pymavlink("wrong", NOW, OTHER_KEY)):
                        vehicle.sendto(frame, ("127.0.0.1", port))
                    vehicle.sendto(by_pymavlink("genuine", NOW), ("127.0.0.1", port))
                    await receive_exactly(connection, peer, "genuine")
                    peer.outgoing = [text("one"), text("two")]
                    connection.flush()
                    assert ours.counts == Counts(good=1, unsigned=1, wrong=1)
                    return [await asyncio.to_thread(vehicle.recv, 999) for _ in range(2)]

    frames = run(exchange)
    checking = signing()
    assert [checking.accepts(frame) for frame in frames] == [True, True]
    assert [frame[-13] for frame in frames] == [5, 5]
    assert b"genuine" in path.read_bytes()
    assert b"wrong" not in path.read_bytes()


def test_a_key_is_sent_on_demand_and_never_recorded(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"

    async def exchange() -> list[bytes]:
        port, peer = free_port(), Peer()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            vehicle.bind(("127.0.0.1", port))
            vehicle.settimeout(PATIENCE_S)
            with Tlog(path, lambda: NOW_US, pytest.fail) as tlog:
                link = f"udpout:127.0.0.1:{port}"
                async with Connection(link, peer, clock_us, tlog=tlog) as connection:
                    connection.set_up_signing((255, 190), (1, 1), KEY, NOW_US, signing())
                    peer.outgoing = [text("signed from now on")]
                    connection.flush()
                    return [await asyncio.to_thread(vehicle.recv, 999) for _ in range(3)]

    *keys, then = run(exchange)
    for frame in keys:
        (message,) = Codec(1, 1).decode(frame)
        assert bytes(message.secret_key) == KEY.secret
        assert 0 < NOW - message.initial_timestamp <= 60 * TICKS_PER_S
    assert signing().accepts(then)
    assert KEY.secret[:16] not in path.read_bytes()
    assert b"signed from now on" in path.read_bytes()


class TextPeer(Peer):
    """A peer that only receives texts."""

    def receive_data(self, data: bytes, now_us: int) -> None:
        for frame in frames_of(data):
            if message_id_of(frame) == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
                super().receive_data(frame, now_us)


def test_a_key_that_another_station_sends_is_not_recorded_either(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    frame = Codec(254, 190).encode(mavlink.MAVLink_setup_signing_message(1, 1, KEY.secret, NOW))

    async def exchange() -> None:
        port, peer = free_port(), TextPeer()
        with Tlog(path, lambda: NOW_US, pytest.fail) as tlog, udp_socket() as other:
            link = f"udpin:127.0.0.1:{port}"
            async with Connection(link, peer, clock_us, tlog=tlog) as connection:
                other.sendto(text("a") + frame + text("b"), ("127.0.0.1", port))
                await receive_exactly(connection, peer, "a", "b")

    run(exchange)
    assert KEY.secret[:16] not in path.read_bytes()


@pytest.mark.parametrize(("key", "accepted"), [(KEY, True), (OTHER_KEY, False)])
def test_a_mission_is_uploaded_between_two_ends_that_share_a_key(key: Key, accepted: bool) -> None:
    mock, client = mock_of(stack_named("px4", "plane")), NativeClient()

    async def exchange() -> None:
        port = free_port()
        up = Connection(f"udpin:127.0.0.1:{port}", client, clock_us, signing=signing())
        down = Connection(f"udpout:127.0.0.1:{port}", mock, clock_us, signing=signing(key=key))
        asked = False
        with contextlib.suppress(TimeoutError):
            async with up, down, asyncio.timeout(PATIENCE_S if accepted else 0.5):
                while True:
                    await up.wait()
                    if client.stack is not None and not asked:
                        asked = True
                        client.upload(line_of(20), clock_us())
                        up.flush()
                    events = iter(client.next_event, None)
                    if any(isinstance(event, TransferFinished) for event in events):
                        return

    run(exchange)
    assert (client.stack is not None) == accepted
    assert len(mock.missions.items) == (20 if accepted else 0)
