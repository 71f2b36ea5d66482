"""What routing alone can gain: ``python -m benchmarks.routing_limit [SCENARIO ...]``.

The fire is believed as in Islam & Hu, section VI.E: each part of the front stays where it was last
seen, in a convex hull. A vehicle that is told where the head is sweeps across it ``sweeps`` times,
going past it by a share ``reach`` of the perimeter, then circles once, and so on. The best of these
routes shows about how much there is to be had by choosing directions. It is no bound: a route may
be less regular than these, and one setting of the damped rule (reversal_margin 0.7) was 9 % below
circling on the fast fire, where the best of these is 7 %.
Printed: mean maximum error of circling and of the best routes, in cells.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import click
import numpy as np
from numpy.typing import NDArray

from firemodel.spread.schemes import SchemeName
from mission_service.experiments.islam_hu.ideal_flight import fly
from mission_service.experiments.islam_hu.scenarios import (
    COMPARED,
    ISLAM_HU,
    islam_hu_burn,
    perimeter_planner,
)
from mission_service.guidance.front.front_path import bearing_deg
from mission_service.guidance.front.front_shape import ring_of_cells
from mission_service.guidance.front.perimeter_planner import PerimeterPlanner
from mission_service.guidance.protocol import Decision

SWEEPS = (1, 2, 3, 4, 6, 8)
REACHES = (0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
HEAD_DEG = {"slow-then-fast": 225, "fast": 225, "brush-grass": 180, "brush-litter": 180}
Floats = NDArray[np.float64]


class SweepAndCircle(PerimeterPlanner):
    """Turns past the head, a number of times a lap."""

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
        elif 0.5 <= behind < 0.6:  # it has passed the tail
            self.turns = 0
        return Decision(self.clockwise, bool(turn), 0.0, 0.0, int(bearing.size))


def mean_max_cells(case: tuple[str, SchemeName, int, float]) -> float:
    """Fly one route."""
    name, scheme, sweeps, reach = case
    burn = islam_hu_burn(name, scheme)
    usual = perimeter_planner(burn, "circling")
    planner = SweepAndCircle(
        usual.settings, burn.arrival_s.shape, (usual.map.centre_row, usual.map.centre_col), 0.0
    )
    planner.head_deg, planner.sweeps, planner.reach = HEAD_DEG[name], sweeps, reach
    return float(fly(burn, planner).max_error.mean())


def main() -> None:
    """Try them all."""
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
