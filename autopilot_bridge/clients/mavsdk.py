"""Implements a client with MAVSDK, an alternative to ``NativeClient`` with a ``Connection``.

MAVSDK (a C library in this process) receives the bytes from the ``Connection``. MAVSDK detects the
vehicle, transfers missions and repeats commands. This module adds three steps that real autopilots
require. A mission is checked before its upload, because ArduPilot keeps a truncated mission after a
rejected item. After the upload the mission is read back, because MAVSDK's result does not prove
success. The mission is then started by commanding an item, because ArduPlane flies to its old
target until an item is commanded. MAVSDK's ``set_current_mission_item`` is not used: if the
autopilot reports another number, that function repeats the request endlessly and without delay.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable
from typing import Self

from autopilot_bridge.clients.mavsdk_commands import MavsdkCommands
from autopilot_bridge.clients.mavsdk_library import MAVSDK_IDS, library
from autopilot_bridge.clients.mavsdk_system import MavsdkSystem
from autopilot_bridge.clients.mavsdk_transfers import Job, MavsdkTransfers
from autopilot_bridge.clients.shared_link import HEARTBEAT_TIMEOUT_US, is_of_autopilot
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import Items
from autopilot_bridge.links.asyncio_connection import Connection, Port, RemotesPeer
from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.links.framing import frames_of, source_of
from autopilot_bridge.links.signing import Signing
from autopilot_bridge.links.tlog_writer import Tlog
from autopilot_bridge.missions.transfer import TransferResult, TransferTiming
from autopilot_bridge.stacks.stacks import Stack, Step
from autopilot_bridge.vehicle.camera_telemetry import CameraEvent, camera_event
from autopilot_bridge.vehicle.client_events import (
    ClientEvent,
    CommandFinished,
    Connected,
    DropFinished,
    LinkRestored,
    ModeChanged,
    Rebooted,
    RemoteIdStatus,
    TransferFinished,
)
from autopilot_bridge.vehicle.command_queue import ParameterQueue
from autopilot_bridge.vehicle.message_rates import rate_requests
from autopilot_bridge.vehicle.monitor import AUTOPILOT, VehicleMonitor
from autopilot_bridge.vehicle.orders import Dropper, OrderContext, order_named
from autopilot_bridge.vehicle.remote_binding import RemoteBinding
from autopilot_bridge.vehicle.remote_id import RemoteIdMonitor, is_of_remote_id
from autopilot_bridge.vehicle.transfer_states import StartItem

NOT_FOUND = "MAVSDK has not detected the vehicle"
NOT_SUPPORTED = 'MAVSDK supports only missions; use backend = "native"'


class MavsdkClient(RemotesPeer):
    """A ``VehicleClient`` and its link, while the context (``async with``) is open.

    Args:
        link: The address of the link; no other vehicle may use it.
        system_id: The vehicle's MAVLink system id.
        clock: Returns the link's time in microseconds.
        tlog: Records the frames sent and received; the caller closes it.
        signing: Signs all sent frames; received frames without a valid signature are dropped.
        link_id: The link id in signatures, 0 to 255.
        max_speed_m_s: Positions that imply a higher speed are discarded; None means no limit.

    Raises:
        BridgeError: The link is not valid, or cannot be opened (on entering the context).
    """

    def __init__(
        self,
        link: str,
        system_id: int,
        clock: Callable[[], int],
        tlog: Tlog | None = None,
        signing: Signing | None = None,
        link_id: int = 0,
        max_speed_m_s: float | None = None,
    ) -> None:
        self.called = {}
        self._signed = signing is not None
        self._source: RemoteBinding | None = None
        self._connection = Connection(
            link, self, clock, tlog=tlog, signing=signing, link_id=link_id
        )
        self._link = link
        self._clock = clock
        self._target = (system_id, AUTOPILOT)
        self._monitor = VehicleMonitor(HEARTBEAT_TIMEOUT_US, max_speed_m_s)
        self._remote_id = RemoteIdMonitor()
        self._codec = Codec(*MAVSDK_IDS)
        self._outgoing: list[bytes] = []
        self._events: deque[ClientEvent] = deque()
        self._waiting: list[Job] = []
        self._next_id = 1
        self._last_command = 0
        self._transfer_added = asyncio.Event()
        self._commands: asyncio.Queue[tuple[int, str, tuple[Step, ...]]] = asyncio.Queue()
        self._tasks: list[asyncio.Task[None]] = []
        self._parameters = ParameterQueue(TransferTiming(), self._report)
        self._system = MavsdkSystem(system_id, clock)
        parts = (self._monitor, self._target, clock)
        self._sender = MavsdkCommands(self._system, *parts)
        self._transfers = MavsdkTransfers(self._system, self._sender, *parts)

    # Requests of the user ---------------------------------------------------------------------

    @property
    def stack(self) -> Stack | None:
        """The autopilot's stack; None until its first HEARTBEAT."""
        return self._monitor.stack

    @property
    def ports(self) -> tuple[Port, ...]:
        """The link, with the numbers of received frames by outcome; see ``Connection``."""
        return self._connection.ports

    def upload(
        self, items: Items, now_us: int, *, begin: StartItem = "restart", holds_first: bool = False
    ) -> int:
        """Replace the mission; see ``NativeClient.upload``."""
        for waiting in [job for job in self._waiting if job.action == "upload"]:
            self._waiting.remove(waiting)
            ended = TransferResult("superseded", "a newer upload replaced it", holds="the old one")
            self._events.append(TransferFinished(now_us, waiting.transfer_id, "upload", ended))
        return self._add(Job(0, "upload", tuple(items), begin, holds_first))

    def download(self, now_us: int) -> int:
        """Read the mission; the result contains the items."""
        return self._add(Job(0, "download"))

    def clear(self, now_us: int) -> int:
        """Remove the mission."""
        return self._add(Job(0, "clear"))

    def command(self, name: str, now_us: int, *arguments: float | str) -> int:
        """Execute a command from ``orders.ORDERS``; CommandFinished reports the outcome.

        A command that MAVSDK cannot send is reported as not accepted.
        """
        steps = order_named(name).through_mavsdk
        self._last_command += 1
        if steps is None:
            finished = CommandFinished(now_us, name, False, NOT_SUPPORTED, self._last_command)
            self._report(finished)
        else:
            context = OrderContext(self._connected_stack(), self._monitor.armed)
            self._commands.put_nowait((self._last_command, name, steps(context, *arguments)))
        return self._last_command

    def read_parameter(self, name: str, now_us: int) -> int:
        """Read one parameter without MAVSDK, which does not report unknown names."""
        request_id = self._parameters.read(name, self._target, self._connected_stack())
        self._send_own(self._parameters.start_next(now_us))
        return request_id

    def drop(self, dropper: Dropper, now_us: int) -> int:
        """Report the drop as refused, because MAVSDK cannot send drops."""
        self._report(DropFinished(now_us, 0, "refused", NOT_SUPPORTED))
        return 0

    def next_event(self) -> ClientEvent | None:
        """Remove and return the oldest pending event; None if no event is pending."""
        return self._events.popleft() if self._events else None

    def _connected_stack(self) -> Stack:
        if self.stack is None:
            raise BridgeError("no autopilot is connected yet; wait for the event Connected")
        return self.stack

    def _add(self, job: Job) -> int:
        job.transfer_id = self._next_id
        self._next_id += 1
        self._waiting.append(job)
        self._transfer_added.set()
        return job.transfer_id

    # The link ---------------------------------------------------------------------------------

    async def __aenter__(self) -> Self:
        library()  # before the link opens, because the import may fail
        await self._connection.__aenter__()
        self._system.open(self._send)
        for work in (self._transfer_all(), self._command_all()):
            task = asyncio.create_task(work)
            task.add_done_callback(self._stopped)
            self._tasks.append(task)
        return self

    async def __aexit__(self, *error: object) -> None:
        for task in self._tasks:
            task.cancel()
        await self._system.close()
        await self._connection.__aexit__(*error)

    async def wait(self) -> None:
        """Wait until there may be events; raise an error of the link or of this client."""
        await self._connection.wait()

    def flush(self) -> None:
        """Send all pending frames."""
        self._connection.flush()

    def _stopped(self, task: asyncio.Task[None]) -> None:
        failure = None if task.cancelled() else task.exception()
        if isinstance(failure, Exception):
            self._connection.raise_in_wait(failure)

    def _send_own(self, messages: Iterable[Message]) -> None:
        """Queue messages that MAVSDK does not send."""
        self._outgoing.extend(self._codec.encode(message) for message in messages)

    def _send(self, data: bytes) -> None:
        self._outgoing.append(data)
        self._connection.flush()

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process frames from a link that has one remote."""
        self.receive_frames("", frames_of(data), now_us, 0)

    def receive_copies(self, remote: str, frames: list[bytes], now_us: int, link: int) -> None:
        """Ignore copies, because this client has only one link."""

    def receive_frames(self, remote: str, frames: list[bytes], now_us: int, link: int) -> None:
        """Pass frames from the vehicle's remote to MAVSDK and to the client's own monitor.

        MAVSDK receives frames only after a HEARTBEAT has identified the remote. Frames with a value
        out of bounds are not passed on.
        """
        if self._source is None:
            self._source = RemoteBinding(
                HEARTBEAT_TIMEOUT_US, self.called.get(link, ""), self._signed
            )
        source = self._source
        for frame in frames:
            messages = self._codec.decode_frames([frame])
            if source_of(frame) == self._target and messages:
                accepted = source.accepts(remote, is_of_autopilot(messages[0]), now_us)
                self._events.extend(source.alarms)
                source.alarms.clear()
                if not accepted:
                    continue
                self._receive(messages[0], now_us)
                if not self._monitor.used:
                    continue
            if remote == source.remote:
                self._events.extend(
                    event for each in messages for event in self._component(each, now_us)
                )
                self._system.receive_frame(frame)

    def _component(self, message: Message, now_us: int) -> list[CameraEvent | RemoteIdStatus]:
        """Return the events of a message from the vehicle's camera, gimbal or Remote ID module."""
        if message.get_srcSystem() != self._target[0] or self.stack is None:
            return []
        if is_of_remote_id(message):
            return [*self._remote_id.receive(message, now_us)]
        event = camera_event(message, now_us)
        return [] if event is None else [event]

    def _receive(self, message: Message, now_us: int) -> None:
        mode = self._monitor.custom_mode
        events = self._monitor.receive(message, now_us)
        self._sender.receive(message)
        self._transfers.receive(message, now_us)
        for event in events:
            if isinstance(event, ModeChanged) and event.custom_mode != mode:
                self._mode_changed(event.custom_mode, now_us)
        self._events.extend(events)
        self._send_own(self._parameters.receive(message, now_us))
        announcements = any(
            isinstance(event, Connected | LinkRestored | Rebooted) for event in events
        )
        if announcements and self.stack is not None:
            self._send_own(rate_requests(self.stack, self._target))

    def _mode_changed(self, mode: int, now_us: int) -> None:
        """Process a mode change; a change that was not commanded ends the start of a mission."""
        if self.stack is None:
            return
        override = self._sender.mode_changed(self.stack, mode, now_us)
        if override is not None:
            self._transfers.stop_start(override)

    def data_to_send(self) -> list[bytes]:
        """Remove and return the frames to send."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def addressed_to_send(self) -> list[tuple[int, str, bytes]]:
        """Return the frames to send, each with link 0 and the vehicle's remote; "" means all."""
        source = self._source
        remote = "" if source is None or source.remote is None else source.remote
        return [(0, remote, frame) for frame in self.data_to_send()]

    def next_timer(self) -> int | None:
        """Return the time of the next ``handle_timer`` call."""
        alarms_us = None if self._source is None else self._source.alarm_timer()
        timers = (
            self._monitor.next_timer(),
            self._monitor.alarm_timer(),
            self._remote_id.next_timer(),
            self._parameters.next_timer(),
            alarms_us,
        )
        return min((timer for timer in timers if timer is not None), default=None)

    def handle_timer(self, now_us: int) -> None:
        """Report a lost link and the alarms that have ended; repeat requests for parameters."""
        self._events.extend(self._monitor.handle_timer(now_us))
        self._send_own(self._parameters.handle_timer(now_us))
        self._events.extend(self._monitor.end_alarms(now_us))
        self._events.extend(self._remote_id.handle_timer(now_us))
        if self._source is not None:
            self._source.handle_timer(now_us)
            self._events.extend(self._source.alarms)
            self._source.alarms.clear()

    def _report(self, event: ClientEvent) -> None:
        self._events.append(event)
        self._connection.notify()

    # Commands and transfers -------------------------------------------------------------------

    async def _command_all(self) -> None:
        while True:
            command_id, name, steps = await self._commands.get()
            accepted, reason = False, NOT_FOUND
            if await self._system.detected():
                accepted, reason = await self._sender.send_steps(steps, self._connected_stack())
            self._report(CommandFinished(self._clock(), name, accepted, reason, command_id))

    async def _transfer_all(self) -> None:
        while True:
            await self._transfer_added.wait()
            found = await self._system.detected()
            if not self._waiting:
                self._transfer_added.clear()
                continue
            job = self._waiting.pop(0)
            result = TransferResult("failed", NOT_FOUND, holds="the old one")
            if found:
                result = await self._transfers.transfer(job, self._connected_stack())
            self._report(TransferFinished(self._clock(), job.transfer_id, job.action, result))
