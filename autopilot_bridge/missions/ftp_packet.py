"""Packs and unpacks the payload of FILE_TRANSFER_PROTOCOL (mavlink.io/en/services/ftp.html)."""

import struct
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message

_HEAD = struct.Struct("<H5BxI")
_PAYLOAD_BYTES = 251
MAX_DATA_BYTES = _PAYLOAD_BYTES - _HEAD.size  # 239

TERMINATE, RESET, OPEN_TO_READ, READ, CREATE, WRITE = 1, 2, 4, 5, 6, 7
BURST_READ = 15
ACK, NAK = 128, 129
FAIL, FAIL_ERRNO, INVALID_SIZE, INVALID_SESSION, NO_SESSIONS, END_OF_FILE = 1, 2, 3, 4, 5, 6
UNKNOWN_COMMAND, FILE_EXISTS, PROTECTED, NOT_FOUND = 7, 8, 9, 10
ERRORS = {
    FAIL: "it failed",
    FAIL_ERRNO: "its file system failed",
    INVALID_SIZE: "the size of a message is not valid",
    INVALID_SESSION: "another session is open",
    NO_SESSIONS: "all sessions are in use",
    END_OF_FILE: "the offset is beyond the end of the file",
    UNKNOWN_COMMAND: "it does not support the request",
    FILE_EXISTS: "the file exists",
    PROTECTED: "the file is protected",
    NOT_FOUND: "the file does not exist",
}


@dataclass(frozen=True, slots=True)
class Packet:
    """A request or a reply.

    In a reply, ``asked`` is the opcode of the request. In a read request, ``size`` is the number of
    requested bytes; otherwise ``size`` is the length of ``data``.
    """

    seq: int
    session: int
    opcode: int
    size: int = 0
    asked: int = 0
    offset: int = 0
    data: bytes = b""

    def message(self, target: tuple[int, int]) -> Message:
        """Return the FILE_TRANSFER_PROTOCOL message with this packet."""
        head = _HEAD.pack(
            self.seq, self.session, self.opcode, self.size, self.asked, 0, self.offset
        )
        payload = (head + self.data).ljust(_PAYLOAD_BYTES, b"\0")
        return mavlink.MAVLink_file_transfer_protocol_message(0, *target, list(payload))


def packet_of(message: Message) -> Packet:
    """Return the packet in a FILE_TRANSFER_PROTOCOL message; data beyond ``size`` is cut off."""
    payload = bytes(message.payload)
    seq, session, opcode, size, asked, _, offset = _HEAD.unpack_from(payload)
    return Packet(
        seq, session, opcode, size, asked, offset, payload[_HEAD.size : _HEAD.size + size]
    )


def error_words(packet: Packet) -> str:
    """Describe the error in a NAK."""
    code = packet.data[0] if packet.data else 0
    words = ERRORS.get(code, "it rejected the request")
    errno = f", errno {packet.data[1]}" if code == FAIL_ERRNO and len(packet.data) > 1 else ""
    return f"{words} (FTP error {code}{errno})"
