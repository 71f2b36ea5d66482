"""Compare the wind over Askervein Hill with the measurements of run TU03-A (3 October 1983).

    python -m benchmarks.askervein FOLDER TERRAIN [--cell METRES] [--alpha RATIO]

FOLDER contains the measured speeds (the folder Askervein_Hill of the public repository
firemodels/exp). TERRAIN is ``z_data.csv`` (public repository firemodels/fds, folder
Validation/Askervein_Hill), which contains the hill without its surroundings, or the contour map
``.map`` (public repository firemodels/cad, folder Case_Studies/Askervein_Hill).

The reference wind is that of the mast RS, 10 m above flat ground upwind of the hill. The reference
wind blows from 206°; its speed follows from the speeds and fractional speed-ups in the files. The
roughness length is 0.03 m (Taylor & Teunissen 1987, Boundary-Layer Meteorology 39, 15-39). No
setting of the solver was chosen for this hill; ``--alpha`` shows how the result depends on the
ratio of the precision moduli, which is 1 in neutral air. The baseline is the reference wind
everywhere. Speeds of line AA are given relative to a reference wind, those of line A in m/s.
"""

import argparse
import csv
import math
import time
from pathlib import Path

import click
import numpy as np
from scipy.interpolate import LinearNDInterpolator, RegularGridInterpolator

from benchmarks.shared import check_folder
from firemodel.arrays import Floats
from firemodel.wind import Surface, TerrainWind, local_wind, terrain_wind
from firemodel.wind.terrain_wind import NEUTRAL_ALPHA_RATIO

WEST_M, EAST_M, SOUTH_M, NORTH_M = 74399.0, 77048.0, 22042.0, 24533.0  # of z_data.csv
HILLTOP_M, CENTRE_M = (75383.0, 23737.0), (75678.0, 23465.0)  # HT and CP
LINE_DEG = 43.0  # direction of the lines A and AA, clockwise from north
DISTANCE_UNIT_M = 10.0  # ASW85 is 850 m south-west of HT
ROUGHNESS_M, HEIGHT_M = 0.03, 10.0
AROUND_M = 1000.0  # contour maps: ground around the hill that belongs to the landscape


def ground_of(path: Path, cell_m: float) -> tuple[Floats, float, float]:
    """Return the elevation (y, x), and the coordinates of the centre of its north-west cell."""
    around = 0.0 if path.suffix == ".csv" else AROUND_M
    east = np.arange(WEST_M - around + cell_m / 2.0, EAST_M + around, cell_m)
    north = np.arange(NORTH_M + around - cell_m / 2.0, SOUTH_M - around, -cell_m)
    if path.suffix == ".csv":
        values = np.loadtxt(path, delimiter=",")
        rows, cols = values.shape
        axes = (np.linspace(SOUTH_M, NORTH_M, rows), np.linspace(WEST_M, EAST_M, cols))
        found = RegularGridInterpolator(axes, values)(
            tuple(np.meshgrid(north, east, indexing="ij"))
        )
    else:
        points = contour_points(path)
        found = LinearNDInterpolator(points[:, :2], points[:, 2])(*np.meshgrid(east, north))
    return found, float(east[0]), float(north[0])


def contour_points(path: Path) -> Floats:
    """Return the points (n, 3) of the contours of a WAsP map."""
    numbers = [line.split() for line in path.read_text(encoding="latin-1").splitlines()[4:]]
    points, at = [], 0
    while at < len(numbers):
        head, at = numbers[at], at + 1
        if not head:
            continue
        values: list[float] = []
        while len(values) < 2 * int(float(head[-1])):
            values += map(float, numbers[at])
            at += 1
        if len(head) != 3:  # lines of roughness alone have three numbers
            level = float(head[0 if len(head) == 2 else 2])
            points += [(x, y, level) for x, y in zip(values[::2], values[1::2], strict=True)]
    return np.array(points)


def table_of(path: Path) -> list[dict[str, float]]:
    """Return the rows of a file of measurements; empty cells are left out."""
    with path.open(encoding="utf-8-sig") as file:
        next(file)  # units
        return [
            {name: float(value) for name, value in row.items() if value}
            for row in csv.DictReader(file)
        ]


def line_places(centre_m: tuple[float, float], distances_m: Floats) -> tuple[Floats, Floats]:
    """Return the coordinates of masts at distances (n) along a line, positive to the north-east."""
    along = math.radians(LINE_DEG)
    return (
        centre_m[0] + distances_m * math.sin(along),
        centre_m[1] + distances_m * math.cos(along),
    )


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("terrain", type=Path)
    parser.add_argument("--cell", type=float, default=20.0, metavar="METRES")
    parser.add_argument("--alpha", type=float, default=NEUTRAL_ALPHA_RATIO, metavar="RATIO")
    options = parser.parse_args()
    folder = check_folder(options.folder)
    ground, west_m, north_m = ground_of(options.terrain, options.cell)
    ones = np.ones(ground.shape)
    began = time.perf_counter()
    solved = terrain_wind(
        ground,
        options.cell,
        Surface(0.0 * ones, ROUGHNESS_M * ones, 0.0 * ones),
        HEIGHT_M,
        options.alpha,
    )
    took_s = time.perf_counter() - began
    masts = table_of(folder / "AASW-AANE_TU03A_10m_MF.csv")
    speed_m_s = float(np.mean([each["SPEED"] / (1.0 + each["FSPUP"]) for each in masts]))
    from_deg = float(np.mean([each["DIRECTION"] - each["DIF"] for each in masts]))
    click.echo(
        f"{ground.shape[0]} x {ground.shape[1]} cells of {options.cell:g} m, "
        f"{np.ptp(ground):.0f} m high: {took_s:.1f} s for two directions, {solved.steps} steps, "
        f"divergence {solved.divergence:.1e} U/dx"
    )
    click.echo(f"reference wind {speed_m_s:.2f} m/s from {from_deg:.0f}°, 10 m above ground")

    def speeds(east_m: Floats, line_north_m: Floats) -> Floats:
        wind = _wind_at(
            solved,
            (north_m - line_north_m) / options.cell,
            (east_m - west_m) / options.cell,
            (speed_m_s, from_deg),
        )
        return np.asarray(np.hypot(wind[0], wind[1]))

    line_a = table_of(folder / "ASW-ANE_TU03A_10m.csv")
    line_aa = table_of(folder / "AASW-AANE_TU03A_10m.csv")
    top = next(each["SPEED"] for each in line_a if each["DIST"] == 0.0) / speed_m_s
    found_top = float(speeds(*(np.array([each]) for each in HILLTOP_M))[0]) / speed_m_s
    click.echo(
        f"hilltop HT, speed over reference: measured {top:.2f}, computed {found_top:.2f} "
        f"({100.0 * (found_top / top - 1.0):+.0f} %); fractional speed-up {top - 1.0:.2f}, "
        f"{found_top - 1.0:.2f} ({100.0 * ((found_top - 1.0) / (top - 1.0) - 1.0):+.0f} %)"
    )
    click.echo(f"{'RMS error in m/s':32} {'masts':>5} {'computed':>9} {'baseline':>9}")
    lines = (
        ("A", HILLTOP_M, [(each["DIST"], each["SPEED"]) for each in line_a]),
        ("AA", CENTRE_M, [(each["DIST"], each["NORM_SPEED"] * speed_m_s) for each in line_aa]),
    )
    for name, centre_m, rows in lines:
        distance_m, measured = np.array(rows).T
        distance_m *= DISTANCE_UNIT_M
        computed = speeds(*line_places(centre_m, distance_m))
        for part, which in (
            ("all", distance_m > -np.inf),
            ("windward side and top", distance_m <= 0.0),
            ("lee side", distance_m > 0.0),
        ):
            error, base = (
                float(np.sqrt(np.mean((each - measured)[which] ** 2)))
                for each in (computed, np.full(len(measured), speed_m_s))
            )
            label = f"line {name}, {part}"
            click.echo(f"{label:32} {which.sum():5d} {error:9.2f} {base:9.2f}")


def _wind_at(solved: TerrainWind, row: Floats, col: Floats, wind: tuple[float, float]) -> Floats:
    heights = np.full(len(row), HEIGHT_M)
    return np.asarray(local_wind(solved.responses_at(row, col, heights), *wind))


if __name__ == "__main__":
    main()
