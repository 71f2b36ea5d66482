"""Compute surface fire spread with Rothermel's model; there is one function per equation.

The model is from Rothermel 1972 (INT-115), with Albini's revisions of 1976, as described by Andrews
2018 (RMRS-GTR-371). Where these publications allow alternatives, this module follows the Forest
Service's `behave`. The equations are in their published units (feet, minutes, pounds, Btu); the
functions at the end return metres and seconds.
"""

import math
from dataclasses import dataclass

import numpy as np

from firemodel.arrays import Floats
from firemodel.physics.fuels import FuelModel

MINERAL_CONTENT = 0.0555
SILICA_FREE_MINERAL_CONTENT = 0.010
PARTICLE_DENSITY_LB_FT3 = 32.0
M_PER_FT = 0.3048
FT_MIN_PER_M_S = 60.0 / M_PER_FT
M_S_PER_MPH = 0.44704
# As in the Forest Service's `behave`; the International Table Btu would give 3.4615.
KW_M_PER_BTU_FT_S = 3.464140419
# Limits between the size classes by which net loads are weighted (Albini 1976, p. 15).
SIZE_CLASS_SAV_1_FT = (1200.0, 192.0, 96.0, 48.0, 16.0)
# Indices of the dead (1 h, 10 h, 100 h, cured herbaceous) and the live classes of a fuel bed.
DEAD, LIVE = slice(0, 4), slice(4, 6)
MAX_LENGTH_TO_BREADTH = 8.0  # as in `behave`; Anderson gives no limit


@dataclass(frozen=True, slots=True)
class Moisture:
    """The moisture of each fuel class as a fraction of its oven-dry weight."""

    dead_1h: float
    dead_10h: float
    dead_100h: float
    live_herb: float
    live_woody: float

    @property
    def classes(self) -> tuple[float, float, float, float, float]:
        """The moistures in the order of a fuel model's classes."""
        return self.dead_1h, self.dead_10h, self.dead_100h, self.live_herb, self.live_woody


@dataclass(frozen=True, slots=True)
class FuelBed:
    """The coefficients of the spread equations for one fuel model at one moisture.

    ``no_wind_rate_ft_min`` is R0. The wind factor is ``wind_c * U**wind_b`` with U in ft/min
    (``wind_c`` includes the term of the packing ratio). The slope factor is ``slope_k *
    tan(slope)**2``, at most ``wind_limit_ft_min`` (see ``slope_factor``).
    """

    no_wind_rate_ft_min: float
    reaction_intensity_btu_ft2_min: float
    sav_1_ft: float
    wind_b: float
    wind_c: float
    slope_k: float


def mineral_damping() -> float:
    """Return the mineral damping η_s (Rothermel 1972, eq. 30), 0.4174 for all fuels."""
    return min(0.174 * math.pow(SILICA_FREE_MINERAL_CONTENT, -0.19), 1.0)


def moisture_damping(moisture: float, extinction: float) -> float:
    """Return the moisture damping η_M of dead or live fuel (Rothermel 1972, eq. 29).

    The moistures are fractions.
    """
    if moisture >= extinction:
        return 0.0
    ratio = moisture / extinction
    return 1.0 - 2.59 * ratio + 5.11 * ratio**2 - 3.52 * ratio**3


def optimum_packing_ratio(sav_1_ft: float) -> float:
    """Return the optimum packing ratio β_op from σ in 1/ft (Rothermel 1972, eq. 37)."""
    return 3.348 * math.pow(sav_1_ft, -0.8189)


def optimum_reaction_velocity_1_min(sav_1_ft: float, relative_packing: float) -> float:
    """Return the optimum reaction velocity Γ' in 1/min from σ in 1/ft and β/β_op.

    Rothermel 1972, eqs. 36 and 38, with the exponent A from Albini 1976.
    """
    largest = 1.0 / (0.0594 + 495.0 * math.pow(sav_1_ft, -1.5))
    a = 133.0 * math.pow(sav_1_ft, -0.7913)
    return largest * math.pow(relative_packing, a) * math.exp(a * (1.0 - relative_packing))


def propagating_flux_ratio(sav_1_ft: float, packing: float) -> float:
    """Return the propagating flux ratio ξ from σ in 1/ft and β (Rothermel 1972, eq. 42)."""
    return math.exp((0.792 + 0.681 * math.sqrt(sav_1_ft)) * (packing + 0.1)) / (
        192.0 + 0.2595 * sav_1_ft
    )


def heat_of_preignition_btu_lb(moisture: float) -> float:
    """Return the heat of preignition Q_ig in Btu/lb (Rothermel 1972, eq. 12).

    The moisture is a fraction.
    """
    return 250.0 + 1116.0 * moisture


def effective_heating_number(sav_1_ft: float) -> float:
    """Return the effective heating number ε from σ in 1/ft (Rothermel 1972, eq. 14)."""
    return math.exp(-138.0 / sav_1_ft)


def wind_coefficients(sav_1_ft: float, relative_packing: float) -> tuple[float, float]:
    """Return B and C·(β/β_op)^-E of the wind factor (Rothermel 1972, eqs. 47-50).

    The coefficients are for wind speeds in ft/min.
    """
    c = 7.47 * math.exp(-0.133 * math.pow(sav_1_ft, 0.55))
    b = 0.02526 * math.pow(sav_1_ft, 0.54)
    e = 0.715 * math.exp(-3.59e-4 * sav_1_ft)
    return b, c * math.pow(relative_packing, -e)


def slope_coefficient(packing: float) -> float:
    """Return the coefficient 5.275 β^-0.3 of the slope factor (Rothermel 1972, eq. 51)."""
    return 5.275 * math.pow(packing, -0.3)


def cured_fraction(live_herb_moisture: float) -> float:
    """Return the fraction of a dynamic model's herbaceous load that is dead.

    ``live_herb_moisture`` is a fraction. The result is 1 below 30 % moisture and 0 above 120 %
    (Scott & Burgan 2005). Between these moistures the result is linear. The numbers are rounded as
    in `behave`, so that the result at exactly 120 % is 0.001.
    """
    if live_herb_moisture < 0.30:
        return 1.0
    return 1.333 - 1.11 * live_herb_moisture if live_herb_moisture <= 1.20 else 0.0


def size_classes(fuel: FuelModel, moisture: Moisture) -> tuple[Floats, Floats, Floats]:
    """Return the loads (lb/ft²), SAVs (1/ft) and moistures of six classes, dead before live.

    Cured herbaceous fuel is a separate dead class with the SAV of the live herbaceous fuel and the
    moisture of the 1-h fuel (Andrews 2018; Burgan 1979, INT-226).
    """
    cured = cured_fraction(moisture.live_herb) if fuel.dynamic else 0.0
    one, ten, hundred, herb, woody = fuel.loads_lb_ft2
    loads = np.array([one, ten, hundred, cured * herb, (1.0 - cured) * herb, woody])
    savs = np.array([*fuel.savs_1_ft[:3], fuel.sav_herb, fuel.sav_herb, fuel.sav_woody])
    wet = moisture.classes
    return loads, savs, np.array([*wet[:3], moisture.dead_1h, *wet[3:]])


def live_extinction_moisture(fuel: FuelModel, moisture: Moisture) -> float:
    """Return the extinction moisture M_x of the live fuel (Albini 1976, p. 16; Andrews 2018).

    M_x is a fraction. M_x of the live fuel decreases as the moisture of the dead fuel increases,
    and is at least M_x of the dead fuel.
    """
    loads, savs, moistures = size_classes(fuel, moisture)
    dead = loads[DEAD] * np.exp(-138.0 / savs[DEAD])
    live = loads[LIVE] * np.exp(-500.0 / savs[LIVE])
    if live.sum() == 0.0:
        return fuel.extinction_moisture
    fine_moisture = (dead * moistures[DEAD]).sum() / dead.sum()
    ratio = dead.sum() / live.sum()
    found = 2.9 * ratio * (1.0 - fine_moisture / fuel.extinction_moisture) - 0.226
    return max(float(found), fuel.extinction_moisture)


def net_load_weights(shares: Floats, savs_1_ft: Floats) -> Floats:
    """Return the weight g_ij of each class: the sum of the fractions in its size class.

    The classes are all dead or all live (Albini 1976, p. 15). ``shares`` contains the fraction of
    the total surface area in each class.
    """
    sizes = (savs_1_ft[:, None] < SIZE_CLASS_SAV_1_FT).sum(axis=1)
    return np.array(
        [shares[sizes == size].sum() if size < len(SIZE_CLASS_SAV_1_FT) else 0.0 for size in sizes]
    )


def reaction_part_lb_ft2(
    loads_lb_ft2: Floats, savs_1_ft: Floats, shares: Floats, moistures: Floats, extinction: float
) -> float:
    """Return w_n η_M η_s in lb/ft² for either the dead or the live fuel (Albini 1976, p. 15).

    The product of this number, Γ' and the heat content is that fuel's part of the reaction
    intensity.
    """
    net_load = (net_load_weights(shares, savs_1_ft) * loads_lb_ft2).sum() * (1.0 - MINERAL_CONTENT)
    damping = moisture_damping(float((shares * moistures).sum()), extinction) * mineral_damping()
    return float(net_load) * damping


def heat_part_btu_lb(savs_1_ft: Floats, shares: Floats, moistures: Floats) -> float:
    """Return Σ f_ij ε Q_ig in Btu/lb for the dead or the live fuel (Rothermel 1972, eq. 77)."""
    return sum(
        float(share) * effective_heating_number(float(sav)) * heat_of_preignition_btu_lb(float(wet))
        for share, sav, wet in zip(shares, savs_1_ft, moistures, strict=True)
    )


def fuel_bed(fuel: FuelModel, moisture: Moisture) -> FuelBed:
    """Return the coefficients of one fuel model at one moisture (Rothermel 1972, eq. 52).

    R0 includes the fuel's ``rate_factor``.
    """
    loads, savs, moistures = size_classes(fuel, moisture)
    areas = savs * loads / PARTICLE_DENSITY_LB_FT3
    extinctions = (fuel.extinction_moisture, live_extinction_moisture(fuel, moisture))
    sav = reacting = heat_to_ignite = 0.0
    heat_live = fuel.heat_btu_lb if fuel.heat_live_btu_lb is None else fuel.heat_live_btu_lb
    relative_heats = (1.0, heat_live / fuel.heat_btu_lb)
    for part, extinction, relative_heat in zip(
        (DEAD, LIVE), extinctions, relative_heats, strict=True
    ):
        area = areas[part].sum()
        if area == 0.0:
            continue
        shares = areas[part] / area
        weight = float(area / areas.sum())
        sav += weight * float((shares * savs[part]).sum())
        reacting += relative_heat * reaction_part_lb_ft2(
            loads[part], savs[part], shares, moistures[part], extinction
        )
        heat_to_ignite += weight * heat_part_btu_lb(savs[part], shares, moistures[part])
    bulk_density_lb_ft3 = float(loads.sum()) / fuel.depth_ft
    packing = bulk_density_lb_ft3 / PARTICLE_DENSITY_LB_FT3
    relative_packing = packing / optimum_packing_ratio(sav)
    velocity = optimum_reaction_velocity_1_min(sav, relative_packing)
    reaction = velocity * reacting * fuel.heat_btu_lb
    rate = reaction * propagating_flux_ratio(sav, packing) / (bulk_density_lb_ft3 * heat_to_ignite)
    b, c = wind_coefficients(sav, relative_packing)
    return FuelBed(fuel.rate_factor * rate, reaction, sav, b, c, slope_coefficient(packing))


def wind_factor(bed: FuelBed, wind_ft_min: float | Floats) -> float | Floats:
    """Return the wind factor φ_w from the midflame wind (Rothermel 1972, eq. 47)."""
    return bed.wind_c * np.power(wind_ft_min, bed.wind_b)


def wind_limit_ft_min(reaction_intensity_btu_ft2_min: float) -> float:
    """Return the upper limit of the effective wind in ft/min (Rothermel 1972, eq. 87)."""
    return 0.9 * reaction_intensity_btu_ft2_min


def slope_factor(bed: FuelBed, slope_tan: float | Floats) -> float | Floats:
    """Return the slope factor φ_s (Rothermel 1972, eq. 51).

    As in `behave`, the factor is at most the numerical value of the wind limit in ft/min. The limit
    matters only on steep slopes with fuel near its extinction moisture.
    """
    limit = wind_limit_ft_min(bed.reaction_intensity_btu_ft2_min)
    return np.minimum(bed.slope_k * np.square(slope_tan), limit)


def effective_wind_m_s(bed: FuelBed, factor: float | Floats) -> float | Floats:
    """Return the wind in m/s whose wind factor equals ``factor`` (Albini 1976, p. 88)."""
    return np.power(np.asarray(factor) / bed.wind_c, 1.0 / bed.wind_b) / FT_MIN_PER_M_S


def length_to_breadth(effective_wind_m_s: float | Floats) -> float | Floats:
    """Return the length-to-width ratio of the ellipse (Anderson 1983, INT-305), at most 8.

    Anderson's 0.2566 and 0.1548 per m/s are rounded as in `behave` to 0.1147 and 0.0692 per mph.
    """
    wind_mph = effective_wind_m_s / M_S_PER_MPH
    ratio = 0.936 * np.exp(0.1147 * wind_mph) + 0.461 * np.exp(-0.0692 * wind_mph) - 0.397
    return np.minimum(np.maximum(ratio, 1.0), MAX_LENGTH_TO_BREADTH)


def eccentricity(length_to_breadth: float | Floats) -> float | Floats:
    """Return the eccentricity e of an ellipse from its length-to-width ratio."""
    return np.sqrt(np.square(length_to_breadth) - 1.0) / length_to_breadth


def heat_per_area_btu_ft2(bed: FuelBed) -> float:
    """Return the heat per area: reaction intensity times residence time 384/σ (Anderson 1969)."""
    return bed.reaction_intensity_btu_ft2_min * 384.0 / bed.sav_1_ft


def fireline_intensity_kw_m(bed: FuelBed, rate_m_s: float | Floats) -> float | Floats:
    """Return Byram's fireline intensity in kW/m from the spread rate (Andrews 2018)."""
    rate_ft_s = np.asarray(rate_m_s) / M_PER_FT
    return heat_per_area_btu_ft2(bed) * rate_ft_s * KW_M_PER_BTU_FT_S


def flame_length_m(intensity_kw_m: float | Floats) -> float | Floats:
    """Return the flame length in metres (Byram 1959): 0.45 I^0.46 in feet and Btu/ft/s."""
    return 0.45 * np.power(np.asarray(intensity_kw_m) / KW_M_PER_BTU_FT_S, 0.46) * M_PER_FT


def fastest_spread(
    bed: FuelBed,
    midflame_wind_m_s: float | Floats,
    wind_toward_deg: float | Floats,
    slope_tan: Floats,
    upslope_deg: Floats,
    wind_limit: bool = False,
) -> tuple[Floats, Floats, Floats]:
    """Return the rate, direction and effective wind of the fastest spread (Andrews 2018).

    The factors of wind and slope are added as vectors. All arrays have the same shape (the wind may
    be a scalar). Directions are in degrees clockwise from north. The rate is along the slope; the
    rate and the effective wind are in m/s. ``wind_limit`` limits the effective wind to
    ``wind_limit_ft_min`` and thereby limits the rate.
    """
    still = bed.no_wind_rate_ft_min
    by_wind = np.asarray(wind_factor(bed, np.asarray(midflame_wind_m_s) * FT_MIN_PER_M_S))
    by_slope = np.asarray(slope_factor(bed, slope_tan))
    wind, up = np.deg2rad(wind_toward_deg), np.deg2rad(upslope_deg)
    north = by_wind * np.cos(wind) + by_slope * np.cos(up)
    east = by_wind * np.sin(wind) + by_slope * np.sin(up)
    factor = np.hypot(north, east)
    if wind_limit:
        limit = wind_limit_ft_min(bed.reaction_intensity_btu_ft2_min)
        factor = np.minimum(factor, wind_factor(bed, limit))
    rate_m_s = still * (1.0 + factor) / FT_MIN_PER_M_S
    effective = effective_wind_m_s(bed, factor) if still > 0.0 else np.zeros_like(factor)
    return rate_m_s, np.rad2deg(np.arctan2(east, north)) % 360.0, np.asarray(effective)
