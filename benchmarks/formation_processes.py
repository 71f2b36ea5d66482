"""One process for each vehicle: ``python -m benchmarks.formation_processes [COUNT] [SPEEDUP]``.

COUNT UAVs of ``virtual-agents`` (default 8) are each controlled by a separate process. The mock
planes fly SPEEDUP (default 15) times as fast as real time, and the broker is a real Mosquitto. Two
processes are killed and restarted, then the broker is killed and restarted. The benchmark prints
the coverage by virtual agents, and the coverage by the same number of UAVs in the ideal simulation
of the same fire. It takes a few minutes on two cores.

``closest_m`` uses the states that the UAVs publish. The mission times of the processes may differ
by a second, so its error is about 20 m. On a machine that is too slow for SPEEDUP, messages arrive
later than in a flight at real-time speed.
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
from functools import partial
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
from mission_service.fire.scenario_fire import fire_of, landscape_of
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
PRESENT_S = 10.0  # maximum age of the last state of a UAV that is present
MIN_S, MAX_S = 120.0, 300.0  # time for a formation to settle
IDEAL_S = 400.0  # duration of the ideal simulation
SAME_TIME_S = 1.0  # maximum time between two states that are compared
NOT_ORDERED = "not ordered, selected by its autopilot or pilot"


def scenario_of(folder: Path, count: int) -> Path:
    """Write the shipped scenario with ``count`` vehicles on free ports and without an end."""
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
    """The processes of a formation, and the messages they publish on the broker."""

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
        """Start the process of one vehicle; after a restart it writes a new journal."""
        out = self.folder / f"{name}-{len(self.journals[name])}"
        self.journals[name].append(out / "journal.jsonl")
        broker = ("--broker", self.broker.address)
        self._run(name, "run", str(self.path), "--vehicle", name, *broker, "--out", str(out))

    async def take_over(self, name: str) -> None:
        """Start a new process without a journal for a flying vehicle, and resume its control.

        Without a journal the process has no record of the order for the present orbit. It does not
        control the vehicle until an operator sends ``resume``.
        """
        reported = self._text(name).count(NOT_ORDERED)
        since_us = self.now_us
        self.start(name)
        await self.until(
            lambda: name in self.states and self.states[name].at_us > since_us,
            120.0,
            f"{name} publishes again",
        )
        await self.passes(10.0)
        if self._text(name).count(NOT_ORDERED) > reported:
            with ControlClient(self.journals[name][-1].parent) as operator:
                operator.ask(do="resume", vehicle=name, confirmed=True, by="ann", station="desk")

    def start_mocks(self, speedup: float) -> None:
        """Start all mock planes in one process."""
        self._run("mocks", "mock", str(self.path), "--speedup", str(speedup))

    def _run(self, name: str, *arguments: str) -> None:
        with (self.folder / f"{name}.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                [*CLI, *arguments], stdout=log, stderr=subprocess.STDOUT
            )

    def kill(self, name: str) -> None:
        """Kill a process with SIGKILL."""
        process = self._processes.pop(name)
        process.kill()
        process.wait(timeout=10)
        self.states.pop(name, None)

    def end(self) -> None:
        """Kill all processes."""
        for name in list(self._processes):
            self.kill(name)

    def has_logged(self, name: str, text: str) -> bool:
        """Return True if the log of a process contains a text."""
        return text in self._text(name)

    def _text(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text(encoding="utf-8")

    def check(self) -> None:
        """Raise RuntimeError if a process has ended by itself."""
        for name, process in self._processes.items():
            if process.poll() is not None:
                log = self._text(name)[-2000:]
                raise RuntimeError(f"{name} ended with code {process.returncode}:\n{log}")

    # Messages ---------------------------------------------------------------------------------

    async def listen(self) -> None:
        """Receive all messages until cancelled; reconnect after each restart of the broker."""
        channel = channel_of(self.broker.address, "mission-service", self.scenario.name)
        while True:
            with contextlib.suppress(aiomqtt.MqttError):
                async with aiomqtt.Client("127.0.0.1", self.broker.port) as client:
                    await client.subscribe(channel.topic("+", "+"))
                    async for received in client.messages:
                        assert isinstance(received.payload, bytes)
                        *_, name, kind = str(received.topic).split("/")
                        self._receive(name, kind, received.payload)
            await asyncio.sleep(0.1)

    def _receive(self, name: str, kind: str, payload: bytes) -> None:
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
        """Return the last state of each UAV that is present."""
        since_us = self.now_us - PRESENT_S * 1e6
        return [state for state in self.states.values() if state.at_us >= since_us]

    def has_settled(self, count: int) -> bool:
        """Return True if ``count`` UAVs are present and their virtual agents have settled."""
        present = self.present()
        return len(present) == count and all(state.settled for state in present)

    def coverage(self) -> float:
        """Return the present coverage by the virtual agents of the UAVs that are present."""
        self._world.advance(self.now_us)
        self._area.burn(self._world.fire.arrival_time_s, self.now_us / 1e6)
        agents_m = np.array([(state.agent_x_m, state.agent_y_m) for state in self.present()])
        return self._area.agent_coverage(agents_m.reshape(-1, 2), self._settings.coverage_radius_m)

    def ideal_coverage(self, count: int) -> float:
        """Return the coverage by ``count`` UAVs in the ideal simulation after ``IDEAL_S``.

        The safety radius is the paper's, because with a larger radius the UAVs that queue at the
        start of the ideal simulation do not move.
        """
        arrival_s = self._world.fire.arrival_time_s - max(self.now_us / 1e6 - IDEAL_S, 0.0)
        settings = replace(self._settings, safety_radius_m=Settings().safety_radius_m)
        world = FormationWorld(arrival_s, count, settings, Rules(duration_s=IDEAL_S), seed=1)
        return fly(world).at_end("va_coverage", 30.0)

    async def until(self, condition: Callable[[], bool], within_s: float, text: str) -> None:
        """Wait for a condition; raise RuntimeError after ``within_s`` of the wall clock."""
        end_s = time.monotonic() + within_s
        while not condition():
            self.check()
            if time.monotonic() > end_s:
                raise RuntimeError(f"not within {within_s:.0f} s: {text}")
            await asyncio.sleep(0.1)

    async def passes(self, mission_s: float) -> None:
        """Wait until ``mission_s`` of mission time have passed."""
        end_us = self.now_us + mission_s * 1e6
        await self.until(lambda: self.now_us >= end_us, 120.0, f"{mission_s:.0f} s passed")


def _distance_m(one: State, other: State, later_s: float) -> float:
    """Return the distance of two UAVs, the second one extrapolated by ``later_s``."""
    return math.hypot(
        one.x_m - other.x_m - later_s * other.velocity_x_m_s,
        one.y_m - other.y_m - later_s * other.velocity_y_m_s,
        one.altitude_amsl_m - other.altitude_amsl_m,
    )


@asynccontextmanager
async def formation(
    folder: Path, count: int, speedup: float, within_s: float = 180.0
) -> AsyncIterator[Stage]:
    """Start a formation and wait until all its UAVs are present; end it with the context."""
    scenario = load_scenario("virtual-agents")
    warm_up(scenario, landscape_of(scenario))  # compile once here, not in each process
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
            ready = partial(stage.has_logged, name, "connected to other processes")
            await stage.until(ready, within_s, f"{name} is connected")
        stage.start_mocks(speedup)
        await stage.until(lambda: len(stage.present()) == count, within_s, "all fly")
        yield stage


def map_of(journal: Path) -> NDArray[np.bool_]:
    """Return the fire (y, x) on the map of the vehicle at the end of its journal."""
    reader = SegmentReader(journal)
    scenario = parse_scenario(reader.header["scenario"], journal)
    core = Core(scenario, landscape_of(scenario))
    for entry in reader:
        if entry.is_event:
            core.handle(entry.content)  # type: ignore[arg-type]
    (member,) = cast(FormationFlight, core.guidance).formation.members.values()
    return member.agent.map.fire


async def run(count: int, speedup: float, folder: Path) -> dict[str, Any]:
    """Fly the formation, kill and restart processes; return the figures."""
    figures: dict[str, Any] = {"count": count, "speedup": speedup}
    began_s = time.monotonic()
    async with formation(folder, count, speedup) as stage:

        async def settled(of_count: int, phase: str) -> None:
            await stage.passes(MIN_S)
            end_us = stage.now_us + MAX_S * 1e6
            await stage.until(
                lambda: stage.has_settled(of_count) or stage.now_us > end_us, 120.0, phase
            )
            figures[phase] = {
                "mission_s": round(stage.now_us / 1e6),
                "wall_s": round(time.monotonic() - began_s),
                "present": len(stage.present()),
                "coverage": round(stage.coverage(), 3),
                "ideal": round(stage.ideal_coverage(of_count), 3),
                "closest_m": round(stage.closest_m, 1),
            }
            click.echo(f"{phase}: {figures[phase]}", err=True)
            stage.closest_m = math.inf

        await settled(count, "all")
        lost = stage.names[1:3]
        for name in lost:
            stage.kill(name)
        await settled(count - 2, "two killed")
        for name in lost:
            await stage.take_over(name)
        await stage.until(lambda: len(stage.present()) == count, 120.0, "all UAVs are present")
        await settled(count, "two back")
        stage.broker.kill()
        await asyncio.sleep(60.0 / speedup)
        stage.broker.start()
        await stage.until(lambda: len(stage.present()) == count, 60.0, "all UAVs publish")
        await settled(count, "broker back")
        figures["messages_per_s_and_uav"] = round(stage.messages / stage.now_us * 1e6 / count, 2)
        figures["bytes_per_s_and_uav"] = round(stage.bytes / stage.now_us * 1e6 / count)
    maps = [map_of(journals[-1]) for journals in stage.journals.values()]
    figures["cells_that_maps_differ_in"] = max(
        int((one != other).sum()) for one in maps for other in maps
    )
    return figures


def main() -> None:
    """Fly the formation and print the figures."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    speedup = float(sys.argv[2]) if len(sys.argv) > 2 else 15.0
    with tempfile.TemporaryDirectory() as folder:
        figures = asyncio.run(run(count, speedup, Path(folder)))
    click.echo(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
