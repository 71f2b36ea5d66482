"""What a run leaves to show: tracks, decisions, uploads. Kept in memory, thinned to 1 Hz."""

from collections import Counter
from dataclasses import dataclass, field

from mission_service.commands import Announce, AnyCommand, Decided, UploadMission
from mission_service.events import AnyEvent, Observed, Telemetry, UploadFinished

TRACK_EVERY_US = 1_000_000


@dataclass
class VehicleRecord:
    """One vehicle's run. A track point is (at_us, lat_deg, lon_deg, altitude_amsl_m)."""

    track: list[tuple[int, float, float, float]] = field(default_factory=list)
    reversals: list[tuple[int, float, float]] = field(default_factory=list)
    decisions: int = 0
    direction: str = ""
    uploads: Counter[str] = field(default_factory=Counter)
    upload_reasons: Counter[str] = field(default_factory=Counter)
    here: tuple[int, float, float, float] | None = None


class Record:
    """Folds events and commands into the vehicles' records; ``news`` holds unprinted lines."""

    def __init__(self, names: tuple[str, ...], start_us: int) -> None:
        self.vehicles = {name: VehicleRecord() for name in names}
        self.at_us = start_us
        self.telemetry = 0
        self.observations = 0
        self.news: list[tuple[int, Announce]] = []

    def add(self, event: AnyEvent, commands: list[AnyCommand]) -> None:
        """Take in one event and what it led to."""
        vehicle = self.vehicles[event.vehicle]
        self.at_us = max(self.at_us, event.at_us)
        match event:
            case Telemetry():
                self.telemetry += 1
                here = (event.at_us, event.lat_deg, event.lon_deg, event.altitude_amsl_m)
                vehicle.here = here
                if not vehicle.track or here[0] - vehicle.track[-1][0] >= TRACK_EVERY_US:
                    vehicle.track.append(here)
            case Observed():
                self.observations += 1
            case UploadFinished():
                vehicle.uploads[event.outcome] += 1
            case _:
                pass
        for command in commands:
            self._commanded(vehicle, command)

    def _commanded(self, vehicle: VehicleRecord, command: AnyCommand) -> None:
        match command:
            case Decided():
                vehicle.decisions += 1
                vehicle.direction = command.direction
                if command.reversed and vehicle.here is not None:
                    vehicle.reversals.append(vehicle.here[:3])
            case UploadMission():
                vehicle.upload_reasons[command.why] += 1
            case Announce():
                self.news.append((self.at_us, command))
            case _:
                pass
