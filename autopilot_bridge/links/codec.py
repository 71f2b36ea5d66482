"""Encoding and decoding of MAVLink 2 messages (pymavlink's generated codec)."""

import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.framing import (
    V2,
    checksum,
    frames_of,
    message_id_of,
    payload_of,
    source_of,
)

Message = Any  # pymavlink's messages carry no types

# Extension fields (all uint32) that the dialect on PyPI lacks; they follow its own fields.
_IDS = {
    mavlink.MAVLink_mission_count_message: ("opaque_id",),
    mavlink.MAVLink_mission_ack_message: ("opaque_id",),
    mavlink.MAVLink_mission_current_message: ("mission_id", "fence_id", "rally_points_id"),
}
_IDS_LEFT_OUT = {
    known.id: (known.unpacker.size, names)
    for known, names in _IDS.items()
    if names[0] not in known.fieldnames
}
# Messages without arrays and strings.
_OF_NUMBERS = {
    message_id: known
    for message_id, known in mavlink.mavlink_map.items()
    if set(known.lengths) == {1} and "char" not in known.fieldtypes
}
_HEADER_V2 = struct.Struct("<BBBBBBBHB")


class Codec:
    """Encoder and parser of one end of one link.

    MISSION_CURRENT comes with ``mission_id``, ``fence_id`` and ``rally_points_id``, MISSION_ACK and
    MISSION_COUNT with ``opaque_id``; each is 0 if the autopilot does not send it.
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._component_id = component_id

    def encode(self, message: Message) -> bytes:
        """The frame of a message, with the next sequence number.

        Its source is this end's component, or the message's ``from_component`` if set.
        """
        mav = self._mav
        mav.srcComponent = getattr(message, "from_component", self._component_id)
        own_pack = "pack" in message.__dict__  # it has extension fields
        if message.get_msgId() in _OF_NUMBERS and not own_pack:
            frame = _frame_of_numbers(message, (mav.seq, mav.srcSystem, mav.srcComponent))
        else:
            frame = bytes(message.pack(mav, force_mavlink1=False))
        mav.seq = (mav.seq + 1) % 256
        return frame

    def decode(self, data: bytes) -> list[Message]:
        """The messages in a datagram or in whole frames; other bytes are skipped."""
        return self.decode_frames(frames_of(data))

    def decode_frames(self, frames: list[bytes]) -> list[Message]:
        """The messages in whole frames whose checksums have been verified."""
        messages = [self._message(frame) for frame in frames]
        return [message for message in messages if message is not None]

    def _message(self, frame: bytes) -> Message | None:
        message_id = message_id_of(frame)
        known = _OF_NUMBERS.get(message_id)
        if known is not None:
            return _message_of_numbers(frame, known)
        if message_id not in mavlink.mavlink_map:
            return None
        try:
            return self._mav.decode(bytearray(frame))
        except mavlink.MAVError:
            return None


def _frame_of_numbers(message: Message, sent: tuple[int, int, int]) -> bytes:
    """Encode a numeric message, faster than pymavlink; ``sent``: sequence, system, component."""
    values = [getattr(message, name) for name in message.ordered_fieldnames]
    payload = message.unpacker.pack(*values).rstrip(b"\0") or b"\0"
    message_id = message.get_msgId()  # some have a field ``id``
    low, high = message_id & 0xFFFF, message_id >> 16
    body = _HEADER_V2.pack(V2, len(payload), 0, 0, *sent, low, high) + payload
    crc: int = checksum(body[1:], message_id)
    return body + crc.to_bytes(2, "little")


def _message_of_numbers(frame: bytes, known: Any) -> Message:
    """The numeric message of a verified frame, faster than pymavlink."""
    payload, size = payload_of(frame), known.unpacker.size
    values = known.unpacker.unpack(payload.ljust(size, b"\0")[:size])
    message = known(*[values[place] for place in known.orders])
    flags = (frame[2], frame[3]) if frame[0] == V2 else (0, 0)
    seq = frame[4] if frame[0] == V2 else frame[2]
    message._header = mavlink.MAVLink_header(known.id, *flags, len(payload), seq, *source_of(frame))
    message._msgbuf = bytearray(frame)
    if known.id in _IDS_LEFT_OUT:
        _set_ids(message, payload, *_IDS_LEFT_OUT[known.id])
    return message


def _set_ids(message: Message, payload: bytes, begin: int, names: tuple[str, ...]) -> None:
    size = 4 * len(names)
    raw = payload[begin : begin + size].ljust(size, b"\0")
    for name, value in zip(names, struct.unpack(f"<{len(names)}I", raw), strict=True):
        setattr(message, name, value)


def item_message(
    target: tuple[int, int], seq: int, item: MissionItem, current: int, mission_type: int
) -> Message:
    """MISSION_ITEM_INT for one item."""
    return mavlink.MAVLink_mission_item_int_message(
        *target,
        seq,
        item.frame,
        item.command,
        current,
        item.autocontinue,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        item.x,
        item.y,
        item.z,
        mission_type,
    )


def item_of(message: Message) -> MissionItem:
    """The item in a MISSION_ITEM_INT."""
    return MissionItem(
        message.command,
        message.frame,
        message.x,
        message.y,
        message.z,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        message.autocontinue,
    )
