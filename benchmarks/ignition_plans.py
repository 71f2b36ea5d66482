"""Planning of ignition lines: ``python -m benchmarks.ignition_plans [TRIALS] [FIRST] [--json]``.

The first part measures the time of a plan for a unit of 20 acres with 500 ignitions (limit 100 ms).
The second part plans random burns (units, fires, winds, settings), changes them during the flight,
plans them again, and checks each plan by brute force. 10,000 burns take about 20 minutes on one
core.
"""

import json
import math
import statistics
import sys
import time
from collections import Counter
from typing import Any

import click
import numpy as np
import shapely

from benchmarks.burn_check import faults
from benchmarks.burn_trials import BASE, Trial, changed, drawn
from firemodel.ellipses.ellipse import EllipseFire, Spread
from firemodel.ellipses.line_ignitions import line_sources
from mission_service.guidance.burn.burn_unit import BurnUnit
from mission_service.guidance.burn.lines.line_planner import LinePlan, NoPlan, Situation, next_line

ACRE_M2 = 4046.8564224
LIMIT_MS = 100.0
IGNITIONS = 500
STEADY = (Spread(0.0, 0.3, 0.015, 0.015, -math.pi / 2),)
CHANGING = (*STEADY, Spread(100.0, 0.4, 0.015, 0.015, -1.4), Spread(400.0, 0.2, 0.015, 0.015, -1.7))


def twenty_acres(spreads: tuple[Spread, ...] = STEADY) -> Situation:
    """Return a square unit with a backing fire along its southern, downwind side.

    The wind is 2 m/s towards the south.
    """
    side_m = math.sqrt(20.0 * ACRE_M2)
    area = shapely.box(0.0, 0.0, side_m, side_m)
    south = np.array([[0.0, 0.0], [side_m, 0.0]])
    fire = EllipseFire(spreads, line_sources(south, 0.0, side_m / (IGNITIONS - 1)))
    return Situation(
        unit=BurnUnit(area, shapely.MultiPolygon(), None, (), BASE.edge_m),
        area=area,
        dropped_m=np.empty((0, 2)),
        fire=fire,
        lights=lambda sources: EllipseFire(spreads, sources),
        at_s=60.0,
        x_m=5.0,
        y_m=150.0,
        height_m=15.0,
        wind_m_s=2.0,
        toward_rad=-math.pi / 2,
        spheres=BASE.spheres,
        battery_s=BASE.battery_s,
        home_m=(5.0, 150.0),
    )


def time_of_plan(spreads: tuple[Spread, ...]) -> dict[str, Any]:
    """Return statistics of the planning time, without the first plan."""
    situation, taken_ms, worked_ms = twenty_acres(spreads), [], []
    for _ in range(21):
        begun, worked = time.perf_counter(), time.process_time()
        plan = next_line(situation, BASE)
        taken_ms.append(1e3 * (time.perf_counter() - begun))
        worked_ms.append(1e3 * (time.process_time() - worked))
    assert isinstance(plan, LinePlan)
    return {
        "ignitions": IGNITIONS,
        "drops": len(plan.drops),
        "median_ms": round(statistics.median(taken_ms[1:]), 1),
        "worst_ms": round(max(taken_ms[1:]), 1),
        "of the processor, median_ms": round(statistics.median(worked_ms[1:]), 1),
        "limit_ms": LIMIT_MS,
    }


def trial(seed: int) -> tuple[list[str], Counter[str], list[float]]:
    """Plan a random burn before and after a change.

    Returns the faults of the plans, counts of their outcomes, and the CPU time of each plan in ms.
    """
    random = np.random.default_rng(seed)
    taken_ms: list[float] = []
    found: list[str] = []
    counts: Counter[str] = Counter()
    burn: Trial | None = drawn(random)
    while burn is not None:
        worked = time.process_time()
        plan = next_line(burn.situation, burn.settings)
        taken_ms.append(1e3 * (time.process_time() - worked))
        again = counts["plans"] + counts["no plan"] > 0
        if isinstance(plan, NoPlan):
            counts["no plan"] += 1
            counts[f"no plan: {plan.why}"] += 1
            break
        found += faults(plan, burn.situation, burn.settings, burn.sources)
        counts["plans"] += 1
        counts["drops"] += len(plan.drops)
        counts["skipped"] += len(plan.skipped)
        low = plan.path[:, 2] < burn.settings.safe_height_m - 1e-6
        counts["over at the safe height"] += int((np.diff(low.astype(int)) == 1).any())
        counts["begun in danger"] += plan.climbs_first
        counts["after a change"] += again
        counts[f"ended by {plan.ended or 'the line'}"] += 1
        burn = None if again else changed(random, burn, plan)
    return found, counts, taken_ms


def main() -> None:
    """Run both parts and print the results."""
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    trials, first = (*numbers, 0) if len(numbers) == 1 else (*numbers, 1000, 0)[:2]
    trials = max(trials, 1)
    result: dict[str, Any] = {
        "plan": time_of_plan(STEADY),
        "plan, two changes of wind": time_of_plan(CHANGING),
    }
    begun, worked = time.perf_counter(), time.process_time()
    wrong: list[str] = []
    counts: Counter[str] = Counter()
    taken_ms: list[float] = []
    for seed in range(first, first + trials):
        found, more, some_ms = trial(seed)
        taken_ms += some_ms
        wrong += [f"seed {seed}: {fault}" for fault in found]
        counts += more
        if sys.stderr.isatty() and seed % 100 == 0:
            sys.stderr.write(f"\r{seed - first} of {trials}, {len(wrong)} faults")
    result["trials"] = {
        "trials": trials,
        "first": first,
        "faults": len(wrong),
        "seconds": round(time.perf_counter() - begun, 1),
        "of the processor": round(time.process_time() - worked, 1),
        "a plan, median_ms": round(statistics.median(taken_ms), 1),
        "99 %, ms": round(float(np.percentile(taken_ms, 99)), 1),
        "worst_ms": round(max(taken_ms), 1),
        **dict(sorted(counts.items())),
    }
    if "--json" in sys.argv[1:]:
        click.echo(json.dumps(result | {"wrong": wrong[:100]}))
        return
    for name, figures in result.items():
        click.echo(f"{name}: " + ", ".join(f"{k} {v}" for k, v in figures.items()))
    for fault in wrong[:100]:
        click.echo(fault)


if __name__ == "__main__":
    main()
