"""Prediction of each mapped perimeter of the Maria fire: ``python -m benchmarks.maria``.

The data are airborne infrared perimeters (California, 2019) with the weather recorded for each
(moistures, and wind at 20 ft, or at 10 m with ``--wind-10m``), and LANDFIRE layers. For each pair
of consecutive perimeters the fire of this package starts along the first perimeter and burns in the
weather of that perimeter until the time of the second. Persistence, an unchanged perimeter, is the
reference.

The benchmark prints the intersection over union with the second perimeter, and the ratio of the
predicted to the observed area, both for the whole area and for the newly burned area. The wind is
converted from true north to grid north; the two differ by 14 degrees in this grid.
"""

from dataclasses import replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from benchmarks.shared import check_folder, data_parser, overlap
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.rasters import read_landscape
from firemodel.landscape.readers.shapes import into_crs
from firemodel.physics.rothermel import M_S_PER_MPH
from firemodel.physics.weather import Weather, WeatherStream, wind_20ft_from_10m
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_perimeter

LAYERS = {
    "fuel": "fuel",
    "elevation": "elevation",
    "slope": "slope",
    "aspect": "aspect",
    "canopy_cover": "cover",
    "canopy_height": "height",
    "canopy_base": "base",
}
UNITS = {
    "slope": "degrees",
    "canopy_cover": "percent",
    "canopy_height": "m*10",
    "canopy_base": "m*10",
}
FIELDS = ("YYYYMMDD", "24_HHMMSS", "type", "windspeed", "winddirec", "1hr", "10hr", "100hr")
LIVE = ("herb", "woody")
GROWN = 1.1  # minimum ratio of the areas of two perimeters of a growing fire


class Mapped(NamedTuple):
    """A perimeter and the weather recorded for it."""

    at: datetime
    area: BaseGeometry  # in the landscape's CRS
    weather: Weather  # wind direction from true north


class Scores(NamedTuple):
    """Scores of one interval."""

    whole: float
    persistence: float
    new: float
    bias: float
    new_bias: float


def read_maria(folder: Path) -> tuple[Landscape, list[Mapped]]:
    """Read the landscape and its perimeters in order of time, without duplicates."""
    files = {layer: folder / f"Maria2019-{name}.tif" for layer, name in LAYERS.items()}
    landscape = read_landscape(files, units=UNITS)
    return landscape, read_perimeters(folder / "firis_perimeters.shp", landscape)


def read_perimeters(path: Path, landscape: Landscape) -> list[Mapped]:
    """Read the perimeters from flights, without the perimeter from a newspaper's map."""
    import pyogrio

    meta, _, shapes, columns = pyogrio.raw.read(path, columns=[*FIELDS, *LIVE])
    names = list(meta["fields"])
    found: dict[datetime, Mapped] = {}
    for number, wkb in enumerate(shapes):
        of = {name: column[number] for name, column in zip(names, columns, strict=True)}
        if of["type"] != "perim":
            continue
        at = datetime.strptime(f"{of['YYYYMMDD']} {of['24_HHMMSS']}", "%Y%m%d %H:%M:%S")  # noqa: DTZ007
        area = into_crs(shapely.make_valid(shapely.from_wkb(wkb)), meta["crs"], landscape.crs)
        moistures = (float(of[name]) for name in (*FIELDS[-3:], *LIVE))
        weather = Weather(0.0, of["windspeed"] * M_S_PER_MPH, float(of["winddirec"]), *moistures)
        found[at] = Mapped(at, area, weather)
    return [found[at] for at in sorted(found)]


def predict(landscape: Landscape, now: Mapped, weather: Weather, for_s: float) -> BaseGeometry:
    """Return the predicted burned area ``for_s`` after a perimeter."""
    burning = burning_from_perimeter([now.area], landscape, 0.0)
    fire = AnyAngleFire(landscape, WeatherStream([weather]), [], burning)
    fire.advance(for_s)
    # The union keeps the edge of the perimeter where the front did not move.
    area: BaseGeometry = fire.front(for_s).buffer(0.0).union(now.area)
    return area


def scores(now: BaseGeometry, then: BaseGeometry, found: BaseGeometry) -> Scores:
    """Return the scores of ``found``, which was predicted from ``now`` for the time of ``then``."""
    new, found_new = then.difference(now), found.difference(now)
    return Scores(
        overlap(found, then),
        overlap(now, then),
        overlap(found_new, new),
        found.area / then.area,
        found_new.area / new.area,
    )


def main() -> None:
    """Print one line for each interval, and the means."""
    parser = data_parser(__doc__)
    parser.add_argument("--wind-10m", action="store_true", help="the recorded wind is at 10 m")
    parser.add_argument("--wind-factor", type=float, default=1.0, help="factor of the wind speed")
    given = parser.parse_args()
    landscape, mapped = read_maria(check_folder(given.data / "maria_2019"))
    click.echo("from           min   km2  new km2  IoU  persist  new IoU   bias  new bias")
    found: list[Scores] = []
    for now, then in pairwise(mapped):
        wind_m_s = float(now.weather.wind_speed_m_s * given.wind_factor)
        weather = replace(
            now.weather,
            wind_speed_m_s=float(wind_20ft_from_10m(wind_m_s)) if given.wind_10m else wind_m_s,
        )
        for_s = (then.at - now.at).total_seconds()
        one = scores(now.area, then.area, predict(landscape, now, weather, for_s))
        found.append(one)
        click.echo(
            f"{now.at:%m-%d %H:%M} {for_s / 60:6.0f} {then.area.area / 1e6:6.2f} "
            f"{then.area.difference(now.area).area / 1e6:6.2f} {one.whole:7.3f} "
            f"{one.persistence:7.3f} {one.new:8.3f} {one.bias:7.2f} {one.new_bias:8.2f}"
        )
    for name, some in (
        ("all", found),
        ("grown by a tenth", [one for one in found if one.persistence < 1.0 / GROWN]),
        ("the others", [one for one in found if one.persistence >= 1.0 / GROWN]),
    ):
        mean = Scores(*np.mean(some, axis=0))
        click.echo(
            f"mean of {len(some):2}, {name:20} {mean.whole:7.3f} {mean.persistence:7.3f} "
            f"{mean.new:8.3f} {mean.bias:7.2f} {mean.new_bias:8.2f}"
        )


if __name__ == "__main__":
    main()
