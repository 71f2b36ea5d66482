"""Process of the mocks of ``load.py``: ``python -m benchmarks.load_mocks SCENARIO [STAMPS]``.

The process writes a record of each sent position into STAMPS: system id, lat_e7, lon_e7 and the
time in microseconds of CLOCK_MONOTONIC. ``--speedup`` is as for ``mission-service mock``. With
``--troubles SECONDS`` each mock has random faults in that time, by ``--seed``: restarts, silence
and loss. With ``--paced`` simulation time advances only while the daemon reads the sent datagrams.
"""

import argparse
import asyncio
import contextlib
import random
import signal
import struct
from collections.abc import Callable, Collection
from pathlib import Path
from typing import IO

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.mock.fault_injection import FaultyMock
from autopilot_bridge.mock.fault_kinds import parse_faults
from autopilot_bridge.mock.serving import MockGroup, serve
from benchmarks.link_shared import clock_us
from mission_service.simulation.mock_processes import MockEnvironment, from_scenario

STAMP = struct.Struct("<Biiq")
POSITION = int(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
PLACE = struct.Struct("<4xii")  # latitude and longitude in the payload
MAX_STEP_S = 1.0  # simulation time between two readings of a paced clock
MAX_UNREAD_BYTES = 16_384  # unread bytes in a socket, counted by the kernel: a few dozen frames
LOOK_EVERY_US = 1_000


class PacedClock:
    """A clock that stops while this process does not run or the daemon does not read its sockets.

    On a busy machine the same flight therefore takes more real time: no datagram is lost in a full
    socket, and no vehicle jumps. ``ports`` are the UDP ports of the daemon.
    """

    def __init__(self, speedup: float, ports: Collection[int]) -> None:
        self._max_step_us = round(MAX_STEP_S / speedup * 1e6)
        self._ports = frozenset(ports)
        self._now_us = self._seen_us = self._looked_us = clock_us()
        self._waits = False

    def __call__(self) -> int:
        """Return the time in microseconds."""
        real_us = clock_us()
        if real_us - self._looked_us >= LOOK_EVERY_US:
            self._looked_us = real_us
            self._waits = max_unread_bytes(self._ports) > MAX_UNREAD_BYTES
        if not self._waits:
            self._now_us += min(real_us - self._seen_us, self._max_step_us)
        self._seen_us = real_us
        return self._now_us


def max_unread_bytes(ports: Collection[int]) -> int:
    """Return the largest number of unread bytes in a UDP socket (IPv4) on these ports."""
    waiting = 0
    for line in Path("/proc/net/udp").read_text("ascii").splitlines()[1:]:
        _, local, _, _, queues, *_ = line.split()
        if int(local.rpartition(":")[2], 16) in ports:
            waiting = max(waiting, int(queues.rpartition(":")[2], 16))
    return waiting


def troubles(seed: int, seconds: float) -> tuple[str, ...]:
    """Return faults of a mock: a loss of 30 %, two periods without frames, and a reboot."""
    rng = random.Random(seed)
    first, second = (rng.uniform(share, share + 0.3) * seconds for share in (0.15, 0.55))
    silence_s = rng.uniform(20.0, 90.0)
    return (
        *("loss=0.3", "delay=0.05", "jitter=0.1", "duplication=0.05"),
        f"silence@{first:.0f}..{first + silence_s:.0f}",
        f"silence@{second:.0f}..{second + silence_s:.0f}",
        f"reboot@{rng.uniform(0.1, 0.85) * seconds:.0f}",
    )


class Stamped:
    """A fleet that records the time of each sent position."""

    def __init__(self, fleet: MockGroup, stamps: IO[bytes]) -> None:
        self.fleet = fleet
        self._stamps = stamps

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Pass data to all mocks."""
        self.fleet.receive_data(data, now_us)

    def next_timer(self) -> int:
        """Return the time of the next timer of the mocks."""
        return self.fleet.next_timer()

    def handle_timer(self, now_us: int) -> None:
        """Handle the due timers of the mocks."""
        self.fleet.handle_timer(now_us)

    def data_to_send(self) -> list[bytes]:
        """Return the MAVLink 2 frames to send, and record their positions."""
        frames = self.fleet.data_to_send()
        for frame in frames:
            if int.from_bytes(frame[7:10], "little") == POSITION:
                lat_e7, lon_e7 = PLACE.unpack_from(frame, 10)
                self._stamps.write(STAMP.pack(frame[5], lat_e7, lon_e7, clock_us()))
        return frames


def _heal(peer: Stamped) -> None:
    """Remove the faults of a fleet."""
    peer.fleet = MockGroup(peer.fleet.mocks)


async def fly(given: argparse.Namespace, stamps: IO[bytes]) -> None:
    """Run all mocks of the scenario until SIGTERM."""
    task = asyncio.current_task()
    assert task is not None
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    mocks = from_scenario(given.scenario, None, (), MockEnvironment())
    clock: Callable[[], int] = clock_us
    if given.paced:
        ports = [int(each.links[0].rpartition(":")[2]) for each in mocks]
        clock = PacedClock(given.speedup, ports)
    async with asyncio.TaskGroup() as group:
        for place, each in enumerate(mocks):
            fleet = each.fleet
            for mock in each.fleet.mocks:
                if mock.stack.name == "px4":  # the missions have no landing
                    mock.parameters.change("MIS_TKO_LAND_REQ", 0.0)
            if given.troubles:
                seed = 1000 * given.seed + place
                faults = parse_faults(troubles(seed, given.troubles))
                fleet = MockGroup([FaultyMock(mock, faults, seed) for mock in fleet.mocks])
            peer = Stamped(fleet, stamps)
            group.create_task(serve(peer, each.links, given.speedup, clock))
            if given.troubles:
                end_s = given.troubles / given.speedup
                asyncio.get_running_loop().call_later(end_s, _heal, peer)


def main() -> None:
    """Run the mocks, as requested on the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("stamps", nargs="?", type=Path, default=Path("/dev/null"))
    parser.add_argument("--speedup", type=float, default=1.0)
    parser.add_argument("--troubles", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--paced", action="store_true")
    given = parser.parse_args()
    with given.stamps.open("wb") as stamps, contextlib.suppress(asyncio.CancelledError):
        asyncio.run(fly(given, stamps))


if __name__ == "__main__":
    main()
