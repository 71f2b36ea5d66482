"""Upload missions to a fleet at once: ``python -m benchmarks.fleet [--vehicles N] [--items N]``.

One process uploads, another runs the mocks; each vehicle has a UDP port on loopback. Every second
vehicle is a PX4 plane, which receives the mission item by item. The others are ArduPlanes, which
receive it as a file that is read back (the default of the bridge, because ArduPlane and its mock
take 20 ms for each item). The limit is 1 s for 100 vehicles with 50 items each, on two cores.
"""

import argparse
import asyncio
import statistics
import subprocess
import sys
import time
from contextlib import AsyncExitStack

import click

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.local_frame import LocalFrame
from autopilot_bridge.mock.serving import serve
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.client_events import TransferFinished
from benchmarks.link_shared import clock_us, free_ports, mission_of

MAX_S = 1.0


async def fly(ports: list[int]) -> None:
    """Run the mocks; reply to each input line with the CPU seconds used so far."""
    loop = asyncio.get_running_loop()
    loop.add_reader(sys.stdin, _report_cpu)
    async with asyncio.TaskGroup() as group:
        for index, port in enumerate(ports):
            stack = stack_named("px4" if index % 2 == 0 else "ardupilot", "plane")
            mock = MockAutopilot(stack, LocalFrame(36.3, -84.2, 300.0), system_id=index + 1)
            if stack.name == "px4":  # the missions have no landing
                mock.parameters.change("MIS_TKO_LAND_REQ", 0.0)
            group.create_task(serve(mock, f"udpout:127.0.0.1:{port}", 1.0, clock_us))


def _report_cpu() -> None:
    if sys.stdin.readline():
        click.echo(f"{time.process_time()}")


class Vehicle:
    """One vehicle with its client and its connection."""

    def __init__(self, system: int, connection: Connection, client: NativeClient) -> None:
        self.stack = "px4" if system % 2 == 1 else "ardupilot"
        self._connection = connection
        self._client = client

    async def connected(self) -> None:
        """Wait for the first heartbeat of the vehicle."""
        while self._client.stack is None:
            await self._connection.wait()

    async def upload(self, count: int, shift_m: float) -> tuple[str, str, float]:
        """Upload a mission; return the stack, the outcome and the duration in seconds."""
        began_s = time.perf_counter()
        transfer = self._client.upload(mission_of(count, shift_m), clock_us())
        self._connection.flush()
        while True:
            while (event := self._client.next_event()) is not None:
                if isinstance(event, TransferFinished) and event.transfer_id == transfer:
                    taken_s = time.perf_counter() - began_s
                    return self.stack, event.result.outcome, taken_s
            await self._connection.wait()


async def run(vehicles: int, items: int, rounds: int) -> bool:
    """Return True if all uploads of all rounds were accepted within the limit."""
    ports = free_ports(vehicles)
    good = True
    async with AsyncExitStack() as stack:
        fleet = []
        for system, port in enumerate(ports, start=1):
            client = NativeClient(target_system=system)
            connection = Connection(f"udpin:127.0.0.1:{port}", client, clock_us)
            await stack.enter_async_context(connection)
            fleet.append(Vehicle(system, connection, client))
        command = [sys.executable, "-m", "benchmarks.fleet", "--fly", *map(str, ports)]
        mocks = await asyncio.create_subprocess_exec(
            *command, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

        async def mock_cpu_s() -> float:
            assert mocks.stdin is not None
            assert mocks.stdout is not None
            mocks.stdin.write(b"\n")
            return float(await mocks.stdout.readline())

        try:
            await asyncio.gather(*(vehicle.connected() for vehicle in fleet))
            for number in range(rounds):
                before = await mock_cpu_s(), time.process_time(), time.perf_counter()
                ended = await asyncio.gather(*(v.upload(items, number) for v in fleet))
                taken_s = time.perf_counter() - before[2]
                own_s, mock_s = time.process_time() - before[1], await mock_cpu_s() - before[0]
                accepted = [entry for entry in ended if entry[1] == "accepted"]
                good &= len(accepted) == vehicles and taken_s <= MAX_S
                medians = " ".join(
                    f"{name} {statistics.median(s for n, _, s in ended if n == name):.2f}"
                    for name in sorted({name for name, _, _ in ended})
                )
                click.echo(
                    f"{len(accepted)}/{vehicles} with {items} items in {taken_s:.2f} s "
                    f"({taken_s / MAX_S:.2f} of the limit); CPU: ours {own_s:.2f} s, "
                    f"mocks {mock_s:.2f} s; median of one: {medians} s"
                )
        finally:
            mocks.kill()
            await mocks.wait()
    return good


def main() -> None:
    """Print the time of each round and its share of the limit; exit with 1 above the limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--items", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--fly", nargs="+", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.fly:
        asyncio.run(fly(arguments.fly))
    elif not asyncio.run(run(arguments.vehicles, arguments.items, arguments.rounds)):
        sys.exit(1)


if __name__ == "__main__":
    main()
