"""Converts log entries to rows of tables; all file formats have the same columns."""

import math
from collections import Counter
from collections.abc import Iterator
from datetime import datetime
from typing import Any

from autopilot_bridge.items import Items, command_name, has_degrees, params_of, place_of
from autopilot_bridge.logs.entries import (
    LATEST_US,
    Acknowledged,
    GripperMoved,
    LogEvent,
    MissionLoaded,
    MissionReplaced,
    Outputs,
)
from autopilot_bridge.vehicle.client_events import (
    Attitude,
    Battery,
    Connected,
    GpsFix,
    Health,
    ItemReached,
    LinkLost,
    LinkRestored,
    MissionProgress,
    ModeChanged,
    Position,
    Rebooted,
    Speed,
    Text,
    Wind,
)
from autopilot_bridge.vehicle.command_sequence import RESULTS

Columns = dict[str, type]  # the value of a datetime is in microseconds since 1970
Row = tuple[Any, ...]

SERVOS = 16
WORDS = {0: "accepted", 5: "in progress", **RESULTS}  # words for MAV_RESULT

HEAD: Columns = {"log": str, "vehicle": int, "at_us": int, "utc": datetime}
OWN: dict[str, Columns] = {
    "positions": {
        "lat_deg": float,
        "lon_deg": float,
        "altitude_amsl_m": float,
        "altitude_relative_m": float,
        "velocity_north_m_s": float,
        "velocity_east_m_s": float,
        "velocity_down_m_s": float,
        "heading_deg": float,
    },
    "attitudes": {"roll_deg": float, "pitch_deg": float, "yaw_deg": float},
    "speeds": {
        "airspeed_m_s": float,
        "groundspeed_m_s": float,
        "climb_m_s": float,
        "throttle_percent": int,
    },
    "winds": {"from_deg": float, "speed_m_s": float},
    "batteries": {"battery_id": int, "percent": int, "voltage_v": float, "current_a": float},
    "fixes": {"fix": str, "satellites": int},
    "modes": {"custom_mode": int, "mode": str, "armed": bool},
    "missions": {
        "mission": int,
        "seq": int,
        "command": int,
        "command_name": str,
        "frame": int,
        **{f"param{number}": float for number in range(1, 8)},
        "lat_deg": float,
        "lon_deg": float,
        "altitude_m": float,
        "autocontinue": int,
    },
    "progress": {"kind": str, "seq": int},
    "outputs": {f"servo{number}_us": int for number in range(1, SERVOS + 1)},
    "events": {"kind": str, "severity": int, "text": str},
}
TABLES: dict[str, Columns] = {name: {**HEAD, **own} for name, own in OWN.items()}
SAME_FIELDS: dict[type, str] = {  # tables whose columns are the fields of an event
    Position: "positions",
    Attitude: "attitudes",
    Speed: "speeds",
    Wind: "winds",
    Battery: "batteries",
    GpsFix: "fixes",
}


class Rows:
    """The rows of one log, event by event."""

    def __init__(self, log: str, offset_us: int | None) -> None:
        self._log = log
        self._offset_us = offset_us
        self._missions: Counter[int] = Counter()
        self._pulses: dict[int, tuple[int, ...]] = {}

    def of(self, system_id: int, event: LogEvent) -> Iterator[tuple[str, Row]]:
        """Yield the tables and rows for an event; none if the event's time is out of range."""
        at_us = event.at_us
        if not 0 <= at_us < LATEST_US:
            return
        unix_us = None if self._offset_us is None else at_us + self._offset_us
        for table, values in self._own(system_id, event):
            own = map(_converted, OWN[table].values(), values)
            yield table, (self._log, system_id, at_us, unix_us, *own)

    def _own(self, system_id: int, event: LogEvent) -> Iterator[tuple[str, Row]]:
        """Yield the tables for an event, with the values of the table's own columns (``OWN``)."""
        table = SAME_FIELDS.get(type(event))
        if table is not None:
            yield table, tuple(getattr(event, column) for column in OWN[table])
            return
        match event:
            case ModeChanged():
                yield "modes", (event.custom_mode, event.name, event.armed)
            case MissionProgress():
                yield "progress", ("begun", event.current_seq)
            case ItemReached():
                yield "progress", ("reached", event.seq)
            case MissionLoaded():
                self._missions[system_id] += 1
                for row in _items(event.items):
                    yield "missions", (self._missions[system_id], *row)
            case Outputs() if event.pulse_us != self._pulses.get(system_id):
                self._pulses[system_id] = event.pulse_us
                missing = (None,) * (SERVOS - len(event.pulse_us))
                yield "outputs", (*event.pulse_us[:SERVOS], *missing)
            case Outputs():
                pass
            case _:
                severity = event.severity if isinstance(event, Text) else None
                kind, text = description_of(event)
                yield "events", (kind, severity, text)


def description_of(event: LogEvent) -> tuple[str, str]:
    """Return the kind of an event and its description."""
    match event:
        case Text():
            return "text", event.text
        case Connected():
            return "connected", f"{event.stack.name} {event.stack.kind}"
        case LinkLost():
            return "link_lost", f"no heartbeat for {event.silent_us / 1e6:.1f} s"
        case LinkRestored():
            return "link_restored", "the link is restored"
        case Rebooted():
            return "rebooted", "the autopilot has rebooted"
        case MissionReplaced():
            return "mission_replaced", "another mission, whose items are not in the log"
        case GripperMoved():
            return "gripper", "release" if event.releases else "grab"
        case Acknowledged():
            words = WORDS.get(event.result, f"MAV_RESULT {event.result}")
            return "acknowledged", f"{command_name(event.command)}: {words}"
        case Health():
            unhealthy = ", ".join(event.unhealthy)
            return "health", f"unhealthy: {unhealthy}" if unhealthy else "healthy"
        case _:
            return type(event).__name__, ""


def _items(items: Items) -> Iterator[Row]:
    for seq, item in enumerate(items):
        lat_deg, lon_deg = place_of(item) or (None, None)
        altitude_m = item.z if has_degrees(item) else None
        command = (item.command, command_name(item.command), item.frame)
        place = (lat_deg, lon_deg, altitude_m)
        yield seq, *command, *params_of(item), *place, item.autocontinue


def _converted(kind: type, value: Any) -> Any:
    """Convert a value to its column's type, because field types vary between ULog files.

    Returns None for NaN and infinity, which JSON and plots cannot represent.
    """
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return None
    return kind(value)
