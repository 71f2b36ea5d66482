"""Encodes and decodes MAVLink 2 messages with pymavlink's generated codec."""

import struct
from collections.abc import Callable
from dataclasses import asdict, fields
from operator import attrgetter
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

Message = Any  # pymavlink's messages have no type annotations

# Extension fields at the end of messages (all uint32). Some releases of pymavlink lack them.
_EXTENSIONS = {
    mavlink.MAVLink_mission_count_message: ("opaque_id",),
    mavlink.MAVLink_mission_ack_message: ("opaque_id",),
    mavlink.MAVLink_mission_current_message: ("mission_id", "fence_id", "rally_points_id"),
}
_MISSING_EXTENSIONS = {
    message_class.id: (message_class.unpacker.size, names)
    for message_class, names in _EXTENSIONS.items()
    if names[0] not in message_class.fieldnames
}
# Messages that contain only scalar numbers.
_NUMERIC = {
    message_id: message_class
    for message_id, message_class in mavlink.mavlink_map.items()
    if set(message_class.lengths) == {1} and "char" not in message_class.fieldtypes
}
_HEADER_V2 = struct.Struct("<BBBBBBBHB")


def _values_getter(names: list[str]) -> Callable[[Message], tuple[Any, ...]]:
    """Return a function that returns the values of these fields of a message."""
    if len(names) == 1:
        return lambda message: (getattr(message, names[0]),)
    return attrgetter(*names)


_VALUES_OF = {
    message_id: _values_getter(message_class.ordered_fieldnames)
    for message_id, message_class in _NUMERIC.items()
}


class Codec:
    """The encoder and parser for one end of one link.

    A decoded MISSION_CURRENT has the fields ``mission_id``, ``fence_id`` and ``rally_points_id``.
    MISSION_ACK and MISSION_COUNT have ``opaque_id``. Each of these fields is 0 if the autopilot
    does not send it.
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._component_id = component_id

    def encode(self, message: Message) -> bytes:
        """Return the frame of a message, with the next sequence number.

        The frame's source is the component of this end, or the message's ``from_component`` if the
        message has one.
        """
        mav = self._mav
        component_id = getattr(message, "from_component", self._component_id)
        if message.get_msgId() in _NUMERIC:
            frame = _encode_numeric(message, (mav.seq, mav.srcSystem, component_id))
        else:
            mav.srcComponent = component_id
            frame = bytes(message.pack(mav, force_mavlink1=False))
        mav.seq = (mav.seq + 1) % 256
        return frame

    def decode(self, data: bytes) -> list[Message]:
        """Return the messages in a datagram or in complete frames; other bytes are skipped."""
        return self.decode_frames(frames_of(data))

    def decode_frames(self, frames: list[bytes]) -> list[Message]:
        """Return the messages in complete frames whose checksums have been verified."""
        return [message for frame in frames if (message := self._message(frame)) is not None]

    def _message(self, frame: bytes) -> Message | None:
        message_id = message_id_of(frame)
        message_class = _NUMERIC.get(message_id)
        if message_class is not None:
            return _decode_numeric(frame, message_class)
        if message_id not in mavlink.mavlink_map:
            return None
        try:
            return self._mav.decode(bytearray(frame))
        except mavlink.MAVError:
            return None


def _encode_numeric(message: Message, sent: tuple[int, int, int]) -> bytes:
    """Return the frame of a numeric message; ``sent`` is (sequence, system, component).

    This function is faster than pymavlink's.
    """
    message_id = message.get_msgId()  # not named ``id``, because some messages have a field ``id``
    values = _VALUES_OF[message_id](message)
    payload = message.unpacker.pack(*values) + getattr(message, "extension_bytes", b"")
    payload = payload.rstrip(b"\0") or b"\0"
    low, high = message_id & 0xFFFF, message_id >> 16
    body = _HEADER_V2.pack(V2, len(payload), 0, 0, *sent, low, high) + payload
    crc: int = checksum(body[1:], message_id)
    return body + crc.to_bytes(2, "little")


def _decode_numeric(frame: bytes, message_class: Any) -> Message:
    """Return the numeric message in a verified frame, faster than pymavlink does."""
    payload, size = payload_of(frame), message_class.unpacker.size
    values = message_class.unpacker.unpack(payload.ljust(size, b"\0")[:size])
    message = message_class(*[values[index] for index in message_class.orders])
    header = message._header
    if frame[0] == V2:
        header.mlen, header.incompat_flags, header.compat_flags, header.seq = frame[1:5]
    else:
        header.mlen, header.seq = frame[1:3]
    header.srcSystem, header.srcComponent = source_of(frame)
    message._msgbuf = bytearray(frame)
    if message_class.id in _MISSING_EXTENSIONS:
        _set_extensions(message, payload, *_MISSING_EXTENSIONS[message_class.id])
    return message


def _set_extensions(message: Message, payload: bytes, begin: int, names: tuple[str, ...]) -> None:
    size = 4 * len(names)
    raw = payload[begin : begin + size].ljust(size, b"\0")
    for name, value in zip(names, struct.unpack(f"<{len(names)}I", raw), strict=True):
        setattr(message, name, value)


def item_message(
    target: tuple[int, int], seq: int, item: MissionItem, current: int, mission_type: int
) -> Message:
    """Return the MISSION_ITEM_INT for one item."""
    return mavlink.MAVLink_mission_item_int_message(
        *target, seq, current=current, mission_type=mission_type, **asdict(item)
    )


def item_of(message: Message) -> MissionItem:
    """Return the item in a MISSION_ITEM_INT."""
    return MissionItem(*(getattr(message, field.name) for field in fields(MissionItem)))
