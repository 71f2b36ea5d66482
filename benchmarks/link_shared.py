"""Clock, ports and missions for benchmarks over real links."""

import socket
import time
from contextlib import ExitStack

from autopilot_bridge.items import MissionItem, loiter_unlimited, waypoint


def clock_us() -> int:
    """Return the monotonic clock in microseconds."""
    return time.monotonic_ns() // 1000


def free_ports(count: int, kind: socket.SocketKind = socket.SOCK_DGRAM) -> list[int]:
    """Return different ports that are free now: of UDP, or of TCP with SOCK_STREAM."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket(socket.AF_INET, kind)) for _ in range(count)]
        for sock in sockets:
            sock.bind(("127.0.0.1", 0))
        return [sock.getsockname()[1] for sock in sockets]


def free_tcp_port() -> int:
    """Return a TCP port that is free now."""
    return free_ports(1, socket.SOCK_STREAM)[0]


def mission_of(count: int, shift_m: float) -> tuple[MissionItem, ...]:
    """Return waypoints and a final loiter; ``shift_m`` is added to the altitudes."""
    points = [waypoint(36.302 + 1e-4 * i, -84.2, 400.0 + shift_m) for i in range(count - 1)]
    return (*points, loiter_unlimited(36.31, -84.19, 420.0 + shift_m, -90.0))
