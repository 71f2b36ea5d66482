"""Connects to TAK: UDP (also multicast), TCP and TLS."""

import asyncio
import contextlib
import socket
from typing import Any, Protocol

from mission_service.interfaces.cot.event_framing import MAX_EVENT_BYTES, EventFramer
from mission_service.interfaces.cot.event_receiver import EventReceiver

ANSWER_S = 5.0  # time limit for connecting and for sending an event
MAX_DATAGRAM_BYTES = 65_535


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
    """A TCP or TLS connection to a TAK server; ``receiver`` processes the events of the server."""

    def __init__(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        receiver: EventReceiver | None,
    ) -> None:
        self._writer = writer
        self._reading = asyncio.create_task(self._read(reader, receiver))

    async def send(self, event: bytes) -> None:
        """Send an event; wait up to ``ANSWER_S`` for a slow server."""
        if self._reading.done():
            self._reading.result()  # for example, a server refuses a certificate after connecting
            raise ConnectionResetError("the server has closed the connection")
        self._writer.write(event + b"\n")
        async with asyncio.timeout(ANSWER_S):
            await self._writer.drain()

    def close(self) -> None:
        """Close the transport."""
        if not self._reading.cancel() and not self._reading.cancelled():
            self._reading.exception()  # marks it as retrieved; sending has failed as well
        self._writer.close()

    async def _read(self, reader: asyncio.StreamReader, receiver: EventReceiver | None) -> None:
        framer = EventFramer()
        while data := await reader.read(65_536):
            if receiver is None:
                continue
            for event in framer.receive(data):
                await receiver.receive(event)
            if framer.too_long:
                receiver.on_unreadable(f"an event has more than {MAX_EVENT_BYTES} bytes")
