"""Bytes of one remote to whole MAVLink frames, whatever lies between them (sans-IO).

pymavlink's own parser throws away everything a false start of frame claims, good frames
included. Here a frame that fails its checksum costs one byte, and the search goes on behind it.
"""

import re

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_STARTS = bytes((mavlink.PROTOCOL_MARKER_V1, mavlink.PROTOCOL_MARKER_V2))
_START = re.compile(b"[" + re.escape(_STARTS) + b"]")
_SIGNED = mavlink.MAVLINK_IFLAG_SIGNED
_HEADER_BYTES = {mavlink.PROTOCOL_MARKER_V1: 6, mavlink.PROTOCOL_MARKER_V2: 10}


class Framer:
    """The bytes of one remote; what is not whole yet is kept (280 bytes at most)."""

    def __init__(self) -> None:
        self._rest = b""
        self._in_step = True  # what comes next begins a frame, if nothing is wrong

    def feed(self, data: bytes) -> list[bytes]:
        """The frames that are whole now, in order. For streams: TCP, serial lines."""
        return self._scan(self._rest + data, all_is_here=False)

    def feed_datagram(self, data: bytes) -> list[bytes]:
        """As ``feed``, but a datagram that begins with a whole frame ends a torn one before it.

        Datagrams get lost, so the rest of a torn frame may never come; waiting for its length
        to fill up would hold back the frames behind it.
        """
        before: list[bytes] = []
        if self._rest and data[:1] in (_STARTS[:1], _STARTS[1:]) and _frame_length(data, 0, True):
            before = self._scan(self._rest, all_is_here=True)
        if not self._rest:
            self._in_step = True
        return before + self.feed(data)

    def _scan(self, data: bytes, all_is_here: bool) -> list[bytes]:
        frames: list[bytes] = []
        at = 0
        self._rest = b""
        while (start := _START.search(data, at)) is not None:
            self._in_step &= start.start() == at
            at = start.start()
            length = _frame_length(data, at, self._in_step)
            if length is None and not all_is_here:
                self._rest = data[at:]
                return frames
            self._in_step = bool(length)
            if length:
                frames.append(data[at : at + length])
            at += length or 1
        self._in_step &= at == len(data)
        return frames


def _frame_length(data: bytes, at: int, in_step: bool) -> int | None:
    """Length of the frame that starts here; 0 when none does, None when more bytes must tell."""
    have = len(data) - at
    marker = data[at]
    header = _HEADER_BYTES[marker]
    if have < 3:
        return None
    payload = data[at + 1]
    end = header + payload  # of what the checksum covers
    length = end + 2
    if marker == mavlink.PROTOCOL_MARKER_V2:
        flags = data[at + 2]
        if flags & ~_SIGNED:
            return 0
        length += mavlink.MAVLINK_SIGNATURE_BLOCK_LEN if flags & _SIGNED else 0
    if have < header:
        return None
    message_id = int.from_bytes(
        data[at + header - (3 if header == 10 else 1) : at + header], "little"
    )
    known = mavlink.mavlink_map.get(message_id)
    if known is not None and header == 6 and payload > known.unpacker.size:
        return 0  # MAVLink 1 knows no longer variants; saves most checksums of noise
    if have < length:
        return None
    if known is None:  # of another dialect, its checksum unknown: believed between frames only
        return length if in_step and (have == length or data[at + length] in _STARTS) else 0
    checksum = mavlink.x25crc(data[at + 1 : at + end] + bytes((known.crc_extra,))).crc
    return length if checksum == int.from_bytes(data[at + end : at + end + 2], "little") else 0
