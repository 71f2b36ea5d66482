"""Handles several vehicles on one link; a vehicle is detected by its heartbeat and has a client.

The shared link is a peer of a connection; it decodes each message once and passes it to the client
of the sending system. A link and a system id together identify a vehicle: the same id on another
link belongs to another vehicle. ``remote_binding.py`` selects the remote whose messages a client
accepts.

The connection may have several links, numbered from 0. A vehicle may then have several of these
links: its client receives from all of them, and sends over one (``vehicle/link_set.py``).
"""

import heapq
from collections import deque
from typing import NamedTuple

from autopilot_bridge.clients.native import (
    COMPONENT_MESSAGES,
    HEARTBEAT_EVERY_US,
    NativeClient,
    gcs_heartbeat,
)
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.stacks.stacks import Stack, stack_of
from autopilot_bridge.vehicle.client_events import AlarmEnded, ClientEvent
from autopilot_bridge.vehicle.link_set import LinkSet
from autopilot_bridge.vehicle.message_rates import ALL_RATES_HZ, RatesHz
from autopilot_bridge.vehicle.monitor import AUTOPILOT
from autopilot_bridge.vehicle.remote_binding import RemoteBinding
from autopilot_bridge.vehicle.remote_id import is_of_remote_id
from autopilot_bridge.vehicle.telemetry import MESSAGES

HEARTBEAT_TIMEOUT_US = 3_000_000


class VehicleKey(NamedTuple):
    """The key that identifies a vehicle: the link and the system id."""

    link: str
    system_id: int

    def __str__(self) -> str:
        return f"{self.system_id} on {self.link}"


class FleetEvent(NamedTuple):
    """An event from a vehicle's client, with the vehicle's key."""

    vehicle: VehicleKey
    event: ClientEvent


class SharedLink:
    """One link with its vehicles; a peer of a ``Connection``.

    ``next_event`` returns the events of vehicles that are detected by their heartbeats. For a
    vehicle that is registered by ``expect``, call ``next_event`` of the client from ``expect``.
    """

    def __init__(
        self,
        name: str | tuple[str, ...],
        system_id: int = 255,
        component_id: int = 190,
        heartbeat_timeout_us: int = HEARTBEAT_TIMEOUT_US,
        timing: TransferTiming | None = None,
        rates_hz: RatesHz = ALL_RATES_HZ,
        expects: bool = False,
        signed: bool = False,
    ) -> None:
        """Create the link; with ``expects`` only vehicles registered by ``expect`` are accepted.

        ``name`` is the address of the link, or the addresses of several links. ``signed`` is True
        if the signatures of received frames are verified.
        """
        self._names = (name,) if isinstance(name, str) else name
        self.name = self._names[0]
        # By link: the remote to which the link connects; "" if it listens.
        self.called: dict[int, str] = {}
        self.clients: dict[int, NativeClient] = {}
        self.unexpected: dict[int, Stack] = {}  # by system id: autopilots that are not registered
        self._own = (system_id, component_id)
        self._heartbeat_timeout_us = heartbeat_timeout_us
        self._timing = timing
        self._rates_hz = rates_hz
        # Each link has its own sequence numbers.
        self._codecs = [Codec(system_id, component_id) for _ in self._names]
        self._outgoing: list[Message] = []  # shared with all clients
        self._events: deque[FleetEvent] = deque()
        self._expects = expects
        self._signed = signed
        self._sources: dict[int, dict[int, RemoteBinding]] = {}  # by system id and link
        self._heartbeat_due_us = 0
        # A heap of (time, system id) that may contain outdated entries.
        self._timers: list[tuple[int, int]] = []
        self._due_us: dict[int, int] = {}

    def expect(
        self, system: int, max_speed_m_s: float | None = None, links: tuple[int, ...] = (0,)
    ) -> NativeClient:
        """Register a vehicle and return its client. Raises BridgeError if its id is in use.

        ``links`` contains the numbers of the vehicle's links, the preferred link first.
        """
        if system in self.clients:
            raise BridgeError(f"link {self.name}: two vehicles with system id {system}")
        client = self._client(system, max_speed_m_s, {} if len(links) > 1 else self._rates_hz)
        client.links = LinkSet(self._names, links, self._own, self._rates_hz)
        return client

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process a datagram from a link that has one remote."""
        self._receive("", self._codecs[0].decode(data), now_us, 0)

    def receive_frames(self, remote: str, frames: list[bytes], now_us: int, link: int = 0) -> None:
        """Process frames from a remote."""
        self._receive(remote, self._codecs[link].decode_frames(frames), now_us, link)

    def receive_copies(self, remote: str, frames: list[bytes], now_us: int, link: int) -> None:
        """Record frames already received over another link, to measure link quality.

        Anyone can repeat a signed frame: copies bind no vehicle to a remote.
        """
        for message in self._codecs[link].decode_frames(frames):
            system = message.get_srcSystem()
            source = self._sources.get(system, {}).get(link)
            links = None if source is None else self.clients[system].links
            if source is not None and links is not None and source.remote == remote:
                is_of_vehicle = message.get_srcComponent() == AUTOPILOT
                links.on_frame(message, link, is_of_vehicle, now_us)

    def _receive(self, remote: str, messages: list[Message], now_us: int, link: int) -> None:
        touched: dict[int, bool] = {}
        for message in messages:
            kind = message.get_type()
            of_component = kind in COMPONENT_MESSAGES or is_of_remote_id(message)
            if message.get_srcComponent() != AUTOPILOT and not of_component:
                continue
            system = message.get_srcSystem()
            client = self.clients.get(system) or self._detected(message, system)
            if client is not None and self._is_accepted((link, remote), system, message, now_us):
                client.receive_message(message, now_us, link)
                # Telemetry changes a timer only if it causes a message to be sent.
                telemetry = kind in MESSAGES or kind in COMPONENT_MESSAGES
                touched[system] = not telemetry or bool(self._outgoing)
        for system, timer in touched.items():
            self._refresh(system, timer)

    def _detected(self, message: Message, system: int) -> NativeClient | None:
        """Return the new client of an autopilot; None if the sender is not an autopilot."""
        stack = _stack_in(message)
        if stack is None:
            return None
        if self._expects:
            self.unexpected[system] = stack
            return None
        return self._client(system, None, self._rates_hz)

    def _client(self, system: int, max_speed_m_s: float | None, rates_hz: RatesHz) -> NativeClient:
        client = NativeClient(
            *self._own,
            target_system=system,
            heartbeat_timeout_us=self._heartbeat_timeout_us,
            timing=self._timing,
            rates_hz=rates_hz,
            shared=self._outgoing,
            max_speed_m_s=max_speed_m_s,
        )
        self.clients[system] = client
        return client

    def _is_accepted(
        self, origin: tuple[int, str], system: int, message: Message, now_us: int
    ) -> bool:
        """Return whether to accept a message of this system from this link and remote."""
        link, remote = origin
        sources = self._sources.setdefault(system, {})
        source = sources.get(link)
        if message.get_srcComponent() != AUTOPILOT:  # a camera or receiver, which binds no vehicle
            return source is not None and source.remote == remote
        if source is None:
            links = self.clients[system].links
            if links is not None and link not in links.order:
                return False
            timeout_us, called = self._heartbeat_timeout_us, self.called.get(link, "")
            source = sources[link] = RemoteBinding(timeout_us, called, self._signed)
        accepted = source.accepts(remote, is_of_autopilot(message), now_us)
        self._report(system, source)
        return accepted

    def _report(self, system: int, source: RemoteBinding) -> None:
        """Report new alarms; an alarm ends when its cause has ended on all links."""
        if source.alarms:
            others = [other for other in self._sources[system].values() if other is not source]
            active = any(other.alarm_timer() is not None for other in others)
            for alarm in source.alarms:
                if not (active and isinstance(alarm, AlarmEnded)):
                    self.clients[system].report(alarm)
            source.alarms.clear()
            self._refresh(system)

    def _refresh(self, system: int, timer: bool = True) -> None:
        """Collect a client's events and update its timer."""
        client = self.clients[system]
        while not self._expects and (event := client.next_event()) is not None:
            self._events.append(FleetEvent(VehicleKey(self.name, system), event))
        if not timer and system in self._due_us:
            return
        due_us = client.next_timer()
        if self._due_us.get(system) != due_us:
            self._due_us[system] = due_us
            heapq.heappush(self._timers, (due_us, system))

    def data_to_send(self) -> list[bytes]:
        """Return the datagrams of all clients, for a link that has one remote."""
        return [datagram for _, _, datagram in self.addressed_to_send()]

    def addressed_to_send(self) -> list[tuple[int, str, bytes]]:
        """Return the datagrams to send, each with its link and remote; "" means all remotes."""
        if not self._outgoing:
            return []
        for system in {getattr(message, "target_system", 0) for message in self._outgoing}:
            if system in self.clients:
                self._refresh(system)
        outgoing, self._outgoing[:] = list(self._outgoing), []
        return [
            (link, remote, self._codecs[link].encode(message))
            for message in outgoing
            for link, remote in self._recipients(message)
        ]

    def _recipients(self, message: Message) -> list[tuple[int, str]]:
        """Return the links and remotes of a message: all links if it has no target."""
        system = getattr(message, "target_system", 0)
        client = self.clients.get(system)
        if client is None:
            return [(link, "") for link in range(len(self._codecs))]
        in_use = 0 if client.links is None else client.links.in_use
        link = getattr(message, "over_link", in_use)
        source = self._sources.get(system, {}).get(link)
        return [(link, "" if source is None or source.remote is None else source.remote)]

    def next_timer(self) -> int:
        """Return the time of the next ``handle_timer`` call."""
        while self._timers and self._due_us.get(self._timers[0][1]) != self._timers[0][0]:
            heapq.heappop(self._timers)
        return min(self._heartbeat_due_us, *(due_us for due_us, _ in self._timers[:1]), 1 << 62)

    def handle_timer(self, now_us: int) -> None:
        """Send this station's heartbeat, and run the timers of the clients that are due."""
        if now_us >= self._heartbeat_due_us:
            self._heartbeat_due_us = now_us + HEARTBEAT_EVERY_US
            self._outgoing.append(gcs_heartbeat())
            for system, sources in self._sources.items():
                for source in sources.values():
                    source.handle_timer(now_us)
                    self._report(system, source)
        due = []
        while self._timers and self._timers[0][0] <= now_us:
            due_us, system = heapq.heappop(self._timers)
            if self._due_us.get(system) == due_us:  # otherwise the entry is outdated or a duplicate
                del self._due_us[system]
                due.append(system)
        for system in due:
            self.clients[system].handle_timer(now_us)
            self._refresh(system)

    def next_event(self) -> FleetEvent | None:
        """Remove and return the oldest pending event; None if no event is pending."""
        return self._events.popleft() if self._events else None


def is_of_autopilot(message: Message) -> bool:
    """Return whether a message is the HEARTBEAT of a supported autopilot."""
    return _stack_in(message) is not None


def _stack_in(message: Message) -> Stack | None:
    """Return the autopilot of a HEARTBEAT; None for other messages and unsupported autopilots."""
    if message.get_type() != "HEARTBEAT":
        return None
    return stack_of(message.autopilot, message.type)
