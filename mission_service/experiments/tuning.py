"""Tune the constants of the virtual forces with a genetic algorithm (section 5.2.6), using DEAP.

DEAP is used because it is one small package, while pymoo depends on autograd, cma and others. DEAP
uses Python's global random generator, which is seeded before the search and restored afterwards.
Only breeding draws random numbers. Evaluations draw no random numbers, and their results are in a
fixed order. A run is therefore bitwise reproducible with any number of processes, and on all
machines of the same kind.
"""

import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any

import numpy as np

from mission_service.errors import MissionServiceError
from mission_service.experiments.virtual_agents.tuning_scenarios import (
    CELL_M,
    KINDS,
    PENALTY,
    STEP_S,
    fitness,
)
from mission_service.guidance.formation.virtual_forces_kernels import NAMES
from mission_service.simulation.task_pool import dask_client

Genes = tuple[float, ...]
Evaluate = Callable[[Sequence[Genes]], list[float]]

MIN_GENE, MAX_GENE = 0.0, 20.0  # bounds of genes, both exclusive
CLOSE = 1e-3  # minimum distance of a gene from its bounds
ELITE, FITTEST = 0.1, 0.5  # fractions of the population
MUTATION, CHANGE = 0.1, 1.0  # probability per gene, and maximum change
POPULATION, GENERATIONS = 50, 200
CHUNKS_PER_WORKER = 4
HOW_TO_INSTALL = "pip install 'mission-service[tune]'"


def tune(
    evaluate: Evaluate,
    seed: int,
    population: int = POPULATION,
    generations: int = GENERATIONS,
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Return the best constants, rounded to 3 digits, and the settings of the search.

    ``history`` has the best and the mean fitness of each generation. Raises MissionServiceError if
    DEAP is not installed, or if the population is too small for breeding.
    """
    base, tools = _deap()
    if population < 4 or generations < 1:
        raise MissionServiceError(
            f"tune: {generations} generations of {population} sets of constants; "
            "specify at least 1 generation of 4 sets"
        )

    rated = type("Fitness", (base.Fitness,), {"weights": (1.0,)})

    class Individual(list[float]):
        def __init__(self, genes: Sequence[float]) -> None:
            super().__init__(genes)
            self.fitness = rated()

    def bred(parents: list[Individual]) -> list[Individual]:
        pair = [Individual(genes) for genes in random.sample(parents, 2)]
        tools.cxUniform(*pair, 0.5)
        for child in pair:
            _mutate(child)
        return pair

    history: list[dict[str, float]] = []
    elite, fittest = max(round(ELITE * population), 1), max(round(FITTEST * population), 2)
    with _seeded(seed):
        alive = [
            Individual([random.uniform(MIN_GENE + CLOSE, MAX_GENE - CLOSE) for _ in NAMES])
            for _ in range(population)
        ]
        for generation in range(1, generations + 1):
            fresh = [one for one in alive if not one.fitness.valid]
            for one, found in zip(fresh, evaluate([tuple(o) for o in fresh]), strict=True):
                one.fitness.values = (found,)
            ranked: list[Individual] = tools.selBest(alive, population)
            best = ranked[0].fitness.values[0]
            mean = float(np.mean([one.fitness.values[0] for one in ranked]))
            history.append({"best": best, "mean": mean})
            progress(f"generation {generation} of {generations}: {best:.4f} (mean {mean:.4f})")
            alive = ranked[:elite]
            while generation < generations and len(alive) < population:
                alive += bred(ranked[:fittest])
            del alive[population:]
    return {
        "constants": dict(zip(NAMES, (float(f"{gene:.3g}") for gene in ranked[0]), strict=True)),
        "fitness": ranked[0].fitness.values[0],
        "seed": seed,
        "population": population,
        "generations": generations,
        "library": f"deap {version('deap')}",
        "scenarios": {
            "cell_m": CELL_M,
            "step_s": STEP_S,
            "penalty": PENALTY,
            "maps": [[kind.cells, kind.steps, kind.agents] for kind in KINDS],
        },
        "history": history,
    }


def _deap() -> tuple[Any, Any]:
    try:
        from deap import base, tools
    except ImportError:
        raise MissionServiceError(f"tune: DEAP is not installed; {HOW_TO_INSTALL}") from None
    return base, tools


def _mutate(genes: list[float]) -> None:
    for i in range(len(genes)):
        if random.random() < MUTATION:
            changed = genes[i] + random.uniform(-CHANGE, CHANGE)
            genes[i] = min(max(changed, MIN_GENE + CLOSE), MAX_GENE - CLOSE)


@contextmanager
def _seeded(seed: int) -> Iterator[None]:
    before = random.getstate()
    random.seed(seed)
    try:
        yield
    finally:
        random.setstate(before)


def fitnesses(many: Sequence[Genes], seed: int) -> list[float]:
    """Return the fitness of each chromosome on the scenarios of a seed (a worker's task)."""
    return [fitness(genes, seed) for genes in many]


def _chunks(many: Sequence[Genes], workers: int) -> list[Sequence[Genes]]:
    size = max(-(-len(many) // (CHUNKS_PER_WORKER * max(workers, 1))), 1)
    return [many[first : first + size] for first in range(0, len(many), size)]


@contextmanager
def on_cores(workers: int, seed: int) -> Iterator[Evaluate]:
    """Yield a function that evaluates in ``workers`` processes; 1 means in this process."""
    if workers <= 1:
        yield lambda many: fitnesses(many, seed)
        return
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:

        def evaluate(many: Sequence[Genes]) -> list[float]:
            chunks = _chunks(many, workers)
            return [
                one for some in pool.map(fitnesses, chunks, [seed] * len(chunks)) for one in some
            ]

        yield evaluate


@contextmanager
def on_cluster(scheduler: str, seed: int) -> Iterator[Evaluate]:
    """Yield a function that evaluates on the workers of a Dask scheduler (tcp://HOST:8786).

    ``task_pool.on_cluster`` describes the requirements on the workers, and the errors.
    """
    with dask_client(scheduler, "tune") as client:

        def evaluate(many: Sequence[Genes]) -> list[float]:
            chunks = _chunks(many, len(client.nthreads()))
            futures = client.map(fitnesses, chunks, seed=seed, pure=False)
            return [one for some in client.gather(futures) for one in some]

        yield evaluate
