"""Exchanges Cursor on Target events by UDP (also multicast), TCP or TLS (table ``[service.cot]``).

The run never waits for a receiver. Each round sends the current state and drops events that cannot
be sent. Events that arrive on the connection are processed as reports of people
(``report_receiver.py``), or are dropped without ``[service.cot.reports]``.
"""

import asyncio
import contextlib
import itertools
import socket
import ssl
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any, Protocol

from mission_service.config.mqtt_names import site_of
from mission_service.config.service_section import CotSection
from mission_service.interfaces.cot.cot_events import fire_events, vehicle_event
from mission_service.interfaces.cot.event_framing import MAX_EVENT_BYTES, EventFramer
from mission_service.interfaces.cot.report_receiver import ABOUT, ReportReceiver
from mission_service.interfaces.maps.run_forecasts import forecasts_of, front_now
from mission_service.interfaces.mqtt.broker_connection import tls_of
from mission_service.runtime.clocks import wall_us

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext

FIRE_EVERY = 10  # the front is sent once in this many rounds
ROUNDS_UNTIL_STALE = 3
ANSWER_S = 5.0  # time limit for connecting and for sending an event
MIN_WAIT_S, MAX_WAIT_S = 1.0, 30.0
MAX_DATAGRAM_BYTES = 65_535
ALARM = "cot"


class CotTransport(Protocol):
    """A transport for events."""

    async def send(self, event: bytes) -> None:
        """Send an event. Raises OSError or TimeoutError if sending fails."""

    def close(self) -> None:
        """Close the transport."""


class Datagrams:
    """A UDP transport: one event per datagram, without acknowledgement.

    With a ``receiver``, the transport also receives the events of a multicast group.
    """

    def __init__(
        self, address: tuple[Any, ...], family: int, receiver: ReportReceiver | None
    ) -> None:
        self._address = address
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._reading: asyncio.Task[None] | None = None
        if receiver is not None:
            try:
                group = joined_group(address, family)
            except OSError:
                self._socket.close()
                raise
            self._reading = asyncio.create_task(self._read(group, receiver))

    async def send(self, event: bytes) -> None:
        """Send an event; drop it if the socket's buffer is full."""
        if self._reading is not None and self._reading.done():
            self._reading.result()
        with contextlib.suppress(BlockingIOError):
            self._socket.sendto(event, self._address)

    def close(self) -> None:
        """Close the transport."""
        if self._reading is not None:
            self._reading.cancel()
        self._socket.close()

    async def _read(self, group: socket.socket, receiver: ReportReceiver) -> None:
        with group:
            loop = asyncio.get_running_loop()
            while True:
                await receiver.receive(await loop.sock_recv(group, MAX_DATAGRAM_BYTES))


def joined_group(address: tuple[Any, ...], family: int) -> socket.socket:
    """Return a non-blocking socket for the datagrams to a multicast group. Raises OSError."""
    group = socket.socket(family, socket.SOCK_DGRAM)
    try:
        group.setblocking(False)
        group.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # for TAK clients on this host
        group.bind(("", address[1]))
        membership = socket.inet_pton(family, address[0]) + bytes(4)  # on the default interface
        if family == socket.AF_INET6:
            group.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, membership)
        else:
            group.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    except OSError:
        group.close()
        raise
    return group


class Stream:
    """A TCP or TLS connection to a TAK server; ``receiver`` processes the events of the server."""

    def __init__(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        receiver: ReportReceiver | None,
    ) -> None:
        self._writer = writer
        self._reading = asyncio.create_task(self._read(reader, receiver))

    async def send(self, event: bytes) -> None:
        """Send an event; wait up to ``ANSWER_S`` for a slow server."""
        if self._reading.done():
            self._reading.result()
            raise ConnectionResetError("the server has closed the connection")
        self._writer.write(event + b"\n")
        async with asyncio.timeout(ANSWER_S):
            await self._writer.drain()

    def close(self) -> None:
        """Close the transport."""
        self._reading.cancel()
        self._writer.close()

    async def _read(self, reader: asyncio.StreamReader, receiver: ReportReceiver | None) -> None:
        framer = EventFramer()
        with contextlib.suppress(OSError):
            while data := await reader.read(65_536):
                if receiver is None:
                    continue
                for event in framer.receive(data):
                    await receiver.receive(event)
                if framer.too_long:
                    receiver.on_unreadable(f"an event has more than {MAX_EVENT_BYTES} bytes")


def cot_interface(
    settings: CotSection, scenario_name: str
) -> Callable[["RunContext"], Coroutine[Any, Any, None]]:
    """Return the coroutine function that sends events until cancelled.

    Raises MissionServiceError for unusable settings.
    """
    tls = None
    if settings.scheme == "tls":
        tls = tls_of(settings.tls_ca, settings.tls_certificate, settings.tls_key)

    async def run_interface(context: "RunContext") -> None:
        await CotSender(context, settings, site_of(scenario_name), tls).run()

    return run_interface


class CotSender:
    """The sender of one run's events, which also makes the receiver of reports."""

    def __init__(
        self, context: "RunContext", settings: CotSection, site: str, tls: ssl.SSLContext | None
    ) -> None:
        self._context, self._settings, self._site, self._tls = context, settings, site, tls
        self._forecasts = forecasts_of(context)
        self._sent: dict[str, int] = {}  # last version sent, by vehicle
        self._receiver: ReportReceiver | None = None
        if settings.reports is not None:
            if context.scenario.burn_flown is None:
                self._receiver = ReportReceiver(context, settings.reports, site)
            else:
                text = "reports from TAK are not used: a burn uses cameras and corrections only"
                context.service.announce(ABOUT, text)

    async def run(self) -> None:
        """Send until cancelled; reconnect after a failure."""
        wait_s = MIN_WAIT_S
        try:
            while True:
                try:
                    async with asyncio.timeout(ANSWER_S):
                        transport = await self._connect()
                    try:
                        await self._rounds(transport)
                    finally:
                        transport.close()
                        wait_s = MIN_WAIT_S
                except (OSError, TimeoutError) as error:
                    text = f"no CoT to {self._settings.url}: {str(error) or 'no response'}"
                    self._context.state_view.alarm(ALARM, text)
                    self._context.ring()
                await asyncio.sleep(wait_s)
                wait_s = min(2.0 * wait_s, MAX_WAIT_S)
        finally:
            self._forecasts.close()

    async def _connect(self) -> CotTransport:
        host, port = self._settings.host, self._settings.port
        if self._settings.scheme != "udp":
            reader, writer = await asyncio.open_connection(host, port, ssl=self._tls)
            return Stream(reader, writer, self._receiver)
        loop = asyncio.get_running_loop()
        addresses = await loop.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        family, _, _, _, address = addresses[0]
        return Datagrams(address, family, self._receiver)

    async def _rounds(self, transport: CotTransport) -> None:
        """Send rounds of events. Raises OSError or TimeoutError when the transport fails."""
        stale_us = round(ROUNDS_UNTIL_STALE * self._settings.every_s * 1e6)
        for number in itertools.count():
            if number % FIRE_EVERY == 0:
                await self._send_fire(transport, FIRE_EVERY * stale_us)
            await self._send_vehicles(transport, stale_us)
            self._context.state_view.clear_alarm(ALARM)
            if self._receiver is not None:
                self._receiver.handle_timer()
            await asyncio.sleep(self._settings.every_s)

    async def _send_vehicles(self, transport: CotTransport, stale_us: int) -> None:
        """Send positions that are new since the last round; receivers mark the others as stale."""
        state_view = self._context.state_view
        for name, fix in list(state_view.telemetry.items()):
            version = state_view.changed[f"telemetry/{name}"]
            if version > self._sent.get(name, 0):
                self._sent[name] = version
                kind = state_view.vehicles[name].kind
                await transport.send(vehicle_event(fix, kind, self._site, wall_us(), stale_us))

    async def _send_fire(self, transport: CotTransport, stale_us: int) -> None:
        front = await front_now(self._context, self._forecasts)
        for event in fire_events(front, self._site, wall_us(), stale_us):
            await transport.send(event)
