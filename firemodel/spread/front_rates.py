"""Compute the speed at which each part of a fire front moves outward along its normal."""

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.compiled import compiled
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.spread.local_spread import (
    FIRST_GRID,
    Tables,
    Terrain,
    slowness_of,
    tables_of,
    terrain_of,
)
from firemodel.spread.rate_options import SURFACE_ONLY, RateOptions

Integers = NDArray[np.int64]


class FrontRates:
    """The spread rates of fronts on a landscape, in the given weather or in a measured wind."""

    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        options: RateOptions = SURFACE_ONLY,
    ) -> None:
        self._landscape = landscape
        self._weather = weather
        self._terrain = terrain_of(landscape, weather.entries, options)
        self._tables = tables_of(landscape, weather.entries, options)

    def speeds_m_s(
        self, rows: Integers, cols: Integers, north: Floats, east: Floats, at_s: float
    ) -> Floats:
        """Return the speed (n,) in m/s at which the front in each cell moves along its own normal.

        Args:
            rows, cols: The cells (n).
            north, east: Outward normals of the front in these cells (n), unit vectors on the grid.
            at_s: The time whose weather applies.

        The speed is 0 where fire does not spread. The speed is the support function of the ellipse
        A |v| - B v = 1 in the direction (north, east) (Huygens). |v| is measured on the slope; A
        and B are those of ``local_spread``.
        """
        entry = self._weather.index_at(at_s)
        return self._rates(self._tables, entry, rows.size).speeds_m_s(rows, cols, north, east)

    def under_wind(
        self,
        rows: Integers,
        cols: Integers,
        north: Floats,
        east: Floats,
        at_s: float,
        wind: tuple[float, float],
    ) -> Floats:
        """Return speeds as ``speeds_m_s`` does, but in the given wind (see ``in_wind``)."""
        return self.in_wind(at_s, wind, rows.size).speeds_m_s(rows, cols, north, east)

    def in_wind(self, at_s: float, wind: tuple[float, float], room: int) -> "SteadyRates":
        """Return the rates in a given wind, for repeated calls with at most ``room`` places.

        ``wind`` is the speed in m/s at 20 ft and the direction in degrees from which the wind
        blows. With a wind field, the given wind replaces the entry's wind.
        """
        entry = self._weather.index_at(at_s)
        toward = np.deg2rad(self._landscape.grid_deg(wind[1] + 180.0))
        blowing = self._tables.wind[entry : entry + 1].copy()
        blowing[0, :FIRST_GRID] = wind[0], np.cos(toward), np.sin(toward)
        tables = self._tables._replace(terms=self._tables.terms[entry : entry + 1], wind=blowing)
        return self._rates(tables, 0, room)

    def _rates(self, tables: Tables, entry: int, room: int) -> "SteadyRates":
        return SteadyRates(self._landscape.shape[1], self._terrain, tables, entry, room)


class SteadyRates:
    """The spread rates of fronts in constant weather; the latest places' ellipses are kept."""

    def __init__(self, cols: int, terrain: Terrain, tables: Tables, entry: int, room: int) -> None:
        self._cols = cols
        self._state = entry, terrain, tables
        self._known_cells = np.full(room, -1, dtype=np.int64)
        self._known = np.empty((room, 3))

    def speeds_m_s(self, rows: Integers, cols: Integers, north: Floats, east: Floats) -> Floats:
        """Return the speeds (n,) in m/s of the front, as ``FrontRates.speeds_m_s`` does."""
        cells = rows * self._cols + cols
        known = self._known_cells, self._known
        rates: Floats = _rates(cells, north, east, *self._state, *known)
        return rates


@compiled
def _rates(cells, north, east, entry, terrain, tables, known_cells, known):  # type: ignore[no-untyped-def]
    """Compute the speeds; ``known`` (places; A, B) are the ellipses of the last call's cells."""
    found = np.zeros(cells.size)
    for place in range(cells.size):
        cell = cells[place]
        if cell != known_cells[place]:
            if place > 0 and cell == cells[place - 1]:  # neighbours are often in the same cell
                known[place] = known[place - 1]
            else:
                known[place] = slowness_of(cell, entry, terrain, tables)
            known_cells[place] = cell
        a, b_north, b_east = known[place, 0], known[place, 1], known[place, 2]
        if a == np.inf:
            continue
        rise_north = np.float64(terrain.gradient[0, cell])
        rise_east = np.float64(terrain.gradient[1, cell])
        # (v - c)' M (v - c) = 1 + B c with M = A² G - B B', G the length on the slope, M c = B.
        m_nn = a * a * (1.0 + rise_north * rise_north) - b_north * b_north
        m_ee = a * a * (1.0 + rise_east * rise_east) - b_east * b_east
        m_ne = a * a * rise_north * rise_east - b_north * b_east
        det = m_nn * m_ee - m_ne * m_ne
        c_north = (m_ee * b_north - m_ne * b_east) / det
        c_east = (m_nn * b_east - m_ne * b_north) / det
        n, e = north[place], east[place]
        across = (m_ee * n * n - 2.0 * m_ne * n * e + m_nn * e * e) / det
        radius = 1.0 + b_north * c_north + b_east * c_east
        found[place] = n * c_north + e * c_east + np.sqrt(radius * across)
    return found
