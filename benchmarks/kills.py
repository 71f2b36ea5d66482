"""Kill live runs with SIGKILL at random moments, and check their files and each restart.

    python -m benchmarks.kills [KILLS] [--seed S] [--rule RULE ...]

The mocks run in a separate process and survive the kills; the daemon is ``mission-service run``.
Simulated operators send requests over the control socket all the time; in a burn they also answer
the checklist and approve. The files are checked after each kill, with little code of the project;
the state of the run is checked after each restart:

- the run resumes within 5 s of its start;
- all acknowledged requests are in the journal, and no existing line has changed;
- no vehicle receives a mission or a command before its mission was read back, and a recognised
  mission equals the mission in the mock;
- each drop was approved (by the check of ``burn_frames``) and is in the journal.

At the end of each run the whole journal is replayed, and must give the same commands bit by bit.
"""

import argparse
import contextlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

from autopilot_bridge.links.link_address import other_end
from benchmarks.burn_frames import check as checked_drops
from benchmarks.burn_frames import released
from benchmarks.link_shared import free_ports
from benchmarks.load import CLI, cpu_s
from mission_service.config.scenario import Scenario, flying, load_run
from mission_service.errors import ControlError, RequestError
from mission_service.interfaces.control.control_client import ControlClient
from mission_service.journal.segments import begin_state, closed_segments
from mission_service.replay.verification import verify

RULES = {
    "islam_hu_damped": "demo",
    "team.balanced": "team",
    "formation": "virtual-agents",
    "burn": "burn",
}
RESUMES_WITHIN_S = 5.0
KILLS_A_RUN = 25
REPORT_EVERY = 50
SPEEDUP = 10.0
MAX_BYTES = 80_000  # growth of the journal for each vehicle between start and kill: some seconds
CORES = os.cpu_count() or 1
BOSS = "firing-boss"
WAITS_S = 180.0
FIRST_WAITS_S = 900.0  # the first start may compile kernels


@dataclass
class Found:
    """Results of all kills so far."""

    kills: int = 0
    asked: int = 0
    restarts_s: list[float] = field(default_factory=list)
    cpu_s: list[float] = field(default_factory=list)
    spent_s: list[float] = field(default_factory=list)  # compared with RESUMES_WITHIN_S by main
    recognised: int = 0
    unknown: int = 0
    drops: int = 0
    events: int = 0
    wrong: list[str] = field(default_factory=list)
    refused: Counter[str] = field(default_factory=Counter)

    def line(self) -> str:
        """Return the results as one line."""
        ordered = sorted(self.restarts_s) or [0.0]
        max_cpu_s = max(self.cpu_s, default=0.0)
        return (
            f"{self.kills} kills: resumes after {ordered[len(ordered) // 2]:.2f} s (median), "
            f"{ordered[-1]:.2f} s at most ({max_cpu_s:.2f} s of CPU); "
            f"{self.asked} requests acknowledged; missions read back: "
            f"{self.recognised} recognised, {self.unknown} others; {self.drops} drops; "
            f"{self.events} events replayed; wrong: {len(self.wrong)}"
        )


def changes_of(rule: str, ports: list[int], keep: dict[str, float]) -> tuple[str, ...]:
    """Return the changes of a shipped scenario."""
    links = [f'vehicles.{n}.link="udpin:127.0.0.1:{port}"' for n, port in enumerate(ports)]
    kept = [f"service.journal.{name}={value}" for name, value in keep.items()]
    late = {"islam_hu_damped": 3600.0, "team.balanced": 3590.0}.get(rule)
    start = [] if late is None else [f"start_s={late}", f"deploy_at_s={late}"]
    if rule == "burn":
        start = ["deploy_at_s=1", "landscape.rows=120", "landscape.cols=120"]
    if rule == "islam_hu_damped":  # the only rule with a map
        start.append('service.http.listen="127.0.0.1:0"')
    return (*links, *kept, *start, "duration_s=1e7")


class Mocks:
    """The mock vehicles, in a separate process."""

    def __init__(self, name: str, changes: tuple[str, ...]) -> None:
        command = [sys.executable, "-m", "benchmarks.kills", "--fly", name, *changes]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.look()

    def look(self) -> dict[str, Any]:
        """Return the mission and the dropper's outputs of each vehicle."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(b"\n")
        self._process.stdin.flush()
        found: dict[str, Any] = json.loads(self._process.stdout.readline())
        return found

    def end(self) -> None:
        """End the process of the mocks."""
        self._process.kill()
        self._process.communicate()


async def fly(name: str, changes: tuple[str, ...]) -> None:
    """Run the mocks; reply to each input line with one line on their state."""
    import asyncio

    from autopilot_bridge.mock.serving import MockGroup, serve
    from mission_service.fire.scenario_fire import landscape_of
    from mission_service.runtime.clocks import clock_us
    from mission_service.simulation.sim import mock_of

    scenario = flying(load_run(name, changes)[0])
    landscape = landscape_of(scenario)
    mocks = {section.name: mock_of(section, landscape) for section in scenario.vehicles}

    def report() -> None:
        if not sys.stdin.readline():
            asyncio.get_running_loop().stop()
        found = {
            each: {
                "items": [[item.command, item.x, item.y] for item in mock.flight.items],
                "released": [value for _, _, _, value in mock.outputs],
            }
            for each, mock in mocks.items()
        }
        click.echo(json.dumps(found))

    asyncio.get_running_loop().add_reader(sys.stdin, report)
    async with asyncio.TaskGroup() as group:
        for section in scenario.vehicles:
            fleet = MockGroup([mocks[section.name]])
            group.create_task(serve(fleet, other_end(section.link), SPEEDUP, clock_us))


class Watched:
    """One run that is killed repeatedly, and the expected content of its journal."""

    def __init__(
        self, rule: str, out: Path, rng: random.Random, found: Found, keep: dict[str, float]
    ) -> None:
        name = RULES[rule]
        ports = free_ports(len(flying(load_run(name, ())[0]).vehicles))
        changes = changes_of(rule, ports, keep)
        self.rule, self.out, self.rng, self.found = rule, out, rng, found
        self.scenario: Scenario = flying(load_run(name, changes)[0])
        self.path = out / "journal.jsonl"
        sets = [word for change in changes for word in ("--set", change)]
        self._command = [*CLI, "run", name, "--out", str(out), *sets]
        self.mocks = Mocks(name, changes)
        self._stood: dict[int, bytes] = {}  # content of each segment at the last kill
        self._acknowledged: list[str] = []
        self._number = 0
        self._corrections = 0
        self._read_back = (0, 0)
        self.cpu_s = 0.0
        self._process: subprocess.Popen[bytes] | None = None

    # Requests ---------------------------------------------------------------------------------

    def start(self) -> float:
        """Start the daemon; return the seconds until it has resumed and replies."""
        began_s = time.monotonic()
        with (self.out / "run.log").open("ab") as log:
            self._process = subprocess.Popen(self._command, stdout=log, stderr=log)
        while True:
            with contextlib.suppress(ControlError), ControlClient(self.out) as client:
                client.ask(do="status")
                self.cpu_s = cpu_s(self._process.pid)
                return time.monotonic() - began_s
            waits_s = WAITS_S if self._stood else FIRST_WAITS_S
            if self._process.poll() is not None or time.monotonic() - began_s > waits_s:
                tail = (self.out / "run.log").read_text()[-2000:]
                raise AssertionError(f"the daemon does not start: {tail}")
            time.sleep(0.02)

    def ask_for(self, more_bytes: int) -> None:
        """Send random requests until the journal has grown by ``more_bytes``."""
        until_s = time.monotonic() + WAITS_S
        enough = self._bytes() + more_bytes
        with contextlib.suppress(ControlError), ControlClient(self.out) as client:
            while self._bytes() < enough and time.monotonic() < until_s:
                for request in self._requests(client):
                    self._ask(client, request)
                time.sleep(self.rng.uniform(0.0, 0.3))

    def _ask(self, client: ControlClient, request: dict[str, Any]) -> None:
        self._number += 1
        by = f"ann-{self._number}"
        try:
            client.ask(**request, by=by, station=BOSS if self.rule == "burn" else "desk")
        except RequestError as error:
            self.found.refused[f"{request['do']}: {error}"] += 1
            return
        self._acknowledged.append(by)
        self.found.asked += 1

    def _requests(self, client: ControlClient) -> Iterator[dict[str, Any]]:
        rng = self.rng
        if self.rule == "burn":
            status = client.ask(do="status")["status"]
            yield {"do": "present"}
            for item in status["open_items"]:
                yield {"do": "go", "item": item}
            guidance = status["guidance"]
            if guidance["phase"] == "proposed" and guidance["plan_hash"]:
                yield {"do": "approve", "hash": guidance["plan_hash"]}
            if rng.random() < 0.01:
                yield {"do": "abort"}
            return
        vehicle = rng.choice(self.scenario.vehicles)
        kind = rng.random()
        if kind < 0.1:
            yield {"do": "hold", "vehicle": vehicle.name}
            yield {"do": "resume", "vehicle": vehicle.name}
        elif kind < 0.2:
            yield {"do": "renew", "vehicle": vehicle.name}
        elif kind < 0.25 and self._corrections < 40:
            self._corrections += 1
            lit = self.scenario.ignition[0]
            assert lit.lat_deg is not None
            place = [lit.lat_deg + rng.uniform(-0.004, 0.004), lit.lon_deg]
            state = rng.choice(["burned", "unburned"])
            yield {"do": "correct", "state": state, "shape": "point", "points": [place]}
        elif kind < 0.3 and self._corrections:
            yield {"do": "undo"}
        else:
            yield {"do": "present"}

    # Checks -----------------------------------------------------------------------------------

    def kill(self) -> None:
        """Kill the daemon and check the files and the mocks."""
        assert self._process is not None
        self._process.kill()
        self._process.wait()
        self.found.kills += 1
        held = self.mocks.look()
        segments = self._segments()
        for number, before in self._stood.items():
            if number in segments and not segments[number].startswith(before):
                self._is_wrong(f"segment {number} has changed")
        self._stood = {number: text[: text.rfind(b"\n") + 1] for number, text in segments.items()}
        whole = b"".join(self._stood.values())
        lost = [by for by in self._acknowledged if f'"by":"{by}"'.encode() not in whole]
        if lost:
            self._is_wrong(f"acknowledged but not in the journal: {lost}")
        if min(segments) > 1:
            self._acknowledged.clear()  # older ones may be in a deleted segment
        self._look_at_missions(whole, held)
        if self.rule == "burn":
            ordered = whole.count(b'"command":{"type":"Drop"')
            fell = sum(released(each["released"]) for each in held.values())
            if fell > ordered:
                self._is_wrong(f"{fell} releases, {ordered} drops ordered")

    def _bytes(self) -> int:
        every = [self.path, *closed_segments(self.path).values()]
        return sum(each.stat().st_size for each in every if each.exists())

    def _segments(self) -> dict[int, bytes]:
        found = {number: path.read_bytes() for number, path in closed_segments(self.path).items()}
        if self.path.exists():
            found[max(found, default=0) + 1] = self.path.read_bytes()
        return found

    def _look_at_missions(self, whole: bytes, held: dict[str, Any]) -> None:
        """Compare the missions in the mocks with those sent and read back in the journal."""
        sent: dict[str, dict[int, Any]] = {each.name: {} for each in self.scenario.vehicles}
        on_board: dict[str, set[int]] = {name: set() for name in sent}
        unread: set[str] = set()
        for line in whole.splitlines():
            if not any(word in line[:60] for word in LOOKED_AT):
                continue
            entry = json.loads(line)
            content = entry.get("event") or entry.get("command") or {}
            name, kind = str(content.get("vehicle")), content.get("type")
            match kind:
                case "Resumed":
                    unread = set(sent)
                case "UploadMission" | "StartMission" if name in unread and self.rule != "burn":
                    self._is_wrong(f"{name}: {kind} before its mission was read back")
                case "MissionReadBack":
                    unread.discard(name)
                    if content["mission_id"]:
                        on_board[name] = {content["mission_id"]}
                case "UploadFinished" if content["outcome"] == "accepted":
                    on_board[name] = {content["mission_id"]}
                case "VehicleRebooted":
                    unread.discard(name)
                case _:
                    pass
            if kind == "UploadMission":
                items = content["items"]
                sent[name][content["mission_id"]] = [[i["command"], i["x"], i["y"]] for i in items]
                on_board[name].add(content["mission_id"])
        for name, mock in held.items():
            on_mock = [[command, x, y] for command, x, y in mock["items"]]
            expected = [sent[name][number] for number in on_board[name] if number in sent[name]]
            under_way = len(on_board[name]) > 1
            matches = any(same(on_mock, items) for items in expected)
            if on_mock and expected and not under_way and not matches:
                self._is_wrong(f"{name} has {len(on_mock)} items that are not in the journal")
        read_back = whole.count(b'"type":"MissionReadBack"')
        unknown = whole.count(b'"mission_id":0,"items"')
        self._read_back = (read_back - unknown, unknown)

    def end(self) -> None:
        """End the mocks, replay the whole journal and check all drops."""
        self.mocks.end()
        result = verify(self.path)
        if result.difference is not None:
            self._is_wrong(f"replay: {result.difference}")
        self.found.events += result.events
        self.found.recognised += self._read_back[0]
        self.found.unknown += self._read_back[1]
        begun = [
            closed
            for number, closed in closed_segments(self.path).items()
            # A run killed early has no state.
            if number == 1 or begin_state(self.path, number).exists()
        ]
        for closed in begun[-2:]:
            alone = verify(closed)
            if alone.difference is not None:
                self._is_wrong(f"replay of {closed.name} from its state: {alone.difference}")
        if self.rule == "burn":
            try:
                self.found.drops += checked_drops(self.path, self.scenario, 0, BOSS)
            except AssertionError as error:
                self._is_wrong(str(error))

    def _is_wrong(self, text: str) -> None:
        self.found.wrong.append(f"{self.rule}, kill {self.found.kills} ({self.out}): {text}")


LOOKED_AT = (
    b'"Resumed"',
    b'"UploadMission"',
    b'"StartMission"',
    b'"MissionReadBack"',
    b'"UploadFinished"',
    b'"VehicleRebooted"',
)


def same(on_mock: list[list[int]], sent: list[list[int]]) -> bool:
    """Return True if a mock has the items that were sent, with or without a home before them."""
    return any(
        len(held) == len(sent)
        and all(
            a[0] == b[0] and (b[1:] == a[1:] or b[1:] == [0, 0] or a[1:] == [0, 0])
            for a, b in zip(held, sent, strict=True)
        )
        for held in (on_mock, on_mock[1:])
    )


def run(
    rule: str, kills: int, seed: int, folder: Path, found: Found, keep: dict[str, float]
) -> None:
    """Kill one run of a rule ``kills`` times, after random amounts of journal since each start."""
    rng = random.Random(seed)
    out = folder / f"{rule}-{seed}"
    out.mkdir()
    watched = Watched(rule, out, rng, found, keep)
    try:
        watched.start()
        for number in range(kills):
            max_bytes = MAX_BYTES * len(watched.scenario.vehicles)
            watched.ask_for(round(rng.uniform(0.0, max_bytes)) if rng.random() < 0.9 else 0)
            watched.kill()
            if found.kills % REPORT_EVERY == 0:
                click.echo(found.line())
            if number < kills - 1:
                taken_s = restarted(watched, rng)
                found.restarts_s.append(taken_s)
                found.cpu_s.append(watched.cpu_s)
                # CPU time is used instead if other processes occupy all cores.
                found.spent_s.append(found.cpu_s[-1] if os.getloadavg()[0] > CORES else taken_s)
    finally:
        if watched._process is not None and watched._process.poll() is None:
            watched._process.kill()
        watched.end()


def restarted(watched: Watched, rng: random.Random) -> float:
    """Restart the daemon, with a probability of 15 % after a kill during a first start."""
    if rng.random() < 0.15:
        with (watched.out / "run.log").open("ab") as log:
            early = subprocess.Popen(watched._command, stdout=log, stderr=log)
        time.sleep(rng.uniform(0.5, 3.5))
        early.kill()
        early.wait()
        watched.found.kills += 1
    return watched.start()


def main() -> None:
    """Print one line for 50 kills; exit with 1 if a check failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kills", type=int, nargs="?", default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rule", action="append", choices=list(RULES))
    parser.add_argument("--fly", nargs="+", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.fly:
        import asyncio

        asyncio.run(fly(given.fly[0], tuple(given.fly[1:])))
        return
    rules, found, seed = given.rule or list(RULES), Found(), given.seed
    folder = tempfile.mkdtemp(prefix="kills-")  # the folder is kept for inspection
    while found.kills < given.kills:
        rule = rules[seed % len(rules)]
        reported = len(found.wrong)
        keep = {"state_every_s": 2.0, "rotate_mb": 2.0 if seed % 2 else 0.4, "keep_mb": 500.0}
        run(rule, min(KILLS_A_RUN, given.kills - found.kills), seed, Path(folder), found, keep)
        for line in found.wrong[reported:]:
            click.echo(f"WRONG {line}")
        seed += 1
    late_s = [each for each in found.spent_s if each > RESUMES_WITHIN_S]
    if late_s:
        click.echo(f"WRONG {len(late_s)} restarts took more than {RESUMES_WITHIN_S} s")
    click.echo(f"{found.line()}; files in {folder}")
    for why, count in found.refused.most_common(8):
        click.echo(f"  {count} refused: {why}")
    if found.wrong or late_s:
        sys.exit(1)


if __name__ == "__main__":
    main()
