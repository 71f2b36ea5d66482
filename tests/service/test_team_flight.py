"""A team in the whole loop in virtual time: four vehicles of both stacks, one of which fails."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firemodel.spread.fire_scheme import Fire
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.guidance.team.baselines import Bumper
from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing
from mission_service.guidance.team.team import TeamMember
from mission_service.replay.decisions import decide
from mission_service.replay.verification import verify
from mission_service.runtime.run_outputs import summary_of
from mission_service.runtime.run_statistics import RunStatistics
from mission_service.simulation import sim
from tests.announced import Announced
from tests.service.dead_autopilot import Dead

DIES_S = 4350.0
ENDS_S = 4800.0
SHORT = (f"duration_s={ENDS_S:.0f}", "planner.rule=team.bumper")


class Mortal(sim.SimulatedVehicle):
    """A simulated vehicle; the mock of swift can fail."""

    def handle_due(self, now_us: int, service: Any) -> None:
        if self.gateway.name == "swift" and service.statistics.at_us > DIES_S * 1e6:
            self.mock = Dead()  # type: ignore[assignment]
            self._weather = None
        super().handle_due(now_us, service)


class Noted(Bumper):
    """The bumper rule, which records the members that it was given at each time."""

    def __init__(self) -> None:
        super().__init__()
        self.members: list[tuple[float, tuple[int, ...]]] = []

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        self.members.append((at_s, tuple(int(member) for member in fleet.member)))
        return super().decide(ring, fleet, which, at_s)


@dataclass
class Run:
    journal: Path
    record: RunStatistics
    fire: Fire
    cores: list[Core]
    announcements: list[str] = field(default_factory=list)

    @property
    def member(self) -> TeamMember:
        planner = self.cores[0].decision_engine.planners["hawk"]
        assert isinstance(planner, TeamMember)
        return planner


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    path = tmp_path_factory.mktemp("team") / "journal.jsonl"
    cores: list[Core] = []

    def core(*args: Any) -> Core:
        cores.append(Core(*args))
        team = cores[-1].decision_engine.planners["hawk"]._team  # type: ignore[attr-defined]
        team.rule = Noted()
        return cores[-1]

    announced = Announced()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sim, "SimulatedVehicle", Mortal)
        patch.setattr(sim, "Core", core)
        record, fire = sim.simulate(load_scenario("team", SHORT), path, "2026-01-01", announced)
    return Run(path, record, fire, cores, announced.lines)


def test_all_four_fly_their_missions(run: Run) -> None:
    for name, vehicle in run.record.vehicles.items():
        assert vehicle.decisions > (20 if name == "swift" else 200), name
        assert vehicle.uploads["accepted"] > 3, name


def test_no_two_come_nearer_than_the_separation(run: Run) -> None:
    assert run.record.closest is not None
    summary = summary_of(load_scenario("team", SHORT), run.record, run.fire)
    assert summary["closest_pair_m"] >= summary["separation_m"] == 30.0
    assert summary["closest_pair_m"] < 500.0  # they did meet


def test_the_first_lap_is_shared(run: Run) -> None:
    hawk = run.cores[0].decision_engine.planners["hawk"]
    began = next(at_s for at_s, _ in hawk._team.rule.members)  # type: ignore[attr-defined]
    assert began < 4500.0


def test_the_loss_of_one_is_announced_and_the_others_fly_without_it_from_their_next_decision_on(
    run: Run,
) -> None:
    assert any(line.startswith("swift: no heartbeat") for line in run.announcements)
    shown = run.cores[0].decision_engine.planners["hawk"]._team.rule.members  # type: ignore[attr-defined]
    before = [members for at_s, members in shown if DIES_S - 30.0 < at_s < DIES_S]
    after = [members for at_s, members in shown if at_s > DIES_S + 4.5]
    assert (0, 1, 2, 3) in before
    assert set(after) == {(0, 1, 3)}


def test_the_others_close_the_gap(run: Run) -> None:
    """After the failure, the other vehicles observe the front of the failed one."""
    visited_at_s = run.member._team.map.outer_at_s
    assert np.min(visited_at_s) > DIES_S
    assert ENDS_S - np.min(visited_at_s) < 500.0


@pytest.mark.long
def test_a_replay_reproduces_every_command_of_a_team(run: Run) -> None:
    result = verify(run.journal)
    assert result.difference is None
    assert result.decisions == sum(each.decisions for each in run.record.vehicles.values())


def test_planners_alone_decide_the_same_and_another_rule_decides_otherwise(run: Run) -> None:
    alone = decide(run.journal)
    assert alone.difference is None
    assert len(alone.found) == len(alone.recorded) > 500
    other = decide(run.journal, "team.circling")
    assert {each.direction for _, each in other.found[-100:]} == {"clockwise"}
    assert other.difference is None
    assert {each.direction for _, each in alone.found} == {"clockwise", "anticlockwise"}
