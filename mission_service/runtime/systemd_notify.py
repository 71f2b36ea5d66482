"""Measures the delay of the event loop and notifies systemd (sd_notify(3)).

Without systemd (no NOTIFY_SOCKET) only the delay is measured.
"""

import asyncio
import os
import socket
from collections import deque
from collections.abc import Callable

from mission_service.runtime.run_context import RunContext

BEAT_S = 1.0
LAG_OF_BEATS = 15  # the usual scrape interval of Prometheus


def notify_systemd(state: str) -> bool:
    """Send lines such as READY=1, and return whether the lines were sent. Raises no exception."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return False
    if address.startswith("@"):  # the address of an abstract socket
        address = "\0" + address[1:]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.setblocking(False)
        try:
            sock.sendto(state.encode(), address)
        except OSError:
            return False
    return True


def watchdog_s() -> float | None:
    """Return the notification interval that systemd requires; None without a watchdog."""
    microseconds = os.environ.get("WATCHDOG_USEC", "")
    pid = os.environ.get("WATCHDOG_PID", str(os.getpid()))
    if not microseconds.isdigit() or int(microseconds) == 0 or pid != str(os.getpid()):
        return None
    return int(microseconds) / 1e6


def status_of(context: RunContext) -> str:
    """Return one line for ``systemctl status``."""
    vehicles = context.state_view.vehicles.values()
    online = sum(state.link == "online" for state in vehicles)
    words = f"{context.scenario.name}: {online} of {len(vehicles)} vehicles online"
    return f"{words}, {len(context.state_view.alarms)} alarms"


async def pulse(context: RunContext, notify: Callable[[str], bool] = notify_systemd) -> None:
    """Notify systemd from the event loop until cancelled; a blocked loop is thereby detected."""
    loop = asyncio.get_running_loop()
    lags_s = deque([0.0], maxlen=LAG_OF_BEATS)
    context.gauges["event_loop_lag_seconds"] = lambda: max(lags_s)
    within_s = watchdog_s()
    every_s = BEAT_S if within_s is None else min(BEAT_S, within_s / 3)
    notify("READY=1")
    try:
        while True:
            notify(f"WATCHDOG=1\nSTATUS={status_of(context)}")
            due_s = loop.time() + every_s
            await asyncio.sleep(every_s)
            lags_s.append(max(loop.time() - due_s, 0.0))
    finally:
        notify("STOPPING=1")
