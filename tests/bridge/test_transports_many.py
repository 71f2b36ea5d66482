"""Many vehicles on one UDP port; timers of a connection."""

import asyncio
import socket
import time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.codec import Codec
from tests.bridge.transport_helpers import (
    Peer,
    clock_us,
    free_port,
    receive_exactly,
    run,
    text,
    udp_socket,
)
from tests.patience import PATIENCE_S


def order(target: int) -> bytes:
    """Return a command for one system; 0 means all systems."""
    zeros = [0.0] * 7
    return Codec(255, 190).encode(mavlink.MAVLink_command_long_message(target, 1, 16, 0, *zeros))


def text_of(system: int, words: str) -> bytes:
    return Codec(system, 1).encode(mavlink.MAVLink_statustext_message(6, words.encode()))


def waiting(sock: socket.socket) -> list[bytes]:
    found = []
    sock.settimeout(0.2)
    try:
        while True:
            found.append(sock.recv(999))
    except TimeoutError:
        return found


def test_each_vehicle_gets_what_is_meant_for_it_and_what_is_for_all() -> None:
    async def exchange() -> list[list[bytes]]:
        port, peer = free_port(), Peer()
        async with Connection(f"udpin:127.0.0.1:{port}", peer, clock_us) as connection:
            with udp_socket() as one, udp_socket() as two, udp_socket() as also_two:
                for sock, system in ((one, 1), (one, 0), (two, 2), (also_two, 2)):
                    sock.sendto(text_of(system, "here"), ("127.0.0.1", port))
                await receive_exactly(connection, peer, *["here"] * 4)
                peer.outgoing = [order(1), order(2), order(0), order(3), text("to all")]
                connection.flush()
                return [await asyncio.to_thread(waiting, sock) for sock in (one, two, also_two)]

    to_one, to_two, also_to_two = run(exchange)
    for_all = [order(0), order(3), text("to all")]
    assert to_one == [order(1), *for_all]
    assert to_two == also_to_two == [order(2), *for_all]


def test_bursts_of_several_remotes_arrive_whole_and_in_order() -> None:
    words = [f"number {index}" for index in range(400)]

    async def exchange() -> list[str]:
        port, peer = free_port(), Peer()
        async with Connection(f"udpin:127.0.0.1:{port}", peer, clock_us) as connection:
            with udp_socket() as one, udp_socket() as two:
                for index, word in enumerate(words):
                    sock = one if index % 2 else two
                    sock.sendto(text_of(index % 2, word), ("127.0.0.1", port))
                async with asyncio.timeout(PATIENCE_S):
                    while len(peer.received) < len(words):
                        await connection.wait()
        return peer.received

    assert run(exchange) == words


class Alarms(Peer):
    """A peer that records the times at which its timer expires."""

    def __init__(self, first_us: int) -> None:
        super().__init__()
        self.due_us: int | None = first_us
        self.called_us: list[int] = []

    def next_timer(self) -> int | None:
        return self.due_us

    def handle_timer(self, now_us: int) -> None:
        if self.due_us is not None and now_us >= self.due_us:
            self.called_us.append(now_us)
            self.due_us = None


def test_a_timer_that_becomes_sooner_is_kept_and_one_that_becomes_later_too() -> None:
    async def exchange() -> list[float]:
        began_us = clock_us()
        peer = Alarms(began_us + 60_000_000)
        async with Connection(f"udpin:127.0.0.1:{free_port()}", peer, clock_us) as connection:
            late_s = []
            for wait_us in (100_000, 250_000):
                peer.due_us = clock_us() + 50_000
                connection.flush()
                peer.due_us = due_us = clock_us() + wait_us
                connection.flush()
                deadline_s = time.monotonic() + PATIENCE_S
                while peer.due_us is not None and time.monotonic() < deadline_s:
                    await connection.wait()
                late_s.append((peer.called_us[-1] - due_us) / 1e6)
            return late_s

    assert all(0.0 <= late_s < PATIENCE_S for late_s in run(exchange))
