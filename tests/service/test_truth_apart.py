"""The simulated fire reaches estimate, guidance and interfaces only by observations."""

import asyncio
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import mission_service
from firemodel.assimilation.observation import UNBURNED
from mission_service.config.fire_sections import SimulationSection
from mission_service.config.rule_lookup import own_ways
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.events import Corrected, Observed, Undone, WindSet
from mission_service.fire.observed_window import states_in
from mission_service.fire.run_ensemble import Images
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.fire.simulated_cameras import SimulatedCameras
from mission_service.fire.simulated_fire import SimulatedFire, simulated_fire_of
from mission_service.journal.journal_file import SegmentReader
from mission_service.replay.verification import verify
from mission_service.simulation.simulated_crew import SimulatedCrew
from tests.api.worlds import world_in

SENSORS = tuple(
    f"mission_service.fire.{name}"
    for name in ("simulated_cameras", "simulated_fire", "camera_views")
)
SOON = ("deploy_at_s=600",)
OF_RULE = {"formation": ("virtual-agents", ()), "burn": ("burn", ())}
SHORT = ("islam_hu_damped", "predictive", "informative", "team.balanced", "formation", "burn")
WRONG = ("simulation.fire.wind_turn_deg=40", "simulation.fire.spread_factor=1.5")


class Poisoned:
    """An object whose attributes raise outside the modules of simulated sensors."""

    def __init__(self, held: Any) -> None:
        object.__setattr__(self, "_held", held)

    def __getattribute__(self, name: str) -> Any:
        _refuse_others(name)
        return getattr(object.__getattribute__(self, "_held"), name)

    def __setattr__(self, name: str, value: Any) -> None:
        _refuse_others(name)
        setattr(object.__getattribute__(self, "_held"), name, value)


def _refuse_others(name: str) -> None:
    reader = sys._getframe(2).f_globals["__name__"]
    if reader not in SENSORS:
        raise AssertionError(f"{reader} reads the attribute {name} of the simulated fire")


def poisoned(scenario: Scenario) -> SimulatedFire:
    """Replace the simulated fire of a scenario; only sensors can read it and its spread model."""
    landscape = landscape_of(scenario)
    found = simulated_fire_of(scenario, landscape)
    assert found is not None
    found.fire = Poisoned(found.fire)  # type: ignore[assignment]
    return Poisoned(found)  # type: ignore[return-value]


def scenario_of_rule(rule: str) -> Scenario:
    """Return a scenario that is flown by a rule."""
    name, changes = OF_RULE.get(rule, ("team" if rule.startswith("team.") else "default", SOON))
    return load_scenario(name, (*changes, f'planner.rule="{rule}"'))


def test_reading_a_poisoned_fire_fails() -> None:
    fire = poisoned(load_scenario("default"))
    with pytest.raises(AssertionError, match="reads the attribute landscape of the simulated fire"):
        _ = fire.landscape


@pytest.mark.parametrize(
    "rule",
    [rule if rule in SHORT else pytest.param(rule, marks=pytest.mark.long) for rule in own_ways()],
)
def test_every_rule_flies_with_a_poisoned_fire(rule: str, tmp_path: Path) -> None:
    scenario = scenario_of_rule(rule)
    world = world_in(tmp_path, scenario)
    engine, context = world.simulation.service, world.context
    engine.cameras = SimulatedCameras(scenario, poisoned(scenario))
    if scenario.burn_flown is not None:
        world.simulation._crew = SimulatedCrew(scenario.burn_flown).due
    world.fly(scenario.first_flight_s + (60.0 if rule == "formation" else 150.0))
    assert engine.statistics.observations
    assert context.fire()["area_ha"] > 0.0
    context.weather()
    now_s = world.now_s

    async def read() -> None:
        forecasts = context.forecasts
        await forecasts.arrival(now_s + 1800.0)
        await forecasts.probability(now_s + 1800.0)
        forecasts.close()

    asyncio.run(read())
    if scenario.burn_flown is None:
        place = (scenario.ignition[0].lat_deg, scenario.ignition[0].lon_deg)
        now_us = world.simulation.clock.now_us
        report = Corrected(now_us, "ann", "", "burned", "point", (place,), now_us)  # type: ignore[arg-type]
        engine.submit(report, world.simulation.link_us)
    world.fly(now_s + 30.0)


def overlap_of(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Return the intersection over union of two areas."""
    return float(np.count_nonzero(first & second) / np.count_nonzero(first | second))


@pytest.mark.long
def test_the_estimate_follows_a_fire_that_its_model_does_not_reproduce(tmp_path: Path) -> None:
    """Wind is turned by 40 degrees, rates are 1.5 times as high; one plane corrects this."""
    changes = ("deploy_at_s=1200", 'planner.rule="circling"')
    scenario = load_scenario("default", (*changes, *WRONG))
    world = world_in(tmp_path, scenario)
    world.fly(4500.0)
    world.simulation.service.advance_fire(world.simulation.clock.now_us)
    assert world.simulation.cameras is not None
    true = world.simulation.cameras.fire.fire.burned()
    model = fire_of(scenario, landscape_of(scenario))
    model.advance(world.now_s)
    assert overlap_of(model.burned(), true) < 0.5
    assert overlap_of(world.simulation.estimate.fire.burned(), true) > 0.85


@pytest.mark.long
def test_how_often_the_estimate_is_read_does_not_change_it(tmp_path: Path) -> None:
    scenario = load_scenario("default", ("deploy_at_s=600", *WRONG))
    flights = []
    for name, every_s in (("often", 11.0), ("once", 1200.0)):
        folder = tmp_path / name
        folder.mkdir()
        world = world_in(folder, scenario)
        for until_s in np.arange(every_s, 1200.0, every_s):
            world.simulation.run_until(float(until_s))
            world.simulation.estimate.advance(world.simulation.clock.now_us)
        world.simulation.run_until(1200.0)
        world.simulation.estimate.advance(1_200_000_000)
        flights.append(world.simulation.estimate.fire.expected_s())
    often, once = flights
    assert np.array_equal(often, once)


@pytest.mark.long
def test_without_a_simulated_fire_the_estimate_is_flown(tmp_path: Path) -> None:
    """The estimate burns on by the model; its views for planners are not observations of it."""
    scenario = load_scenario("default", ("deploy_at_s=600", "planner.rule=circling"))
    scenario = scenario.model_copy(update={"simulation": SimulationSection()})
    world = world_in(tmp_path, scenario)
    world.fly(3600.0)  # long enough for a fire that crosses several cells between two images
    engine = world.simulation.service
    engine.advance_fire(world.simulation.clock.now_us)
    assert engine.cameras is None
    model = fire_of(scenario, landscape_of(scenario))
    model.advance(engine.estimate.fire.time_s)
    assert np.array_equal(engine.estimate.fire.burned(), model.burned())
    inputs = engine.estimate.ensemble.inputs_until(world.now_s)
    assert not any(isinstance(each, Images) and each.seen for each in inputs)
    assert world.context.state_view.vehicles["hawk"].decisions
    engine.recording.journal.close()
    verification = verify(tmp_path / "journal.jsonl")
    assert verification.difference is None
    stage = next(each for each in verification.stages if each.name == "fire")
    assert stage.counts["observations"] > 100
    assert stage.counts["within tolerance"] == 0
    images = [
        entry.content
        for entry in SegmentReader(tmp_path / "journal.jsonl")
        if isinstance(entry.content, Observed)
    ]
    assert all(image.estimated for image in images)


def test_images_that_contradict_a_correction_reach_the_planners(tmp_path: Path) -> None:
    """Otherwise a planner would fly around a fire that no camera observes."""
    scenario = load_scenario("default", ("deploy_at_s=600", "planner.rule=circling"))
    world = world_in(tmp_path, scenario)
    world.fly(900.0)
    engine, estimate = world.simulation.service, world.simulation.estimate
    land, now_us = estimate.landscape, world.simulation.clock.now_us
    row, col = np.argwhere(estimate.fire.burned()).max(axis=0) + 6
    corners = [(row, col), (row, col + 8), (row + 8, col + 8), (row + 8, col)]
    places = tuple(
        tuple(float(each) for each in land.lat_lon_of(*land.xy_of(*corner))) for corner in corners
    )
    engine.submit(Corrected(now_us, "ann", "", "burned", "polygon", places, now_us), 0)  # type: ignore[arg-type]
    assert estimate.fire.burned()[row + 4, col + 4]
    assert estimate.contradicted() == ()
    image = Observed(now_us + 1_000_000, "hawk", int(row) - 5, int(col) - 5, ("u" * 20,) * 20)
    estimate.on_event(image)
    estimate.on_event(Observed(now_us + 60_000_000, "hawk", 0, 0, (".",)))
    estimate.advance(now_us + 60_000_000)
    (window,) = estimate.contradicted()
    assert not estimate.fire.burned()[row + 4, col + 4]
    state = states_in(window.cells)
    assert state[row + 4 - window.row, col + 4 - window.col] == UNBURNED
    engine.check_estimate(world.simulation.link_us)
    engine._estimate_due_us = 0
    engine.check_estimate(world.simulation.link_us)
    assert estimate.contradicted() == ()
    planner: Any = engine.core.guidance.planners["hawk"]
    assert planner.shape(float(row), float(col)).max() < 40.0


def test_an_estimate_without_any_fire_begins_with_a_report() -> None:
    place = {"ignition_known": False, "reported_lat_deg": 36.364232, "reported_lon_deg": -84.140907}
    changes = (*(f"planner.{key}={str(value).lower()}" for key, value in place.items()),)
    scenario = load_scenario("default", (*changes, "ignition=[]"))
    estimate = RunEstimate(scenario, landscape_of(scenario))
    estimate.advance(600_000_000)
    assert estimate.fire.burned_ha == 0.0
    estimate.apply_report(WindSet(600_000_000, "ann", "", 6.0, 45.0))
    at = (place["reported_lat_deg"], place["reported_lon_deg"])
    estimate.apply_report(Corrected(660_000_000, "ann", "", "burning", "point", (at,), 660_000_000))
    estimate.advance(4_000_000_000)
    assert estimate.fire.burned_ha > 5.0
    estimate.apply_report(Undone(4_000_000_000, "ann", ""))
    assert estimate.fire.burned_ha == 0.0


def test_no_module_but_the_sensors_imports_the_simulated_fire() -> None:
    root = Path(mission_service.__file__).parent
    readers = {
        str(path.relative_to(root))
        for path in root.rglob("*.py")
        if "fire.simulated_fire import" in path.read_text(encoding="utf-8")
    }
    assert readers == {
        "fire/simulated_cameras.py",
        "simulation/image_writer.py",  # images in files
        *("simulation/mock_processes.py", "simulation/sim.py"),  # the wind
    }
