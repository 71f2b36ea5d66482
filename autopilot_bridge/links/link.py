"""Parses link addresses, and simulates a link with loss, delay, reordering and duplication."""

import heapq
import random
from dataclasses import dataclass
from typing import Literal, cast

from autopilot_bridge.errors import BridgeError

NetworkKind = Literal["udpin", "udpout", "tcp", "tcpin"]
# For each kind of link, the kind that the program at the other end uses.
_OTHER_END = {"udpin": "udpout", "udpout": "udpin", "tcp": "tcpin", "tcpin": "tcp"}
FIRST_WAIT_S = 0.25
LONGEST_WAIT_S = 5.0


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """A UDP or TCP address: ``udpin`` and ``tcpin`` listen, ``udpout`` and ``tcp`` connect."""

    kind: NetworkKind
    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class SerialAddress:
    """A serial line, e.g. a telemetry radio."""

    device: str
    baud: int

    def __str__(self) -> str:
        return f"serial:{self.device}:{self.baud}"


def parse_link(text: str) -> LinkAddress | SerialAddress:
    """Parse ``udpin:``, ``udpout:``, ``tcp:`` or ``tcpin:HOST:PORT``, or ``serial:DEVICE:BAUD``."""
    kind, _, rest = text.partition(":")
    host_or_device, _, number = rest.rpartition(":")
    if kind not in (*_OTHER_END, "serial"):
        kinds = ", ".join(_OTHER_END)
        raise BridgeError(f"link {text!r}: begin with {kinds} or serial, as in udpin:HOST:PORT")
    form = "serial:DEVICE:BAUD" if kind == "serial" else f"{kind}:HOST:PORT"
    if not host_or_device or not (number.isascii() and number.isdigit()):
        raise BridgeError(f"link {text!r}: write it as {form}")
    if kind == "serial":
        if not 0 < int(number) <= 10_000_000:
            raise BridgeError(f"link {text!r}: {number} is not a baud rate; 57600 is usual")
        return SerialAddress(host_or_device, int(number))
    if not 0 < int(number) < 65536:
        raise BridgeError(f"link {text!r}: port {number} is not between 1 and 65535")
    return LinkAddress(cast(NetworkKind, kind), host_or_device, int(number))


def other_end(link: str) -> str:
    """Return the link for the program at the other end, e.g. ``udpout:...`` for ``udpin:...``."""
    address = parse_link(link)
    if isinstance(address, SerialAddress):
        raise BridgeError(f"link {link!r}: a serial line has no network port; use udpin or tcpin")
    return f"{_OTHER_END[address.kind]}:{address.host}:{address.port}"


def reconnect_wait_s(failures: int) -> float:
    """Return the seconds to wait before connecting again, after ``failures`` failed attempts."""
    return float(min(FIRST_WAIT_S * 2 ** min(failures, 16), LONGEST_WAIT_S))


class MemoryLink:
    """One direction of a link in memory.

    The same seed and the same traffic cause the same faults.
    """

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
        self._in_transit: list[tuple[int, int, bytes]] = []
        self._sent = 0

    def send(self, datagram: bytes, now_us: int) -> None:
        """Send a datagram."""
        copies = 2 if self._random.random() < self._duplication else 1
        for _ in range(copies):
            if self._random.random() < self._loss:
                continue
            late_us = self._random.randrange(self._jitter_us + 1)
            self._sent += 1
            heapq.heappush(
                self._in_transit, (now_us + self._delay_us + late_us, self._sent, datagram)
            )

    def next_timer(self) -> int | None:
        """Return the arrival time of the next datagram; None if no datagram is in transit."""
        return self._in_transit[0][0] if self._in_transit else None

    def receive(self, now_us: int) -> list[bytes]:
        """Remove and return the datagrams that have arrived by ``now_us``."""
        arrived = []
        while self._in_transit and self._in_transit[0][0] <= now_us:
            arrived.append(heapq.heappop(self._in_transit)[2])
        return arrived
