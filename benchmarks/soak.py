"""An hour of simulated time with random faults: ``python -m benchmarks.soak [--seed N]``.

The benchmark runs the daemon as users start it, mocks at 20 times real time in a separate process,
and Mosquitto. At random times (from the seed) the broker is killed and restarted; vehicles stop
sending, reboot and lose 30 % of the frames in each direction; the wall clock steps (libfaketime);
the disk becomes full (a separate tmpfs, as root); and invalid MAVLink, HTTP and MQTT input arrives.
The output lists faults that cannot be simulated on this machine. The exit code is 1 unless, at the
end, the daemon has not crashed, its log contains no traceback, memory is constant, each expected
alarm was raised, all alarms are cleared, the daemon ends with code 0, and the journal verifies. It
takes three minutes.
"""

import argparse
import json
import os
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import click

from benchmarks.invalid_input import publish_invalid_mqtt, send_invalid_http, send_invalid_mavlink
from benchmarks.link_shared import free_tcp_port
from benchmarks.load import Client, end, memory_mib, process, ready_after_s, tracebacks_in, verified
from benchmarks.load_scenario import BROKER, FIRST_PORT, Load, scenario_text
from benchmarks.mosquitto import MOSQUITTO, Mosquitto

FAKETIME = Path("/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1")
INSIDE = "SOAK_INSIDE"  # set in the separate mount namespace
DISK_MB = 96
WARM_UP = 0.35  # fraction of the time in which caches and tracks grow
MAX_GROWTH_MIB_H = 15.0  # duration in simulated time
LOOK_EVERY_S = 0.5
SETTLES_S = 40.0


@dataclass
class Observed:
    """Alarms, memory and response times of the daemon."""

    raised: set[str] = field(default_factory=set)  # kinds of alarms
    standing: set[str] = field(default_factory=set)
    memory: list[tuple[float, float]] = field(default_factory=list)  # seconds, MiB
    max_gap_s: float = 0.0  # longest time without a response

    def look(self, client: Client, pid: int, at_s: float) -> None:
        """Record the alarms and the memory of the daemon."""
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
        """Return the slope of memory after a warm-up, by least squares."""
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
        """Fill the disk to its last byte."""
        with (self.folder / "filler").open("wb", buffering=0) as file, suppress(OSError):
            while file.write(bytes(1 << 16)):
                pass

    def free(self) -> None:
        """Remove the file that fills the disk."""
        (self.folder / "filler").unlink(missing_ok=True)


class Clock:
    """The wall clock of the daemon; it can step if libfaketime is installed."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "faketime"
        self.steps = FAKETIME.exists()
        self.step(0.0)

    @property
    def environment(self) -> dict[str, str]:
        """Environment variables for the daemon's process."""
        if not self.steps:
            return {}
        return {
            "LD_PRELOAD": str(FAKETIME),
            "FAKETIME_TIMESTAMP_FILE": str(self._file),
            "FAKETIME_NO_CACHE": "1",
            "FAKETIME_DONT_FAKE_MONOTONIC": "1",
        }

    def step(self, seconds: float) -> None:
        """Set the offset of the clock in seconds."""
        self._file.write_text(f"{seconds:+.0f}\n", "ascii")


Fault = tuple[float, str, Callable[[], None]]  # time in real seconds, name, and action


def faults_of(
    rng: random.Random, seconds: float, broker: Mosquitto, disk: Disk, clock: Clock, port: int
) -> list[Fault]:
    """Return all faults in order of time, each kind at least twice."""
    found: list[Fault] = []
    ports = range(FIRST_PORT, FIRST_PORT + 4)

    def span(name: str, begin: Callable[[], None], end: Callable[[], None], lasts_s: float) -> None:
        for part in (0.05, 0.5):
            at_s = seconds * (part + rng.uniform(0.0, 0.3))
            found.append((at_s, f"{name} begins", begin))
            found.append((at_s + lasts_s * rng.uniform(0.6, 1.4), f"{name} ends", end))

    span("broker stopped", broker.kill, broker.start, 6.0)
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
            (at_s, "MAVLink", partial(send_invalid_mavlink, one, ports)),
            (at_s + 1.0, "HTTP", partial(send_invalid_http, two, port)),
            (at_s + 2.0, "MQTT", partial(publish_invalid_mqtt, three, broker.port, "load")),
        ]
    return sorted(found, key=lambda fault: fault[0])


def soak(given: argparse.Namespace, folder: Path) -> tuple[dict[str, Any], list[str]]:
    """Run the daemon with all faults; return the figures and the failed checks."""
    rng = random.Random(given.seed)
    seconds = given.hours * 3600.0 / given.speedup
    broker, clock, disk = Mosquitto(folder), Clock(folder), Disk(folder / "out")
    port, path, log = free_tcp_port(), folder / "load.toml", folder / "daemon.log"
    extra = BROKER.format(address=broker.address, rotate_mb=4, keep_mb=48, state_every_s=5)
    path.write_text(scenario_text(Load(4, cells=200, http_port=port, extra=extra)), "utf-8")
    observed, done = Observed(), []
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
                _, name, action = waiting.pop(0)
                action()
                done.append(name)
            samples = len(observed.memory)
            observed.look(client, daemon.pid, now_s)
            if len(observed.memory) > samples:
                observed.max_gap_s = max(observed.max_gap_s, time.monotonic() - answered_s)
                answered_s = time.monotonic()
            if daemon.poll() is not None:
                break
            if now_s > seconds and not observed.standing - set(given.may_stand):
                break
            time.sleep(LOOK_EVERY_S)
        state = json.loads(client.get("/api/v1/state")[1] or b"{}")
        crashed = daemon.poll() is not None
        code = end(daemon)
    growth = observed.growth_mib_s(WARM_UP * seconds) * seconds / given.hours
    replay = verified(disk.folder / "journal.jsonl")
    traces = tracebacks_in(log)
    # If the broker ends during a connection, aiomqtt leaves a future, which asyncio logs.
    left = [line for line in traces if '"logger":"asyncio"' in line and "aiomqtt" in line]
    traces = [line for line in traces if line not in left]
    expected = {"broker", "link"} | ({"journal"} if disk.small else set())
    checks = {
        "the daemon crashed": crashed,
        f"the daemon ended with code {code}": code != 0,
        f"tracebacks in its log: {len(traces)}": bool(traces),
        f"memory grows by {growth:.1f} MiB an hour": growth > MAX_GROWTH_MIB_H,
        f"not raised: {sorted(expected - observed.raised)}": bool(expected - observed.raised),
        f"not cleared: {sorted(observed.standing)}": bool(observed.standing - set(given.may_stand)),
        f"the journal: {replay.stdout}{replay.stderr}": replay.returncode != 0,
    }
    figures = {
        "faults": dict(sorted(Counter(done).items())),
        "left_out": [
            *([] if disk.small else ["disk full: needs root and unshare"]),
            *([] if clock.steps else ["clock steps: apt-get install faketime"]),
        ],
        "alarms_raised": sorted(observed.raised),
        "mission_s": round((state.get("status") or {}).get("at_us", 0) / 1e6),
        "pss_mib": [round(observed.memory[k][1], 1) for k in (len(observed.memory) // 3, -1)],
        "growth_mib_per_h": round(growth, 1),
        "futures_left_by_aiomqtt": len(left),
        "longest_without_answer_s": round(observed.max_gap_s, 1),
        "verified": replay.stdout.strip(),
    }
    if any(checks.values()):
        kept = Path(given.keep)
        shutil.rmtree(kept, ignore_errors=True)
        shutil.copytree(disk.folder, kept, ignore=shutil.ignore_patterns("*.sock"))
        shutil.copy(log, kept)
    return figures, [text for text, wrong in checks.items() if wrong]


def main() -> None:
    """Print the figures; exit with 1 and the failed checks if there are any."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--speedup", type=float, default=20.0)
    kept = str(Path(tempfile.gettempdir()) / "soak")
    parser.add_argument("--keep", default=kept, help="folder for the files of a failed run")
    parser.add_argument(
        "--may-stand", nargs="*", default=[], help="alarms that need not be cleared"
    )
    given = parser.parse_args()
    if MOSQUITTO is None:
        sys.exit("mosquitto is not installed: apt-get install mosquitto")
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
