"""Compare the time of an ensemble with the same number of single fires (500 x 500 cells, 3 h).

    .venv/bin/python -m benchmarks.many_fires [--members 100] [--workers 2]

The single fires are simulated in one process, one after the other, by ``new_fire``, ``perturb`` and
``advance``. The single fires are timed without and with ``behaviour_of``, which computes flame
lengths, as the ensemble does. A whole command ``fire run`` also starts Python and writes files; it
is timed once. The landscapes are those of ``bench fire``: hills with patches of 12 fuels, and a
plain; each has a moderate and a strong wind.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import click
import numpy as np

from firemodel.ensemble.draws import Draw, latin_draws
from firemodel.ensemble.member_fires import Start, Window, burned_windows
from firemodel.ensemble.products import arrival_quantiles_s, burn_probability, mean_flame_length_m
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.fire_scheme import Fire
from firemodel.spread.schemes import new_fire
from mission_service.cli.bench_commands import CELL_M, landscape

CELLS, UNTIL_S = 500, 3 * 3600.0
LIT = (250, 250, 0.0)
COMMAND = [sys.executable, "-m", "mission_service.cli", "fire", "run", "default"]
THREE_HOURS = ["--set", "fire.scheme=anyangle", "--set", f"duration_s={UNTIL_S:g}"]


def weather(wind_m_s: float) -> WeatherStream:
    """Return dry weather with a wind from the west."""
    return WeatherStream([Weather(0.0, wind_m_s, 250.0, 5.0, 6.0, 7.0, 60.0, 90.0)])


class Case:
    """One landscape and wind, and the draws of its members."""

    def __init__(self, mixed: bool, wind_m_s: float, count: int) -> None:
        self.land, self.weather = landscape(CELLS, mixed), weather(wind_m_s)
        self.start = self._start()
        self.draws = latin_draws(Uncertainty(), 1, count, self.start.fuels)

    def _start(self) -> Start:
        return Start(new_fire("anyangle", self.land, self.weather, []), [LIT])

    def single(self, draw: Draw) -> Fire:
        """Simulate a member as a single fire."""
        row, col, at_s = LIT
        down, right = round(-draw.north_m / CELL_M), round(draw.east_m / CELL_M)
        lit = (row + down, col + right, at_s)
        fire = new_fire("anyangle", self.land, self.weather, [lit])
        fire.perturb(draw.wind_factor, draw.turn_deg, self.start.rate_factors(draw))
        fire.advance(UNTIL_S)
        return fire

    def ensemble(self, workers: int) -> list[Window]:
        """Simulate all members, from the landscape to the maps; return the burned areas."""
        start, numbers = self._start(), range(len(self.draws))
        with ThreadPoolExecutor(workers) as pool:
            windows = list(burned_windows(start, self.draws, numbers, UNTIL_S, 1, pool.map))
        burn_probability(windows, self.land.shape, UNTIL_S)
        arrival_quantiles_s(windows, self.land.shape, (0.1, 0.5, 0.9))
        mean_flame_length_m(windows, self.land.shape)
        return windows


def seconds(work: Callable[[], object]) -> tuple[float, float]:
    """Return the elapsed and the processor time of a call."""
    began, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - began, time.process_time() - cpu


def command_s() -> float:
    """Return the time of one command ``fire run`` of the default scenario (200 x 200 cells)."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        subprocess.run(
            [*COMMAND, "-o", folder, "--json", *THREE_HOURS],
            check=True,
            stdout=subprocess.DEVNULL,
            cwd=Path(__file__).parents[1],
        )
        return time.perf_counter() - began


def measured(mixed: bool, wind_m_s: float, count: int, workers: int) -> dict[str, object]:
    """Return the times of single fires and of an ensemble on one landscape, in s and s of CPU."""
    Case(mixed, wind_m_s, 4).ensemble(workers)  # compile the kernels
    case = Case(mixed, wind_m_s, count)
    burned = [np.isfinite(window.after_s).sum() for window in case.ensemble(workers)]
    assert burned[0] == case.single(case.draws[0]).burned().sum()
    plain = seconds(lambda: [case.single(draw) for draw in case.draws])
    flames = seconds(lambda: [behaviour_of(case.single(draw)) for draw in case.draws])
    many = seconds(lambda: case.ensemble(workers))
    return {
        "fuel": "mixed" if mixed else "uniform",
        "wind_m_s": wind_m_s,
        "mean_burned_cells": round(float(np.mean(burned))),
        "single_s": [round(each, 2) for each in plain],
        "single_with_flames_s": [round(each, 2) for each in flames],
        "ensemble_s": [round(each, 2) for each in many],
        "times_as_fast": round(plain[0] / many[0], 1),
        "times_as_fast_as_with_flames": round(flames[0] / many[0], 1),
    }


def main() -> None:
    """Print one line for each landscape and wind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--members", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    load = os.getloadavg()[0]
    click.echo(f"{options.members} members, {options.workers} threads, load {load:.1f}")
    for mixed in (True, False):
        for wind_m_s in (5.0, 12.0):
            click.echo(json.dumps(measured(mixed, wind_m_s, options.members, options.workers)))
    click.echo(f"one command fire run (200 x 200 cells, three hours): {command_s():.1f} s")


if __name__ == "__main__":
    main()
