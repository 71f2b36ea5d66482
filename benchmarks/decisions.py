"""Time of one decision with its map update: ``python -m benchmarks.decisions [--json]``.

Each planner follows the front of a large, slow fire (an ellipse with its ignition in the rear
focus) for one lap and then decides cell by cell. The times contain ``observe`` and ``at``. Team
rules decide for four vehicles on a ring with the same number of cells; in flight their map is a
ring of 360 bearings.
"""

import json
import statistics
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import click
import numpy as np

from firemodel.physics.weather import WeatherStream
from mission_service.experiments.boundary_following import BoundaryFollower
from mission_service.experiments.fires import CELL_M, HOUR_S, Burn, flat, wind
from mission_service.experiments.islam_hu.ideal_flight import look
from mission_service.experiments.islam_hu.predictive_flight import predictive_planner
from mission_service.experiments.islam_hu.scenarios import islam_hu_planner
from mission_service.guidance.protocol import Planner
from mission_service.guidance.team.balanced import Balanced
from mission_service.guidance.team.bent_rules import LATER_PLANNERS, bent_rule
from mission_service.guidance.team.bent_rules import PLANNERS as BENT_PLANNERS
from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing, TeamRule

SIZES = (500, 1000, 2000, 4000)  # numbers of cells of the front
DECISIONS = 400
ECCENTRICITY = 0.8
LENGTH_CELLS = 0.425  # size of the ellipse for each cell of the front
OLD_S = 100.0 * HOUR_S  # a fire of this age grows little during a lap
SPEED_M_S = 20.0
LIMIT_MS = 1.0  # limit of the median at 2,000 cells

# Factory of each measured planner, by name. Add new planners here.
PLANNERS: dict[str, Callable[[Burn], Planner]] = {
    "perimeter.damped": lambda burn: islam_hu_planner(burn, "islam_hu_damped"),
    "perimeter.literal": lambda burn: islam_hu_planner(burn, "islam_hu"),
    "perimeter.predictive": lambda burn: _with_wind(predictive_planner(burn), burn),
}
UAVS = 4
# Factory of each measured team rule, by name. Add new rules here.
TEAM_RULES: dict[str, Callable[[], TeamRule]] = {
    f"team.{name}": partial(bent_rule, name, "centre", "exponential")
    for name in (*BENT_PLANNERS, *LATER_PLANNERS)
} | {"team.balanced": partial(Balanced, "exponential")}


def _with_wind(planner: Planner, burn: Burn) -> Planner:
    now = burn.weather.weather_at(burn.deploy_s)
    planner.wind(now.wind_speed_m_s, now.wind_from_deg, burn.deploy_s)
    return planner


def ellipse(front_cells: int) -> Burn:
    """Return a fire whose front has about ``front_cells`` cells at the arrival of the vehicle."""
    length = LENGTH_CELLS * front_cells
    size = int(1.2 * length)
    ignition = (int(0.2 * length), size // 2)
    south, east = np.indices((size, size)) - np.array(ignition)[:, None, None]
    distance = np.maximum(np.hypot(south, east), 1e-9)
    head_cells_s = length * (1.0 + ECCENTRICITY) / 2.0 / OLD_S
    rate = head_cells_s * (1.0 - ECCENTRICITY) / (1.0 - ECCENTRICITY * south / distance)
    land = flat(np.ones((size, size), np.int16))
    weather = WeatherStream([wind(0.0, 5.0, 0.0)])
    return Burn(
        "ellipse", "anyangle", land, weather, ignition, OLD_S, 2 * OLD_S, SPEED_M_S, distance / rate
    )


def measure(burn: Burn, planner: Planner) -> tuple[list[float], float]:
    """Return the time of each decision in ms, and the mean number of front cells it used."""
    walk, at_s = BoundaryFollower(burn.arrival_s, burn.deploy_s), burn.deploy_s
    taken_ms: list[float] = []
    cells: list[int] = []
    while len(taken_ms) < DECISIONS:
        observed = look(burn, *walk.cell, at_s)
        began = time.perf_counter()
        planner.observe(observed)
        decision = planner.at(*walk.cell, at_s)
        ended = time.perf_counter()
        if decision is not None:
            taken_ms.append(1e3 * (ended - began))
            cells.append(decision.front_cells)
        walk.onwards(planner.clockwise, at_s)
        at_s += CELL_M / SPEED_M_S
    return taken_ms, statistics.mean(cells)


def measure_rule(rule: TeamRule, cells: int) -> list[float]:
    """Return the time of each decision in ms, on a ring with random spread rates."""
    random = np.random.default_rng(1)
    rate, age_s = random.uniform(0.01, 0.5, cells), random.uniform(0.0, 900.0, cells)
    ring = FrontRing(np.full(cells, CELL_M), rate, -age_s)
    members = np.arange(UAVS)
    fleet = ActiveFleet(
        members, members * cells // UAVS, np.ones(UAVS, bool), np.full(UAVS, SPEED_M_S)
    )
    taken_ms: list[float] = []
    for number in range(DECISIONS):
        which, at_s = number % UAVS, number / UAVS * CELL_M / SPEED_M_S
        ring.visited_at_s[fleet.cell[which]] = at_s
        began = time.perf_counter()
        clockwise = rule.decide(ring, fleet, which, at_s)
        taken_ms.append(1e3 * (time.perf_counter() - began))
        fleet.clockwise[which] = clockwise
        fleet.cell[which] = (fleet.cell[which] + (1 if clockwise else -1)) % cells
    return taken_ms


def result_row(name: str, cells: float, taken_ms: list[float]) -> dict[str, Any]:
    """Return one row of the result."""
    return {
        "planner": name,
        "front_cells": round(cells),
        "median_ms": round(statistics.median(taken_ms), 3),
        "p99_ms": round(float(np.percentile(taken_ms, 99)), 3),
    }


def main() -> None:
    """Measure all planners and rules and print their times."""
    rows = []
    for size in SIZES:
        burn = ellipse(size)
        for name, make in PLANNERS.items():
            taken_ms, cells = measure(burn, make(burn))
            rows.append(result_row(name, cells, taken_ms))
        rows += [
            result_row(name, size, measure_rule(make_rule(), size))
            for name, make_rule in TEAM_RULES.items()
        ]
    if "--json" in sys.argv[1:]:
        click.echo(json.dumps({"limit_ms": LIMIT_MS, "decisions": rows}))
        return
    click.echo("planner                 cells   median ms     p99 ms")
    for row in rows:
        click.echo(
            f"{row['planner']:22}{row['front_cells']:7}{row['median_ms']:12}{row['p99_ms']:11}"
        )
    click.echo(f"limit of the median at 2,000 cells: {LIMIT_MS} ms")


if __name__ == "__main__":
    main()
