"""Speed compared with pyretechnics: ``python -m benchmarks.pyretechnics_compare [--json]``.

Both packages simulate the same fire in one run: 1000 x 1000 cells of 30 m, wind of 5 m/s at 20 ft
from 250 degrees, one ignition cell, until about half of the cells have burned. The times contain
Rothermel's equations and the construction of the fire. The times exclude the reading of files, the
start of Python and the compilation. Both packages have no wind limit and the same length-to-width
ratio; pyretechnics runs with its defaults.

If each cell has a random fuel ("speckled"), the burned areas differ. ``--finer 3`` divides each
cell into 3 x 3 cells of the same fuel and shows the limit to which each package converges; use it
with ``--cells 120``.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WIND_10M_OVER_20FT, Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire

CELL_M = 30.0
# Equal moistures of live herbaceous and live woody fuel, because pyretechnics exchanges them.
WEATHER = Weather(0.0, 5.0, 250.0, 6.0, 7.0, 8.0, 90.0, 90.0)
FUELS = (1, 2, 5, 9, 10)
PATCH_CELLS = {"mixed": 20, "speckled": 1}
WORKER = Path(__file__).with_name("pyretechnics_worker.py")
# Duration in minutes with 1000 cells a side; other sizes have a proportional duration.
DURATIONS_MIN = {"uniform": 1180.0, "mixed": 2700.0, "speckled": 2700.0}


def landscapes(cells: int, finer: int = 1) -> dict[str, Landscape]:
    """Return level ground of one fuel, and hills of five fuels, in patches or in single cells.

    The hills have slopes up to about 20 %. Each cell is divided into ``finer`` by ``finer`` cells.
    """
    place = np.arange(cells * finer) * CELL_M / finer
    hills = 200.0 * np.sin(place / 900.0)[:, None] * np.cos(place / 1100.0) + 0.02 * place
    fuels = {"uniform": np.ones((place.size, place.size))}
    for name, patch in PATCH_CELLS.items():
        some = np.random.default_rng(1).choice(FUELS, (-(-cells // patch),) * 2)
        fuels[name] = np.kron(some, np.ones((patch * finer,) * 2))[: place.size, : place.size]
    return {
        name: Landscape(
            "EPSG:32616",
            0.0,
            0.0,
            CELL_M / finer,
            fuel.astype(np.int16),
            (hills * (name != "uniform")).astype(np.float32),
        )
        for name, fuel in fuels.items()
    }


def ignition(landscape: Landscape) -> tuple[int, int]:
    """Return the row and column of the ignition, upwind of most of the landscape."""
    return int(0.6 * landscape.shape[0]), int(0.2 * landscape.shape[1])


def ours(landscape: Landscape, duration_min: float) -> tuple[float, Floats]:
    """Return (wall time in s, arrival times in s) of this package, without compilation."""
    lit = [(*ignition(landscape), 0.0)]
    AnyAngleFire(landscape, WeatherStream([WEATHER]), lit).advance(60.0)
    began = time.perf_counter()
    fire = AnyAngleFire(landscape, WeatherStream([WEATHER]), lit)
    fire.advance(duration_min * 60.0)
    return time.perf_counter() - began, fire.arrival_time_s


def answer_of(
    python: Path, landscape: Landscape, weather: Weather, **more: Any
) -> dict[str, NDArray[Any]]:
    """Return pyretechnics' results for a landscape without trees (see ``pyretechnics_worker``)."""
    dead_1h, dead_10h, dead_100h, herb, woody = weather.moisture.classes
    with tempfile.TemporaryDirectory() as folder:
        case, answer = Path(folder) / "case.npz", Path(folder) / "answer.npz"
        np.savez(
            case,
            slope=landscape.slope_tan,
            aspect=landscape.aspect_deg,
            fuel_model=landscape.fuel_model,
            wind_speed_10m=weather.wind_speed_m_s * WIND_10M_OVER_20FT * 3.6,
            upwind_direction=weather.wind_from_deg,
            fuel_moisture_dead_1hr=dead_1h,
            fuel_moisture_dead_10hr=dead_10h,
            fuel_moisture_dead_100hr=dead_100h,
            fuel_moisture_live_herbaceous=herb,
            fuel_moisture_live_woody=woody,
            cell_m=landscape.cell_size_m,
            **more,
        )
        subprocess.run([python, WORKER, case, answer], check=True)
        return dict(np.load(answer))


def theirs(python: Path, landscape: Landscape, duration_min: float) -> tuple[float, Floats]:
    """Return (wall time in s, arrival times in s) of pyretechnics."""
    more = {"ignition": ignition(landscape), "duration_min": duration_min}
    found = answer_of(python, landscape, WEATHER, **more)
    return float(found["wall_s"]), np.nan_to_num(found["arrival_min"] * 60.0, nan=np.inf)


def environment(folder: Path) -> Path:
    """Return the Python of a virtual environment with pyretechnics; create it if necessary."""
    python = folder / "bin" / "python"
    ready = folder / "ready"
    if not ready.exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        pip = (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
        subprocess.run([*pip, "pyretechnics"], check=True)
        ready.touch()
    return python


def compare(name: str, landscape: Landscape, python: Path) -> dict[str, Any]:
    """Return the burned cells a second of both packages and the overlap of the burned areas."""
    duration_min = (
        DURATIONS_MIN[name] * landscape.shape[0] * landscape.cell_size_m / (1000.0 * CELL_M)
    )
    our_s, our_arrival = ours(landscape, duration_min)
    their_s, their_arrival = theirs(python, landscape, duration_min)
    our_burned, their_burned = np.isfinite(our_arrival), np.isfinite(their_arrival)
    our_cells, their_cells = int(our_burned.sum()), int(their_burned.sum())
    return {
        "case": name,
        "duration_min": duration_min,
        "our_s": our_s,
        "their_s": their_s,
        "our_cells": our_cells,
        "their_cells": their_cells,
        "our_cells_per_s": our_cells / our_s,
        "their_cells_per_s": their_cells / their_s,
        "faster": (our_cells / our_s) / (their_cells / their_s),
        "area_ratio": our_cells / their_cells,
        "overlap": int((our_burned & their_burned).sum()) / int((our_burned | their_burned).sum()),
    }


def main() -> None:
    """Print one line for each case, or JSON."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--cells", type=int, default=1000, help="number of cells on each side of the map"
    )
    parser.add_argument(
        "--finer", type=int, default=1, help="number of cells on each side of a divided cell"
    )
    parser.add_argument("--venv", type=Path, default=cache / "firemodel" / "pyretechnics")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    python = environment(given.venv)
    for name, landscape in landscapes(given.cells, given.finer).items():
        found = compare(name, landscape, python)
        if given.json:
            click.echo(json.dumps(found))
            continue
        click.echo(
            f"{name}: {found['our_cells_per_s']:,.0f} cells/s in {found['our_s']:.2f} s, "
            f"pyretechnics {found['their_cells_per_s']:,.0f} in {found['their_s']:.1f} s: "
            f"{found['faster']:.1f} x; burned {found['our_cells']:,} and "
            f"{found['their_cells']:,} cells, overlap {found['overlap']:.3f}"
        )


if __name__ == "__main__":
    main()
