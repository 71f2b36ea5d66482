"""Decodes Mode S extended squitters (ADS-B and TIS-B, downlink formats 17 and 18). Pure.

Whole batches of messages are decoded with arrays. Airborne positions with a barometric altitude,
ground speeds and callsigns are used. Source: RTCA DO-260B; J. Sun, *The 1090 Megahertz Riddle*, 2nd
ed., chapters 3 to 6 and 9.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission_service.ground_distance import M_PER_FT
from mission_service.surveillance.aircraft_table import (
    M_S_PER_FPM,
    M_S_PER_KNOT,
    AircraftTable,
    callsign_of,
    set_climb,
    set_velocity,
)
from mission_service.surveillance.cpr import global_position, local_positions

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

LENGTH = 14  # bytes in an extended squitter
GENERATOR = 0xFFF409  # of the 24-bit CRC
PAIR_US = 10_000_000  # maximum time between the messages of a pair
MAX_PAIRS = 5000
NEAR_DEG = 0.2  # a position is no farther than this from the last one of its track
LETTERS = "#ABCDEFGHIJKLMNOPQRSTUVWXYZ##### ###############0123456789######"
FORMATS = {17: (0, 1, 2, 3, 4, 5, 6, 7), 18: (0, 1, 2, 5, 6)}  # with their CA or CF values


def _crc_table() -> NDArray[np.uint32]:
    table = []
    for value in range(256):
        crc = value << 16
        for _ in range(8):
            crc = (crc << 1) ^ (GENERATOR if crc & 0x800000 else 0)
        table.append(crc & 0xFFFFFF)
    return np.array(table, dtype=np.uint32)


CRC_TABLE = _crc_table()


def remainders(messages: Bytes) -> NDArray[np.uint32]:
    """Return the CRC of the first 11 bytes of each message (n, 14)."""
    crc = np.zeros(len(messages), dtype=np.uint32)
    for column in messages[:, : LENGTH - 3].T:
        crc = ((crc << np.uint32(8)) & np.uint32(0xFFFFFF)) ^ CRC_TABLE[
            (crc >> np.uint32(16)) ^ column
        ]
    return crc


class _Encoded(NamedTuple):
    """An encoded position and the time of its message."""

    lat: int
    lon: int
    at_us: int


class ModeSDecoder:
    """The decoder of the extended squitters of one source."""

    def __init__(self, table: AircraftTable, source: str) -> None:
        """Update ``table`` with the messages of ``source``."""
        self.rejected = 0
        self._table = table
        self._source = source
        # The last even and odd positions of aircraft that have no track yet.
        self._pairs: dict[int, list[_Encoded | None]] = {}

    def decode_squitters(self, messages: Iterable[bytes], at_us: int) -> None:
        """Process extended squitters of 14 bytes each, all received at about ``at_us``."""
        joined = b"".join(messages)
        if not joined:
            return
        rows = np.frombuffer(joined, dtype=np.uint8).reshape(-1, LENGTH)
        first = rows[:, 0]
        known = np.zeros(len(rows), dtype=bool)
        for number, subtypes in FORMATS.items():
            known |= (first >> 3 == number) & np.isin(first & 7, subtypes)
        wide = rows.astype(np.int64)
        parity = (wide[:, 11] << 16) | (wide[:, 12] << 8) | wide[:, 13]
        intact = remainders(rows) == parity
        self.rejected += int(np.count_nonzero(known & ~intact))
        wide = wide[known & intact]
        address = (wide[:, 1] << 16) | (wide[:, 2] << 8) | wide[:, 3]
        kind = wide[:, 4] >> 3
        is_place = (kind >= 9) & (kind <= 18)
        self._positions(wide[is_place], address[is_place], at_us)
        is_velocity = (kind == 19) & ((wide[:, 4] & 7) <= 2)
        self._velocities(wide[is_velocity], address[is_velocity])
        is_name = (kind >= 1) & (kind <= 4)
        self._callsigns(wide[is_name], address[is_name])

    def _positions(self, rows: Integers, addresses: Integers, at_us: int) -> None:
        region = self._table.region
        if not len(rows) or region.south_deg > region.north_deg:
            return
        height = (rows[:, 5] << 4) | (rows[:, 6] >> 4)
        odd = (rows[:, 6] >> 2 & 1).astype(bool)
        lat = ((rows[:, 6] & 3) << 15) | (rows[:, 7] << 7) | (rows[:, 8] >> 1)
        lon = ((rows[:, 8] & 1) << 16) | (rows[:, 9] << 8) | rows[:, 10]
        in_feet = (height >> 4 & 1).astype(bool)  # otherwise in units of 100 feet, in Gray code
        altitude_m = (((height >> 5 << 4) | (height & 15)) * 25 - 1000) * M_PER_FT
        altitude_m = altitude_m + self._table.pressure_offset_m
        centre = (
            (region.south_deg + region.north_deg) / 2.0,
            (region.west_deg + region.east_deg) / 2.0,
        )
        # This is the position of an aircraft inside the region; one far away may give the same
        # result.
        found_lat, found_lon = local_positions(centre, lat.astype(float), lon.astype(float), odd)
        inside = (
            (found_lat >= region.south_deg)
            & (found_lat <= region.north_deg)
            & (found_lon >= region.west_deg)
            & (found_lon <= region.east_deg)
        )
        usable = in_feet & inside
        columns = (addresses, odd, lat, lon, found_lat, found_lon, altitude_m)
        rows_used = zip(*(column[usable].tolist() for column in columns), strict=True)
        for address, is_odd, lat_cpr, lon_cpr, *place in rows_used:
            encoded = _Encoded(lat_cpr, lon_cpr, at_us)
            self._position(address, is_odd, encoded, (place[0], place[1], place[2]))
        if self._table.tracks:
            for address in addresses[~inside].tolist():
                self._table.remove(f"{address:06x}")

    def _position(
        self,
        address: int,
        odd: bool,
        encoded: _Encoded,
        place: tuple[float, float, float],
    ) -> None:
        """Use a position if a pair of messages, or the aircraft's track, confirms it."""
        key = f"{address:06x}"
        track = self._table.track_of(key, self._source)
        if track is None:
            pair = self._pairs.setdefault(address, [None, None])
            pair[odd] = encoded
            if not self._is_confirmed(pair, odd, place):
                return
            del self._pairs[address]
        elif max(abs(track.lat_deg - place[0]), abs(track.lon_deg - place[1])) > NEAR_DEG:
            self.rejected += 1
            return
        self._table.place(key, self._source, encoded.at_us, place)

    def _is_confirmed(
        self, pair: list[_Encoded | None], odd: bool, place: tuple[float, float, float]
    ) -> bool:
        even_one, odd_one = pair
        if even_one is None or odd_one is None:
            self._limit_pairs()
            return False
        if abs(even_one.at_us - odd_one.at_us) > PAIR_US:
            return False
        found = global_position(even_one[:2], odd_one[:2], odd)
        return found is not None and (
            max(abs(found[0] - place[0]), abs(found[1] - place[1])) <= NEAR_DEG
        )

    def _limit_pairs(self) -> None:
        if len(self._pairs) > MAX_PAIRS:
            del self._pairs[next(iter(self._pairs))]

    def _velocities(self, rows: Integers, addresses: Integers) -> None:
        """Apply ground speeds (subtypes 1 and 2, the latter in units of 4 knots)."""
        if not len(rows) or not self._table.tracks:
            return
        unit = np.where((rows[:, 4] & 7) == 2, 4, 1)
        east = ((rows[:, 5] & 3) << 8) | rows[:, 6]
        north = ((rows[:, 7] & 127) << 3) | (rows[:, 8] >> 5)
        climb = ((rows[:, 8] & 7) << 6) | (rows[:, 9] >> 2)
        speeds = [
            np.where(size == 0, math.nan, (size - 1) * scale) * np.where(sign, -1.0, 1.0)
            for size, scale, sign in (
                (east, unit * M_S_PER_KNOT, rows[:, 5] & 4),
                (north, unit * M_S_PER_KNOT, rows[:, 7] & 128),
                (climb, 64.0 * M_S_PER_FPM, rows[:, 8] & 8),
            )
        ]
        columns = (addresses, *speeds)
        for address, east_m_s, north_m_s, climb_m_s in zip(
            *(column.tolist() for column in columns), strict=True
        ):
            track = self._table.track_of(f"{address:06x}", self._source)
            if track is not None:
                set_velocity(track, north_m_s, east_m_s)
                set_climb(track, climb_m_s)

    def _callsigns(self, rows: Integers, addresses: Integers) -> None:
        for row, address in zip(rows.tolist(), addresses.tolist(), strict=True):
            track = self._table.track_of(f"{address:06x}", self._source)
            if track is not None:
                bits = int.from_bytes(bytes(row[5:11]))
                letters = (LETTERS[bits >> shift & 63] for shift in range(42, -1, -6))
                track.callsign = callsign_of("".join(letters).replace("#", ""))
