"""Keeps the last state of each aircraft near the vehicles, from all sources. Pure.

Only aircraft inside ``region`` are kept, so that a feed for a whole country costs little: decoders
check a position against the region before decoding the rest of a report. An aircraft is identified
by its 24-bit ICAO address, so that several sources contribute to one track. The position is taken
from one source until this source has been silent for ``SOURCE_S``. An aircraft is reported after
two consistent positions, and a position too far from the last one is not used.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from mission_service.events import AircraftState
from mission_service.ground_distance import M_PER_DEG, M_PER_FT, M_PER_NMI, offset_m

MAX_AIRCRAFT = 5000
MAX_REPORTED = 50  # per vehicle; the nearest aircraft
MAX_AGE_S = 20.0  # of a position; older positions are not extrapolated
SOURCE_S = 3.0
SLACK_M = 1000.0  # errors of positions and of their times
MAX_JUMPS = 3  # consecutive positions that contradict a track before it is restarted
MAX_SPEED_M_S, MAX_CLIMB_M_S = 700.0, 150.0
MIN_ALTITUDE_M, MAX_ALTITUDE_M = -500.0, 30_000.0
MAX_CALLSIGN = 20
STANDARD_HPA = 1013.25
M_S_PER_KNOT, M_S_PER_FPM = M_PER_NMI / 3600.0, M_PER_FT / 60.0


class AircraftDecoder(Protocol):
    """A decoder of one source's format, which updates an ``AircraftTable``."""

    problem: str
    """Why no message is used at present, in words; otherwise ""."""

    @property
    def rejected(self) -> int:
        """The number of messages that were damaged or implausible."""

    def decode(self, data: bytes, at_us: int, unix_us: int | None = None) -> None:
        """Process received bytes; an incomplete last message is completed by the next bytes.

        ``at_us`` is mission time. ``unix_us`` is the wall clock; ``CotTrackDecoder`` computes the
        age of a position from it. Without it, a position has the time of reception.
        """


class Region(NamedTuple):
    """The box in degrees in which aircraft are kept; it does not cross the antimeridian."""

    south_deg: float
    west_deg: float
    north_deg: float
    east_deg: float

    def encloses(self, lat_deg: float, lon_deg: float) -> bool:
        """Return whether a position is inside; False for NaN values."""
        return (
            self.south_deg <= lat_deg <= self.north_deg
            and self.west_deg <= lon_deg <= self.east_deg
        )


NOWHERE = Region(1.0, 1.0, 0.0, 0.0)


@dataclass(slots=True)
class Track:
    """The last state of one aircraft; the velocity is 0 until it is received."""

    source: str
    at_us: int  # mission time of the position
    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    north_m_s: float = 0.0
    east_m_s: float = 0.0
    climb_m_s: float = 0.0
    callsign: str = ""
    confirmed: bool = False  # by a second position
    jumps: int = 0  # consecutive positions that contradicted the track

    def agrees(self, lat_deg: float, lon_deg: float, at_us: int) -> bool:
        """Return whether an aircraft could have flown from the last position to this one."""
        reach_m = SLACK_M + MAX_SPEED_M_S * max(at_us - self.at_us, 0) / 1e6
        north_m, east_m = offset_m((self.lat_deg, self.lon_deg), (lat_deg, lon_deg))
        return abs(north_m) <= reach_m and abs(east_m) <= reach_m


class OwnPosition(NamedTuple):
    """The position of a vehicle of this run."""

    vehicle: str
    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float


def pressure_offset_m(qnh_hpa: float) -> float:
    """Return the altitude above sea level of pressure altitude 0 in the ICAO atmosphere.

    ``qnh_hpa`` is the pressure reduced to sea level. Source: ICAO Doc 7488.
    """
    return float(44_330.77 * ((qnh_hpa / STANDARD_HPA) ** 0.190263 - 1.0))


def callsign_of(text: str) -> str:
    """Return a callsign as one short line of printable characters without surrounding blanks."""
    return "".join(each for each in text if each.isprintable()).strip()[:MAX_CALLSIGN]


class AircraftTable:
    """The tracks of aircraft in ``region``, by identifier."""

    def __init__(self, range_m: float, qnh_hpa: float, ignored: Iterable[str] = ()) -> None:
        """Keep aircraft within ``range_m`` of a vehicle, except those in ``ignored``.

        Pressure altitudes are corrected using the sea-level pressure ``qnh_hpa``.
        """
        self.tracks: dict[str, Track] = {}
        self.region = NOWHERE
        self.pressure_offset_m = pressure_offset_m(qnh_hpa)
        self._range_m = range_m
        self._ignored = frozenset(each.lower() for each in ignored)

    def update_region(self, own: Iterable[OwnPosition]) -> None:
        """Set the region to the surroundings of the vehicles; without positions it is empty."""
        places = [(each.lat_deg, each.lon_deg) for each in own]
        if not places:
            self.region = NOWHERE
            return
        lats, lons = zip(*places, strict=True)
        lat_deg = self._range_m / M_PER_DEG
        lon_deg = lat_deg / max(math.cos(math.radians(max(map(abs, lats)))), 0.01)
        self.region = Region(
            min(lats) - lat_deg, min(lons) - lon_deg, max(lats) + lat_deg, max(lons) + lon_deg
        )

    def place(
        self,
        key: str,
        source: str,
        at_us: int,
        position: tuple[float, float, float],
    ) -> Track | None:
        """Set the position (lat_deg, lon_deg, altitude_amsl_m) of an aircraft.

        Returns the track, whose velocity and callsign the decoder may set. Returns None if the
        position is not used because it is outside the region, implausible or too far from the last
        one, because the aircraft is ignored, or because another source reports it.
        """
        lat_deg, lon_deg, altitude_m = position
        if not self.region.encloses(lat_deg, lon_deg):
            self.tracks.pop(key, None)
            return None
        if key in self._ignored or not MIN_ALTITUDE_M <= altitude_m <= MAX_ALTITUDE_M:
            return None
        track = self.tracks.get(key)
        if track is None:
            if len(self.tracks) >= MAX_AIRCRAFT:
                return None
            track = self.tracks[key] = Track(source, at_us, lat_deg, lon_deg, altitude_m)
            return track
        if track.source != source:
            if at_us - track.at_us < 1e6 * SOURCE_S:
                return None
            track.source = source
        if track.agrees(lat_deg, lon_deg, at_us):
            track.confirmed, track.jumps = True, 0
        elif track.confirmed and track.jumps < MAX_JUMPS:
            track.jumps += 1
            return None
        else:
            track.confirmed, track.jumps = False, 0
        track.at_us, track.lat_deg, track.lon_deg = at_us, lat_deg, lon_deg
        track.altitude_amsl_m = altitude_m
        return track

    def track_of(self, key: str, source: str) -> Track | None:
        """Return the track of an aircraft if its positions come from this source."""
        track = self.tracks.get(key)
        return track if track is not None and track.source == source else None

    def remove(self, key: str) -> None:
        """Remove an aircraft that is on the ground."""
        self.tracks.pop(key, None)

    def expire(self, at_us: int) -> None:
        """Remove the aircraft whose positions are too old."""
        limit_us = at_us - round(1e6 * MAX_AGE_S)
        for key in [key for key, track in self.tracks.items() if track.at_us < limit_us]:
            del self.tracks[key]

    def near(self, own: OwnPosition, at_us: int) -> tuple[AircraftState, ...]:
        """Return the nearest aircraft within range of a vehicle, extrapolated to ``at_us``.

        They are sorted by identifier.
        """
        lat_deg = self._range_m / M_PER_DEG
        found = []
        for key, track in self.tracks.items():
            if track.confirmed and abs(track.lat_deg - own.lat_deg) <= lat_deg:
                age_s = max(at_us - track.at_us, 0) / 1e6
                north_m, east_m = offset_m(
                    (own.lat_deg, own.lon_deg), (track.lat_deg, track.lon_deg)
                )
                north_m, east_m = north_m + age_s * track.north_m_s, east_m + age_s * track.east_m_s
                apart_m = math.hypot(north_m, east_m)
                if apart_m <= self._range_m:
                    found.append((apart_m, key, age_s, track))
        found.sort(key=lambda each: each[:2])
        nearest = sorted(found[:MAX_REPORTED], key=lambda each: each[1])
        return tuple(_state(key, age_s, track) for _, key, age_s, track in nearest)


def set_velocity(track: Track, north_m_s: float, east_m_s: float) -> bool:
    """Set the horizontal velocity; return False for an implausible velocity."""
    if not math.hypot(north_m_s, east_m_s) <= MAX_SPEED_M_S:
        return False
    track.north_m_s, track.east_m_s = north_m_s, east_m_s
    return True


def set_course(track: Track, speed_m_s: float, track_deg: float) -> bool:
    """Set the horizontal velocity from speed and track; return False for implausible values."""
    if not (0.0 <= speed_m_s <= MAX_SPEED_M_S and -360.0 <= track_deg <= 720.0):
        return False
    track_rad = math.radians(track_deg)
    return set_velocity(track, speed_m_s * math.cos(track_rad), speed_m_s * math.sin(track_rad))


def set_climb(track: Track, climb_m_s: float) -> bool:
    """Set the vertical velocity; return False for an implausible velocity."""
    if not abs(climb_m_s) <= MAX_CLIMB_M_S:
        return False
    track.climb_m_s = climb_m_s
    return True


def _state(key: str, age_s: float, track: Track) -> AircraftState:
    lat_deg = track.lat_deg + age_s * track.north_m_s / M_PER_DEG
    lon_scale = M_PER_DEG * max(math.cos(math.radians(track.lat_deg)), 0.01)
    lon_deg = track.lon_deg + age_s * track.east_m_s / lon_scale
    return AircraftState(
        key,
        track.callsign,
        round(min(max(lat_deg, -90.0), 90.0), 6),
        round(min(max(lon_deg, -180.0), 180.0), 6),
        round(track.altitude_amsl_m + age_s * track.climb_m_s, 1),
        round(track.north_m_s, 2),
        round(track.east_m_s, 2),
        round(track.climb_m_s, 2),
        round(age_s, 2),
        track.source,
    )
