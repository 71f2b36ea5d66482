"""Forecasts between mapped perimeters of simulated fires: ``-m benchmarks.perimeter_twins A B``.

The true fires (seeds A to B) are those of ``estimate_twins`` with a further common factor of all
rates. Before each perimeter, with a probability of one half, a random sector of the front is held
until the end. Perimeters are mapped every 15 to 45 minutes from 40 minutes on; their outlines are
moved inwards or outwards by 12 m (standard deviation) and simplified. Each forecast from one
perimeter to the next uses only the earlier perimeters. Persistence is the last perimeter.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import click
import numpy as np

from benchmarks.estimate_twins import (
    HOUR_S,
    UNBURNABLE,
    WRONG,
    Twin,
    continued,
    drawn,
    sector,
    seeds_parser,
    twin,
)
from firemodel.arrays import Floats
from firemodel.assimilation.estimate_forecast import likely_area
from firemodel.assimilation.fire_estimate import EstimateSettings, FireEstimate
from firemodel.assimilation.observation import BURNED, Observation, mapped_perimeter
from firemodel.assimilation.scores import coverage, overlap
from firemodel.landscape.landscape import Landscape
from firemodel.spread.burning import burning_from_perimeter
from firemodel.spread.front import front_polygons
from mission_service.simulation.fire_assimilation import Step
from mission_service.simulation.forecast_picture import draw_forecast

FIRST_S, LAST_S = 2400.0, 4.0 * HOUR_S
GAPS_S = (900.0, 1500.0, 1800.0, 2700.0)
MAP_ERROR_M, SIMPLIFIED_M = 12.0, 15.0


def mapped(seed: int) -> tuple[Twin, list[Observation]]:
    """Return a fire and its mapped perimeters."""
    truth = twin(1000 + seed)
    rng = np.random.default_rng((4242, seed))
    inputs = drawn(truth.seeds)
    codes, factors = inputs.true.copy(), inputs.factors * math.exp(rng.normal(-0.2, 0.4))
    arrival_s, at_s = truth.arrival_s, FIRST_S
    found = [_map_of(arrival_s, at_s, truth.landscape, rng)]
    while at_s < LAST_S:
        if rng.random() < 0.5:
            half_deg = rng.uniform(15.0, 50.0)
            closed = sector(arrival_s <= at_s, rng.uniform(0.0, 360.0), half_deg)
            codes = np.where(closed, UNBURNABLE, codes)
        fire = continued(arrival_s, at_s, inputs.actual, codes, factors)
        at_s += float(rng.choice(GAPS_S))
        fire.advance(at_s)
        arrival_s = fire.expected_s()
        found.append(_map_of(arrival_s, at_s, truth.landscape, rng))
    return truth, found


def _map_of(
    arrival_s: Floats, at_s: float, landscape: Landscape, rng: np.random.Generator
) -> Observation:
    area = front_polygons(arrival_s, at_s, landscape).buffer(0.0)
    drawn_area = area.buffer(rng.normal(0.0, MAP_ERROR_M)).simplify(SIMPLIFIED_M).buffer(0.0)
    return mapped_perimeter(drawn_area, landscape, at_s, 20.0)


def run(
    seed: int, members: int, pool: ThreadPoolExecutor, pictures: Path | None = None
) -> list[list[float]]:
    """Return estimate, persistence, model and share in the band for each forecast of a fire.

    A picture of each forecast is written to the folder ``pictures``.
    """
    truth, perimeters = mapped(seed)
    estimate = FireEstimate(
        truth.landscape, truth.weather, settings=EstimateSettings(members, seed, WRONG)
    )
    estimate.assimilate(perimeters[0])
    found = []
    for before, after in pairwise(perimeters):
        forecast = estimate.forecast(after.at_s, pool.map)
        observed, known = after.state == BURNED, before.state == BURNED
        start = burning_from_perimeter([before.area], truth.landscape, before.at_s)
        alone = estimate.model.restarted(start)
        alone.advance(after.at_s)
        probability = forecast.burn_probability(after.at_s)
        inside, likely = coverage(probability, observed), likely_area(probability)
        scores = [overlap(area, observed) for area in (likely, known, alone.burned())]
        found.append([*scores, math.nan if inside is None else inside])
        if pictures is not None:
            step = Step(before, after, probability, likely, alone.burned())
            path = pictures / f"perimeters-{seed}-{len(found)}.png"
            draw_forecast(path, truth.landscape, step, f"Simulated fire {seed}", None)
        estimate.assimilate(after, pool.map)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the mean intersection over union of each fire, and means of all forecasts."""
    parser = seeds_parser(__doc__, 24)
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each forecast")
    given = parser.parse_args(arguments)
    click.echo("seed    IoU: estimate  persistence  model   in the 80 % band")
    every: list[list[list[float]]] = []
    with ThreadPoolExecutor(given.threads) as pool:
        for seed in range(given.first, given.last + 1):
            every.append(run(seed, given.members, pool, given.pictures))
            click.echo(_line(f"{seed:4}", every[-1]))
    click.echo(_line("first", [rows[0] for rows in every]))
    click.echo(_line("later", [row for rows in every for row in rows[1:]]))
    click.echo(_line("all", [row for rows in every for row in rows]))


def _line(name: str, rows: list[list[float]]) -> str:
    estimate, persistence, model, inside = np.nanmean(rows, axis=0)
    return f"{name:6} {estimate:14.3f} {persistence:12.3f} {model:6.3f} {inside:18.2f}"


if __name__ == "__main__":
    main()
