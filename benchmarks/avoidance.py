"""Compare collision avoidance in small simulations, and measure the time of one decision.

    python -m benchmarks.avoidance [VEHICLES] [SEEDS]

The columns are flights without avoidance, with the paper's avoidance, and with avoidance by planned
orbits. In each simulation (``tests/service/formation_worlds.py``) all vehicles fly at one altitude.
In simulations named "lost" the vehicles' states arrive half a second late, and 30 % of them are
lost. As in the paper, a conflict means that the desired velocity is inside the reciprocal velocity
obstacle of another vehicle. A collision means a distance below 60 m.
"""

import sys
import time

import click
import numpy as np

from mission_service.guidance.formation import intent_avoidance as intent
from mission_service.guidance.formation import peer_table as peers
from tests.service.formation_worlds import (
    AVOIDANCES,
    SETTINGS,
    World,
    deployment,
    fly,
    home_and_back,
    shuffle,
    swap,
)

WIND = (6.0, 5.0)
SPACING_M = 280.0


def worlds(count: int, seed: int) -> dict[str, tuple[World, float]]:
    """Return each simulation and its duration in seconds, by name."""
    long_s = 300.0 + 8.0 * count

    def deployed(gap_m: float, drift_m_s: float = 0.5, **more: object) -> tuple[World, float]:
        return deployment(count, SPACING_M, gap_m, seed, drift_m_s=drift_m_s, **more), long_s

    swapped = {"seed": seed}
    return {
        "deploy": deployed(120.0),
        "deploy, wind": deployed(120.0, wind_m_s=WIND),
        "deploy, lost": deployed(130.0, delay_s=0.5, lost=0.3),
        "deploy, lost, wind, jumps": deployed(
            130.0, 1.0, delay_s=0.5, lost=0.3, wind_m_s=WIND, jumps_s=150.0
        ),
        "swap": (swap(count, SPACING_M, **swapped), 500.0),
        "swap, lost, wind": (
            swap(count, SPACING_M, delay_s=0.5, lost=0.3, wind_m_s=WIND, **swapped),
            500.0,
        ),
        "shuffle": (shuffle(count, SPACING_M, seed), 760.0),
        "shuffle, lost": (shuffle(count, SPACING_M, seed, delay_s=0.5, lost=0.3), 760.0),
        "home and back": (home_and_back(count, SPACING_M, seed), 660.0),
        "home and back, lost, wind": (
            home_and_back(count, SPACING_M, seed, delay_s=0.5, lost=0.3, wind_m_s=WIND),
            760.0,
        ),
    }


def decision_us(count: int, desired: intent.IntendedOrbit) -> float:
    """Return the time of one decision in us: the smallest mean of six batches of 200.

    The other ``count`` vehicles fly orbits in phase on a square grid with a spacing of 300 m.
    """
    grid = [(east, north) for east in range(-5, 6) for north in range(-5, 6)]
    places = 300.0 * np.array(sorted(grid, key=lambda place: np.hypot(*place))[1 : count + 1])
    rows = np.zeros((count, peers.COLUMNS))
    rows[:, peers.X], rows[:, peers.Y] = places[:, 0] + 150.0, places[:, 1]
    rows[:, peers.ORBIT_X], rows[:, peers.ORBIT_Y] = places.T
    rows[:, peers.VY], rows[:, peers.AIRSPEED], rows[:, peers.RADIUS] = 17.5, 17.5, -150.0
    rows[:, peers.AGE_S], rows[:, peers.KEY] = 0.25, np.arange(count)
    own = intent.OwnMotion(1 << 31, 150.0, 0.0, 0.0, 0.0, np.pi / 2.0, 17.5)
    rules = intent.avoidance_rules(SETTINGS)
    held = intent.AdoptedOrbit(intent.IntendedOrbit(0.0, 0.0, -150.0, 17.5))
    best = np.inf
    for _ in range(6):
        begun_s = time.process_time()
        for turn in range(200):
            intent.choose_orbit(1.9 + 8.0 * turn, own, desired, held, rows, rules)
        best = min(best, (time.process_time() - begun_s) / 200.0)
    return 1e6 * best


def main() -> None:
    """Fly all simulations with each kind of avoidance and print the results."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    seeds = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    sums = {avoidance: [0, 0, np.inf] for avoidance in AVOIDANCES}
    head = f"{'':28}" + "".join(f"{name:>34}" for name in AVOIDANCES)
    click.echo(head + "\n" + f"{'':28}" + 3 * "  conflicts collisions near settled")
    for seed in range(1, seeds + 1):
        for name, (world, until_s) in worlds(count, seed).items():
            line = f"{f'{name} ({seed})':28}"
            for avoidance, total in sums.items():
                out = fly(world, avoidance, until_s)
                settled = np.isfinite(out.settled_s)
                mean_s = out.settled_s[settled].mean() - world.places[-1][0]
                line += f"{out.conflicts:11}{out.collisions:11}{out.nearest_m:5.0f}"
                line += f"{settled.sum():3}{mean_s:4.0f}"
                total[0] += out.conflicts
                total[1] += out.collisions
                total[2] = min(total[2], out.nearest_m)
            click.echo(line)
    for avoidance, (conflicts, collisions, nearest_m) in sums.items():
        share = f"({100.0 * collisions / conflicts:.1f} %), nearest {nearest_m:.1f} m"
        click.echo(f"{avoidance}: {conflicts} conflicts, {collisions} collisions {share}")
    for peer_count in (8, 64):
        free_us = decision_us(peer_count, intent.IntendedOrbit(0.0, 0.0, -150.0, 17.5))
        blocked_us = decision_us(peer_count, intent.IntendedOrbit(250.0, 50.0, -150.0, 17.5))
        click.echo(
            f"a decision with {peer_count} other vehicles: {free_us:.0f} us, with the desired "
            f"orbit blocked {blocked_us:.0f} us"
        )


if __name__ == "__main__":
    main()
