"""Run the experiments of the "Virtual agents" paper (section 6, table 2) with three seeds."""

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from mission_service.experiments.virtual_agents.ideal_world import (
    Flight,
    FormationWorld,
    Rules,
    fly,
)
from mission_service.experiments.virtual_agents.scenarios import EXPERIMENTS, Experiment, burned
from mission_service.experiments.virtual_agents.static_placement import best_around
from mission_service.guidance.formation.settings import Settings

SEEDS = (1, 2, 3)
PROCESSES = 2
AT_END_S = 60.0
COMPLETE = 0.998


def run(
    out: Path | None, seeds: tuple[int, ...] = SEEDS, progress: Callable[[str], None] = print
) -> dict[str, Any]:
    """Fly all experiments and return the result; if ``out`` is given, draw the figures there."""
    flights: dict[str, list[Flight]] = {experiment.name: [] for experiment in EXPERIMENTS}
    best: dict[str, list[float]] = {experiment.name: [] for experiment in EXPERIMENTS}
    cases = list(product(EXPERIMENTS, seeds))
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        flown = pool.map(fly_experiment, *zip(*cases, strict=True))
        for number, ((experiment, seed), result) in enumerate(zip(cases, flown, strict=True), 1):
            progress(f"{experiment.name}, seed {seed}: flown ({number} of {len(cases)})")
            flights[experiment.name].append(result[0])
            best[experiment.name].append(result[1])
    if out:
        from mission_service.experiments.virtual_agents.figures import draw

        draw(out, flights)
    return {"experiments": [_row(name, runs, best[name]) for name, runs in flights.items()]}


def fly_experiment(experiment: Experiment, seed: int) -> tuple[Flight, float]:
    """Return one flight of 20 minutes, and the best static coverage found for the final fire.

    If the flight reaches complete coverage, no better placement is searched for, and the second
    result is the flight's coverage.
    """
    rules = Rules(
        avoidance="intent" if experiment.avoids else "none", synchronises=experiment.synchronises
    )
    arrival_s = burned(experiment.p_spread, experiment.first_cells, seed)
    settings = Settings()
    world = FormationWorld(arrival_s, experiment.uavs, settings, rules, seed)
    flight = fly(world)
    reached = flight.at_end("va_coverage", AT_END_S)
    if reached >= COMPLETE:
        return flight, reached
    fire = arrival_s <= rules.duration_s
    best = best_around(fire, world.grid, settings, experiment.uavs, starts=4, kicks=12)
    return flight, best.coverage


def _row(name: str, runs: list[Flight], best: list[float]) -> dict[str, Any]:
    def at_end(key: str) -> float:
        return round(float(np.mean([run.at_end(key, AT_END_S) for run in runs])), 4)

    def in_all(key: str) -> int:
        return int(sum(run.series[key][-1] for run in runs))

    return {
        "name": name,
        "va_coverage_final": at_end("va_coverage"),
        "uav_coverage_final": at_end("uav_coverage"),
        "uav_coverage_efficiency_final": at_end("efficiency"),
        "conflicts": in_all("conflicts"),
        "collisions": in_all("collisions"),
        "inaccuracy_mean_cells": round(
            float(np.mean([run.series["inaccuracy"] for run in runs])), 2
        ),
        "va_coverage_best": round(max(float(run.series["va_coverage"].max()) for run in runs), 4),
        "va_coverage_best_static": round(float(np.mean(best)), 4),
        "closest_m": round(min(run.closest_m for run in runs), 1),
        "flights": len(runs),
    }
