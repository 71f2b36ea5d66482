"""Merges logs of several vehicles into one stream of entries, each with its vehicle."""

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
    """An entry of a vehicle's log, on the common clock of all logs."""

    at_us: int
    vehicle: str
    system_id: int
    event: LogEvent


# The kinds of entries that remain valid until the next entry of the same kind (lasting entries). A
# part of a flight begins with the last earlier entry of each of these kinds.
LASTING: tuple[tuple[tuple[type, ...], str], ...] = (
    ((Connected,), "stack"),
    ((LinkLost, LinkRestored), "link"),
    ((ModeChanged,), "mode"),
    ((MissionLoaded, MissionReplaced), "mission"),
    ((MissionProgress,), "progress"),
)


class Flight(NamedTuple):
    """Logs that are analysed together, each with the given name of its vehicle in ``names``.

    Only the part between ``from_s`` and ``to_s``, in seconds since the logs begin, is used.
    """

    logs: tuple[Log, ...]
    names: tuple[str | None, ...]
    from_s: float = 0.0
    to_s: float = math.inf

    @property
    def offset_us(self) -> int | None:
        """Offset from the common clock to microseconds since 1970; None if unknown."""
        offsets = [log.unix_offset_us() for log in self.logs]
        if len(offsets) == 1:
            return offsets[0]
        return None if None in offsets else 0

    @property
    def is_part(self) -> bool:
        """Whether only a part of the flight is used."""
        return self.from_s > 0.0 or self.to_s < math.inf

    def zero_us(self) -> int:
        """Return the time at which the whole flight begins. Raises FlightError for empty logs."""
        first = next(self._whole(), None)
        if first is None:
            raise FlightError(f"{self.paths_text}: no vehicle in the logs")
        return first.at_us

    @property
    def paths_text(self) -> str:
        """The paths of all logs, as text."""
        return ", ".join(str(log.path) for log in self.logs)

    def played(self) -> Iterator[VehicleLog]:
        """Yield the lasting entries from before the part, then the part's entries in time order.

        If a vehicle has two logs (one recorded on the link and one on board), each kind of event is
        read from the log in which it occurs first.
        """
        from_us, to_us = None, math.inf
        lasting: dict[tuple[str, str], VehicleLog] = {}
        for entry in self._whole():
            if from_us is None:
                from_us = entry.at_us + round(self.from_s * 1e6)
                to_us = entry.at_us + self.to_s * 1e6
            if entry.at_us > to_us:
                return
            if entry.at_us < from_us:
                _replace(lasting, entry, from_us)
                continue
            yield from lasting.values()
            lasting.clear()
            yield entry

    def _whole(self) -> Iterator[VehicleLog]:
        names: dict[tuple[int, int], str] = {}
        source_of: dict[tuple[str, type], tuple[int, int]] = {}
        for at_us, log, entry in merged(self.logs):
            key = (log, entry.system_id)
            if key not in names:
                names[key] = self._name(names, key)
            name = names[key]
            if source_of.setdefault((name, type(entry.event)), key) == key:
                yield VehicleLog(at_us, name, *entry)

    def _name(self, names: dict[tuple[int, int], str], key: tuple[int, int]) -> str:
        given, log = self.names[key[0]], self.logs[key[0]]
        if given is not None and any(each[0] == key[0] for each in names):
            raise FlightError(
                f"{log.path}: has several vehicles, which cannot share the name {given}; remove "
                f"{given}="
            )
        return given or name_of(log, key[1])


def _replace(lasting: dict[tuple[str, str], VehicleLog], entry: VehicleLog, at_us: int) -> None:
    """Replace the lasting entry of the same kind; the new entry becomes the last in order."""
    kind = next((word for kinds, word in LASTING if isinstance(entry.event, kinds)), None)
    if kind is None:
        return
    if kind == "mission":  # the progress belonged to the previous mission
        lasting.pop((entry.vehicle, "progress"), None)
    lasting.pop((entry.vehicle, kind), None)
    lasting[entry.vehicle, kind] = entry._replace(at_us=at_us)


def flight_of(words: Sequence[str]) -> Flight:
    """Open logs, given as PATH or NAME=PATH; logs with the same NAME belong to one vehicle.

    Raises FlightError or BridgeError with a one-line text.
    """
    given = [_split(word) for word in words]
    logs = tuple(open_flight(path) for _, path in given)
    # A single log keeps its clock, because a search for the date could read the whole file.
    dated = [len(logs) == 1 or log.unix_offset_us() is not None for log in logs]
    if any(dated) and not all(dated):
        path = logs[dated.index(False)].path
        raise FlightError(f"{path}: has no UTC time and cannot be merged with logs that have one")
    return Flight(logs, tuple(name for name, _ in given))


def path_of(word: str) -> Path:
    """Return the path in an argument PATH or NAME=PATH."""
    return _split(word)[1]


def _split(word: str) -> tuple[str | None, Path]:
    name, equals, path = word.partition("=")
    if equals and not Path(word).exists():
        return name, Path(path)
    return None, Path(word)


class Survey(NamedTuple):
    """The vehicles and times of a flight, which begins at ``zero_us`` on the flight's clock."""

    flown: dict[str, Flown]
    zero_us: int
    begin_us: int
    end_us: int
    offset_us: int | None  # offset to microseconds since 1970
    damage: tuple[str, ...]


def survey(flight: Flight) -> Survey:
    """Read a flight to its end. Raises FlightError for a flight without a vehicle."""
    zero_us, offset_us = flight.zero_us(), flight.offset_us
    flown: dict[str, Flown] = {}
    begin_us = end_us = 0
    for entry in flight.played():
        if not flown:
            begin_us = entry.at_us
        if entry.vehicle not in flown:
            flown[entry.vehicle] = Flown(entry.vehicle, entry.system_id, offset_us)
        flown[entry.vehicle].apply(entry.event, entry.at_us)
        end_us = max(end_us, entry.at_us)
    if not flown:
        part = "this part of the logs" if flight.is_part else "the logs"
        raise FlightError(f"{flight.paths_text}: no vehicle in {part}")
    damage = tuple(f"{log.path}: {each}" for log in flight.logs for each in log.damage)
    return Survey(flown, zero_us, begin_us, end_us, offset_us, damage)
