"""Measure the time and the memory of the wind over terrain on random hills.

    python -m benchmarks.wind_speed [CELLS] [SEED]

The landscape has CELLS x CELLS cells of 30 m (default 670). The amplitude of the elevations falls
with the square of the wave number, and the root mean square of the rise is 0.25. The wind is solved
for two directions, first one after the other, then in two threads. The times do not contain the
compilation of the kernels.
"""

import argparse
import resource
import time
from concurrent.futures import ThreadPoolExecutor

import click
import numpy as np

from firemodel.arrays import Floats
from firemodel.wind import REFERENCE_M, surface_of_height, terrain_wind
from firemodel.wind.terrain_wind import MapFunction

CELL_M, RISE = 30.0, 0.25
LIMIT_S, LIMIT_DIVERGENCE = 5.0, 1e-6


def hills(cells: int, seed: int) -> Floats:
    """Return random elevations (cells, cells)."""
    rng = np.random.default_rng(seed)
    waves = np.hypot(np.fft.fftfreq(cells)[:, None], np.fft.rfftfreq(cells))
    waves[0, 0] = np.inf
    parts = rng.normal(size=waves.shape) + 1j * rng.normal(size=waves.shape)
    found = np.fft.irfft2(parts / waves**2, s=(cells, cells))
    rise = np.hypot(*np.gradient(found, CELL_M))
    return np.asarray(found * RISE / np.sqrt(np.mean(rise**2)))


def main() -> None:
    """Print times, memory and the remaining divergence."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cells", type=int, nargs="?", default=670)
    parser.add_argument("seed", type=int, nargs="?", default=3)
    options = parser.parse_args()
    ground = hills(options.cells, options.seed)
    surface = surface_of_height(np.full(ground.shape, 0.3))
    small = surface_of_height(np.full((16, 16), 0.3))
    terrain_wind(hills(16, 0), CELL_M, small).responses(REFERENCE_M)  # compiles
    with ThreadPoolExecutor(2) as threads:
        ways: tuple[tuple[str, MapFunction], ...] = (
            ("one thread", map),
            ("two threads", threads.map),
        )
        for name, run in ways:
            began, used = time.perf_counter(), time.process_time()
            found = terrain_wind(ground, CELL_M, surface, run=run)
            solved_s, used_s = time.perf_counter() - began, time.process_time() - used
            began = time.perf_counter()
            found.responses(REFERENCE_M)
            click.echo(
                f"{name}: {solved_s:.1f} s for two directions ({used_s:.1f} s of processor time; "
                f"limit {LIMIT_S:g} s for one), {found.steps} steps, divergence "
                f"{found.divergence:.1e} U/dx (limit {LIMIT_DIVERGENCE:g}), wind of the cells "
                f"{time.perf_counter() - began:.2f} s"
            )
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    click.echo(f"{np.ptp(ground):.0f} m high; peak memory {peak_mib:.0f} MiB")


if __name__ == "__main__":
    main()
