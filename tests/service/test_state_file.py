"""A core restored from a snapshot returns the commands of an uninterrupted core, bit for bit."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.config.rule_lookup import own_ways
from mission_service.config.scenario import Scenario, flying, load_scenario
from mission_service.core.core import Core
from mission_service.events import AnyEvent
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.front.way import PLANNERS
from mission_service.journal.journal_file import Journal, SegmentReader, header_of
from mission_service.journal.snapshot import Frozen, Known, restore
from mission_service.simulation.sim import Simulation
from tests.service.test_formation_sim import at_once

CHANGES = {
    "default": ("start_s=3590",),
    "team": ("start_s=3590",),
    "virtual-agents": (),
    "burn": ("landscape.rows=120", "landscape.cols=120"),
}
FLOWN_S = {"default": 240.0, "team": 130.0, "virtual-agents": 75.0, "burn": 80.0}


@dataclass
class Flown:
    """A scenario that was flown for some minutes, with its events."""

    scenario: Scenario
    landscape: Landscape
    events: list[AnyEvent]
    simulation: Simulation


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Flown]:
    """Fly each shipped scenario once: the same events for all rules of its kind."""
    folder, found = tmp_path_factory.mktemp("flown"), {}
    for name, seconds in FLOWN_S.items():
        scenario = flying(load_scenario(name, CHANGES[name]))
        scenario = scenario.model_copy(update={"vehicles": scenario.vehicles[:3]})
        scenario = at_once(scenario) if name == "virtual-agents" else scenario
        landscape = landscape_of(scenario)
        path = folder / f"{name}.jsonl"
        journal = Journal(path, header_of(scenario, landscape.digest(), ""), durable=False)
        simulation = Simulation(scenario, journal, landscape)
        simulation.run_until(max(scenario.start_s, scenario.deploy_at_s) + seconds)
        journal.close()
        events: list[Any] = [entry.content for entry in SegmentReader(path) if entry.is_event]
        found[name] = Flown(scenario, landscape, events, simulation)
    return found


def kind_of(rule: str) -> str:
    return {"formation": "virtual-agents", "burn": "burn"}.get(
        rule, "default" if rule in PLANNERS else "team"
    )


@pytest.mark.parametrize("rule", own_ways())
def test_a_core_goes_on_from_a_state_as_if_nothing_had_been(
    flown: dict[str, Flown], rule: str
) -> None:
    run = flown[kind_of(rule)]
    planner = run.scenario.planner.model_copy(update={"rule": rule})
    scenario = run.scenario.model_copy(update={"planner": planner})
    shared = Known(scenario, run.landscape)
    cores = [Core(scenario, run.landscape)]
    stops = [round(len(run.events) * share) for share in (0.75, 0.9)]
    command_count = 0
    for number, event in enumerate(run.events):
        if number in stops:
            cores = [cores[0], restore(Frozen({"core": cores[-1]}, shared))["core"]]
        commands = [core.handle(event) for core in cores]
        assert all(each == commands[0] for each in commands), f"event {number}: {event}"
        command_count += len(commands[0])
    assert command_count > 5
    restored = cores[-1]
    assert restored is not cores[0]
    assert restored.landscape is run.landscape
    assert restored.scenario is scenario
    name = scenario.vehicles[0].name
    assert restored.vehicles[name].availability is restored.decision_engine.availability[name]
    assert restored.vehicles[name].section is scenario.vehicles[0]


@pytest.mark.parametrize("name", ["default", "virtual-agents", "burn"])
def test_a_fire_burns_on_from_a_state_as_if_nothing_had_been(
    flown: dict[str, Flown], name: str
) -> None:
    run = flown[name]
    shared = Known(run.scenario, run.landscape)
    world = run.simulation.estimate
    again = restore(Frozen({"world": world}, shared))["world"]
    assert again.landscape is run.landscape
    later_us = round(world.fire.time_s * 1e6) + 900_000_000
    before = np.isfinite(world.fire.arrival_time_s).sum()
    for each in (world, again):
        each.advance(later_us)
    assert np.isfinite(world.fire.arrival_time_s).sum() > before
    assert np.array_equal(world.fire.arrival_time_s, again.fire.arrival_time_s)


def test_arrays_that_share_memory_share_it_again(flown: dict[str, Flown]) -> None:
    run = flown["burn"]
    shared = Known(run.scenario, run.landscape)
    whole = np.arange(24.0).reshape(4, 6)
    read_only = whole[1:3]
    read_only.flags.writeable = False
    objects: dict[str, Any] = {
        "whole": whole,
        "part": whole[::-2, 1:4],
        "bytes": whole.view(np.uint8),
        "across": np.asfortranarray(whole).T,
        "read_only": read_only,
        "elevation": run.landscape.elevation_m,
        "words": np.array(["a", None], dtype=object)[:1],
    }
    for _ in range(2):  # a snapshot that was read can be written again
        objects = restore(Frozen(objects, shared))
    assert np.array_equal(objects["part"], whole[::-2, 1:4])
    assert np.array_equal(objects["across"], whole.T)
    assert not objects["read_only"].flags.writeable
    assert objects["elevation"] is run.landscape.elevation_m
    assert list(objects["words"]) == ["a"]
    objects["whole"][3, 1] = 100.0
    assert objects["part"][0, 0] == 100.0
    assert objects["bytes"].view(np.float64)[3, 1] == 100.0
