"""Days of mission time in one process: ``python -m benchmarks.weeks [--hours 24] [--speedup 60]``.

The daemon as users start it, four mocks in a process of their own, a fire so slow that it does not
end, Mosquitto. All the time: the broker goes and comes back, or stops answering; readers of the
live stream come and go; people ask for all that the map asks for, draw corrections, erase them,
undo them, change the wind, hold and resume vehicles.

Each mission hour all callers pause, so that what is open then is the service's own: a line says
resident memory and what of it is anonymous, that is no file's, file descriptors, threads, the
journal and how many requests were answered. PSS is left out: it moves with what other processes on
the machine have loaded. In the end, exit code 1 otherwise: the slope of memory after the
first hour is below 1 MiB an hour (least squares over all samples), the number of file descriptors
is the same in each pause, each request was answered, the daemon ended in order without a
traceback, and the journal that is left verifies. No verdict depends on how fast the machine is.
"""

import argparse
import http.client
import json
import math
import random
import shutil
import signal
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

from benchmarks.link_shared import free_ports
from benchmarks.load import Client, cpu_s, memory_mib, process, ready_after_s
from benchmarks.load_scenario import FIRE, M_PER_DEG, Load, scenario_text
from benchmarks.mosquitto import MOSQUITTO, Mosquitto
from benchmarks.soak import CLI, ENDS_WITHIN_S

MAX_SLOPE_MIB_H = 1.0  # of mission time, after WARM_UP_H
WARM_UP_H = 1.0
START_S = 12 * 3600.0  # the fire is large enough to be watched by four
SAMPLE_EVERY_S = 3.0
READERS = 3
READ_S = (1.0, 5.0)  # a reader of the live stream stays so long ...
READ_EVERY_H = 0.05  # ... and comes again; of mission time, as what follows
CALL_EVERY_H = 1.0 / 60.0
CORRECT_EVERY_H = 0.1
BROKER_UP_S, BROKER_DOWN_S, BROKER_FROZEN_S = 20.0, 4.0, 15.0
ANSWER_WITHIN_S = 300.0
READY_WITHIN_S = 1800.0  # kernels may have to be compiled first
PAUSE_WITHIN_S = 180.0  # for connections to be closed
STALLED_S = 300.0  # without progress of mission time
EXTRA = """
[service.mqtt]
broker = "{broker}"
commands = true

[service.journal]
rotate_mb = 8
keep_mb = 64
state_every_s = 10
"""
# What the map asks for, and programs; the slow ones more rarely.
OFTEN = ("state", "announcements", "vehicles", "fire/front", "weather", "fire/corrections")
RARELY = (
    *("fire/contours", "fire/uncertainty", "fire/arrival.png", "fire/arrival.json", "planner"),
    *("vehicles/uas1", "vehicles/uas2/track", "vehicles/uas3/mission", "journal", "openapi.json"),
)


@dataclass
class Hour:
    """The service in a pause after a mission hour."""

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
        """For people."""
        return "  ".join(
            f"{name} {value:.1f}" if isinstance(value, float) else f"{name} {value}"
            for name, value in vars(self).items()
        )


@dataclass
class People:
    """All who call: each request is counted when it is asked and when it is answered."""

    client: Client
    seed: int
    asked: int = 0
    answered: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    mission_h: float = 0.0  # since the start
    area_ha: float = 50.0
    may_call: threading.Event = field(default_factory=threading.Event)
    over: threading.Event = field(default_factory=threading.Event)
    calling: int = 0
    _not_yet: list[str] = field(default_factory=lambda: [*OFTEN, *RARELY])
    lock: threading.Lock = field(default_factory=threading.Lock)

    def ask(self, path: str, body: dict[str, Any] | None = None) -> bytes:
        """One request; every status but 5xx and 429 is an answer."""
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
        """All of them, started."""
        found = [threading.Thread(target=self._turns, args=(self._look_around, 0), daemon=True)]
        found.append(threading.Thread(target=self._turns, args=(self._correct, 1), daemon=True))
        for number in range(READERS):
            turn = (self._read, 2 + number)
            found.append(threading.Thread(target=self._turns, args=turn, daemon=True))
        for each in found:
            each.start()
        return found

    def _turns(self, turn: Any, number: int) -> None:
        rng = random.Random(1000 * self.seed + number)
        every_h = {0: CALL_EVERY_H, 1: CORRECT_EVERY_H}.get(number, READ_EVERY_H)
        due_h = 0.0
        while not self.over.is_set():
            if self.mission_h < due_h or not self.may_call.is_set():
                time.sleep(0.2)
                continue
            due_h = max(due_h, self.mission_h - every_h) + every_h  # late by one turn at most
            with self.lock:
                self.calling += 1
            try:
                turn(rng)
            finally:
                with self.lock:
                    self.calling -= 1

    def _look_around(self, rng: random.Random) -> None:
        """Everything once, since much is loaded at the first time; then at random."""
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
        """One thing that people do to the fire or to vehicles."""
        place = self._at_edge(rng)
        match rng.randrange(10):
            case 0:
                self.ask("/api/v1/fire/undo", {})
            case 1:
                self.ask("/api/v1/fire/redo", {})
            case 2:
                told = {"lat_deg": place[0], "lon_deg": place[1], "radius_m": 300.0}
                self.ask("/api/v1/fire/erase", told)
            case 3:
                wind = {"speed_m_s": rng.uniform(0.0, 0.5), "from_deg": rng.uniform(0.0, 360.0)}
                self.ask("/api/v1/wind", wind)
            case 4:
                vehicle = f"uas{rng.randrange(1, 5)}"
                for what in ("hold", "resume", "mission/renew"):
                    self.ask(f"/api/v1/vehicles/{vehicle}/{what}", {})
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
    """A broker that is killed and started, and now and then stops answering."""

    def __init__(self, broker: Mosquitto) -> None:
        self._broker = broker
        self._begun_s = time.monotonic()
        self._state = "up"
        self.times = 0

    def look(self) -> None:
        """Do what is due."""
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
        """Have it answer."""
        if self._state == "down":
            self._broker.start()
        elif self._state == "frozen":
            self._broker.freeze(False)
        self._to("up")

    def _to(self, state: str) -> None:
        self._state, self._begun_s = state, time.monotonic()


def open_files(pid: int) -> int:
    """File descriptors of a process."""
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def threads_of(pid: int) -> int:
    """Threads of a process."""
    return sum(1 for _ in Path(f"/proc/{pid}/task").iterdir())


class Run:
    """One daemon, and what was seen of it."""

    def __init__(self, daemon: "subprocess.Popen[bytes]", people: People, out: Path) -> None:
        self.daemon = daemon
        self.people = people
        self.out = out
        self.began_s = time.monotonic()
        self.hours: list[Hour] = []
        self.samples: list[tuple[float, float, float]] = []  # mission h, RSS, anonymous in MiB
        self._state: dict[str, Any] = {}
        self._moved_s = time.monotonic()

    @property
    def mission_h(self) -> float:
        """Since the start."""
        return self.people.mission_h

    def look(self) -> None:
        """Take a sample. Raises SystemExit if nothing moves any more."""
        content = self.people.ask("/api/v1/state")
        if content.startswith(b"{"):
            self._state = json.loads(content)
            reached_h = (self._state["status"]["at_us"] / 1e6 - START_S) / 3600.0
            if reached_h > self.mission_h:
                self._moved_s = time.monotonic()
            self.people.mission_h = reached_h
            self.people.area_ha = self._state["fire"]["area_ha"]
        pid = self.daemon.pid
        rss, anonymous = memory_mib(pid, "Rss"), memory_mib(pid, "Anonymous")
        self.samples.append((self.mission_h, rss, anonymous))
        if time.monotonic() - self._moved_s > STALLED_S:
            raise SystemExit(f"mission time stands still after {self.mission_h:.2f} h")

    def pause(self) -> Hour:
        """How things are while nobody calls."""
        people = self.people
        people.may_call.clear()
        until_s = time.monotonic() + PAUSE_WITHIN_S
        while people.calling and time.monotonic() < until_s:
            time.sleep(0.1)
        time.sleep(2.0)  # the broker is found again
        self.look()
        pid, vehicles = self.daemon.pid, self._state["vehicles"]
        files = min(_every(lambda: open_files(pid), 40))  # a state is being written now and then
        found = Hour(
            self.mission_h,
            time.monotonic() - self.began_s,
            cpu_s(pid),
            memory_mib(pid, "Rss"),
            memory_mib(pid, "Anonymous"),
            files,
            threads_of(pid),
            sum(each.stat().st_size for each in self.out.glob("journal*")) / 2**20,
            people.asked,
            people.answered,
            sum(each["decisions"] for each in vehicles),
            sum(each["uploads_accepted"] for each in vehicles),
            len(self._state["fire"]["corrections"]),
        )
        self.hours.append(found)
        people.may_call.set()
        return found

    def slopes_mib_h(self) -> tuple[float, float]:
        """Of RSS and its anonymous part after the warm-up; NaN without enough samples."""
        late = [sample for sample in self.samples if sample[0] >= WARM_UP_H]
        if len(late) < 3:
            return math.nan, math.nan
        hours, rss, anonymous = zip(*late, strict=True)
        slope = statistics.linear_regression
        return slope(hours, rss).slope, slope(hours, anonymous).slope


def _every(measure: Any, times: int) -> list[int]:
    found = []
    for _ in range(times):
        found.append(measure())
        time.sleep(0.1)
    return found


def fly(given: argparse.Namespace, folder: Path) -> list[tuple[str, bool]]:
    """Prints what is seen; returns checks in words, and whether each holds."""
    broker, out = Mosquitto(folder), folder / "out"
    port, path, log = free_ports(1)[0], folder / "weeks.toml", folder / "daemon.log"
    load = Load(
        4,
        cells=200,
        start_s=START_S,
        end_s=1e8,
        wind_speed_m_s=0.0,
        dead_1h_pct=6.0,
        http_port=port,
        extra=EXTRA.format(broker=broker.address),
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
        people = People(Client(port, (out / "token").read_text("ascii").strip()), given.seed)
        stack.callback(people.over.set)
        run, flapping = Run(daemon, people, out), Flapping(broker)
        callers = people.threads()
        _announce(run.pause())
        while run.mission_h < given.hours and daemon.poll() is None:
            flapping.look()
            run.look()
            if run.mission_h >= math.floor(run.hours[-1].hour) + 1:
                flapping.up()
                _announce(run.pause())
            time.sleep(SAMPLE_EVERY_S)
        crashed = daemon.poll() is not None
        people.over.set()
        people.may_call.set()
        for each in callers:
            each.join(timeout=PAUSE_WITHIN_S)
        daemon.send_signal(signal.SIGTERM)
        try:
            code = daemon.wait(timeout=ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            daemon.send_signal(signal.SIGABRT)  # its stacks go into the log
            code = daemon.wait(timeout=30)
    replayed = [*CLI, "replay", "--verify", str(out / "journal.jsonl")]
    verified = subprocess.run(replayed, capture_output=True, text=True, check=False)
    lines = log.read_text("utf-8", "replace").splitlines()
    traces = [line for line in lines if "Traceback" in line or '"traceback"' in line]
    rss, anonymous = run.slopes_mib_h()
    files = {each.files for each in run.hours if each.hour >= WARM_UP_H}
    click.echo(f"broker gone {flapping.times} times; not 2xx: {dict(people.statuses)}")
    kept = Path(given.keep)
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    shutil.copy(log, kept)
    samples = [dict(zip(("h", "rss", "anonymous"), each, strict=True)) for each in run.samples]
    (kept / "samples.json").write_text(json.dumps(samples), "ascii")
    return [
        (
            f"resident memory rises by {rss:.2f} MiB an hour after the first "
            f"(its anonymous part by {anonymous:.2f})",
            rss < MAX_SLOPE_MIB_H,
        ),
        (f"file descriptors in each pause: {sorted(files)}", len(files) == 1),
        (f"{people.answered} of {people.asked} requests answered", people.answered == people.asked),
        (f"the daemon ended by itself: {crashed}; code {code}", not crashed and code == 0),
        (f"{len(traces)} tracebacks in its log", not traces),
        (f"the journal: {verified.stdout}{verified.stderr}".strip(), verified.returncode == 0),
    ]


def _announce(hour: Hour) -> None:
    click.echo(hour.line())


def main() -> None:
    """Print a line an hour and the verdicts; 1 unless all hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0, help="of mission time")
    parser.add_argument("--speedup", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", default=str(Path(tempfile.gettempdir()) / "weeks"))
    given = parser.parse_args()
    if MOSQUITTO is None:
        sys.exit("no mosquitto here: apt-get install mosquitto")
    with tempfile.TemporaryDirectory() as folder:
        checks = fly(given, Path(folder))
    for words, holds in checks:
        click.echo(f"{'PASS' if holds else 'FAIL'} {words}")
    if not all(holds for _, holds in checks):
        sys.exit(1)


if __name__ == "__main__":
    main()
