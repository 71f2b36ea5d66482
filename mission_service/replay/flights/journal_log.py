"""Reads a journal as a log: vehicle events become log entries with mission times."""

import math
from collections.abc import Iterator
from datetime import datetime
from functools import cached_property
from pathlib import Path

from autopilot_bridge.items import Items
from autopilot_bridge.logs.entries import Damage, Entry, Log, LogEvent, MissionLoaded
from autopilot_bridge.logs.reading import open_log
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle import client_events as bridge
from mission_service.commands import Announce, AnyCommand, UploadMission
from mission_service.config.rule_lookup import rules
from mission_service.config.scenario import Scenario, recorded_scenario, rule_in
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
from mission_service.journal.segments import Chain, lines_skipped
from mission_service.replay.flights.utc_time import unix_us
from mission_service.replay.flights.write_once_journal import REPLAY

SEVERITY = {"warning": 4, "info": 6}  # MAV_SEVERITY
JOURNAL = "journal.jsonl"
ANY_RULE = "circling"  # a rule for reading the log's own data, which do not depend on the planner


class JournalLog(Log):
    """A journal as a log, whose vehicles are numbered from 1 in the order of the scenario.

    The numbers replace system ids, because vehicles on separate links may have equal ids.
    """

    def __init__(self, path: Path) -> None:
        """Open the journal at ``path``. Raises JournalError if the file or header is missing."""
        super().__init__(path)
        self._chain = Chain(path)
        header = self._chain.readers[0].header
        self._recorded = header["scenario"]
        self.open_loop = bool(header.get(REPLAY))
        self.names = {at: each.name for at, each in enumerate(self._without_planner.vehicles, 1)}
        self._numbers = {name: number for number, name in self.names.items()}

    def scenario(self, rule: str | None = None) -> Scenario:
        """Return the recorded scenario, with another rule if one is given."""
        return recorded_scenario(self._recorded, self.path, rule)

    @cached_property
    def skipped(self) -> dict[tuple[int, int], str]:
        """The reasons why restarts have skipped lines, by (segment, line)."""
        return lines_skipped(self._chain.lines(self._chain.begin))

    @cached_property
    def _without_planner(self) -> Scenario:
        installed = rule_in(self._recorded) in (None, *rules())
        return self.scenario(None if installed else ANY_RULE)

    def unix_offset_us(self) -> int | None:
        """Return the offset to microseconds since 1970, if the scenario has ``time_zero``."""
        zero: datetime | None = self._without_planner.time_zero
        return None if zero is None else unix_us(zero)

    def entries(self) -> Iterator[Entry]:
        """Yield the vehicles' events as log entries; an accepted upload becomes a loaded mission.

        The journal of an open-loop replay yields no missions, because no vehicle received any.
        """
        sent: dict[tuple[str, int], Items] = {}
        at_us = 0
        for content in self.contents():
            if isinstance(content, UploadMission):
                sent[content.vehicle, content.mission_id] = content.items
            elif isinstance(content, Announce) and content.vehicle in self._numbers:
                text = bridge.Text(at_us, SEVERITY[content.level], content.text)
                yield Entry(self._numbers[content.vehicle], text)
            if not isinstance(content, AnyEvent):
                continue
            at_us = content.at_us
            if isinstance(content, OperatorEvent):
                continue
            event = _log_event(content)
            if isinstance(content, UploadFinished):
                items = sent.pop((content.vehicle, content.mission_id), None)
                if items is not None and content.outcome == "accepted" and not self.open_loop:
                    event = MissionLoaded(at_us, items)
            if self.open_loop and isinstance(event, bridge.MissionProgress):
                continue
            if event is not None:
                yield Entry(self._numbers[content.vehicle], event)

    def contents(self) -> Iterator[AnyEvent | AnyCommand]:
        """Yield events and commands in order; damaged lines are instead listed in ``damage``."""
        return (content for _, content in self.located() if content is not None)

    def located(self) -> Iterator[tuple[tuple[int, int], AnyEvent | AnyCommand | None]]:
        """Yield ``contents`` with segment and line, and None for each altered or skipped line."""
        self.messages, self.damage = 0, []
        skipped = self.skipped  # found first, because a segment has one reading position
        for reader in self._chain.readers:
            at_byte = reader.begin.at_byte
            try:
                for number, body, intact in reader.lines(reader.begin):
                    self.messages += 1
                    place = (reader.segment, number)
                    if intact and place not in skipped:
                        yield place, reader.entry(number, body, intact).content
                    else:
                        yield place, None
                        fault = "was skipped by a restart"
                        fault = fault if intact else "its checksum does not match"
                        why = f"{reader.path.name}, line {number}: {fault}"
                        self.damage.append(Damage(at_byte, reader.rest.at_byte - at_byte, why))
                    at_byte = reader.rest.at_byte
            except JournalError as error:  # a line after the end, or of an unknown kind
                self._rest_is_damaged(reader.path, at_byte, str(error))
            if reader.cut_at_line is not None:
                self._rest_is_damaged(reader.path, at_byte, "the last line is incomplete")

    def requests(self) -> Iterator[AnyOperatorEvent]:
        """Return an iterator over the operators' requests."""
        return (each for each in self.contents() if isinstance(each, OperatorEvent))

    def _rest_is_damaged(self, path: Path, at_byte: int, why: str) -> None:
        self.damage.append(Damage(at_byte, path.stat().st_size - at_byte, why))


def _log_event(event: AnyEvent) -> LogEvent | None:
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
                math.nan,  # a journal does not contain the vertical speed
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
            percent = None if event.percent is None else round(event.percent)
            return bridge.Battery(event.at_us, 0, percent, event.voltage_v, event.current_a)
        case GpsFixChanged():
            return bridge.GpsFix(event.at_us, event.fix, None)
        case _:
            return None


def journal_in(path: Path) -> Path:
    """Return the path of the journal in a run's folder, or the given path if it is a file."""
    return path / JOURNAL if path.is_dir() else path


def open_flight(path: Path) -> Log:
    """Open a log, a journal, or the journal in a run's folder.

    Raises BridgeError, JournalError and ScenarioError.
    """
    path = journal_in(path)
    return JournalLog(path) if begins_journal(path) else open_log(path)
