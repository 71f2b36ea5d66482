"""Compute, in closed form, the arrival times of a fire that grows as ellipses from points.

The model is taken from section IV of Beachly et al. ("Fire-Aware Planning of Aerial Trajectories
and Ignitions"), with corrections to eqs. 1 and 2. With the spread rates ``head``, ``back`` and
``flank``, the ellipse of a point ignition extends after a time t from ``-back t`` to ``head t``
along the wind and ``flank t`` to each side. Fuel, moisture and wind are the same everywhere and the
ground is level. An ignition line is represented by a series of points (``line_ignitions``).

If the wind changes, each point of the front starts its own ellipse (Huygens). The burned area is
then the Minkowski sum of the ellipses of all wind periods. A point at the vector d from the source
lies inside the burned area as soon as d·n <= Σ τ_i h_i(n) for every direction n, where τ_i is the
elapsed part of wind period i, and h_i the support function of the ellipse in this period. The
arrival time is therefore the maximum over n of the time at which both sides are equal. That time
has a closed form and, as a function of n, only one maximum (``ellipse_kernels.reach``).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.ellipses.ellipse_kernels import Bounds, changing, steady, to_plane
from firemodel.ellipses.tiles import Tiles, check_finite, tiles_of
from firemodel.errors import FireModelError
from firemodel.physics.fuels import FUEL_MODELS, FuelModel
from firemodel.physics.rothermel import FT_MIN_PER_M_S, fuel_bed, wind_factor
from firemodel.physics.weather import WeatherStream, wind_adjustment_factor

TILE = 64  # average number of points in a tile
DIRECTIONS = 12  # number of directions in which the distance that fire covers is bounded

Places = NDArray[np.int32]


class Spread(NamedTuple):
    """The rates of spread in m/s with, against and across the wind, from ``from_s`` on.

    ``toward_rad`` is the direction toward which the wind blows, in radians anticlockwise from grid
    east.
    """

    from_s: float
    head_m_s: float
    back_m_s: float
    flank_m_s: float
    toward_rad: float


def spreads_of(
    fuel: int,
    weather: WeatherStream,
    grid_deg: Callable[[float], float] = float,
    fuels: Mapping[int, FuelModel] = FUEL_MODELS,
) -> tuple[Spread, ...]:
    """Return Rothermel's spread rates for one fuel model on level ground, at each weather change.

    As in section IV of Beachly et al., the back and the flanks spread at the no-wind rate. The wind
    at 20 ft is reduced to midflame height for unsheltered fuel. The moistures are those of this
    fuel in the weather, without zones. ``grid_deg`` converts a direction from true north to grid
    north (``Landscape.grid_deg``); by default the two are assumed to be the same. ``fuels`` are the
    fuel models by code (``Landscape.fuels``). Raises FireModelError for an unknown fuel.
    """
    if fuel not in fuels:
        raise FireModelError(
            f"fuel model {fuel}: unknown; use a fuel model of Anderson or of Scott & Burgan, or "
            "one of the landscape's custom fuels"
        )
    model = fuels[fuel]
    factor = float(wind_adjustment_factor(model.depth_ft))
    found = []
    for entry in weather.changes():
        bed = fuel_bed(model, replace(entry, of_zones=()).moisture_of(fuel))
        still_m_s = bed.no_wind_rate_ft_min / FT_MIN_PER_M_S
        wind_ft_min = entry.wind_speed_m_s * factor * FT_MIN_PER_M_S
        head_m_s = still_m_s * (1.0 + float(wind_factor(bed, wind_ft_min)))
        toward_rad = math.radians((90.0 - grid_deg(entry.wind_from_deg + 180.0)) % 360.0)
        found.append(Spread(entry.at_s, head_m_s, still_m_s, still_m_s, toward_rad))
    return tuple(found)


class EllipseFire:
    """A fire that spreads from point ignitions, with the rates in ``spreads``.

    The ignitions are ``sources`` (m, 3), given as x, y, at_s; there may be none. The first element
    of ``spreads`` also applies before its ``from_s``. A source lit inside the burned area has no
    effect.
    """

    def __init__(self, spreads: Sequence[Spread], sources: Floats) -> None:
        """Raise FireModelError for invalid rates, times or positions."""
        self.spreads = tuple(spreads)
        self.sources = _checked(sources)
        self._table = _table(self.spreads)

    def lit(self, sources: Floats) -> "EllipseFire":
        """Return the same fire with sources (k, 3) added."""
        more = EllipseFire.__new__(EllipseFire)
        more.spreads, more._table = self.spreads, self._table
        more.sources = np.concatenate([self.sources, _checked(sources)])
        return more

    def ignition_time_s(self, points_m: Floats) -> Floats:
        """Return the arrival times (n,) in s at points (n, 2) in metres; infinity if unburned."""
        return self.arrivals(points_m, with_sources=False)[0]

    def sources_of(self, points_m: Floats) -> Places:
        """Return the index (n,) of the source whose fire first reaches each point (n, 2), or -1."""
        return self.arrivals(points_m, with_sources=True)[1]

    def arrivals(self, points_m: Floats, with_sources: bool = True) -> tuple[Floats, Places]:
        """Return the results of ``ignition_time_s`` and ``sources_of``, computed in one pass.

        Without ``with_sources`` the second array is empty.
        """
        points: Any = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 2)
        one = len(self._table) == 1 and self.spreads[0].head_m_s > 0.0
        sources = self.sources
        if one:
            matrix, e = _plane(self.spreads[0])
            origin = sources[0] if len(sources) else np.zeros(2)
            points, given = np.empty_like(points), points
            check_finite(given, to_plane(given, origin, matrix, points))
            sources = sources.copy()
            to_plane(self.sources, origin, matrix, sources)
        tiles = tiles_of(points, TILE)
        count, most = len(sources), tiles.levels + 1
        best_s = np.full(len(tiles.x), np.inf)
        first = np.full(len(tiles.x) if with_sources else 0, -1, dtype=np.int32)
        kept = np.empty((most, count), dtype=np.int32)
        kept[0] = np.arange(count)
        counts, at = np.full(most, count), np.full(most, -1)
        if count == 0:
            pass
        elif one:
            steady(sources, e, tiles, kept, counts, at, np.empty(count), best_s, first)
        else:
            lit_in = np.searchsorted(self._table[:, 0], sources[:, 2], side="right") - 1
            lit_in = np.maximum(lit_in, 0)
            bounds = _bounds(self._table, sources[:, 2], lit_in)
            changing(
                *(sources, lit_in, self._table, bounds, tiles, kept, counts, at),
                *(np.zeros((count, 2)), best_s, first),
            )
        return _in_order(best_s, tiles), _in_order(first, tiles) if with_sources else first


def _checked(sources: Floats) -> Floats:
    given = np.asarray(sources, dtype=np.float64)
    if given.size == 0:
        return np.empty((0, 3))
    if given.ndim != 2 or given.shape[1] != 3:
        raise FireModelError(
            f"sources have the shape {given.shape}, but must have (count, 3): x, y, at_s"
        )
    wrong = ~np.isfinite(given).all(axis=1)
    if wrong.any():
        place = int(np.argmax(wrong))
        raise FireModelError(
            f"source {place}: x, y, at_s = {given[place].tolist()}; all must be finite"
        )
    return np.ascontiguousarray(given)


def _table(spreads: Sequence[Spread]) -> Floats:
    """Return the spreads as a table (changes, 6).

    The columns of the table are from_s, the velocity c (x, y) of the ellipse's centre in m/s, and
    the matrix Q (xx, xy, yy).

    The support function of the ellipse is h(n) = c·n + √(n·Qn).
    """
    if not spreads:
        raise FireModelError("no spreads; specify at least one")
    rows: list[tuple[float, ...]] = []
    for number, spread in enumerate(spreads):
        rates = spread[1:4]
        alike = all(rate > 0.0 for rate in rates) or all(rate == 0.0 for rate in rates)
        if not alike or not all(map(math.isfinite, spread)):
            raise FireModelError(
                f"spread {number}: {spread}: rates must be positive, or all 0 where nothing burns"
            )
        if rows and not spread.from_s > rows[-1][0]:
            raise FireModelError(
                f"spread {number}: from_s = {spread.from_s} is not later than the previous"
            )
        cos, sin = math.cos(spread.toward_rad), math.sin(spread.toward_rad)
        centre = (spread.head_m_s - spread.back_m_s) / 2.0
        long2, wide2 = ((spread.head_m_s + spread.back_m_s) / 2.0) ** 2, spread.flank_m_s**2
        rows.append(
            (
                *(spread.from_s, centre * cos, centre * sin),
                *(long2 * cos * cos + wide2 * sin * sin, (long2 - wide2) * cos * sin),
                long2 * sin * sin + wide2 * cos * cos,
            )
        )
    return np.array([row for k, row in enumerate(rows) if not k or row[1:] != rows[k - 1][1:]])


def _bounds(table: Floats, lit_s: Floats, lit_in: NDArray[np.int64]) -> Bounds:
    """Return bounds for sources lit at the times ``lit_s`` (n,), in the periods ``lit_in`` (n,)."""
    angles = np.arange(DIRECTIONS) * (2.0 * math.pi / DIRECTIONS)
    nx, ny = np.cos(angles), np.sin(angles)
    from_s, cx, cy, xx, xy, yy = table.T[:, :, None]
    speeds = cx * nx + cy * ny + np.sqrt(xx * nx * nx + 2.0 * xy * nx * ny + yy * ny * ny)
    begins_m = np.zeros_like(speeds)
    np.cumsum(speeds[:-1] * np.diff(from_s, axis=0), axis=0, out=begins_m[1:])
    lit_m = begins_m[lit_in] + speeds[lit_in] * (lit_s[:, None] - from_s[lit_in])
    last = np.zeros(len(lit_s), dtype=np.int64)
    return Bounds(np.column_stack([nx, ny]), speeds, begins_m, lit_m, np.empty(DIRECTIONS), last)


def _in_order(found: Any, tiles: Tiles) -> Any:
    """Reorder values from the order of the tiles to the order of the points."""
    given = np.empty_like(found)
    given[tiles.order] = found
    return given


def _plane(spread: Spread) -> tuple[Floats, float]:
    """Return M and e such that fire reaches (x, y) after |d| - e d_x, where d = (x, y) M.

    The position (x, y) is relative to the source.

    This time is the solution t of (p - c t)² / a² + q² / b² = t², where p is the distance along the
    wind and q the distance across it.
    """
    a, b = (spread.head_m_s + spread.back_m_s) / 2.0, spread.flank_m_s
    e = (spread.head_m_s - spread.back_m_s) / (2.0 * a)
    k = spread.head_m_s * spread.back_m_s / (a * a)  # 1 - e²
    cos, sin = math.cos(spread.toward_rad), math.sin(spread.toward_rad)
    turn = np.array([[cos, -sin], [sin, cos]])
    return turn / (a * k, b * math.sqrt(k)), e
