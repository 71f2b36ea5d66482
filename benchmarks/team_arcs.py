"""Fly team.balanced on rings with a fast arc: ``python -m benchmarks.team_arcs [FIRST] [COUNT]``.

For each seed (default: 3 from 0), each team of 2 to 8 and each speed a ring is drawn: 150 to 300
cells of 30 m, and an arc of 2 to 15 % of them that spreads 5 to 100 times as fast as the rest. Each
line shows the mean cost (linear importance) divided by that of circling and by that of the best of
circling, bumper and Bent's eight combinations, and the cost of the second half divided by that of
the best pattern. This pattern is found off line, by the visits of every arc near the fast one, for
each number of vehicles that sweep it and up to four returns in each lap. ``--turn SECONDS`` sets
the duration of a turn back (default: 0, as in Bent's thesis). ``--speeds 10 20`` flies only some of
the speeds 1.5, 5, 10, 20 and 40 m/s.
"""

import argparse
import multiprocessing
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import click
import numpy as np
from numpy.typing import NDArray

from mission_service.experiments.bent.ring_flight import fly_team
from mission_service.experiments.bent.ring_history import RingStep
from mission_service.guidance.team.balanced import Balanced
from mission_service.guidance.team.bent_rules import BENCHMARKS, NEGOTIATIONS, PLANNERS, bent_rule
from mission_service.guidance.team.front_ring import TeamRule

Floats = NDArray[np.float64]

SIZES = range(2, 9)
SPEEDS_M_S = (1.5, 5.0, 10.0, 20.0, 40.0)
CELL_M, EVERY_S, LAPS = 30.0, 18.7, 10
COOL_M_S = 0.02
FINE = 1000  # parts of a cell in which places on the circle are given
RETURNS = range(1, 5)
SEARCHED_LAPS = 20
# All rules to compare with, as planner and negotiation.
BASELINES: tuple[tuple[str, str | None], ...] = (
    *((name, None) for name in BENCHMARKS),
    *product(PLANNERS, NEGOTIATIONS),
)


class ArcCase(NamedTuple):
    """A ring with a fast arc, and the team that flies on it."""

    cells: int
    first: int
    length: int  # cells in the arc
    factor: float  # rate of spread in the arc, divided by that of the rest
    uavs: int
    speed_m_s: float
    turn_s: float


class ArcResult(NamedTuple):
    """Costs of a case: mean over the flight, and over its second half (``late``)."""

    mean: float
    late: float
    circling: float
    best: float
    best_rule: str
    best_pattern: float
    pattern: str


def drawn_cases(seed: int, turn_s: float) -> list[ArcCase]:
    """Return the cases of a seed, one for each team size and speed."""
    rng = np.random.default_rng(seed)
    cases = []
    for speed_m_s, uavs in product(SPEEDS_M_S, SIZES):
        cells = int(rng.integers(150, 301))
        length = max(2, round(cells * rng.uniform(0.02, 0.15)))
        factor = float(np.exp(rng.uniform(np.log(5.0), np.log(100.0))))
        first = int(rng.integers(cells))
        cases.append(ArcCase(cells, first, length, factor, uavs, speed_m_s, turn_s))
    return cases


def hot_rates(case: ArcCase) -> Floats:
    """Return the rate of spread of each cell in m/s."""
    rates = np.full(case.cells, COOL_M_S)
    rates[(case.first + np.arange(case.length)) % case.cells] *= case.factor
    return rates


def still_ring(case: ArcCase, rates_m_s: Floats) -> list[RingStep]:
    """Return a ring that does not grow, for a flight of ``LAPS`` laps."""
    same = np.arange(case.cells)
    angle = 2.0 * np.pi * same / case.cells
    radius = FINE * case.cells / (2.0 * np.pi)
    places = np.rint(radius * np.column_stack([np.cos(angle), np.sin(angle)])).astype(np.int64)
    steps = int(LAPS * case.cells * CELL_M / case.speed_m_s / EVERY_S)
    step_m = np.full(case.cells, CELL_M)
    return [
        RingStep(EVERY_S * step, places, step_m, rates_m_s, same, same) for step in range(steps)
    ]


def pattern_cost(case: ArcCase, arc: tuple[int, int], sweeping: int, returns: int) -> float:
    """Return the mean cost of a pattern, from the times of all its visits with even spacing.

    ``arc`` contains the first and the last cell. Without ``sweeping`` vehicles, all fly back and
    forth on the arc ``returns`` times in each lap.
    """
    first, last = arc
    cell_s = CELL_M / case.speed_m_s
    rates = hot_rates(case)
    place = (np.arange(case.cells) - first) % case.cells
    arc_s = (last - first) * cell_s
    there_s = 2.0 * (arc_s + case.turn_s)
    lap_s = case.cells * cell_s + (0 if sweeping else returns) * there_s
    gap_s = lap_s / (case.uavs - sweeping)
    along_s = place * cell_s
    inside = place <= last - first
    ends_s = SEARCHED_LAPS * lap_s
    total = float(rates[~inside].sum()) * gap_s / 2.0
    for cell in np.flatnonzero(inside):
        times = [along_s[cell] + np.arange(0.0, ends_s, gap_s)]
        if sweeping:
            starts = np.arange(0.0, ends_s, there_s / sweeping)
            times += [starts + along_s[cell], starts + there_s - case.turn_s - along_s[cell]]
        else:
            for turn in range(returns):
                back_s = turn * there_s + 2.0 * arc_s + case.turn_s - along_s[cell]
                again_s = (turn + 1) * there_s + along_s[cell]
                times += [times[0] - along_s[cell] + back_s, times[0] - along_s[cell] + again_s]
        seen = np.sort(np.concatenate(times))
        seen = seen[(seen >= lap_s) & (seen <= ends_s)]
        gaps = np.diff(seen)
        total += rates[cell] * float((gaps**2).sum()) / (2.0 * (seen[-1] - seen[0]))
    return total / case.cells


def best_pattern_cost(case: ArcCase) -> tuple[float, str]:
    """Return the lowest cost of all patterns, and the pattern as text."""
    rates = hot_rates(case)
    gap_s = case.cells * CELL_M / case.speed_m_s / case.uavs
    best = float(rates.mean()) * gap_s / 2.0, "all lap"
    step = max(1, case.length // 6)
    wider = range(-4 * step, 5 * step, step)
    for before, after in product(wider, wider):
        arc = case.first - before, case.first + case.length - 1 + after
        if arc[1] <= arc[0]:
            continue
        kinds = [(sweeping, 0) for sweeping in range(1, case.uavs)]
        kinds += [(0, returns) for returns in RETURNS]
        for sweeping, returns in kinds:
            cost = pattern_cost(case, arc, sweeping, returns)
            if cost < best[0]:
                kind = f"{sweeping} sweep" if sweeping else f"{returns} returns"
                best = cost, f"{kind} on {arc[1] - arc[0] + 1} cells"
    return best


def fly(case: ArcCase) -> ArcResult:
    """Fly a case by team.balanced and by all other rules, and search the best pattern."""
    ring = still_ring(case, hot_rates(case))

    def flown(rule: TeamRule) -> Floats:
        return fly_team(
            ring, rule, case.uavs, case.speed_m_s, cell_m=CELL_M / FINE, turn_s=case.turn_s
        ).linear

    ours = flown(Balanced(turn_s=case.turn_s))
    others = {names: float(flown(bent_rule(*names, "linear")).mean()) for names in BASELINES}
    best = min(others, key=lambda names: others[names])
    lowest, pattern = best_pattern_cost(case)
    return ArcResult(
        float(ours.mean()),
        float(ours[ours.size // 2 :].mean()),
        others["circling", None],
        others[best],
        " / ".join(name for name in best if name),
        lowest,
        pattern,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly the cases of the seeds and print the costs and the limits."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("count", type=int, nargs="?", default=3)
    parser.add_argument("--speeds", type=float, nargs="+", default=SPEEDS_M_S, help="in m/s")
    parser.add_argument("--turn", type=float, default=0.0, help="duration of a turn back in s")
    given = parser.parse_args(arguments)
    cases = [
        case
        for seed in range(given.first, given.first + given.count)
        for case in drawn_cases(seed, given.turn)
        if case.speed_m_s in given.speeds
    ]
    results = []
    click.echo("  m/s UAVs cells  hot  factor /circling  /best  best rule  /pattern  best pattern")
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        for case, found in zip(cases, pool.imap(fly, cases), strict=True):
            results.append(found)
            click.echo(
                f"{case.speed_m_s:5g} {case.uavs:4d} {case.cells:5d} {case.length:4d} "
                f"{case.factor:7.1f} {found.mean / found.circling:9.3f} "
                f"{found.mean / found.best:6.3f}  {found.best_rule:9} "
                f"{found.late / found.best_pattern:9.3f}  {found.pattern}"
            )
    ratios = np.array([[one.mean / one.best, one.late / one.best_pattern] for one in results])
    speeds = np.array([case.speed_m_s for case in cases])
    for speed_m_s in given.speeds:
        _show(f"{speed_m_s:g} m/s", ratios[speeds == speed_m_s])
    _show("all", ratios)


def _show(group: str, ratios: Floats) -> None:
    to_best, to_pattern = ratios.T
    click.echo(
        f"{group}: to the best rule mean {to_best.mean():.3f}, worst {to_best.max():.3f} "
        f"(limit 1.02); to the best pattern mean {to_pattern.mean():.3f}, "
        f"worst {to_pattern.max():.3f} (limit 1.05)"
    )


if __name__ == "__main__":
    main()
