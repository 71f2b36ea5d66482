"""Computes the spread in every cell of a landscape by the kernels of the schemes."""

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import compiled
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather
from firemodel.spread.local_spread import head_of, tables_of, terrain_of

Floats = NDArray[np.float64]


@compiled
def _heads(entry, terrain, tables):  # type: ignore[no-untyped-def]
    found = np.zeros((4, terrain.fuel.size))
    for cell in range(terrain.fuel.size):
        if terrain.fuel[cell] >= 0:
            rate, north, east, e = head_of(cell, entry, terrain, tables)
            found[0, cell], found[1, cell], found[2, cell], found[3, cell] = rate, north, east, e
    return found


def spread_fields(landscape: Landscape, weather: Weather) -> tuple[Floats, Floats, Floats]:
    """Return the fastest spread (m/s), its direction (rad) and eccentricity of each cell (y, x).

    The direction is clockwise from grid north. The rate is 0 in cells that do not burn.
    """
    tables = tables_of(landscape, [weather])
    rate, north, east, e = _heads(0, terrain_of(landscape, [weather]), tables).reshape(
        4, *landscape.shape
    )
    return rate, np.arctan2(east, north) % (2.0 * np.pi), e
