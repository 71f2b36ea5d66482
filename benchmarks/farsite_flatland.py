"""Overlap with FARSITE's own perimeters: ``python -m benchmarks.farsite_flatland [--data ...]``.

FARSITE's flatland case: level ground, fuel model 1, 30 m cells, ignition as a polygon, and for
seven hours a wind of 3 mph from a constant or a turning direction. Conditions are those of its
.input files: initial moistures 3/4/6/70/100 %, dead fuel conditioned from the first weather record
on, and acceleration. The landscape has no trees and therefore no spotting.

Burned areas are compared after each hour (intersection over union), for the fire of this package
and for the exact solution. On level ground of one fuel the exact solution is the Minkowski sum of
the polygon and the ellipses of all periods. The lines of the table are:

- held: moistures stay at their initial values
- hourly: dead moistures are conditioned at each record, as by ``read_weather``
- 5 min: dead moistures are conditioned every 5 minutes
- point, line: hourly or 5 min, with an acceleration of 0.115 or 0.3 per minute (McAlpine & Wakimoto
  1989, as in FARSITE)
- implied: hourly moistures at which the head covers the same distance as FARSITE's in a constant
  wind, and the distance by which this exact solution reaches beyond FARSITE's area, every 22.5
  degrees from north (the corners of the ignition polygon point north, east, south and west)

The first lines of each case show FARSITE's highest spread rates by the minute in which cells
ignite.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from benchmarks.shared import check_folder, data_parser, overlap
from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.bands import band_of, missing_in, values_of
from firemodel.landscape.readers.rasters import read_landscape
from firemodel.landscape.readers.shapes import read_shapes
from firemodel.landscape.readers.weather_files import read_weather
from firemodel.physics.moisture import HOUR_S, TIME_LAGS_H, after_time_lag, equilibrium_moisture_pct
from firemodel.physics.rothermel import Moisture
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_perimeter
from tests.firemodel.spread_fields import spread_fields

CASES = (
    *("3mph0deg7hr", "3mph60deg7hr", "3mph120deg7hr", "3mph180deg7hr"),
    *("clockwise1hr", "clockwise3hr"),
)
STEADY = CASES[0]  # towards the south
START = datetime(2013, 4, 26, 12)  # noqa: DTZ001  # without a UTC offset, as in the files
FIRST = Moisture(0.03, 0.04, 0.06, 0.70, 1.00)
TEMPERATURE_C, HUMIDITY_PCT = 25.0, 25.0  # conditions in every record
STEP_S = 300.0
HOURS = 7
NORMALS_RAD = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
POINT_PER_MIN, LINE_PER_MIN = 0.115, 0.3
BINS_MIN = (5, 10, 20, 30, *range(60, 421, 60))


class Stretch(NamedTuple):
    """A period with a constant ellipse."""

    upto_s: float
    head_m: float  # distance covered by the head
    toward_rad: float
    eccentricity: float


def outline(area: BaseGeometry) -> Floats:
    """Return the outermost vertex of a convex polygon in each direction, (n, 2) as (x, y)."""
    vertices = shapely.get_coordinates(area)
    outward = np.stack([np.sin(NORMALS_RAD), np.cos(NORMALS_RAD)])
    return np.asarray(vertices[np.argmax(vertices @ outward, axis=0)])


def ellipse(stretch: Stretch) -> Floats:
    """Return the outermost point in each direction, (n, 2), of an ellipse lit in a focus."""
    half_length = stretch.head_m / (1.0 + stretch.eccentricity)
    half_width = half_length * math.sqrt(1.0 - stretch.eccentricity**2)
    off_rad = NORMALS_RAD - stretch.toward_rad
    along, across = np.cos(off_rad), np.sin(off_rad)
    reach = np.hypot(half_length * along, half_width * across)
    forward = half_length**2 * along / reach + half_length * stretch.eccentricity
    lateral = half_width**2 * across / reach
    sin, cos = math.sin(stretch.toward_rad), math.cos(stretch.toward_rad)
    return np.stack([forward * sin + lateral * cos, forward * cos - lateral * sin], axis=1)


def exact(lit: BaseGeometry, stretches: Sequence[Stretch]) -> list[BaseGeometry]:
    """Return the exact burned area after each hour."""
    points = outline(lit)
    found: list[BaseGeometry] = []
    for stretch in stretches:
        points = points + ellipse(stretch)
        if stretch.upto_s % HOUR_S == 0.0:
            found.append(Polygon(points).buffer(0.0))
    return found


def stretches_of(
    landscape: Landscape, stream: WeatherStream, per_min: float | None = None
) -> list[Stretch]:
    """Return the period of each weather entry.

    With ``per_min`` the spread rate accelerates: t minutes after the ignition it is the fraction
    1 - exp(-per_min t) of the steady rate.
    """
    found = []
    ends_s = [*stream.change_times(), HOURS * HOUR_S]
    for entry, end_s in zip(stream.entries, ends_s, strict=True):
        rate, toward, e = (float(field[0, 0]) for field in spread_fields(landscape, entry))
        lost_s = 0.0
        if per_min:
            begin, end = (math.exp(-per_min * at_s / 60.0) for at_s in (entry.at_s, end_s))
            lost_s = (begin - end) / per_min * 60.0
        found.append(Stretch(end_s, rate * (end_s - entry.at_s - lost_s), toward, e))
    return found


def followed(stream: WeatherStream) -> WeatherStream:
    """Return the stream with the same wind, and dead moistures conditioned every ``STEP_S``."""
    dry = np.full(3, equilibrium_moisture_pct(TEMPERATURE_C, HUMIDITY_PCT))
    first = 100.0 * np.array(FIRST.classes[:3])
    entries: list[Weather] = []
    for at_s in np.arange(0.0, HOURS * HOUR_S, STEP_S):
        middle_h = (at_s + 0.5 * STEP_S) / HOUR_S
        dead = after_time_lag(first, dry, middle_h, TIME_LAGS_H)
        names = ("dead_1h_pct", "dead_10h_pct", "dead_100h_pct")
        given: dict[str, Any] = dict(zip(names, map(float, dead), strict=True))
        entries.append(replace(stream.weather_at(float(at_s)), at_s=float(at_s), **given))
    return WeatherStream(entries)


def with_moisture(stream: WeatherStream, one_hour_pct: Sequence[float]) -> WeatherStream:
    """Return the stream with given hourly moistures of 1-h fuel, the only class of fuel model 1."""
    return WeatherStream(
        [
            replace(stream.weather_at(hour * HOUR_S), at_s=hour * HOUR_S, dead_1h_pct=pct)
            for hour, pct in enumerate(one_hour_pct)
        ]
    )


def implied_pct(landscape: Landscape, lit: BaseGeometry, areas: list[BaseGeometry]) -> list[float]:
    """Return the hourly moistures at which the head moves as far south as FARSITE's."""
    south_m = [lit.bounds[1], *(area.bounds[1] for area in areas)]
    tried = np.arange(2.0, 12.0, 0.05)
    calm = Weather(0.0, 0.0, 0.0, 0.0, *(100.0 * part for part in FIRST.classes[1:]))
    wind_m_s = 3 * 0.44704
    rates = [
        spread_fields(landscape, replace(calm, wind_speed_m_s=wind_m_s, dead_1h_pct=pct))[0][0, 0]
        for pct in tried
    ]
    comes_m = -HOUR_S * np.array(rates)  # rises with moisture
    return [float(pct) for pct in np.interp(np.diff(south_m), comes_m, tried)]


def gaps_m(area: BaseGeometry, within: BaseGeometry) -> list[float]:
    """Return the distances in m by which one convex area exceeds another, in 16 directions."""
    bearing = np.deg2rad(np.arange(0.0, 360.0, 22.5))
    outward = np.stack([np.sin(bearing), np.cos(bearing)])
    reach, other = ((shapely.get_coordinates(one) @ outward).max(axis=0) for one in (area, within))
    return [float(gap) for gap in reach - other]


def ours(landscape: Landscape, stream: WeatherStream, lit: BaseGeometry) -> list[BaseGeometry]:
    """Return the burned area of this package's fire after each hour."""
    fire = AnyAngleFire(landscape, stream, [], burning_from_perimeter([lit], landscape, 0.0))
    found = []
    for hour in range(1, HOURS + 1):
        fire.advance(hour * HOUR_S)
        found.append(fire.front(hour * HOUR_S))
    return found


def farsites(folder: Path, case: str, landscape: Landscape) -> list[BaseGeometry]:
    """Return FARSITE's burned area after each hour."""
    path = folder / "Outputs" / f"flatland_centerIgnit_{case}_RAWS_Perimeters.shp"
    return [Polygon(line.coords) for line in read_shapes(path, landscape, crs=landscape.crs)]


def grid_values(path: Path) -> Floats:
    """Return the values (y, x) of a raster; cells without a value are NaN."""
    band = band_of(path)
    values = values_of(band)
    return np.where(missing_in(band, values), np.nan, values)


def fastest_m_min(folder: Path, case: str) -> list[float]:
    """Return FARSITE's highest spread rate between each two of the times ``BINS_MIN``."""
    name = f"flatland_centerIgnit_{case}_RAWS"
    arrival_min = grid_values(folder / "Outputs" / f"{name}_ArrivalTime.asc")
    rate_m_min = grid_values(folder / "Outputs" / f"{name}_SpreadRate.asc")
    return [
        float(np.nanmax(rate_m_min[(arrival_min > begin) & (arrival_min <= end)]))
        for begin, end in pairwise(BINS_MIN)
    ]


def read_case(folder: Path, case: str, *, conditioned: bool) -> WeatherStream:
    """Return the weather of a case; it ends an hour after its last record."""
    path = folder / "Inputs" / "d_weatherFiles" / f"flatland_{case}.raws"
    stream = read_weather(path, start=START, moisture=FIRST, conditioned=conditioned)
    return WeatherStream(stream.entries[:HOURS])


def row(name: str, values: Sequence[float], places: int = 3) -> str:
    """Return one line of the table."""
    return f"  {name:22}" + " ".join(f"{value:6.{places}f}" for value in values) + "\n"


def main() -> None:
    """Print the table of each case."""
    folder = check_folder(data_parser(__doc__).parse_args().data / "farsite_flatland")
    landscape = read_landscape(folder / "Inputs" / "a_lcpFiles" / "flatland.lcp")
    ignition = folder / "Inputs" / "b_ignitionFiles" / "flatland_centerIgnit.shp"
    (lit,) = read_shapes(ignition, landscape)
    implied = implied_pct(landscape, lit, farsites(folder, STEADY, landscape))
    followed_pct = [
        entry.dead_1h_pct for entry in read_case(folder, STEADY, conditioned=True).entries
    ]
    steady, *_ = stretches_of(landscape, read_case(folder, STEADY, conditioned=False))
    click.echo(f"head at the first moistures: {steady.head_m / steady.upto_s * 60:.2f} m/min")
    click.echo(row("1-h moisture, implied", implied, 2), nl=False)
    click.echo(row("1-h moisture, hourly", followed_pct, 2), nl=False)
    for case in CASES:
        held = read_case(folder, case, conditioned=False)
        hourly = read_case(folder, case, conditioned=True)
        minutes = followed(held)
        theirs = farsites(folder, case, landscape)
        click.echo(f"{case}")
        click.echo(row("  minutes, up to", BINS_MIN[1:], 0), nl=False)
        click.echo(row("  FARSITE, m/min", fastest_m_min(folder, case), 2), nl=False)
        lines: dict[str, tuple[WeatherStream, float | None]] = {
            "held": (held, None),
            "hourly": (hourly, None),
            "5 min": (minutes, None),
            "hourly, point": (hourly, POINT_PER_MIN),
            "hourly, line": (hourly, LINE_PER_MIN),
            "5 min, point": (minutes, POINT_PER_MIN),
            "5 min, line": (minutes, LINE_PER_MIN),
            "implied": (with_moisture(held, implied), None),
        }
        for name, (stream, per_min) in lines.items():
            answer = exact(lit, stretches_of(landscape, stream, per_min))
            both = zip(answer, theirs, strict=True)
            click.echo(row(f"{name}, exact", [overlap(*pair) for pair in both]), nl=False)
            if per_min is None:
                found = ours(landscape, stream, lit)
                both = zip(found, theirs, strict=True)
                click.echo(row(f"{name}, this fire", [overlap(*pair) for pair in both]), nl=False)
                both = zip(found, answer, strict=True)
                click.echo(row("  these two", [overlap(*pair) for pair in both]), nl=False)
        for hour in (1, HOURS):
            gaps = gaps_m(answer[hour - 1], theirs[hour - 1])
            click.echo(row(f"  beyond FARSITE, m, {hour} h", gaps, 0), nl=False)


if __name__ == "__main__":
    main()
