"""The ground-station side of one vehicle on one link, sans-IO.

Bytes in (``receive_data``), datagrams out (``data_to_send``), one timer (``next_timer``,
``handle_timer``), events (``next_event``). Time is an argument, in microseconds of any clock.
"""

from collections import deque
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.client_events import (
    ClientEvent,
    CommandFinished,
    Connected,
    ItemReached,
    LinkLost,
    LinkRestored,
    MissionProgress,
    ModeChanged,
    Position,
    Rebooted,
    Text,
    TransferFinished,
)
from autopilot_bridge.codec import Codec, Message
from autopilot_bridge.command import CommandSequence
from autopilot_bridge.download import MissionClear, MissionDownload, SetCurrent
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem
from autopilot_bridge.stacks import Stack, Step, stack_of
from autopilot_bridge.transfer import Address, TransferResult, TransferTiming, same_mission
from autopilot_bridge.upload import MissionUpload

HEARTBEAT_EVERY_US = 1_000_000
AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
REBOOT_BACK_MS = 5_000
# Message rates asked for once (ArduCopter streams nothing unasked).
RATES_HZ = (
    (mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 4.0),
    (mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, 1.0),
)
Transfer = MissionUpload | MissionDownload | MissionClear | SetCurrent


@dataclass
class _Job:
    """A transfer asked for: what is under way for it now, and what it needs to end well."""

    transfer_id: int
    kind: str
    items: tuple[MissionItem, ...] = ()
    under_way: Transfer | None = None
    wire_items: tuple[MissionItem, ...] = ()


class VehicleClient:
    """One vehicle. ``target_system`` None takes the first autopilot heard."""

    def __init__(
        self,
        system_id: int = 255,
        component_id: int = 190,
        target_system: int | None = 1,
        heartbeat_timeout_us: int = 3_000_000,
        timing: TransferTiming | None = None,
    ) -> None:
        self.stack: Stack | None = None
        self.armed = False
        self.custom_mode = 0
        self._own = (system_id, component_id)
        self._target_system = target_system
        self._heartbeat_timeout_us = heartbeat_timeout_us
        self._timing = timing or TransferTiming()
        self._codec = Codec(system_id, component_id)
        self._outgoing: list[bytes] = []
        self._events: deque[ClientEvent] = deque()
        self._heard_us: int | None = None
        self._lost = False
        self._heartbeat_due_us = 0
        self._boot_ms = 0
        self._current: int | None = None
        self._reached: int | None = None
        self._next_transfer_id = 1
        self._job: _Job | None = None
        self._queue: list[_Job] = []
        self._sequences: list[CommandSequence] = []

    # What the user asks for -------------------------------------------------------------------

    def upload(self, items: tuple[MissionItem, ...], now_us: int) -> int:
        """Replace the mission; the outcome comes as TransferFinished with the id returned.

        A later upload takes the place of one that has not begun yet.
        """
        for waiting in [job for job in self._queue if job.kind == "upload"]:
            self._queue.remove(waiting)
            self._report(waiting, TransferResult("superseded", "a newer mission came"), now_us)
        return self._enqueue("upload", items, now_us)

    def download(self, now_us: int) -> int:
        """Read the mission; the result carries the items."""
        return self._enqueue("download", (), now_us)

    def clear(self, now_us: int) -> int:
        """Remove the mission."""
        return self._enqueue("clear", (), now_us)

    def start_mission(self, now_us: int) -> None:
        """Fly the mission: arm and change mode where needed; outcome as CommandFinished."""
        stack = self._known_stack()
        flying = (stack.set_mode(stack.mission_mode),)
        self._command("start mission", flying if self.armed else stack.start, now_us)

    def hold(self, now_us: int) -> None:
        """Loiter here; outcome as CommandFinished."""
        stack = self._known_stack()
        self._command("hold", (stack.set_mode(stack.hold_mode),), now_us)

    def _known_stack(self) -> Stack:
        if self.stack is None:
            raise BridgeError("no autopilot was heard yet; wait for Connected")
        return self.stack

    # Bytes and time -----------------------------------------------------------------------------

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take in a datagram."""
        for message in self._codec.decode(data):
            if self._from_vehicle(message):
                self._receive(message, now_us)

    def data_to_send(self) -> list[bytes]:
        """Datagrams to send, in order; each is handed out once."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def next_event(self) -> ClientEvent | None:
        """The oldest event not handed out yet."""
        return self._events.popleft() if self._events else None

    def next_timer(self) -> int:
        """When to call ``handle_timer`` next."""
        timers = [self._heartbeat_due_us]
        if self._heard_us is not None and not self._lost:
            timers.append(self._heard_us + self._heartbeat_timeout_us)
        if self._job is not None and self._job.under_way is not None:
            timers.append(self._job.under_way.next_timer())
        timers.extend(sequence.next_timer() for sequence in self._sequences[:1])
        return min(timers)

    def handle_timer(self, now_us: int) -> None:
        """Do what is due."""
        if now_us >= self._heartbeat_due_us:
            self._heartbeat_due_us = now_us + HEARTBEAT_EVERY_US
            self._send(
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3
                )
            )
        if self._heard_us is not None and not self._lost:
            silent_us = now_us - self._heard_us
            if silent_us >= self._heartbeat_timeout_us:
                self._lost = True
                self._events.append(LinkLost(now_us, silent_us))
        if self._job is not None and self._job.under_way is not None:
            self._send(*self._job.under_way.handle_timer(now_us))
            self._step_job(now_us)
        if self._sequences:
            self._send(*self._sequences[0].handle_timer(now_us))
            self._step_sequences(now_us)

    # Messages -----------------------------------------------------------------------------------

    def _from_vehicle(self, message: Message) -> bool:
        if self._target_system is None and message.get_type() == "HEARTBEAT":
            if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
                return False
            self._target_system = message.get_srcSystem()
        source = (message.get_srcSystem(), message.get_srcComponent())
        return source == (self._target_system, AUTOPILOT)

    def _receive(self, message: Message, now_us: int) -> None:
        match message.get_type():
            case "HEARTBEAT":
                self._heartbeat(message, now_us)
            case "GLOBAL_POSITION_INT":
                self._position(message, now_us)
            case "MISSION_CURRENT":
                self._progress(message, now_us)
            case "MISSION_ITEM_REACHED":
                if message.seq != self._reached:
                    self._reached = message.seq
                    self._events.append(ItemReached(now_us, message.seq - self._hidden_items()))
            case "STATUSTEXT":
                self._events.append(Text(now_us, message.severity, message.text))
            case _:
                pass
        if self._job is not None and self._job.under_way is not None:
            self._send(*self._job.under_way.receive(message, now_us))
            self._step_job(now_us)
        if self._sequences:
            self._send(*self._sequences[0].receive(message, now_us))
            self._step_sequences(now_us)

    def _heartbeat(self, message: Message, now_us: int) -> None:
        self._heard_us = now_us
        if self.stack is None:
            self.stack = stack_of(message.autopilot, message.type)
            if self.stack is None:
                return
            self._events.append(Connected(now_us, self.stack))
            self._ask_for_rates()
        if self._lost:
            self._lost = False
            self._events.append(LinkRestored(now_us))
            self._ask_for_rates()
        armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if (armed, message.custom_mode) != (self.armed, self.custom_mode):
            self.armed, self.custom_mode = armed, message.custom_mode
            self._events.append(ModeChanged(now_us, message.custom_mode, armed))
        self._begin_next(now_us)

    def _ask_for_rates(self) -> None:
        for message_id, rate_hz in RATES_HZ:
            command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            params = (float(message_id), 1e6 / rate_hz, 0.0, 0.0, 0.0, 0.0, 0.0)
            self._send(mavlink.MAVLink_command_long_message(*self._target(), command, 0, *params))

    def _position(self, message: Message, now_us: int) -> None:
        if message.time_boot_ms < self._boot_ms - REBOOT_BACK_MS:
            self._current = self._reached = None
            self._events.append(Rebooted(now_us))
            self._ask_for_rates()
        elif message.time_boot_ms <= self._boot_ms:
            return  # late or doubled on the way
        self._boot_ms = message.time_boot_ms
        heading = message.hdg / 100.0 if message.hdg != 65535 else 0.0
        self._events.append(
            Position(
                now_us,
                message.time_boot_ms * 1000,
                message.lat / 1e7,
                message.lon / 1e7,
                message.alt / 1e3,
                message.relative_alt / 1e3,
                message.vx / 100.0,
                message.vy / 100.0,
                message.vz / 100.0,
                heading,
            )
        )

    def _progress(self, message: Message, now_us: int) -> None:
        if message.seq != self._current:
            self._current = message.seq
            self._events.append(MissionProgress(now_us, message.seq - self._hidden_items()))

    def _hidden_items(self) -> int:
        """Items the user does not know of: ArduPilot's home."""
        return 1 if self.stack is not None and self.stack.item_0_is_home else 0

    # Transfers ----------------------------------------------------------------------------------

    def _target(self) -> tuple[int, int]:
        return self._target_system or 0, AUTOPILOT

    def _enqueue(self, kind: str, items: tuple[MissionItem, ...], now_us: int) -> int:
        job = _Job(self._next_transfer_id, kind, items)
        self._next_transfer_id += 1
        self._queue.append(job)
        self._begin_next(now_us)
        return job.transfer_id

    def _begin_next(self, now_us: int) -> None:
        if self._job is not None or not self._queue or self.stack is None:
            return
        job = self._job = self._queue.pop(0)
        address = Address(self._own, self._target())
        match job.kind:
            case "upload":
                hidden = self._hidden_items()
                job.wire_items = (*job.items[:hidden], *job.items)
                self._begin(MissionUpload(address, job.wire_items, hidden, self._timing), now_us)
            case "download":
                self._begin(MissionDownload(address, self._timing), now_us)
            case _:
                self._begin(MissionClear(address, self._timing), now_us)

    def _begin(self, transfer: Transfer, now_us: int) -> None:
        assert self._job is not None
        self._job.under_way = transfer
        self._send(*transfer.start(now_us))

    def _step_job(self, now_us: int) -> None:
        """See whether what is under way has ended, and what comes after it."""
        job = self._job
        if job is None or job.under_way is None or job.under_way.result is None:
            return
        result = job.under_way.result
        following = self._after(job, job.under_way, result)
        if isinstance(following, TransferResult):
            self._job = None
            self._report(job, following, now_us)
            self._begin_next(now_us)
        else:
            self._begin(following, now_us)

    def _after(
        self, job: _Job, ended: Transfer, result: TransferResult
    ) -> Transfer | TransferResult:
        """The next part of a job, or its result."""
        address = Address(self._own, self._target())
        hidden = self._hidden_items()
        if job.kind == "download" and result.items is not None:
            return TransferResult("accepted", result.reason, items=result.items[hidden:])
        if job.kind != "upload":
            return result
        match ended:
            case MissionUpload() if result.outcome == "unknown":
                return MissionDownload(address, self._timing)  # never guess: read it back
            case MissionUpload() if result.outcome == "accepted" and job.items:
                # ArduPilot flies its old target on until told; PX4 may begin elsewhere.
                return SetCurrent(address, hidden, self._timing)
            case MissionDownload() if result.items is None:
                return TransferResult("unknown", f"no acknowledgement came, and {result.reason}")
            case MissionDownload():
                if not same_mission(job.wire_items, result.items or (), hidden == 1):
                    return TransferResult("failed", "the vehicle holds another mission")
                return SetCurrent(address, hidden, self._timing)
            case SetCurrent() if result.outcome == "accepted":
                return TransferResult("accepted", "accepted", items=job.items)
            case SetCurrent():
                return TransferResult(
                    "failed", "the vehicle holds the mission but did not begin it"
                )
            case _:
                return result

    def _report(self, job: _Job, result: TransferResult, now_us: int) -> None:
        self._events.append(TransferFinished(now_us, job.transfer_id, job.kind, result))

    # Commands -----------------------------------------------------------------------------------

    def _command(self, name: str, steps: tuple[Step, ...], now_us: int) -> None:
        self._sequences.append(CommandSequence(name, self._target(), steps, self._timing))
        if len(self._sequences) == 1:
            self._send(*self._sequences[0].start(now_us))

    def _step_sequences(self, now_us: int) -> None:
        outcome = self._sequences[0].outcome
        if outcome is None:
            return
        ended = self._sequences.pop(0)
        self._events.append(CommandFinished(now_us, ended.name, *outcome))
        if self._sequences:
            self._send(*self._sequences[0].start(now_us))

    def _send(self, *messages: Message) -> None:
        self._outgoing.extend(self._codec.encode(message) for message in messages)
