"""Runs the demo: a daemon and mock autopilots in child processes, connected by UDP."""

import asyncio
import contextlib
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import Items, Plan
from autopilot_bridge.links.link_address import other_end
from autopilot_bridge.missions.check import check
from autopilot_bridge.missions.plan_file import write_any
from autopilot_bridge.stacks.stacks import stack_named
from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import (
    landing_places,
    mission_parts,
    mission_places,
)
from mission_service.airspace.vehicle_fence import VehicleFence, fence_for
from mission_service.config.scenario import Scenario, flying, load_scenario, scenario_path
from mission_service.config.sections import VehicleSection
from mission_service.core.closed_airspace import ClosedAirspace
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


class PlanWritten(NamedTuple):
    """The numbers of items in a plan file, and the volumes that its fence does not contain."""

    items: int
    fence_items: int
    left_out: tuple[str, ...]


def write_plan(
    name: str,
    vehicle: str | None,
    output: Path,
    overrides: tuple[str, ...],
    with_fence: bool = False,
) -> PlanWritten:
    """Write a vehicle's first mission, and the fence of its airspace if asked, as a .plan file."""
    scenario = flying(load_scenario(name, overrides))
    landscape = landscape_of(scenario)
    section = vehicle_of(scenario, vehicle)
    items = way_of(scenario).first_mission(scenario, section, landscape)
    _refuse_conflict(items, section, scenario, landscape)
    fence = VehicleFence((), ())
    if with_fence:
        fence = fence_for(section, scenario, landscape)
        if not fence.items:
            reasons = "; ".join(fence.left_out) or "the scenario closes no airspace"
            raise ScenarioError(f"{scenario.name}: --fence: no fence can be written: {reasons}")
        problems = check(
            fence.items, stack_named(section.stack, section.kind), mavlink.MAV_MISSION_TYPE_FENCE
        )
        if problems:
            raise ScenarioError(f"{scenario.name}: --fence: {problems[0]}")
    plan = Plan(items, fence=fence.items, home=home_of(section, landscape))
    write_any(output, plan, stack_named(section.stack, section.kind))
    return PlanWritten(len(items), len(fence.items), fence.left_out)


def _refuse_conflict(
    items: Items, section: VehicleSection, scenario: Scenario, landscape: Landscape
) -> None:
    """Raise ScenarioError if a first mission, or the landing in it, would enter closed airspace."""
    airspace = ClosedAirspace(scenario.airspace, landscape).at(scenario.first_flight_s)
    if not airspace.is_limited:
        return
    altitude_m = home_of(section, landscape)[2]
    x_m, y_m = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    start = (float(x_m), float(y_m), altitude_m)
    for places in (mission_places, landing_places):
        parts = mission_parts(places(items, landscape, altitude_m), [start])
        conflict = airspace.conflict(parts, landscape, start)
        if conflict is not None:
            raise ScenarioError(
                f"{scenario.name}: the first mission of {section.name} would enter {conflict}; "
                "correct the airspace, or fly with `run` or `sim`, which route missions around "
                "closed volumes where possible"
            )
