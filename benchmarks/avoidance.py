"""Avoidance in small worlds: none, the paper's and by intentions; what a thought costs.

    python -m benchmarks.avoidance [VEHICLES] [SEEDS]

Worlds (``tests/service/formation_worlds.py``) have all vehicles at one altitude; "lost" is half a
second of delay and 30 % of states lost. A conflict is the paper's: a desired velocity inside the
other's reciprocal velocity obstacle; a collision a distance below 60 m.
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


def say(line: str) -> None:
    click.echo(line)


def worlds(count: int, seed: int) -> dict[str, tuple[World, float]]:
    """By name, and how many seconds to fly."""
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


def thought_us(count: int, wanted: intent.IntendedOrbit) -> float:
    """Least mean time of a thought on an orbit in a square of others in phase, 300 m apart."""
    grid = [(east, north) for east in range(-5, 6) for north in range(-5, 6)]
    places = 300.0 * np.array(sorted(grid, key=lambda place: np.hypot(*place))[1 : count + 1])
    rows = np.zeros((count, peers.COLUMNS))
    rows[:, peers.X], rows[:, peers.Y] = places[:, 0] + 150.0, places[:, 1]
    rows[:, peers.ORBIT_X], rows[:, peers.ORBIT_Y] = places.T
    rows[:, peers.VY], rows[:, peers.AIRSPEED], rows[:, peers.RADIUS] = 17.5, 17.5, -150.0
    rows[:, peers.AGE_S], rows[:, peers.KEY] = 0.25, np.arange(count)
    own = intent.OwnMotion(1 << 31, 150.0, 0.0, 0.0, np.pi / 2.0, 17.5)
    rules = intent.avoidance_rules(SETTINGS)
    held = intent.AdoptedOrbit(intent.IntendedOrbit(0.0, 0.0, -150.0, 17.5))
    best = np.inf
    for _ in range(6):
        begun_s = time.process_time()
        for turn in range(200):
            intent.choose_orbit(1.9 + 8.0 * turn, own, wanted, held, rows, rules)
        best = min(best, (time.process_time() - begun_s) / 200.0)
    return 1e6 * best


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    seeds = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    sums = {avoidance: [0, 0, np.inf] for avoidance in AVOIDANCES}
    head = f"{'':28}" + "".join(f"{name:>34}" for name in AVOIDANCES)
    say(head + "\n" + f"{'':28}" + 3 * "  conflicts collisions near settled")
    for seed in range(1, seeds + 1):
        for name, (world, until_s) in worlds(count, seed).items():
            line = f"{f'{name} ({seed})':28}"
            for avoidance, total in sums.items():
                out = fly(world, avoidance, until_s)
                there = np.isfinite(out.settled_s)
                mean_s = out.settled_s[there].mean() - world.places[-1][0]
                line += f"{out.conflicts:11}{out.collisions:11}{out.nearest_m:5.0f}"
                line += f"{there.sum():3}{mean_s:4.0f}"
                total[0] += out.conflicts
                total[1] += out.collisions
                total[2] = min(total[2], out.nearest_m)
            say(line)
    for avoidance, (conflicts, collisions, nearest_m) in sums.items():
        share = f"({100.0 * collisions / conflicts:.1f} %), nearest {nearest_m:.1f} m"
        say(f"{avoidance}: {conflicts} conflicts, {collisions} collisions {share}")
    for known in (8, 64):
        calm = thought_us(known, intent.IntendedOrbit(0.0, 0.0, -150.0, 17.5))
        blocked = thought_us(known, intent.IntendedOrbit(250.0, 50.0, -150.0, 17.5))
        say(f"a thought with {known} known: {calm:.0f} us, with its way blocked {blocked:.0f} us")


if __name__ == "__main__":
    main()
