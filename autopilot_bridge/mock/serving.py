"""Mocks on a link: several with different system ids, keys of signing, simulation time."""

from collections.abc import Callable, Sequence

from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.connection import Connection, Peer
from autopilot_bridge.links.framing import frames_of
from autopilot_bridge.links.signing import Key, Signing, is_secret
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.fault_injection import FaultyMock


class MockGroup:
    """Several mocks as one peer of a link: all receive every datagram, and all may send."""

    def __init__(self, peers: Sequence[MockAutopilot | FaultyMock]) -> None:
        self.peers = peers
        self.mocks = [peer.mock if isinstance(peer, FaultyMock) else peer for peer in peers]

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process a datagram."""
        for peer in self.peers:
            peer.receive_data(data, now_us)

    def data_to_send(self) -> list[bytes]:
        """Datagrams of all mocks."""
        return [datagram for peer in self.peers for datagram in peer.data_to_send()]

    def next_timer(self) -> int:
        """Return time of the first mock's next ``handle_timer`` call."""
        return min(peer.next_timer() for peer in self.peers)

    def handle_timer(self, now_us: int) -> None:
        """Fly all of them."""
        for peer in self.peers:
            peer.handle_timer(now_us)


_ID = b"\x00\x01\x00"  # 256 as a header has it: most datagrams need no look at each frame


class SigningServer:
    """Passes frames to a mock or a fleet, and the key of a SETUP_SIGNING to ``learned``.

    None for a key of zeros, which turns signing off. As on ArduPilot, not while armed.
    """

    def __init__(self, peer: MockGroup, learned: Callable[[Key | None], None]) -> None:
        self._peer: Peer = peer
        self._mocks = peer.mocks
        self._learned = learned
        self._codec = Codec(1, 1)

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process whole frames."""
        if _ID in data:
            for frame in filter(is_secret, frames_of(data)):
                self._learn_key(frame)
        self._peer.receive_data(data, now_us)

    def _learn_key(self, frame: bytes) -> None:
        for message in self._codec.decode_frames([frame]):
            ids = {mock.system_id for mock in self._mocks}
            armed = any(mock.flight.armed for mock in self._mocks)
            if message.target_system in ids and not armed:
                secret = bytes(message.secret_key)
                self._learned(Key(secret) if any(secret) else None)

    def data_to_send(self) -> list[bytes]:
        """Return frames of the mock."""
        return self._peer.data_to_send()

    def next_timer(self) -> int | None:
        """Return time of the mock's next ``handle_timer`` call."""
        return self._peer.next_timer()

    def handle_timer(self, now_us: int) -> None:
        """Fly the mock."""
        self._peer.handle_timer(now_us)


async def serve(
    mock: Peer,
    link: str,
    speedup: float,
    clock: Callable[[], int],
    opened: Callable[[], None] = lambda: None,
    signing: Signing | None = None,
    learns: Callable[[Key], Signing] | None = None,
) -> None:
    """Fly a mock or a fleet on a link until cancelled. ``clock`` gives real microseconds.

    ``opened`` is called when the link is open. With ``learns`` a fleet signs with received keys; it
    makes the signing for a key.
    """
    began_us = clock()

    def simulation_us() -> int:
        return int((clock() - began_us) * speedup)

    peer = mock
    if learns is not None and isinstance(mock, MockGroup):
        peer = SigningServer(
            mock, lambda key: connection.change_signing(None if key is None else learns(key))
        )
    connection = Connection(link, peer, simulation_us, rate=speedup, signing=signing)
    async with connection:
        opened()
        while True:
            await connection.wait()
