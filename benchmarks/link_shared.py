"""What benchmarks over real links need."""

import socket
import time

from autopilot_bridge.items import MissionItem, loiter_unlimited, waypoint


def clock_us() -> int:
    """Real time."""
    return time.monotonic_ns() // 1000


def free_ports(count: int) -> list[int]:
    """Different UDP ports nobody uses now."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    for sock in sockets:
        sock.bind(("127.0.0.1", 0))
    ports = [sock.getsockname()[1] for sock in sockets]
    for sock in sockets:
        sock.close()
    return ports


def mission_of(count: int, shift_m: float) -> tuple[MissionItem, ...]:
    """Waypoints and a loiter at the end; ``shift_m`` makes missions differ."""
    points = [waypoint(36.302 + 1e-4 * i, -84.2, 400.0 + shift_m) for i in range(count - 1)]
    return (*points, loiter_unlimited(36.31, -84.19, 420.0 + shift_m, -90.0))
