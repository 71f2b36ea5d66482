"""The watch of ``watch.py`` live, in separate processes; a mock and the service are killed.

    python -m benchmarks.live_watch [MINUTES] [--speedup N] [--seed N] [--out FOLDER]

``mission-service run`` and a ``mission-service mock`` for each of the four planes run ``--speedup``
times as fast as real time. A simulated person orders over HTTP the start of each vehicle whose
battery has been replaced. After a third of the time the mock of the vehicle on task is killed with
SIGKILL and stays dead; after two thirds the service is killed and started again. All figures are
measured from the journal after the end, by the functions of ``watch.py``. Exit with 1 if a limit of
``watch.py`` is exceeded, if the journal does not replay to the same commands, or if no vehicle is
on task for longer than ``MAX_GAP_S``.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

from autopilot_bridge.links.link_address import other_end
from benchmarks.link_shared import free_ports, free_tcp_port
from benchmarks.load import CLI, Client, cpu_s, ready_after_s, tracebacks_in, verified
from benchmarks.watch import FULL_PCT, report, scenario_of
from mission_service.config.scenario import Scenario, load_scenario
from tests.service.relief_flights import reliefs_in

EVERY_S = 0.5  # real time between two looks of the simulated person
PACKS = 2  # spare batteries of each vehicle: the processes of the mocks share none
WITHIN_S = 60.0  # real time in which a killed service replies again
LATE_S = 120.0  # real time for which the run may continue after its planned end
MAX_GAP_S = 300.0  # without a vehicle on task: a lost link, a takeoff and a flight to the task


def toml_value(value: object) -> str:
    """Return a value as TOML on one line."""
    if isinstance(value, dict):
        pairs = (f"{key} = {toml_value(each)}" for key, each in value.items())
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(toml_value, value))}]"
    return json.dumps(value)


def write_scenario(path: Path, minutes: float, seed: int, http_port: int) -> Scenario:
    """Write the scenario of the watch with free ports; return it as the service reads it."""
    data = scenario_of(minutes / 60.0, seed).model_dump(mode="json", exclude_none=True)
    ports = free_ports(len(data["vehicles"]))
    for vehicle, port in zip(data["vehicles"], ports, strict=True):
        vehicle["link"] = f"udpin:127.0.0.1:{port}"
    data["simulation"]["batteries"]["packs"] = PACKS
    data["service"] = {
        "http": {"listen": f"127.0.0.1:{http_port}"},
        "journal": {"rotate_mb": 1024.0},  # one segment
    }
    lines = (f"{key} = {toml_value(each)}\n" for key, each in data.items())
    path.write_text("".join(lines), "utf-8")
    return load_scenario(str(path))


@dataclass
class LiveWatch:
    """The processes of a watch, and their kills and restarts."""

    path: Path  # the scenario file
    out: Path
    port: int  # of HTTP
    scenario: Scenario
    speedup: float
    mocks: dict[str, "subprocess.Popen[bytes]"] = field(default_factory=dict)
    service: "subprocess.Popen[bytes] | None" = None
    killed: str = ""  # the vehicle whose mock was killed
    killed_at_s: float = 0.0  # mission time
    restarted_at_s: float = 0.0
    down_s: float = 0.0  # real time from the kill of the service to its first reply
    orders: int = 0
    refused: set[str] = field(default_factory=set)  # replies to orders that were refused
    service_cpu_s: float = 0.0
    client: Client = field(init=False)

    def start_mocks(self) -> None:
        """Start one process for each vehicle, in the wind of the scenario."""
        wind = self.scenario.weather[0]
        for section in self.scenario.vehicles:
            words = ["mock", str(self.path), "--vehicle", section.name]
            words += ["--link", other_end(section.link), "--speedup", str(self.speedup)]
            words += ["--wind", f"{wind.wind_from_deg:g},{wind.wind_speed_m_s:g}"]
            self.mocks[section.name] = self._process(f"{section.name}.log", *words)

    def start_service(self) -> None:
        """Start the service, or start it again, and wait until it is ready."""
        began_s = time.monotonic()
        self.service = self._process("run.log", "run", str(self.path), "--out", str(self.out))
        if not self.killed:
            ready_after_s(Client(self.port), began_s, self.service)
        self.client = Client(self.port, (self.out / "token").read_text("ascii").strip())

    def _process(self, log: str, *words: str) -> "subprocess.Popen[bytes]":
        with (self.out / log).open("ab") as output:
            return subprocess.Popen([*CLI, *words], stdout=output, stderr=subprocess.STDOUT)

    def state(self) -> dict[str, Any] | None:
        """Return the state over HTTP, or None without a reply."""
        status, body = self.client.get("/api/v1/state", 10.0)
        state: dict[str, Any] | None = json.loads(body) if status == 200 else None
        return state

    def sign_off(self, state: dict[str, Any]) -> None:
        """Order the start of each vehicle on the ground with a full battery and no sign-off."""
        for each in state["vehicles"]:
            waits = each["waits_for_signoff"] and each["link"] == "online" and not each["armed"]
            charge_pct = each["battery_pct"]
            if waits and charge_pct is not None and charge_pct >= FULL_PCT:
                path = f"/api/v1/vehicles/{each['vehicle']}/start"
                status, body = self.client.post(path, {}, 10.0)
                self.orders += status == 200
                words = body.decode()
                if status != 200 and words not in self.refused:
                    self.refused.add(words)
                    click.echo(f"        {words[:150]}")

    def kill_mock(self, state: dict[str, Any], at_s: float) -> None:
        """Kill the mock of the vehicle on task, if there is one."""
        for each in state["vehicles"]:
            if each["relief"] == "on task":
                self.killed, self.killed_at_s = each["vehicle"], at_s
                self.mocks[self.killed].kill()
                self.mocks[self.killed].wait(timeout=30)
                click.echo(f"{at_s:6.0f} s  killed the mock of {self.killed}, which was on task")

    def kill_service(self, at_s: float) -> None:
        """Kill the service and start it again."""
        assert self.service is not None
        self.service_cpu_s += cpu_s(self.service.pid)
        self.service.kill()
        self.service.wait(timeout=30)
        self.restarted_at_s, began_s = at_s, time.monotonic()
        self.start_service()
        while self.state() is None:
            if self.service.poll() is not None or time.monotonic() > began_s + WITHIN_S:
                raise SystemExit(f"the service does not reply after its restart: see {self.out}")
            time.sleep(0.05)
        self.down_s = time.monotonic() - began_s
        click.echo(f"{at_s:6.0f} s  killed the service; it replied after {self.down_s:.1f} s")

    def fly(self, minutes: float) -> None:
        """Fly until the service ends at the end of the scenario."""
        assert self.service is not None
        until_s = time.monotonic() + minutes * 60.0 / self.speedup + LATE_S
        shown: dict[str, str] = {}
        while self.service.poll() is None:
            if time.monotonic() > until_s:
                raise SystemExit(f"the run does not end {LATE_S:.0f} s after its planned end")
            state = self.state()
            if state is not None:
                at_s = state["status"]["at_us"] / 1e6 - self.scenario.start_s
                self._show(state, at_s, shown)
                self.sign_off(state)
                if not self.killed and at_s >= minutes * 20.0:
                    self.kill_mock(state, at_s)
                if self.killed and not self.restarted_at_s and at_s >= minutes * 40.0:
                    self.kill_service(at_s)
                with contextlib.suppress(OSError):  # the service has ended
                    used_s = cpu_s(self.service.pid)
            time.sleep(EVERY_S)
        self.service_cpu_s += used_s

    @staticmethod
    def _show(state: dict[str, Any], at_s: float, shown: dict[str, str]) -> None:
        """Print the reliefs of the vehicles that have changed."""
        for each in state["vehicles"]:
            relief = each["relief"].partition(" in ")[0]
            if shown.get(each["vehicle"]) != relief:
                shown[each["vehicle"]] = relief
                click.echo(f"{at_s:6.0f} s  {each['vehicle']}: {relief}")


@contextlib.contextmanager
def running(watch: LiveWatch) -> Iterator[None]:
    """Start the mocks and the service; kill those that still run at the end."""
    try:
        watch.start_mocks()
        watch.start_service()
        yield
    finally:
        for each in (*watch.mocks.values(), watch.service):
            if each is not None and each.poll() is None:
                each.kill()
                each.wait(timeout=30)


def judged(watch: LiveWatch, minutes: float, took_s: float) -> bool:
    """Print the figures of a watch that has ended; return whether all limits are kept."""
    journal = watch.out / "journal.jsonl"
    summary = json.loads((watch.out / "summary.json").read_text("utf-8"))
    closest_m = summary["closest_pair_m"]
    kept = report(journal, watch.scenario, closest_m, MAX_GAP_S)
    for each in reliefs_in(journal):
        line = f"{each.left_by} relieved by {each.resumed_by}"
        after_s = each.at_s - watch.scenario.start_s
        click.echo(f"{line:30} {after_s:.0f} s: gap {each.gap_s:.0f} s, {each.distance_m:.0f} m")
    replayed = verified(journal)
    load = os.getloadavg()[0]
    figures = {
        "killed": f"{watch.killed} at {watch.killed_at_s:.0f} s",
        "service killed": f"at {watch.restarted_at_s:.0f} s, replied after {watch.down_s:.1f} s",
        "orders to start": f"{watch.orders}",
        "speed": f"{minutes * 60.0 / took_s:.2f} of {watch.speedup:g} times real time",
        "service, share of a core": f"{watch.service_cpu_s / took_s:.0%}, load {load:.1f}",
        "journal": f"{journal.stat().st_size / 1e6:.0f} MB",
        "replay --verify": "equal" if replayed.returncode == 0 else replayed.stderr.strip(),
    }
    for name, figure in figures.items():
        click.echo(f"{name:30} {figure}")
    tracebacks = [line for log in watch.out.glob("*.log") for line in tracebacks_in(log)]
    for line in tracebacks:
        click.echo(f"WRONG {line}")
    happened = bool(watch.killed) and summary["service_restarts"] == 1
    return kept and happened and replayed.returncode == 0 and not tracebacks


def main() -> None:
    """Fly the watch and print its figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("minutes", type=float, nargs="?", default=60.0, help="of mission time")
    parser.add_argument("--speedup", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="an empty folder, which is kept")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        out = given.out or Path(temporary)
        out.mkdir(parents=True, exist_ok=True)
        path = out / "watch.toml"
        port = free_tcp_port()
        scenario = write_scenario(path, given.minutes, given.seed, port)
        watch = LiveWatch(path, out, port, scenario, given.speedup)
        with running(watch):
            began_s = time.monotonic()
            watch.fly(given.minutes)
            took_s = time.monotonic() - began_s
        kept = judged(watch, given.minutes, took_s)
    sys.exit(not kept)


if __name__ == "__main__":
    main()
