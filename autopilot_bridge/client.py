"""The ground-station side of one vehicle on one link, sans-IO.

Bytes in (``receive_data``), datagrams out (``data_to_send``), one timer (``next_timer``,
``handle_timer``), events (``next_event``). Time is an argument, in microseconds of any clock.
"""

from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.client_events import (
    ClientEvent,
    CommandFinished,
    Connected,
    LinkRestored,
    Rebooted,
    TransferFinished,
)
from autopilot_bridge.codec import Codec, Message
from autopilot_bridge.command import CommandSequence
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem
from autopilot_bridge.jobs import Begin, Job, Jobs, Seen
from autopilot_bridge.stacks import Stack, Step
from autopilot_bridge.transfer import Kind, TransferResult, TransferTiming
from autopilot_bridge.watch import AUTOPILOT, Watch, rate_requests

HEARTBEAT_EVERY_US = 1_000_000


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
        self._own = (system_id, component_id)
        self._target_system = target_system
        self._watch = Watch(heartbeat_timeout_us)
        self._timing = timing or TransferTiming()
        self._codec = Codec(system_id, component_id)
        self._outgoing: list[bytes] = []
        self._events: deque[ClientEvent] = deque()
        self._heartbeat_due_us = 0
        self._jobs = Jobs(self._own, self._timing, self._report)
        self._sequences: list[CommandSequence] = []

    @property
    def stack(self) -> Stack | None:
        """The autopilot, once it was heard."""
        return self._watch.stack

    @property
    def armed(self) -> bool:
        """By its last HEARTBEAT."""
        return self._watch.armed

    @property
    def custom_mode(self) -> int:
        """By its last HEARTBEAT."""
        return self._watch.custom_mode

    # What the user asks for -------------------------------------------------------------------

    def upload(
        self,
        items: tuple[MissionItem, ...],
        now_us: int,
        kind: Kind = "mission",
        begin: Begin = "restart",
        check: bool = False,
        holds_first: bool = False,
        by_file: bool = True,
    ) -> int:
        """Replace the mission, fence or rally points; TransferFinished with the id tells how.

        ``begin`` is the item of a new mission to fly next: its first, the one of the same number
        as now, or a number from 0. ``check`` reads back what was accepted. With ``holds_first`` a
        vehicle that flies its mission holds meanwhile if its autopilot would fly a list that is
        half overwritten; if the upload breaks off it stays there. ``by_file`` is for autopilots
        that take whole missions by MAVFTP. A later upload takes the place of one of its kind that
        has not begun yet.
        """
        job = Job(0, "upload", kind, tuple(items), begin, check, holds_first, by_file)
        return self._add(job, now_us)

    def download(self, now_us: int, kind: Kind = "mission", by_file: bool = True) -> int:
        """Read the mission, fence or rally points; the result carries the items."""
        return self._add(Job(0, "download", kind, by_file=by_file), now_us)

    def clear(self, now_us: int, kind: Kind = "mission") -> int:
        """Remove the mission, fence or rally points."""
        return self._add(Job(0, "clear", kind), now_us)

    def cancel(self, transfer_id: int, now_us: int) -> None:
        """End a transfer; it is reported as cancelled when the autopilot has ended it too."""
        self._send(*self._jobs.cancel(transfer_id, self._known_stack(), now_us))
        self._go_on(now_us)

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
        others = (self._watch.next_timer(), self._jobs.next_timer())
        timers.extend(timer for timer in others if timer is not None)
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
        self._events.extend(self._watch.handle_timer(now_us))
        self._send(*self._jobs.handle_timer(now_us))
        self._go_on(now_us)
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
        events = self._watch.receive(message, now_us)
        self._events.extend(events)
        if any(isinstance(event, Connected | LinkRestored | Rebooted) for event in events):
            self._send(*rate_requests(self._target()))
        if message.get_type() == "HEARTBEAT":
            self._go_on(now_us)
        self._send(*self._jobs.receive(message, now_us))
        self._go_on(now_us)
        if self._sequences:
            self._send(*self._sequences[0].receive(message, now_us))
            self._step_sequences(now_us)

    def _target(self) -> tuple[int, int]:
        return self._target_system or 0, AUTOPILOT

    # Transfers ----------------------------------------------------------------------------------

    def _add(self, job: Job, now_us: int) -> int:
        transfer_id = self._jobs.add(job, now_us)
        self._go_on(now_us)
        return transfer_id

    def _go_on(self, now_us: int) -> None:
        """End what has ended, begin what comes after it."""
        if self.stack is None:
            return
        watch = self._watch
        total = None if watch.total is None else watch.total + watch.hidden_items
        seen = Seen(self.stack, self._target(), watch.current, total, self.armed, self.custom_mode)
        self._send(*self._jobs.step(seen, now_us))
        self._send(*self._jobs.begin_next(seen, now_us))

    def _report(self, job: Job, result: TransferResult, now_us: int) -> None:
        ended = TransferFinished(now_us, job.transfer_id, job.action, result, job.kind)
        self._events.append(ended)

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
