"""Measures the run times of the fire model for ``bench fire``: whole burns and short steps."""

import resource
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire

STEP_S = 10.0
CELL_M = 30.0
FUELS = np.array([1, 2, 4, 5, 8, 9, 10, 102, 122, 145, 165, 183], dtype=np.int16)
PATCH_CELLS = 20
WEATHER = WeatherStream([Weather(0.0, 5.0, 250.0, 5.0, 6.0, 7.0, 60.0, 90.0)])
NO_END_S = 1e12  # later than the end of every burn


def landscape(cells: int, mixed: bool) -> Landscape:
    """Return a square landscape, flat with one fuel or (``mixed``) hilly with patches of 12 fuels.

    Equal arguments result in equal landscapes.
    """
    shape = (cells, cells)
    if not mixed:
        fuel, height_m = np.full(shape, 2, np.int16), np.zeros(shape, np.float32)
    else:
        patches = -(-cells // PATCH_CELLS)
        chosen = np.random.default_rng(1).choice(FUELS, size=(patches, patches))
        fuel = np.repeat(np.repeat(chosen, PATCH_CELLS, 0), PATCH_CELLS, 1)[:cells, :cells]
        at = np.arange(cells, dtype=np.float32)
        height_m = 300 * np.outer(np.cos(at / 55), np.sin(at / 40)) + 100 * np.sin(at / 13)
    fuel = np.ascontiguousarray(fuel)
    return Landscape("EPSG:32611", 5e5, 4e6, CELL_M, fuel, height_m.astype(np.float32))


def bench_fire(largest: int, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return cells/s, ms per step and peak memory per case, up to ``largest`` cells per side."""
    # Compile the kernels before measuring.
    AnyAngleFire(landscape(50, True), WEATHER, [(25, 25, 0.0)]).advance(NO_END_S)
    sizes = [cells for cells in (200, 1000, 4000) if cells <= largest]
    burns = [_whole_burn(cells, mixed, progress) for cells in sizes for mixed in (False, True)]
    loops = [_closed_loop(cells, mixed, progress) for cells in sizes[:2] for mixed in (False, True)]
    return {"whole_burn": burns, "closed_loop": loops}


def _whole_burn(cells: int, mixed: bool, progress: Callable[[str], None]) -> dict[str, Any]:
    """Measure one whole burn, including the computation of all spread rates (Rothermel)."""
    land = landscape(cells, mixed)
    began = time.perf_counter()
    fire = AnyAngleFire(land, WEATHER, [(cells // 2, cells // 2, 0.0)])
    fire.advance(NO_END_S)
    elapsed_s = time.perf_counter() - began
    burned = int(np.count_nonzero(fire.burned()))
    found = {
        "cells": f"{cells}x{cells}",
        "fuel": _name(mixed),
        "burned_cells": burned,
        "seconds": round(elapsed_s, 4),
        "cells_per_s": round(burned / elapsed_s),
        "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
    }
    progress(
        f"whole burn  {found['cells']:>9} {found['fuel']:<8} {burned / elapsed_s / 1e6:6.2f} "
        f"million cells/s, peak memory of the process {found['peak_memory_mib']} MiB"
    )
    return found


def _closed_loop(cells: int, mixed: bool, progress: Callable[[str], None]) -> dict[str, Any]:
    """Measure steps of 10 s for three hours, starting when a tenth of the cells have burned."""
    fire = AnyAngleFire(landscape(cells, mixed), WEATHER, [(cells // 2, cells // 2, 0.0)])
    while np.count_nonzero(fire.burned()) < cells * cells / 10:
        fire.advance(fire.time_s + 600.0)
    before = np.count_nonzero(fire.burned())
    steps_s = np.empty(1080)
    for step in range(steps_s.size):
        began = time.perf_counter()
        fire.advance(fire.time_s + STEP_S)
        steps_s[step] = time.perf_counter() - began
    median_ms, p99_ms = np.quantile(steps_s * 1e3, [0.5, 0.99])
    burned = int(np.count_nonzero(fire.burned()) - before)
    found = {
        "cells": f"{cells}x{cells}",
        "fuel": _name(mixed),
        "step_s": STEP_S,
        "burned_cells_per_step": round(burned / steps_s.size, 1),
        "median_ms": round(float(median_ms), 4),
        "p99_ms": round(float(p99_ms), 4),
    }
    progress(
        f"closed loop {found['cells']:>9} {found['fuel']:<8} {median_ms:6.3f} ms for {STEP_S:g} s "
        f"(median; 99 % {p99_ms:.3f} ms), {found['burned_cells_per_step']} cells burned per step"
    )
    return found


def _name(mixed: bool) -> str:
    return "mixed" if mixed else "uniform"
