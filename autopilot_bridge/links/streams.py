"""Sends and receives the frames of TCP connections and serial lines."""

import asyncio
import os
import socket

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.framing import Framer
from autopilot_bridge.links.link_address import LinkAddress, SerialAddress
from autopilot_bridge.links.sockets import bind, socket_of
from autopilot_bridge.links.transport import Listener

# If a remote does not read, frames beyond this buffer size are dropped, as on a radio link.
MAX_UNSENT_BYTES = 256 * 1024
CLOSE_WITHIN_S = 1.0


class Stream(asyncio.Protocol):
    """One TCP connection or one open serial line, until the connection is lost."""

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
        """Close when the buffered data has been sent, or after one second."""
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
        """Pass the frames in received bytes to the listener; a frame may arrive in parts."""
        frames = self._framer.feed(data)
        if frames:
            self.received_frames = True
            self._listener.frames_received([(self.remote, frames)])

    def connection_lost(self, exc: Exception | None) -> None:
        """Record that either end has closed the connection."""
        self.lost.set()
        if self.out is not None and self.out is not self._read_transport:
            self.out.abort()

    def writing_ended(self) -> None:
        """Close after the write transport of a serial line has closed."""
        if self._read_transport is not None:
            self._read_transport.close()


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


async def connect_tcp(address: LinkAddress, listener: Listener) -> Stream:
    """Connect to a TCP server. Raises OSError."""
    loop = asyncio.get_running_loop()
    sock = socket_of(socket.SOCK_STREAM)
    try:
        await loop.sock_connect(sock, (address.host, address.port))
        _, stream = await loop.create_connection(lambda: Stream(listener), sock=sock)
    except BaseException:
        sock.close()
        raise
    return stream


async def open_serial(address: SerialAddress, listener: Listener) -> Stream:
    """Open a serial line (POSIX). Raises OSError, or BridgeError if pyserial is missing."""
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
    # asyncio's pipes work on any character device. Each pipe closes its file, so each pipe has a
    # file of its own.
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
