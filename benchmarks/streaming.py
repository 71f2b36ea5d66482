"""Telemetry of a fleet to one process: ``python -m benchmarks.streaming [--vehicles N]``.

Each vehicle sends HEARTBEAT at 1 Hz and GLOBAL_POSITION_INT and ATTITUDE at 4 Hz over UDP on
loopback, from a separate socket in another process. The receiver has one client and one port for
each vehicle, or one port for all vehicles. The share of a core is from getrusage, the loss from the
sequence numbers. The limits are 25 % of one core for 250 vehicles, and no loss.
"""

import argparse
import asyncio
import json
import resource
import socket
import subprocess
import sys
import time
from contextlib import AsyncExitStack

import click
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.clients.shared_link import SharedLink
from autopilot_bridge.links.asyncio_connection import Connection, Peer
from autopilot_bridge.links.codec import Codec
from benchmarks.link_shared import clock_us, free_ports

MAX_SHARE = 0.25
TICK_S = 0.02
SETTLE_S = 3.0
PERIOD_TICKS = round(0.25 / TICK_S)


class Counts:
    """Counts of received and, by sequence numbers, missed frames."""

    def __init__(self) -> None:
        self.received = self.missed = self.events = 0
        self._last: dict[int, int] = {}

    def add(self, frame: bytes) -> None:
        """Count a MAVLink 2 frame."""
        seq, system = frame[4], frame[5]
        self.received += 1
        self.missed += (seq - self._last.get(system, seq - 1) - 1) % 256
        self._last[system] = seq


class CountingClient(NativeClient):
    """Client of one vehicle that counts its frames and events."""

    def __init__(self, system: int, counts: Counts) -> None:
        super().__init__(target_system=system)
        self._counts = counts

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Count and process a datagram of whole frames without signatures."""
        at = 0
        while at < len(data):
            self._counts.add(data[at:])
            at += 12 + data[at + 1]
        super().receive_data(data, now_us)
        while self.next_event() is not None:
            self._counts.events += 1


class CountingFleet(SharedLink):
    """Link of all vehicles on one port that counts their frames and events."""

    def __init__(self, counts: Counts) -> None:
        super().__init__("one port")
        self._counts = counts

    def receive_frames(self, remote: str, frames: list[bytes], now_us: int, link: int = 0) -> None:
        """Count and process whole frames."""
        for frame in frames:
            self._counts.add(frame)
        super().receive_frames(remote, frames, now_us, link)
        while self.next_event() is not None:
            self._counts.events += 1


async def receive(vehicles: int, one_port: bool, seconds: float) -> dict[str, float]:
    """Receive the telemetry of all vehicles; return the share of a core and the counts."""
    counts = Counts()
    systems = range(1, vehicles + 1)
    each = [CountingClient(system, counts) for system in systems]
    peers: list[Peer] = [CountingFleet(counts)] if one_port else [*each]
    ports = free_ports(len(peers))
    connections: list[Connection] = []
    async with AsyncExitStack() as stack:
        for port, peer in zip(ports, peers, strict=True):
            link = f"udpin:127.0.0.1:{port}"
            connection = await stack.enter_async_context(Connection(link, peer, clock_us))
            connections.append(connection)
        numbers = [str(n) for n in (vehicles, seconds + SETTLE_S, *ports)]
        command = [sys.executable, "-m", "benchmarks.streaming", "--send", *numbers]
        sender = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE)
        await asyncio.sleep(SETTLE_S)
        used, began_s = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
        await asyncio.sleep(seconds - 1.0)
        now, ended_s = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
        output, _ = await sender.communicate()
        await asyncio.sleep(0.2)
        for connection in connections:
            await connection.wait()  # raises the error of a connection
    cpu_s = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
    sent = sum(json.loads(output).values())
    return {
        "share": cpu_s / (ended_s - began_s),
        "sent": sent,
        "missed": counts.missed,
        "lost": sent - counts.received,
        "events": counts.events,
    }


def send(vehicles: int, seconds: float, ports: list[int]) -> dict[int, int]:
    """Send the telemetry of all vehicles, evenly in time; return the frames sent by each."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(vehicles)]
    codecs = [Codec(system, 1) for system in range(1, vehicles + 1)]
    sent = dict.fromkeys(range(1, vehicles + 1), 0)
    began_s = time.perf_counter()
    for tick in range(round(seconds / TICK_S)):
        time.sleep(max(began_s + tick * TICK_S - time.perf_counter(), 0.0))
        for index in range(tick % PERIOD_TICKS, vehicles, PERIOD_TICKS):
            ms = round(1000 * tick * TICK_S) + 100
            messages = [
                mavlink.MAVLink_global_position_int_message(ms, 1, 2, 3, 4, 5, 6, 7, 8),
                mavlink.MAVLink_attitude_message(ms, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
            ]
            if tick // PERIOD_TICKS % 4 == 0:
                messages.append(mavlink.MAVLink_heartbeat_message(1, 12, 81, 1 << 18, 4, 3))
            for message in messages:
                frame = codecs[index].encode(message)
                sockets[index].sendto(frame, ("127.0.0.1", ports[index % len(ports)]))
                sent[index + 1] += 1
    return sent


def main() -> None:
    """Print the share of a core and the loss; exit with 1 if a limit is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=250)
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--send", nargs="+", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.send:
        vehicles, seconds, *ports = arguments.send
        sent = send(int(vehicles), float(seconds), [int(port) for port in ports])
        click.echo(json.dumps(sent), nl=False)
        return
    failed = False
    for one_port in (False, True):
        found = asyncio.run(receive(arguments.vehicles, one_port, arguments.seconds))
        failed |= found["share"] > MAX_SHARE or found["lost"] != 0
        where = "one port" if one_port else "a port each"
        click.echo(
            f"{arguments.vehicles} vehicles, {where}: {100 * found['share']:.1f} % of a core "
            f"({found['share'] / MAX_SHARE:.2f} of the limit), {found['sent']:.0f} frames, "
            f"{found['lost']:.0f} lost ({found['missed']:.0f} by sequence), "
            f"{found['events']:.0f} events"
        )
    sys.exit(int(failed))


if __name__ == "__main__":
    main()
