"""Spread without wind in each cell of a real landscape: ``python -m benchmarks.worcester``.

The landscape has LANDFIRE's layers around Worcester, Vermont (613 x 549 cells of 30 m, Scott &
Burgan's fuels); the moistures are 6/8/10/75/60 %. The benchmark measures the time to read the
files, the time of the first call in this process, which loads the compiled code, and the best of
five more calls.

With ``--venv`` (the environment that ``pyretechnics_compare`` creates) it also compares each cell
with pyretechnics, without a wind limit.
"""

import time
from pathlib import Path

import click
import numpy as np

from benchmarks.pyretechnics_compare import answer_of, environment
from benchmarks.shared import check_folder, data_parser
from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.rasters import read_landscape
from firemodel.physics.weather import Weather
from tests.firemodel.spread_fields import spread_fields

LAYERS = {
    "fuel": "LC22_F40_230",
    "elevation": "LC20_Elev_220",
    "slope": "LC20_SlpP_220",
    "aspect": "LC20_Asp_220",
    "canopy_cover": "LC22_CC_230",
    "canopy_height": "LC22_CH_230",
    "canopy_base": "LC22_CBH_230",
}
UNITS = {
    "slope": "percent",
    "canopy_cover": "percent",
    "canopy_height": "m*10",
    "canopy_base": "m*10",
}
CALM = Weather(0.0, 0.0, 0.0, 6.0, 8.0, 10.0, 75.0, 60.0)


def read_worcester(folder: Path) -> Landscape:
    """Read the landscape; cells without data become bare ground."""
    files = {layer: folder / f"{name}.tif" for layer, name in LAYERS.items()}
    return read_landscape(files, units=UNITS, missing="unburnable")


def timed(landscape: Landscape) -> tuple[float, Floats]:
    """Return the wall time in s, and the rates (y, x) in m/s."""
    began = time.perf_counter()
    rate_m_s, _, _ = spread_fields(landscape, CALM)
    return time.perf_counter() - began, rate_m_s


def main() -> None:
    """Print the times, and the ratios of the rates to pyretechnics'."""
    parser = data_parser(__doc__)
    parser.add_argument("--venv", type=Path, help="environment of pyretechnics, for the comparison")
    given = parser.parse_args()
    folder = check_folder(given.data / "worcester_vt" / "landfire")
    began = time.perf_counter()
    landscape = read_worcester(folder)
    reading_s = time.perf_counter() - began
    first_s, rate_m_s = timed(landscape)
    best_s = min(timed(landscape)[0] for _ in range(5))
    burns = rate_m_s > 0.0
    click.echo(
        f"{rate_m_s.size:,} cells, {int(burns.sum()):,} burn: reading {reading_s:.2f} s, spread "
        f"{first_s:.3f} s at first, then {best_s:.3f} s; together {reading_s + first_s:.2f} s\n"
        f"m/min: median {60 * np.median(rate_m_s[burns]):.3f}, most {60 * rate_m_s.max():.2f}"
    )
    if not given.venv:
        return
    answer = answer_of(environment(given.venv), landscape, CALM)
    their_m_s = answer["rate_m_min"].astype(np.float64) / 60.0
    both = burns & (their_m_s > 0.0)
    ratio = rate_m_s[both] / their_m_s[both]
    low, middle, high = np.percentile(ratio, [5, 50, 95])
    click.echo(
        f"over pyretechnics: 5 % {low:.4f}, median {middle:.4f}, 95 % {high:.4f}, from "
        f"{ratio.min():.4f} to {ratio.max():.4f}; {int((burns != (their_m_s > 0.0)).sum())} cells "
        "burn in only one of both"
    )


if __name__ == "__main__":
    main()
