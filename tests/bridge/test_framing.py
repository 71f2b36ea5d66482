"""Framing of bytes that are incomplete, noisy, or of another dialect."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.framing import Framer


def text(words: str) -> bytes:
    """Return a frame that contains this text; its length is 13 bytes plus one for a character."""
    return Codec(1, 1).encode(mavlink.MAVLink_statustext_message(6, words.encode()))


def mavlink_1(words: str) -> bytes:
    message = mavlink.MAVLink_statustext_message(6, words.encode())
    return bytes(message.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True))


def signed(words: str) -> bytes:
    mav = mavlink.MAVLink(None, 1, 1)
    mav.signing.secret_key = bytes(32)
    mav.signing.sign_outgoing = True
    return bytes(mavlink.MAVLink_statustext_message(6, words.encode()).pack(mav))


def of_another_dialect(payload: bytes) -> bytes:
    """Return a frame of an unknown message, so that its checksum cannot be verified."""
    return (
        bytes((0xFD, len(payload), 0, 0, 7, 1, 1))
        + (60_999).to_bytes(3, "little")
        + payload
        + b"cc"
    )


@pytest.mark.parametrize("cut", [1, 2, 3, 7, 10, 11, 30])
def test_frames_come_whole_however_the_stream_is_cut(cut: int) -> None:
    sent = [text("one"), signed("two"), mavlink_1("three"), of_another_dialect(b"four"), text("")]
    stream = b"".join(sent)
    framer = Framer()
    found = [
        frame for at in range(0, len(stream), cut) for frame in framer.feed(stream[at : at + cut])
    ]
    assert found == sent


def test_a_frame_is_handed_out_as_soon_as_it_is_whole() -> None:
    framer, frame = Framer(), text("now")
    assert framer.feed(frame[:-1]) == []
    assert framer.feed(frame[-1:]) == [frame]


def test_a_damaged_frame_is_passed_over() -> None:
    damaged = bytearray(text("damaged"))
    damaged[12] ^= 1
    assert Framer().feed(bytes(damaged) + text("whole")) == [text("whole")]


def test_a_false_start_does_not_cost_the_frames_it_claims() -> None:
    # The header states 200 bytes of payload: pymavlink's parser loses both frames.
    false = bytes((0xFD, 200, 0, 0, 0, 1, 1, 0, 0, 0))
    frames = [text("inside the false frame"), text("too")]
    assert Framer().feed(false + b"".join(frames) + bytes(200)) == frames


noise = st.binary(max_size=40) | st.binary(max_size=9).map(lambda tail: b"\xfd\x30\x00" + tail)


@settings(max_examples=150)
@given(st.lists(noise, min_size=1, max_size=6), st.integers(1, 90), st.booleans())
def test_noise_between_frames_costs_no_frame(gaps: list[bytes], cut: int, old: bool) -> None:
    frames = [(mavlink_1 if old else text)(f"number {index}") for index in range(len(gaps))]
    # Noise may look like the start of a frame of another dialect, so such starts are removed here.
    parts = [b"\x00" + gap + frame for gap, frame in zip(gaps, frames, strict=True)]
    stream = b"".join(parts) + bytes(300)
    framer = Framer()
    found = [
        frame for at in range(0, len(stream), cut) for frame in framer.feed(stream[at : at + cut])
    ]
    assert found == frames


def test_a_torn_datagram_is_completed_by_the_next() -> None:
    framer, frame = Framer(), text("torn")
    assert framer.feed_datagram(frame[:12]) == []
    assert framer.feed_datagram(frame[12:] + text("and another")) == [frame, text("and another")]


def test_a_torn_datagram_whose_rest_is_lost_delays_nothing() -> None:
    framer = Framer()
    torn = Codec(1, 1).encode(mavlink.MAVLink_statustext_message(6, b"x" * 50))[:20]
    assert framer.feed_datagram(torn) == []
    assert framer.feed_datagram(text("")) == [text("")]


def test_frames_behind_a_false_start_come_at_the_next_datagram_at_the_latest() -> None:
    framer = Framer()
    assert framer.feed_datagram(b"\x00\xfd\xff\x00" + text("behind")) == []
    assert framer.feed_datagram(text("next")) == [text("behind"), text("next")]


def test_little_is_kept_of_endless_noise() -> None:
    framer = Framer()
    for _ in range(200):
        framer.feed(b"\xfd\xff\x00" * 100)
    assert len(framer._rest) <= 280


def test_a_frame_that_cannot_be_checked_hides_no_good_ones() -> None:
    frames = [text("inside"), text("too")]
    claims = of_another_dialect(b"".join(frames))
    assert Framer().feed(claims + text("behind")) == [claims, *frames, text("behind")]
    across = claims[:-20] + text("begins inside and ends behind")
    assert text("begins inside and ends behind") in Framer().feed(across + bytes(300))


def test_a_datagram_begins_a_frame_whatever_came_before() -> None:
    framer, foreign = Framer(), of_another_dialect(b"abc")
    assert framer.feed_datagram(b"noise without a start") == []
    assert framer.feed_datagram(foreign) == [foreign]
