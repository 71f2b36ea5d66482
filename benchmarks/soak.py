"""An hour of simulated time with everything going wrong: ``python -m benchmarks.soak [--seed N]``.

The daemon as users start it, mocks at 20 times real time in a process of their own, Mosquitto. By
chance, from the seed: the broker goes and comes back; vehicles fall silent, restart and lose a
third of all frames each way; the wall clock steps (libfaketime); the disk fills up (a tmpfs of its
own, as root); rubbish comes in as MAVLink, HTTP and MQTT. What there is no way to do here is said
and left out. Looked at in the end, exit code 1 otherwise: no crash and no traceback; memory flat;
each alarm was raised and is cleared; the daemon ends in order; the journal verifies. It takes three
minutes.
"""

import argparse
import json
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import click

from benchmarks.link_shared import free_ports
from benchmarks.load import Client, memory_mib, process, ready_after_s
from benchmarks.load_scenario import FIRST_PORT, Load, scenario_text
from benchmarks.mosquitto import MOSQUITTO, Mosquitto
from benchmarks.rubbish import http_rubbish, mavlink_rubbish, mqtt_rubbish

FAKETIME = Path("/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1")
INSIDE = "SOAK_INSIDE"  # of a mount namespace of its own
DISK_MB = 96
WARM_UP = 0.35  # of the time: caches and tracks have grown by then
MAX_GROWTH_MIB_H = 15.0  # of simulated time
LOOK_EVERY_S = 0.5
CLI = (sys.executable, "-m", "mission_service.cli")
SETTLES_S = 40.0
ENDS_WITHIN_S = 60.0
MQTT = """
[service.mqtt]
broker = "{broker}"
commands = true

[service.journal]
rotate_mb = 4
keep_mb = 48
state_every_s = 5
"""


@dataclass
class Seen:
    """What was seen of the daemon."""

    raised: set[str] = field(default_factory=set)  # kinds of alarms
    standing: set[str] = field(default_factory=set)
    memory: list[tuple[float, float]] = field(default_factory=list)  # seconds, MiB
    silent_s: float = 0.0  # the longest time without an answer

    def look(self, client: Client, pid: int, at_s: float) -> None:
        """Alarms and memory."""
        status, body = client.get("/api/v1/state")
        if status != 200:
            return
        self.standing = set()
        state = json.loads(body)
        for alarm in state["alarms"]:
            kind = alarm["alarm"].partition("/")[0]
            self.raised.add(kind)
            if alarm.get("cleared_at_us") is None:
                self.standing.add(alarm["alarm"])
        self.memory.append((at_s, memory_mib(pid)))

    def growth_mib_s(self, from_s: float) -> float:
        """Slope of memory after a warm-up, by least squares."""
        late = [sample for sample in self.memory if sample[0] >= from_s]
        if len(late) < 3:
            return 0.0
        return statistics.linear_regression(*zip(*late, strict=True)).slope


class Disk:
    """The folder of the run; as root a small tmpfs that can be filled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.folder.mkdir()
        self.small = INSIDE in os.environ
        if self.small:
            mount = ("mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m,mode=0700", "tmpfs")
            subprocess.run([*mount, str(folder)], check=True)

    def fill(self) -> None:
        """Not a byte is left."""
        with (self.folder / "filler").open("wb", buffering=0) as file, suppress(OSError):
            while file.write(bytes(1 << 16)):
                pass

    def free(self) -> None:
        """There is room again."""
        (self.folder / "filler").unlink(missing_ok=True)


class Clock:
    """The wall clock that the daemon sees; steps if libfaketime is there."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "faketime"
        self.steps = FAKETIME.exists()
        self.step(0.0)

    @property
    def environment(self) -> dict[str, str]:
        """For the daemon's process."""
        if not self.steps:
            return {}
        return {
            "LD_PRELOAD": str(FAKETIME),
            "FAKETIME_TIMESTAMP_FILE": str(self._file),
            "FAKETIME_NO_CACHE": "1",
            "FAKETIME_DONT_FAKE_MONOTONIC": "1",
        }

    def step(self, seconds: float) -> None:
        """To so many seconds off."""
        self._file.write_text(f"{seconds:+.0f}\n", "ascii")


Fault = tuple[float, str, Callable[[], None]]  # when (real seconds), what, how


def faults_of(
    rng: random.Random, seconds: float, broker: Mosquitto, disk: Disk, clock: Clock, port: int
) -> list[Fault]:
    """All that is done to the daemon, in order; each kind at least twice."""
    found: list[Fault] = []
    ports = range(FIRST_PORT, FIRST_PORT + 4)

    def span(what: str, begin: Callable[[], None], end: Callable[[], None], lasts_s: float) -> None:
        for part in (0.05, 0.5):
            at_s = seconds * (part + rng.uniform(0.0, 0.3))
            found.append((at_s, f"{what} begins", begin))
            found.append((at_s + lasts_s * rng.uniform(0.6, 1.4), f"{what} ends", end))

    span("broker gone", broker.kill, broker.start, 6.0)
    if disk.small:
        span("disk full", disk.fill, disk.free, 5.0)
    if clock.steps:
        for off_s in (3600.0, -7200.0, 86_400.0 * 400, 0.0):
            at_s = seconds * rng.uniform(0.05, 0.9)
            found.append((at_s, f"clock {off_s:+.0f} s", partial(clock.step, off_s)))
    for _ in range(max(6, round(seconds / 10.0))):
        at_s = seconds * rng.uniform(0.05, 0.92)
        one, two, three = (random.Random(rng.randrange(1 << 30)) for _ in range(3))
        found += [
            (at_s, "MAVLink", partial(mavlink_rubbish, one, ports)),
            (at_s + 1.0, "HTTP", partial(http_rubbish, two, port)),
            (at_s + 2.0, "MQTT", partial(mqtt_rubbish, three, broker.port, "load")),
        ]
    return sorted(found, key=lambda fault: fault[0])


def soak(given: argparse.Namespace, folder: Path) -> tuple[dict[str, Any], list[str]]:
    """Figures, and what is wrong."""
    rng = random.Random(given.seed)
    seconds = given.hours * 3600.0 / given.speedup
    broker, clock, disk = Mosquitto(folder), Clock(folder), Disk(folder / "out")
    port, path, log = free_ports(1)[0], folder / "load.toml", folder / "daemon.log"
    extra = MQTT.format(broker=broker.address)
    path.write_text(scenario_text(Load(4, cells=200, http_port=port, extra=extra)), "utf-8")
    seen, done = Seen(), []
    os.environ.update({**clock.environment, "PYTHONFAULTHANDLER": "1"})
    words = ("mission_service.cli", "run", str(path), "--out", str(disk.folder), "--log", "json")
    with ExitStack() as stack:
        broker.start()
        stack.callback(broker.kill)
        daemon = stack.enter_context(process(*words, out=log))
        for name in clock.environment:
            del os.environ[name]
        began_s = time.monotonic()
        flown = ["--speedup", f"{given.speedup}", "--seed", f"{given.seed}"]
        flown += ["--troubles", f"{given.hours * 3600.0:.0f}"]
        stack.enter_context(process("benchmarks.load_mocks", str(path), *flown))
        ready_after_s(Client(port), began_s, daemon)
        client = Client(port, (disk.folder / "token").read_text("ascii").strip())
        began_s, answered_s = time.monotonic(), time.monotonic()
        waiting = faults_of(rng, seconds, broker, disk, clock, port)
        while (now_s := time.monotonic() - began_s) < seconds + SETTLES_S:
            while waiting and waiting[0][0] <= now_s:
                _, what, how = waiting.pop(0)
                how()
                done.append(what)
            looked = len(seen.memory)
            seen.look(client, daemon.pid, now_s)
            if len(seen.memory) > looked:
                seen.silent_s = max(seen.silent_s, time.monotonic() - answered_s)
                answered_s = time.monotonic()
            if daemon.poll() is not None:
                break
            if now_s > seconds and not seen.standing - set(given.may_stand):
                break
            time.sleep(LOOK_EVERY_S)
        state = json.loads(client.get("/api/v1/state")[1] or b"{}")
        crashed = daemon.poll() is not None
        daemon.send_signal(signal.SIGTERM)
        try:
            code = daemon.wait(timeout=ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            daemon.send_signal(signal.SIGABRT)  # its stacks go into the log
            code = daemon.wait(timeout=30)
    growth = seen.growth_mib_s(WARM_UP * seconds) * seconds / given.hours
    verified = subprocess.run(
        [*CLI, "replay", "--verify", str(disk.folder / "journal.jsonl")],
        capture_output=True,
        text=True,
        check=False,
    )
    lines = log.read_text("utf-8", "replace").splitlines()
    traces = [line for line in lines if "Traceback" in line or '"traceback"' in line]
    # aiomqtt leaves a future behind when the broker goes while it connects; asyncio tells of it.
    left = [line for line in traces if '"logger":"asyncio"' in line and "aiomqtt" in line]
    traces = [line for line in traces if line not in left]
    expected = {"broker", "link"} | ({"journal"} if disk.small else set())
    checks = {
        "the daemon crashed": crashed,
        f"it ended with code {code}": code != 0,
        f"tracebacks in its log: {len(traces)}": bool(traces),
        f"memory grows by {growth:.1f} MiB an hour": growth > MAX_GROWTH_MIB_H,
        f"never raised: {sorted(expected - seen.raised)}": bool(expected - seen.raised),
        f"still stand: {sorted(seen.standing)}": bool(seen.standing - set(given.may_stand)),
        f"the journal: {verified.stdout}{verified.stderr}": verified.returncode != 0,
    }
    figures = {
        "faults": {what: done.count(what) for what in sorted(set(done))},
        "left_out": [
            *([] if disk.small else ["disk full: needs root and unshare"]),
            *([] if clock.steps else ["clock steps: apt-get install faketime"]),
        ],
        "alarms_raised": sorted(seen.raised),
        "mission_s": round((state.get("status") or {}).get("at_us", 0) / 1e6),
        "pss_mib": [round(seen.memory[len(seen.memory) // 3][1], 1), round(seen.memory[-1][1], 1)],
        "growth_mib_per_h": round(growth, 1),
        "futures_left_by_aiomqtt": len(left),
        "longest_without_answer_s": round(seen.silent_s, 1),
        "verified": verified.stdout.strip(),
    }
    if any(checks.values()):
        kept = Path(given.keep)
        shutil.rmtree(kept, ignore_errors=True)
        shutil.copytree(disk.folder, kept, ignore=shutil.ignore_patterns("*.sock"))
        shutil.copy(log, kept)
    return figures, [what for what, wrong in checks.items() if wrong]


def main() -> None:
    """Print the figures; what is wrong, and 1, or 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--speedup", type=float, default=20.0)
    kept = str(Path(tempfile.gettempdir()) / "soak")
    parser.add_argument("--keep", default=kept, help="the run's files, if something is wrong")
    parser.add_argument("--may-stand", nargs="*", default=[], help="alarms that may be left")
    given = parser.parse_args()
    if MOSQUITTO is None:
        sys.exit("no mosquitto here: apt-get install mosquitto")
    if os.geteuid() == 0 and shutil.which("unshare") and INSIDE not in os.environ:
        os.environ[INSIDE] = "1"
        again = ["unshare", "-m", sys.executable, "-m", "benchmarks.soak", *sys.argv[1:]]
        sys.exit(subprocess.run(again, check=False).returncode)
    with tempfile.TemporaryDirectory() as folder:
        try:
            figures, wrong = soak(given, Path(folder))
        finally:
            if INSIDE in os.environ:
                subprocess.run(["umount", "--lazy", str(Path(folder) / "out")], check=False)
    click.echo(json.dumps(figures, indent=2))
    if wrong:
        sys.exit("wrong: " + "; ".join(wrong))


if __name__ == "__main__":
    main()
