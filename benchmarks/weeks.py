"""Days of mission time in one process: ``python -m benchmarks.weeks [--hours 24] [--speedup 60]``.

The benchmark runs the daemon as users start it, four mocks in a separate process, a fire that grows
so slowly that it burns until the end, and Mosquitto. During the run the broker is killed, restarted
and frozen, clients of the live stream connect and disconnect, and HTTP clients send all requests of
the map, draw, erase and undo corrections, change the wind, and hold and resume vehicles.

In each mission hour all clients pause, so that only the resources of the service itself are open.
It then prints a line with resident memory and its anonymous part, file descriptors, threads, the
size of the journal and the number of answered requests. PSS is not used, because it depends on the
pages shared with other processes. The exit code is 1 unless the slope of memory after the first
hour is below 1 MiB an hour (least squares over all samples), the number of file descriptors is the
same in each pause, each request was answered, the daemon ended with code 0 and without a traceback,
and the remaining journal verifies. The result does not depend on the speed of the machine.
"""

import argparse
import http.client
import json
import math
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

from benchmarks.link_shared import free_tcp_port
from benchmarks.load import (
    Client,
    cpu_s,
    end,
    memory_mib,
    process,
    ready_after_s,
    tracebacks_in,
    verified,
)
from benchmarks.load_scenario import BROKER, FIRE, M_PER_DEG, Load, scenario_text
from benchmarks.mosquitto import MOSQUITTO, Mosquitto

MAX_SLOPE_MIB_H = 1.0  # in mission time, after WARM_UP_H
WARM_UP_H = 1.0
START_S = 12 * 3600.0  # the fire is then large enough for four vehicles
SAMPLE_EVERY_S = 3.0
READERS = 3
READ_S = (1.0, 5.0)  # duration of a connection to the live stream
READ_EVERY_H = 0.05  # of mission time, as the next two
CALL_EVERY_H = 1.0 / 60.0
CORRECT_EVERY_H = 0.1
BROKER_UP_S, BROKER_DOWN_S, BROKER_FROZEN_S = 20.0, 4.0, 15.0
ANSWER_WITHIN_S = 300.0
READY_WITHIN_S = 1800.0  # the first start may compile kernels
PAUSE_WITHIN_S = 180.0  # time for connections to be closed
STALLED_S = 300.0  # limit of the time without progress of mission time
# Paths that the map and other programs request; slow requests are rare.
OFTEN = ("state", "announcements", "vehicles", "fire/front", "weather", "fire/corrections")
RARELY = (
    *("fire/contours", "fire/uncertainty", "fire/arrival.png", "fire/arrival.json", "planner"),
    *("vehicles/uas1", "vehicles/uas2/track", "vehicles/uas3/mission", "journal", "openapi.json"),
)


@dataclass
class Hour:
    """Measurements of the service in the pause after a mission hour."""

    hour: float
    real_s: float
    cpu_s: float
    rss_mib: float
    anonymous_mib: float
    files: int
    threads: int
    journal_mib: float
    asked: int
    answered: int
    decisions: int
    uploads: int
    corrections: int

    def line(self) -> str:
        """Return the measurements as one line."""
        return "  ".join(
            f"{name} {value:.1f}" if isinstance(value, float) else f"{name} {value}"
            for name, value in vars(self).items()
        )


@dataclass
class Clients:
    """All HTTP clients, with counts of sent and of answered requests."""

    client: Client
    seed: int
    asked: int = 0
    answered: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    mission_h: float = 0.0  # counts since the start
    area_ha: float = 50.0
    may_call: threading.Event = field(default_factory=threading.Event)
    over: threading.Event = field(default_factory=threading.Event)
    calling: int = 0
    _not_yet: list[str] = field(default_factory=lambda: [*OFTEN, *RARELY])
    lock: threading.Lock = field(default_factory=threading.Lock)

    def ask(self, path: str, body: dict[str, Any] | None = None) -> bytes:
        """Send one request; each status except 5xx and 429 counts as answered."""
        with self.lock:
            self.asked += 1
        if body is None:
            status, content = self.client.get(path, ANSWER_WITHIN_S)
        else:
            status, content = self.client.post(path, body, ANSWER_WITHIN_S)
        with self.lock:
            if 200 <= status < 500 and status != 429:
                self.answered += 1
            if not 200 <= status < 300:
                self.statuses[f"{path.partition('?')[0]}: {status}"] += 1
        return content

    def threads(self) -> list[threading.Thread]:
        """Start the thread of each client and return the threads."""
        turns = [self._look_around, self._correct, *[self._read] * READERS]
        found = [
            threading.Thread(target=self._turns, args=(turn, number), daemon=True)
            for number, turn in enumerate(turns)
        ]
        for thread in found:
            thread.start()
        return found

    def _turns(self, turn: Any, number: int) -> None:
        rng = random.Random(1000 * self.seed + number)
        every_h = {0: CALL_EVERY_H, 1: CORRECT_EVERY_H}.get(number, READ_EVERY_H)
        due_h = 0.0
        while not self.over.is_set():
            if self.mission_h < due_h or not self.may_call.is_set():
                time.sleep(0.2)
                continue
            due_h = max(due_h, self.mission_h - every_h) + every_h  # delayed by at most one turn
            with self.lock:
                self.calling += 1
            try:
                turn(rng)
            finally:
                with self.lock:
                    self.calling -= 1

    def _look_around(self, rng: random.Random) -> None:
        """Request each path once, because first requests load much, and then random paths."""
        if self._not_yet:
            self.ask(f"/api/v1/{self._not_yet.pop()}")
        else:
            self.ask(f"/api/v1/{rng.choice(OFTEN if rng.random() < 0.9 else RARELY)}")

    def _read(self, rng: random.Random) -> None:
        until_s = time.monotonic() + rng.uniform(*READ_S)
        with self.lock:
            self.asked += 1
        try:
            for _ in self.client.stream(0, until_s, ANSWER_WITHIN_S):
                if not self.may_call.is_set():
                    break
        except (OSError, http.client.HTTPException) as error:
            with self.lock:
                self.statuses[f"live stream: {error}"] += 1
            return
        with self.lock:
            self.answered += 1

    def _correct(self, rng: random.Random) -> None:
        """Send a random request on the fire or on a vehicle."""
        place = self._at_edge(rng)
        match rng.randrange(10):
            case 0:
                self.ask("/api/v1/fire/undo", {})
            case 1:
                self.ask("/api/v1/fire/redo", {})
            case 2:
                circle = {"lat_deg": place[0], "lon_deg": place[1], "radius_m": 300.0}
                self.ask("/api/v1/fire/erase", circle)
            case 3:
                wind = {"speed_m_s": rng.uniform(0.0, 0.5), "from_deg": rng.uniform(0.0, 360.0)}
                self.ask("/api/v1/wind", wind)
            case 4:
                vehicle = f"uas{rng.randrange(1, 5)}"
                for command in ("hold", "resume", "mission/renew"):
                    self.ask(f"/api/v1/vehicles/{vehicle}/{command}", {})
            case _:
                state = rng.choice(("burned", "burning", "unburned"))
                drawn = {"state": state, "shape": "point", "points": [place]}
                self.ask("/api/v1/fire/corrections", drawn)

    def _at_edge(self, rng: random.Random) -> list[float]:
        radius_m = math.sqrt(self.area_ha * 1e4 / math.pi) * rng.uniform(0.85, 1.15)
        turn = rng.uniform(0.0, math.tau)
        north, east = radius_m * math.cos(turn), radius_m * math.sin(turn)
        lat, lon = FIRE
        return [lat + north / M_PER_DEG, lon + east / M_PER_DEG / math.cos(math.radians(lat))]


class Flapping:
    """A broker that is regularly killed and restarted, or frozen."""

    def __init__(self, broker: Mosquitto) -> None:
        self._broker = broker
        self._begun_s = time.monotonic()
        self._state = "up"
        self.times = 0

    def look(self) -> None:
        """Change the state of the broker if its time has elapsed."""
        lasts_s = {"up": BROKER_UP_S, "down": BROKER_DOWN_S, "frozen": BROKER_FROZEN_S}
        if time.monotonic() - self._begun_s < lasts_s[self._state]:
            return
        if self._state == "up":
            self.times += 1
            if self.times % 4:
                self._broker.kill()
                self._to("down")
            else:
                self._broker.freeze(True)
                self._to("frozen")
        else:
            self.up()

    def up(self) -> None:
        """Restart or continue the broker."""
        if self._state == "down":
            self._broker.start()
        elif self._state == "frozen":
            self._broker.freeze(False)
        self._to("up")

    def _to(self, state: str) -> None:
        self._state, self._begun_s = state, time.monotonic()


def open_files(pid: int) -> int:
    """Return the number of file descriptors of a process."""
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def threads_of(pid: int) -> int:
    """Return the number of threads of a process."""
    return sum(1 for _ in Path(f"/proc/{pid}/task").iterdir())


class Run:
    """One daemon with its samples and hourly measurements."""

    def __init__(self, daemon: "subprocess.Popen[bytes]", clients: Clients, out: Path) -> None:
        self.daemon = daemon
        self.clients = clients
        self.out = out
        self.began_s = time.monotonic()
        self.hours: list[Hour] = []
        # Mission time in h, RSS and anonymous memory in MiB.
        self.samples: list[tuple[float, float, float]] = []
        self._state: dict[str, Any] = {}
        self._moved_s = time.monotonic()

    @property
    def mission_h(self) -> float:
        """Mission time in hours since the start."""
        return self.clients.mission_h

    def look(self) -> None:
        """Take a sample. Raises SystemExit if mission time does not advance."""
        content = self.clients.ask("/api/v1/state")
        if content.startswith(b"{"):
            self._state = json.loads(content)
            reached_h = (self._state["status"]["at_us"] / 1e6 - START_S) / 3600.0
            if reached_h > self.mission_h:
                self._moved_s = time.monotonic()
            self.clients.mission_h = reached_h
            self.clients.area_ha = self._state["fire"]["area_ha"]
        pid = self.daemon.pid
        rss, anonymous = memory_mib(pid, "Rss"), memory_mib(pid, "Anonymous")
        self.samples.append((self.mission_h, rss, anonymous))
        if time.monotonic() - self._moved_s > STALLED_S:
            raise SystemExit(f"mission time stands still after {self.mission_h:.2f} h")

    def pause(self) -> Hour:
        """Pause all clients and measure the service."""
        clients = self.clients
        clients.may_call.clear()
        until_s = time.monotonic() + PAUSE_WITHIN_S
        while clients.calling and time.monotonic() < until_s:
            time.sleep(0.1)
        time.sleep(2.0)  # time for the connection to the broker
        self.look()
        pid, vehicles = self.daemon.pid, self._state["vehicles"]
        files = min(_repeated(lambda: open_files(pid), 40))  # a snapshot opens further files
        found = Hour(
            self.mission_h,
            time.monotonic() - self.began_s,
            cpu_s(pid),
            memory_mib(pid, "Rss"),
            memory_mib(pid, "Anonymous"),
            files,
            threads_of(pid),
            sum(each.stat().st_size for each in self.out.glob("journal*")) / 2**20,
            clients.asked,
            clients.answered,
            sum(each["decisions"] for each in vehicles),
            sum(each["uploads_accepted"] for each in vehicles),
            len(self._state["fire"]["corrections"]),
        )
        self.hours.append(found)
        clients.may_call.set()
        return found

    def slopes_mib_h(self) -> tuple[float, float]:
        """Return the slopes of RSS and of its anonymous part after the warm-up, or NaN."""
        late = [sample for sample in self.samples if sample[0] >= WARM_UP_H]
        if len(late) < 3:
            return math.nan, math.nan
        hours, rss, anonymous = zip(*late, strict=True)
        slope = statistics.linear_regression
        return slope(hours, rss).slope, slope(hours, anonymous).slope


def _repeated(measure: Any, times: int) -> list[int]:
    found = []
    for _ in range(times):
        found.append(measure())
        time.sleep(0.1)
    return found


def fly(given: argparse.Namespace, folder: Path) -> list[tuple[str, bool]]:
    """Run the daemon; print each hour; return the text and the result of each check."""
    broker, out = Mosquitto(folder), folder / "out"
    port, path, log = free_tcp_port(), folder / "weeks.toml", folder / "daemon.log"
    load = Load(
        4,
        cells=200,
        start_s=START_S,
        end_s=1e8,
        wind_speed_m_s=0.0,
        dead_1h_pct=6.0,
        http_port=port,
        extra=BROKER.format(address=broker.address, rotate_mb=8, keep_mb=64, state_every_s=10),
    )
    path.write_text(scenario_text(load), "utf-8")
    words = ("mission_service.cli", "run", str(path), "--out", str(out), "--log", "json")
    with ExitStack() as stack:
        broker.start()
        stack.callback(broker.kill)
        daemon = stack.enter_context(process(*words, out=log))
        speed = ("--speedup", f"{given.speedup}", "--paced")
        began_s = time.monotonic()
        stack.enter_context(process("benchmarks.load_mocks", str(path), *speed))
        ready_after_s(Client(port), began_s, daemon, READY_WITHIN_S)
        clients = Clients(Client(port, (out / "token").read_text("ascii").strip()), given.seed)
        stack.callback(clients.over.set)
        run, flapping = Run(daemon, clients, out), Flapping(broker)
        threads = clients.threads()
        click.echo(run.pause().line())
        while run.mission_h < given.hours and daemon.poll() is None:
            flapping.look()
            run.look()
            if run.mission_h >= math.floor(run.hours[-1].hour) + 1:
                flapping.up()
                click.echo(run.pause().line())
            time.sleep(SAMPLE_EVERY_S)
        crashed = daemon.poll() is not None
        clients.over.set()
        clients.may_call.set()
        for thread in threads:
            thread.join(timeout=PAUSE_WITHIN_S)
        code = end(daemon)
    replay, traces = verified(out / "journal.jsonl"), tracebacks_in(log)
    rss, anonymous = run.slopes_mib_h()
    files = {each.files for each in run.hours if each.hour >= WARM_UP_H}
    click.echo(f"broker stopped {flapping.times} times; not 2xx: {dict(clients.statuses)}")
    kept = Path(given.keep)
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    shutil.copy(log, kept)
    samples = [dict(zip(("h", "rss", "anonymous"), each, strict=True)) for each in run.samples]
    (kept / "samples.json").write_text(json.dumps(samples), "ascii")
    return [
        (
            f"resident memory rises by {rss:.2f} MiB an hour after the first hour "
            f"(its anonymous part by {anonymous:.2f})",
            rss < MAX_SLOPE_MIB_H,
        ),
        (f"file descriptors in each pause: {sorted(files)}", len(files) == 1),
        (
            f"{clients.answered} of {clients.asked} requests answered",
            clients.answered == clients.asked,
        ),
        (f"the daemon ended by itself: {crashed}; code {code}", not crashed and code == 0),
        (f"{len(traces)} tracebacks in its log", not traces),
        (f"the journal: {replay.stdout}{replay.stderr}".strip(), replay.returncode == 0),
    ]


def main() -> None:
    """Print one line for each hour and the checks; exit with 1 if a check failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0, help="of mission time")
    parser.add_argument("--speedup", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", default=str(Path(tempfile.gettempdir()) / "weeks"))
    given = parser.parse_args()
    if MOSQUITTO is None:
        sys.exit("mosquitto is not installed: apt-get install mosquitto")
    with tempfile.TemporaryDirectory() as folder:
        checks = fly(given, Path(folder))
    for text, holds in checks:
        click.echo(f"{'PASS' if holds else 'FAIL'} {text}")
    if not all(holds for _, holds in checks):
        sys.exit(1)


if __name__ == "__main__":
    main()
