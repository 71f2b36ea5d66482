"""Several mocks on one link, told apart by their system ids."""

from collections.abc import Sequence

from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.fault_injection import FaultyMock


class MockGroup:
    """Takes the place of one mock on a link: all hear everything, all may speak."""

    def __init__(self, peers: Sequence[MockAutopilot | FaultyMock]) -> None:
        self.peers = peers
        self.mocks = [peer.mock if isinstance(peer, FaultyMock) else peer for peer in peers]

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take in a datagram."""
        for peer in self.peers:
            peer.receive_data(data, now_us)

    def data_to_send(self) -> list[bytes]:
        """Datagrams of all."""
        return [datagram for peer in self.peers for datagram in peer.data_to_send()]

    def next_timer(self) -> int:
        """When the first of them has something to do."""
        return min(peer.next_timer() for peer in self.peers)

    def handle_timer(self, now_us: int) -> None:
        """Fly all of them."""
        for peer in self.peers:
            peer.handle_timer(now_us)
