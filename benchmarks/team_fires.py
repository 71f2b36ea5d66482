"""Fly team.balanced on random fires: ``python -m benchmarks.team_fires [FIRST] [COUNT]``.

For each fire of ``tests.service.random_fires`` (default: 6 from 20), team of 2 to 8 and speed the
mean cost is divided by that of circling, and by that of the best of circling, bumper and Bent's
eight combinations. At 1.5 m/s a flight takes three hours, at 5 m/s two, and at higher speeds one.
``--speeds`` and ``--sizes`` select some of the flights.
"""

import argparse
import multiprocessing
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import click
import numpy as np

from benchmarks.team_arcs import BASELINES, SIZES, SPEEDS_M_S
from mission_service.experiments.bent.ring_flight import fly_team
from mission_service.experiments.bent.ring_history import RingStep, ring_history
from mission_service.guidance.team.balanced import Balanced, Importance
from mission_service.guidance.team.bent_rules import IMPORTANCES, bent_rule
from tests.service.random_fires import random_fire

BALANCED = ("balanced", None)


class FireFlight(NamedTuple):
    """A flight on the ring of a fire by one rule."""

    history: Sequence[RingStep]
    rule: tuple[str, str | None]
    importance: Importance
    uavs: int
    speed_m_s: float


def part_flown(history: Sequence[RingStep], speed_m_s: float) -> Sequence[RingStep]:
    """Return the steps of a flight: the middle hour, two hours, or all of the fire."""
    share = 1.0 if speed_m_s < 5.0 else 2.0 / 3.0 if speed_m_s < 10.0 else 1.0 / 3.0
    begin = round(len(history) * (1.0 - share) / 2.0)
    return history[begin : len(history) - begin]


def mean_cost(flight: FireFlight) -> float:
    """Return the mean cost of a flight."""
    history, rule, importance, uavs, speed_m_s = flight
    flown_by = Balanced(importance) if rule == BALANCED else bent_rule(*rule, importance)
    return fly_team(history, flown_by, uavs, speed_m_s).mean_std(importance)[0]


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly all cases and print the ratios, and their means and maxima for each speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int, nargs="?", default=20)
    parser.add_argument("count", type=int, nargs="?", default=6)
    parser.add_argument("--speeds", type=float, nargs="+", default=SPEEDS_M_S, help="in m/s")
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SIZES))
    parser.add_argument("--importance", choices=IMPORTANCES, default="linear")
    given = parser.parse_args(arguments)
    rules = [BALANCED, *BASELINES]
    ratios: dict[float, list[float]] = {speed_m_s: [] for speed_m_s in given.speeds}
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        for seed in range(given.first, given.first + given.count):
            history = ring_history(random_fire(seed))
            for speed_m_s, uavs in product(given.speeds, given.sizes):
                part = part_flown(history, speed_m_s)
                flights = [
                    FireFlight(part, rule, given.importance, uavs, speed_m_s) for rule in rules
                ]
                costs = dict(zip(rules, pool.map(mean_cost, flights, chunksize=1), strict=True))
                best = min(BASELINES, key=costs.__getitem__)
                ratios[speed_m_s].append(costs[BALANCED] / costs[best])
                click.echo(
                    f"fire {seed}  {speed_m_s:4g} m/s  {uavs} UAVs  "
                    f"/circling {costs[BALANCED] / costs['circling', None]:.3f}  "
                    f"/best {ratios[speed_m_s][-1]:.3f} ({' / '.join(filter(None, best))})"
                )
    for speed_m_s, found in ratios.items():
        over = sum(ratio > 1.02 for ratio in found)
        click.echo(
            f"{speed_m_s:g} m/s: to the best rule mean {np.mean(found):.3f}, "
            f"worst {max(found):.3f}; {over} of {len(found)} above 1.02"
        )


if __name__ == "__main__":
    main()
