"""Runs the demo: a daemon and mock autopilots in child processes, connected by UDP."""

import asyncio
import contextlib
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from autopilot_bridge.items import Plan
from autopilot_bridge.links.link_address import other_end
from autopilot_bridge.missions.plan_file import write_any
from autopilot_bridge.stacks.stacks import stack_named
from mission_service.config.scenario import Scenario, flying, load_scenario, scenario_path
from mission_service.config.sections import VehicleSection
from mission_service.errors import MissionServiceError, ScenarioError, did_you_mean
from mission_service.fire.scenario_fire import home_of, landscape_of
from mission_service.guidance.registry import way_of
from mission_service.live.daemon import Run, serve
from mission_service.runtime.engine import Progress
from mission_service.runtime.run_outputs import write_outputs


def run_demo(
    run: Run,
    name: str,
    speedup: float,
    progress: Progress,
    address: Callable[[str], None],
    notice: Callable[[str], None],
) -> dict[str, Any]:
    """Fly the scenario ``name`` with mock autopilots over UDP and return the summary.

    Raises MissionServiceError if a mock's process ends.
    """
    scenario = run.scenario
    with contextlib.ExitStack() as stack:
        mocks = [
            stack.enter_context(_mock_process(name, section, speedup))
            for section in scenario.vehicles
        ]

        def mocks_alive() -> None:
            for section, mock in zip(scenario.vehicles, mocks, strict=True):
                if mock.poll() is not None:
                    raise MissionServiceError(
                        f"the mock autopilot of {section.name} ended with code {mock.returncode}"
                    )

        record, fire = asyncio.run(serve(run, progress, mocks_alive, address, notice))
    return write_outputs(run.out, scenario, record, fire)


@contextlib.contextmanager
def _mock_process(
    scenario: str, section: VehicleSection, speedup: float
) -> Iterator["subprocess.Popen[bytes]"]:
    """Run one mock autopilot, connected to the daemon's port, until the end of this context."""
    command = [
        *(sys.executable, "-m", "mission_service.cli", "mock", str(scenario_path(scenario))),
        *("--until-eof", "--vehicle", section.name),
        *("--speedup", str(speedup)),
        *(word for link in section.links for word in ("--link", other_end(link))),
    ]
    if section.signing_key is not None:
        command += ["--signing-key", section.signing_key]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(timeout=5)
        if process.stdin is not None:
            process.stdin.close()


def vehicle_of(scenario: Scenario, name: str | None) -> VehicleSection:
    """Return the vehicle with this name, or the first vehicle for None; raises ScenarioError."""
    if name is None:
        return scenario.vehicles[0]
    for section in scenario.vehicles:
        if section.name == name:
            return section
    names = [section.name for section in scenario.vehicles]
    listed = f"(it has: {', '.join(names)}){did_you_mean(name, names)}"
    raise ScenarioError(f"{scenario.name} has no vehicle {name!r} {listed}")


def write_plan(name: str, vehicle: str | None, output: Path, overrides: tuple[str, ...]) -> int:
    """Write a vehicle's first mission as a .plan file and return the number of items."""
    scenario = flying(load_scenario(name, overrides))
    landscape = landscape_of(scenario)
    section = vehicle_of(scenario, vehicle)
    items = way_of(scenario).first_mission(scenario, section, landscape)
    plan = Plan(items, home=home_of(section, landscape))
    write_any(output, plan, stack_named(section.stack, section.kind))
    return len(items)
