"""Implements the native client of one vehicle on one link, without input or output.

The client receives bytes (``receive_data``), and returns datagrams (``data_to_send``) and events
(``next_event``). The client needs one timer (``next_timer``, ``handle_timer``). The time is an
argument, in microseconds of any clock. On a link with several vehicles, ``shared_link.py`` decodes
each message once and calls ``receive_message``.
"""

from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.missions.transfer import Kind, TransferResult, TransferTiming
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle import orders
from autopilot_bridge.vehicle.aircraft_seen import ADSB_VEHICLE, aircraft_seen
from autopilot_bridge.vehicle.camera_telemetry import MESSAGES as CAMERA_MESSAGES
from autopilot_bridge.vehicle.camera_telemetry import camera_event
from autopilot_bridge.vehicle.client_events import (
    ClientEvent,
    Connected,
    LinkRestored,
    ModeChanged,
    Position,
    Rebooted,
    TransferFinished,
)
from autopilot_bridge.vehicle.command_queue import CommandQueue, ParameterQueue
from autopilot_bridge.vehicle.commanded_modes import CommandedModes
from autopilot_bridge.vehicle.drop_sender import DropSender
from autopilot_bridge.vehicle.link_set import LinkSet
from autopilot_bridge.vehicle.message_rates import ALL_RATES_HZ, MessageRates, RatesHz
from autopilot_bridge.vehicle.mode_change import changed_meanwhile
from autopilot_bridge.vehicle.monitor import AUTOPILOT, VehicleMonitor
from autopilot_bridge.vehicle.remote_id import RemoteIdMonitor, is_of_remote_id
from autopilot_bridge.vehicle.sent_commands import SentCommands
from autopilot_bridge.vehicle.statustext import StatustextAssembler
from autopilot_bridge.vehicle.transfer_queue import TransferQueue
from autopilot_bridge.vehicle.transfer_states import Job, StartItem, VehicleState

HEARTBEAT_EVERY_US = 1_000_000
COMPONENT_MESSAGES = CAMERA_MESSAGES | {ADSB_VEHICLE}  # of the vehicle, from any component
NEVER_US = 1 << 62


class NativeClient:
    """The native ``VehicleClient`` of one vehicle, which is the peer of a ``Connection``.

    Args:
        system_id: This station's MAVLink system id.
        component_id: This station's component id.
        target_system: The vehicle's system id; None means the first autopilot that sends a
            HEARTBEAT.
        heartbeat_timeout_us: The link counts as lost after this time without a HEARTBEAT.
        timing: Timeouts and retries of transfers and commands.
        rates_hz: Message rates to request when the vehicle connects, by message id.
        shared: The outgoing messages of all clients on the same link; the owner of the link also
            sends the heartbeats. None means that the client is alone on its link.
        max_speed_m_s: Positions that imply a higher speed are discarded; None means no limit.
    """

    def __init__(
        self,
        system_id: int = 255,
        component_id: int = 190,
        target_system: int | None = 1,
        heartbeat_timeout_us: int = 3_000_000,
        timing: TransferTiming | None = None,
        rates_hz: RatesHz = ALL_RATES_HZ,
        shared: list[Message] | None = None,
        max_speed_m_s: float | None = None,
    ) -> None:
        self._own = (system_id, component_id)
        self._target_system = target_system
        self._monitor = VehicleMonitor(heartbeat_timeout_us, max_speed_m_s)
        self._remote_id = RemoteIdMonitor()
        self._texts: dict[int, StatustextAssembler] = {}  # by link
        self.links: LinkSet | None = None  # set by the owner of the links
        self._timing = timing or TransferTiming()
        self._codec = Codec(system_id, component_id)
        self._outgoing: list[Message] = [] if shared is None else shared
        self._events: deque[ClientEvent] = deque()
        self._heartbeats = shared is None
        self._heartbeat_due_us = 0
        self._due_us: int | None = None  # result of ``next_timer`` until the state changes
        self._rates = MessageRates(self._own, rates_hz)
        self._commanded_modes = CommandedModes()
        self._jobs = TransferQueue(self._own, self._timing, self._report, self._commanded_modes)
        self._sent_commands = SentCommands(self._own)
        self._commands = CommandQueue(
            self._timing, self._events.append, self._commanded_modes, self._sent_commands
        )
        self._drops = DropSender(system_id, self._timing, self._events.append)
        self._parameters = ParameterQueue(self._timing, self._events.append)

    @property
    def stack(self) -> Stack | None:
        """The autopilot's stack; None until its first HEARTBEAT."""
        return self._monitor.stack

    @property
    def target_system(self) -> int | None:
        """The vehicle's system id; None before the first HEARTBEAT if no id was given."""
        return self._target_system

    @property
    def armed(self) -> bool:
        """Whether the last HEARTBEAT reports the vehicle as armed."""
        return self._monitor.armed

    @property
    def custom_mode(self) -> int:
        """The mode in the last HEARTBEAT."""
        return self._monitor.custom_mode

    @property
    def position(self) -> Position | None:
        """The last plausible position received."""
        return self._monitor.position

    # Requests of the user ---------------------------------------------------------------------

    def upload(
        self,
        items: tuple[MissionItem, ...],
        now_us: int,
        kind: Kind = "mission",
        begin: StartItem = "restart",
        check: bool = False,
        holds_first: bool = False,
        by_file: bool = True,
    ) -> int:
        """Replace the mission, fence or rally points; TransferFinished reports the result.

        ``begin`` selects the item of the new mission to fly next: ``restart`` means the first item,
        ``keep`` the item with the index of the current item, and a number (from 0) the item with
        that index. With ``check`` the list is read back after it was accepted. With ``holds_first``
        a vehicle that is flying its mission holds during the upload if the autopilot would
        otherwise fly a partly overwritten list. After a failed upload the vehicle continues to
        hold. With ``by_file`` the client uses MAVFTP if the autopilot supports it. An upload
        replaces a queued upload of the same kind.
        """
        job = Job(0, "upload", kind, tuple(items), begin, check, holds_first, by_file)
        return self._add(job, now_us)

    def download(self, now_us: int, kind: Kind = "mission", by_file: bool = True) -> int:
        """Read the mission, fence or rally points; TransferFinished contains the items."""
        return self._add(Job(0, "download", kind, by_file=by_file), now_us)

    def clear(self, now_us: int, kind: Kind = "mission") -> int:
        """Remove the mission, fence or rally points."""
        return self._add(Job(0, "clear", kind), now_us)

    def cancel(self, transfer_id: int, now_us: int) -> None:
        """Cancel a transfer; TransferFinished follows when the autopilot has ended the transfer."""
        self._due_us = None
        self._send(*self._jobs.cancel(transfer_id, self._connected_stack(), now_us))
        self._advance(now_us)

    def command(self, name: str, now_us: int, *arguments: float | str) -> int:
        """Execute a command from ``orders.ORDERS``; CommandFinished reports the outcome.

        Commands run in sequence; an urgent command first ends all others. Raises BridgeError if an
        argument is out of range, or if the stack has no such command.
        """
        self._due_us = None
        order, stack, position = orders.order_named(name), self._connected_stack(), self.position
        altitude_m = None if position is None else position.altitude_amsl_m
        mode = stack.mode_name(self.custom_mode)
        steps = order.steps(orders.OrderContext(stack, self.armed, mode, altitude_m), *arguments)
        if order.urgent:
            self._drops.withdraw(self._outgoing, f"{name} replaced it", now_us)
            self._jobs.release_mode()
            if name == "return" and stack.atomic_upload:
                self._send(*self._jobs.cancel_missions(stack, "the vehicle returns", now_us))
        command_id = self._commands.enqueue(
            name, steps, self._target(), stack, order.urgent, now_us, order.timing
        )
        self._send_commands(self._commands.start_next(now_us), now_us)
        return command_id

    def drop(self, dropper: orders.Dropper, now_us: int) -> int:
        """Release one object now; DropFinished reports the outcome.

        The command is sent once, before queued commands, and never repeated. A drop that cannot be
        sent at once is refused. Raises BridgeError if the stack does not support the dropper.
        """
        self._due_us = None
        lost = self._monitor.next_timer() is None
        drop_id, messages = self._drops.drop(
            self._connected_stack(), dropper, self._target(), lost, now_us
        )
        self._send(*messages)
        return drop_id

    # Parameters: each function returns an id; the ParametersFinished with this id has the result.

    def read_parameter(self, name: str, now_us: int) -> int:
        """Read one parameter."""
        return self._send_request(
            self._parameters.read(name, self._target(), self._connected_stack()), now_us
        )

    def read_parameters(self, now_us: int) -> int:
        """Read all parameters (ArduPilot has over a thousand)."""
        return self._send_request(
            self._parameters.read_all(self._target(), self._connected_stack()), now_us
        )

    def set_parameter(self, name: str, value: float, now_us: int) -> int:
        """Set a parameter; the result is "accepted" when the autopilot reports the new value."""
        stack = self._connected_stack()
        return self._send_request(self._parameters.set(name, value, self._target(), stack), now_us)

    def _send_request(self, request_id: int, now_us: int) -> int:
        self._due_us = None
        self._send(*self._parameters.start_next(now_us))
        return request_id

    def _connected_stack(self) -> Stack:
        if self.stack is None:
            raise BridgeError("no autopilot is connected yet; wait for the event Connected")
        return self.stack

    # Data, events and timers --------------------------------------------------------------------

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process a received datagram."""
        for message in self._codec.decode(data):
            self.receive_message(message, now_us)

    def receive_message(self, message: Message, now_us: int, link: int = 0) -> None:
        """Process a message from any sender; ``link`` is the number of the receiving link."""
        self._due_us = None
        kind = message.get_type()
        is_from_vehicle = self._from_vehicle(message)
        if self.links is not None and message.get_srcSystem() == self._target_system:
            self.links.on_frame(message, link, is_from_vehicle, now_us)
            self._send(*self.links.continue_rates(message, link, now_us))
        if is_of_remote_id(message):
            if self.stack is not None and message.get_srcSystem() == self._target_system:
                self._events.extend(self._remote_id.receive(message, now_us))
            return
        if is_from_vehicle:
            if link not in self._texts:
                self._texts[link] = StatustextAssembler()
            for whole in self._texts[link].receive(message):
                if self.links is None or self.links.is_usable(whole, link, now_us):
                    self._receive_own(whole, now_us)
                elif kind == "HEARTBEAT":
                    self._monitor.keep_alive(now_us)
        elif (
            kind in COMPONENT_MESSAGES
            and message.get_srcSystem() == self._target_system
            and (self.links is None or self.links.is_usable(message, link, now_us))
        ):
            self._receive_component(message, now_us)

    def _receive_own(self, message: Message, now_us: int) -> None:
        """Process a message of the vehicle's autopilot."""
        kind = message.get_type()
        if kind in COMPONENT_MESSAGES:
            self._receive_component(message, now_us)
        if kind != ADSB_VEHICLE:
            self._receive(message, now_us)

    def data_to_send(self) -> list[bytes]:
        """Remove and return the datagrams to send, in order."""
        if not self._outgoing:
            return []
        outgoing, self._outgoing = self._outgoing, []
        return [self._codec.encode(message) for message in outgoing]

    def next_event(self) -> ClientEvent | None:
        """Remove and return the oldest pending event; None if no event is pending."""
        return self._events.popleft() if self._events else None

    def report(self, event: ClientEvent) -> None:
        """Add an event about this vehicle that the link's owner detected."""
        self._events.append(event)

    def next_timer(self) -> int:
        """Return the time of the next ``handle_timer`` call."""
        if self._due_us is None or self.links is not None:  # other clients also use the links
            self._due_us = self._earliest_timer()
        return self._due_us

    def _earliest_timer(self) -> int:
        lost_us = self._monitor.next_timer()
        timers = (
            self._heartbeat_due_us if self._heartbeats else NEVER_US,
            self._jobs.next_timer(),
            self._commands_timer(),
            self._drops.next_timer(),
            self._parameters.next_timer(),
            self._monitor.alarm_timer(),
            self._remote_id.next_timer(),
            lost_us,
            # No requests are sent on a lost link.
            None if lost_us is None else self._rates.next_timer(),
            None if self.links is None else self.links.next_timer(),
        )
        return min([timer_us for timer_us in timers if timer_us is not None])

    def handle_timer(self, now_us: int) -> None:
        """Run all actions due at ``now_us``."""
        idle = self._jobs.idle and self._commands.idle and self._parameters.idle
        if idle and now_us < self.next_timer():
            return
        self._due_us = None
        if self.links is not None:
            self._check_links(self.links, not idle, now_us)
        if self._heartbeats and now_us >= self._heartbeat_due_us:
            self._heartbeat_due_us = now_us + HEARTBEAT_EVERY_US
            self._send(gcs_heartbeat())
        self._events.extend(self._monitor.handle_timer(now_us))
        self._events.extend(self._monitor.end_alarms(now_us))
        self._events.extend(self._remote_id.handle_timer(now_us))
        if self._monitor.next_timer() is not None:
            self._send(*self._rates.handle_timer(now_us))
        self._send_commands(self._jobs.handle_timer(now_us), now_us)
        self._advance(now_us)
        if now_us >= self._monitor.undecided_until_us:
            self._send_commands(self._commands.handle_timer(now_us), now_us)
        self._send(*self._drops.handle_timer(now_us))
        self._send(*self._parameters.handle_timer(now_us))

    def _check_links(self, links: LinkSet, busy: bool, now_us: int) -> None:
        """Switch to a better link if necessary; a transfer continues over the new link."""
        requests, changed = links.handle_timer(busy, now_us)
        self._send(*requests)
        if changed is not None:
            self._events.append(changed)
            if changed.cause:
                self._send(*self._jobs.link_switched(now_us))

    def _commands_timer(self) -> int | None:
        """Return the time of the next retry; no retry is made while a restart is suspected."""
        due_us = self._commands.next_timer()
        return None if due_us is None else max(due_us, self._monitor.undecided_until_us)

    # Messages -----------------------------------------------------------------------------------

    def _from_vehicle(self, message: Message) -> bool:
        if self._target_system is None and message.get_type() == "HEARTBEAT":
            if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
                return False
            self._target_system = message.get_srcSystem()
        header = message.get_header()
        return bool(header.srcSystem == self._target_system and header.srcComponent == AUTOPILOT)

    def _receive_component(self, message: Message, now_us: int) -> None:
        """Process a message of a camera, gimbal or ADS-B receiver, maybe a separate component."""
        decode = aircraft_seen if message.get_type() == ADSB_VEHICLE else camera_event
        event = None if self.stack is None else decode(message, now_us)
        if event is not None:
            self._events.append(event)

    def _receive(self, message: Message, now_us: int) -> None:
        monitor = self._monitor
        mode, armed, critical = monitor.custom_mode, monitor.armed, monitor.critical
        for event in monitor.receive(message, now_us):
            self._events.append(event)
            if isinstance(event, Rebooted):
                self._commands.end_all("the autopilot was restarted", now_us)
            if isinstance(event, (Connected, LinkRestored, Rebooted)) and self.stack is not None:
                self._send(*self._rates.begin(self.stack, self._target(), now_us))
                if self.links is not None:
                    self._send(*self.links.request_rates(self.stack, self._target(), now_us))
            if isinstance(event, ModeChanged):
                self._mode_changed(mode, armed, now_us)
        if monitor.critical and not critical:
            self._jobs.mode_overridden("the autopilot entered failsafe in the meantime")
        if not monitor.used:
            return
        self._drops.receive(message, now_us)
        self._outgoing += self._rates.receive(message, now_us)
        if message.get_type() == "COMMAND_ACK":
            self._sent_commands.receive(message, now_us)
        if now_us >= monitor.undecided_until_us:  # otherwise a restart may undo the command
            self._send_commands(self._commands.receive(message, now_us), now_us)
        self._outgoing += self._parameters.receive(message, now_us)
        if self._jobs.next_timer() is not None:  # a transfer is active
            self._send_commands(self._jobs.receive(message, now_us), now_us)
            self._advance(now_us)
        elif message.get_type() == "HEARTBEAT":
            self._advance(now_us)

    def _mode_changed(self, before: int, was_armed: bool, now_us: int) -> None:
        """Stop transfers and commands if the autopilot or a pilot has changed the mode."""
        mode, stack = self.custom_mode, self._connected_stack()
        if mode != before and not self._commanded_modes.has(mode, now_us):
            why = changed_meanwhile(stack, mode)
            self._jobs.mode_overridden(why, self.armed)
            if mode == stack.rtl_mode and stack.atomic_upload:
                self._send(*self._jobs.cancel_missions(stack, why, now_us))
            self._send_commands(self._commands.release_mode(why, now_us), now_us)
        elif was_armed and not self.armed:
            why = "the vehicle was disarmed in the meantime"
            self._send_commands(self._commands.release_mode(why, now_us), now_us)

    def _target(self) -> tuple[int, int]:
        return self._target_system or 0, AUTOPILOT

    # Transfers ----------------------------------------------------------------------------------

    def _add(self, job: Job, now_us: int) -> int:
        self._due_us = None
        transfer_id = self._jobs.enqueue(job, now_us)
        self._advance(now_us)
        return transfer_id

    def _advance(self, now_us: int) -> None:
        """Report the finished transfer and start the next phase or transfer."""
        if self.stack is None or self._jobs.idle:
            return
        monitor = self._monitor
        total = None if monitor.total is None else monitor.total + monitor.hidden_items
        state = VehicleState(
            *(self.stack, self._target(), monitor.current, total, self.armed, self.custom_mode),
            *(monitor.plan_id, monitor.unfit),
        )
        self._send_commands(self._jobs.continue_jobs(state, now_us), now_us)
        self._send_commands(self._jobs.start_next(state, now_us), now_us)

    def validate_state(self) -> None:
        """Raise AssertionError if an invariant does not hold between two events; for tests."""
        self._jobs.validate_state()

    def _report(self, job: Job, result: TransferResult, now_us: int) -> None:
        ended = TransferFinished(now_us, job.transfer_id, job.action, result, job.kind)
        self._events.append(ended)

    def _send(self, *messages: Message) -> None:
        self._outgoing.extend(messages)

    def _send_commands(self, messages: list[Message], now_us: int) -> None:
        for message in messages:
            self._sent_commands.sent(message, now_us, self._connected_stack())
        self._outgoing += messages


def gcs_heartbeat() -> Message:
    """Return the HEARTBEAT of a ground station."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3
    )
