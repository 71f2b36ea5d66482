"""``mission-service experiment bent``: its cases, tables, figures and JSON."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from mission_service.cli.main import main
from mission_service.experiments.bent import run as bent
from mission_service.experiments.bent.scenarios import Case, later_cases, thesis_cases, uneven
from mission_service.experiments.bent.tables import THESIS_BEST, averages, best, name_of
from mission_service.guidance.team.bent_rules import BENCHMARKS
from tests.service.test_ring_flight import still


def test_the_cases_are_those_of_the_thesis() -> None:
    cases = thesis_cases()
    assert len(cases) == len(set(cases)) == 100
    benchmarks = [case for case in cases if case.planner in BENCHMARKS]
    assert len(benchmarks) == 20
    assert {case.negotiation for case in benchmarks} == {None}
    assert {case.uavs for case in cases} == {2, 3, 4, 5, 6}
    later = later_cases()
    assert not set(later) & set(cases)
    # The planner that keeps its path with each of three negotiations, the other four with the new
    # one.
    assert len(later) == len(set(later)) == (3 + 4) * 2 * 5


def test_averages_are_over_numbers_of_vehicles() -> None:
    runs: list[dict[str, Any]] = [
        {
            "planner": "predictive",
            "negotiation": "centre",
            "importance": "linear",
            "uavs": uavs,
            "mean_cost": 10.0 * uavs,
            "std_cost": 1.0,
        }
        for uavs in (2, 3)
    ]
    runs.append({**runs[0], "planner": "bumper", "negotiation": None, "std_cost": 0.5})
    runs.append({**runs[0], "importance": "exponential", "mean_cost": 0.0})
    costs = averages(runs, "linear")
    assert costs == {"Predictive - COI": (25.0, 1.0), "Bumper": (20.0, 0.5)}
    assert best(costs, 0) == best(costs, 1) == "Bumper"
    assert averages(runs, "linear", [3]) == {"Predictive - COI": (30.0, 1.0)}


def test_every_name_of_the_thesis_is_one_of_ours() -> None:
    ours = {name_of(case.planner, case.negotiation) for case in thesis_cases()}
    assert {name for table in THESIS_BEST.values() for row in table for name in row} <= ours
    assert len(ours) == 10


@pytest.mark.parametrize("as_json", [True, False])
def test_command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, as_json: bool) -> None:
    """The whole command on a ring that does not change, in this process."""
    burn = replace(uneven(), end_s=3600.0 + 200.0)
    monkeypatch.setattr(bent, "uneven", lambda: burn)
    monkeypatch.setattr(bent, "ring_history", lambda burn, spread: still(40, 6, rate=0.1))
    monkeypatch.setattr(
        bent,
        "fly_cases",
        lambda cases, history, speed, _: [bent.fly_case(case, history, speed) for case in cases],
    )
    options = ["--json"] if as_json else ["--out", str(tmp_path)]
    result = CliRunner().invoke(main, ["experiment", "bent", "--speed", "10", *options])
    assert result.exit_code == 0, result.output
    if not as_json:
        for text in ("Table 5.1", "Table 5.4", "High Target Static - COI", "3037.289", " ± "):
            assert text in result.output
        drawn = sorted(path.name for path in tmp_path.iterdir())
        assert drawn == ["bent_5_1.png", "bent_5_2.png", "bent_5_3.png"]
        return
    found = json.loads(result.output)
    assert found["speed_m_s"] == 10.0
    assert len(found["runs"]) == 100
    assert set(found["runs"][0]) >= {"planner", "negotiation", "importance", "uavs"}
    circling = [
        run
        for run in found["runs"]
        if run["planner"] == "circling" and run["importance"] == "linear"
    ]
    means = [run["mean_cost"] for run in circling]
    assert means == sorted(means, reverse=True)
    assert all(np.isfinite(run["std_cost"]) for run in found["runs"])
    assert all(run["min_separation_m"] >= 30.0 for run in [*found["runs"], *found["later"]])


def test_processes_fly_what_this_one_flies() -> None:
    cases = [Case("predictive", "centre", "linear", 3), Case("bumper", None, "linear", 2)]
    history = still(80, 20, rate=0.1)
    apart = bent.fly_cases(cases, history, 10.0)
    fix = [bent.fly_case(case, history, 10.0) for case in cases]
    assert [run.case for run in apart] == cases
    assert [run.cost.tolist() for run in apart] == [run.cost.tolist() for run in fix]
