"""Sends and receives the frames of a UDP link."""

import asyncio
import contextlib
import errno
import socket
from dataclasses import dataclass, field

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.framing import Framer, source_of, target_system_of
from autopilot_bridge.links.link_address import LinkAddress
from autopilot_bridge.links.sockets import bind, look_up, reason_of, socket_of
from autopilot_bridge.links.transport import Listener

MAX_REMOTES = 1024
MAX_AT_ONCE = 256  # datagrams read before other tasks run
MAX_DATAGRAM_BYTES = 65536
QUICK_S = 0.002
ANSWER_FOR_S = 10.0
IGNORED_ERRORS = {  # the port, host or network is unreachable, or the send queue is full
    *(errno.ECONNREFUSED, errno.ECONNRESET, errno.EHOSTUNREACH, errno.ENETUNREACH),
    *(errno.ENETDOWN, errno.EHOSTDOWN, errno.ENOBUFS),
}

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
    seconds; if there is none, ``udpin`` sends to the remote that sent last. Frames with a target
    system are sent to the remote of that system.
    """

    def __init__(self, address: LinkAddress, listener: Listener) -> None:
        self.called = ""
        self._address = address
        self._listener = listener
        self._remotes: dict[Where, _Remote] = {}  # in the order of their last frames
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
            _check_allowed(address, self._target)
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
        if remote:  # even a remote that was removed from ``_remotes``
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
        """Pass the frames of this datagram, and of any waiting datagrams, to the listener.

        asyncio reads one datagram per iteration of its loop. More datagrams are read here only if
        they are likely (several remotes, short intervals), because an attempt that finds no
        datagram costs as much as reading one.
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
        """Return the remote of a datagram and the frames that the datagram completes.

        A datagram from port 0 is dropped, because nothing can be sent to this port.
        """
        if not addr[1]:
            return "", []
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
        """Treat an error as a lost datagram; ignore ICMP errors, such as a port without listener.

        The error may concern one remote, so the socket continues for all others.
        """
        if not isinstance(exc, OSError):
            self._listener.failed(exc)
        elif exc.errno not in IGNORED_ERRORS:
            self._listener.datagram_lost(exc)

    def connection_lost(self, exc: Exception | None) -> None:
        """Record that the socket is closed."""
        self._closed.set()


def _check_allowed(address: LinkAddress, target: Where) -> None:
    """Raise BridgeError if the system permits no datagrams to an address, such as a broadcast."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock, contextlib.suppress(OSError):
        try:
            sock.connect(target)  # sends nothing
        except PermissionError as error:
            raise BridgeError(
                f"link {address}: cannot send to this address ({reason_of(error)})"
            ) from None
