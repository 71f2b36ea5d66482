"""Formations around several fires and around islands, and with lost messages.

    python -m benchmarks.formation_fires [fires | losses] [SEEDS] [UAVS] [DURATION_S]

``fires`` prints the final coverage of the virtual agents, beside the coverage of the best static
places and the final coverage with the paper's forces. The fires are two and three fires whose
distances and directions depend on the seed, and a ring of fire around an island. ``losses`` prints
collisions and coverage with 0, 50 and 90 % of the messages lost, in wind of 10 m/s. Without a
number of UAVs, fires are flown by eight and losses by sixteen.
"""

import math
import sys

import click
import numpy as np

from mission_service.experiments.virtual_agents.ideal_world import (
    Flight,
    FormationWorld,
    Rules,
    fly,
)
from mission_service.experiments.virtual_agents.scenarios import CELL_M, COLS, ROWS, burned
from mission_service.experiments.virtual_agents.static_placement import best_around
from mission_service.guidance.formation.settings import Settings

P_SPREAD = 0.01
FIRES = ("two fires", "three fires", "ring with an island")
DISTANCES_M = (1000.0, 2000.0)  # distance between two fires
RADII_M = (350.0, 500.0)  # radius of a ring
CELLS = {"two fires": 2000, "three fires": 1200, "ring with an island": 2000}  # initial size
WIND_M_S = 10.0
LOSSES = (0.0, 0.5, 0.9)
AT_END_S = 60.0

Place = tuple[int, int]


def on_circle(count: int, radius_m: float, first_rad: float) -> tuple[Place, ...]:
    """Return cells at equal distances on a circle around the middle of the map."""
    angles = first_rad + 2.0 * np.pi * np.arange(count) / count
    rows = np.rint(ROWS / 2 + radius_m / CELL_M * np.sin(angles)).astype(int)
    cols = np.rint(COLS / 2 + radius_m / CELL_M * np.cos(angles)).astype(int)
    return tuple(zip(rows.tolist(), cols.tolist(), strict=True))


def ignitions(name: str, seed: int) -> tuple[Place, ...]:
    """Return the cells where a fire of ``FIRES`` begins; a seed gives its size and direction."""
    rng = np.random.default_rng(seed)
    turn_rad = rng.uniform(0.0, 2.0 * np.pi)
    if name == "ring with an island":
        radius_m = rng.uniform(*RADII_M)
        return on_circle(math.ceil(2.0 * np.pi * radius_m / CELL_M), radius_m, turn_rad)
    count = 2 if name == "two fires" else 3
    return on_circle(count, rng.uniform(*DISTANCES_M) / (2.0 * math.sin(np.pi / count)), turn_rad)


def flown(name: str, seed: int, uavs: int, duration_s: float) -> str:
    """Return a line with the coverage of one fire by the agents, static places and forces."""
    arrival_s = burned(P_SPREAD, CELLS[name], seed, ignitions(name, seed))
    rules = Rules(duration_s=duration_s)
    ends, collisions = [], []
    for settings in (Settings(), Settings(placement="forces")):
        flight = fly(FormationWorld(arrival_s, uavs, settings, rules, seed))
        ends.append(flight.at_end("va_coverage", AT_END_S))
        collisions.append(int(flight.series["collisions"][-1]))
    world = FormationWorld(arrival_s, uavs, Settings(), rules, seed)
    static = best_around(arrival_s <= duration_s, world.grid, Settings(), uavs, starts=4, kicks=8)
    return (
        f"{name:20} seed {seed}: agents {ends[0]:6.1%}, static places {static.coverage:6.1%}, "
        f"paper's forces {ends[1]:6.1%}; collisions {collisions[0]}"
    )


def lossy(seed: int, uavs: int, loss: float, duration_s: float) -> Flight:
    """Return a flight over the fire of experiment 2_1, with wind from a direction by the seed."""
    towards_rad = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi)
    wind_m_s = (WIND_M_S * math.cos(towards_rad), WIND_M_S * math.sin(towards_rad))
    rules = Rules(loss_at=lambda at_s: loss, wind_m_s=wind_m_s, duration_s=duration_s)
    arrival_s = burned(P_SPREAD, 2600, seed)
    return fly(FormationWorld(arrival_s, uavs, Settings(), rules, seed))


def main() -> None:
    """Print the results of the chosen simulations."""
    kind = sys.argv[1] if len(sys.argv) > 1 else "fires"
    seeds = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    uavs = int(sys.argv[3]) if len(sys.argv) > 3 else 8 if kind == "fires" else 16
    duration_s = float(sys.argv[4]) if len(sys.argv) > 4 else 1200.0
    if kind == "fires":
        for name in FIRES:
            for seed in range(seeds):
                click.echo(flown(name, seed, uavs, duration_s))
        return
    for loss in LOSSES:
        total = 0
        for seed in range(seeds):
            flight = lossy(seed, uavs, loss, duration_s)
            total += int(flight.series["collisions"][-1])
            click.echo(
                f"{loss:4.0%} lost, seed {seed}: collisions "
                f"{flight.series['collisions'][-1]:.0f}, nearest {flight.closest_m:.0f} m, "
                f"final coverage {flight.at_end('va_coverage', AT_END_S):.1%}"
            )
        click.echo(f"{loss:4.0%} lost: {total} collisions in {seeds} flights")


if __name__ == "__main__":
    main()
