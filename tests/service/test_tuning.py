"""Tuning of the virtual forces' constants: reproducible, on cores and on a Dask cluster."""

import json
import random
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from mission_service.cli.main import main
from mission_service.errors import MissionServiceError
from mission_service.experiments.tuning import Genes, on_cores, tune
from mission_service.experiments.virtual_agents.tuning_scenarios import (
    KINDS,
    fitness,
    flown,
    scenarios,
)
from mission_service.guidance import formation
from mission_service.guidance.formation.settings import Constants
from mission_service.guidance.formation.virtual_forces_kernels import NAMES, constants_array
from mission_service.simulation import task_pool
from tests.service.dask_cluster import cluster
from tests.service.test_live import free_port

TUNED = Path(formation.__file__).parent / "tuned.json"
BY_HAND = Constants(c1=2.0, c2=15.0, c3=1.0, c4=18.0, c5=5.0, e3=1.0, t1=1.0, t2=8.0)
UNSEEN = range(1001, 1009)
SMALL = 8, 2  # population, generations


def sphere(many: Sequence[Genes]) -> list[float]:
    """A function whose best value is at 7 for all genes."""
    return [-sum((gene - 7.0) ** 2 for gene in genes) for genes in many]


def test_a_run_finds_the_best_of_something_simple() -> None:
    found = tune(sphere, seed=1, population=50, generations=120)
    assert found["fitness"] > -2.0
    assert found["history"][0]["best"] < -30.0
    best = [generation["best"] for generation in found["history"]]
    assert best == sorted(best)  # the best tenth is kept
    assert found["library"].startswith("deap ")
    assert list(found["constants"]) == list(NAMES)


def test_it_breeds_as_the_paper_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth is kept, genes come from the fittest half, and one in ten changes by less than 1."""
    asked: list[list[Genes]] = []

    def counted(many: Sequence[Genes]) -> list[float]:
        asked.append(list(many))
        return sphere(many)

    tune(counted, seed=2, population=200, generations=2)
    first, second = asked
    assert len(first) == 200
    assert len(second) == 180
    assert 0.0 < min(map(min, first)) < 0.3
    assert 19.7 < max(map(max, first)) < 20.0
    parents = sorted(first, key=lambda genes: sphere([genes])[0], reverse=True)[:100]
    of_parents = [np.array([genes[k] for genes in parents]) for k in range(8)]
    changes = np.array(
        [[np.abs(of_parents[k] - child[k]).min() for k in range(8)] for child in second]
    )
    assert changes.max() <= 1.0
    assert 0.06 < (changes > 0.0).mean() < 0.14


def test_genes_stay_between_0_and_20() -> None:
    seen: list[Genes] = []

    def outwards(many: Sequence[Genes]) -> list[float]:
        seen.extend(many)
        return [sum(genes[:4]) - sum(genes[4:]) for genes in many]

    tune(outwards, seed=3, population=20, generations=150)
    assert max(map(max, seen)) < 20.0
    assert max(max(genes) for genes in seen[-20:]) > 19.0
    assert min(map(min, seen)) > 0.0


def test_the_same_seed_is_the_same_run_and_leaves_the_random_generator_alone() -> None:
    random.seed(5)
    expected = random.Random(5).random()
    one = tune(sphere, 4, *SMALL)
    assert random.random() == expected
    assert tune(sphere, 4, *SMALL) == one
    assert tune(sphere, 5, *SMALL) != one


def test_what_cannot_be_bred_is_refused() -> None:
    with pytest.raises(MissionServiceError, match="5 generations of 3"):
        tune(sphere, seed=1, population=3, generations=5)


def test_scenarios_are_three_small_and_three_large_and_the_seeds_own() -> None:
    drawn = scenarios(11)
    assert [one.grid.rows for one in drawn] == [50, 50, 50, 100, 100, 100]
    assert [one.kind.steps for one in drawn] == [250, 250, 250, 500, 500, 500]
    for one in drawn:
        least, most = one.kind.fire_cells
        assert least <= one.maps.fire.sum() <= most + 40
        edge = np.concatenate([one.weights[[0, -1]].ravel(), one.weights[:, [0, -1]].ravel()])
        assert not edge.any()  # the whole monitored area is on the map
        rows, cols = one.grid.row_col_of(one.agents_m[0], one.agents_m[1])
        assert (one.maps.area[np.int64(rows), np.int64(cols)] == 0).all()  # they come from outside
    scenarios.cache_clear()
    again = scenarios(11)
    assert all(np.array_equal(a.maps.fire, b.maps.fire) for a, b in zip(drawn, again, strict=True))
    assert not np.array_equal(drawn[0].agents_m, scenarios(12)[0].agents_m)


def test_agents_over_fire_cost_far_more_than_they_cover() -> None:
    genes = constants_array(BY_HAND)
    into = constants_array(Constants(c1=20.0, c2=20.0, c4=0.001))  # no force keeps them outside
    covered, too_near = flown(scenarios(11)[0], into)
    assert too_near > 0.5
    assert 0.0 <= covered <= 1.0
    assert fitness(tuple(into), 11) < -4.0
    assert fitness(tuple(genes), 11) > 0.2
    away = constants_array(Constants(c2=0.001))
    assert fitness(tuple(away), 11) == 0.0


def test_any_number_of_processes_finds_the_same() -> None:
    found = []
    for workers in (1, 2):
        with on_cores(workers, seed=6) as evaluate:
            found.append(tune(evaluate, 6, *SMALL))
    assert found[0] == found[1]
    assert found[0]["fitness"] == found[0]["history"][-1]["best"]


@pytest.mark.long
def test_a_dask_cluster_finds_what_one_process_does(tmp_path: Path) -> None:
    out = tmp_path / "found.json"
    command = ["tune", "virtual-agents", "--population", "8", "--generations", "2", "--seed", "6"]
    with cluster(2) as dask:
        options = ["--scheduler", dask.address, "--out", str(out)]
        result = CliRunner().invoke(main, [*command, *options])
    assert result.exit_code == 0, result.output
    found = json.loads(out.read_text(encoding="utf-8"))
    with on_cores(1, seed=6) as evaluate:
        assert tune(evaluate, 6, *SMALL) == found


def test_a_missing_scheduler_is_reported_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task_pool, "SECONDS_TO_CONNECT", 1)
    address = f"tcp://127.0.0.1:{free_port()}"
    result = CliRunner().invoke(main, ["tune", "virtual-agents", "--scheduler", address])
    assert result.exit_code == 1
    assert f"no Dask scheduler at {address}" in result.output
    assert "Traceback" not in result.output


def test_the_shipped_constants_are_those_of_the_shipped_run() -> None:
    run = json.loads(TUNED.read_text(encoding="utf-8"))
    assert Constants(**run["constants"]) == Constants()
    assert (run["population"], run["generations"]) == (50, 200)
    assert len(run["history"]) == 200
    assert run["scenarios"]["maps"] == [[k.cells, k.steps, k.agents] for k in KINDS]


def test_the_shipped_constants_beat_those_set_by_hand_on_fires_never_seen() -> None:
    run = json.loads(TUNED.read_text(encoding="utf-8"))
    assert run["seed"] not in UNSEEN
    tuned, by_hand = tuple(constants_array(Constants())), tuple(constants_array(BY_HAND))
    gains = [fitness(tuned, seed) - fitness(by_hand, seed) for seed in UNSEEN]
    assert np.mean(gains) > 0.2
    assert min(gains) > 0.0
