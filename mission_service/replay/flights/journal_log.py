"""A journal as a log: the events of its vehicles in the form of log entries, on mission time."""

import math
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from autopilot_bridge.items import Items
from autopilot_bridge.logs.entries import Damage, Entry, Log, LogEvent, MissionLoaded
from autopilot_bridge.logs.reading import open_log
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle import client_events as bridge
from mission_service.commands import Announce, AnyCommand, UploadMission
from mission_service.config.scenario import Scenario, parse_scenario
from mission_service.errors import JournalError
from mission_service.events import (
    AnyEvent,
    AnyOperatorEvent,
    BatteryUpdated,
    GpsFixChanged,
    LinkLost,
    LinkRestored,
    MissionProgress,
    ModeChanged,
    OperatorEvent,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.journal.journal_file import begins_journal
from mission_service.journal.segments import Chain
from mission_service.replay.flights.utc_time import unix_us
from mission_service.replay.flights.write_once_journal import REPLAY

SEVERITY = {"warning": 4, "info": 6}  # MAV_SEVERITY
JOURNAL = "journal.jsonl"


class JournalLog:
    """A journal's vehicles, numbered from 1 in the order of its scenario.

    System ids are not used, because vehicles on separate links may have the same one.
    """

    def __init__(self, path: Path) -> None:
        """Raises JournalError if there is no journal, or if it lacks its header."""
        self.path = path
        self.messages = 0
        self.damage: list[Damage] = []
        self._chain = Chain(path)
        header = self._chain.readers[0].header
        self.scenario: Scenario = parse_scenario(header["scenario"], path)
        self.open_loop = bool(header.get(REPLAY))
        self.names = {at: each.name for at, each in enumerate(self.scenario.vehicles, 1)}
        self._numbers = {name: number for number, name in self.names.items()}

    def unix_offset_us(self) -> int | None:
        """Offset to microseconds since 1970 by the scenario's ``time_zero``, if it has one."""
        zero: datetime | None = self.scenario.time_zero
        return None if zero is None else unix_us(zero)

    def entries(self) -> Iterator[Entry]:
        """Yield the vehicles' events as log entries; a mission counts once its upload was accepted.

        In a replay no upload is accepted, so its journal has no missions as entries.
        """
        sent: dict[tuple[str, int], Items] = {}
        at_us = 0
        for thing in self.things():
            if isinstance(thing, UploadMission):
                sent[thing.vehicle, thing.mission_id] = thing.items
            elif isinstance(thing, Announce) and thing.vehicle in self._numbers:
                text = bridge.Text(at_us, SEVERITY[thing.level], thing.text)
                yield Entry(self._numbers[thing.vehicle], text)
            if not isinstance(thing, AnyEvent):
                continue
            at_us = thing.at_us
            if isinstance(thing, OperatorEvent):
                continue
            told = _told(thing)
            if isinstance(thing, UploadFinished):
                items = sent.pop((thing.vehicle, thing.mission_id), None)
                if items is not None and thing.outcome == "accepted" and not self.open_loop:
                    told = MissionLoaded(at_us, items)
            if self.open_loop and isinstance(told, bridge.MissionProgress):
                continue
            if told is not None:
                yield Entry(self._numbers[thing.vehicle], told)

    def things(self) -> Iterator[AnyEvent | AnyCommand]:
        """Events and commands in order; damaged lines are left out and noted in ``damage``."""
        self.messages, self.damage = 0, []
        for reader in self._chain.readers:
            at_byte = reader.begin.at_byte
            try:
                for number, body, intact in reader.lines(reader.begin):
                    self.messages += 1
                    if intact:
                        yield reader.entry(number, body, intact).content
                    else:
                        why = f"{reader.path.name}, line {number}: its checksum does not match"
                        self.damage.append(Damage(at_byte, reader.rest.at_byte - at_byte, why))
                    at_byte = reader.rest.at_byte
            except JournalError as error:  # behind its end, or of an unknown kind
                self._rest_is_damaged(reader.path, at_byte, str(error))
            if reader.cut_at_line is not None:
                self._rest_is_damaged(reader.path, at_byte, "the last line is cut off")

    def crew(self) -> Iterator[AnyOperatorEvent]:
        """Return the operators' requests."""
        return (thing for thing in self.things() if isinstance(thing, OperatorEvent))

    def _rest_is_damaged(self, path: Path, at_byte: int, why: str) -> None:
        self.damage.append(Damage(at_byte, path.stat().st_size - at_byte, why))


def _told(event: AnyEvent) -> LogEvent | None:
    match event:
        case Telemetry():
            return bridge.Position(
                event.at_us,
                event.at_us,
                event.lat_deg,
                event.lon_deg,
                event.altitude_amsl_m,
                event.altitude_relative_m,
                event.velocity_north_m_s,
                event.velocity_east_m_s,
                math.nan,  # not in a journal
                event.heading_deg,
            )
        case VehicleConnected():
            return bridge.Connected(event.at_us, stack_named(*event.stack.split(" ", 1)))
        case LinkLost():
            return bridge.LinkLost(event.at_us, round(event.silent_s * 1e6))
        case LinkRestored():
            return bridge.LinkRestored(event.at_us)
        case VehicleRebooted():
            return bridge.Rebooted(event.at_us)
        case MissionProgress():
            return bridge.MissionProgress(event.at_us, event.current_seq)
        case ModeChanged():
            return bridge.ModeChanged(event.at_us, event.custom_mode, event.armed, event.mode)
        case WindMeasured():
            return bridge.Wind(event.at_us, event.from_deg, event.speed_m_s)
        case BatteryUpdated():
            return bridge.Battery(event.at_us, 0, round(event.percent), None, None)
        case GpsFixChanged():
            return bridge.GpsFix(event.at_us, event.fix, None)
        case _:
            return None


def journal_in(path: Path) -> Path:
    """Return the path itself if it is a file, else that of the journal in the folder of a run."""
    return path / JOURNAL if path.is_dir() else path


def open_flight(path: Path) -> Log:
    """Open a log, a journal, or the journal in a run's folder. Raises BridgeError and others."""
    path = journal_in(path)
    return JournalLog(path) if begins_journal(path) else open_log(path)
