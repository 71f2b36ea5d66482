"""Reads ArduPilot's DataFlash logs (.bin), a self-describing format.

A message consists of the bytes A3 95, a type and values. An FMT message (type 128) gives the names
and formats of the columns of one type. Source: ArduPilot 4.6
``libraries/AP_Logger/LogStructure.h``. Times are in microseconds since boot (``TimeUS``); GPS
messages contain the date.
"""

import math
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.logs.entries import (
    LATEST_US,
    Entry,
    Log,
    LogEvent,
    MissionLoaded,
    MissionReplaced,
    Outputs,
)
from autopilot_bridge.logs.record_scanner import Values, events_of, records, steady
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle.client_events import (
    Attitude,
    Battery,
    Connected,
    GpsFix,
    ItemReached,
    MissionProgress,
    ModeChanged,
    Position,
    Speed,
    Text,
)
from autopilot_bridge.vehicle.telemetry import Changes, fix_name, wind_of_air

HEAD = b"\xa3\x95"
FMT = 128
FMT_BYTES = 89
LONGEST_BYTES = 255
NO_MESSAGE = "not a DataFlash message of a type that the log defines"
GPS_EPOCH_US = 315_964_800_000_000  # 6 January 1980
LEAP_US = 18_000_000  # GPS time minus UTC since 2017
WEEK_US = 7 * 86_400_000_000
# For each format letter, the code for ``struct`` and the divisor of the value. A divisor of 0 means
# bytes, a divisor of -1 a string.
LETTERS: dict[str, tuple[str, float]] = {
    **{letter: (letter, 1.0) for letter in "bBhHiIfdqQ"},
    **{letter: (code, 100.0) for letter, code in zip("cCeE", "hHiI", strict=True)},
    "a": ("64s", 0.0),
    "g": ("e", 1.0),
    "n": ("4s", -1.0),
    "N": ("16s", -1.0),
    "Z": ("64s", -1.0),
    "L": ("i", 1e7),
    "M": ("B", 1.0),
}
ARMED, DISARMED = ("Throttle armed", "Arming motors"), ("Throttle disarmed", "Disarming motors")


class DataFlashLog(Log):
    """The reader of a .bin file, which contains no system id; the default is 1."""

    def __init__(self, path: Path, system_id: int = 1) -> None:
        super().__init__(path)
        self.system_id = system_id

    def unix_offset_us(self) -> int | None:
        """Return the offset to UTC, taken from the first GPS message with a valid time."""
        for name, values in self._messages(frozenset(("GPS",))):
            if name == "GPS" and values.get("GWk", 0) > 0:
                gps_us = values["GWk"] * WEEK_US + values["GMS"] * 1000
                offset_us = int(GPS_EPOCH_US + gps_us - LEAP_US - values["TimeUS"])
                if 0 < offset_us < LATEST_US:
                    return offset_us
        return None

    def entries(self) -> Iterator[Entry]:
        """Yield the entries of the file from its beginning."""
        flight = _Flight()

        def convert(name: str, values: Values) -> list[LogEvent]:
            return _CONVERTERS[name](flight, values, values["TimeUS"])

        messages = steady(self._messages(frozenset(_CONVERTERS)), "TimeUS")
        for event in events_of(self, messages, convert):
            yield Entry(self.system_id, event)

    def _messages(self, names: frozenset[str]) -> Iterator[tuple[str, Values]]:
        """Yield the name and values of each message that has a time and one of these names."""
        lengths = [0] * 256
        lengths[FMT] = FMT_BYTES
        kinds: list[_Kind | None] = [None] * 256

        def length_at(data: bytes, at: int, lost: bool) -> int:
            return _length_at(data, at, lengths)

        def next_start(data: bytes, at: int) -> int:
            return data.find(HEAD, at)

        for data, at, _ in records(self, 2 * LONGEST_BYTES, length_at, next_start, NO_MESSAGE):
            number = data[at + 2]
            kind = kinds[number]
            if kind is not None:
                values = kind.read(data, at + 3)
                if values is not None:
                    yield kind.name, values
            elif number == FMT:
                described = _Kind(data[at + 3 : at + FMT_BYTES])
                if described.valid:
                    lengths[described.number] = described.length
                    kinds[described.number] = described if described.name in names else None


def _length_at(data: bytes, at: int, lengths: list[int]) -> int:
    """Return the length of the message at ``at``; 0 if there is no complete message.

    Messages have no checksum: a message is accepted only if another message follows it.
    """
    if data[at : at + 2] != HEAD or at + 3 > len(data):
        return 0
    length = lengths[data[at + 2]]
    if not length or at + length > len(data):
        return 0
    follows = data[at + length : at + length + 2]
    return length if HEAD.startswith(follows) else 0


class _Kind:
    """A message type, as described by its FMT message."""

    def __init__(self, fields: bytes) -> None:
        self.number, self.length, name, letters, columns = struct.unpack("<BB4s16s64s", fields)
        self.name = _text(name)
        self._columns = _text(columns).split(",")
        types = [LETTERS.get(letter) for letter in _text(letters)]
        self._struct = struct.Struct("<" + "".join(each[0] for each in types if each))
        self._scales = [each[1] for each in types if each]
        self._plain = all(scale == 1.0 for scale in self._scales)
        self.valid = (
            None not in types
            and len(types) == len(self._columns)
            and self._struct.size + 3 == self.length
        )
        self.timed = "TimeUS" in self._columns

    def read(self, data: bytes, at: int) -> Values | None:
        """Return the values by column, in scaled units; None if the message has no time."""
        if not self.timed:
            return None
        values = self._struct.unpack_from(data, at)
        if self._plain:
            return dict(zip(self._columns, values, strict=True))
        return {
            column: value
            if scale == 1.0
            else _text(value)
            if scale < 0.0
            else value
            if scale == 0.0
            else value / scale
            for column, value, scale in zip(self._columns, values, self._scales, strict=True)
        }


def _text(data: bytes) -> str:
    return data.split(b"\0", 1)[0].decode("utf-8", "replace")


class _Flight:
    """The latest values of a flight, for events that need values from several messages."""

    def __init__(self) -> None:
        self.stack: Stack | None = None
        self.armed = False
        self.mode: int | None = None
        self.mode_name = ""  # "" until the text that names the firmware
        self.velocity = (0.0, 0.0, 0.0)  # north, east, down
        self.by_filter = False  # True if the velocity is from the EKF, False if from GPS
        self.yaw_deg = 0.0
        self.airspeed_m_s: float | None = None
        self.throttle_percent = 0
        self.items: dict[int, MissionItem] = {}
        self.on_board: dict[int, MissionItem] = {}  # items of the mission on board
        self.count = 0
        self.current: int | None = None
        self._changes = Changes()

    def on_change(self, event: Battery | GpsFix) -> list[LogEvent]:
        """Return a list with the event, or an empty list if the state has not changed."""
        return [event] if self._changes.has(event) else []


def _pos(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    if not (fields["Lat"] or fields["Lng"]):
        return []
    above_m = fields.get("RelHomeAlt", math.nan)
    place = (fields["Lat"], fields["Lng"], fields["Alt"], above_m)
    return [Position(at_us, at_us, *place, *flight.velocity, flight.yaw_deg)]


def _xkf1(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    if fields.get("C", 0) == 0:
        flight.velocity, flight.by_filter = (fields["VN"], fields["VE"], fields["VD"]), True
    return []


def _xkf2(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    north, east = fields["VWN"], fields["VWE"]
    if fields.get("C", 0) or not (north or east):
        return []
    return [wind_of_air(north, east, at_us)]


def _att(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    flight.yaw_deg = fields["Yaw"] % 360.0
    return [Attitude(at_us, at_us, fields["Roll"], fields["Pitch"], flight.yaw_deg)]


def _gps(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    if fields.get("I", 0):
        return []
    if not flight.by_filter:
        course_rad = math.radians(fields["GCrs"])
        north, east = fields["Spd"] * math.cos(course_rad), fields["Spd"] * math.sin(course_rad)
        flight.velocity = (north, east, fields["VZ"])
    climb_m_s = -float(fields["VZ"])
    speed = Speed(at_us, flight.airspeed_m_s, fields["Spd"], climb_m_s, flight.throttle_percent)
    return [
        *flight.on_change(GpsFix(at_us, fix_name(fields["Status"]), fields["NSats"])),
        speed,
    ]


def _ctun(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    if "As" in fields:
        flight.airspeed_m_s = fields["As"]
    throttle = fields.get("ThO", 0.0)
    share = 100.0 if flight.stack is not None and flight.stack.vehicle == "copter" else 1.0
    flight.throttle_percent = round(share * throttle) if math.isfinite(throttle) else 0
    return []


def _mode(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    return _mode_changed(
        flight, fields["ModeNum" if "ModeNum" in fields else "Mode"], flight.armed, at_us
    )


def _mode_changed(flight: _Flight, mode: int | None, armed: bool, at_us: int) -> list[LogEvent]:
    name = "" if flight.stack is None or mode is None else flight.stack.mode_name(mode)
    if (mode, armed, name) == (flight.mode, flight.armed, flight.mode_name):
        return []
    flight.mode, flight.armed, flight.mode_name = mode, armed, name
    if mode is None:
        return []
    return [ModeChanged(at_us, mode, armed, name)]


def _arm(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    return _mode_changed(flight, flight.mode, bool(fields["ArmState"]), at_us)


def _msg(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    text = fields["Message"]
    found: list[LogEvent] = []
    for word, vehicle in (("ArduPlane", "plane"), ("ArduCopter", "copter")):
        if flight.stack is None and text.startswith(word):
            flight.stack = stack_named("ardupilot", vehicle)
            found = [Connected(at_us, flight.stack)]
    # Logs often begin at arming, before the first ARM message.
    armed = text in ARMED or (flight.armed and text not in DISARMED)
    changed = _mode_changed(flight, flight.mode, armed, at_us)
    return [*found, *changed, Text(at_us, mavlink.MAV_SEVERITY_INFO, text)]


# Defaults for fields of an item that a MISE may lack.
NO_ITEM = dict.fromkeys(("CId", "Frame", "Prm1", "Prm2", "Prm3", "Prm4", "Lat", "Lng", "Alt"), 0)


def _item(fields: Values) -> MissionItem:
    params = (fields["Prm1"], fields["Prm2"], fields["Prm3"], fields["Prm4"])
    x, y = round(fields["Lat"] * 1e7), round(fields["Lng"] * 1e7)
    return MissionItem(fields["CId"], fields["Frame"], x, y, fields["Alt"], *params)


def _cmd(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    """Process a CMD; return MissionLoaded after the last CMD of a mission.

    ArduPilot logs the whole mission, home first, at the start of a log and after an item-by-item
    upload, but not after an upload by MAVFTP (4.6.2: ``AP_Filesystem_Mission.cpp``).
    """
    number, count = fields["CNum"], fields["CTot"]
    if number == 0:
        flight.items.clear()
    flight.items[number] = _item(fields)
    if number + 1 < count or len(flight.items) < count or count < 2:
        return []
    user = tuple(flight.items[seq] for seq in range(1, count))
    flight.on_board, flight.count = flight.items, count
    flight.items = {}
    return [MissionLoaded(at_us, user)]


def _mise(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    """Process a MISE: an item begins, so the previous item has been reached."""
    seq, item, count = fields["CNum"] - 1, _item({**NO_ITEM, **fields}), fields["CTot"]
    replaced = flight.count and (count, flight.on_board.get(seq + 1, item)) != (flight.count, item)
    if replaced:
        flight.on_board, flight.current = {}, None
    flight.count, flight.on_board[seq + 1] = count, item
    before, flight.current = flight.current, seq
    if replaced:
        return [MissionReplaced(at_us), MissionProgress(at_us, seq)]
    if before is None or seq != before + 1:
        return [MissionProgress(at_us, seq)]
    return [ItemReached(at_us, before), MissionProgress(at_us, seq)]


def _rcou(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    pulses = (fields.get(f"C{number}") for number in range(1, 15))
    return [Outputs(at_us, tuple(pulse for pulse in pulses if pulse is not None))]


def _bat(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    if fields.get("Inst", 0):
        return []
    percent = fields.get("RemPct")
    return flight.on_change(
        Battery(at_us, 0, percent, round(fields["Volt"], 2), round(fields["Curr"], 1))
    )


_CONVERTERS: dict[str, Callable[[_Flight, Values, int], list[LogEvent]]] = {
    "POS": _pos,
    "XKF1": _xkf1,
    "XKF2": _xkf2,
    "ATT": _att,
    "GPS": _gps,
    "CTUN": _ctun,
    "MODE": _mode,
    "ARM": _arm,
    "MSG": _msg,
    "CMD": _cmd,
    "MISE": _mise,
    "RCOU": _rcou,
    "BAT": _bat,
}
