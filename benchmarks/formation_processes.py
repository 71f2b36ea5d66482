"""A process a vehicle: ``python -m benchmarks.formation_processes [COUNT] [SPEEDUP]``.

So many UAVs of ``virtual-agents`` (8), each flown by a process of its own, mock planes that fly
SPEEDUP (15) times as fast as real time, and a real Mosquitto. Two agents are killed, then started
again; at last the broker is killed and started again. Printed is the coverage by virtual agents,
next to that of as many UAVs in the ideal world over the same fire. A few minutes on two cores.

``closest_m`` is by what the UAVs say, each at its own mission time: processes may be a second apart
in that, so it can be wrong by some 20 m. A machine that is too slow for SPEEDUP has messages come
late, which says nothing of a flight in real time.
"""

import asyncio
import contextlib
import json
import math
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import aiomqtt
import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.link_shared import free_ports
from benchmarks.mosquitto import Mosquitto
from mission_service.config.scenario import SHIPPED, Scenario, load_scenario, parse_scenario
from mission_service.core.core import Core
from mission_service.experiments.virtual_agents.ideal_world import FormationWorld, Rules, fly
from mission_service.experiments.virtual_agents.monitoring import MonitoringArea
from mission_service.fire.setup import fire_of, landscape_of
from mission_service.fire.simulated_fire import SimulatedFire
from mission_service.guidance.formation.controller import FormationFlight
from mission_service.guidance.formation.map_grid import map_grid_of
from mission_service.guidance.formation.members import settings_of
from mission_service.guidance.formation.settings import Settings
from mission_service.guidance.formation.warm_up import warm_up
from mission_service.interfaces.control.control_client import ControlClient
from mission_service.interfaces.mqtt.peer_exchange import TIME, channel_of, decoded
from mission_service.journal.journal_file import SegmentReader
from mission_service.peer_messages import State

CLI = [sys.executable, "-m", "mission_service.cli"]
PRESENT_S = 10.0  # who said nothing for longer is not there
MIN_S, MAX_S = 120.0, 300.0  # for a formation to come to rest
SAME_TIME_S = 1.0  # of two states that are compared
NOT_ORDERED = "not ordered, selected by its autopilot or pilot"


def scenario_of(folder: Path, count: int) -> Path:
    """The shipped scenario with its first vehicles on free ports, without an end."""
    text = (SHIPPED / "virtual-agents.toml").read_text(encoding="utf-8")
    text = re.sub(r"duration_s = \d+", "duration_s = 100000", text)
    head, *vehicles = text.split("[[vehicles]]")
    parts = [head]
    for vehicle, port in zip(vehicles[:count], free_ports(count), strict=True):
        parts.append(re.sub(r"127\.0\.0\.1:\d+", f"127.0.0.1:{port}", vehicle))
    path = folder / "scenario.toml"
    path.write_text("[[vehicles]]".join(parts), encoding="utf-8")
    return path


class Stage:
    """The processes of a formation, and what is heard of it on the broker."""

    def __init__(self, folder: Path, count: int, broker: Mosquitto) -> None:
        self.folder = folder
        self.path = scenario_of(folder, count)
        self.scenario: Scenario = load_scenario(str(self.path))
        self.names = [section.name for section in self.scenario.vehicles]
        self.broker = broker
        self.journals: dict[str, list[Path]] = {name: [] for name in self.names}
        self.states: dict[str, State] = {}
        self.now_us = 0
        self.closest_m = math.inf
        self.messages = self.bytes = 0
        landscape = landscape_of(self.scenario)
        self._world = SimulatedFire(fire_of(self.scenario, landscape), landscape)
        self._settings = settings_of(self.scenario, self.scenario.vehicles[0])
        grid = map_grid_of(landscape)
        near_m = self._settings.augmentation_m(grid.cell_m)
        self._area = MonitoringArea(grid, near_m, self._settings.monitoring_m)
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    # Processes --------------------------------------------------------------------------------

    def start(self, name: str) -> None:
        """The process of one vehicle; one that is started again writes a new journal."""
        out = self.folder / f"{name}-{len(self.journals[name])}"
        self.journals[name].append(out / "journal.jsonl")
        broker = ("--broker", self.broker.address)
        self._run(name, "run", str(self.path), "--vehicle", name, *broker, "--out", str(out))

    async def take_over(self, name: str) -> None:
        """A new process, without a journal, for a vehicle in flight: an operator hands it over.

        Without a journal it is not known by whose order the vehicle circles: it is left alone.
        """
        reported = self._text(name).count(NOT_ORDERED)
        since_us = self.now_us
        self.start(name)
        await self.until(
            lambda: name in self.states and self.states[name].at_us > since_us, 120.0, "it is back"
        )
        await self.passes(10.0)
        if self._text(name).count(NOT_ORDERED) > reported:
            with ControlClient(self.journals[name][-1].parent) as operator:
                order = {"do": "resume", "vehicle": name, "confirmed": True}
                operator.ask(**order, by="ann", station="desk")

    def start_mocks(self, speedup: float) -> None:
        """All planes, in one process."""
        self._run("mocks", "mock", str(self.path), "--speedup", str(speedup))

    def _run(self, name: str, *arguments: str) -> None:
        with (self.folder / f"{name}.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                [*CLI, *arguments], stdout=log, stderr=subprocess.STDOUT
            )

    def kill(self, name: str) -> None:
        """SIGKILL."""
        process = self._processes.pop(name)
        process.kill()
        process.wait(timeout=10)
        self.states.pop(name, None)

    def end(self) -> None:
        """Kill what is left."""
        for name in list(self._processes):
            self.kill(name)

    def said(self, name: str, words: str) -> bool:
        """Whether a process has printed this."""
        return words in self._text(name)

    def _text(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text(encoding="utf-8")

    def check(self) -> None:
        """Raises RuntimeError for a process that has ended by itself."""
        for name, process in self._processes.items():
            if process.poll() is not None:
                log = self._text(name)[-2000:]
                raise RuntimeError(f"{name} ended with code {process.returncode}:\n{log}")

    # What is heard ----------------------------------------------------------------------------

    async def listen(self) -> None:
        """Hear all messages until cancelled, over all ends of the broker."""
        channel = channel_of(self.broker.address, "mission-service", self.scenario.name)
        while True:
            with contextlib.suppress(aiomqtt.MqttError):
                async with aiomqtt.Client("127.0.0.1", self.broker.port) as client:
                    await client.subscribe(channel.topic("+", "+"))
                    async for told in client.messages:
                        assert isinstance(told.payload, bytes)
                        *_, name, kind = str(told.topic).split("/")
                        self._hear(name, kind, told.payload)
            await asyncio.sleep(0.1)

    def _hear(self, name: str, kind: str, payload: bytes) -> None:
        self.messages, self.bytes = self.messages + 1, self.bytes + len(payload)
        if kind == TIME:
            self.now_us = max(self.now_us, int(payload))
            return
        message = decoded(name, payload, latest_us=2**60)
        self.now_us = max(self.now_us, message.at_us)
        if isinstance(message, State):
            self.states[name] = message
            for other in self.states.values():
                apart_s = (message.at_us - other.at_us) / 1e6
                if other.sender != name and abs(apart_s) <= SAME_TIME_S:
                    self.closest_m = min(self.closest_m, _distance_m(message, other, apart_s))

    def present(self) -> list[State]:
        """What those said last who are there."""
        since_us = self.now_us - PRESENT_S * 1e6
        return [state for state in self.states.values() if state.at_us >= since_us]

    def has_settled(self, count: int) -> bool:
        """Whether so many are there and their agents have come to rest."""
        present = self.present()
        return len(present) == count and all(state.settled for state in present)

    def coverage(self) -> float:
        """By the virtual agents of those who are there, now."""
        self._world.advance(self.now_us)
        self._area.burn(self._world.fire.arrival_time_s, self.now_us / 1e6)
        agents_m = np.array([(state.agent_x_m, state.agent_y_m) for state in self.present()])
        return self._area.agent_coverage(agents_m.reshape(-1, 2), self._settings.coverage_radius_m)

    def ideal_coverage(self, count: int, over_s: float = 400.0) -> float:
        """By so many UAVs in the ideal world, after they have flown for a while.

        With the paper's safety radius: with a wider one the ideal world's queue stays where it is.
        """
        arrival_s = self._world.fire.arrival_time_s - max(self.now_us / 1e6 - over_s, 0.0)
        settings = replace(self._settings, safety_radius_m=Settings().safety_radius_m)
        world = FormationWorld(arrival_s, count, settings, Rules(duration_s=over_s), seed=1)
        return fly(world).at_end("va_coverage", 30.0)

    async def until(self, what: Callable[[], bool], within_s: float, words: str) -> None:
        """Wait so many seconds of the wall clock for something; raises RuntimeError."""
        end_s = time.monotonic() + within_s
        while not what():
            self.check()
            if time.monotonic() > end_s:
                raise RuntimeError(f"not within {within_s:.0f} s: {words}")
            await asyncio.sleep(0.1)

    async def passes(self, mission_s: float, within_s: float = 120.0) -> None:
        """Wait for mission time."""
        end_us = self.now_us + mission_s * 1e6
        await self.until(lambda: self.now_us >= end_us, within_s, f"{mission_s:.0f} s passed")


def _distance_m(one: State, other: State, later_s: float) -> float:
    """Between two UAVs, the second moved on by so many seconds."""
    return math.hypot(
        one.x_m - other.x_m - later_s * other.velocity_x_m_s,
        one.y_m - other.y_m - later_s * other.velocity_y_m_s,
        one.altitude_amsl_m - other.altitude_amsl_m,
    )


@asynccontextmanager
async def formation(
    folder: Path, count: int, speedup: float, within_s: float = 180.0
) -> AsyncIterator[Stage]:
    """A formation whose vehicles have all said something; everything ends with the context."""
    scenario = load_scenario("virtual-agents")
    warm_up(scenario, landscape_of(scenario))  # once, not in each process
    async with AsyncExitStack() as stack:
        broker = Mosquitto(folder)
        stack.callback(broker.kill)
        broker.start()
        stage = Stage(folder, count, broker)
        stack.callback(stage.end)
        listening = asyncio.create_task(stage.listen())
        stack.callback(listening.cancel)
        for name in stage.names:
            stage.start(name)
        for name in stage.names:
            ready = lambda name=name: stage.said(name, "connected to other processes")  # noqa: E731
            await stage.until(ready, within_s, f"{name} talks")
        stage.start_mocks(speedup)
        await stage.until(lambda: len(stage.present()) == count, within_s, "all fly")
        yield stage


def map_of(journal: Path) -> NDArray[np.bool_]:
    """The fire (y, x) on the map of the vehicle that wrote a journal, at its end."""
    reader = SegmentReader(journal)
    scenario = parse_scenario(reader.header["scenario"], journal)
    core = Core(scenario, landscape_of(scenario))
    for entry in reader:
        if entry.is_event:
            core.handle(entry.content)  # type: ignore[arg-type]
    (seat,) = cast(FormationFlight, core.guidance).formation.members.values()
    return seat.agent.map.fire


async def run(count: int, speedup: float, folder: Path) -> dict[str, Any]:
    """Fly and kill; returns the figures."""
    figures: dict[str, Any] = {"count": count, "speedup": speedup}
    began_s = time.monotonic()
    async with formation(folder, count, speedup) as stage:

        async def settled(of_count: int, what: str) -> None:
            await stage.passes(MIN_S)
            end_us = stage.now_us + MAX_S * 1e6
            await stage.until(
                lambda: stage.has_settled(of_count) or stage.now_us > end_us, 120.0, what
            )
            figures[what] = {
                "mission_s": round(stage.now_us / 1e6),
                "wall_s": round(time.monotonic() - began_s),
                "present": len(stage.present()),
                "coverage": round(stage.coverage(), 3),
                "ideal": round(stage.ideal_coverage(of_count), 3),
                "closest_m": round(stage.closest_m, 1),
            }
            sys.stderr.write(f"{what}: {figures[what]}\n")
            stage.closest_m = math.inf

        await settled(count, "all")
        lost = stage.names[1:3]
        for name in lost:
            stage.kill(name)
        await settled(count - 2, "two killed")
        for name in lost:
            await stage.take_over(name)
        await stage.until(lambda: len(stage.present()) == count, 120.0, "they are back")
        await settled(count, "two back")
        stage.broker.kill()
        await asyncio.sleep(60.0 / speedup)
        stage.broker.start()
        await stage.until(lambda: len(stage.present()) == count, 60.0, "all talk again")
        await settled(count, "broker back")
        figures["messages_per_s_and_uav"] = round(stage.messages / stage.now_us * 1e6 / count, 2)
        figures["bytes_per_s_and_uav"] = round(stage.bytes / stage.now_us * 1e6 / count)
        burned = [journals[-1] for journals in stage.journals.values()]
    maps = [map_of(journal) for journal in burned]
    figures["cells_that_maps_differ_in"] = max(
        int((one != other).sum()) for one in maps for other in maps
    )
    return figures


def main() -> None:
    """Print the figures."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    speedup = float(sys.argv[2]) if len(sys.argv) > 2 else 15.0
    with tempfile.TemporaryDirectory() as folder:
        figures = asyncio.run(run(count, speedup, Path(folder)))
    click.echo(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
