"""Computing time of an estimate on 500 x 500 cells: ``python -m benchmarks.estimate_speed``.

The fire burns patches of five fuels for two hours. With 100 members a camera sees 200 m of its
front, and the fire is forecast for 60 minutes. With 300 members a whole perimeter is processed and
forecast for 30 minutes. Each line contains the limit and the ratio of the time to the limit.
"""

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import click
import numpy as np

from firemodel.assimilation.fire_estimate import EstimateSettings, FireEstimate
from firemodel.assimilation.observation import BURNED, UNBURNED, Observation, mapped_perimeter
from firemodel.landscape.flat import flat_landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire

CELLS, CELL_M, PATCH_CELLS = 500, 30.0, 4
FUELS = (1, 2, 5, 8, 10)
SEEN_S, RADIUS_CELLS = 7200.0, 5
WEATHER = WeatherStream([Weather(0.0, 4.0, 240.0, 6.0, 7.0, 8.0, 60.0, 90.0)])


def main() -> None:
    """Print the time of each step."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=2)
    given = parser.parse_args()
    side = CELLS // PATCH_CELLS
    codes = np.random.default_rng(1).choice(FUELS, size=(side, side))
    level = flat_landscape(CELLS, CELLS, CELL_M, 37.0, -120.0, 100.0, 1)
    fuel = np.kron(codes, np.ones((PATCH_CELLS, PATCH_CELLS), dtype=np.int16))
    landscape = replace(level, fuel_model=fuel.astype(np.int16))
    fire = AnyAngleFire(landscape, WEATHER, [(CELLS // 2, CELLS // 2, 0.0)])
    fire.perturb(1.0, 0.0, 1.2)
    fire.advance(SEEN_S + 3600.0)
    with ThreadPoolExecutor(given.threads) as pool:
        lit = [(CELLS // 2, CELLS // 2, 0.0)]
        estimate = FireEstimate(landscape, WEATHER, lit, EstimateSettings(100))
        estimate.advance(SEEN_S - 60.0, pool.map)
        _time("advance 100 members by 60 s", 2.0, lambda: estimate.advance(SEEN_S, pool.map))
        image = _image(fire, estimate.time_s)
        _time("observe 200 m of front", 1.0, lambda: estimate.assimilate(image, pool.map))
        until_s = estimate.time_s + 3600.0
        _time("forecast 60 min", 5.0, lambda: estimate.forecast(until_s, pool.map))
        many = FireEstimate(landscape, WEATHER, settings=EstimateSettings(300))
        many.assimilate(mapped_perimeter(fire.front(SEEN_S), landscape, SEEN_S))
        later_s = SEEN_S + 1800.0
        later = mapped_perimeter(fire.front(later_s), landscape, later_s)
        _time("300 members, a perimeter", 10.0, lambda: many.assimilate(later, pool.map))


def _image(fire: AnyAngleFire, at_s: float) -> Observation:
    """Return an image of the easternmost front."""
    rows, cols = np.nonzero(fire.arrival_time_s <= at_s)
    place = int(np.argmax(cols))
    top, left = int(rows[place]) - RADIUS_CELLS, int(cols[place]) - RADIUS_CELLS
    window = fire.arrival_time_s[top : top + 2 * RADIUS_CELLS, left : left + 2 * RADIUS_CELLS]
    return Observation(at_s, top, left, np.where(window <= at_s, BURNED, UNBURNED).astype(np.uint8))


def _time(what: str, limit_s: float, run: Callable[[], object]) -> None:
    began = time.perf_counter()
    run()
    took_s = time.perf_counter() - began
    click.echo(f"{what:28} {took_s:6.2f} s  {took_s / limit_s:5.2f} of {limit_s:g} s")


if __name__ == "__main__":
    main()
