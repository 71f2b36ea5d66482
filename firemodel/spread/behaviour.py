"""Compute spread rate, direction, intensity and flame length when fire arrives in each cell."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.compiled import compiled
from firemodel.physics import rothermel
from firemodel.physics.crown_fire import NO_CROWNS, crown_flame_length_m
from firemodel.spread.fire_scheme import Fire
from firemodel.spread.local_spread import (
    HEAT,
    crowned_head,
    same_conditions,
    slowness_of,
    tables_of,
    terrain_of,
)


class Behaviour(NamedTuple):
    """The fire behaviour when the front arrives in each cell.

    The arrays are float32 (y, x); unburned cells have NaN.
    """

    spread_rate_m_s: NDArray[np.float32]  # along the slope
    toward_deg: NDArray[np.float32]  # direction of movement, clockwise from true north
    intensity_kw_m: NDArray[np.float32]  # Byram's intensity
    flame_length_m: NDArray[np.float32]
    crown_fraction: NDArray[np.float32]  # fraction of the canopy fuel that burned, 0 to 1


def behaviour_of(fire: Fire) -> Behaviour:
    """Return the fire behaviour when the front arrives in each cell.

    The spread rate is that normal to the front. It is computed from the cell's ellipse (Rothermel
    1972; Anderson 1983, INT-305) and the direction from which the fire came. In an ignition cell
    the rate is that of the head. The intensity is Byram's. The flame length is after Byram 1959 or,
    where crowns burn, after Thomas 1963. With acceleration, rate and intensity are those at the
    fire's age.

    Args:
        fire: A fire that has been advanced to the time of interest.

    Returns:
        Spread rate (m/s), direction (degrees clockwise from true north), fireline intensity (kW/m),
        flame length (m) and crown fraction burned, each float32 (y, x). Unburned cells have NaN.
    """
    land, entries = fire.landscape, fire.weather.changes()
    options = fire.rate_options
    terrain, tables = terrain_of(land, entries, options), tables_of(land, entries, options)
    heat = np.ascontiguousarray(tables.terms[..., HEAT])
    began_s = np.array([-math.inf, *(entry.at_s for entry in entries[1:])])
    arrival_s = fire.burned_arrival_s().ravel()
    paths = fire.arrival_vectors().reshape(2, -1)
    rate, toward_deg, intensity, crown = front_behaviour(
        arrival_s, paths, began_s, heat, terrain, tables
    )
    share = np.ravel(fire.rate_share())
    rate, intensity = rate * share, intensity * share
    toward_deg = land.true_deg(toward_deg)
    found = (rate, toward_deg, intensity, flame_length_m(intensity, crown), crown)
    return Behaviour(*(np.asarray(part, np.float32).reshape(land.shape) for part in found))


def flame_length_m(intensity_kw_m: Floats, crown_fraction: Floats) -> Floats:
    """Return the flame length in m: after Thomas 1963 where crowns burn, else after Byram 1959."""
    surface = np.asarray(rothermel.flame_length_m(intensity_kw_m))
    if not (crown_fraction > 0.0).any():
        return surface
    return np.where(crown_fraction > 0.0, crown_flame_length_m(intensity_kw_m), surface)


@compiled
def front_behaviour(arrival_s, paths, began_s, heat, terrain, tables, directions=True):  # type: ignore[no-untyped-def]
    """Return rate (m/s), direction (° from grid north), intensity (kW/m), crown fraction (4, n).

    Without ``directions``, which take half the computing time, the directions are NaN.
    """
    found = np.full((4, arrival_s.size), np.nan, dtype=np.float32)
    before, entry_before = -1, -1  # the latest cell with a computed slowness, and its entry
    a = b_north = b_east = 0.0
    for cell in range(arrival_s.size):
        if arrival_s[cell] == np.inf:
            continue
        # An arrival at the exact time of a change belongs to the weather before the change.
        entry = max(np.searchsorted(began_s, arrival_s[cell]) - 1, 0) if began_s.size > 1 else 0
        if before < 0 or entry != entry_before or not same_conditions(cell, before, terrain):
            a, b_north, b_east = slowness_of(cell, entry, terrain, tables)
            before, entry_before = cell, entry
        if a == np.inf:
            found[0, cell] = found[2, cell] = found[3, cell] = 0.0
            continue
        rise_north = np.float64(terrain.gradient[0, cell])
        rise_east = np.float64(terrain.gradient[1, cell])
        north, east = paths[0, cell], paths[1, cell]
        if north == 0.0 and east == 0.0:
            rate, north, east, _, _ = crowned_head(cell, entry, terrain, tables)
        else:
            # The front is normal to the gradient of the time A |v| - B v.
            up = rise_north * north + rise_east * east
            length = math.sqrt(north * north + east * east + up * up)
            to_north = a * (north + up * rise_north) / length - b_north
            to_east = a * (east + up * rise_east) / length - b_east
            slowness = math.sqrt(to_north * to_north + to_east * to_east)
            north, east = to_north / slowness, to_east / slowness
            up = rise_north * north + rise_east * east
            rate = math.sqrt(1.0 + up * up) / slowness
        found[0, cell] = rate
        if directions:
            found[1, cell] = math.degrees(math.atan2(east, north)) % 360.0
        crown = canopy_heat = 0.0
        if tables.crown_method != NO_CROWNS:
            _, _, _, _, crown = crowned_head(cell, entry, terrain, tables)
        if crown > 0.0:
            canopy_heat = crown * terrain.canopy.heat_kj_m2[cell]
        found[2, cell] = rate * (heat[entry, terrain.fuel[cell]] + canopy_heat)
        found[3, cell] = crown
    return found
