"""Upload by the native client and by MAVSDK: ``python -m benchmarks.mavsdk_compare [--items N]``.

Both clients upload new missions alternately to the same mock PX4 over UDP on loopback; MAVSDK runs
in a separate process. The native client also waits until the autopilot reports the first item as
current. The times are from the call to the end of the upload, without the connection.
"""

import argparse
import asyncio
import statistics
import subprocess
import sys
import time

import click

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.vehicle.client_events import TransferFinished
from benchmarks.link_shared import clock_us, free_ports, mission_of

MAVSDK = """
import sys, time
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.mission_raw.mission_raw import MissionItem

link, count, shift = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
client = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
client.add_any_connection(link)
missions = MissionRaw(client.first_autopilot(15.0))
items = [
    MissionItem(seq, 0, 16, int(seq == 0), 1, 0, 0, 0, 0, 363020000 + 1000 * seq, -842000000, shift)
    for seq in range(count)
]
began = time.perf_counter()
missions.upload_mission(items)
print(time.perf_counter() - began)
"""


async def ours_s(port: int, count: int, shift_m: float) -> float:
    """Return the seconds of one upload by the native client."""
    client = NativeClient()
    async with Connection(f"udpin:127.0.0.1:{port}", client, clock_us) as connection:
        while client.stack is None:
            await connection.wait()
        began_s = time.perf_counter()
        transfer = client.upload(mission_of(count, shift_m), clock_us())
        connection.flush()
        while True:
            await connection.wait()
            while (event := client.next_event()) is not None:
                if isinstance(event, TransferFinished) and event.transfer_id == transfer:
                    if event.result.outcome != "accepted":
                        sys.exit(f"ours: {event.result.reason}")
                    return time.perf_counter() - began_s


def mavsdk_s(port: int, count: int, shift_m: float) -> float:
    """Return the seconds of one upload by MAVSDK."""
    link = f"udpin://127.0.0.1:{port}"
    command = [sys.executable, "-c", MAVSDK, link, str(count), str(400.0 + shift_m)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    if ended.returncode != 0:
        sys.exit(f"MAVSDK: {ended.stderr.strip().splitlines()[-1:]}")
    return float(ended.stdout.splitlines()[-1])


def main() -> None:
    """Print the time of each upload, the medians and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--items", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    (port,) = free_ports(1)
    mock = [sys.executable, "-m", "mission_service.cli", "mock", "--stack", "px4"]
    mock += ["--param", "MIS_TKO_LAND_REQ=0"]  # the missions have no landing
    mock += ["--home", "36.3,-84.2,300", "--link", f"udpout:127.0.0.1:{port}"]
    process = subprocess.Popen(mock, stdout=subprocess.DEVNULL)
    ours, theirs = [], []
    try:
        for number in range(arguments.rounds):
            ours.append(asyncio.run(ours_s(port, arguments.items, 2.0 * number)))
            theirs.append(mavsdk_s(port, arguments.items, 2.0 * number + 1.0))
            click.echo(f"ours {ours[-1]:.3f} s, MAVSDK {theirs[-1]:.3f} s")
    finally:
        process.kill()
        process.wait(timeout=10)
    ratio = statistics.median(ours) / statistics.median(theirs)
    click.echo(
        f"{arguments.items} items, median of {arguments.rounds}: ours "
        f"{statistics.median(ours):.3f} s, MAVSDK {statistics.median(theirs):.3f} s, "
        f"ours / MAVSDK {ratio:.2f}"
    )


if __name__ == "__main__":
    main()
