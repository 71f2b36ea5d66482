"""A mock autopilot in a separate process that connects to a port, for other MAVLink clients."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from autopilot_bridge.items import MissionItem, loiter_unlimited, takeoff, waypoint
from tests.patience import PATIENCE_S

HOME = (36.3, -84.2, 300.0)


def free_port() -> int:
    """Return a UDP port of this machine that is not in use."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        port: int = sock.getsockname()[1]
        return port


@contextmanager
def mock_process(
    port: int,
    stack: str,
    kind: str = "plane",
    speedup: float = 1.0,
    link: str = "udpout",
    faults: tuple[str, ...] = (),
) -> Iterator["subprocess.Popen[bytes]"]:
    """Start the mock of a stack at HOME; it connects to the port.

    With a speed-up its timeouts are shorter: at 20, PX4 aborts after a quarter of a second.
    """
    command = [sys.executable, "-m", "mission_service.cli", "mock", "--stack", stack]
    command += ["--vehicle", kind, "--home", ",".join(str(value) for value in HOME)]
    if stack == "px4":  # the missions have no landing
        command += ["--param", "MIS_TKO_LAND_REQ=0"]
    command += ["--speedup", str(speedup), "--link", f"{link}:127.0.0.1:{port}"]
    for fault in faults:
        command += ["--fault", fault]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait(timeout=PATIENCE_S)


def short_mission(legs: int = 3) -> tuple[MissionItem, ...]:
    """Return a takeoff, waypoints 111 m apart to the north, and an endless loiter at the last."""
    lat, lon, altitude_m = HOME
    points = [waypoint(lat + 0.001 * leg, lon, altitude_m + 20.0) for leg in range(1, legs + 1)]
    last = loiter_unlimited(lat + 0.001 * legs, lon, altitude_m + 20.0, 80.0)
    return takeoff(lat, lon, altitude_m + 20.0), *points, last
