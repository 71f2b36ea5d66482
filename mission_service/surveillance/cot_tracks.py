"""Decodes air tracks among Cursor on Target events (XML), received by UDP or TCP. Pure.

An air track is an event with the type ``a-*-A…``. The decoder uses ``point`` (``lat``, ``lon``,
``hae``) and ``detail/track`` (``course``, ``speed`` in m/s, and ``slope`` in degrees). ``hae`` is
treated as the altitude above mean sea level; an event with an unknown ``hae`` is not used. ``time``
is the time of the position, and the event is not used more than 5 s after ``stale``. A uid of the
form ``ICAO-…`` or ``ICAO…`` contains an aircraft's address. Source: MITRE, *Cursor-on-Target
Message Router User's Guide*, base event 2.0.
"""

import math
import re
from datetime import UTC, datetime
from xml.etree import ElementTree

from mission_service.surveillance.aircraft_table import (
    MAX_AGE_S,
    AircraftTable,
    Track,
    callsign_of,
    set_climb,
    set_course,
)
from mission_service.surveillance.delimited_data import complete_parts

END = b"</event>"
MAX_EVENT = 65_535  # bytes; longer data are discarded
MAX_UID = 64
UNKNOWN_M = 9_999_999.0
MAX_SLOPE_DEG = 60.0
CLOCKS_US = 5_000_000  # tolerated difference between the clocks of the sender and the service
STALE_ONLY_US = 5_000_000  # events that are all stale for this time are a problem
_AIR_TRACK = re.compile(rb"""\stype\s*=\s*["']a-[^"'-]+-A""")
_WINTAK_TIME = re.compile(r"(T\d\d:\d\d:\d\d):(\d{1,6}Z?)$")  # a colon instead of a decimal point
_ICAO = re.compile(r"icao[-_. ]?([0-9a-f]{6})", re.IGNORECASE)


class CotTrackDecoder:
    """The decoder of one source."""

    def __init__(self, table: AircraftTable, source: str) -> None:
        """Update ``table`` with the events of ``source``."""
        self.rejected = 0
        self.problem = ""
        self._used_at_us: int | None = None  # mission time at which an event was used last
        self._table = table
        self._source = source
        self._rest = b""

    def decode(self, data: bytes, at_us: int, unix_us: int | None = None) -> None:
        """Process received bytes; an incomplete last event is completed by the next bytes.

        ``unix_us`` is the wall clock; without it, the times in events are not used.
        """
        events, self._rest = complete_parts(self._rest + data, END, MAX_EVENT)
        for event in events:
            begin = event.rfind(b"<event")
            if begin >= 0 and _AIR_TRACK.search(event, begin):
                try:
                    self._event(event[begin:] + END, at_us, unix_us)
                except (ElementTree.ParseError, ValueError):
                    self.rejected += 1

    def _event(self, text: bytes, at_us: int, unix_us: int | None) -> None:
        """Process an event. Raises ParseError or ValueError if it cannot be read or is stale."""
        root = ElementTree.fromstring(text)  # without a DOCTYPE, which precedes the element
        point = root.find("point")
        if point is None:
            raise ValueError("an event has no point")
        place = float(point.get("lat", "")), float(point.get("lon", ""))
        key = _key_of(root.get("uid", ""))
        if unix_us is not None:
            age_us = max(unix_us - unix_us_of(root.get("time", "")), 0)
            stale_us = unix_us_of(root.get("stale", "")) + CLOCKS_US
            if unix_us > stale_us or age_us > 1e6 * MAX_AGE_S:
                self._report_stale(age_us, at_us)
                raise ValueError("an event is stale")
            self._used_at_us, self.problem = at_us, ""
            at_us -= age_us
        known = self._table.track_of(key, self._source)
        if known is not None and known.at_us > at_us:
            return
        if not self._table.region.encloses(*place):
            self._table.remove(key)
            return
        altitude_m = float(point.get("hae", UNKNOWN_M))
        track = self._table.place(key, self._source, at_us, (*place, altitude_m))
        if track is None:
            return
        detail = root.find("detail")
        if detail is not None:
            self._detail(detail, track)

    def _report_stale(self, age_us: int, at_us: int) -> None:
        """Describe the problem of an event that is not used, unless a recent event was used."""
        if self._used_at_us is None or at_us - self._used_at_us > STALE_ONLY_US:
            self.problem = (
                f"its events are {age_us / 1e6:.0f} s old and are not used; compare the clocks of "
                "the sender and of this computer"
            )

    def _detail(self, detail: ElementTree.Element, track: Track) -> None:
        contact, motion = detail.find("contact"), detail.find("track")
        if contact is not None:
            track.callsign = callsign_of(contact.get("callsign", ""))
        if motion is not None:
            speed_m_s = float(motion.get("speed", "0"))
            self.rejected += not set_course(track, speed_m_s, float(motion.get("course", "0")))
            slope_deg = float(motion.get("slope", "0"))
            if abs(slope_deg) <= MAX_SLOPE_DEG:
                set_climb(track, speed_m_s * math.tan(math.radians(slope_deg)))


def unix_us_of(text: str) -> int:
    """Return the time of an event, such as 2026-11-22T00:30:00.000Z, in microseconds since 1970.

    Raises ValueError for an unknown format.
    """
    found = datetime.fromisoformat(_WINTAK_TIME.sub(r"\1.\2", text))
    if found.tzinfo is None:
        found = found.replace(tzinfo=UTC)
    try:
        return round(found.timestamp() * 1e6)
    except OverflowError as error:  # a time zone before the year 1
        raise ValueError(str(error)) from None


def _key_of(uid: str) -> str:
    """Return the identifier in a uid. Raises ValueError if the uid is unusable."""
    found = _ICAO.search(uid)
    if found is not None:
        return found[1].lower()
    if not uid or len(uid) > MAX_UID or not uid.isprintable():
        raise ValueError("an event has no usable uid")
    return f"cot:{uid}"
