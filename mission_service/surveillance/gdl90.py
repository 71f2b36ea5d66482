"""Decodes GDL 90 traffic reports, as sent by ADS-B receivers to UDP port 4000. Pure.

A message is enclosed by 0x7E bytes. In a message, 0x7D is an escape byte: the byte after it is
XORed with 0x20. The last two bytes are a CRC. Source: Garmin, *GDL 90 Data Interface
Specification*, 560-1058-00 Rev A, chapters 2 and 3.5.
"""

import fastcrc

from mission_service.ground_distance import M_PER_FT
from mission_service.surveillance.aircraft_table import (
    M_S_PER_FPM,
    M_S_PER_KNOT,
    AircraftTable,
    callsign_of,
    set_climb,
    set_course,
)

TRAFFIC_REPORT, LENGTH = 20, 28  # message id; length in bytes, including the id
ICAO_ADDRESSES = (0, 2)  # address types: ADS-B or TIS-B with an ICAO address
NO_ALTITUDE, NO_SPEED, NO_CLIMB = 0xFFF, 0xFFF, -2048
AIRBORNE, TRACK_KIND, TRUE_TRACK = 8, 3, 1  # bits of the miscellaneous indicators
DEG_PER_STEP = 180.0 / 2**23


def crc_of(message: bytes) -> int:
    """Return the CRC (CCITT, not augmented) of a message of at least two bytes."""
    return fastcrc.crc16.xmodem(message[:-2]) ^ int.from_bytes(message[-2:])


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> (bits - 1) else value


class Gdl90Decoder:
    """The decoder of one source; datagrams contain whole messages."""

    problem = ""

    def __init__(self, table: AircraftTable, source: str) -> None:
        """Update ``table`` with the reports of ``source``."""
        self.rejected = 0
        self._table = table
        self._source = source

    def decode(self, data: bytes, at_us: int, unix_us: int | None = None) -> None:
        """Process one or more datagrams."""
        for part in data.split(b"\x7e"):
            if not part or part[0] != TRAFFIC_REPORT:  # the id is never escaped
                continue
            message = part
            if b"\x7d" in part:
                message = part.replace(b"\x7d\x5e", b"\x7e").replace(b"\x7d\x5d", b"\x7d")
            body = message[:-2]
            if len(body) != LENGTH or crc_of(body) != int.from_bytes(message[-2:], "little"):
                self.rejected += 1
                continue
            self._traffic(body, at_us)

    def _traffic(self, body: bytes, at_us: int) -> None:
        bits = int.from_bytes(body[5:18])  # latitude to track
        lat_deg = DEG_PER_STEP * _signed(bits >> 80, 24)
        lon_deg = DEG_PER_STEP * _signed(bits >> 56 & 0xFFFFFF, 24)
        key = body[2:5].hex()
        if body[1] & 15 not in ICAO_ADDRESSES:
            key = f"~{key}"
        altitude, flags = bits >> 44 & 0xFFF, bits >> 40 & 15
        if not self._table.region.encloses(lat_deg, lon_deg) or not flags & AIRBORNE:
            self._table.remove(key)
            return
        if altitude == NO_ALTITUDE:
            return
        altitude_m = (25 * altitude - 1000) * M_PER_FT + self._table.pressure_offset_m
        place = (lat_deg, lon_deg, altitude_m)
        track = self._table.place(key, self._source, at_us, place)
        if track is None:
            return
        speed, climb = bits >> 20 & 0xFFF, _signed(bits >> 8 & 0xFFF, 12)
        if speed != NO_SPEED and flags & TRACK_KIND == TRUE_TRACK:
            track_deg = (bits & 0xFF) * 360.0 / 256.0
            self.rejected += not set_course(track, speed * M_S_PER_KNOT, track_deg)
        if climb != NO_CLIMB:
            self.rejected += not set_climb(track, climb * 64.0 * M_S_PER_FPM)
        track.callsign = callsign_of(body[19:27].decode("ascii", "replace"))
