"""Defines the entries of a log: events of a vehicle's client, and events that only logs contain."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from autopilot_bridge.items import Items
from autopilot_bridge.vehicle.client_events import (
    ClockChanged,
    Connected,
    ItemReached,
    LinkLost,
    LinkRestored,
    MissionProgress,
    ModeChanged,
    Rebooted,
    TelemetryEvent,
    Text,
)

LATEST_US = 4_102_444_800_000_000  # the year 2100; later times are noise


@dataclass(frozen=True, slots=True)
class MissionLoaded:
    """The mission that is now on board (the user's items, without ArduPilot's home)."""

    at_us: int
    items: Items


@dataclass(frozen=True, slots=True)
class MissionReplaced:
    """The replacement of the mission by a mission whose items are not in the log."""

    at_us: int


@dataclass(frozen=True, slots=True)
class Outputs:
    """The pulse widths of the autopilot's servo outputs, from output 1 on, in microseconds."""

    at_us: int
    pulse_us: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class GripperMoved:
    """A command to a gripper to release or to hold."""

    at_us: int
    releases: bool


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """The autopilot's result (MAV_RESULT) for a command (MAV_CMD), from a COMMAND_ACK."""

    at_us: int
    command: int
    result: int


LogEvent = (
    Connected
    | LinkLost
    | LinkRestored
    | Rebooted
    | ClockChanged
    | TelemetryEvent
    | MissionProgress
    | ItemReached
    | ModeChanged
    | Text
    | MissionLoaded
    | MissionReplaced
    | Outputs
    | GripperMoved
    | Acknowledged
)


class Entry(NamedTuple):
    """An event of the vehicle with the id ``system_id``; times are those of the log's clock."""

    system_id: int
    event: LogEvent


class Damage(NamedTuple):
    """Bytes of a log that could not be read, and the reason."""

    at_byte: int
    skipped_bytes: int
    why: str

    def __str__(self) -> str:
        return f"{self.skipped_bytes} bytes at {self.at_byte}: {self.why}"


class Log(ABC):
    """A log file.

    ``messages`` is the number of messages read so far, including skipped ones. ``names`` contains
    the names of the vehicles by system id, if the file contains names.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.messages = 0
        self.damage: list[Damage] = []
        self.names: dict[int, str] = {}

    @abstractmethod
    def entries(self) -> Iterator[Entry]:
        """Yield all entries of the file. Raises BridgeError if the file is unreadable."""

    @abstractmethod
    def unix_offset_us(self) -> int | None:
        """Return time 0 of the log's clock in microseconds since 1970; None if there is no date."""
