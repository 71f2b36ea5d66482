"""Compute crown fire in the cells of a landscape with the compiled equations of ``crown_fire``."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics import CrownMethod, crown_fire
from firemodel.physics.crown_fire import (
    CROWN_FUEL,
    CROWN_RATE_FACTOR,
    CRUZ,
    ROTHERMEL,
)
from firemodel.physics.fuels import FUEL_MODELS
from firemodel.physics.rothermel import FT_MIN_PER_M_S, Moisture, fuel_bed
from firemodel.physics.weather import WIND_10M_OVER_20FT, Weather

_BED = fuel_bed(FUEL_MODELS[CROWN_FUEL], Moisture(0.06, 0.07, 0.08, 0.6, 0.9))
# Wind-factor coefficients of the crown's fuel model, for wind in m/s and any moisture.
WIND_B, WIND_C = _BED.wind_b, _BED.wind_c * FT_MIN_PER_M_S**_BED.wind_b
MIN_DENSITY_KG_M3 = 1e-4  # trees with thinner crowns do not carry crown fire

_critical_rate = kernel(crown_fire.critical_rate_m_s)
_rothermel_rate = kernel(crown_fire.rothermel_rate_m_s)
_crowning_wind = kernel(crown_fire.crowning_wind_m_s)
_linked_fraction = kernel(crown_fire.linked_crown_fraction)
_excess_fraction = kernel(crown_fire.excess_crown_fraction)
_cruz_active_rate = kernel(crown_fire.cruz_active_rate_m_s)
_cruz_passive_rate = kernel(crown_fire.cruz_passive_rate_m_s)
crown_length_to_width = kernel(crown_fire.crown_length_to_width)


class Canopy(NamedTuple):
    """The inputs of crown fire in each cell; cells are flattened (n)."""

    critical_kw_m: NDArray[np.float32]  # (n) intensity that ignites crowns; infinity without crowns
    density_kg_m3: NDArray[np.float32]  # (n) canopy bulk density
    heat_kj_m2: NDArray[np.float32]  # (n) heat per area of the canopy fuel


NO_CANOPY = Canopy(np.full(1, np.inf, np.float32), *np.zeros((2, 1), np.float32))


def canopy_of(landscape: Landscape, foliar_moisture_pct: float) -> Canopy:
    """Return the canopy of each cell. Raises FireModelError if a layer is missing."""
    layers = {
        "canopy_height": landscape.canopy_height_m,
        "canopy_base": landscape.canopy_base_m,
        "canopy_bulk_density": landscape.canopy_bulk_density_kg_m3,
    }
    missing = [name for name, layer in layers.items() if layer is None]
    if missing:
        raise FireModelError(
            f"crown fire: the landscape lacks {' and '.join(missing)}; add what is missing, or set "
            'crown = "none"'
        )
    height_m, base_m, density = (
        np.asarray(layer, dtype=np.float64).ravel() for layer in layers.values()
    )
    some = (density >= MIN_DENSITY_KG_M3) & (height_m > base_m)
    critical = np.full(height_m.size, np.inf)
    bases, places = np.unique(base_m[some], return_inverse=True)
    critical[some] = np.array(
        [crown_fire.critical_intensity_kw_m(base, foliar_moisture_pct) for base in bases.tolist()]
    )[places]
    length_m = np.where(some, height_m - base_m, 0.0)
    heat = density * length_m * crown_fire.LOW_HEAT_KJ_KG
    return Canopy(*(np.asarray(layer, np.float32) for layer in (critical, density, heat)))


def crown_factor(method: CrownMethod, entry: Weather, zone: int = 0) -> float:
    """Return the factor of a crown fire's rate that depends on the fuel moistures in a zone.

    With Rothermel's method it is 3.34 times the no-wind rate of fuel model 10, in m/s; with the
    method of Cruz et al. it is the fine fuel moisture factor; without crown fire it is 0.
    """
    if method == "none":
        return 0.0
    if method == "cruz":
        dead_1h_pct = 100.0 * entry.of_zones[zone][0] if entry.of_zones else entry.dead_1h_pct
        return crown_fire.cruz_still_factor(dead_1h_pct)
    bed = fuel_bed(FUEL_MODELS[CROWN_FUEL], entry.moisture_of(CROWN_FUEL, zone))
    return CROWN_RATE_FACTOR * bed.no_wind_rate_ft_min / FT_MIN_PER_M_S


@kernel
def crowning_wind_of(factor, density_kg_m3):  # type: ignore[no-untyped-def]
    """Return the wind at 20 ft in m/s at which a crown fire becomes active (0 if always)."""
    if factor <= 0.0:
        return np.inf
    return _crowning_wind(_critical_rate(density_kg_m3), factor, WIND_B, WIND_C)


@kernel
def with_crowns(  # type: ignore[no-untyped-def]
    method, surface_m_s, initiation_m_s, full_m_s, factor, wind_20ft_m_s, density_kg_m3
):
    """Return the head rate in m/s, the crown fraction burned, and whether a crown fire is active.

    The surface fire ignites crowns. With Rothermel's method (1991), torching crowns do not change
    the rate. With that of Scott & Reinhardt (2001, eq. 33), the rate rises with the crown fraction
    burned. ``factor`` is ``crown_factor``; the other arguments are those of ``crown_fire``.
    """
    critical_m_s = _critical_rate(density_kg_m3)
    if method == CRUZ:
        wind_10m_m_s = WIND_10M_OVER_20FT * wind_20ft_m_s
        rate = _cruz_active_rate(factor, wind_10m_m_s, density_kg_m3)
        if rate >= critical_m_s:
            return rate, 1.0, True
        rate = max(surface_m_s, _cruz_passive_rate(rate, critical_m_s))
        return rate, _excess_fraction(rate, initiation_m_s), False
    rate = _rothermel_rate(factor, WIND_B, WIND_C, wind_20ft_m_s)
    if rate >= critical_m_s:
        return rate, 1.0, True
    if method == ROTHERMEL:
        return surface_m_s, 1.0, False
    fraction = _linked_fraction(surface_m_s, initiation_m_s, full_m_s)
    return surface_m_s + fraction * (rate - surface_m_s), fraction, False
