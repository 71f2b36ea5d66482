"""A real service for the map's tests: daemon and mock autopilots as `demo` runs them."""

import json
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from mission_service.config.scenario import scenario_path
from mission_service.interfaces.api.access.token_file import added
from tests.patience import PATIENCE_S

CLI = [sys.executable, "-m", "mission_service.cli"]
ALL = ("look", "correct", "fly", "approve")

HTTP = """
[service.http]
listen = "127.0.0.1:{http}"
tokens = "{tokens}"
"""
FIRE = (
    """
name = "map-test"
seed = 1
duration_s = 100000
start_s = 2400
deploy_at_s = 2400
[landscape]
source = "jacksboro"
rows = 100
cols = 100
cell_size_m = 30
[[ignition]]
lat_deg = 36.350
lon_deg = -84.160
[[weather]]
at_s = 0
wind_speed_m_s = 4
wind_from_deg = 45
dead_1h_pct = 4
[planner]
rule = "islam_hu_damped"
[[vehicles]]
name = "hawk"
stack = "px4"
kind = "plane"
link = "udpin:127.0.0.1:{hawk}"
system_id = 1
altitude_agl_m = 150
airspeed_m_s = 12
home_lat_deg = 36.352
home_lon_deg = -84.157
autostart = true
[[vehicles]]
name = "kite"
stack = "ardupilot"
kind = "plane"
link = "udpin:127.0.0.1:{kite}"
system_id = 2
altitude_agl_m = 200
airspeed_m_s = 12
home_lat_deg = 36.351
home_lon_deg = -84.155
autostart = true
"""
    + HTTP
)
FORMATION = (
    FIRE.replace('rule = "islam_hu_damped"', 'rule = "formation"')
    + """
[mission]
approval = "each"
"""
)
BURN = (
    scenario_path("burn")
    .read_text(encoding="utf-8")
    .replace("127.0.0.1:14550", "127.0.0.1:{hawk}")
    .replace("deploy_at_s = 240", "deploy_at_s = 60")
    + HTTP
)


class Service(NamedTuple):
    """A running daemon and its tokens: one with all roles, and one with the role look."""

    address: str
    boss: str
    looker: str
    process: "subprocess.Popen[bytes]"
    log: Path

    def get(self, path: str) -> Any:
        """Return the JSON at a path of the API."""
        return self._ask(path, None)

    def post(self, path: str, **body: Any) -> Any:
        """Send a POST request; return the response."""
        return self._ask(path, json.dumps(body).encode())

    def _ask(self, path: str, body: bytes | None) -> Any:
        headers = {"Authorization": f"Bearer {self.boss}", "Content-Type": "application/json"}
        asked = urllib.request.Request(f"{self.address}/api/v1/{path}", body, headers)
        with urllib.request.urlopen(asked, timeout=PATIENCE_S) as answer:
            return json.load(answer)

    def ready(self) -> bool:
        """Return whether the daemon replies; fail if it has ended."""
        if self.process.poll() is not None:
            pytest.fail(self.log.read_text(encoding="utf-8"))
        try:
            return bool(self.get("state")["telemetry"])
        except (urllib.error.URLError, ConnectionError):
            return False


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def wait_for(what: Callable[[], Any], within_s: float, words: str) -> Any:
    """Wait for a condition; return its value; fail if it takes too long (at least PATIENCE_S)."""
    began, within_s = time.monotonic(), max(within_s, PATIENCE_S)
    while not (found := what()):
        if time.monotonic() - began > within_s:
            pytest.fail(f"not within {within_s} s: {words}")
        time.sleep(0.25)
    return found


@contextmanager
def running(folder: Path, scenario: str, speedup: int) -> Iterator[Service]:
    """Run the demo of a scenario in a context."""
    tokens, log = folder / "tokens.toml", folder / "log"
    boss = added(tokens, "boss", ALL, "")
    looker = added(tokens, "looker", ("look",), "")
    http = free_port(socket.SOCK_STREAM)
    ports = {"hawk": free_port(), "kite": free_port(), "http": http, "tokens": tokens}
    path = folder / "scenario.toml"
    path.write_text(scenario.format(**ports), encoding="utf-8")
    words = ["demo", str(path), "--out", str(folder / "out"), "--speedup", str(speedup)]
    with log.open("wb") as output:
        process = subprocess.Popen([*CLI, *words], stdout=output, stderr=subprocess.STDOUT)
        try:
            service = Service(f"http://127.0.0.1:{http}", boss, looker, process, log)
            wait_for(service.ready, 120, "the service is ready")
            yield service
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
            try:
                process.wait(timeout=PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(timeout=PATIENCE_S)
