"""Merges several logs of several vehicles into one stream of entries, each with its vehicle."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from autopilot_bridge.logs.entries import Log, LogEvent, MissionLoaded, MissionReplaced
from autopilot_bridge.logs.reading import merged
from autopilot_bridge.vehicle.client_events import (
    Connected,
    LinkLost,
    LinkRestored,
    MissionProgress,
    ModeChanged,
)
from mission_service.errors import FlightError
from mission_service.replay.flights.flown_vehicle import Flown, name_of
from mission_service.replay.flights.journal_log import open_flight


class VehicleLog(NamedTuple):
    """An entry of a vehicle's log, on the clock that all logs share."""

    at_us: int
    vehicle: str
    system_id: int
    event: LogEvent


# Entries that hold until the next one of their kind: the last one before a part of a flight counts.
LASTING: tuple[tuple[tuple[type, ...], str], ...] = (
    ((Connected,), "stack"),
    ((LinkLost, LinkRestored), "link"),
    ((ModeChanged,), "mode"),
    ((MissionLoaded, MissionReplaced), "mission"),
    ((MissionProgress,), "progress"),
)


class Flight(NamedTuple):
    """Logs that are analysed together; ``names`` are the names given to the vehicles of each log.

    Only the part between two times is used, in seconds from the beginning of the logs.
    """

    logs: tuple[Log, ...]
    names: tuple[str | None, ...]
    from_s: float = 0.0
    to_s: float = math.inf

    @property
    def offset_us(self) -> int | None:
        """Offset of the shared clock to microseconds since 1970; None: unknown."""
        offsets = [log.unix_offset_us() for log in self.logs]
        if len(offsets) == 1:
            return offsets[0]
        return None if None in offsets else 0

    @property
    def is_part(self) -> bool:
        """Whether only a part of the flight is used."""
        return self.from_s > 0.0 or self.to_s < math.inf

    def zero_us(self) -> int:
        """Begin of the whole flight on its clock. Raises FlightError if the logs are empty."""
        first = next(self._whole(), None)
        if first is None:
            raise FlightError(f"{self.paths}: nothing flew in it")
        return first.at_us

    @property
    def paths(self) -> str:
        """The paths of all its logs, as text."""
        return ", ".join(str(log.path) for log in self.logs)

    def played(self) -> Iterator[VehicleLog]:
        """Yield all entries in order of time; lasting entries from before the part come at its begin.

        Two logs of one vehicle (from the link and from on board) do not yield an entry twice: of
        each kind of event only the log is used that has it first.
        """
        from_us, to_us = None, math.inf
        holds: dict[tuple[str, str], VehicleLog] = {}
        for told in self._whole():
            if from_us is None:
                from_us = told.at_us + round(self.from_s * 1e6)
                to_us = told.at_us + self.to_s * 1e6
            if told.at_us > to_us:
                return
            if told.at_us < from_us:
                _hold(holds, told, from_us)
                continue
            yield from holds.values()
            holds.clear()
            yield told

    def _whole(self) -> Iterator[VehicleLog]:
        names: dict[tuple[int, int], str] = {}
        tells: dict[tuple[str, type], tuple[int, int]] = {}
        for at_us, log, entry in merged(self.logs):
            key = (log, entry.system_id)
            if key not in names:
                names[key] = self._name(names, key)
            name = names[key]
            if tells.setdefault((name, type(entry.event)), key) == key:
                yield VehicleLog(at_us, name, *entry)

    def _name(self, names: dict[tuple[int, int], str], key: tuple[int, int]) -> str:
        given, log = self.names[key[0]], self.logs[key[0]]
        if given is not None and any(each[0] == key[0] for each in names):
            raise FlightError(
                f"{log.path}: has several vehicles, so they cannot all be {given}; leave "
                f"{given}= out"
            )
        return given or name_of(log, key[1])


def _hold(holds: dict[tuple[str, str], VehicleLog], told: VehicleLog, at_us: int) -> None:
    """Replace the lasting entry of this kind by this one, in the order of the entries."""
    kind = next((word for kinds, word in LASTING if isinstance(told.event, kinds)), None)
    if kind is None:
        return
    if kind == "mission":  # the progress was that of the previous mission
        holds.pop((told.vehicle, "progress"), None)
    holds.pop((told.vehicle, kind), None)
    holds[told.vehicle, kind] = told._replace(at_us=at_us)


def flight_of(words: Sequence[str]) -> Flight:
    """Logs by their paths, or as NAME=PATH: logs of the same name belong to one vehicle.

    Raises FlightError and BridgeError in one line.
    """
    given = [_split(word) for word in words]
    logs = tuple(open_flight(path) for _, path in given)
    # A single log keeps its own clock; the search for its date might read the whole file.
    dated = [len(logs) == 1 or log.unix_offset_us() is not None for log in logs]
    if any(dated) and not all(dated):
        path = logs[dated.index(False)].path
        raise FlightError(f"{path}: has no UTC time, so it cannot be merged with logs that have")
    return Flight(logs, tuple(name for name, _ in given))


def path_of(word: str) -> Path:
    """Return the path in PATH or NAME=PATH."""
    return _split(word)[1]


def _split(word: str) -> tuple[str | None, Path]:
    name, equals, path = word.partition("=")
    if equals and not Path(word).exists():
        return name, Path(path)
    return None, Path(word)


class Survey(NamedTuple):
    """The vehicles of a flight and its times on its clock; the whole began at ``zero_us``."""

    flown: dict[str, Flown]
    zero_us: int
    begin_us: int
    end_us: int
    offset_us: int | None  # to microseconds since 1970
    damage: tuple[str, ...]


def survey(flight: Flight) -> Survey:
    """Read a flight to its end. Raises FlightError if nothing flew in it."""
    zero_us, offset_us = flight.zero_us(), flight.offset_us
    flown: dict[str, Flown] = {}
    begin_us = end_us = 0
    for told in flight.played():
        if not flown:
            begin_us = told.at_us
        if told.vehicle not in flown:
            flown[told.vehicle] = Flown(told.vehicle, told.system_id, offset_us)
        flown[told.vehicle].apply(told.event, told.at_us)
        end_us = max(end_us, told.at_us)
    if not flown:
        where = "in this part of it" if flight.is_part else "in it"
        raise FlightError(f"{flight.paths}: nothing flew {where}")
    damage = tuple(f"{log.path}: {each}" for log in flight.logs for each in log.damage)
    return Survey(flown, zero_us, begin_us, end_us, offset_us, damage)
