"""Connects links to a peer in asyncio: moves frames between them and sets the peer's timer.

A *peer* is a protocol endpoint that does no input or output of its own. A *remote* is an endpoint
at the other end of a link: an address and port, or a connection. A connection usually has one link.
If it has several, they are numbered from 0; each has its own transport, signature link id and
counts.
"""

import asyncio
from collections.abc import Callable, Sequence
from typing import Protocol, Self, runtime_checkable

from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.link_address import parse_link
from autopilot_bridge.links.signing import Counts, Key, Signing, is_secret, is_signed, setup_signing
from autopilot_bridge.links.sockets import reason_of
from autopilot_bridge.links.tlog_writer import Tlog
from autopilot_bridge.links.transport import Batch
from autopilot_bridge.links.transports import transport_of

SHORTEST_WAIT_S = 0.001
MAX_VERIFIED = 2048  # number of frames whose copies over other links are recognised


class Peer(Protocol):
    """A protocol endpoint without input or output: a station's client or a mock autopilot."""

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process complete frames that all come from one remote."""

    def data_to_send(self) -> list[bytes]:
        """Return the frames to send."""

    def next_timer(self) -> int | None:
        """Return the time of the next ``handle_timer`` call; None if no action is due."""

    def handle_timer(self, now_us: int) -> None:
        """Run all actions due at ``now_us``."""


@runtime_checkable
class RemotesPeer(Protocol):
    """A client or mock that distinguishes the remote endpoints of a link by their names."""

    called: dict[int, str]  # by link: the remote to which it connects, "" if it listens

    def receive_frames(self, remote: str, frames: list[bytes], now_us: int, link: int) -> None:
        """Process complete frames from a remote of a link."""

    def receive_copies(self, remote: str, frames: list[bytes], now_us: int, link: int) -> None:
        """Process signed frames that were already received over another link."""

    def addressed_to_send(self) -> list[tuple[int, str, bytes]]:
        """Return the frames to send, each with its link and remote; "" means all remotes."""


class Port:
    """One link of a connection: its transport, the id of its signatures, and its frames.

    Args:
        number: The number of the link, from 0.
        address: The address of the link.
        link_id: The link id in signatures, 0 to 255.
        connection: Receives the frames.
    """

    def __init__(self, number: int, address: str, link_id: int, connection: "Connection") -> None:
        self.number = number
        self.address = address
        self.link_id = link_id
        self.counts = Counts()  # of this link; ``signing`` has the counts of all links
        self.receives_signed = False  # True if the last frame was signed but not verified
        self.lost_datagrams = 0  # through errors other than an unreachable remote or network
        self.last_error = ""
        self.transport = transport_of(parse_link(address), self)
        self._connection = connection

    def frames_received(self, batch: Batch) -> None:
        """Pass the frames of each remote to the connection."""
        self._connection.frames_received(batch, self)

    def datagram_lost(self, error: OSError) -> None:
        """Count a lost datagram."""
        self.lost_datagrams += 1
        self.last_error = reason_of(error)

    def failed(self, error: Exception) -> None:
        """Store an error of the transport; ``Connection.wait`` raises this error."""
        self._connection.raise_in_wait(error)


class Connection:
    """The connection of one peer to its links while the context (``async with``) is open.

    Args:
        link: The address of the link: ``udpin:HOST:PORT``, ``tcp:HOST:PORT``, ``serial:...``; or
            several addresses, for a peer that distinguishes links.
        peer: The client or mock at this end.
        clock: Returns the peer's time in microseconds.
        rate: The speed of ``clock`` relative to real time.
        tlog: Records the frames sent and received; the caller closes it.
        signing: Signs all sent frames; received frames without a valid signature are dropped.
        link_id: The link id in signatures, 0 to 255; or one for each link.

    Raises:
        BridgeError: The address is not valid, or cannot be opened when the context is entered.
    """

    def __init__(
        self,
        link: str | Sequence[str],
        peer: Peer,
        clock: Callable[[], int],
        rate: float = 1.0,
        tlog: Tlog | None = None,
        signing: Signing | None = None,
        link_id: int | Sequence[int] = 0,
    ) -> None:
        links = (link,) if isinstance(link, str) else tuple(link)
        link_ids = (link_id,) if isinstance(link_id, int) else tuple(link_id)
        self.ports = tuple(
            Port(number, address, signs_as, self)
            for number, (address, signs_as) in enumerate(zip(links, link_ids, strict=True))
        )
        self._peer = peer
        self._by_remote = peer if isinstance(peer, RemotesPeer) else None
        self._clock = clock
        self._rate = rate
        self._tlog = tlog
        self._signing = signing
        self._verified: dict[bytes, int] = {}  # the last signed frames, and their links
        self._activity = asyncio.Event()
        self._open = False
        self._timer: asyncio.TimerHandle | None = None
        self._armed_us = 0  # time at which the timer expires
        self._failure: Exception | None = None

    async def __aenter__(self) -> Self:
        opened: list[Port] = []
        try:
            for port in self.ports:
                await port.transport.open()
                opened.append(port)
        except BaseException:
            for port in opened:
                await port.transport.close()
            raise
        if self._by_remote is not None:
            for port in self.ports:
                self._by_remote.called[port.number] = port.transport.called
        self._open = True
        self._wake()
        return self

    async def __aexit__(self, *error: object) -> None:
        self._open = False
        if self._timer is not None:
            self._timer.cancel()
        for port in self.ports:
            await port.transport.close()

    async def wait(self) -> None:
        """Wait until frames have arrived or the timer has expired since the last call.

        The peer's exceptions are raised again here, so that a defect ends the program and is not
        only logged. A lost connection raises no exception: the peer then receives no frames.
        """
        await self._activity.wait()
        self._activity.clear()
        if self._failure is not None:
            raise self._failure

    def flush(self) -> None:
        """Send the peer's frames and set the timer."""
        if self._by_remote is not None:
            for link, remote, frame in self._by_remote.addressed_to_send():
                self._send([frame], self.ports[link], remote)
        elif frames := self._peer.data_to_send():
            self._send(frames, self.ports[0])
        self._arm()

    def notify(self) -> None:
        """Flush, and let ``wait`` return; for peers that create events without input."""
        self._guarded(lambda: None)

    def set_up_signing(
        self,
        own: tuple[int, int],
        target: tuple[int, int],
        key: Key | None,
        wall_us: int,
        signing: Signing | None,
    ) -> None:
        """Send the key (None stops signing) to a vehicle, then use ``signing`` for the link.

        The key is sent in clear text and is not recorded. The message is sent twice because
        vehicles do not acknowledge it. A vehicle that already signs accepts only frames signed with
        its old key.
        """
        codec = Codec(*own)
        for _ in range(2):
            self._send([codec.encode(setup_signing(target, key, wall_us))], self.ports[0])
        self.change_signing(signing)

    def change_signing(self, signing: Signing | None) -> None:
        """Sign and verify with another key from now on; with None, neither sign nor verify."""
        self._signing = signing
        for port in self.ports:
            port.receives_signed = False

    def _send(self, frames: list[bytes], port: Port, remote: str = "") -> None:
        if not self._open:
            return
        if self._signing is not None:
            frames = [self._signing.sign(frame, port.link_id) for frame in frames]
        if port.transport.send(frames, remote):
            self._record(frames, port)

    def _record(self, frames: list[bytes], port: Port) -> None:
        if self._tlog is not None:
            self._tlog.record([frame for frame in frames if not is_secret(frame)], port.number)

    def _arm(self) -> None:
        due_us = self._peer.next_timer()
        if due_us is None or not self._open:
            return
        if self._timer is not None:
            if self._armed_us <= due_us:
                # The timer is set again when it expires; setting it for every datagram costs more.
                return
            self._timer.cancel()
        self._armed_us = due_us
        wait_s = max((due_us - self._clock()) / 1e6 / self._rate, SHORTEST_WAIT_S)
        self._timer = asyncio.get_running_loop().call_later(wait_s, self._wake)

    def _wake(self) -> None:
        self._timer = None
        self._guarded(lambda: self._peer.handle_timer(self._clock()))

    def _guarded(self, handle: Callable[[], None]) -> None:
        try:
            handle()
            self.flush()
        except Exception as error:
            self._failure = error
        self._activity.set()

    def frames_received(self, batch: Batch, port: Port) -> None:
        """Pass the frames of each remote to the peer."""
        if self._signing is not None:
            batch = [(remote, self._accepted(remote, frames, port)) for remote, frames in batch]
        elif batch and batch[-1][1]:
            port.receives_signed = is_signed(batch[-1][1][-1])
        if any(frames for _, frames in batch):
            self._guarded(lambda: self._deliver(batch, port))

    def _accepted(self, remote: str, frames: list[bytes], port: Port) -> list[bytes]:
        """Return the frames with valid signatures.

        A frame that a router sends over several links is valid on the first link only, like
        any repeated frame. Its copies on the other links show that those links work.
        """
        assert self._signing is not None
        accepted, copies = [], []
        for frame in frames:
            if self._verified.get(frame, port.number) != port.number:
                copies.append(frame)
            elif self._signing.accepts(frame, port.counts):
                accepted.append(frame)
                if len(self.ports) > 1:
                    self._verified[frame] = port.number
        while len(self._verified) > MAX_VERIFIED:
            del self._verified[next(iter(self._verified))]
        if copies and self._by_remote is not None:
            self._by_remote.receive_copies(remote, copies, self._clock(), port.number)
        return accepted

    def _deliver(self, batch: Batch, port: Port) -> None:
        for remote, frames in batch:
            self._record(frames, port)
            if self._by_remote is not None:
                self._by_remote.receive_frames(remote, frames, self._clock(), port.number)
            else:
                self._peer.receive_data(b"".join(frames), self._clock())

    def raise_in_wait(self, error: Exception) -> None:
        """Store an error, which ``wait`` raises."""
        self._failure = error
        self._activity.set()
