"""A mock that learns its key as real autopilots do: it takes the mock's place on a link."""

from collections.abc import Callable

from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.connection import Peer
from autopilot_bridge.links.framing import frames_of
from autopilot_bridge.links.signing import Key, is_secret
from autopilot_bridge.mock.mock_group import MockGroup

_ID = b"\x00\x01\x00"  # 256 as a header has it: most datagrams need no look at each frame


class SigningServer:
    """Hands all on to a mock or a fleet, and ``learned`` the key that SETUP_SIGNING brings.

    None for a key of zeros, which turns signing off. As on ArduPilot, not while armed.
    """

    def __init__(self, peer: MockGroup, learned: Callable[[Key | None], None]) -> None:
        self._peer: Peer = peer
        self._mocks = peer.mocks
        self._learned = learned
        self._codec = Codec(1, 1)

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Take in whole frames."""
        if _ID in data:
            for frame in filter(is_secret, frames_of(data)):
                self._take(frame)
        self._peer.receive_data(data, now_us)

    def _take(self, frame: bytes) -> None:
        for message in self._codec.decode_frames([frame]):
            ids = {mock.system_id for mock in self._mocks}
            armed = any(mock.flight.armed for mock in self._mocks)
            if message.target_system in ids and not armed:
                secret = bytes(message.secret_key)
                self._learned(Key(secret) if any(secret) else None)

    def data_to_send(self) -> list[bytes]:
        """Frames of the mock."""
        return self._peer.data_to_send()

    def next_timer(self) -> int | None:
        """When the mock has something to do."""
        return self._peer.next_timer()

    def handle_timer(self, now_us: int) -> None:
        """Fly the mock."""
        self._peer.handle_timer(now_us)
