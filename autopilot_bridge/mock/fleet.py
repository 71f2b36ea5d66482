"""Several mocks on one link, told apart by their system ids."""

from collections.abc import Sequence

from autopilot_bridge.mock.autopilot import MockAutopilot


class Fleet:
    """Takes the place of one mock on a link: all hear everything, all may speak."""

    def __init__(self, mocks: Sequence[MockAutopilot]) -> None:
        self.mocks = mocks

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take in a datagram."""
        for mock in self.mocks:
            mock.receive_data(data, now_us)

    def data_to_send(self) -> list[bytes]:
        """Datagrams of all."""
        return [datagram for mock in self.mocks for datagram in mock.data_to_send()]

    def next_timer(self) -> int:
        """When the first of them has something to do."""
        return min(mock.next_timer() for mock in self.mocks)

    def handle_timer(self, now_us: int) -> None:
        """Fly all of them."""
        for mock in self.mocks:
            mock.handle_timer(now_us)
