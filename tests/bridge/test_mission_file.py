"""Encoding and decoding of mission files."""

import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import item_message
from autopilot_bridge.missions.mission_file import (
    decode_mission_file,
    encode_mission_file,
    file_length,
    first_bad_item,
)
from tests.bridge.helpers import flight_of, line_of

int32 = st.integers(-(2**31), 2**31 - 1)
single = st.floats(width=32, allow_nan=False)
items: st.SearchStrategy[MissionItem] = st.builds(
    MissionItem,
    *(st.integers(1, 65535), st.integers(0, 255), int32, int32),
    *(single, single, single, single, single),
    autocontinue=st.integers(0, 1),
)
lists = st.lists(items, max_size=20).map(tuple)


@given(lists, st.sampled_from([0, 1, 2]))
def test_a_file_gives_back_what_was_put_in(sent: tuple[MissionItem, ...], kind: int) -> None:
    data = encode_mission_file(sent, kind, (1, 1))
    assert len(data) == 10 + 38 * len(sent) == file_length(data[:10], kind)
    assert decode_mission_file(data, kind) == sent


def test_a_file_is_a_header_and_the_payloads_of_the_item_messages() -> None:
    sent = flight_of()
    codec = mavlink.MAVLink(None, 255, 190)
    payloads = b""
    for seq, item in enumerate(sent):
        frame = item_message((1, 1), seq, item, 0, 0).pack(codec)
        payloads += bytes(frame[10:-2]).ljust(38, b"\0")  # MAVLink 2 omits trailing zeros
    data = encode_mission_file(sent, 0, (1, 1))
    assert data[:10] == struct.pack("<5H", 0x763D, 0, 0, 0, 5)
    assert data[10:] == payloads


@given(lists, st.data())
def test_a_file_cut_short_or_too_long_is_refused(sent: Any, data: Any) -> None:
    whole = encode_mission_file(sent, 0, (1, 1))
    short = data.draw(st.integers(0, len(whole) - 1))
    for damaged in (whole[:short], whole + bytes(data.draw(st.integers(1, 80)))):
        with pytest.raises(BridgeError, match="mission file") as caught:
            decode_mission_file(damaged, 0)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("at", "value", "words"),
    [
        (0, b"\x3e", "begins with"),
        (2, b"\x01", "mission type 1"),
        (4, b"\x01", "options 1"),
        (6, b"\x02", "start 2"),
        (10 + 38 + 28, b"\x07", "item 1 has the number 7"),
        (10 + 38 + 30, b"\0\0", "item 1 is empty"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(at: int, value: bytes, words: str) -> None:
    data = bytearray(encode_mission_file(line_of(4), 0, (1, 1)))
    data[at : at + len(value)] = value
    with pytest.raises(BridgeError, match=words) as caught:
        decode_mission_file(bytes(data), 0)
    assert "\n" not in str(caught.value)


def test_a_number_that_does_not_fit_is_named_with_its_item() -> None:
    with pytest.raises(BridgeError, match="item 1"):
        encode_mission_file((*line_of(1), MissionItem(16, 0, 2**31, 0, 0.0)), 0, (1, 1))


def test_what_ardupilot_would_refuse_midway_is_found_beforehand() -> None:
    good = line_of(5)

    def found(**wrong: Any) -> tuple[int, str] | None:
        item = {"command": 16, "frame": 3, "x": 1, "y": 1, "z": 50.0} | wrong
        return first_bad_item((*good, MissionItem(**item)), 655)

    assert first_bad_item(good, 655) is None
    assert found() is None
    assert found(param4=math.nan) is None
    assert found(command=177, param1=5.0) is None
    for wrong, words in (
        ({"command": 31000}, "command 31000"),
        ({"param1": math.nan}, "parameter 1"),
        ({"command": 19, "param4": math.nan}, "parameter 4"),
        ({"param2": math.inf}, "parameter 2"),
        ({"x": 910_000_000}, "not a latitude and longitude"),
        ({"y": -1_810_000_000}, "not a latitude and longitude"),
        ({"z": math.nan}, "altitude"),
        ({"z": 83_000.0}, "altitude"),
        ({"frame": 1}, "frame 1"),
        ({"command": 177, "param1": 6.0}, "jump"),
        ({"command": 177, "param1": 0.0}, "jump"),
    ):
        bad = found(**wrong)
        assert bad is not None
        assert bad[0] == 5
        assert words in bad[1]
    assert first_bad_item(line_of(656), 655) == (655, "the autopilot stores at most 655 items")
