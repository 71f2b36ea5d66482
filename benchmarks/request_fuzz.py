"""Send valid and malformed requests of each guidance at random times of simulated flights.

    python -m benchmarks.request_fuzz [REQUESTS] [SEED] [SCENARIO...]

The shipped scenarios fly in virtual time, with MAVLink frames to mock autopilots. At random times
the process forks. The fork sends requests to the request handler (as the control socket and HTTP
do), as lines of the control socket, and over MQTT, and continues the flight between requests. The
requests are generated from the request table (``core/request_events.py``), so that new requests are
included automatically. The checks are:

- no request raises an exception, and no request is refused because it cannot be handled;
- the state after a restart from the last snapshot, and from the beginning of the journal, equals
  the state of the live run, object by object: core, fire, state view, missions, interlock;
- the journal replays to the same lines, stage by stage.
"""

import json
import math
import os
import shutil
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import click
import msgspec
import numpy as np
from msgspec import inspect as kinds

from benchmarks.folds import difference
from mission_service.config.scenario import Scenario, flying, load_scenario, one_of_many
from mission_service.core import request_events
from mission_service.core.core import Core
from mission_service.errors import JournalError
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import landscape_of
from mission_service.fire.simulated_cameras import cameras_of
from mission_service.guidance.registry import way_of
from mission_service.interfaces.mqtt.command_gate import TAKEN, CommandGate
from mission_service.journal.journal_file import Journal, header_of
from mission_service.journal.recovery import unfinished
from mission_service.journal.segments import begin_state, newest_state, synced
from mission_service.journal.snapshot import Frozen, Known, code_digest, write
from mission_service.live.daemon import replay
from mission_service.live.interface_setup import request_handler_of
from mission_service.replay.verification import verify
from mission_service.runtime.engine import Engine
from mission_service.runtime.state_view import StateView
from mission_service.simulation.sim import Simulation

REQUESTS = 10_000
A_FORK = 40  # requests
DEFECT = "cannot be handled"
UNIX_US = 1_700_000_000_000_000
Rng = np.random.Generator


@dataclass(frozen=True)
class Case:
    """A flight of a shipped scenario, with changes that shorten it, and its end."""

    scenario: str
    changes: tuple[str, ...]
    ends_s: float
    vehicle: str | None = None  # the only vehicle that this process flies


CASES = {
    "default": Case("default", ("start_s=590", "deploy_at_s=600"), 400.0),
    "approval": Case(
        "default", ("start_s=590", "deploy_at_s=600", 'mission.approval="each"'), 400.0
    ),
    "demo": Case("demo", ("start_s=1190", "deploy_at_s=1200"), 400.0),
    "sitl": Case("sitl", ("start_s=1190", "deploy_at_s=1200"), 400.0),
    "one-of-many": Case("sitl", ("start_s=1190", "deploy_at_s=1200"), 200.0, "kite"),
    "team": Case("team", ("start_s=3590",), 200.0),
    "virtual-agents": Case("virtual-agents", (), 60.0),
    "burn": Case(
        "burn", ("deploy_at_s=1", "landscape.rows=120", "landscape.cols=120"), 400.0
    ),
}  # fmt: skip


@dataclass
class Found:
    """Results of all requests."""

    asked: Counter[str] = field(default_factory=Counter)
    done: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)

    def add(self, other: dict[str, Any]) -> None:
        """Add the results of a fork."""
        for name in ("asked", "done", "refused"):
            getattr(self, name).update(other[name])
        self.wrong += other["wrong"]

    def line(self) -> str:
        """Return the results as one line."""
        kinds_done = ", ".join(f"{name} {count}" for name, count in sorted(self.done.items()))
        return (
            f"{self.asked.total()} requests, {self.done.total()} done ({kinds_done}), "
            f"{self.refused.total()} refused; wrong: {len(self.wrong)}"
        )


# Requests -------------------------------------------------------------------------------------

ODD: tuple[Any, ...] = (
    *(None, True, "", "x", "x" * 1000, "\x00", "\ud800", "ünï", [], {}, [[]], -1, 0, 1e-300),
    *(1e308, -1e308, math.nan, math.inf, -math.inf, 2**63, -(2**70), 1e7, 360.0, 180.0001),
)


class RequestGenerator:
    """Generator of random requests from the request table."""

    def __init__(self, rng: Rng, service: Engine, scenario: Scenario) -> None:
        self._rng = rng
        self._service = service
        self._scenario = scenario
        burn = scenario.burn_flown
        self._stations = ["desk"] if burn is None else [each.name for each in burn.stations]
        self._items = ["weather"] if burn is None else list(burn.go_items)
        self._kinds = {
            word: kind for word, kind in request_events.REQUESTS.items() if word != "abort"
        }
        self._words = sorted(self._kinds)
        self._accepted = sorted(request_events.accepted_in(scenario).keys() & self._kinds.keys())

    def request(self) -> dict[str, Any]:
        """Return a request, 95 % of this guidance and 5 % of any; one in six is malformed."""
        rng = self._rng
        word = str(rng.choice(self._accepted if rng.random() < 0.95 else self._words))
        if rng.random() < 0.02:
            return {"do": "abort", **self._operator()}
        asked: dict[str, Any] = {"do": word, **self._operator()}
        for each in kinds.type_info(self._kinds[word]).fields:  # type: ignore[attr-defined]
            if each.name not in ("by", "station") and (each.required or rng.random() < 0.6):
                asked[each.name] = self._value(each.name, each.type)
        if word == "raster":
            asked |= self._edges()
        if rng.random() < 1 / 6:
            self._spoil(asked)
        return asked

    def _edges(self) -> dict[str, float]:
        """Return the edges of a raster of up to 5 km, most often in order."""
        lat_deg, lon_deg = self._place(300.0)
        sizes_deg = self._rng.choice([-0.001, 0.002, 0.01, 0.05], 2).tolist()
        return {
            "south_deg": lat_deg,
            "north_deg": lat_deg + sizes_deg[0],
            "west_deg": lon_deg,
            "east_deg": lon_deg + sizes_deg[1],
        }

    def _rows(self) -> list[str]:
        """Return the rows of a raster, most often all of the same length."""
        rng = self._rng
        count, length = int(rng.integers(1, 30)), int(rng.integers(1, 30))
        found = ["".join(rng.choice(["b", "u", "."], length).tolist()) for _ in range(count)]
        return [*found, "b"] if rng.random() < 0.1 else found

    def _operator(self) -> dict[str, Any]:
        by = ("ann", "bob", " c ", "ünï", "service", "x" * 80)
        return {"by": str(self._rng.choice(by)), "station": str(self._rng.choice(self._stations))}

    def _spoil(self, asked: dict[str, Any]) -> None:
        rng = self._rng
        key = str(rng.choice(sorted(asked)))
        match int(rng.integers(4)):
            case 0 if key != "do":
                del asked[key]
            case 1:
                asked[str(rng.choice(["more", "vehicle", "hash", "at_us"]))] = 1
            case 2 if "points" in asked:
                asked["points"] = [self._odd(), *asked["points"][1:]]
            case _:
                asked[key] = self._odd()

    def _odd(self) -> Any:
        return ODD[int(self._rng.integers(len(ODD)))]

    def _value(self, name: str, kind: kinds.Type) -> Any:
        rng = self._rng
        match name:
            case "vehicle":
                flown = [section.name for section in self._scenario.vehicles]
                return str(rng.choice([*flown, *flown, "", "nobody"]))
            case "hash":
                return str(rng.choice([*self._hashes() * 3, "0" * 64]))
            case "item":
                return str(rng.choice([*self._items, "no such item"]))
            case "points" | "corners":
                return self._points()
            case "rows":
                return self._rows()
            case "lat_deg" | "lon_deg":
                return self._place(rng.choice([10.0, 300.0, 5000.0]))[name == "lon_deg"]
            case "name":
                return str(rng.choice(["ann", "cy", " d ", "e" * 80]))
            case "volume":
                return str(rng.choice(["ann", "cy", "no such volume", "", ""]))
            case "text":
                return str(rng.choice(["gate locked", " ", "é" * 200]))
            case "photo":
                return str(rng.choice(["", f"{'5e' * 32}.jpg", "../journal.jsonl"]))
            case "alarm":
                return str(rng.choice(["link/hawk", "abort", "no such alarm", " "]))
            case "override":
                return str(rng.choice(["the monitor is not calibrated", "", "", " "]))
            case "source":
                return str(rng.choice(["tower", "satellite", ""]))
            case "false_alarms_pct":
                return float(rng.choice([0.0, 0.0, 5.0, 50.0, 100.0]))
            case _:
                return self._of_type(kind)

    def _of_type(self, kind: kinds.Type) -> Any:
        rng = self._rng
        match kind:
            case kinds.Metadata():
                return self._of_type(kind.type)
            case kinds.UnionType():
                return self._of_type(kind.types[int(rng.integers(len(kind.types)))])
            case kinds.LiteralType():
                return kind.values[int(rng.integers(len(kind.values)))]
            case kinds.FloatType() | kinds.IntType():
                low = -1e9 if kind.ge is None else float(kind.ge)
                high = 1e9 if kind.le is None else float(kind.le)
                near = float(np.clip(rng.normal(0.0, 100.0), low, high))
                some = (low, high, near, near, near, float(rng.uniform(low, high)))
                return some[int(rng.integers(len(some)))]
            case kinds.BoolType():
                return bool(rng.random() < 0.5)
            case kinds.NoneType():
                return None
            case _:
                raise AssertionError(f"no random values of type {kind} are defined")

    def _hashes(self) -> list[str]:
        state_view = self._service.state_view
        proposed = (each.proposed for each in state_view.missions.values())
        found = [mission.mission_hash for mission in proposed if mission is not None]
        return [*found, *([state_view.plan_hash] if state_view.plan_hash else [])] or ["1" * 64]

    def _centre(self) -> tuple[float, float]:
        """Return the position of a fire or of a vehicle."""
        state_view = self._service.state_view
        positions = list(state_view.telemetry.values())
        if positions and self._rng.random() < 0.3:
            vehicle = positions[int(self._rng.integers(len(positions)))]
            return vehicle.lat_deg, vehicle.lon_deg
        burn = self._scenario.burn_flown
        if burn is not None and burn.unit is not None:
            corners = np.array(burn.unit)
            return float(corners[:, 0].mean()), float(corners[:, 1].mean())
        lit = self._scenario.ignition[0]
        assert lit.lat_deg is not None
        assert lit.lon_deg is not None
        return lit.lat_deg, lit.lon_deg

    def _place(self, around_m: float) -> tuple[float, float]:
        lat, lon = self._centre()
        north_m, east_m = self._rng.normal(0.0, around_m, 2)
        lon += float(east_m) / 111_195.0 / math.cos(math.radians(lat))
        return float(np.clip(lat + float(north_m) / 111_195.0, -90, 90)), lon

    def _points(self) -> list[list[float]]:
        rng = self._rng
        around_m = float(rng.choice([3.0, 30.0, 100.0, 300.0, 3000.0]))
        count = int(rng.choice([1, 2, 3, 4, 5, 12, 200], p=[0.2, 0.2, 0.2, 0.2, 0.1, 0.09, 0.01]))
        if rng.random() < 0.5 and count > 2:  # points on a ring, so that the sides do not cross
            lat, lon = self._place(around_m / 3)
            turns = np.sort(rng.uniform(0.0, math.tau, count))
            reach = rng.uniform(0.5, 1.0, count) * around_m / 111_195.0
            return [
                [lat + float(r * np.sin(t)), lon + float(r * np.cos(t))]
                for r, t in zip(reach, turns, strict=True)
            ]
        found = [list(self._place(around_m)) for _ in range(count)]
        return [*found, found[0]] if rng.random() < 0.1 else found


# The run --------------------------------------------------------------------------------------


class FuzzedEngine:
    """A flight in virtual time with a durable journal and a state view, as in the daemon."""

    def __init__(self, case: Case, folder: Path) -> None:
        scenario = flying(load_scenario(case.scenario, case.changes))
        self.scenario = one_of_many(scenario, case.vehicle, peer_messaging=False)
        self.landscape = landscape_of(self.scenario)
        way_of(self.scenario).warm_up(self.scenario, self.landscape)
        self.known = Known(self.scenario, self.landscape)
        self.path = folder / "journal.jsonl"
        self.header = header_of(self.scenario, self.known.landscape, "")
        journal = Journal(self.path, self.header, durable=True)
        self.simulation = Simulation(self.scenario, journal, self.landscape)
        self.simulation.estimate.advance(self.simulation.clock.now_us)

    @property
    def service(self) -> Engine:
        """The engine that handles the requests."""
        return self.simulation.service

    def run(self, seconds: float) -> None:
        """Continue the flight."""
        self.simulation.run_until(self.simulation.clock.now_us / 1e6 + seconds)

    def keep(self) -> None:
        """Begin a journal segment with a snapshot, as the daemon does regularly."""
        journal = self.service.recording.journal
        frozen = Frozen(self.service.snapshot_fields(), self.known)
        journal.begin_segment()
        write(begin_state(self.path, journal.rest.segment), frozen, journal.rest)

    def move_journal(self, folder: Path, whole: bool) -> None:
        """Continue with a copy of the journal, or of only its last segment and snapshot."""
        old = self.service.recording.journal
        synced(old.path)
        state = begin_state(self.path, old.rest.segment)
        for each in self.path.parent.glob("journal*") if whole else (self.path, state):
            shutil.copy(each, folder / each.name)
        shutil.copy(state, newest_state(folder / self.path.name))
        self.path = folder / "journal.jsonl"
        journal = Journal(self.path, self.header, durable=True, rest=old.rest)
        self.service.recording.journal = journal

    def again(self) -> Engine:
        """Return the engine of a restart, before it resumes."""
        cut_off = unfinished(self.path, self.known, self.scenario)
        if cut_off is None:
            raise JournalError(f"{self.path}: the run is not resumed")
        cut_off.rest()
        start_us = round(self.scenario.start_s * 1e6)
        names = tuple(section.name for section in self.scenario.flown)
        estimate = RunEstimate(self.scenario, self.landscape)
        estimate.advance(start_us)
        service = Engine(
            self.scenario,
            Core(self.scenario, self.landscape),
            cameras_of(self.scenario, self.landscape),
            estimate,
            self.service.recording.journal,
            StateView(self.scenario, self.landscape, start_us),
            dict.fromkeys(names),  # type: ignore[arg-type]  # nothing is carried out
        )
        if cut_off.objects is not None:
            service.restore(cut_off.objects)
        replay(cut_off, service)
        if cut_off.missing:
            raise JournalError(f"{self.path}: does not contain {cut_off.missing}")
        return service


def differs(live: Engine, again: Engine) -> str:
    """Return the first difference between the live run and a restart; empty if there is none."""
    for service in (live, again):
        service.advance_fire(live.statistics.at_us)
    ours, theirs = live.snapshot_fields(), again.snapshot_fields()
    return next(filter(None, (difference(ours[name], theirs[name], name) for name in ours)), "")


def ask(engine: FuzzedEngine, rng: Rng, count: int, found: Found) -> None:
    """Send ``count`` requests and continue the flight between them."""
    simulation = engine.simulation
    request_handler = request_handler_of(engine.scenario, engine.service, simulation.clock, {})
    gate = CommandGate(request_handler.ask)
    generator = RequestGenerator(rng, engine.service, engine.scenario)
    for number in range(count):
        asked = generator.request()
        word = ascii(asked.get("do")).strip("'")[:20]
        channel = rng.random()
        try:
            answer = _answer(request_handler, gate, asked, number, channel, simulation)
        except Exception:
            found.wrong.append(f"{asked!r:.500}: {traceback.format_exc()}")
            return
        found.asked[word] += 1
        (found.done if answer["ok"] else found.refused)[word] += 1
        error = answer.get("error", "")
        if DEFECT in error or "\n" in error:
            found.wrong.append(f"{asked!r:.500}: {error}")
        elif not answer["ok"] and word == "abort":
            found.wrong.append(f"{asked!r:.500}: an abort was refused: {error}")
        engine.run(float(rng.choice([0.0, 0.3, 1.0, 3.0, 10.0], p=[0.3, 0.3, 0.2, 0.15, 0.05])))


def _answer(
    request_handler: Any,
    gate: CommandGate,
    asked: dict[str, Any],
    number: int,
    channel: float,
    simulation: Simulation,
) -> dict[str, Any]:
    if channel < 0.6 or not isinstance(asked.get("do"), str):
        answer: dict[str, Any] = request_handler.ask(asked)
        return answer
    if channel < 0.8 or asked["do"] not in TAKEN:
        return request_handler.answer(json.dumps(asked).encode())  # type: ignore[no-any-return]
    command = {key: value for key, value in asked.items() if key != "do"}
    command |= {"id": f"id-{number}", "sent_at_unix_us": UNIX_US}
    payload = json.dumps(command).encode()
    at_us = simulation.clock.now_us
    reply = gate.accept(asked["do"], payload, False, at_us, 10.0 * number, UNIX_US)
    assert reply is not None
    return msgspec.to_builtins(reply)  # type: ignore[no-any-return]


def trial(engine: FuzzedEngine, seed: int, count: int, folder: Path, whole: bool) -> Found:
    """Send requests, then check restarts and replay; runs in a fork."""
    found, rng = Found(), np.random.default_rng(seed)
    engine.move_journal(folder, whole)
    ask(engine, rng, count, found)
    if found.wrong:
        return found
    try:
        engine.service.recording.journal.close()
        if problem := differs(engine.service, engine.again()):
            found.wrong.append(f"a restart from the last state: {problem}")
        if whole:
            for state in folder.glob("*.state"):
                state.unlink()
            if problem := differs(engine.service, engine.again()):
                found.wrong.append(f"a restart from the beginning: {problem}")
        result = verify(engine.path, alone=not whole)
        if result.difference is not None:
            found.wrong.append(f"replay: {result.differing}: {result.difference}")
    except Exception:
        found.wrong.append(traceback.format_exc())
    return found


def forked(work: Callable[[], Found]) -> dict[str, Any]:
    """Run a function in a fork, so that it does not change this process; return its results."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            os.close(reading)
            found = work()
            with os.fdopen(writing, "wb") as pipe:
                pipe.write(msgspec.json.encode(vars(found), enc_hook=str))
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(status)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        content = pipe.read()
    os.waitpid(child, 0)
    if not content:
        return {"asked": {}, "done": {}, "refused": {}, "wrong": ["a fork has crashed"]}
    results: dict[str, Any] = msgspec.json.decode(content)
    return results


def run(name: str, count: int, seed: int, found: Found, a_fork: int = A_FORK) -> None:
    """Fly one case and send about ``count`` requests in forks at random times.

    The journal of the last fork is replayed from its beginning, the others from their snapshots.
    """
    case, rng = CASES[name], np.random.default_rng([seed, sum(name.encode())])
    code_digest()
    forks = max(1, round(count / a_fork))
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) / "flown"
        folder.mkdir()
        engine = FuzzedEngine(case, folder)
        at_s = 0.0
        for number, moment_s in enumerate(sorted(rng.uniform(0.0, case.ends_s, forks))):
            engine.run(float(moment_s) - at_s)
            at_s = float(moment_s)
            engine.keep()
            place = Path(made) / f"fork-{number}"
            place.mkdir()
            its_seed = int(rng.integers(2**31))
            is_last = number == forks - 1
            results = forked(partial(trial, engine, its_seed, a_fork, place, is_last))
            prefix = f"{name}, seed {its_seed}, {moment_s:.1f} s: "
            results["wrong"] = [prefix + each for each in results["wrong"]]
            found.add(results)
            shutil.rmtree(place)


def main() -> None:
    """Run all cases; exit with 1 if a check failed."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else REQUESTS
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    names = sys.argv[3:] or list(CASES)
    found = Found()
    for name in names:
        before = len(found.wrong)
        run(name, round(count / len(names)), seed, found)
        click.echo(f"{name}: {found.line()}")
        for line in found.wrong[before:]:
            click.echo(f"  {line}")
    sys.exit(1 if found.wrong else 0)


if __name__ == "__main__":
    main()
