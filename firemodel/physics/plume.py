"""Compute the temperature, height and updraught of the warm air above a line of fire.

Temperatures follow Van Wagner's equation for the scorch height in wind (1973, Can. J. For. Res. 3,
373-378), in SI units (Alexander & Cruz 2012, Int. J. Wildland Fire 21, 95-113). Its form follows
from the theory of line plumes in neutral air, in which the warming decreases with height. Its
constants come from 13 fires of 67 to 1255 kW/m, measured up to 17 m above the ground. Other
intensities and heights are extrapolations. The functions take numbers or arrays.
"""

from typing import Any

import numpy as np

from firemodel.arrays import Floats

SCORCH = 0.74183  # K m, with kW/m and m/s
BUOYANCY = 0.025574  # m³/s³ per kW/m
UPDRAUGHT = 1.80  # at the centre of a line plume (Rouse, Yih & Humphreys 1952, Tellus 4, 201-210)
GRAVITY_M_S2, AIR_KG_M3, AIR_KJ_KG_K, AIR_K = 9.81, 1.2, 1.005, 293.0


def _warming_metres(intensity_kw_m: Any, wind_m_s: Any) -> Floats:
    """Return the product of warming and height in K m, which is the same at all heights."""
    intensity = np.asarray(intensity_kw_m, dtype=np.float64)
    buoyancy = BUOYANCY * intensity + np.asarray(wind_m_s, dtype=np.float64) ** 3
    found = np.zeros(np.broadcast(intensity, buoyancy).shape)
    np.divide(SCORCH * intensity ** (7 / 6), np.sqrt(buoyancy), out=found, where=buoyancy != 0.0)
    return found


def warming_k(intensity_kw_m: Any, wind_m_s: Any, height_m: Any) -> Floats:
    """Return the warming of the air at a height above a line of fire (Van Wagner 1973).

    The result applies to the centre of the plume, which the wind tilts and cools.

    Args:
        intensity_kw_m: Fireline intensity.
        wind_m_s: Wind near the flames.
        height_m: Height above the ground, greater than 0.

    Returns:
        The warming in K; NaN where the intensity is NaN.
    """
    return np.asarray(_warming_metres(intensity_kw_m, wind_m_s) / np.asarray(height_m))


def warm_height_m(intensity_kw_m: Any, wind_m_s: Any, max_warming_k: Any) -> Floats:
    """Return the height above which a line of fire warms the air by less than ``max_warming_k``.

    The other arguments are those of ``warming_k``; the result is in m above the ground.
    """
    return np.asarray(_warming_metres(intensity_kw_m, wind_m_s) / np.asarray(max_warming_k))


def updraught_m_s(intensity_kw_m: Any) -> Floats:
    """Return the vertical wind at the centre of the plume over a line of fire in calm, neutral air.

    This wind does not depend on the height (Rouse et al. 1952). All of the fire's heat is assumed
    to heat the air; if 30 % of the heat is radiated, the result is 11 % lower.
    """
    heat = np.asarray(intensity_kw_m, dtype=np.float64) / (AIR_KG_M3 * AIR_KJ_KG_K * AIR_K)
    return np.asarray(UPDRAUGHT * np.cbrt(GRAVITY_M_S2 * heat))
