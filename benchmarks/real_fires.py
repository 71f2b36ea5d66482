"""Simulate real fires by ``fire run``: ``python -m benchmarks.real_fires FIRE FOLDER``.

FIRE and its FOLDER, a checkout of a public repository unless stated otherwise:

- sandiego: hahmed17/FARSITE_demo. FARSITE's own perimeters of a fire in San Diego County (2025)
  after 30, 60 and 90 minutes, from its landscape (.lcp), inputs file and ignition (Shapefile). The
  .lcp declares slopes in degrees, and FARSITE reads them so; according to the elevation they are in
  percent. The weather is constant; a fire with the acceleration of a line source is therefore the
  fire 200 s earlier (``firemodel.physics.acceleration``).
- belgium: data/handson/Instances_Belgium of fire2a/C2F-W. Four fires of 2025 with mapped burned
areas, ASCII grids of fuel and elevation, Cell2Fire's weather, and the moistures D2L2 of Scott &
Burgan. The time of suppression is not known; the fire burns until the end of the weather.
- tubbs: cases/Validation/landscape_scale/tubbs_fire of berkeley-firelab/ELMFIRE_VnV_Suite. The
  Tubbs fire (California, 2017), GeoTIFFs in a projection on a sphere, hourly wind and moistures as
  the means of ELMFIRE's rasters; buildings (code 256) do not burn. The rows of 6 h (5.5 h after the
  ignition) and of 12 h are compared with the concave hull of the VIIRS detections of the first and
  of the first two half-days, as the repository does; kappa is Cohen's, over the landscape.
- maria: ../shared/data/maria_2019. The Maria fire from each mapped perimeter to the next.

Each run is a process ``mission-service fire run`` on a scenario that names the original files. The
benchmark prints the intersection over union of the simulated fire and of persistence (an unchanged
initial perimeter) with the reference, and the ratio of the areas.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
import pyogrio
import shapely
from shapely.geometry import shape
from shapely.geometry.base import BaseGeometry

from benchmarks.shared import check_folder, overlap
from firemodel.landscape.readers.repairs import repaired
from firemodel.landscape.readers.shapes import features_of, into_crs

ALBERS = "EPSG:5070"
BELGIUM = "EPSG:3812"
LINE_LAG_S = 200.0  # time that a line source loses by acceleration
D2L2 = """dead_1h_pct = 6
dead_10h_pct = 7
dead_100h_pct = 8
live_herb_pct = 60
live_woody_pct = 90
"""


# Returns the fronts of a scenario, every so many seconds, in a CRS, each with its time in s.
Run = Callable[[str, float, str], list[tuple[float, Any]]]


class Row(NamedTuple):
    """One comparison; ``reference`` is None if there is nothing to compare with."""

    name: str
    found: BaseGeometry
    start: BaseGeometry
    reference: BaseGeometry | None
    landscape: BaseGeometry | None = None  # its extent, if kappa is to be computed


def kappa(found: BaseGeometry, reference: BaseGeometry, landscape: BaseGeometry) -> float:
    """Return Cohen's kappa of two areas on a landscape."""
    total = landscape.area
    here, there = (part.intersection(landscape).area / total for part in (found, reference))
    both = found.intersection(reference).intersection(landscape).area / total
    agree = 1.0 - here - there + 2.0 * both
    by_chance = here * there + (1.0 - here) * (1.0 - there)
    return (agree - by_chance) / (1.0 - by_chance)


def run_fire(
    changes: Sequence[str], scenario: str, every_s: float, crs: str
) -> list[tuple[float, Any]]:
    """Return each front of a scenario in a CRS, with its time in s, by a process ``fire run``.

    ``changes`` are keys and values as in ``fire run --set``.
    """
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "fire.toml", Path(folder) / "out"
        path.write_text(scenario, encoding="utf-8")
        overrides = [word for change in changes for word in ("--set", change)]
        program = [sys.executable, "-m", "mission_service.cli", "fire", "run"]
        done = subprocess.run(
            [*program, path, "-o", out, "--front-every", f"{every_s:g}", *overrides],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            sys.exit(done.stderr.strip())
        features = json.loads((out / "fronts.geojson").read_text(encoding="utf-8"))["features"]
    return [
        (
            float(each["properties"]["time_s"]),
            into_crs(shape(each["geometry"]), "EPSG:4326", crs).buffer(0.0),
        )
        for each in features
    ]


def place(x_m: float, y_m: float, crs: str) -> str:
    """Return the lines of a scenario for a place that is given in a CRS."""
    lon, lat = into_crs(shapely.Point(x_m, y_m), crs, "EPSG:4326").coords[0]
    return f"lat_deg = {lat}\nlon_deg = {lon}"


SLOPES = (("degrees", "unburnable"), ("percent", "refuse"))  # readings of the slope, and `missing`


def san_diego(folder: Path, run: Run, slopes: Sequence[tuple[str, str]] = SLOPES) -> Iterator[Row]:
    """Yield the comparisons with FARSITE's perimeters, for each reading of the slope."""
    case = folder / "tmp" / "0912a968d53d4a8a81ec57e3e2d79308"
    theirs = [repaired(line) for line in features_of(Path(f"{case}_out_Perimeters.shp"))[0]]
    (lit,) = features_of(Path(f"{case}_ignite.shp"))[0]
    for unit, missing in slopes:
        fronts = run(
            f"""name = "San Diego"
duration_s = 5400
[landscape]
source = "files"
file = "{folder / "landscape.lcp"}"
crs = "{ALBERS}"
units = {{slope = "{unit}"}}
missing = "{missing}"
[weather_file]
path = "{case}_config.cfg"
[fire]
perimeter = "{case}_ignite.shp"
""",
            LINE_LAG_S,
            ALBERS,
        )
        at = dict(fronts)
        for name, lag_s in ((f"slope in {unit}", 0.0), ("  with acceleration", LINE_LAG_S)):
            for number, their in enumerate(theirs, start=1):
                front = at[1800.0 * number - lag_s]
                yield Row(f"{name}, {30 * number} min", front, lit, their)


def belgium(folder: Path, run: Run) -> Iterator[Row]:
    """Yield the comparisons of each fire."""
    for case in sorted(each for each in folder.glob("Case*") if each.is_dir()):
        yield from belgian(case, run)


def belgian(case: Path, run: Run) -> Iterator[Row]:
    """Yield the comparison with the mapped area for each hour; persistence is the ignited cell."""
    header = (case / "fuels.asc").read_text(encoding="utf-8").split(maxsplit=10)
    cols, rows, west_m, south_m, cell_m = (float(text) for text in header[1:10:2])
    x_m, y_m = west_m + cols / 2 * cell_m, south_m + rows / 2 * cell_m
    hours = len((case / "Weather.csv").read_text(encoding="utf-8").split("\n")[1:]) - 1
    fronts = run(
        f"""name = "{case.name}"
duration_s = {hours * 3600}
[landscape]
source = "files"
fuel = "{case / "fuels.asc"}"
elevation = "{case / "elevation.asc"}"
missing = "unburnable"
[weather_file]
path = "{case / "Weather.csv"}"
{D2L2}
[[ignition]]
{place(x_m, y_m, BELGIUM)}
""",
        3600.0,
        BELGIUM,
    )
    scar = shapely.union_all(
        [repaired(each) for each in features_of(case / "ground_truth/observed_scar.shp")[0]]
    )
    cell = shapely.Point(x_m, y_m).buffer(cell_m / 2, cap_style="square")
    for at_s, front in fronts:
        yield Row(f"{case.name}, {at_s / 3600:.0f} h", front, cell, scar)


def tubbs(folder: Path, run: Run) -> Iterator[Row]:
    """Yield the simulated area of the Tubbs fire after each hour."""
    import rasterio

    data = folder / "data"
    names = ("ws", "wd", "m1", "m10", "m100")
    bands = {}
    for name in names:
        with rasterio.open(data / "weather" / f"{name}.tif") as file:
            bands[name] = file.read()
            crs, extent = file.crs.to_string(), shapely.box(*file.bounds)
    seen = viirs_areas(data / "viirs_observation" / "viirs_tubbs.shp", crs)
    turn = np.deg2rad(bands["wd"])
    from_deg = np.rad2deg(np.arctan2(np.sin(turn).mean((1, 2)), np.cos(turn).mean((1, 2)))) % 360
    mean = {name: values.mean((1, 2)) for name, values in bands.items()}
    weather = "".join(
        f"""[[weather]]
at_s = {hour * 3600}
wind_speed_m_s = {mean["ws"][hour] * 0.44704:.3f}
wind_from_deg = {from_deg[hour]:.1f}
dead_1h_pct = {mean["m1"][hour]:.2f}
dead_10h_pct = {mean["m10"][hour]:.2f}
dead_100h_pct = {mean["m100"][hour]:.2f}
live_herb_pct = 30
live_woody_pct = 60
"""
        for hour in range(12)
    )
    ground = data / "fuels_and_topography"
    files = "\n".join(
        f'{layer} = "{ground / name}.tif"'
        for layer, name in (
            *(("fuel", "fbfm40b"), ("elevation", "dem"), ("slope", "slp"), ("aspect", "asp")),
            *(("canopy_cover", "cc"), ("canopy_height", "ch"), ("canopy_base", "cbh")),
            ("canopy_bulk_density", "cbd"),
        )
    )
    fronts = run(
        f"""name = "Tubbs"
duration_s = 43200
[landscape]
source = "files"
{files}
fuel_codes = {{256 = 91}}
[landscape.units]
slope = "degrees"
canopy_cover = "percent"
canopy_height = "m*10"
canopy_base = "m*10"
canopy_bulk_density = "kg/m3*100"
{weather}
[[ignition]]
{place(6938.0, 343607.0, crs)}
at_s = 1800
""",
        7200.0,
        crs,
    )
    start = shapely.Point(6938.0, 343607.0).buffer(1.0)
    for at_s, front in fronts:
        reference = {21_600.0: seen[0], 43_200.0: seen[1]}.get(at_s)
        yield Row(f"{at_s / 3600:.0f} h", front, start, reference, extent)


def viirs_areas(path: Path, crs: str) -> list[BaseGeometry]:
    """Return the hull of the detections up to each half-day, in the landscape's CRS."""
    table, _, shapes, columns = pyogrio.raw.read(path)
    record = dict(zip(table["fields"], columns, strict=True))
    points, days = shapely.from_wkb(shapes), record["ACQ_DATE"].astype("datetime64[D]")
    half_days = days.astype(int) * 2 + (record["ACQ_TIME"].astype(int) >= 1200)
    return [
        into_crs(
            shapely.concave_hull(
                shapely.MultiPoint(points[half_days <= last]), ratio=0.5, allow_holes=True
            ),
            "EPSG:4326",
            crs,
        ).buffer(0.0)
        for last in np.unique(half_days)
    ]


def maria(folder: Path, run: Run) -> Iterator[Row]:
    """Yield the comparison of each interval between two mapped perimeters."""
    path = folder / "firis_perimeters.shp"
    areas, crs = features_of(path)
    table, _, _, columns = pyogrio.raw.read(path, read_geometry=False)
    record = dict(zip(table["fields"], columns, strict=True))
    times = {
        datetime.fromisoformat(f"{int(day)}T{clock}"): number
        for number, (day, clock, kind) in enumerate(
            zip(record["YYYYMMDD"], record["24_HHMMSS"], record["type"], strict=True)
        )
        if kind == "perim"
    }
    order = [(at, times[at]) for at in sorted(times)]
    layers = {
        "canopy_cover": "cover",
        "canopy_height": "height",
        "canopy_base": "base",
        "canopy_bulk_density": "density",
    }
    files = "\n".join(
        f'{layer} = "{folder}/Maria2019-{layers.get(layer, layer)}.tif"'
        for layer in ("fuel", "elevation", "slope", "aspect", *layers)
    )
    for (at, number), (then, later) in pairwise(order):
        wet = {name: record[name][number] for name in ("1hr", "10hr", "100hr", "herb", "woody")}
        fronts = run(
            f"""name = "Maria"
duration_s = {(then - at).total_seconds()}
[landscape]
source = "files"
{files}
[landscape.units]
slope = "degrees"
canopy_cover = "percent"
canopy_height = "m*10"
canopy_base = "m*10"
canopy_bulk_density = "kg/m3*100"
[[weather]]
at_s = 0
wind_speed_m_s = {record["windspeed"][number] * 0.44704}
wind_from_deg = {record["winddirec"][number]}
dead_1h_pct = {wet["1hr"]}
dead_10h_pct = {wet["10hr"]}
dead_100h_pct = {wet["100hr"]}
live_herb_pct = {wet["herb"]}
live_woody_pct = {wet["woody"]}
[fire]
perimeter = "{path}"
perimeter_feature = {number + 1}
repair_perimeter = true
""",
            86400.0,
            ALBERS,
        )
        now, reference = (
            into_crs(repaired(areas[each]), str(crs), ALBERS) for each in (number, later)
        )
        yield Row(
            f"{at:%m-%d %H:%M}, {(then - at).total_seconds() / 60:.0f} min",
            fronts[-1][1].union(now),
            now,
            reference,
        )


FIRES: dict[str, Callable[[Path, Run], Iterator[Row]]] = {
    "sandiego": san_diego,
    "belgium": belgium,
    "tubbs": tubbs,
    "maria": maria,
}


def main() -> None:
    """Print one line for each comparison, and the mean overlap."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("fire", choices=FIRES)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--set", action="append", default=[], help="as in fire run (repeatable)")
    given = parser.parse_args()
    click.echo(f"{'':30} {'ha':>9} {'IoU':>6} {'persist':>8} {'area':>6} {'kappa':>6}")
    scores = []
    run = partial(run_fire, given.set)
    for row in FIRES[given.fire](check_folder(given.folder).resolve(), run):
        line = f"{row.name:30} {row.found.area / 1e4:9.1f}"
        if row.reference is not None:
            both = overlap(row.found, row.reference), overlap(row.start, row.reference)
            scores.append(both)
            line += f" {both[0]:6.3f} {both[1]:8.3f} {row.found.area / row.reference.area:6.2f}"
            if row.landscape is not None:
                line += f" {kappa(row.found, row.reference, row.landscape):6.3f}"
        click.echo(line)
    if given.fire == "maria":
        mean = np.mean(scores, axis=0)
        click.echo(f"{'mean':30} {'':9} {mean[0]:6.3f} {mean[1]:8.3f}")


if __name__ == "__main__":
    main()
