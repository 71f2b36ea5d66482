"""Decodes the Beast binary format, as dump1090 and readsb send on TCP port 30005. Pure.

A message is 0x1A, a type (1: Mode A/C, 2 bytes; 2: Mode S, 7 bytes; 3: Mode S, 14 bytes), a 6-byte
time, a 1-byte signal level and the message. After the type, a byte 0x1A is sent twice. The times
are those of the receiver's clock and are not used. Source: the Mode-S Beast wiki
(https://wiki.jetvision.de/wiki/Mode-S_Beast:Data_Output_Formats).
"""

import re

from mission_service.surveillance.aircraft_table import AircraftTable
from mission_service.surveillance.mode_s import LENGTH, ModeSDecoder

PREFIX = 7  # bytes for time and signal level
_BYTE = rb"(?:[^\x1a]|\x1a\x1a)"
_MESSAGE = re.compile(
    rb"\x1a(?:3(" + _BYTE + rb"{21})|2" + _BYTE + rb"{14}|1" + _BYTE + rb"{9})", re.DOTALL
)
MAX_MESSAGE = 2 + 2 * (PREFIX + LENGTH)  # bytes, if each one is sent twice


class BeastDecoder:
    """The decoder of one connection."""

    problem = ""

    def __init__(self, table: AircraftTable, source: str) -> None:
        """Update ``table`` with the messages of ``source``."""
        self._squitters = ModeSDecoder(table, source)
        self._rest = b""

    @property
    def rejected(self) -> int:
        """The number of damaged messages."""
        return self._squitters.rejected

    def decode(self, data: bytes, at_us: int, unix_us: int | None = None) -> None:
        """Process received bytes; an incomplete last message is completed by the next bytes."""
        data = self._rest + data
        messages, end = [], 0
        for found in _MESSAGE.finditer(data):
            end = found.end()
            whole = found[1]
            if whole is not None:
                if b"\x1a" in whole:
                    whole = whole.replace(b"\x1a\x1a", b"\x1a")
                messages.append(whole[PREFIX:])
        self._rest = data[end:][-MAX_MESSAGE:]
        self._squitters.decode_squitters(messages, at_us)
