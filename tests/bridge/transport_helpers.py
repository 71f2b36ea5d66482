"""A peer that receives texts, and other parts that tests of real links share."""

import asyncio
import socket
import time
from collections.abc import Callable, Coroutine
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.codec import Codec
from tests.patience import PATIENCE_S

WITHIN_S = 2 * PATIENCE_S


def clock_us() -> int:
    return time.monotonic_ns() // 1000


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        port: int = sock.getsockname()[1]
        return port


def text(words: str) -> bytes:
    """Return a frame that contains this text."""
    return Codec(1, 1).encode(mavlink.MAVLink_statustext_message(6, words.encode()))


class Peer:
    """A peer: the texts that it received, and the frames to send."""

    def __init__(self) -> None:
        self.received: list[str] = []
        self.outgoing: list[bytes] = []
        self._codec = Codec(255, 190)

    def receive_data(self, data: bytes, now_us: int) -> None:
        self.received += [message.text for message in self._codec.decode(data)]

    def data_to_send(self) -> list[bytes]:
        frames, self.outgoing = self.outgoing, []
        return frames

    def next_timer(self) -> int | None:
        return None

    def handle_timer(self, now_us: int) -> None:
        pass


def run(test: Callable[[], Coroutine[Any, Any, Any]]) -> Any:
    """Run a coroutine of a test; fail if it takes too long."""

    async def bounded() -> Any:
        return await asyncio.wait_for(test(), WITHIN_S)

    return asyncio.run(bounded())


async def receive_exactly(connection: Connection, peer: Peer, *expected: str) -> None:
    """Wait until the peer has received exactly these texts."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            while len(peer.received) < len(expected):
                await connection.wait()
    except TimeoutError:
        pass
    assert peer.received == list(expected)


def udp_socket() -> socket.socket:
    """Return a separate UDP socket, as another remote."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.settimeout(PATIENCE_S)
    return sock
