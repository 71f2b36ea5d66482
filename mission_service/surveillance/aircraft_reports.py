"""Generates events about other aircraft once a second, from all sources' reports. Pure."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Protocol

from autopilot_bridge.vehicle.aircraft_seen import AircraftSeen
from mission_service.config.surveillance_section import AircraftSource, SurveillanceSection
from mission_service.events import AircraftReported
from mission_service.surveillance.adsb_vehicle import apply_seen
from mission_service.surveillance.aircraft_table import AircraftDecoder, AircraftTable, OwnPosition
from mission_service.surveillance.beast import BeastDecoder
from mission_service.surveillance.cot_tracks import CotTrackDecoder
from mission_service.surveillance.gdl90 import Gdl90Decoder
from mission_service.surveillance.sbs import SbsDecoder

EVERY_US = 1_000_000
FRESH_US = 5_000_000  # a vehicle with an older position is not compared
DECODERS: dict[str, Callable[[AircraftTable, str], AircraftDecoder]] = {
    "sbs": SbsDecoder,
    "beast": BeastDecoder,
    "gdl90": Gdl90Decoder,
    "cot": CotTrackDecoder,
}


class _Fix(Protocol):
    @property
    def at_us(self) -> int: ...
    @property
    def lat_deg(self) -> float: ...
    @property
    def lon_deg(self) -> float: ...
    @property
    def altitude_amsl_m(self) -> float: ...


class AircraftReports:
    """The aircraft near the vehicles of a run; without a table [surveillance] there are none."""

    def __init__(self, section: SurveillanceSection | None) -> None:
        self.section = section
        used = section or SurveillanceSection()
        self.table = AircraftTable(used.range_m, used.qnh_hpa, used.ignored)
        self._due_us = -(2**63)
        # By vehicle: ``own_position_unknown`` of its last event, if that contains no aircraft.
        # Any run, even a resumed one, begins with an event for each vehicle, which ends the alerts
        # of an interrupted run.
        self._empty: dict[str, bool] = {}

    def decoder(self, source: AircraftSource) -> AircraftDecoder:
        """Return a new decoder for a connection to a source."""
        return DECODERS[source.format](self.table, source.label)

    def take_seen(self, vehicle: str, seen: deque[AircraftSeen], at_us: int) -> None:
        """Remove and apply the reports of a vehicle's ADS-B receiver; ``at_us``: mission time."""
        while seen:
            apply_seen(self.table, vehicle, seen.popleft(), at_us)

    def events_due(self, fixes: Mapping[str, _Fix], at_us: int) -> Iterator[AircraftReported]:
        """Yield the events due at the given mission time: at most one per vehicle and second.

        Args:
            fixes: The last positions of the vehicles, by name.
            at_us: The mission time.
        """
        if self.section is None or at_us < self._due_us:
            return
        self._due_us = at_us + EVERY_US
        own = {
            name: OwnPosition(name, fix.lat_deg, fix.lon_deg, fix.altitude_amsl_m)
            for name, fix in fixes.items()
        }
        self.table.update_region(own.values())
        self.table.expire(at_us)
        for name, fix in fixes.items():
            unknown = at_us - fix.at_us > FRESH_US
            aircraft = () if unknown else self.table.near(own[name], at_us)
            if aircraft:
                self._empty.pop(name, None)
            elif self._empty.get(name) is unknown:
                continue
            else:
                self._empty[name] = unknown
            yield AircraftReported(at_us, name, aircraft, unknown)
