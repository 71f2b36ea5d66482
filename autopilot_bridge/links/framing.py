"""Framing: whole MAVLink frames from the bytes of one remote, with noise skipped (sans-IO).

After a false start marker pymavlink's parser discards as many bytes as the false header states,
valid frames included. This parser consumes the bytes of a frame only if its checksum is right;
otherwise it skips one byte and searches on. So a frame is lost only if noise before it has a right
checksum by chance (1 in 65536). On a stream, bytes after a false start marker wait until its stated
length has arrived: 280 bytes at most.
"""

import re
import struct
from functools import cache

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

STARTS = bytes((mavlink.PROTOCOL_MARKER_V1, mavlink.PROTOCOL_MARKER_V2))
_START = re.compile(b"[" + re.escape(STARTS) + b"]")
SIGNED = mavlink.MAVLINK_IFLAG_SIGNED
SIGNATURE_BYTES = mavlink.MAVLINK_SIGNATURE_BLOCK_LEN
V2 = mavlink.PROTOCOL_MARKER_V2
# For each message of the dialect: its longest payload and its CRC extra byte.
_KNOWN = {
    message_id: (known.unpacker.size, bytes((known.crc_extra,)))
    for message_id, known in mavlink.mavlink_map.items()
}


class Framer:
    """The frame parser of one remote; it buffers an incomplete frame (280 bytes at most)."""

    def __init__(self) -> None:
        self._rest = b""
        self._step_at = 0  # offset in the rest at which the next frame should begin

    def feed(self, data: bytes) -> list[bytes]:
        """The frames completed by ``data``, in order. For streams: TCP, serial lines."""
        return self._scan(self._rest + data, all_is_here=False)

    def feed_datagram(self, data: bytes) -> list[bytes]:
        """As ``feed``, but a datagram that begins with a whole frame ends an incomplete one.

        The rest of an incomplete frame may be in a lost datagram; waiting for its full length would
        delay the frames after it.
        """
        before: list[bytes] = []
        if self._rest and data[:1] in (STARTS[:1], STARTS[1:]) and frame_length(data, 0, True):
            before = self._scan(self._rest, all_is_here=True)
        if not self._rest:
            self._step_at = 0
        return before + self.feed(data)

    def _scan(self, data: bytes, all_is_here: bool) -> list[bytes]:
        frames, at, self._step_at = _scan(data, self._step_at, all_is_here)
        self._rest = data[at:]
        return frames


def frames_of(data: bytes) -> list[bytes]:
    """The whole frames in complete data, such as a datagram."""
    if data and data[0] == V2 and frame_length(data, 0, True) == len(data):  # as most are
        return [data]
    return _scan(data, 0, all_is_here=True)[0]


def _scan(data: bytes, step_at: int, all_is_here: bool) -> tuple[list[bytes], int, int]:
    """The frames, the offset of the bytes to keep, and the next frame's offset within those."""
    frames: list[bytes] = []
    at = 0
    while (start := _START.search(data, at)) is not None:
        at = start.start()
        length = frame_length(data, at, at == step_at)
        if length is None and not all_is_here:
            break
        if length:
            frames.append(data[at : at + length])
            step_at = at + length
        # A frame with an unknown checksum may be noise around valid frames: search inside it too.
        at = step_at if length and message_id_of(frames[-1]) in _KNOWN else at + 1
    else:
        at = len(data)
    return frames, at, step_at - at


def message_id_of(frame: bytes) -> int:
    """The message id of a frame."""
    if frame[0] == V2:
        return frame[7] | frame[8] << 8 | frame[9] << 16
    return frame[5]


def source_of(frame: bytes) -> tuple[int, int]:
    """Source system and component of a frame."""
    return (frame[5], frame[6]) if frame[0] == V2 else (frame[3], frame[4])


def payload_of(frame: bytes) -> bytes:
    """A frame's payload; MAVLink 2 omits trailing zeros."""
    header = 10 if frame[0] == V2 else 6
    return frame[header : header + frame[1]]


@cache
def field_at(message_id: int, name: str) -> int | None:
    """The offset of a field in a message's payload; None if the message has no such field."""
    known = mavlink.mavlink_map.get(message_id)
    if known is None or name not in known.ordered_fieldnames:
        return None
    formats = re.findall(r"\d*[a-zA-Z]", known.unpacker.format)
    before = formats[: known.ordered_fieldnames.index(name)]
    return struct.calcsize("<" + "".join(before))


def target_system_of(frame: bytes) -> int:
    """The target system of a frame; 0 (all) also for a message without a target."""
    at = field_at(message_id_of(frame), "target_system")
    payload = payload_of(frame)
    return payload[at] if at is not None and at < len(payload) else 0


def is_known(message_id: int) -> bool:
    """Whether the dialect has this message."""
    return message_id in _KNOWN


def checksum(data: bytes, message_id: int) -> int:
    """The X.25 checksum of a known message's frame, without its start marker and checksum."""
    return mcrf4xx(_KNOWN[message_id][1], mcrf4xx(data))


def frame_length(data: bytes, at: int, in_step: bool) -> int | None:
    """Length of the frame at ``at``; 0 if none begins there, None if more bytes are needed."""
    have = len(data) - at
    marker = data[at]
    header = 10 if marker == V2 else 6
    if have < 3:
        return None
    payload = data[at + 1]
    end = header + payload  # of the bytes covered by the checksum
    length = end + 2
    if header == 10:
        flags = data[at + 2]
        if flags & ~SIGNED:
            return 0
        length += SIGNATURE_BYTES if flags else 0
    if have < header:
        return None
    message_id = message_id_of(data[at : at + header])
    known = _KNOWN.get(message_id)
    if known is not None and header == 6 and payload > known[0]:
        return 0  # MAVLink 1 has no longer variants; saves most checksums of noise
    if have < length:
        return None
    if known is None:  # another dialect, checksum unknown: accepted only right after a frame
        return length if in_step and (have == length or data[at + length] in STARTS) else 0
    crc = checksum(data[at + 1 : at + end], message_id)
    return length if crc == data[at + end] | data[at + end + 1] << 8 else 0
