"""Sends and receives the frames of a link, with one transport class for each kind of link.

A lost connection is not an error: the peers have timeouts, and ``tcp`` and ``serial`` reconnect
with delays that grow to five seconds.
"""

import asyncio
import errno
import os
import socket
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Protocol

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.framing import Framer, source_of, target_system_of
from autopilot_bridge.links.link import LinkAddress, SerialAddress, reconnect_wait_s
from autopilot_bridge.links.sockets import bind, look_up, reason_of, socket_of

# If a remote does not read, frames beyond this buffer size are dropped, like on a radio.
MAX_UNSENT_BYTES = 256 * 1024
MAX_REMOTES = 1024
MAX_AT_ONCE = 256  # datagrams read before other tasks run
MAX_DATAGRAM_BYTES = 65536
QUICK_S = 0.002
ANSWER_FOR_S = 10.0
CONNECT_WITHIN_S = 5.0
CLOSE_WITHIN_S = 1.0
SILENCE = {
    *(errno.ECONNREFUSED, errno.ECONNRESET, errno.EHOSTUNREACH, errno.ENETUNREACH),
    *(errno.ENETDOWN, errno.EHOSTDOWN, errno.ENOBUFS),
}


Batch = list[tuple[str, list[bytes]]]  # each remote with its frames, in order


class Listener(Protocol):
    """The receiver of a transport's frames and errors."""

    def frames_received(self, batch: Batch) -> None:
        """Process received frames."""

    def failed(self, error: Exception) -> None:
        """Report an error after which the transport cannot continue."""


class Transport(Protocol):
    """An open link; ``called`` is the remote to which it connects, "" if it listens."""

    called: str

    async def open(self) -> None:
        """Open the socket or device. Raises BridgeError if the link's address cannot be used."""

    def send(self, frames: list[bytes], remote: str = "") -> bool:
        """Send frames to a remote, or to all (""), and return whether there was a recipient."""

    async def close(self) -> None:
        """Close the socket or device."""


def transport_of(address: LinkAddress | SerialAddress, listener: Listener) -> Transport:
    """Return the transport for a link's address."""
    if isinstance(address, SerialAddress):
        return StreamClient(lambda: _open_serial(address, listener), listener, address)
    match address.kind:
        case "tcp":
            return StreamClient(lambda: _call(address, listener), listener, address)
        case "tcpin":
            return TcpServer(address, listener)
        case _:
            return Udp(address, listener)


# UDP ------------------------------------------------------------------------------------------


Where = tuple[str, int]


@dataclass
class _Remote:
    name: str
    framer: Framer = field(default_factory=Framer)
    received_s: float = float("-inf")
    systems: set[int] = field(default_factory=set)


class Udp(asyncio.DatagramProtocol):
    """A UDP socket.

    ``udpout`` sends to its address. ``udpin`` sends to all remotes that sent frames in the last ten
    seconds; if there were none, it sends to the last remote. Frames with a target system are sent
    to the remote of that system.
    """

    def __init__(self, address: LinkAddress, listener: Listener) -> None:
        self.called = ""
        self._address = address
        self._listener = listener
        self._remotes: dict[Where, _Remote] = {}  # ordered by the time of the last frame
        self._target: Where | None = None
        self._transport: asyncio.DatagramTransport | None = None
        self._socket: socket.socket | None = None
        self._closed = asyncio.Event()
        self._last_s = float("-inf")

    async def open(self) -> None:
        """Resolve the host and bind the socket."""
        address = self._address
        if address.kind == "udpout":
            self._target = await look_up(address)
            self.called = f"{self._target[0]}:{self._target[1]}"
        sock = socket_of(socket.SOCK_DGRAM)
        bind(sock, address, ("", 0) if self._target else (address.host, address.port))
        loop = asyncio.get_running_loop()
        transport, _ = await loop.create_datagram_endpoint(lambda: self, sock=sock)
        self._transport, self._socket = transport, sock

    def send(self, frames: list[bytes], remote: str = "") -> bool:
        """Send each frame to each remote, as one datagram."""
        targets = self._targets(remote)
        if self._transport is None or not frames:
            return bool(targets)
        of_system = self._of_system(targets) if len(targets) > 1 else {}
        for frame in frames:
            for target in of_system.get(target_system_of(frame), targets):
                self._transport.sendto(frame, target)
        return bool(targets)

    def _targets(self, remote: str) -> list[Where]:
        if self._address.kind == "udpout" or self._target is None:
            return [self._target] if self._target else []
        host, _, port = remote.rpartition(":")
        if remote:  # even one that was removed from ``_remotes``
            return [(host, int(port))]
        since_s = asyncio.get_running_loop().time() - ANSWER_FOR_S
        recent = [at for at, entry in self._remotes.items() if entry.received_s >= since_s]
        return recent or [self._target]

    def _of_system(self, targets: list[Where]) -> dict[int, list[Where]]:
        """Return the remotes of each system id."""
        found: dict[int, list[Where]] = {}
        for target in targets:
            for system in self._remotes[target].systems - {0}:  # 0 is the id of all systems
                found.setdefault(system, []).append(target)
        return found

    async def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()
            await self._closed.wait()

    def datagram_received(self, data: bytes, addr: Where) -> None:
        """Pass the frames of this datagram, and of others in the socket, to the listener.

        asyncio reads one datagram in each turn of its loop. More datagrams are read here only if
        they are likely (several remotes, short intervals), because a read that finds none costs as
        much as a datagram.
        """
        now_s = asyncio.get_running_loop().time()
        more_expected = len(self._remotes) > 1 or now_s - self._last_s < QUICK_S
        self._last_s = now_s
        batch = [self._frames(data, addr)]
        max_datagrams = MAX_AT_ONCE if more_expected else 1
        while len(batch) < max_datagrams and (datagram := self._read()) is not None:
            batch.append(self._frames(*datagram))
        batch = [(remote, frames) for remote, frames in batch if frames]
        if batch:
            self._listener.frames_received(batch)

    def _read(self) -> tuple[bytes, Where] | None:
        assert self._socket is not None
        try:
            return self._socket.recvfrom(MAX_DATAGRAM_BYTES)
        except BlockingIOError:
            pass
        except OSError as error:
            self.error_received(error)
        return None

    def _frames(self, data: bytes, addr: Where) -> tuple[str, list[bytes]]:
        """Return the remote of a datagram and the frames that its framer finds."""
        remote = self._remotes.pop(addr, None) or _Remote(f"{addr[0]}:{addr[1]}")
        self._remotes[addr] = remote
        if len(self._remotes) > MAX_REMOTES:
            del self._remotes[next(iter(self._remotes))]
        frames = remote.framer.feed_datagram(data)
        if frames:
            remote.received_s = asyncio.get_running_loop().time()
            remote.systems.update(source_of(frame)[0] for frame in frames)
            if self._address.kind == "udpin":
                self._target = addr
        return remote.name, frames

    def error_received(self, exc: Exception) -> None:
        """Ignore ICMP errors: the address has no listener, or the network is unreachable."""
        if not isinstance(exc, OSError) or exc.errno not in SILENCE:
            self._listener.failed(exc)

    def connection_lost(self, exc: Exception | None) -> None:
        """Record that the socket is closed."""
        self._closed.set()


# Streams --------------------------------------------------------------------------------------


class Stream(asyncio.Protocol):
    """One TCP connection or one open serial line, until it is lost."""

    def __init__(self, listener: Listener) -> None:
        self.lost = asyncio.Event()
        self.received_frames = False
        self.out: asyncio.WriteTransport | None = None
        self._read_transport: asyncio.BaseTransport | None = None
        self._framer = Framer()
        self._listener = listener
        self.remote = ""

    def send(self, frames: list[bytes]) -> bool:
        """Send frames unless the remote has stopped reading; return whether they were sent."""
        if self.lost.is_set() or self.out is None:
            return False
        if self.out.get_write_buffer_size() > MAX_UNSENT_BYTES:
            return False
        self.out.write(b"".join(frames))
        return True

    async def close(self) -> None:
        """Close when the buffered data is sent, but after one second at the latest."""
        if self.out is not None:
            self.out.close()
        try:
            async with asyncio.timeout(CLOSE_WITHIN_S):
                await self.lost.wait()
        except TimeoutError:
            if self.out is not None:
                self.out.abort()
            await self.lost.wait()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Record that the connection is open."""
        self._read_transport = transport
        host_and_port = transport.get_extra_info("peername") or ()
        self.remote = ":".join(str(part) for part in host_and_port[:2])
        if isinstance(transport, asyncio.Transport):  # a serial line has a separate write transport
            self.out = transport

    def data_received(self, data: bytes) -> None:
        """Pass the frames in received bytes to the listener; frames may be in parts."""
        frames = self._framer.feed(data)
        if frames:
            self.received_frames = True
            self._listener.frames_received([(self.remote, frames)])

    def connection_lost(self, exc: Exception | None) -> None:
        """Record that the connection is closed, by the remote or by us."""
        self.lost.set()
        if self.out is not None and self.out is not self._read_transport:
            self.out.abort()

    def writing_ended(self) -> None:
        """Close after the write transport of a serial line has closed."""
        if self._read_transport is not None:
            self._read_transport.close()


class StreamClient:
    """A client connection that reconnects after every loss."""

    def __init__(
        self,
        connect: Callable[[], Awaitable[Stream]],
        listener: Listener,
        address: LinkAddress | SerialAddress,
    ) -> None:
        self.called = ""  # the link has only one remote
        self._connect = connect
        self._listener = listener
        self._address = address
        self._stream: Stream | None = None
        self._task: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Start to connect.

        A serial device must exist, and a host name must resolve; a TCP server may start later.
        """
        if isinstance(self._address, LinkAddress):
            await look_up(self._address)
        else:
            try:
                self._stream = await self._connect()
            except OSError as error:
                raise BridgeError(
                    f"link {self._address}: cannot be opened ({reason_of(error)}); check that the "
                    "device is connected, that you may read and write it, and that no other "
                    "program uses it"
                ) from None
        self._task = asyncio.create_task(self._stay_connected())
        self._task.add_done_callback(self._ended)

    async def _stay_connected(self) -> None:
        failures = 0
        while True:
            failures += 1
            try:
                if self._stream is None:
                    async with asyncio.timeout(CONNECT_WITHIN_S):
                        self._stream = await self._connect()
                await self._stream.lost.wait()
                if self._stream.received_frames:
                    failures = 0
            except OSError:  # also TimeoutError, if the server does not listen yet
                pass
            self._stream = None
            await asyncio.sleep(reconnect_wait_s(failures))

    def _ended(self, task: "asyncio.Task[None]") -> None:
        error = None if task.cancelled() else task.exception()
        if isinstance(error, Exception):
            self._listener.failed(error)

    def send(self, frames: list[bytes], remote: str = "") -> bool:
        """Send frames if there is a connection, and return whether they were sent."""
        return self._stream is not None and self._stream.send(frames)

    async def close(self) -> None:
        """Disconnect, and stop reconnecting."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
        if self._stream is not None:
            await self._stream.close()


class TcpServer:
    """A TCP server that sends to all its connections."""

    def __init__(self, address: LinkAddress, listener: Listener) -> None:
        self.called = ""
        self._address = address
        self._listener = listener
        self._streams: list[Stream] = []
        self._server: asyncio.Server | None = None

    async def open(self) -> None:
        """Bind and listen."""
        sock = socket_of(socket.SOCK_STREAM)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bind(sock, self._address, (self._address.host, self._address.port))
        self._server = await asyncio.get_running_loop().create_server(self._accept, sock=sock)

    def _accept(self) -> Stream:
        stream = Stream(self._listener)
        self._streams = [*(old for old in self._streams if not old.lost.is_set()), stream]
        return stream

    def send(self, frames: list[bytes], remote: str = "") -> bool:
        """Send frames to all connections or to one remote; return whether any were sent."""
        addressed = [stream for stream in self._streams if remote == stream.remote]
        sent = [stream.send(frames) for stream in addressed or self._streams]
        return any(sent)

    async def close(self) -> None:
        """Stop listening and close all connections."""
        if self._server is not None:
            self._server.close()
        connected = [stream for stream in self._streams if stream.out is not None]
        await asyncio.gather(*(stream.close() for stream in connected))


async def _call(address: LinkAddress, listener: Listener) -> Stream:
    """Return a new connection to a TCP server. Raises OSError."""
    loop = asyncio.get_running_loop()
    sock = socket_of(socket.SOCK_STREAM)
    try:
        await loop.sock_connect(sock, (address.host, address.port))
        _, stream = await loop.create_connection(lambda: Stream(listener), sock=sock)
    except BaseException:
        sock.close()
        raise
    return stream


async def _open_serial(address: SerialAddress, listener: Listener) -> Stream:
    """Return a newly opened serial line (POSIX). Raises OSError."""
    try:
        import serial
    except ImportError:
        raise BridgeError(
            f"link {address}: serial lines need pyserial: pip install pyserial"
        ) from None
    loop = asyncio.get_running_loop()
    try:
        port = serial.Serial(address.device, address.baud, timeout=0, exclusive=True)
    except ValueError as error:
        raise BridgeError(f"link {address}: {error}") from None
    # asyncio's pipes work on any character device. Each pipe closes its file, so each needs its
    # own.
    _, stream = await loop.connect_read_pipe(lambda: Stream(listener), port)
    writable = os.fdopen(os.dup(port.fileno()), "wb", buffering=0)
    try:
        stream.out, _ = await loop.connect_write_pipe(lambda: _Writing(stream), writable)
    except BaseException:
        writable.close()
        stream.writing_ended()
        raise
    return stream


class _Writing(asyncio.BaseProtocol):
    """The protocol of a serial line's write transport."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream

    def connection_lost(self, exc: Exception | None) -> None:
        """Close the serial line after its device was closed or removed."""
        self._stream.writing_ended()
