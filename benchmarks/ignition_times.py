"""Time of the correctable fire simulation: ``python -m benchmarks.ignition_times [--json]``.

The case is a square kilometre of short grass with 500 ignitions in an hour and 200 corrections,
under a constant wind and under a wind that changes every ten minutes. Each figure is the minimum of
several runs, in wall time and in CPU time. ``pairs`` is the time of a computation of all pairs of
ignitions and points (extrapolated from fewer points), divided by the time of this package.
``off_s`` is the difference of the results.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import click
import numpy as np

from firemodel.arrays import Floats
from firemodel.assimilation.distance_weighting import PaperCorrected
from firemodel.assimilation.gaussian_process import GaussianCorrected
from firemodel.ellipses import ellipse
from firemodel.ellipses.ellipse import EllipseFire, Spread, spreads_of
from firemodel.ellipses.point_observations import BURNING
from firemodel.physics.weather import Weather, WeatherStream

WIDE_M = 1000.0
IGNITIONS, CORRECTIONS = 500, 200
LENGTHS_M = (30.0, 100.0)
MANY, MAP_SIDE, FEW = 1_000_000, 400, 300
PAIRS = 4000  # number of points in the computation of all pairs
HOUR_S = 3600.0
FUEL, WIND_M_S = 1, 4.0
LIMIT_S, MAP_LIMIT_MS = 1.0, 50.0


def weather(at_s: float, wind_m_s: float, from_deg: float) -> Weather:
    return Weather(at_s, wind_m_s, from_deg, 6.0, 7.0, 8.0, 60.0, 90.0)


def winds() -> dict[str, tuple[Spread, ...]]:
    """Return the rates under a constant wind, and under a wind that turns and increases."""
    turning = [weather(600.0 * k, WIND_M_S + 0.5 * k, 220.0 + 15.0 * k) for k in range(7)]
    return {
        "steady": spreads_of(FUEL, WeatherStream([weather(0.0, WIND_M_S, 220.0)])),
        "changing": spreads_of(FUEL, WeatherStream(turning)),
    }


def least(run: Callable[[], Any], times: int) -> tuple[float, float]:
    """Return the minimum wall time and the minimum CPU time of a function in ms."""
    run()
    clock, core = [], []
    for _ in range(times):
        began, began_core = time.perf_counter(), time.thread_time()
        run()
        core.append(time.thread_time() - began_core)
        clock.append(time.perf_counter() - began)
    return 1e3 * min(clock), 1e3 * min(core)


@contextmanager
def one_tile() -> Iterator[None]:
    """Disable the tiles, so that each ignition is tried at each point."""
    kept, ellipse.TILE = ellipse.TILE, MANY
    try:
        yield
    finally:
        ellipse.TILE = kept


def fitted(
    fire: EllipseFire, observations: Floats, near: GaussianCorrected | None, cells: Floats
) -> None:
    """Fit the Gaussian process to all observations and compute the times of all cells."""
    GaussianCorrected(fire, observations, near=near).ignition_time_s(cells)


def corrected(
    fire: EllipseFire,
    observations: Floats,
    length_m: float,
    points: Floats,
    simulated_s: Floats | None = None,
) -> Floats:
    """Return corrected times of points; ``simulated_s`` are their simulated times, if computed."""
    found = PaperCorrected(fire, observations, length_m)
    if simulated_s is None:
        return found.ignition_time_s(points)
    return found.corrected_s(points, simulated_s)


def measure(name: str, spreads: tuple[Spread, ...]) -> list[dict[str, Any]]:
    """Return all figures for one wind."""
    random = np.random.default_rng(1)
    sources = random.uniform(0.0, 1.0, (IGNITIONS, 3)) * (WIDE_M, WIDE_M, HOUR_S)
    fire = EllipseFire(spreads, sources)
    many = random.uniform(0.0, WIDE_M, (MANY, 2))
    path = np.linspace((200.0, 300.0), (500.0, 420.0), FEW)
    scattered = many[:FEW]
    observations = np.column_stack(
        [random.uniform(0.0, WIDE_M, (CORRECTIONS, 2)), np.zeros((CORRECTIONS, 2))]
    )
    observations[:, 2] = fire.ignition_time_s(observations[:, :2]) + random.normal(
        0.0, 120.0, CORRECTIONS
    )
    observations[:, 3] = BURNING
    rows = []

    def add(what: str, took_ms: tuple[float, float], **more: Any) -> None:
        rows.append({"wind": name, "what": what, "ms": took_ms[0], "core_ms": took_ms[1], **more})

    with one_tile():
        pairs_ms = least(lambda: fire.ignition_time_s(many[:PAIRS]), 2)[1] / PAIRS
        pairs_s = fire.ignition_time_s(many[:PAIRS])
    for what, points, times in (
        (f"{MANY} points", many, 3),
        (f"{FEW} points on a path", path, 100),
        (f"{FEW} points scattered", scattered, 100),
    ):
        found_ms = least(partial(fire.ignition_time_s, points), times)
        add(what, found_ms, pairs=pairs_ms * len(points) / found_ms[1])
    rows[0]["off_s"] = float(np.abs(fire.ignition_time_s(many)[:PAIRS] - pairs_s).max())
    side = (np.arange(MAP_SIDE) + 0.5) * WIDE_M / MAP_SIDE
    cells = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    simulated_s = fire.ignition_time_s(cells)
    for length_m in LENGTHS_M:
        all_ms = least(partial(corrected, fire, observations, length_m, many), 3)
        add(
            f"{MANY} points, {CORRECTIONS} corrections of {length_m:g} m",
            all_ms,
            limit_ms=1e3 * LIMIT_S,
        )
        map_ms = least(partial(corrected, fire, observations, length_m, cells, simulated_s), 10)
        add(
            f"{MAP_SIDE} x {MAP_SIDE} map, one more correction, {length_m:g} m",
            map_ms,
            limit_ms=MAP_LIMIT_MS,
        )
    before = GaussianCorrected(fire, observations[:-1])
    one_more = partial(fitted, fire, observations, before, cells)
    what = f"{MAP_SIDE} x {MAP_SIDE} map, one more correction, Gaussian"
    add(what, least(one_more, 10), limit_ms=MAP_LIMIT_MS)
    add(
        f"{what}, without an earlier fit",
        least(partial(fitted, fire, observations, None, cells), 5),
    )
    return rows


def main() -> None:
    """Measure all cases and print the table."""
    rows = [row for name, spreads in winds().items() for row in measure(name, spreads)]
    if "--json" in sys.argv[1:]:
        click.echo(json.dumps({"ignitions": IGNITIONS, "ignition_times": rows}))
        return
    click.echo(f"{IGNITIONS} ignitions{'ms':>52}{'of a core':>12}{'limit':>8}{'pairs':>8}")
    for row in rows:
        limit = f"{row['limit_ms']:.0f}" if "limit_ms" in row else ""
        pairs = f"{row['pairs']:.0f} x" if "pairs" in row else ""
        off = f"  off {row['off_s']:.0e} s" if "off_s" in row else ""
        click.echo(
            f"{row['wind']:10}{row['what']:47}{row['ms']:9.2f}{row['core_ms']:12.2f}{limit:>8}"
            f"{pairs:>8}{off}"
        )


if __name__ == "__main__":
    main()
