"""The formation in the whole loop in virtual time: mock planes with MAVLink frames."""

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from benchmarks.formation_flight import figures_of
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.core.core import Core
from mission_service.errors import MissionServiceError
from mission_service.events import AnyOperatorEvent, OrderGiven
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import Journal, header_of
from mission_service.replay.decisions import decide
from mission_service.replay.verification import verify
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.simulation.sim import Simulation, simulate
from tests.announced import Announced

APART_M = 340.0  # spacing of homes, so that all may take off at once
AWAY_M = 1100.0  # distance of homes from the fire
SETTLED_BY_S = 290.0
ENDS_S = 360.0


def at_once(scenario: Scenario) -> Scenario:
    """Return the scenario with homes in a row north of the fire instead of one base."""
    land = landscape_of(scenario)
    x_m, y_m = land.xy_of_lat_lon(scenario.ignition[0].lat_deg, scenario.ignition[0].lon_deg)
    middle = (len(scenario.vehicles) - 1) / 2.0
    vehicles = []
    for number, section in enumerate(scenario.vehicles):
        lat, lon = land.lat_lon_of(x_m + APART_M * (number - middle), y_m + AWAY_M)
        home = {"home_lat_deg": float(lat), "home_lon_deg": float(lon)}
        vehicles.append(section.model_copy(update=home))
    return scenario.model_copy(update={"vehicles": tuple(vehicles)})


@dataclass
class Run:
    journal: Path
    record: RunStatistics
    figures: dict[str, Any]
    announcements: list[str]


def flown(scenario: Scenario, path: Path, from_s: float) -> Run:
    announced = Announced()
    record, _ = simulate(scenario, path, "2026-01-01", announced)
    return Run(path, record, figures_of(path, from_s), announced.lines)


@pytest.fixture(scope="module")
def eight(tmp_path_factory: pytest.TempPathFactory) -> Run:
    path = tmp_path_factory.mktemp("formation") / "journal.jsonl"
    scenario = load_scenario("virtual-agents", (f"duration_s={ENDS_S}",))
    return flown(at_once(scenario), path, SETTLED_BY_S)


def test_eight_px4_planes_fly_their_orbits_in_phase(eight: Run) -> None:
    """A short version of benchmarks.formation_flight, which flies twenty minutes."""
    figures = eight.figures
    assert figures["radius_within_10_percent"] == 1.0
    assert figures["phase_within_15_deg"] >= 0.99
    assert figures["refused"] == figures["uploads_not_accepted"] == 0
    assert figures["on_circles_share"] > 0.7
    assert figures["samples"] > 8 * 60


def test_they_keep_apart_at_one_height(eight: Run) -> None:
    assert eight.record.closest is not None
    assert eight.record.closest.distance_m > 2 * 30.0


def test_those_that_settled_fly_their_missions(eight: Run) -> None:
    for name, vehicle in eight.record.vehicles.items():
        assert vehicle.orders["Orbit"] > 5, name
        assert vehicle.upload_reasons["fly to the fire"] == 1, name
    settled = [
        each.upload_reasons["settled: loiter on this circle"]
        for each in eight.record.vehicles.values()
    ]
    assert sum(count > 0 for count in settled) >= 4


def test_orders_do_not_flood_the_links(eight: Run) -> None:
    for name, vehicle in eight.record.vehicles.items():
        assert vehicle.orders.total() < 0.6 * ENDS_S, name


@pytest.mark.long
def test_a_replay_reproduces_every_order(eight: Run) -> None:
    result = verify(eight.journal)
    assert result.difference is None
    assert result.commands > 500


def test_planners_alone_report_that_there_are_no_decisions(eight: Run) -> None:
    with pytest.raises(
        MissionServiceError, match="makes no decisions along a front; use replay --verify"
    ):
        decide(eight.journal)


@pytest.mark.long
def test_both_stacks_fly_together_over_a_bad_link(tmp_path: Path) -> None:
    overrides = ("duration_s=330", "link.loss=0.05", "fire.initial_cells=300")
    scenario = at_once(load_scenario("virtual-agents", overrides))
    first, second, third = scenario.vehicles[:3]
    others = (second.model_copy(update={"stack": "ardupilot"}), third)
    scenario = scenario.model_copy(update={"vehicles": (first, *others)})
    run = flown(scenario, tmp_path / "journal.jsonl", 250.0)
    assert run.figures["radius_within_10_percent"] == 1.0
    assert run.figures["radius_off_most"] > 0.03  # ArduPlane flies wider orbits
    assert run.figures["phase_within_15_deg"] >= 0.95
    assert run.figures["samples"] > 3 * 60
    assert verify(run.journal).difference is None


@pytest.mark.long
def test_a_held_vehicle_is_kept_clear_of_for_as_long_as_the_hold_takes(
    tmp_path: Path,
) -> None:
    scenario = at_once(load_scenario("virtual-agents", ("duration_s=800",)))
    landscape = landscape_of(scenario)
    header = header_of(scenario, landscape.digest(), "2026-01-01")
    held: list[AnyOperatorEvent] = [OrderGiven(330_000_000, "ann", "desk", "crane", "hold")]

    def hold(at_us: int, core: Core) -> list[AnyOperatorEvent]:
        return [held.pop()] if held and at_us >= held[0].at_us else []

    with contextlib.closing(Journal(tmp_path / "journal.jsonl", header, durable=False)) as journal:
        simulation = Simulation(scenario, journal, landscape, hold)
        record = simulation.service.statistics
        simulation.run_until(450.0)
        record.closest = None
        simulation.run_until(800.0)
    announced = simulation.service.state_view.announcements
    words = [line.text for line in announced if line.vehicle == "crane"]
    assert any("hold ordered" in text for text in words)
    assert record.closest is not None
    assert record.closest.distance_m > 2 * 30.0, record.closest
