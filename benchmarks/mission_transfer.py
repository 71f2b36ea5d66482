"""Item protocol and MAVFTP compared: ``python -m benchmarks.mission_transfer [--sitl HOST:PORT]``.

The transfers run in virtual time with the mock, over a link with a delay of 10 ms in each direction
(the mock replies at once; ArduPlane takes 20 ms for an item). With ``--sitl`` they also run with a
real ArduPilot that sends to HOST:PORT, and replace its mission. Each uploaded mission is downloaded
by the other protocol and compared.
"""

import argparse
import socket
import time
from typing import Protocol

import click

from autopilot_bridge.items import MissionItem, loiter_unlimited, waypoint
from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.missions.download import MissionDownload
from autopilot_bridge.missions.ftp import FtpDownload, FtpUpload, next_session
from autopilot_bridge.missions.read_back import same_mission
from autopilot_bridge.missions.transfer import Address, TransferResult, TransferTiming
from autopilot_bridge.missions.upload import MissionUpload
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.local_frame import LocalFrame
from autopilot_bridge.stacks.stacks import stack_named
from benchmarks.link_shared import clock_us

STATION = (255, 190)
HOME = (36.3, -84.2, 300.0)
DELAY_US = 10_000  # delay of the link in each direction
Transfer = MissionUpload | MissionDownload | FtpUpload | FtpDownload
ARDUPLANE = stack_named("ardupilot", "plane")


class Vehicle(Protocol):
    """An autopilot at the other end of a link."""

    target: tuple[int, int]

    def run(self, transfer: Transfer) -> float:
        """Run a transfer and return its duration in seconds."""


class MockVehicle:
    """The mock autopilot in virtual time."""

    target = (1, 1)

    def __init__(self, loss: float) -> None:
        self._mock = MockAutopilot(ARDUPLANE, LocalFrame(*HOME))
        self._up, self._down = (MemoryLink(loss, DELAY_US, seed=seed) for seed in (1, 2))
        self._codec = Codec(*STATION)
        self._now_us = 0

    def run(self, transfer: Transfer) -> float:
        """Run a transfer and return its duration in virtual seconds."""
        began_us = self._now_us
        self._send(transfer.start(self._now_us))
        while transfer.result is None:
            links = (self._up.next_timer(), self._down.next_timer())
            timers = (transfer.next_timer(), self._mock.next_timer(), *links)
            due_us = min(timer for timer in timers if timer is not None)
            self._now_us = max(self._now_us, due_us)
            self._step(transfer)
        return (self._now_us - began_us) / 1e6

    def _step(self, transfer: Transfer) -> None:
        now_us = self._now_us
        for datagram in self._up.receive(now_us):
            self._mock.receive_data(datagram, now_us)
        self._mock.handle_timer(now_us)
        for datagram in self._mock.data_to_send():
            self._down.send(datagram, now_us)
        for datagram in self._down.receive(now_us):
            for message in self._codec.decode(datagram):
                self._send(transfer.receive(message, now_us))
        self._send(transfer.handle_timer(now_us))

    def _send(self, messages: list[Message]) -> None:
        for message in messages:
            self._up.send(self._codec.encode(message), self._now_us)


class SocketVehicle:
    """An autopilot that sends to a UDP port of this machine."""

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self._socket.bind((host, port))
        self._socket.settimeout(60.0)
        self._codec = Codec(*STATION)
        while True:
            data, self._remote = self._socket.recvfrom(65536)
            heartbeats = [m for m in self._codec.decode(data) if m.get_type() == "HEARTBEAT"]
            if heartbeats:
                source = heartbeats[0]
                self.target = (source.get_srcSystem(), source.get_srcComponent())
                return

    def run(self, transfer: Transfer) -> float:
        """Run a transfer and return its duration in seconds of the clock."""
        began_us = clock_us()
        self._send(transfer.start(began_us))
        while transfer.result is None:
            wait_s = (transfer.next_timer() - clock_us()) / 1e6
            self._socket.settimeout(max(wait_s, 1e-4))
            try:
                data, self._remote = self._socket.recvfrom(65536)
            except TimeoutError:
                self._send(transfer.handle_timer(clock_us()))
                continue
            for message in self._codec.decode(data):
                self._send(transfer.receive(message, clock_us()))
        return (clock_us() - began_us) / 1e6

    def _send(self, messages: list[Message]) -> None:
        for message in messages:
            self._socket.sendto(self._codec.encode(message), self._remote)


def mission_of(count: int, shift: float) -> tuple[MissionItem, ...]:
    """Return MAVLink items, home first; ``shift`` in m is added to the altitudes."""
    points = [waypoint(36.302 + 1e-4 * i, -84.2 + 1e-4 * i, 400.0 + shift) for i in range(count)]
    return (*points[:-1], loiter_unlimited(36.31, -84.19, 420.0 + shift, -90.0))


def _checked(result: TransferResult | None) -> TransferResult:
    if result is None or result.outcome != "accepted":
        raise SystemExit(f"a transfer did not succeed: {result}")
    return result


def compare(vehicle: Vehicle, count: int) -> dict[str, float]:
    """Return the seconds of upload and download by each protocol; exit if a mission differs."""
    address, timing = Address(STATION, vehicle.target), TransferTiming()
    session = time.time_ns() // 10**9 % 255 + 1
    taken: dict[str, float] = {}
    by_items, by_file = mission_of(count, 0.0), mission_of(count, 30.0)
    for name, transfer, held in (
        ("items up", MissionUpload(address, by_items, 1, timing), by_items),
        ("ftp down", FtpDownload(address, session, timing), by_items),
        ("ftp up", FtpUpload(address, by_file, count, next_session(session), timing), by_file),
        ("items down", MissionDownload(address, timing), by_file),
    ):
        taken[name] = vehicle.run(transfer)
        read = _checked(transfer.result).items or ()
        if not same_mission(held, read, ARDUPLANE):
            raise SystemExit(f"{name}: the downloaded mission differs from the uploaded mission")
    return taken


def main() -> None:
    """Print the times and ratios of all transfers."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--items", type=int, default=650, help="with home")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--sitl", metavar="HOST:PORT")
    arguments = parser.parse_args()
    vehicles: list[tuple[str, Vehicle]] = [
        ("mock", MockVehicle(0.0)),
        ("mock, 5 % loss each way", MockVehicle(0.05)),
    ]
    if arguments.sitl:
        host, _, port = arguments.sitl.rpartition(":")
        vehicles.append((f"autopilot at {arguments.sitl}", SocketVehicle(host, int(port))))
    for name, vehicle in vehicles:
        for _ in range(arguments.runs):
            taken = compare(vehicle, arguments.items)
            click.echo(f"{name}, {arguments.items} items")
            for direction in ("up", "down"):
                items_s, ftp_s = taken[f"items {direction}"], taken[f"ftp {direction}"]
                click.echo(
                    f"  {direction:4} items {items_s:7.2f} s  ftp {ftp_s:6.3f} s"
                    f"  ratio {items_s / ftp_s:5.1f}"
                )


if __name__ == "__main__":
    main()
