"""Connects to TAK: UDP (also multicast), TCP and TLS."""

import asyncio
import contextlib
import socket
from typing import Any, Protocol

from mission_service.interfaces.cot.cot_events import PONG, ping_event
from mission_service.interfaces.cot.event_framing import MAX_EVENT_BYTES, EventFramer
from mission_service.interfaces.cot.event_receiver import EventReceiver
from mission_service.runtime.clocks import clock_us, wall_us

ANSWER_S = 5.0  # time limit for connecting and for sending an event
PING_S = 3.0
SILENT_S = 12.0  # after this silence, a connection to a server that answers pings is lost
MAX_DATAGRAM_BYTES = 65_535


class CotTransport(Protocol):
    """A transport for events."""

    async def send_event(self, event: bytes) -> None:
        """Send an event. Raises OSError or TimeoutError if sending fails."""

    async def wait(self, seconds: float) -> None:
        """Wait; return earlier if the connection ends."""

    def alive_us(self) -> int:
        """Return the last monotonic time at which the connection is known to have worked."""

    def close(self) -> None:
        """Close the transport."""


class Datagrams:
    """A UDP transport: one event per datagram, without acknowledgement.

    With a ``receiver``, the transport also receives the events of a multicast group.
    """

    def __init__(
        self, address: tuple[Any, ...], family: int, receiver: EventReceiver | None
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

    async def send_event(self, event: bytes) -> None:
        """Send an event; drop it if the socket's buffer is full."""
        if self._reading is not None and self._reading.done():
            self._reading.result()
        with contextlib.suppress(BlockingIOError):
            self._socket.sendto(event, self._address)

    async def wait(self, seconds: float) -> None:
        """Wait."""
        await asyncio.sleep(seconds)

    def alive_us(self) -> int:
        """Return the current time, because UDP has no connection."""
        return clock_us()

    def close(self) -> None:
        """Close the transport."""
        if self._reading is not None:
            self._reading.cancel()
        self._socket.close()

    async def _read(self, group: socket.socket, receiver: EventReceiver) -> None:
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
    """A TCP or TLS connection to a TAK server; ``receiver`` processes the server's events.

    The server receives pings, which TAK servers answer. If a server has answered a ping and then
    sends nothing for ``SILENT_S``, for example because its network has failed, reading raises
    TimeoutError, and the connection counts as lost.
    """

    def __init__(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        receiver: EventReceiver | None,
    ) -> None:
        self._writer = writer
        self._answers = False  # the server has answered a ping
        self._received_us = self._ended_us = clock_us()
        self._reading = asyncio.create_task(self._read(reader, receiver))
        self._pinging = asyncio.create_task(self._ping())

    async def send_event(self, event: bytes) -> None:
        """Send an event; wait up to ``ANSWER_S`` for a slow server."""
        if self._reading.done():
            self._reading.result()  # for example, a server refused a certificate after connecting
            raise ConnectionResetError("the server closed the connection")
        self._writer.write(event + b"\n")
        async with asyncio.timeout(ANSWER_S):
            await self._writer.drain()

    async def wait(self, seconds: float) -> None:
        """Wait; return earlier if the connection ends."""
        await asyncio.wait([self._reading], timeout=seconds)

    def alive_us(self) -> int:
        """Return the monotonic time in µs of the last data from a server that answers pings.

        Otherwise return the time of the disconnection, or the current time while connected.
        """
        if self._answers:
            return self._received_us
        return self._ended_us if self._reading.done() else clock_us()

    def close(self) -> None:
        """Close the transport."""
        self._pinging.cancel()
        if not self._reading.cancel() and not self._reading.cancelled():
            self._reading.exception()  # marks it as retrieved; sending has failed as well
        self._writer.close()

    async def _ping(self) -> None:
        while not self._reading.done():
            self._writer.write(ping_event(wall_us()) + b"\n")
            await self.wait(PING_S)

    async def _read(self, reader: asyncio.StreamReader, receiver: EventReceiver | None) -> None:
        framer = EventFramer()
        try:
            while data := await self._data(reader):
                self._received_us = clock_us()
                self._answers |= PONG.search(data) is not None
                if receiver is None:
                    continue
                for event in framer.receive(data):
                    await receiver.receive(event)
                if framer.too_long:
                    receiver.on_unreadable(f"an event has more than {MAX_EVENT_BYTES} bytes")
        finally:
            self._ended_us = clock_us()

    async def _data(self, reader: asyncio.StreamReader) -> bytes:
        """Return received bytes, or no bytes at the end. Raises TimeoutError after silence."""
        try:
            async with asyncio.timeout(SILENT_S if self._answers else None):
                return await reader.read(65_536)
        except TimeoutError:
            raise TimeoutError(f"the server has sent nothing for {SILENT_S:.0f} s") from None
