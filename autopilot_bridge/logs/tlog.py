"""Reads MAVLink telemetry logs, whose records are a time (big-endian uint64) and one frame.

The time is in microseconds since 1970, as written by MAVProxy, QGroundControl, Mission Planner,
pymavlink and ``links/tlog_writer.py``. MAVProxy stores the number of the link in the lowest two
bits of the time. Only frames with a correct checksum are accepted. A message of another dialect is
skipped by its length if another record follows. If a simulator ran faster or slower than the
recorder's clock, the time is derived from the autopilots' time since boot (``entry_times.py``).
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Codec, Message, item_of
from autopilot_bridge.links.field_limits import list_out_of_bounds, out_of_bounds
from autopilot_bridge.links.framing import (
    STARTS,
    frame_length,
    in_dialect,
    message_id_of,
    source_of,
)
from autopilot_bridge.logs.entries import (
    LATEST_US,
    Acknowledged,
    Entry,
    GripperMoved,
    Log,
    LogEvent,
    MissionLoaded,
    Outputs,
)
from autopilot_bridge.logs.entry_times import FlightTime, Sample, rate_of
from autopilot_bridge.logs.record_scanner import LEAP_US, records
from autopilot_bridge.missions.ftp_packet import ACK, CREATE, TERMINATE, WRITE, packet_of
from autopilot_bridge.missions.mission_file import PATHS, decode_mission_file
from autopilot_bridge.vehicle.client_events import AlarmEnded, ClientEvent, LinkAlarm
from autopilot_bridge.vehicle.monitor import AUTOPILOT, VehicleMonitor
from autopilot_bridge.vehicle.statustext import StatustextAssembler
from autopilot_bridge.vehicle.telemetry import MESSAGES

STAMP_BYTES = 8
LONGEST_BYTES = STAMP_BYTES + 280
LINK_BITS = 3
NO_RECORD = "not a timestamp followed by a MAVLink frame"
MISSION_FILE = PATHS[mavlink.MAV_MISSION_TYPE_MISSION]
MAX_FILE_BYTES = 4_000_000
POSITION = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
MAX_SURVEYED = 30_000  # number of records from which the rate of the autopilots' clocks is computed
_OTHERS = (
    "HEARTBEAT",
    "MISSION_CURRENT",
    "MISSION_ITEM_REACHED",
    "STATUSTEXT",
    "SERVO_OUTPUT_RAW",
    "COMMAND_ACK",
    "COMMAND_LONG",
    "MISSION_COUNT",
    "MISSION_ITEM",
    "MISSION_ITEM_INT",
    "MISSION_ACK",
    "FILE_TRANSFER_PROTOCOL",
)
MESSAGE_IDS = frozenset(
    message_class.id
    for message_class in mavlink.mavlink_map.values()
    if message_class.msgname in MESSAGES or message_class.msgname in _OTHERS
)


class TlogLog(Log):
    """The reader of a .tlog file; systems that send frames from component 1 count as vehicles."""

    def unix_offset_us(self) -> int | None:
        """Return 0, because the timestamps are microseconds since 1970."""
        return 0

    def entries(self) -> Iterator[Entry]:
        """Yield the entries; a link counts as lost after three seconds without a HEARTBEAT."""
        codec, vehicles = Codec(255, 0), dict[int, _Vehicle]()
        missions = _Missions()
        time = FlightTime(rate_of(TlogLog(self.path)._samples()))
        for frame, stamp_us in self._frames():
            decoded = codec.decode_frames([frame])
            if not decoded:
                continue
            message, (system_id, component_id) = decoded[0], source_of(frame)
            own = component_id == AUTOPILOT
            at_us = time.flight_us(stamp_us, system_id, _boot_us(message) if own else None)
            yield from missions.receive(message, at_us, vehicles)
            if own:
                if system_id not in vehicles:
                    vehicles[system_id] = _Vehicle()
                for event in vehicles[system_id].receive(message, at_us):
                    yield Entry(system_id, event)

    def _frames(self) -> Iterator[tuple[bytes, int]]:
        """Yield the frames whose message ids are in ``MESSAGE_IDS``, with their timestamps."""
        latest_us: int | None = None
        for data, at, length in records(
            self, LONGEST_BYTES, _record_length, _next_start, NO_RECORD
        ):
            frame = data[at + STAMP_BYTES : at + length]
            if message_id_of(frame) not in MESSAGE_IDS:
                continue
            at_us = int.from_bytes(data[at : at + STAMP_BYTES], "big") & ~LINK_BITS
            if latest_us is None or not -LEAP_US <= at_us - latest_us <= LEAP_US:
                at_us = _without_leap(
                    at_us, latest_us, data[at + length : at + length + STAMP_BYTES]
                )
            latest_us = at_us
            yield frame, at_us

    def _samples(self) -> Iterator[Sample]:
        """Yield the autopilots' times since boot in the first records, with their timestamps."""
        codec = Codec(255, 0)
        for frame, stamp_us in islice(self._frames(), MAX_SURVEYED):
            system_id, component_id = source_of(frame)
            if message_id_of(frame) != POSITION or component_id != AUTOPILOT:
                continue
            for message in codec.decode_frames([frame]):
                yield system_id, stamp_us, message.time_boot_ms * 1000


def _boot_us(message: Message) -> int | None:
    boot_ms: int | None = getattr(message, "time_boot_ms", None)
    return None if boot_ms is None else boot_ms * 1000


def _without_leap(at_us: int, latest_us: int | None, after: bytes) -> int:
    """Return a record's time, or a neighbouring record's time if only this record's time leaps."""
    if len(after) < STAMP_BYTES:
        return at_us if latest_us is None else latest_us
    after_us = int.from_bytes(after, "big") & ~LINK_BITS
    if abs(after_us - at_us) <= LEAP_US:
        return at_us
    return after_us if latest_us is None else latest_us


def _record_length(data: bytes, at: int, lost: bool) -> int:
    """Return the length of the record at ``at``; 0 if no record begins there."""
    begin = at + STAMP_BYTES
    if begin >= len(data) or data[begin] not in STARTS:
        return 0
    stamp = int.from_bytes(data[at:begin], "big")
    if not 0 <= stamp < LATEST_US:
        return 0
    length = frame_length(data, begin, True)
    if length:
        return STAMP_BYTES + length
    return _length_unknown(data, begin)


def _length_unknown(data: bytes, begin: int) -> int:
    """Return the length of a record in another dialect; 0 unless a record or the end follows."""
    header = data[begin : begin + 10]
    if len(header) < 10 or in_dialect(message_id_of(header)):
        return 0
    version_2 = header[0] == mavlink.PROTOCOL_MARKER_V2
    length = header[1] + (12 + (13 if header[2] & 1 else 0) if version_2 else 8)
    follows = begin + length + STAMP_BYTES
    if follows < len(data):
        return STAMP_BYTES + length if data[follows] in STARTS else 0
    return STAMP_BYTES + length if begin + length == len(data) else 0


def _next_start(data: bytes, at: int) -> int:
    """Return the next offset at which a record may begin."""
    offsets = (data.find(start, at + STAMP_BYTES) for start in STARTS)
    return min((offset - STAMP_BYTES for offset in offsets if offset >= 0), default=-1)


class _Vehicle:
    """One vehicle in the log: the monitor of its state and the assembler of its texts."""

    def __init__(self) -> None:
        self.monitor = VehicleMonitor()
        self._texts = StatustextAssembler()

    def receive(self, message: Message, at_us: int) -> list[LogEvent]:
        """Return the events of a message of this vehicle."""
        events: list[ClientEvent] = []
        due_us = self.monitor.next_timer()
        if due_us is not None and at_us >= due_us:
            events += self.monitor.handle_timer(at_us)
        kind = message.get_type()
        if kind == "SERVO_OUTPUT_RAW":
            return [*events, _outputs(message, at_us)]  # type: ignore[list-item]
        if kind == "COMMAND_ACK":
            return [*events, Acknowledged(at_us, message.command, message.result)]  # type: ignore[list-item]
        if kind in ("HEARTBEAT", "STATUSTEXT"):
            for whole in self._texts.receive(message):
                events += self.monitor.receive(whole, at_us)
        else:
            events += self.monitor.receive(message, at_us)
        return [event for event in events if not isinstance(event, LinkAlarm | AlarmEnded)]  # type: ignore[misc]


def _outputs(message: Message, at_us: int) -> Outputs:
    return Outputs(at_us, tuple(getattr(message, f"servo{number}_raw") for number in range(1, 17)))


class _Missions:
    """The missions that any station transfers over the link, in either direction."""

    def __init__(self) -> None:
        self._incoming: dict[tuple[int, int], dict[int, MissionItem]] = {}
        self._count: dict[tuple[int, int], int] = {}
        self._files: dict[tuple[int, int], bytearray] = {}  # written by MAVFTP (ArduPilot)

    def receive(self, message: Message, at_us: int, vehicles: dict[int, _Vehicle]) -> list[Entry]:
        """Return MissionLoaded after an acknowledged transfer, or GripperMoved for a DO_GRIPPER."""
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            if message.command == mavlink.MAV_CMD_DO_GRIPPER:
                return [Entry(message.target_system, GripperMoved(at_us, message.param2 == 0.0))]
            return []
        if kind == "FILE_TRANSFER_PROTOCOL":
            return self._file(message, at_us, vehicles)
        if not kind.startswith("MISSION_") or getattr(message, "mission_type", False):
            return []
        direction = (message.get_srcSystem(), getattr(message, "target_system", 0))
        match kind:
            case "MISSION_COUNT":
                self._incoming[direction], self._count[direction] = {}, message.count
            case "MISSION_ITEM_INT" | "MISSION_ITEM" if direction in self._incoming:
                if message.seq < self._count[direction] and out_of_bounds(message) is None:
                    self._incoming[direction][message.seq] = _item(message)
            case "MISSION_ACK" if message.type == mavlink.MAV_MISSION_ACCEPTED:
                return self._complete(direction[::-1], at_us, vehicles)
            case _:
                pass
        return []

    def _file(self, message: Message, at_us: int, vehicles: dict[int, _Vehicle]) -> list[Entry]:
        """Return MissionLoaded when a mission file written by MAVFTP is closed."""
        packet = packet_of(message)
        direction = (message.get_srcSystem(), message.target_system)
        if packet.opcode == CREATE and packet.data.rstrip(b"\0").decode("latin-1") == MISSION_FILE:
            self._files[direction] = bytearray()
        elif packet.opcode == WRITE and direction in self._files:
            file = self._files[direction]
            if packet.offset <= MAX_FILE_BYTES:
                file.extend(bytes(max(packet.offset + len(packet.data) - len(file), 0)))
                file[packet.offset : packet.offset + len(packet.data)] = packet.data
        elif packet.opcode == ACK and packet.asked == TERMINATE:
            file = self._files.pop(direction[::-1], bytearray())
            if not file or direction[0] not in vehicles:
                return []
            try:
                items = decode_mission_file(bytes(file), mavlink.MAV_MISSION_TYPE_MISSION)
            except BridgeError:  # an incomplete file, which the vehicle has also rejected
                return []
            if list_out_of_bounds(items):
                return []
            hidden = vehicles[direction[0]].monitor.hidden_items
            return [Entry(direction[0], MissionLoaded(at_us, tuple(items[hidden:])))]
        return []

    def _complete(
        self, direction: tuple[int, int], at_us: int, vehicles: dict[int, _Vehicle]
    ) -> list[Entry]:
        items, count = self._incoming.pop(direction, {}), self._count.pop(direction, 0)
        vehicle = direction[0] if direction[0] in vehicles else direction[1]
        if not count or len(items) < count or vehicle not in vehicles:
            return []
        hidden = vehicles[vehicle].monitor.hidden_items
        user = tuple(items[seq] for seq in range(hidden, count))
        return [Entry(vehicle, MissionLoaded(at_us, user))]


def _item(message: Message) -> MissionItem:
    item = item_of(message)
    if message.get_type() == "MISSION_ITEM_INT":
        return item
    return replace(item, x=round(float(message.x) * 1e7), y=round(float(message.y) * 1e7))
