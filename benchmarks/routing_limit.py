"""Gain of routing alone: ``python -m benchmarks.routing_limit [SCENARIO ...]``.

The fire is estimated as in Islam & Hu, section VI.E: each part of the front stays at its last
observed position, in a convex hull. The vehicle has the true bearing of the head. The vehicle
sweeps across the head ``sweeps`` times, passes it each time by a fraction ``reach`` of the
perimeter, then flies one lap, and repeats. The best of these routes shows the approximate gain of
choosing directions. It is not a bound, because other routes may be less regular: on the fast fire
one setting of the damped rule (reversal_margin 0.7) had an error 9 % below circling, and the best
of these routes 7 % below. The benchmark prints the mean maximum error of circling and of the best
routes, in cells.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import click
import numpy as np

from firemodel.spread.schemes import SchemeName
from mission_service.experiments.islam_hu.ideal_flight import fly
from mission_service.experiments.islam_hu.scenarios import (
    COMPARED,
    ISLAM_HU,
    islam_hu_burn,
    islam_hu_planner,
)
from mission_service.guidance.front.front_path import bearing_deg
from mission_service.guidance.front.front_shape import ring_of_cells
from mission_service.guidance.front.islam_hu_planner import PerimeterPlanner
from mission_service.guidance.protocol import Decision

SWEEPS = (1, 2, 3, 4, 6, 8)
REACHES = (0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
HEAD_DEG = {"slow-then-fast": 225, "fast": 225, "brush-grass": 180, "brush-litter": 180}


class SweepAndCircle(PerimeterPlanner):
    """Planner that sweeps across the head a number of times in each lap."""

    head_deg: int
    sweeps: int
    reach: float
    turns = 0

    def _decide(self, row: float, col: float, at_s: float) -> Decision:
        own_deg = round(bearing_deg(self.map, row, col)) % 360
        _, _, bearing = ring_of_cells(self.shape(row, col), own_deg, self.clockwise)
        behind = np.argmin(np.abs((bearing - self.head_deg + 180) % 360 - 180)) / bearing.size
        turn = self.reach <= behind < 0.5 and self.turns < self.sweeps
        if turn:
            self.clockwise = not self.clockwise
            self.turns += 1
        elif 0.5 <= behind < 0.6:  # the vehicle has passed the tail
            self.turns = 0
        return Decision(self.clockwise, bool(turn), 0.0, 0.0, int(bearing.size))


def mean_max_cells(case: tuple[str, SchemeName, int, float]) -> float:
    """Fly one route and return its mean maximum error in cells."""
    name, scheme, sweeps, reach = case
    burn = islam_hu_burn(name, scheme)
    usual = islam_hu_planner(burn, "circling")
    planner = SweepAndCircle(
        usual.settings, burn.arrival_s.shape, (usual.map.centre_row, usual.map.centre_col), 0.0
    )
    planner.head_deg, planner.sweeps, planner.reach = HEAD_DEG[name], sweeps, reach
    return float(fly(burn, planner).max_error.mean())


def main() -> None:
    """Fly all routes and print the best ones."""
    names = sys.argv[1:] or ["slow-then-fast", "fast"]
    with ProcessPoolExecutor(2) as pool:
        for name, scheme in product([name for name in ISLAM_HU if name in names], COMPARED):
            routes = [(0, 1.0), *product(SWEEPS, REACHES)]
            errors = list(pool.map(mean_max_cells, [(name, scheme, *route) for route in routes]))
            click.echo(f"{name} {scheme}: circling {errors[0]:.2f} cells")
            for place in np.argsort(errors)[:5]:
                sweeps, reach = routes[place]
                change = 100.0 * (errors[place] / errors[0] - 1.0)
                click.echo(
                    f"  {sweeps} sweeps, {reach:.2f} of the perimeter past the head: "
                    f"{errors[place]:.2f} ({change:+.0f} %)"
                )


if __name__ == "__main__":
    main()
