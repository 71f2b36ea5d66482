"""Several logs of several vehicles as one stream: whose each entry is, and which tells what."""

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
    """Something that a vehicle's log tells, on the clock that all logs share."""

    at_us: int
    vehicle: str
    system_id: int
    event: LogEvent


# What holds until it is told anew: it counts for a part of a flight, though told before that.
LASTING: tuple[tuple[tuple[type, ...], str], ...] = (
    ((Connected,), "stack"),
    ((LinkLost, LinkRestored), "link"),
    ((ModeChanged,), "mode"),
    ((MissionLoaded, MissionReplaced), "mission"),
    ((MissionProgress,), "progress"),
)


class Flight(NamedTuple):
    """Logs that are looked at together; ``names`` are those given to the vehicles of each.

    Only the part between two times counts, in seconds from their beginning.
    """

    logs: tuple[Log, ...]
    names: tuple[str | None, ...]
    from_s: float = 0.0
    to_s: float = math.inf

    @property
    def offset_us(self) -> int | None:
        """What to add to their shared clock for microseconds since 1970; None: not known."""
        offsets = [log.unix_offset_us() for log in self.logs]
        if len(offsets) == 1:
            return offsets[0]
        return None if None in offsets else 0

    @property
    def is_part(self) -> bool:
        """Whether not all of it counts."""
        return self.from_s > 0.0 or self.to_s < math.inf

    def zero_us(self) -> int:
        """When the whole flight begins on its clock. Raises FlightError where nothing is in it."""
        first = next(self._whole(), None)
        if first is None:
            raise FlightError(f"{self.paths}: nothing flew in it")
        return first.at_us

    @property
    def paths(self) -> str:
        """Of all its logs."""
        return ", ".join(str(log.path) for log in self.logs)

    def played(self) -> Iterator[VehicleLog]:
        """All of it, by time; what holds when the part begins is told with its first moment.

        Two logs of one vehicle (its link's and its own) do not tell the same thing twice: of each
        kind of event only the one counts that tells it first.
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
    """Have what this says in the place of what it ends, in the order in which it was said."""
    kind = next((word for kinds, word in LASTING if isinstance(told.event, kinds)), None)
    if kind is None:
        return
    if kind == "mission":  # which item was flown to, was of the one before
        holds.pop((told.vehicle, "progress"), None)
    holds.pop((told.vehicle, kind), None)
    holds[told.vehicle, kind] = told._replace(at_us=at_us)


def flight_of(words: Sequence[str]) -> Flight:
    """Logs by their paths, or as NAME=PATH: those of one name are of one vehicle.

    Raises FlightError and BridgeError in one line.
    """
    given = [_split(word) for word in words]
    logs = tuple(open_flight(path) for _, path in given)
    # One is on its own clock anyhow, and to look for the date may take all of it.
    dated = [len(logs) == 1 or log.unix_offset_us() is not None for log in logs]
    if any(dated) and not all(dated):
        path = logs[dated.index(False)].path
        raise FlightError(f"{path}: knows no UTC, so it cannot be joined with logs that do")
    return Flight(logs, tuple(name for name, _ in given))


def path_of(word: str) -> Path:
    """The path in a word that may give a name too."""
    return _split(word)[1]


def _split(word: str) -> tuple[str | None, Path]:
    name, equals, path = word.partition("=")
    if equals and not Path(word).exists():
        return name, Path(path)
    return None, Path(word)


class Survey(NamedTuple):
    """Who flew in a flight, and when, on its clock: the whole began at ``zero_us``."""

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
        flown[told.vehicle].take(told.event, told.at_us)
        end_us = max(end_us, told.at_us)
    if not flown:
        where = "in this part of it" if flight.is_part else "in it"
        raise FlightError(f"{flight.paths}: nothing flew {where}")
    damage = tuple(f"{log.path}: {each}" for log in flight.logs for each in log.damage)
    return Survey(flown, zero_us, begin_us, end_us, offset_us, damage)
