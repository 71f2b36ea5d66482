"""Encoders of messages about other aircraft: SBS, Beast with Mode S, GDL 90, Cursor on Target.

They are independent of the decoders, except that Mode S and GDL 90 share the CRC of the decoders
(tests compare these CRCs with published messages).
"""

import math
from dataclasses import dataclass

import numpy as np

from mission_service.surveillance.cpr import longitude_zones
from mission_service.surveillance.gdl90 import crc_of
from mission_service.surveillance.mode_s import LETTERS, remainders

FT, KNOT, FPM = 0.3048, 1852.0 / 3600.0, 0.3048 / 60.0


@dataclass
class Aircraft:
    """The state of an aircraft; the altitude is a pressure altitude."""

    address: int
    lat_deg: float
    lon_deg: float
    altitude_m: float
    north_m_s: float = 0.0
    east_m_s: float = 0.0
    climb_m_s: float = 0.0
    callsign: str = "N417EA"

    @property
    def speed_m_s(self) -> float:
        return math.hypot(self.north_m_s, self.east_m_s)

    @property
    def track_deg(self) -> float:
        return math.degrees(math.atan2(self.east_m_s, self.north_m_s)) % 360.0


def sbs_lines(craft: Aircraft) -> bytes:
    """Return a position, a velocity and a callsign as BaseStation text."""
    head = f"1,1,{craft.address:06X},1,2026/08/01,12:00:00.000,2026/08/01,12:00:00.000"
    place = f"{craft.lat_deg:.6f},{craft.lon_deg:.6f}"
    speed = f"{craft.speed_m_s / KNOT:.1f},{craft.track_deg:.1f}"
    return (
        f"MSG,3,{head},,{craft.altitude_m / FT:.0f},,,{place},,,0,0,0,0\r\n"
        f"MSG,4,{head},,,{speed},,,{craft.climb_m_s / FPM:.0f},,,,,0\r\n"
        f"MSG,1,{head},{craft.callsign:<8},,,,,,,,,,,0\r\n"
    ).encode()


def _squitter(address: int, message: int) -> bytes:
    """Return an extended squitter (DF 17) with 56 bits of message."""
    body = bytes([17 << 3 | 5]) + address.to_bytes(3) + message.to_bytes(7)
    row = np.frombuffer(body + bytes(3), dtype=np.uint8).reshape(1, 14)
    return body + int(remainders(row)[0]).to_bytes(3)


def position_squitter(craft: Aircraft, odd: bool) -> bytes:
    """Return an airborne position with an altitude in steps of 25 feet."""
    size = 360.0 / (60 - odd)
    lat = math.floor(131_072.0 * ((craft.lat_deg % size) / size) + 0.5)
    coded_deg = size * (lat / 131_072.0 + math.floor(craft.lat_deg / size))
    width = 360.0 / max(longitude_zones(coded_deg) - odd, 1)
    lon = math.floor(131_072.0 * ((craft.lon_deg % width) / width) + 0.5)
    steps = round((craft.altitude_m / FT + 1000.0) / 25.0)
    height = (steps >> 4) << 5 | 1 << 4 | steps & 15
    message = 11 << 51 | height << 36 | odd << 34 | (lat & 131_071) << 17 | lon & 131_071
    return _squitter(craft.address, message)


def _signed(value: float, bits: int) -> int:
    """Return sign and size + 1 of a velocity component."""
    return (value < 0) << bits | min(round(abs(value)) + 1, (1 << bits) - 1)


def velocity_squitter(craft: Aircraft) -> bytes:
    """Return a ground speed (subtype 1)."""
    east = _signed(craft.east_m_s / KNOT, 10)
    north = _signed(craft.north_m_s / KNOT, 10)
    climb = _signed(craft.climb_m_s / FPM / 64.0, 9)
    message = 19 << 51 | 1 << 48 | east << 32 | north << 21 | climb << 10
    return _squitter(craft.address, message)


def callsign_squitter(craft: Aircraft) -> bytes:
    """Return an identification."""
    message = 4 << 51
    for number, letter in enumerate(f"{craft.callsign:<8}"[:8]):
        message |= LETTERS.index(letter) << (42 - 6 * number)
    return _squitter(craft.address, message)


def beast(squitter: bytes, clock: int = 0x1A0042) -> bytes:
    """Return a Beast frame; the time and the level contain the escaped byte 0x1A."""
    content = clock.to_bytes(6) + b"\x1a" + squitter
    return b"\x1a3" + content.replace(b"\x1a", b"\x1a\x1a")


def beast_frames(craft: Aircraft, odd: bool) -> bytes:
    """Return a position and a velocity."""
    return beast(position_squitter(craft, odd)) + beast(velocity_squitter(craft))


def gdl90_report(craft: Aircraft) -> bytes:
    """Return a traffic report, with its flags and escapes."""
    lat, lon = (round(angle * 2**23 / 180.0) & 0xFFFFFF for angle in (craft.lat_deg, craft.lon_deg))
    altitude = round((craft.altitude_m / FT + 1000.0) / 25.0)
    speed = round(craft.speed_m_s / KNOT)
    climb = round(craft.climb_m_s / FPM / 64.0) & 0xFFF
    track = round(craft.track_deg * 256.0 / 360.0) & 0xFF
    bits = lat << 80 | lon << 56 | altitude << 44 | 0b1001 << 40 | 0xAA << 32
    bits |= speed << 20 | climb << 8 | track
    body = b"\x14\x00" + craft.address.to_bytes(3) + bits.to_bytes(13) + b"\x01"
    return gdl90_frame(body + f"{craft.callsign:<8}".encode()[:8] + b"\x00")


def gdl90_frame(body: bytes) -> bytes:
    """Return a message with CRC, escapes and flags."""
    whole = body + crc_of(body).to_bytes(2, "little")
    escaped = whole.replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e")
    return b"\x7e" + escaped + b"\x7e"


def cot_event(craft: Aircraft) -> bytes:
    """Return an air track."""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><event version="2.0" '
        f'uid="ICAO-{craft.address:06X}" type="a-n-A-C-F" how="m-g" '
        f'time="2026-08-01T12:00:00.000Z" start="2026-08-01T12:00:00.000Z" '
        f'stale="2026-08-01T12:00:30.000Z"><point lat="{craft.lat_deg:.6f}" '
        f'lon="{craft.lon_deg:.6f}" hae="{craft.altitude_m:.1f}" ce="50" le="50"/><detail>'
        f'<contact callsign="{craft.callsign}"/><track course="{craft.track_deg:.1f}" '
        f'speed="{craft.speed_m_s:.1f}"/></detail></event>'
    ).encode()
