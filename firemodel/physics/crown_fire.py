"""Compute crown fire from the surface fire below the trees, with one function per equation.

Crowns ignite if the surface fire reaches Van Wagner's critical intensity (1977). The rate of the
crown fire is that of Rothermel (1991, INT-438), alone or linked with the surface fire by the crown
fraction burned (Scott & Reinhardt 2001, RMRS-RP-29), or that of Cruz, Alexander & Wakimoto (2005,
Can. J. For. Res. 35, 1626-1639). Where the publications allow alternatives, this module follows the
Forest Service's `behave`. The functions take numbers and use SI units.
"""

import math

import numpy as np

from firemodel.arrays import Floats
from firemodel.physics import CrownMethod
from firemodel.physics.rothermel import (
    FT_MIN_PER_M_S,
    KW_M_PER_BTU_FT_S,
    M_PER_FT,
    M_S_PER_MPH,
    MAX_LENGTH_TO_BREADTH,
)

# The methods as numbers, for compiled code.
NO_CROWNS, ROTHERMEL, SCOTT_REINHARDT, CRUZ = 0, 1, 2, 3
METHODS: dict[CrownMethod, int] = {
    "none": NO_CROWNS,
    "rothermel": ROTHERMEL,
    "scott_reinhardt": SCOTT_REINHARDT,
    "cruz": CRUZ,
}
CROWN_FUEL = 10  # Rothermel's crown rate is proportional to the surface rate of this fuel model
CROWN_RATE_FACTOR = 3.34
CROWN_MIDFLAME = 0.4  # ratio of midflame wind to wind at 20 ft in that fuel
MIN_BASE_M, MIN_FOLIAR_PCT = 0.1, 30.0  # lower limits as in `behave`
CRITICAL_MASS_FLOW_KG_M2_S = 0.05  # 3 kg/m²/min
KG_M3_PER_LB_FT3 = 16.0185  # as rounded in `behave`
# 8000 Btu/lb, with the units of Btu, lb and ft as rounded in `behave`.
LOW_HEAT_KJ_KG = 8000.0 * KW_M_PER_BTU_FT_S / (KG_M3_PER_LB_FT3 * M_PER_FT**2)


def critical_intensity_kw_m(base_height_m: float, foliar_moisture_pct: float) -> float:
    """Return the surface fire intensity at which crowns ignite (Van Wagner 1977, eq. 4).

    As in `behave`, a base height below 0.1 m counts as 0.1 m, and a foliar moisture below 30 % as
    30 %.
    """
    base_m = max(base_height_m, MIN_BASE_M)
    foliar_pct = max(foliar_moisture_pct, MIN_FOLIAR_PCT)
    return math.pow(0.010 * base_m * (460.0 + 25.9 * foliar_pct), 1.5)


def critical_rate_m_s(bulk_density_kg_m3: float) -> float:
    """Return the minimum rate of an active crown fire (Van Wagner 1977): 3/CBD in m/min."""
    return CRITICAL_MASS_FLOW_KG_M2_S / bulk_density_kg_m3


def rothermel_rate_m_s(
    still_rate_m_s: float, wind_b: float, wind_c: float, wind_20ft_m_s: float
) -> float:
    """Return the rate of an active crown fire (Rothermel 1991): 3.34 times that of fuel model 10.

    Args:
        still_rate_m_s: 3.34 times the rate of fuel model 10 without wind and slope.
        wind_b: The exponent B of the wind factor of fuel model 10.
        wind_c: The coefficient C of that factor, for wind in m/s.
        wind_20ft_m_s: Wind at 20 ft (6.1 m) above the vegetation.
    """
    return still_rate_m_s * (1.0 + wind_c * math.pow(CROWN_MIDFLAME * wind_20ft_m_s, wind_b))


def crowning_wind_m_s(
    critical_m_s: float, still_rate_m_s: float, wind_b: float, wind_c: float
) -> float:
    """Return the wind at 20 ft at which ``rothermel_rate_m_s`` reaches the critical rate.

    The wind is O'active of Scott & Reinhardt 2001, eq. 20; it is 0 if the crown fire is active
    without wind. The other arguments are those of ``rothermel_rate_m_s``.
    """
    if critical_m_s <= still_rate_m_s:
        return 0.0
    factor = critical_m_s / still_rate_m_s - 1.0
    return math.pow(factor / wind_c, 1.0 / wind_b) / CROWN_MIDFLAME


def cruz_crowning_wind_m_s(
    critical_m_s: float, moisture_factor: float, bulk_density_kg_m3: float
) -> float:
    """Return the wind at 10 m at which ``cruz_active_rate_m_s`` reaches the critical rate."""
    by_wind = math.pow(3.6, 0.90)
    in_unit_wind = 11.02 / 60.0 * by_wind * math.pow(bulk_density_kg_m3, 0.19) * moisture_factor
    return math.pow(critical_m_s / in_unit_wind, 1.0 / 0.90)


def torching_wind_m_s(
    initiation_m_s: float,
    still_rate_m_s: float,
    wind_b: float,
    wind_c: float,
    by_slope: float,
    cos_upslope: float,
    adjustment: float,
) -> float:
    """Return the wind at 20 ft at which the surface fire ignites crowns (Scott & Reinhardt 2001).

    This wind is the torching index. The index is 0 if crowns ignite without wind, and infinity if
    no wind suffices. Effects of wind and slope are added as vectors, as in
    ``rothermel.fastest_spread``.

    Args:
        initiation_m_s: Rate of the surface fire at which crowns ignite.
        still_rate_m_s: Rate of the surface fire without wind and slope.
        wind_b: The exponent B of the fuel's wind factor.
        wind_c: The coefficient C of that factor, for wind in m/s.
        by_slope: The slope factor.
        cos_upslope: Cosine of the angle between wind and upslope; 1 if the wind blows upslope.
        adjustment: Ratio of midflame wind to wind at 20 ft.
    """
    if still_rate_m_s <= 0.0:
        return math.inf
    factor = initiation_m_s / still_rate_m_s - 1.0
    if factor <= by_slope:
        return 0.0
    if wind_c <= 0.0 or adjustment <= 0.0:
        return math.inf
    # The positive root w of |w + s| = factor, where s is the effect of the slope.
    along = by_slope * cos_upslope
    across2 = by_slope * by_slope - along * along
    by_wind = math.sqrt(factor * factor - across2) - along
    return math.pow(by_wind / wind_c, 1.0 / wind_b) / adjustment


def linked_crown_fraction(surface_m_s: float, initiation_m_s: float, full_m_s: float) -> float:
    """Return the crown fraction burned (Scott & Reinhardt 2001, eq. 28), from 0 to 1.

    Args:
        surface_m_s: Rate of the surface fire.
        initiation_m_s: Rate of the surface fire at which crowns ignite.
        full_m_s: Rate of the surface fire in the wind of ``crowning_wind_m_s``.

    As in `behave`, the fraction is 0 if ``full_m_s`` is not above ``initiation_m_s``.
    """
    span_m_s = full_m_s - initiation_m_s
    if span_m_s * FT_MIN_PER_M_S <= 1e-7:
        return 0.0
    return min(max((surface_m_s - initiation_m_s) / span_m_s, 0.0), 1.0)


def excess_crown_fraction(rate_m_s: float, initiation_m_s: float) -> float:
    """Return the crown fraction burned (Van Wagner 1993): 1 - exp(-0.23 (R - R0)), R in m/min."""
    return 1.0 - math.exp(-0.23 * 60.0 * max(rate_m_s - initiation_m_s, 0.0))


def cruz_still_factor(dead_1h_pct: float) -> float:
    """Return the factor for the moisture of fine dead fuel in ``cruz_active_rate_m_s``."""
    return math.exp(-0.17 * dead_1h_pct)


def cruz_active_rate_m_s(
    moisture_factor: float, wind_10m_m_s: float, bulk_density_kg_m3: float
) -> float:
    """Return the rate of an active crown fire (Cruz et al. 2005, eq. 9).

    The rate is 11.02 U^0.90 CBD^0.19 e^(-0.17 EFFM) in m/min, U in km/h at 10 m in the open.
    ``moisture_factor`` is ``cruz_still_factor``.
    """
    by_wind = math.pow(3.6 * wind_10m_m_s, 0.90)
    return 11.02 / 60.0 * by_wind * math.pow(bulk_density_kg_m3, 0.19) * moisture_factor


def cruz_passive_rate_m_s(active_m_s: float, critical_m_s: float) -> float:
    """Return the rate of a crown fire that is not active (Cruz et al. 2005, eq. 12)."""
    return active_m_s * math.exp(-active_m_s / critical_m_s)


def crown_length_to_width(wind_20ft_m_s: float) -> float:
    """Return the length-to-width ratio of a crown fire (Rothermel 1991, eq. 10), at most 8."""
    return min(1.0 + 0.125 * wind_20ft_m_s / M_S_PER_MPH, MAX_LENGTH_TO_BREADTH)


def crown_flame_length_m(intensity_kw_m: float | Floats) -> float | Floats:
    """Return the flame length of a crown fire (Thomas 1963): 0.2 I^(2/3) in ft and Btu/ft/s."""
    intensity_btu_ft_s = np.asarray(intensity_kw_m) / KW_M_PER_BTU_FT_S
    return 0.2 * np.power(intensity_btu_ft_s, 2.0 / 3.0) * M_PER_FT
