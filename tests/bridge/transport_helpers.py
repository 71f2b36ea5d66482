"""A peer that listens, and what the tests of real links share."""

import asyncio
import socket
import time
from collections.abc import Callable, Coroutine
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.connection import Connection
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
    """A frame that holds these words."""
    return Codec(1, 1).encode(mavlink.MAVLink_statustext_message(6, words.encode()))


class Ear:
    """A peer: what it heard, and what it wants to say."""

    def __init__(self) -> None:
        self.heard: list[str] = []
        self.to_say: list[bytes] = []
        self._codec = Codec(255, 190)

    def receive_data(self, data: bytes, now_us: int) -> None:
        self.heard += [message.text for message in self._codec.decode(data)]

    def data_to_send(self) -> list[bytes]:
        said, self.to_say = self.to_say, []
        return said

    def next_timer(self) -> int | None:
        return None

    def handle_timer(self, now_us: int) -> None:
        pass


def run(test: Callable[[], Coroutine[Any, Any, Any]]) -> Any:
    """Run a test's coroutine; it fails when it takes too long."""

    async def bounded() -> Any:
        return await asyncio.wait_for(test(), WITHIN_S)

    return asyncio.run(bounded())


async def heard(connection: Connection, ear: Ear, *expected: str) -> None:
    """Wait until the peer has heard exactly this."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            while len(ear.heard) < len(expected):
                await connection.wait()
    except TimeoutError:
        pass
    assert ear.heard == list(expected)


def udp_socket() -> socket.socket:
    """A remote of one's own."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.settimeout(PATIENCE_S)
    return sock
