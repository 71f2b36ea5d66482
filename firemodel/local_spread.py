"""Rothermel in every cell of a landscape: how fast, which way and how thinly fire leaves it.

The equations are those of ``rothermel``, compiled to run cell by cell: the terms of each fuel come
from ``rothermel.fuel_bed``, once for each entry of the weather, and only wind and slope are left
for the cell.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from firemodel import rothermel
from firemodel.fuels import FUEL_MODELS
from firemodel.landscape import Landscape
from firemodel.rothermel import FT_MIN_PER_M_S, fuel_bed
from firemodel.weather import Weather, wind_adjustment_factor

Floats = NDArray[np.float64]

_length_to_breadth = njit(cache=True)(rothermel.length_to_breadth)
_eccentricity = njit(cache=True)(rothermel.eccentricity)


class Terrain(NamedTuple):
    """What a cell's spread depends on and time does not change; cells in one row (n)."""

    fuel: NDArray[np.int16]  # (n) place in the tables, -1 where nothing burns
    gradient: NDArray[np.float32]  # (2, n) rise per metre towards north and east
    midflame: NDArray[np.float32]  # (n) midflame wind over wind 20 ft above the vegetation


class Tables(NamedTuple):
    """What it depends on besides, for each entry of the weather."""

    terms: Floats  # (entries, fuels, 5): R0 m/s, B, C for wind in m/s, slope's K, largest factor
    wind: Floats  # (entries, 3): speed m/s at 20 ft, its parts towards north and east (unit)
    until_s: Floats  # (entries) when the next one takes over


def terrain_of(landscape: Landscape) -> Terrain:
    """The landscape's cells in one row."""
    codes = burnable_codes(landscape)
    place = np.full(int(landscape.fuel_model.max()) + 1, -1, dtype=np.int16)
    place[codes] = np.arange(len(codes))
    factor = np.zeros(place.size, dtype=np.float32)
    factor[codes] = [wind_adjustment_factor(FUEL_MODELS[code].depth_ft) for code in codes]
    cells = landscape.fuel_model.ravel()
    return Terrain(place[cells], landscape.gradient.reshape(2, -1), factor[cells])


def burnable_codes(landscape: Landscape) -> list[int]:
    """Codes of the fuels that are there, in rising order."""
    present = np.bincount(landscape.fuel_model.ravel()).nonzero()[0]
    return [int(code) for code in present if int(code) in FUEL_MODELS]


def tables_of(landscape: Landscape, entries: Sequence[Weather], wind_limit: bool = False) -> Tables:
    """The terms of the landscape's fuels under each entry; ``wind_limit`` as in ``rothermel``."""
    codes = burnable_codes(landscape)
    terms = np.empty((len(entries), len(codes), 5))
    wind = np.empty((len(entries), 3))
    for number, entry in enumerate(entries):
        toward = math.radians(entry.wind_from_deg + 180.0)
        wind[number] = entry.wind_speed_m_s, math.cos(toward), math.sin(toward)
        for place, code in enumerate(codes):
            bed = fuel_bed(FUEL_MODELS[code], entry.moisture)
            largest = math.inf
            terms[number, place] = (
                bed.no_wind_rate_ft_min / FT_MIN_PER_M_S,
                bed.wind_b,
                bed.wind_c * FT_MIN_PER_M_S**bed.wind_b,
                bed.slope_k,
                largest,
            )
    until_s = np.array([*(entry.at_s for entry in entries[1:]), math.inf])
    return Tables(terms, wind, until_s)


@njit(cache=True)
def head_of(cell, entry, terrain, tables):  # type: ignore[no-untyped-def]
    """Fastest spread from a cell: (rate m/s along the slope, north, east (unit), eccentricity).

    Wind and slope are added as vectors (``rothermel.fastest_spread``).
    """
    terms = tables.terms[entry, terrain.fuel[cell]]
    rise_north = np.float64(terrain.gradient[0, cell])
    rise_east = np.float64(terrain.gradient[1, cell])
    slope = math.sqrt(rise_north * rise_north + rise_east * rise_east)
    wind = tables.wind[entry, 0] * terrain.midflame[cell]
    by_wind = terms[2] * wind ** terms[1] if wind > 0.0 else 0.0
    north = by_wind * tables.wind[entry, 1] + terms[3] * slope * rise_north
    east = by_wind * tables.wind[entry, 2] + terms[3] * slope * rise_east
    factor = math.sqrt(north * north + east * east)
    if factor == 0.0:
        return terms[0], 1.0, 0.0, 0.0
    north, east = north / factor, east / factor
    factor = min(factor, terms[4])
    effective_m_s = (factor / terms[2]) ** (1.0 / terms[1])
    e = _eccentricity(_length_to_breadth(effective_m_s))
    return terms[0] * (1.0 + factor), north, east, e


@njit(cache=True)
def _heads(entry, terrain, tables):  # type: ignore[no-untyped-def]
    found = np.zeros((4, terrain.fuel.size))
    for cell in range(terrain.fuel.size):
        if terrain.fuel[cell] >= 0:
            found[:, cell] = head_of(cell, entry, terrain, tables)
    return found


def spread_fields(landscape: Landscape, weather: Weather) -> tuple[Floats, Floats, Floats]:
    """Of each cell (y, x): fastest spread (m/s), its direction (rad from north), eccentricity.

    Cells that do not burn have rate 0.
    """
    tables = tables_of(landscape, [weather])
    rate, north, east, e = _heads(0, terrain_of(landscape), tables).reshape(4, *landscape.shape)
    return rate, np.arctan2(east, north) % (2.0 * np.pi), e
