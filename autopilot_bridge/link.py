"""Links: connection strings, and a link in memory that loses, delays, reorders and doubles."""

import heapq
import random
from dataclasses import dataclass
from typing import Literal

from autopilot_bridge.errors import BridgeError


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """``udpin`` listens and answers whoever spoke last; ``udpout`` speaks first."""

    kind: Literal["udpin", "udpout"]
    host: str
    port: int


def parse_link(text: str) -> LinkAddress:
    """Read ``udpin:HOST:PORT`` or ``udpout:HOST:PORT``."""
    kind, _, rest = text.partition(":")
    host, _, port = rest.rpartition(":")
    if kind not in ("udpin", "udpout") or not host or not port.isdigit():
        raise BridgeError(f"link {text!r}: write it as udpin:HOST:PORT or udpout:HOST:PORT")
    if not 0 < int(port) < 65536:
        raise BridgeError(f"link {text!r}: port {port} is not between 1 and 65535")
    return LinkAddress("udpin" if kind == "udpin" else "udpout", host, int(port))


class MemoryLink:
    """One direction of a link. The same seed and traffic give the same fate to every datagram."""

    def __init__(
        self,
        loss: float = 0.0,
        delay_us: int = 0,
        jitter_us: int = 0,
        duplication: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._loss = loss
        self._delay_us = delay_us
        self._jitter_us = jitter_us
        self._duplication = duplication
        self._random = random.Random(seed)
        self._under_way: list[tuple[int, int, bytes]] = []
        self._sent = 0

    def send(self, datagram: bytes, now_us: int) -> None:
        """Put a datagram on its way."""
        copies = 2 if self._random.random() < self._duplication else 1
        for _ in range(copies):
            if self._random.random() < self._loss:
                continue
            late_us = self._random.randrange(self._jitter_us + 1)
            self._sent += 1
            heapq.heappush(
                self._under_way, (now_us + self._delay_us + late_us, self._sent, datagram)
            )

    def next_timer(self) -> int | None:
        """When the next datagram arrives."""
        return self._under_way[0][0] if self._under_way else None

    def receive(self, now_us: int) -> list[bytes]:
        """What has arrived by now."""
        arrived = []
        while self._under_way and self._under_way[0][0] <= now_us:
            arrived.append(heapq.heappop(self._under_way)[2])
        return arrived
