"""Simulates a link in memory with loss, delay, reordering and duplication."""

import heapq
import random


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
        if not (self._loss or self._jitter_us or self._duplication):
            self._deliver(datagram, now_us + self._delay_us)
            return
        copies = 2 if self._random.random() < self._duplication else 1
        for _ in range(copies):
            if self._random.random() < self._loss:
                continue
            late_us = self._random.randrange(self._jitter_us + 1)
            self._deliver(datagram, now_us + self._delay_us + late_us)

    def _deliver(self, datagram: bytes, at_us: int) -> None:
        self._sent += 1
        heapq.heappush(self._in_transit, (at_us, self._sent, datagram))

    def next_timer(self) -> int | None:
        """Return the arrival time of the next datagram; None if no datagram is in transit."""
        return self._in_transit[0][0] if self._in_transit else None

    def receive(self, now_us: int) -> list[bytes]:
        """Remove and return the datagrams that have arrived by ``now_us``."""
        arrived: list[bytes] = []
        in_transit = self._in_transit
        while in_transit and in_transit[0][0] <= now_us:
            arrived.append(heapq.heappop(in_transit)[2])
        return arrived
