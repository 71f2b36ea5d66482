"""Compute the winds at which crowns ignite and at which a crown fire is active, in each cell."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import compiled, kernel
from firemodel.physics import crown_fire
from firemodel.physics.crown_fire import CRUZ
from firemodel.physics.weather import WIND_10M_OVER_20FT
from firemodel.spread.crown_spread import crowning_wind_of
from firemodel.spread.fire_scheme import Fire
from firemodel.spread.local_spread import (
    CROWN,
    HEAT,
    Tables,
    Terrain,
    tables_of,
    terrain_of,
    wind_at,
)

_torching_wind = kernel(crown_fire.torching_wind_m_s)
_cruz_crowning_wind = kernel(crown_fire.cruz_crowning_wind_m_s)
_critical_rate = kernel(crown_fire.critical_rate_m_s)


class CrownWinds(NamedTuple):
    """Winds 20 ft (6.1 m) above the vegetation in m/s; float32 (y, x).

    Infinity where no wind suffices, and where there are no crowns.
    """

    torching_m_s: NDArray[np.float32]  # the torching index: the surface fire ignites crowns
    crowning_m_s: NDArray[np.float32]  # the crowning index: a crown fire is active


def crown_winds_of(fire: Fire) -> CrownWinds:
    """Return the torching index and the crowning index (Scott & Reinhardt 2001) in each cell.

    Each index is the lowest wind over the weather entries in effect until the fire's time, with the
    moistures and the wind direction of the entry. The indices do not depend on whether the fire has
    reached the cell.

    Args:
        fire: A fire with crown fire (``rate_options.crown``), with or without burned cells.

    Returns:
        Both winds in m/s at 20 ft, float32 (y, x); infinity where no wind suffices.
    """
    land, options = fire.landscape, fire.rate_options
    entries = [entry for entry in fire.weather.changes() if entry.at_s <= max(fire.time_s, 0.0)]
    terrain, tables = terrain_of(land, entries, options), tables_of(land, entries, options)
    return CrownWinds(*least_winds(terrain, tables).reshape(2, *land.shape))


@compiled
def least_winds(terrain: Terrain, tables: Tables) -> NDArray[np.float32]:
    """Return each cell's lowest torching and crowning winds over the entries, (2, n)."""
    found = np.full((2, terrain.fuel.size), np.inf, dtype=np.float32)
    for cell in range(terrain.fuel.size):
        if terrain.fuel[cell] < 0 or terrain.canopy.critical_kw_m[cell] == np.inf:
            continue
        for entry in range(tables.terms.shape[0]):
            found[0, cell] = min(found[0, cell], torching_wind(cell, entry, terrain, tables))
            found[1, cell] = min(found[1, cell], crowning_wind(cell, entry, terrain, tables))
    return found


@kernel
def torching_wind(cell, entry, terrain, tables):  # type: ignore[no-untyped-def]
    """Return the wind in m/s at 20 ft, in the entry's direction, that ignites a cell's crowns."""
    terms = tables.terms[entry, terrain.fuel[cell]]
    rise_north = np.float64(terrain.gradient[0, cell])
    rise_east = np.float64(terrain.gradient[1, cell])
    slope = math.sqrt(rise_north * rise_north + rise_east * rise_east)
    by_slope = cos_upslope = 0.0
    if slope > 0.0:
        by_slope = min(terms[3] * slope * slope, terms[4])
        _, wind_north, wind_east = wind_at(cell, entry, terrain, tables)
        up = wind_north * rise_north + wind_east * rise_east
        cos_upslope = up / slope
    rate_factor = terrain.rate_factor
    rate = terms[0] * rate_factor[cell if rate_factor.size > 1 else 0]
    if terms[HEAT] <= 0.0:
        return np.inf
    initiation_m_s = np.float64(terrain.canopy.critical_kw_m[cell]) / terms[HEAT]
    if initiation_m_s > rate * (1.0 + terms[5]):  # above the limit of the effective wind
        return np.inf
    return _torching_wind(
        initiation_m_s,
        rate,
        terms[1],
        terms[2],
        by_slope,
        cos_upslope,
        np.float64(terrain.midflame[cell]),
    )


@kernel
def crowning_wind(cell, entry, terrain, tables):  # type: ignore[no-untyped-def]
    """Return the wind in m/s at 20 ft above which a crown fire in a cell is active."""
    rate_factor = terrain.rate_factor
    factor = tables.terms[entry, terrain.fuel[cell], CROWN]
    factor *= rate_factor[cell if rate_factor.size > 1 else 0]
    density_kg_m3 = np.float64(terrain.canopy.density_kg_m3[cell])
    if tables.crown_method != CRUZ:
        return crowning_wind_of(factor, density_kg_m3)
    if factor <= 0.0:
        return np.inf
    critical_m_s = _critical_rate(density_kg_m3)
    return _cruz_crowning_wind(critical_m_s, factor, density_kg_m3) / WIND_10M_OVER_20FT
