"""Combine wind grids, or directions relative to grid north, with a weather stream."""

import math
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.physics.wind_field import MeanWind, WindGrids, mean_wind

MAX_WINDS = 10_000  # between two grids; all of these winds are in memory


class WindStack(NamedTuple):
    """Wind grids on a landscape, and their times."""

    at_s: tuple[float, ...]  # (grids) in ascending order, the first at 0 s or earlier
    grids: WindGrids  # in m/s at 20 ft


def with_wind_stack(
    weather: WeatherStream, stack: WindStack, landscape: Landscape, interval_s: float
) -> WeatherStream:
    """Return a weather stream with the wind from grids.

    Between two grids, the wind vectors of each cell are interpolated linearly at multiples of
    ``interval_s`` after the first of them; each wind is used until the next. The last grid is used
    until the end. An entry's wind is the mean over the landscape (``mean_wind``). Moistures and
    source are taken from ``weather``.

    Raises:
        FireModelError: More than ``MAX_WINDS`` winds would be interpolated between two grids.
    """
    times = sorted({*_times(stack, interval_s), *(entry.at_s for entry in weather.entries)})
    winds: dict[float, MeanWind] = {}
    entries = []
    for at_s in times[max(bisect_right(times, 0.0) - 1, 0) :]:
        wind_at_s = _wind_time(stack, interval_s, at_s)
        if wind_at_s not in winds:
            winds[wind_at_s] = mean_wind(stack.grids, _shares(stack.at_s, wind_at_s))
        mean = winds[wind_at_s]
        toward_deg = float(landscape.true_deg(mean.toward_grid_deg))
        entries.append(
            replace(
                weather.weather_at(at_s),
                at_s=at_s,
                wind_speed_m_s=mean.speed_m_s,
                wind_from_deg=(toward_deg + 180.0) % 360.0,
                wind_field=mean.field,
            )
        )
    source = weather.source
    if source is not None and source.humidity_pct is not None:
        of_entries = (source.humidity_pct[weather.index_at(entry.at_s)] for entry in entries)
        source = source._replace(humidity_pct=tuple(of_entries))
    return WeatherStream(entries, source)


def from_grid_north(weather: WeatherStream, landscape: Landscape) -> WeatherStream:
    """Return a weather stream with its wind directions converted from grid north to true north.

    The directions are in degrees clockwise. The convergence is that at the landscape's centre.
    """
    return WeatherStream(
        [
            replace(entry, wind_from_deg=float(landscape.true_deg(entry.wind_from_deg)))
            for entry in weather.entries
        ],
        weather.source,
    )


def _times(stack: WindStack, interval_s: float) -> Iterator[float]:
    """Yield the times of the grids, and the times at which winds are interpolated."""
    for before_s, after_s in pairwise(stack.at_s):
        winds = (after_s - before_s) / interval_s
        if winds > MAX_WINDS:
            raise FireModelError(
                f"wind grids at {before_s:g} s and {after_s:g} s: at most {MAX_WINDS:,} winds are "
                "interpolated between two grids; correct the times, or set a longer interval_s"
            )
        yield from (before_s + count * interval_s for count in range(math.ceil(winds)))
    yield stack.at_s[-1]


def _wind_time(stack: WindStack, interval_s: float, at_s: float) -> float:
    """Return the time of the wind in effect at ``at_s``: the last of ``_times`` up to then."""
    before_s = stack.at_s[max(bisect_right(stack.at_s, at_s) - 1, 0)]
    if before_s == stack.at_s[-1]:
        return before_s
    return before_s + max((at_s - before_s) // interval_s, 0.0) * interval_s


def _shares(at_s: tuple[float, ...], time_s: float) -> tuple[tuple[int, float], ...]:
    """Return the grids before and after a time, and their weights."""
    before = max(bisect_right(at_s, time_s) - 1, 0)
    if time_s <= at_s[before]:
        return ((before, 1.0),)
    share = (time_s - at_s[before]) / (at_s[before + 1] - at_s[before])
    return ((before, 1.0 - share), (before + 1, share))
