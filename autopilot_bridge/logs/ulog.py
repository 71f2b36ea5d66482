"""Reads PX4's ULog (.ulg): messages of topics, with their formats at the beginning of the file.

Source: docs.px4.io "ULog file format", version 1. Times are in microseconds since boot; GPS
topics contain the date. Mission items are not logged.
"""

import math
import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

from autopilot_bridge.logs.entries import (
    LATEST_US,
    Acknowledged,
    Entry,
    GripperMoved,
    Log,
    LogEvent,
    MissionReplaced,
    Outputs,
)
from autopilot_bridge.logs.record_scanner import Values, events_of, records, steady
from autopilot_bridge.stacks.modes import PX4
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle.client_events import (
    Attitude,
    Battery,
    Connected,
    GpsFix,
    ItemReached,
    LandedState,
    MissionProgress,
    ModeChanged,
    Position,
    Speed,
    SystemState,
    Text,
)
from autopilot_bridge.vehicle.telemetry import Changes, ReportedOnChange, fix_name, wind_of_air

MAGIC = b"ULog\x01\x12\x35"
FILE_HEAD_BYTES, HEAD_BYTES = 16, 3
LONGEST_BYTES = HEAD_BYTES + 0xFFFF
NO_MESSAGE = "not a ULog message"
# The maximum body size for each kind of message; no other kinds exist.
MAX_BYTES = dict.fromkeys(b"BFIMD", 65535) | dict.fromkeys(b"LC", 1024)
MAX_BYTES |= {ord("P"): 300, ord("Q"): 301, ord("A"): 259, ord("R"): 2, ord("S"): 8, ord("O"): 2}
PADDING_BYTES = 8  # maximum padding at the end of a topic; files omit the padding
DATA = ord("D")
BOOT_KEY = b"uint64_t boot_time_utc_us"  # boot time by the autopilot's clock, if it has one
LETTERS = {
    "int8_t": "b",
    "uint8_t": "B",
    "int16_t": "h",
    "uint16_t": "H",
    "int32_t": "i",
    "uint32_t": "I",
    "int64_t": "q",
    "uint64_t": "Q",
    "float": "f",
    "double": "d",
    "bool": "?",
    "char": "c",
}
ARMED, ROTARY_WING, FIXED_WING = 2, 1, 2
_FIELD = re.compile(r"([A-Za-z0-9_\-/]+)(?:\[(\d+)\])? (\w+)")
# The names of modes for vehicle_status.nav_state, in PX4's order; other states have no name.
NAV_STATES = {
    0: "manual",
    1: "altitude",
    2: "position",
    3: "mission",
    4: "hold",
    5: "return",
    6: "position slow",
    10: "acro",
    12: "land",  # descends
    13: "termination",
    14: "offboard",
    15: "stabilised",
    17: "takeoff",
    18: "land",
    19: "follow",
    20: "precision landing",
    21: "orbit",
    22: "vtol takeoff",
    **{22 + number: f"external {number}" for number in range(1, 9)},
}


class UlogLog(Log):
    """The reader of a .ulg file; the system id is the parameter MAV_SYS_ID, or 1 without it."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._system_id = 1
        self._boot_unix_us: int | None = None

    def unix_offset_us(self) -> int | None:
        """Return the offset to UTC from the first valid GPS time, or else the autopilot's clock."""
        for name, fields in self._messages(frozenset(("sensor_gps", "vehicle_gps_position"))):
            if name != "L" and 0 < fields.get("time_utc_usec", 0) < LATEST_US:
                return int(fields["time_utc_usec"] - fields["timestamp"])
        return self._boot_unix_us

    def entries(self) -> Iterator[Entry]:
        """Yield the entries of the file from its beginning."""
        flight = _Flight()

        def convert(name: str, values: Values) -> list[LogEvent]:
            return _CONVERTERS[name](flight, values, values["timestamp"])

        messages = steady(self._messages(frozenset(_CONVERTERS)), "timestamp")
        for event in events_of(self, messages, convert):
            yield Entry(self._system_id, event)

    def _messages(self, names: frozenset[str]) -> Iterator[tuple[str, Values]]:
        """Yield the topic and values of messages of these topics (instance 0); "L" is a text."""
        formats: dict[str, str] = {}
        subscribed = _Subscriptions(names)

        def length_at(data: bytes, at: int, lost: bool) -> int:
            return _length_at(data, at, lost, subscribed.sizes)

        for data, at, length in records(
            self, 2 * LONGEST_BYTES, length_at, _next_start, NO_MESSAGE
        ):
            body = data[at + HEAD_BYTES : at + length]
            match chr(data[at + 2]):
                case "D":
                    topic = subscribed.topics.get(int.from_bytes(body[:2], "little"))
                    if topic is not None:
                        yield topic.name, topic.read(body[2:])
                case "F":
                    name, _, fields = body.decode("utf-8", "replace").partition(":")
                    formats[name] = fields
                case "A" if len(body) > 3:
                    subscribed.subscribe(body, formats)
                case "R" if len(body) == 2:
                    subscribed.topics.pop(int.from_bytes(body[:2], "little"), None)
                case "P" | "I" as kind if len(body) > 1:
                    self._header_value(kind, body)
                case "L" if "L" in names and len(body) > 9:
                    level, at_us = struct.unpack_from("<BQ", body)
                    text = body[9:].decode("utf-8", "replace")
                    yield "L", {"timestamp": at_us, "level": level, "text": text}
                case _:
                    pass

    def _header_value(self, kind: str, body: bytes) -> None:
        """Store the system id from a parameter (P) or the boot time from an info message (I)."""
        key = body[1 : 1 + body[0]]
        if (kind, key) == ("P", b"int32_t MAV_SYS_ID") and len(body) >= 1 + len(key) + 4:
            self._system_id = int.from_bytes(body[1 + len(key) : 5 + len(key)], "little")
        elif (kind, key) == ("I", BOOT_KEY):
            boot_us = int.from_bytes(body[1 + len(key) :], "little")
            self._boot_unix_us = boot_us if 0 < boot_us < LATEST_US else None


class _Subscriptions:
    """The topics by number: the sizes of all topics, and the columns of the requested topics."""

    def __init__(self, names: frozenset[str]) -> None:
        self.topics: dict[int, _Topic] = {}
        self.sizes: dict[int, int] = {}
        self._names = names

    def subscribe(self, body: bytes, formats: dict[str, str]) -> None:
        """Process an ADD_LOGGED message; a message without a known format is ignored."""
        instance, number = struct.unpack_from("<BH", body)
        name = body[3:].decode("utf-8", "replace")
        if name not in formats:
            return
        self.topics.pop(number, None)
        topic = _topic(name, formats)
        if topic is not None:
            self.sizes[number] = topic.size
            if instance == 0 and name in self._names:
                self.topics[number] = topic


def _length_at(data: bytes, at: int, lost: bool, sizes: dict[int, int]) -> int:
    """Return the length of the message at ``at``; 0 if there is no complete message.

    Messages have no checksum. A message is accepted if its length is valid for its kind or its
    topic (``sizes`` by topic number) and another message follows. After damage, three messages must
    follow.
    """
    if data.startswith(MAGIC, at):
        return FILE_HEAD_BYTES if at + FILE_HEAD_BYTES <= len(data) else 0
    offset, first = at, 0
    for number in range(4 if lost else 2):
        if offset == len(data) and number:
            break
        if offset + HEAD_BYTES > len(data) or not _is_valid_length(data, offset, sizes):
            # A truncated message after a complete one does not invalidate the complete one.
            return first if first and len(data) - offset < HEAD_BYTES else 0
        length = HEAD_BYTES + (data[offset] | data[offset + 1] << 8)
        first = first or length
        if offset + length > len(data):
            return first if number else 0
        offset += length
    return first


def _is_valid_length(data: bytes, offset: int, sizes: dict[int, int]) -> bool:
    length, kind = data[offset] | data[offset + 1] << 8, data[offset + 2]
    if kind != DATA:
        return length <= MAX_BYTES.get(kind, -1)
    number = data[offset + HEAD_BYTES : offset + HEAD_BYTES + 2]
    size = sizes.get(number[0] | number[1] << 8) if len(number) == 2 else None
    return size is None or size - PADDING_BYTES < length - 2 <= size


def _next_start(data: bytes, at: int) -> int:
    return at if at < len(data) else -1


class _Topic:
    """The columns of a topic, and the layout of its bytes."""

    def __init__(self, name: str, columns: list[str], letters: str) -> None:
        self.name = name
        self._columns = columns
        self._struct = struct.Struct("<" + letters)
        self.size = self._struct.size

    def read(self, body: bytes) -> Values:
        """Return the values by column; files omit the padding at the end of a topic."""
        size = self._struct.size
        whole = body if len(body) >= size else body.ljust(size, b"\0")
        return dict(zip(self._columns, self._struct.unpack_from(whole), strict=True))


def _topic(name: str, formats: dict[str, str]) -> _Topic | None:
    """Return the topic with this name; None if its format is unknown or contains no time."""
    columns: list[str] = []
    letters: list[str] = []
    if not _flatten(name, "", formats, columns, letters, 0) or "timestamp" not in columns:
        return None
    return _Topic(name, columns, "".join(letters))


def _flatten(
    name: str,
    prefix: str,
    formats: dict[str, str],
    columns: list[str],
    letters: list[str],
    depth: int,
) -> bool:
    """Add a topic's fields, with those of nested topics; return whether all types are known."""
    if name not in formats or depth > 5:
        return False
    for field in filter(None, formats[name].split(";")):
        found = _FIELD.fullmatch(field.strip())
        if found is None:
            return False
        kind, count, path = found[1], found[2], prefix + found[3]
        if kind == "char" or found[3].startswith("_padding"):
            size = int(count or 1) * (1 if kind in ("char", "uint8_t") else 0)
            letters.append(f"{size}x")
            continue
        for number in range(int(count or 1)):
            column = f"{path}[{number}]" if count else path
            if kind in LETTERS:
                columns.append(column)
                letters.append(LETTERS[kind])
            elif not _flatten(kind, f"{column}.", formats, columns, letters, depth + 1):
                return False
    return True


class _Flight:
    """The latest values of a flight, for events that need values from several messages."""

    def __init__(self) -> None:
        self.stack: Stack | None = None
        self.state: tuple[int, bool] | None = None
        self.velocity = (0.0, 0.0, 0.0)
        self.yaw_deg = 0.0
        self.home_amsl_m = math.nan
        self.current: int | None = None
        self.reached: int | None = None
        self.mission: int | None = None
        self._changes = Changes()

    def on_change(self, event: ReportedOnChange) -> list[LogEvent]:
        """Return a list with the event, or an empty list if the state has not changed."""
        return [event] if self._changes.has(event) else []


def _position(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    if not fields.get("lat_lon_valid", True):
        return []
    above_m = fields["alt"] - flight.home_amsl_m
    place = (fields["lat"], fields["lon"], fields["alt"], above_m)
    return [Position(at_us, at_us, *place, *flight.velocity, flight.yaw_deg)]


def _local(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    flight.velocity = (fields["vx"], fields["vy"], fields["vz"])
    return []


def _home(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    flight.home_amsl_m = fields["alt"]
    return []


def _attitude(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    w, x, y, z = (fields[f"q[{number}]"] for number in range(4))
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(min(max(2 * (w * y - z * x), -1.0), 1.0))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    flight.yaw_deg = math.degrees(yaw) % 360.0
    return [Attitude(at_us, at_us, math.degrees(roll), math.degrees(pitch), flight.yaw_deg)]


def _airspeed(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    airspeed_m_s = fields["calibrated_airspeed_m_s"]
    north, east, down = flight.velocity
    airspeed = airspeed_m_s if math.isfinite(airspeed_m_s) else None
    return [Speed(at_us, airspeed, math.hypot(north, east), -down, 0)]


def _wind(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    return [wind_of_air(fields["windspeed_north"], fields["windspeed_east"], at_us)]


def _status(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    found: list[LogEvent] = []
    if flight.stack is None and fields["vehicle_type"] in (ROTARY_WING, FIXED_WING):
        flight.stack = stack_named(
            "px4", "plane" if fields["vehicle_type"] == FIXED_WING else "copter"
        )
        found.append(Connected(at_us, flight.stack))
    mode_name = NAV_STATES.get(fields["nav_state"], "")
    number = next((mode for name, mode in PX4 if name == mode_name), 0)
    state = (number, fields["arming_state"] == ARMED)
    if state != flight.state:
        flight.state = state
        found.append(ModeChanged(at_us, *state, mode_name))
    # As in PX4's heartbeat.
    system = "critical" if fields.get("failsafe") else "active" if state[1] else "standby"
    return [*found, *flight.on_change(SystemState(at_us, system))]


def _landed(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    return flight.on_change(LandedState(at_us, "on ground" if fields["landed"] else "in air"))


def _mission(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    found: list[LogEvent] = []
    reached, current = fields["seq_reached"], fields["seq_current"]
    mission = fields.get("mission_id", fields.get("mission_update_counter"))
    if mission != flight.mission:
        found += [MissionReplaced(at_us)] if flight.mission is not None else []
        flight.mission, flight.reached, flight.current = mission, None, None
    if reached != flight.reached:
        flight.reached = reached
        found += [ItemReached(at_us, reached)] if reached >= 0 else []
    if current != flight.current:
        flight.current = current
        found.append(MissionProgress(at_us, current))
    return found


def _outputs(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    pulses = (fields[f"output[{number}]"] for number in range(min(fields["noutputs"], 16)))
    return [Outputs(at_us, tuple(round(pulse) if math.isfinite(pulse) else 0 for pulse in pulses))]


def _gripper(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    return [GripperMoved(at_us, fields["command"] == 1)]


def _acknowledged(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    return [Acknowledged(at_us, fields["command"], fields["result"])]


def _battery(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    share = fields["remaining"]
    percent = round(100.0 * share) if math.isfinite(share) and share >= 0.0 else None
    voltage_v = round(fields["voltage_v"], 2)
    current_a = round(fields["current_a"], 1) if fields["current_a"] >= 0.0 else None  # -1: unknown
    return flight.on_change(Battery(at_us, 0, percent, voltage_v, current_a))


def _gps(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    return flight.on_change(GpsFix(at_us, fix_name(fields["fix_type"]), fields["satellites_used"]))


def _text(flight: _Flight, fields: Values, at_us: int) -> list[LogEvent]:
    return [Text(at_us, max(fields["level"] - ord("0"), 0), fields["text"].strip())]


_CONVERTERS: dict[str, Callable[[_Flight, Values, int], list[LogEvent]]] = {
    "vehicle_global_position": _position,
    "vehicle_local_position": _local,
    "home_position": _home,
    "vehicle_attitude": _attitude,
    "airspeed_validated": _airspeed,
    "wind": _wind,
    "vehicle_status": _status,
    "vehicle_land_detected": _landed,
    "mission_result": _mission,
    "actuator_outputs": _outputs,
    "gripper": _gripper,
    "vehicle_command_ack": _acknowledged,
    "battery_status": _battery,
    "sensor_gps": _gps,
    "L": _text,
}
