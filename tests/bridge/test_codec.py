"""Messages that the installed dialect contains only in part; ids of plans."""

import json
import math
import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Codec, Message, item_message
from autopilot_bridge.links.extension_fields import with_extension
from autopilot_bridge.missions.plan_id import mission_id_of
from autopilot_bridge.stacks.stacks import stack_named
from tests.bridge.helpers import SECOND, line_of, mock_of
from tests.bridge.transcripts import FOLDER

PX4 = stack_named("px4", "plane")
ids = st.sampled_from([0, 1, 0xFF, 0x100, 0xFF000000, 0xFFFFFFFF]) | st.integers(0, 2**32 - 1)


def decoded(message: Message) -> Message:
    (found,) = Codec(255, 190).decode(Codec(1, 1).encode(message))
    return found


def current_message() -> Message:
    return mavlink.MAVLink_mission_current_message(3, 7, 2, 1)


@given(ids, ids, ids)
def test_mission_current_has_its_three_ids(mission: int, fence: int, rally: int) -> None:
    found = decoded(with_extension(current_message(), mission, fence, rally))
    assert (found.mission_id, found.fence_id, found.rally_points_id) == (mission, fence, rally)
    assert (found.seq, found.total, found.mission_state, found.mission_mode) == (3, 7, 2, 1)


@given(ids)
def test_acknowledgement_and_count_have_an_id(plan: int) -> None:
    for message in (
        mavlink.MAVLink_mission_ack_message(255, 190, 0, 0),
        mavlink.MAVLink_mission_count_message(255, 190, 4, 1),
    ):
        assert decoded(with_extension(message, plan)).opaque_id == plan


def test_ids_that_are_not_sent_are_zero() -> None:
    assert decoded(current_message()).mission_id == 0
    assert decoded(mavlink.MAVLink_mission_ack_message(255, 190, 0, 0)).opaque_id == 0
    old = mavlink.MAVLink_mission_ack_message(255, 190, 0, 0)
    frame = old.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True)
    (found,) = Codec(255, 190).decode(frame)
    assert found.opaque_id == 0


def test_a_datagram_of_noise_costs_the_next_one_nothing() -> None:
    receiver, frame = Codec(255, 190), Codec(1, 1).encode(current_message())
    assert receiver.decode(b"\xfd\xff\x00 a false start") == []
    assert [found.seq for found in receiver.decode(b"\x00\xfd\x40\x00" + frame)] == [3]
    assert [found.seq for found in receiver.decode(frame)] == [3]


def crc_bit_by_bit(data: bytes) -> int:
    """Return the reflected CRC-32 that begins with 0 and is not inverted."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


def test_an_id_is_the_crc_of_the_items() -> None:
    items = (
        MissionItem(22, 6, 363017966, -842000000, 40.0, 15.0, param4=math.nan),
        MissionItem(177, 2, 0, 0, 0.0, 1.0, 2.0, autocontinue=0),
    )
    raw = struct.pack("<BHB4fiif", 6, 22, 1, 15, 0, 0, math.nan, 363017966, -842000000, 40)
    raw += struct.pack("<BHB4fiif", 2, 177, 0, 1, 2, 0, 0, 0, 0, 0)
    assert mission_id_of(items, PX4) == crc_bit_by_bit(raw)
    assert mission_id_of((), PX4) == 0
    assert mission_id_of(items, stack_named("ardupilot", "plane")) is None


def test_the_mock_gives_the_same_id() -> None:
    mock, station, items = mock_of(PX4), Codec(255, 190), line_of(5)
    mock.handle_timer(0)
    mock.receive_data(station.encode(mavlink.MAVLink_mission_count_message(1, 1, 5, 0)), 0)
    for seq, item in enumerate(items):
        mock.receive_data(station.encode(item_message((1, 1), seq, item, seq == 0, 0)), 0)
    mock.handle_timer(SECOND)  # MISSION_CURRENT is sent once a second
    received = [m for datagram in mock.data_to_send() for m in Codec(9, 9).decode(datagram)]
    (ack,) = [m for m in received if m.get_type() == "MISSION_ACK"]
    current = [m for m in received if m.get_type() == "MISSION_CURRENT"][-1]
    assert ack.opaque_id == current.mission_id == mission_id_of(items, PX4) != 0


def item_of_record(fields: dict[str, Any]) -> MissionItem:
    others = ("target_system", "target_component", "seq", "current", "mission_type")
    kept = {name: value for name, value in fields.items() if name not in others}
    values: dict[str, Any] = {k: math.nan if v is None else v for k, v in kept.items()}
    return MissionItem(**values)


def uploads_of(path: Path) -> list[tuple[int, int | None]]:
    """Return PX4's id and the id computed from the items, for each upload that PX4 accepted."""
    found: list[tuple[int, int | None]] = []
    items: dict[int, MissionItem] = {}
    count = -1
    for record in map(json.loads, path.read_text().splitlines()[1:]):
        kind, fields = record["msg"], record["fields"]
        if kind == "MISSION_COUNT" and record["dir"] == "tx":
            items, count = {}, fields["count"]
        elif kind == "MISSION_ITEM_INT" and record["dir"] == "tx":
            items.setdefault(fields["seq"], item_of_record(fields))
        elif kind == "MISSION_ACK" and record["dir"] == "rx" and len(items) == count > 0:
            if fields["type"] == mavlink.MAV_MISSION_ACCEPTED:
                sent = [items[seq] for seq in range(count)]
                found.append((fields["opaque_id"], mission_id_of(sent, PX4)))
            items, count = {}, -1
    return found


@pytest.mark.skipif(not FOLDER.exists(), reason="no recordings on this machine")
@pytest.mark.parametrize("name", ["px4_fixedwing", "px4_multicopter"])
def test_px4_itself_gave_the_same_ids(name: str) -> None:
    cases = sorted((FOLDER / name).glob("*.jsonl"))
    found = [pair for case in cases if case.stem != "second_uploader" for pair in uploads_of(case)]
    assert len(found) > 12
    assert [theirs_id for theirs_id, _ in found] == [ours for _, ours in found]


def test_every_message_is_decoded_as_pymavlink_does() -> None:
    sender, theirs = mavlink.MAVLink(None, 7, 8), mavlink.MAVLink(None)
    for message_id, message_class in mavlink.mavlink_map.items():
        size = message_class.unpacker.size
        values = message_class.unpacker.unpack(bytes(number % 120 + 1 for number in range(size)))
        blank = theirs.decode(bytearray(frame_with(message_class, bytes(size), sender)))
        assert blank.get_msgId() == message_id
        for payload in (message_class.unpacker.pack(*values), b"\x01"):
            frame = frame_with(message_class, payload, sender)
            expected = theirs.decode(bytearray(frame))
            (found,) = Codec(255, 190).decode(frame)
            same = {name: getattr(expected, name) for name in expected.get_fieldnames()}
            assert {name: getattr(found, name) for name in found.get_fieldnames()} == same
            assert found.get_type() == expected.get_type()
            assert vars(found.get_header()) == vars(expected.get_header())
            assert found.get_msgbuf() == expected.get_msgbuf()


def frame_with(message_class: Any, payload: bytes, sender: Any) -> bytes:
    message = message_class.__new__(message_class)
    mavlink.MAVLink_message.__init__(message, message_class.id, message_class.msgname)
    frame: bytes = message._pack(sender, message_class.crc_extra, payload)
    return frame
