"""Splits the byte stream from one remote into complete MAVLink frames, and skips noise.

After a false start marker, pymavlink's parser discards as many bytes as the false header states,
including valid frames. This parser consumes the bytes of a frame only if the checksum is correct;
otherwise the parser skips one byte and searches again. A frame is therefore lost only if noise
before it has a correct checksum by chance (1 in 65536). On a stream, bytes after a false start
marker are buffered until as many bytes have arrived as the false header states, at most 280.
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
# The longest payload and the CRC extra byte of each message in the dialect.
_DIALECT = {
    message_id: (message_class.unpacker.size, bytes((message_class.crc_extra,)))
    for message_id, message_class in mavlink.mavlink_map.items()
}


class Framer:
    """The frame parser of one remote, which buffers an incomplete frame (at most 280 bytes)."""

    def __init__(self) -> None:
        self._rest = b""
        self._next_at = 0  # offset in ``_rest`` at which the next frame should begin

    def feed(self, data: bytes) -> list[bytes]:
        """Return the frames that ``data`` completes, in order; for streams (TCP, serial lines)."""
        return self._scan(self._rest + data, complete=False)

    def feed_datagram(self, data: bytes) -> list[bytes]:
        """Return completed frames; a datagram that begins with a frame ends an incomplete frame.

        The rest of the incomplete frame may have been in a lost datagram. Waiting for the frame's
        full length would delay later frames.
        """
        before: list[bytes] = []
        if self._rest and data[:1] in (STARTS[:1], STARTS[1:]) and frame_length(data, 0, True):
            before = self._scan(self._rest, complete=True)
        if not self._rest:
            self._next_at = 0
        return before + self.feed(data)

    def _scan(self, data: bytes, complete: bool) -> list[bytes]:
        frames, at, self._next_at = _scan(data, self._next_at, complete)
        self._rest = data[at:]
        return frames


def frames_of(data: bytes) -> list[bytes]:
    """Return the frames in complete data, such as a datagram."""
    if data and data[0] == V2 and frame_length(data, 0, True) == len(data):  # the usual case
        return [data]
    return _scan(data, 0, complete=True)[0]


def _scan(data: bytes, next_at: int, complete: bool) -> tuple[list[bytes], int, int]:
    """Return the frames, the offset of the rest, and the next frame's offset in the rest."""
    frames: list[bytes] = []
    at = 0
    while (start := _START.search(data, at)) is not None:
        at = start.start()
        length = frame_length(data, at, at == next_at)
        if length is None and not complete:
            break
        if length:
            frames.append(data[at : at + length])
            next_at = at + length
        # A frame whose checksum is unknown may be noise around valid frames, so search inside it
        # too.
        at = next_at if length and message_id_of(frames[-1]) in _DIALECT else at + 1
    else:
        at = len(data)
    return frames, at, next_at - at


def message_id_of(data: bytes, at: int = 0) -> int:
    """Return the message id of the frame that begins at an offset in ``data``."""
    if data[at] == V2:
        return data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
    return data[at + 5]


def source_of(frame: bytes) -> tuple[int, int]:
    """Return the source system and component of a frame."""
    return (frame[5], frame[6]) if frame[0] == V2 else (frame[3], frame[4])


def payload_of(frame: bytes) -> bytes:
    """Return the payload of a frame; MAVLink 2 omits trailing zeros."""
    header = 10 if frame[0] == V2 else 6
    return frame[header : header + frame[1]]


@cache
def field_at(message_id: int, name: str) -> int | None:
    """Return the offset of a field in the payload; None if the message has no such field."""
    message_class = mavlink.mavlink_map.get(message_id)
    if message_class is None or name not in message_class.ordered_fieldnames:
        return None
    formats = re.findall(r"\d*[a-zA-Z]", message_class.unpacker.format)
    before = formats[: message_class.ordered_fieldnames.index(name)]
    return struct.calcsize("<" + "".join(before))


def target_system_of(frame: bytes) -> int:
    """Return the target system of a frame; 0 means all systems or a message without a target."""
    at = field_at(message_id_of(frame), "target_system")
    payload = payload_of(frame)
    return payload[at] if at is not None and at < len(payload) else 0


def in_dialect(message_id: int) -> bool:
    """Return whether the dialect has this message."""
    return message_id in _DIALECT


def checksum(data: bytes, message_id: int) -> int:
    """Return a frame's X.25 checksum; ``data`` is the frame from the length byte to the payload."""
    return mcrf4xx(_DIALECT[message_id][1], mcrf4xx(data))


def frame_length(data: bytes, at: int, in_step: bool) -> int | None:
    """Return the length of the frame at ``at``; 0 if there is none, None if bytes are missing."""
    have = len(data) - at
    marker = data[at]
    header = 10 if marker == V2 else 6
    if have < 3:
        return None
    payload = data[at + 1]
    end = header + payload  # end of the bytes that the checksum covers
    length = end + 2
    if header == 10:
        flags = data[at + 2]
        if flags & ~SIGNED:
            return 0
        length += SIGNATURE_BYTES if flags else 0
    if have < header:
        return None
    message_id = message_id_of(data, at)
    definition = _DIALECT.get(message_id)
    if definition is not None and header == 6 and payload > definition[0]:
        return 0  # too long for a MAVLink 1 payload: probably noise
    if have < length:
        return None
    if definition is None:  # another dialect, checksum unknown: accepted only right after a frame
        return length if in_step and (have == length or data[at + length] in STARTS) else 0
    crc = checksum(data[at + 1 : at + end], message_id)
    return length if crc == data[at + end] | data[at + end + 1] << 8 else 0
