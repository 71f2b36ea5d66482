"""The asyncio adapter: moves bytes between a UDP socket and a sans-IO peer, arms one timer."""

import asyncio
import contextlib
import socket
from collections.abc import Callable
from types import TracebackType
from typing import Protocol, Self, cast

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.link import parse_link

RECEIVE_BUFFER_BYTES = 4 * 1024 * 1024
SHORTEST_WAIT_S = 0.001


class Peer(Protocol):
    """Either side of a link: the ground station's client or the mock autopilot."""

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take in a datagram."""

    def data_to_send(self) -> list[bytes]:
        """Datagrams to send."""

    def next_timer(self) -> int | None:
        """When to call ``handle_timer``."""

    def handle_timer(self, now_us: int) -> None:
        """Do what is due."""


class Connection(asyncio.DatagramProtocol):
    """One peer on one UDP socket while the context is open.

    ``clock`` gives the peer's time in microseconds and runs ``rate`` times as fast as real time.
    """

    def __init__(self, link: str, peer: Peer, clock: Callable[[], int], rate: float = 1.0) -> None:
        self._address = parse_link(link)
        self._peer = peer
        self._clock = clock
        self._rate = rate
        self._news = asyncio.Event()
        self._transport: asyncio.DatagramTransport | None = None
        self._remote: tuple[str, int] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._failure: Exception | None = None

    async def __aenter__(self) -> Self:
        address = self._address
        where = (address.host, address.port)
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        try:
            if address.kind == "udpin":
                sock.bind(where)
            else:
                sock.bind(("", 0))
                self._remote = (socket.gethostbyname(address.host), address.port)
        except OSError as error:
            sock.close()
            doing = "listen on" if address.kind == "udpin" else "reach"
            raise BridgeError(
                f"link {address.kind}:{address.host}:{address.port}: cannot {doing} it "
                f"({error.strerror}); is another program using the port?"
            ) from None
        loop = asyncio.get_running_loop()
        await loop.create_datagram_endpoint(lambda: self, sock=sock)
        self._wake()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._transport is not None:
            self._transport.close()

    async def wait(self) -> None:
        """Return when something arrived or was due since the last call.

        Raises what the peer raised: a defect ends the program instead of passing by in a log.
        """
        await self._news.wait()
        self._news.clear()
        if self._failure is not None:
            raise self._failure

    def flush(self) -> None:
        """Send what the peer has to send, and look at its timer anew."""
        datagrams = self._peer.data_to_send()
        if self._transport is not None and self._remote is not None:
            for datagram in datagrams:
                self._transport.sendto(datagram, self._remote)
        self._arm()

    def _arm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        due_us = self._peer.next_timer()
        if due_us is None or self._transport is None:
            return
        wait_s = max((due_us - self._clock()) / 1e6 / self._rate, SHORTEST_WAIT_S)
        self._timer = asyncio.get_running_loop().call_later(wait_s, self._wake)

    def _wake(self) -> None:
        self._guarded(lambda: self._peer.handle_timer(self._clock()))

    def _guarded(self, handle: Callable[[], None]) -> None:
        try:
            handle()
            self.flush()
        except Exception as error:
            self._failure = error
        self._news.set()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The socket is ready."""
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Hand a datagram to the peer; answer whoever spoke last."""
        if self._address.kind == "udpin":
            self._remote = addr
        self._guarded(lambda: self._peer.receive_data(data, self._clock()))

    def error_received(self, exc: Exception) -> None:
        """Nobody listens there yet (ICMP): the peer's own timeouts deal with silence."""
        with contextlib.suppress(ConnectionRefusedError):
            raise exc
