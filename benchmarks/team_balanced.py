"""Compare team.balanced with Bent's rules: ``python -m benchmarks.team_balanced [--json] [FIRE]``.

The cases are three fires, two to six vehicles and both importances, and the loss of one of four
vehicles after half of the time. FIRE selects one or more fires by name.
"""

import json
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from typing import Any, NamedTuple

import click

from firemodel.physics.weather import WeatherStream
from mission_service.experiments.bent.ring_flight import TeamFlight, fly_team
from mission_service.experiments.bent.ring_history import RingStep, ring_history
from mission_service.experiments.bent.scenarios import SPEED_M_S, uneven
from mission_service.experiments.fires import (
    HOUR_S,
    SHORT_GRASS,
    TALL_GRASS,
    Burn,
    burn,
    flat,
    of_one_fuel,
    wind,
)
from mission_service.guidance.team.balanced import Balanced
from mission_service.guidance.team.bent_rules import (
    BENCHMARKS,
    IMPORTANCES,
    NEGOTIATIONS,
    PLANNERS,
    bent_rule,
)

SIZES = (2, 3, 4, 5, 6)
LOST_MEMBER = 1


class Case(NamedTuple):
    """Conditions of one flight."""

    rule: str
    negotiation: str | None
    importance: str
    uavs: int
    lost_at_s: float | None = None


class Flown(NamedTuple):
    """Results of one flight; ``late_mean`` is the mean over the second half."""

    case: Case
    mean: float
    std: float
    late_mean: float
    separation_m: float
    us_a_decision: float


_history: Sequence[RingStep] = ()


def even() -> Burn:
    """Return a fire in tall grass in light wind, deployed when it is large enough for six UAVs."""
    weather = WeatherStream((wind(0.0, 0.5, 0.0),))
    land = flat(of_one_fuel(TALL_GRASS))
    return burn(
        "even", "anyangle", land, weather, (100, 100), 6.0 * HOUR_S, SPEED_M_S, 2.0 * HOUR_S
    )


def wind_turning() -> Burn:
    """Return a fire in short grass; the wind turns from north to south after three hours."""
    weather = WeatherStream((wind(0.0, 3.0, 0.0), wind(3.0 * HOUR_S, 3.0, 180.0)))
    land = flat(of_one_fuel(SHORT_GRASS))
    return burn("wind turning", "anyangle", land, weather, (85, 100), 5.0 * HOUR_S, SPEED_M_S)


def team_fires() -> list[Burn]:
    """Return the three fires."""
    return [uneven(), even(), wind_turning()]


def _share(history: Sequence[RingStep]) -> None:
    global _history
    _history = history


def fly(case: Case) -> Flown:
    """Fly a case on the history of a fire that all processes share."""
    if case.rule == "balanced":
        rule: Any = Balanced("exponential" if case.importance == "exponential" else "linear")
    else:
        rule = bent_rule(case.rule, case.negotiation, case.importance)
    leaving = () if case.lost_at_s is None else ((case.lost_at_s, LOST_MEMBER),)
    began = time.process_time()
    flight: TeamFlight = fly_team(_history, rule, case.uavs, SPEED_M_S, leaving=leaving)
    took_s = time.process_time() - began
    cost = flight.exponential if case.importance == "exponential" else flight.linear
    late = cost[cost.size // 2 :]
    return Flown(
        case,
        float(cost.mean()),
        float(cost.std()),
        float(late.mean()),
        flight.min_separation_m,
        1e6 * took_s / flight.decisions,
    )


def cases(half_s: float) -> Iterator[Case]:
    """Yield the cases of one fire; one UAV of four is lost at ``half_s``."""
    for importance, uavs in product(IMPORTANCES, SIZES):
        yield Case("balanced", None, importance, uavs)
        for name in BENCHMARKS:
            yield Case(name, None, importance, uavs)
        for name, negotiation in product(PLANNERS, NEGOTIATIONS):
            yield Case(name, negotiation, importance, uavs)
    for importance in IMPORTANCES:
        yield Case("balanced", None, importance, 4, half_s)


def name_of(case: Case) -> str:
    """Return the name of the rule, with its negotiation."""
    return case.rule + (f" / {case.negotiation}" if case.negotiation else "")


def compare(fire: str, flown: Sequence[Flown]) -> dict[str, Any]:
    """Compare team.balanced with the best other rule, by number of UAVs and importance."""
    rows: list[dict[str, Any]] = []
    whole = [one for one in flown if one.case.lost_at_s is None]
    for importance, uavs in product(IMPORTANCES, SIZES):
        pair = [one for one in whole if one.case[2:4] == (importance, uavs)]
        ours = next(one for one in pair if one.case.rule == "balanced")
        others = [one for one in pair if one is not ours]
        by_mean = min(others, key=lambda one: one.mean)
        by_std = min(others, key=lambda one: one.std)
        rows.append(
            {
                "importance": importance,
                "uavs": uavs,
                "mean": ours.mean,
                "mean_ratio": ours.mean / by_mean.mean,
                "best_mean": name_of(by_mean.case),
                "std": ours.std,
                "std_ratio": ours.std / by_std.std,
                "best_std": name_of(by_std.case),
                "separation_m": ours.separation_m,
                "us_a_decision": ours.us_a_decision,
            }
        )
    losses = {}
    for lost in (one for one in flown if one.case.lost_at_s is not None):
        three = next(o for o in whole if o.case == Case("balanced", None, lost.case.importance, 3))
        losses[lost.case.importance] = {
            "mean_ratio": lost.mean / three.mean,
            "late_ratio": lost.late_mean / three.late_mean,
        }
    return {
        "fire": fire,
        "pairs": rows,
        "means_won": sum(row["mean_ratio"] < 1.0 for row in rows),
        "stds_won": sum(row["std_ratio"] < 1.0 for row in rows),
        "worst_std_ratio": max(row["std_ratio"] for row in rows),
        "loss_of_one_of_four_over_three": losses,
    }


def in_text(found: dict[str, Any]) -> str:
    """Return the comparison of one fire as a table."""
    lines = [
        f"## {found['fire']}",
        "| importance | UAVs | mean | / best other | which | std / best other | which | µs |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row['importance']} | {row['uavs']} | {row['mean']:.3f} | {row['mean_ratio']:.4f} "
        f"| {row['best_mean']} | {row['std_ratio']:.4f} | {row['best_std']} "
        f"| {row['us_a_decision']:.0f} |"
        for row in found["pairs"]
    ]
    lines.append(
        f"means won {found['means_won']}/10, standard deviations won {found['stds_won']}/10 "
        f"(worst {found['worst_std_ratio']:.3f}); nearest pair "
        f"{min(row['separation_m'] for row in found['pairs']):.1f} m"
    )
    for importance, loss in found["loss_of_one_of_four_over_three"].items():
        lines.append(
            f"loss of one UAV of four, {importance}: {loss['mean_ratio']:.4f} of the cost of three "
            f"UAVs, {loss['late_ratio']:.4f} after the loss"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Fly all cases of the selected fires and print the comparisons."""
    selected = [name for name in sys.argv[1:] if not name.startswith("--")]
    found = []
    for fire in team_fires():
        if selected and fire.name not in selected:
            continue
        history = ring_history(fire)
        half_s = (fire.deploy_s + fire.end_s) / 2.0
        with ProcessPoolExecutor(2, initializer=_share, initargs=(history,)) as pool:
            found.append(compare(fire.name, list(pool.map(fly, cases(half_s)))))
        if "--json" not in sys.argv[1:]:
            click.echo(in_text(found[-1]))
    if "--json" in sys.argv[1:]:
        click.echo(json.dumps(found))


if __name__ == "__main__":
    main()
