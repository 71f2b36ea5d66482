"""Runs mocks on a link: groups of mocks, signing keys, simulation time."""

from collections.abc import Callable, Sequence

from autopilot_bridge.links.asyncio_connection import Connection, Peer
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.framing import frames_of
from autopilot_bridge.links.signing import Key, Signing, is_secret
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.fault_injection import FaultyMock


class MockGroup:
    """Several mocks that are one peer of a link: all receive every datagram, and all may send."""

    def __init__(self, peers: Sequence[MockAutopilot | FaultyMock]) -> None:
        self.peers = peers
        self.mocks = [peer.mock if isinstance(peer, FaultyMock) else peer for peer in peers]

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process a datagram."""
        for peer in self.peers:
            peer.receive_data(data, now_us)

    def data_to_send(self) -> list[bytes]:
        """Return the datagrams of all mocks."""
        return [datagram for peer in self.peers for datagram in peer.data_to_send()]

    def next_timer(self) -> int:
        """Return the time of the next ``handle_timer`` call of any mock."""
        return min(peer.next_timer() for peer in self.peers)

    def handle_timer(self, now_us: int) -> None:
        """Run all mocks until ``now_us``."""
        for peer in self.peers:
            peer.handle_timer(now_us)


class ChannelGroup(MockGroup):
    """Mocks with several channels: the peer of a connection with as many links."""

    def __init__(self, mocks: Sequence[MockAutopilot], channels: int) -> None:
        super().__init__(mocks)
        self.called: dict[int, str] = {}
        for mock in self.mocks:
            mock.open_channels(channels)

    def receive_frames(self, remote: str, frames: list[bytes], now_us: int, link: int) -> None:
        """Process frames that arrived on a channel."""
        for mock in self.mocks:
            mock.receive_on_channel(link, b"".join(frames), now_us)

    def receive_copies(self, remote: str, frames: list[bytes], now_us: int, link: int) -> None:
        """Ignore frames that were already received on another channel."""

    def addressed_to_send(self) -> list[tuple[int, str, bytes]]:
        """Return the frames to send, each with its channel, to all remotes."""
        return [
            (channel, "", frame)
            for mock in self.mocks
            for channel, frame in mock.channel_data_to_send()
        ]


_ID = b"\x00\x01\x00"  # message id 256 in a header; other datagrams are not parsed


class SigningServer:
    """A peer that passes frames to a group of mocks, and keys from SETUP_SIGNING to ``on_key``.

    A key of zeros, which turns signing off, is passed as None. Like ArduPilot, the peer ignores
    keys while a mock is armed.
    """

    def __init__(self, peer: MockGroup, on_key: Callable[[Key | None], None]) -> None:
        self._peer: Peer = peer
        self._mocks = peer.mocks
        self._on_key = on_key
        self._codec = Codec(1, 1)

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process frames."""
        if _ID in data:
            for frame in filter(is_secret, frames_of(data)):
                self._process_key(frame)
        self._peer.receive_data(data, now_us)

    def _process_key(self, frame: bytes) -> None:
        for message in self._codec.decode_frames([frame]):
            ids = {mock.system_id for mock in self._mocks}
            armed = any(mock.flight.armed for mock in self._mocks)
            if message.target_system in ids and not armed:
                secret = bytes(message.secret_key)
                self._on_key(Key(secret) if any(secret) else None)

    def data_to_send(self) -> list[bytes]:
        """Return the frames of the mocks."""
        return self._peer.data_to_send()

    def next_timer(self) -> int | None:
        """Return the time of the next ``handle_timer`` call."""
        return self._peer.next_timer()

    def handle_timer(self, now_us: int) -> None:
        """Run the mocks until ``now_us``."""
        self._peer.handle_timer(now_us)


async def serve(
    mock: Peer,
    link: str | Sequence[str],
    speedup: float,
    clock: Callable[[], int],
    opened: Callable[[], None] = lambda: None,
    signing: Signing | None = None,
    learns: Callable[[Key], Signing] | None = None,
) -> None:
    """Run a mock or a group on a link until cancelled; ``clock`` returns real microseconds.

    A ``ChannelGroup`` has several links, and does not receive keys from SETUP_SIGNING. ``opened``
    is called when the link is open. If ``learns`` is given, a group signs with the keys that it
    receives; ``learns`` returns the ``Signing`` object for a key.
    """
    began_us = clock()

    def simulation_us() -> int:
        return int((clock() - began_us) * speedup)

    peer = mock
    channels = isinstance(mock, ChannelGroup)
    if learns is not None and isinstance(mock, MockGroup) and not channels:
        peer = SigningServer(
            mock, lambda key: connection.change_signing(None if key is None else learns(key))
        )
    link_ids = 0 if isinstance(link, str) else range(len(link))
    connection = Connection(link, peer, simulation_us, speedup, None, signing, link_ids)
    async with connection:
        opened()
        while True:
            await connection.wait()
