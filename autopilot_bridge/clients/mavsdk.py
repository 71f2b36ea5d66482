"""Implements a vehicle client with MAVSDK, to replace ``NativeClient`` and its ``Connection``.

MAVSDK (a C library in this process) receives the bytes from our link. It detects the vehicle,
transfers missions and repeats commands. This module adds three steps that real autopilots require.
A mission is checked before its upload, because ArduPilot keeps a truncated mission after a rejected
item. After the upload the mission is read back, because MAVSDK's result does not prove the upload.
The mission is then started by an item number, because ArduPlane flies to its old target until an
item is commanded. MAVSDK's ``set_current_mission_item`` is not used: if the autopilot reports
another number, the function repeats its request without end and without delay.
"""

import asyncio
import json
from collections import deque
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, replace
from typing import Any, Literal, Self, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.mavsdk_library import (
    ACCEPTED,
    MAVSDK_IDS,
    library,
    raw_items,
    raw_message,
    upload_result,
)
from autopilot_bridge.clients.shared_link import HEARTBEAT_TIMEOUT_US, is_of_autopilot
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import Items, jumps_moved
from autopilot_bridge.links.codec import Codec, Message, item_of
from autopilot_bridge.links.connection import Connection
from autopilot_bridge.links.framing import frames_of, source_of
from autopilot_bridge.links.signing import Counts, Signing
from autopilot_bridge.links.tlog_writer import Tlog
from autopilot_bridge.missions.check import check
from autopilot_bridge.missions.plan_id import mission_id_of
from autopilot_bridge.missions.transfer import Address, TransferResult, TransferTiming
from autopilot_bridge.stacks.stacks import Stack, Step
from autopilot_bridge.vehicle.client_events import (
    ClientEvent,
    CommandFinished,
    Connected,
    DropFinished,
    LinkRestored,
    ModeChanged,
    Rebooted,
    TransferFinished,
)
from autopilot_bridge.vehicle.command_sequence import command_message, result_words
from autopilot_bridge.vehicle.commanded_modes import CommandedModes, modes_of_step
from autopilot_bridge.vehicle.message_rates import rate_requests
from autopilot_bridge.vehicle.mission_activation import MissionActivation, Onboard
from autopilot_bridge.vehicle.mode_change import changed_meanwhile
from autopilot_bridge.vehicle.monitor import AUTOPILOT, VehicleMonitor
from autopilot_bridge.vehicle.orders import Dropper, OrderContext, order_named
from autopilot_bridge.vehicle.remote_binding import RemoteBinding
from autopilot_bridge.vehicle.transfer_queue import LAST_NAV
from autopilot_bridge.vehicle.transfer_states import StartItem

POLL_INTERVAL_S = 0.05
REPLY_TIMEOUT_S = 1.5
DETECTION_TIMEOUT_S = 10.0
NOT_FOUND = "MAVSDK has not detected the vehicle"
CALL_TIMEOUT_S = 120.0  # longer than the transfer of the longest mission by a slow radio
NO_ANSWER = "NO_ANSWER"  # the result of a call that does not return
NOT_SUPPORTED = "MAVSDK supports only missions; use backend native"
CLOSE_TIMEOUT_S = 5.0  # time for active transfers to end when the service stops
Result = TypeVar("Result")


@dataclass
class Job:
    """A transfer that was requested."""

    transfer_id: int
    action: Literal["upload", "download", "clear"]
    items: Items = ()
    begin: StartItem = "restart"
    holds_first: bool = False


class MavsdkClient:
    """A ``VehicleClient`` and its link, while the context (``async with``) is open.

    Args:
        link: The address of the link; no other vehicle may use it.
        system_id: The vehicle's MAVLink system id.
        clock: Returns the link's time in microseconds.
        tlog: Records the frames sent and received; the caller closes it.
        signing: Signs all sent frames; received frames without a valid signature are dropped.
        link_id: The link id of signatures, 0 to 255.
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
        self.called = ""  # the remote to which the link connects
        self._signed = signing is not None
        self._source: RemoteBinding | None = None
        self._connection = Connection(
            link, self, clock, tlog=tlog, signing=signing, link_id=link_id
        )
        self._link = link
        self._clock = clock
        self._target = (system_id, AUTOPILOT)
        self._monitor = VehicleMonitor(HEARTBEAT_TIMEOUT_US, max_speed_m_s)
        self._codec = Codec(*MAVSDK_IDS)
        self._outgoing: list[bytes] = []
        self._events: deque[ClientEvent] = deque()
        self._waiting: list[Job] = []
        self._next_id = 1
        self._last_command = 0
        self._transfer_added = asyncio.Event()
        self._commands: asyncio.Queue[tuple[int, str, tuple[Step, ...]]] = asyncio.Queue()
        self._begin: MissionActivation | None = None  # the start that is in progress
        self._commanded_modes = CommandedModes()
        self._overrides: list[str] = []  # descriptions of mode changes by the autopilot or a pilot
        self._heartbeats = 0
        self._mavsdk: Any = None
        self._missions: Any = None
        self._direct: Any = None
        self._tasks: list[asyncio.Task[None]] = []
        self._calls: set[asyncio.Task[Any]] = set()

    # Requests of the user ---------------------------------------------------------------------

    @property
    def stack(self) -> Stack | None:
        """The autopilot's stack; None until its first HEARTBEAT."""
        return self._monitor.stack

    @property
    def counts(self) -> Counts:
        """The numbers of received frames on the link, by outcome; see ``Connection``."""
        return self._connection.counts

    @property
    def receives_signed(self) -> bool:
        """Whether received frames are signed while signatures are not checked."""
        return self._connection.receives_signed

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

    def drop(self, dropper: Dropper, now_us: int) -> int:
        """Refuse the drop by a DropFinished, because MAVSDK cannot send drops."""
        self._report(DropFinished(now_us, 0, "refused", NOT_SUPPORTED))
        return 0

    def next_event(self) -> ClientEvent | None:
        """Remove and return the oldest pending event; None if there is none."""
        return self._events.popleft() if self._events else None

    def _connected_stack(self) -> Stack:
        if self.stack is None:
            raise BridgeError("no autopilot is connected yet; wait for Connected")
        return self.stack

    def _add(self, job: Job) -> int:
        job.transfer_id = self._next_id
        self._next_id += 1
        self._waiting.append(job)
        self._transfer_added.set()
        return job.transfer_id

    # The link ---------------------------------------------------------------------------------

    async def __aenter__(self) -> Self:
        core = library().core
        loop = asyncio.get_running_loop()
        station = core.ComponentType.GROUND_STATION
        await self._connection.__aenter__()
        self._mavsdk = core.Mavsdk(core.Configuration.create_with_component_type(station))
        self._mavsdk.subscribe_raw_bytes_to_be_sent(  # called in one of MAVSDK's threads
            lambda data: loop.call_soon_threadsafe(self._send, data)
        )
        self._mavsdk.add_any_connection("raw://")
        for work in (self._transfer_all(), self._command_all()):
            task = asyncio.create_task(work)
            task.add_done_callback(self._stopped)
            self._tasks.append(task)
        return self

    async def __aexit__(self, *error: object) -> None:
        for task in self._tasks:
            task.cancel()
        # An active call would never return if MAVSDK were destroyed.
        if self._calls:
            await asyncio.wait(self._calls, timeout=CLOSE_TIMEOUT_S)
        if self._calls:
            await self._missions.cancel_mission_upload()
            await self._missions.cancel_mission_download()
            await asyncio.wait(self._calls, timeout=CLOSE_TIMEOUT_S)
        self._mavsdk.destroy()
        await self._connection.__aexit__(*error)

    async def wait(self) -> None:
        """Wait until there may be events. Raises errors of the link and of this client again."""
        await self._connection.wait()

    def flush(self) -> None:
        """Send all pending frames."""
        self._connection.flush()

    def _stopped(self, task: asyncio.Task[None]) -> None:
        failure = None if task.cancelled() else task.exception()
        if isinstance(failure, Exception):
            self._connection.failed(failure)

    def _send(self, data: bytes) -> None:
        self._outgoing.append(data)
        self._connection.flush()

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process frames from a link that has one remote."""
        self.receive_frames("", frames_of(data), now_us)

    def receive_frames(self, remote: str, frames: list[bytes], now_us: int) -> None:
        """Pass frames from the vehicle's remote to MAVSDK and to our own monitor.

        MAVSDK receives frames only after a HEARTBEAT has identified the remote. It receives no
        frame that has a value out of bounds.
        """
        if self._source is None:
            self._source = RemoteBinding(HEARTBEAT_TIMEOUT_US, self.called, self._signed)
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
                self._mavsdk.pass_received_raw_bytes(frame)

    def _receive(self, message: Message, now_us: int) -> None:
        mode = self._monitor.custom_mode
        events = self._monitor.receive(message, now_us)
        self._heartbeats += message.get_type() == "HEARTBEAT"
        if self._begin is not None:
            self._begin.receive(message, now_us)
        for event in events:
            if isinstance(event, ModeChanged) and event.custom_mode != mode:
                self._mode_changed(event.custom_mode, now_us)
        self._events.extend(events)
        announcements = any(
            isinstance(event, Connected | LinkRestored | Rebooted) for event in events
        )
        if announcements and self.stack is not None:
            for request in rate_requests(self.stack, self._target):
                self._outgoing.append(self._codec.encode(request))

    def _mode_changed(self, mode: int, now_us: int) -> None:
        """Process a mode change; a change that was not commanded ends the start of a mission."""
        if self.stack is not None and not self._commanded_modes.has(mode, now_us):
            self._overrides.append(changed_meanwhile(self.stack, mode))
            if self._begin is not None:
                self._begin.stop_commands(self._overrides[-1])

    def data_to_send(self) -> list[bytes]:
        """Remove and return the frames to send."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def addressed_to_send(self) -> list[tuple[str, bytes]]:
        """Return the frames to send, with the vehicle's remote, or "" (all) until it is bound."""
        source = self._source
        remote = "" if source is None or source.remote is None else source.remote
        return [(remote, frame) for frame in self.data_to_send()]

    def next_timer(self) -> int | None:
        """Return the time at which ``handle_timer`` may report a lost link or an ended alarm."""
        alarms_us = None if self._source is None else self._source.alarm_timer()
        timers = (self._monitor.next_timer(), self._monitor.alarm_timer(), alarms_us)
        return min((timer for timer in timers if timer is not None), default=None)

    def handle_timer(self, now_us: int) -> None:
        """Report a lost link and the alarms that have ended."""
        self._events.extend(self._monitor.handle_timer(now_us))
        self._events.extend(self._monitor.end_alarms(now_us))
        if self._source is not None:
            self._source.handle_timer(now_us)
            self._events.extend(self._source.alarms)
            self._source.alarms.clear()

    def _report(self, event: ClientEvent) -> None:
        self._events.append(event)
        self._connection.notify()

    # MAVSDK -----------------------------------------------------------------------------------

    async def _detected(self) -> bool:
        """Return whether MAVSDK has detected the vehicle; wait for this, and create the plugins."""
        modules = library()

        def detect() -> bool:
            for system in self._mavsdk.get_systems() if self._missions is None else ():
                if system.get_system_id() == self._target[0] and system.has_autopilot():
                    wrapped = modules.system.System(system)
                    self._direct = modules.direct.MavlinkDirectAsync(wrapped)
                    self._missions = modules.missions.MissionRawAsync(wrapped)
            return self._missions is not None

        return await self._until(detect, DETECTION_TIMEOUT_S)

    async def _call(self, call: Coroutine[Any, Any, Result]) -> Result:
        """Return the result of a call to MAVSDK; if the wait is cancelled, the call continues.

        Raises TimeoutError if the call takes longer than all of MAVSDK's own timeouts.
        """
        task = asyncio.ensure_future(call)
        self._calls.add(task)
        task.add_done_callback(self._returned)
        return await asyncio.wait_for(asyncio.shield(task), CALL_TIMEOUT_S)

    def _returned(self, task: asyncio.Task[Any]) -> None:
        self._calls.discard(task)
        # Read the result here, because perhaps no task waits for it.
        task.cancelled() or task.exception()

    async def _until(self, condition: Callable[[], bool], within_s: float) -> bool:
        """Return whether ``condition()`` is true; wait up to ``within_s`` for this."""
        ends_us = self._clock() + round(within_s * 1e6)
        while not condition():
            if self._clock() > ends_us:
                return False
            await asyncio.sleep(POLL_INTERVAL_S)
        return True

    # Commands ---------------------------------------------------------------------------------

    async def _command_all(self) -> None:
        while True:
            command_id, name, steps = await self._commands.get()
            accepted, reason = False, NOT_FOUND
            if await self._detected():
                accepted, reason = await self._steps(steps)
            self._report(CommandFinished(self._clock(), name, accepted, reason, command_id))

    async def _steps(self, steps: tuple[Step, ...]) -> tuple[bool, str]:
        """Send commands in sequence until one is refused; MAVSDK retries each of them.

        No command is sent after a failsafe or after a pilot has taken control.
        """
        overrides = len(self._overrides)
        for step in steps:
            if len(self._overrides) > overrides:
                return False, self._overrides[-1]
            self._commanded_modes.add(modes_of_step(step, self._connected_stack()), self._clock())
            command, request = step.command, command_message(self._target, step, 0)
            try:
                ack = await self._call(
                    self._direct.send_command(raw_message(request, self._target))
                )
            except library().direct.MavlinkDirectError as error:
                return False, f"command {command}: no acknowledgement ({error.result.name})"
            except TimeoutError:
                return False, f"command {command}: no acknowledgement ({NO_ANSWER})"
            result = json.loads(ack.fields_json)["result"]
            if result != mavlink.MAV_RESULT_ACCEPTED:
                return False, f"command {command} {result_words(result)}"
        return True, "accepted"

    async def _change_mode(self, stack: Stack, before: int, custom_mode: int) -> tuple[bool, str]:
        """Change the mode right after a heartbeat, and only if the mode is still ``before``."""
        heartbeats = self._heartbeats
        await self._until(lambda: self._heartbeats > heartbeats, 2 * REPLY_TIMEOUT_S)
        if self._monitor.custom_mode != before:
            return False, changed_meanwhile(stack, self._monitor.custom_mode)
        accepted, reason = await self._steps((stack.set_mode(custom_mode),))
        if not accepted:
            return False, reason
        changed = await self._until(
            lambda: self._monitor.custom_mode == custom_mode, 2 * REPLY_TIMEOUT_S
        )
        return changed, "accepted" if changed else "no heartbeat shows the mode"

    # Transfers --------------------------------------------------------------------------------

    async def _transfer_all(self) -> None:
        while True:
            await self._transfer_added.wait()
            found = await self._detected()
            if not self._waiting:
                self._transfer_added.clear()
                continue
            job = self._waiting.pop(0)
            result = TransferResult("failed", NOT_FOUND, holds="the old one")
            if found:
                result = await self._transfer(job, self._connected_stack())
            self._report(TransferFinished(self._clock(), job.transfer_id, job.action, result))

    async def _transfer(self, job: Job, stack: Stack) -> TransferResult:
        if job.action == "download":
            read, reason = await self._read()
            if read is None:
                return TransferResult("failed", reason)
            hidden = self._monitor.hidden_items
            return TransferResult(
                "accepted", "read", items=jumps_moved(read[hidden:], -hidden), holds="not known"
            )
        if job.action == "clear" or not job.items:
            return await self._clear(stack)
        return await self._upload(job, stack)

    async def _clear(self, stack: Stack) -> TransferResult:
        idle = not stack.keeps_target or await self._until(
            lambda: not self._monitor.in_mission, REPLY_TIMEOUT_S
        )
        if not idle:
            # MAVSDK would truncate the list and report success, and the vehicle would fly on.
            reason = "the vehicle flies its mission and would continue without it; hold first"
            return TransferResult("rejected", reason, holds="the old one")
        verdict = await self._send_request(self._missions.clear_mission())
        read, reason = await self._read()
        if read is None:
            return TransferResult("unknown", f"{verdict}; the read-back: {reason}")
        if len(read) > self._monitor.hidden_items:
            return TransferResult("rejected", f"the mission is still on board ({verdict})")
        return ACCEPTED

    async def _upload(self, job: Job, stack: Stack) -> TransferResult:
        bad = next((each for each in check(job.items, stack) if each.kind == "refused"), None)
        if bad is not None:
            return TransferResult("rejected", str(bad), seq=bad.index, holds="the old one")
        monitor, hidden = self._monitor, self._monitor.hidden_items
        first = self._first(job)
        paused = job.holds_first and monitor.in_mission and not stack.atomic_upload
        before, overrides = Onboard(None, monitor.plan_id, monitor.unfit), len(self._overrides)
        if paused:
            held, reason = await self._change_mode(stack, stack.mission_mode, stack.hold_mode)
            if not held:
                words = f"it did not hold for the upload: {reason}"
                return TransferResult("rejected", words, holds="the old one")
        wire_items = (*job.items[:hidden], *jumps_moved(job.items, hidden))
        verdict = await self._send_request(
            self._missions.upload_mission(raw_items(wire_items, first))
        )
        read, reason = await self._read()
        ended = upload_result(stack, hidden, wire_items, verdict, read)
        if read is None:
            ended = replace(ended, reason=f"{ended.reason}; the read-back: {reason}")
        if ended.outcome != "accepted":
            return ended
        ended = replace(ended, items=job.items)
        if len(self._overrides) > overrides and stack.keeps_target:
            started = TransferResult("failed", self._overrides[-1])
        else:
            started = await self._start_mission(first, wire_items, before, stack)
        if started.outcome != "accepted":
            words = f"the mission is on board, but the vehicle did not start it: {started.reason}"
            return replace(ended, outcome=started.outcome, reason=words, code=None)
        if paused and len(self._overrides) > overrides:
            words = f"accepted; {self._overrides[-1]}, and its mode was not changed"
            return replace(ended, reason=words)
        if paused:
            resumed, reason = await self._change_mode(stack, stack.hold_mode, stack.mission_mode)
            if not resumed:
                words = f"the mission is on board, but the vehicle did not resume it: {reason}"
                return replace(ended, outcome="failed", reason=words, code=None)
        return ended

    def _first(self, job: Job) -> int:
        """Return the number of the item to fly next, as it is transmitted."""
        hidden, last = self._monitor.hidden_items, self._monitor.hidden_items + len(job.items) - 1
        if job.begin == "restart":
            return hidden
        seq = self._monitor.current or 0 if job.begin == "keep" else hidden + job.begin
        return min(max(seq, hidden), last)

    async def _start_mission(
        self, seq: int, wire_items: Items, before: Onboard, stack: Stack
    ) -> TransferResult:
        """Start the mission on board; see ``vehicle/mission_activation.py``."""
        address = Address(MAVSDK_IDS, self._target)
        later = range(seq, len(wire_items))
        shown = next((at for at in later if wire_items[at].command <= LAST_NAV), seq)
        begin = self._begin = MissionActivation(
            *(address, seq, shown, len(wire_items), mission_id_of(wire_items, stack)),
            *(before._replace(seq=self._monitor.current), TransferTiming()),
        )
        try:
            messages = begin.start(self._clock())
            while begin.result is None:
                for message in messages:
                    await self._call(self._direct.send_message(raw_message(message, self._target)))
                await asyncio.sleep(POLL_INTERVAL_S)
                messages = begin.handle_timer(self._clock())
            return begin.result
        finally:
            self._begin = None

    async def _send_request(self, call: Coroutine[Any, Any, Any]) -> str:
        """Send a transfer request, and return the name of MAVSDK's result."""
        try:
            await self._call(call)
        except library().missions.MissionRawError as error:
            return str(error.result.name)
        except TimeoutError:
            return NO_ANSWER
        return "SUCCESS"

    async def _read(self) -> tuple[Items | None, str]:
        """Return the items as transmitted, or None if the download fails, and MAVSDK's result."""
        try:
            read = await self._call(self._missions.download_mission())
        except library().missions.MissionRawError as error:
            if error.result.name == "NO_MISSION_AVAILABLE":
                return (), "SUCCESS"
            return None, str(error.result.name)
        except TimeoutError:
            return None, NO_ANSWER
        return tuple(item_of(raw) for raw in read), "SUCCESS"
