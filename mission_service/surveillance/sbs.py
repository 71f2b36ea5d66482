"""Decodes SBS-1 (BaseStation) text, as dump1090 and readsb send on TCP port 30003. Pure.

A line has 22 comma-separated fields. The decoder uses transmission types 1 (callsign), 3 (position
and pressure altitude), 4 (velocity), and 5 to 8 as far as they contain the same fields. Units:
feet, knots, degrees, feet per minute. Source: the port's de facto specification
(http://woodair.net/sbs/article/barebones42_socket_data.htm).
"""

from mission_service.ground_distance import M_PER_FT
from mission_service.surveillance.aircraft_table import (
    M_S_PER_FPM,
    M_S_PER_KNOT,
    AircraftTable,
    callsign_of,
    set_climb,
    set_course,
)
from mission_service.surveillance.delimited_data import complete_parts

MAX_LINE = 300  # bytes; longer data without a line end are discarded
FIELDS = 22
TYPE, ADDRESS, CALLSIGN, ALTITUDE, SPEED, TRACK, LAT, LON, CLIMB = 1, 4, 10, 11, 12, 13, 14, 15, 16
ON_GROUND = 21


class SbsDecoder:
    """The decoder of one connection."""

    problem = ""

    def __init__(self, table: AircraftTable, source: str) -> None:
        """Update ``table`` with the reports of ``source``."""
        self.rejected = 0
        self._table = table
        self._source = source
        self._rest = b""

    def decode(self, data: bytes, at_us: int, unix_us: int | None = None) -> None:
        """Process received bytes; an incomplete last line is completed by the next bytes."""
        lines, self._rest = complete_parts(self._rest + data, b"\n", MAX_LINE)
        line = self._line
        for each in lines:
            if each[:4] == b"MSG,":
                try:
                    line(each, at_us)
                except ValueError:
                    self.rejected += 1

    def _line(self, line: bytes, at_us: int) -> None:
        """Process a line. Raises ValueError for a field of the wrong type."""
        fields = line.decode("ascii").split(",")
        if len(fields) < FIELDS:
            raise ValueError("a line is too short")
        lat, table = fields[LAT], self._table
        key = fields[ADDRESS].lower()
        if not lat:
            track = table.track_of(key, self._source)
            if track is None:
                return
        else:
            place = float(lat), float(fields[LON])
            if not table.region.encloses(*place):
                table.remove(key)
                return
            if fields[ON_GROUND].strip() in ("1", "-1"):
                table.remove(key)
                return
            if not fields[ALTITUDE] or len(key) != 6 or int(key, 16) < 0:
                return
            altitude_m = float(fields[ALTITUDE]) * M_PER_FT + table.pressure_offset_m
            track = table.place(key, self._source, at_us, (*place, altitude_m))
            if track is None:
                return
        if fields[SPEED] and fields[TRACK]:
            speed_m_s = float(fields[SPEED]) * M_S_PER_KNOT
            self.rejected += not set_course(track, speed_m_s, float(fields[TRACK]))
        if fields[CLIMB]:
            self.rejected += not set_climb(track, float(fields[CLIMB]) * M_S_PER_FPM)
        if fields[CALLSIGN]:
            track.callsign = callsign_of(fields[CALLSIGN])
