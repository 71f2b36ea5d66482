"""Rothermel's surface fire spread model, one function per equation.

Rothermel 1972 (INT-115), with Albini's 1976 revisions, as set out by Andrews 2018
(RMRS-GTR-371). The equations are in their published units (feet, minutes, pounds, Btu); the
functions at the end give metres and seconds. No wind limit.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firemodel.fuels import FuelModel

HEAT_CONTENT_BTU_LB = 8000.0
MINERAL_CONTENT = 0.0555
SILICA_FREE_MINERAL_CONTENT = 0.010
PARTICLE_DENSITY_LB_FT3 = 32.0
M_PER_FT = 0.3048
FT_MIN_PER_M_S = 60.0 / M_PER_FT
M_S_PER_MPH = 0.44704
# As in the Forest Service's `behave`; the International Table Btu would give 3.4615.
KW_M_PER_BTU_FT_S = 3.46414
# Upper bounds of the size classes by which net loads are weighted (Albini 1976, p. 15).
SIZE_CLASS_SAV_1_FT = (1200.0, 192.0, 96.0, 48.0, 16.0)

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Moisture:
    """Fuel moisture as fractions of the oven-dry weight."""

    dead_1h: float
    dead_10h: float
    dead_100h: float
    live_herb: float
    live_woody: float

    @property
    def classes(self) -> tuple[float, float, float, float, float]:
        """In the order of a fuel model's classes."""
        return self.dead_1h, self.dead_10h, self.dead_100h, self.live_herb, self.live_woody


@dataclass(frozen=True, slots=True)
class FuelBed:
    """What the spread equations need of one fuel model at one moisture.

    ``no_wind_rate_ft_min`` is R0; the wind factor is ``wind_c * U**wind_b`` with U in ft/min (the
    packing ratio's part is in ``wind_c``), the slope factor ``slope_k * tan(slope)**2``.
    """

    no_wind_rate_ft_min: float
    reaction_intensity_btu_ft2_min: float
    sav_1_ft: float
    wind_b: float
    wind_c: float
    slope_k: float


def mineral_damping() -> float:
    """η_s, no unit: 0.4174 for the silica-free minerals of all fuels (Rothermel 1972, eq. 30)."""
    return min(0.174 * math.pow(SILICA_FREE_MINERAL_CONTENT, -0.19), 1.0)


def moisture_damping(moisture: float, extinction: float) -> float:
    """η_M of dead or live fuel, no unit; moistures are fractions (Rothermel 1972, eq. 29)."""
    if moisture >= extinction:
        return 0.0
    ratio = moisture / extinction
    return 1.0 - 2.59 * ratio + 5.11 * ratio**2 - 3.52 * ratio**3


def optimum_packing_ratio(sav_1_ft: float) -> float:
    """β_op, no unit, from σ in 1/ft (Rothermel 1972, eq. 37)."""
    return 3.348 * math.pow(sav_1_ft, -0.8189)


def optimum_reaction_velocity_1_min(sav_1_ft: float, relative_packing: float) -> float:
    """Γ' in 1/min from σ in 1/ft and β/β_op (Rothermel 1972, eqs. 36, 38; A by Albini 1976)."""
    largest = 1.0 / (0.0594 + 495.0 * math.pow(sav_1_ft, -1.5))
    a = 133.0 * math.pow(sav_1_ft, -0.7913)
    return largest * math.pow(relative_packing, a) * math.exp(a * (1.0 - relative_packing))


def propagating_flux_ratio(sav_1_ft: float, packing: float) -> float:
    """ξ, no unit, from σ in 1/ft and β (Rothermel 1972, eq. 42)."""
    return math.exp((0.792 + 0.681 * math.sqrt(sav_1_ft)) * (packing + 0.1)) / (
        192.0 + 0.2595 * sav_1_ft
    )


def heat_of_preignition_btu_lb(moisture: float) -> float:
    """Q_ig in Btu/lb; moisture is a fraction (Rothermel 1972, eq. 12)."""
    return 250.0 + 1116.0 * moisture


def effective_heating_number(sav_1_ft: float) -> float:
    """ε, no unit, from σ in 1/ft (Rothermel 1972, eq. 14)."""
    return math.exp(-138.0 / sav_1_ft)


def wind_coefficients(sav_1_ft: float, relative_packing: float) -> tuple[float, float]:
    """(B, C·(β/β_op)^-E) of the wind factor for wind in ft/min (Rothermel 1972, eqs. 47-50)."""
    c = 7.47 * math.exp(-0.133 * math.pow(sav_1_ft, 0.55))
    b = 0.02526 * math.pow(sav_1_ft, 0.54)
    e = 0.715 * math.exp(-3.59e-4 * sav_1_ft)
    return b, c * math.pow(relative_packing, -e)


def slope_coefficient(packing: float) -> float:
    """5.275 β^-0.3 of the slope factor, no unit (Rothermel 1972, eq. 51)."""
    return 5.275 * math.pow(packing, -0.3)


def live_extinction_moisture(fuel: FuelModel, moisture: Moisture) -> float:
    """M_x of the live fuel, a fraction (Albini 1976, p. 16; Andrews 2018).

    It falls with the moisture of the dead fuel and is never below M_x of the dead fuel.
    """
    loads, savs = fuel.loads_lb_ft2, fuel.savs_1_ft
    dead = [load * math.exp(-138.0 / sav) for load, sav in zip(loads[:3], savs[:3], strict=True)]
    live = [load * math.exp(-500.0 / sav) for load, sav in zip(loads[3:], savs[3:], strict=True)]
    if sum(live) == 0.0:
        return fuel.extinction_moisture
    water = [weight * wet for weight, wet in zip(dead, moisture.classes[:3], strict=True)]
    fine_moisture = sum(water) / sum(dead)
    ratio = sum(dead) / sum(live)
    found = 2.9 * ratio * (1.0 - fine_moisture / fuel.extinction_moisture) - 0.226
    return max(found, fuel.extinction_moisture)


def net_load_weights(shares: Floats, savs_1_ft: Floats) -> Floats:
    """g_ij, no unit: a class counts with the area of all classes of its size (Albini 1976, p. 15).

    ``shares`` are the classes' parts of the surface area of the dead, or of the live, fuel.
    """
    sizes = (savs_1_ft[:, None] < SIZE_CLASS_SAV_1_FT).sum(axis=1)
    return np.array(
        [shares[sizes == size].sum() if size < len(SIZE_CLASS_SAV_1_FT) else 0.0 for size in sizes]
    )


def reaction_part_btu_ft2(
    loads_lb_ft2: Floats, savs_1_ft: Floats, shares: Floats, moistures: Floats, extinction: float
) -> float:
    """w_n h η_M η_s of the dead, or of the live, fuel in Btu/ft² (Albini 1976, p. 15).

    Times Γ' it is that fuel's part of the reaction intensity.
    """
    net_load = (net_load_weights(shares, savs_1_ft) * loads_lb_ft2).sum() * (1.0 - MINERAL_CONTENT)
    damping = moisture_damping(float((shares * moistures).sum()), extinction) * mineral_damping()
    return float(net_load) * HEAT_CONTENT_BTU_LB * damping


def heat_part_btu_lb(savs_1_ft: Floats, shares: Floats, moistures: Floats) -> float:
    """Σ f_ij ε Q_ig of the dead, or of the live, fuel in Btu/lb (Rothermel 1972, eq. 77)."""
    return sum(
        float(share) * effective_heating_number(float(sav)) * heat_of_preignition_btu_lb(float(wet))
        for share, sav, wet in zip(shares, savs_1_ft, moistures, strict=True)
    )


def fuel_bed(fuel: FuelModel, moisture: Moisture) -> FuelBed:
    """The spread equations' terms for one fuel model at one moisture (Rothermel 1972, eq. 52)."""
    loads, savs = np.array(fuel.loads_lb_ft2), np.array(fuel.savs_1_ft)
    moistures = np.array(moisture.classes)
    areas = savs * loads / PARTICLE_DENSITY_LB_FT3
    extinctions = (fuel.extinction_moisture, live_extinction_moisture(fuel, moisture))
    sav = reaction_heat = heat_to_ignite = 0.0
    for part, extinction in zip((slice(0, 3), slice(3, 5)), extinctions, strict=True):
        area = areas[part].sum()
        if area == 0.0:
            continue
        shares = areas[part] / area
        weight = float(area / areas.sum())
        sav += weight * float((shares * savs[part]).sum())
        reaction_heat += reaction_part_btu_ft2(
            loads[part], savs[part], shares, moistures[part], extinction
        )
        heat_to_ignite += weight * heat_part_btu_lb(savs[part], shares, moistures[part])
    bulk_density_lb_ft3 = float(loads.sum()) / fuel.depth_ft
    packing = bulk_density_lb_ft3 / PARTICLE_DENSITY_LB_FT3
    relative_packing = packing / optimum_packing_ratio(sav)
    reaction = optimum_reaction_velocity_1_min(sav, relative_packing) * reaction_heat
    rate = reaction * propagating_flux_ratio(sav, packing) / (bulk_density_lb_ft3 * heat_to_ignite)
    b, c = wind_coefficients(sav, relative_packing)
    return FuelBed(rate, reaction, sav, b, c, slope_coefficient(packing))


def wind_factor(bed: FuelBed, wind_ft_min: float | Floats) -> float | Floats:
    """φ_w (Rothermel 1972, eq. 47); midflame wind."""
    return bed.wind_c * np.power(wind_ft_min, bed.wind_b)


def slope_factor(bed: FuelBed, slope_tan: float | Floats) -> float | Floats:
    """φ_s (Rothermel 1972, eq. 51)."""
    return bed.slope_k * np.square(slope_tan)


def effective_wind_m_s(bed: FuelBed, factor: float | Floats) -> float | Floats:
    """The wind that alone would give this combined wind and slope factor (Albini 1976, p. 88)."""
    return np.power(np.asarray(factor) / bed.wind_c, 1.0 / bed.wind_b) / FT_MIN_PER_M_S


def length_to_breadth(effective_wind_m_s: float | Floats) -> float | Floats:
    """Length over width of the ellipse, no upper bound (Anderson 1983, INT-305).

    Anderson's 0.2566 and 0.1548 per m/s, as `behave` rounds them: 0.1147 and 0.0692 per mph.
    """
    wind_mph = effective_wind_m_s / M_S_PER_MPH
    return np.maximum(
        0.936 * np.exp(0.1147 * wind_mph) + 0.461 * np.exp(-0.0692 * wind_mph) - 0.397, 1.0
    )


def eccentricity(length_to_breadth: float | Floats) -> float | Floats:
    """e of an ellipse of this length over width."""
    return np.sqrt(np.square(length_to_breadth) - 1.0) / length_to_breadth


def rate_towards(
    largest_rate: float | Floats, eccentricity: float | Floats, off_heading_rad: float | Floats
) -> float | Floats:
    """R(γ) = R_max (1 - e)/(1 - e cos γ), γ from the direction of fastest spread."""
    return largest_rate * (1.0 - eccentricity) / (1.0 - eccentricity * np.cos(off_heading_rad))


def flanking_rate(
    largest_rate: float | Floats, length_to_breadth: float | Floats
) -> float | Floats:
    """Speed at which the ellipse widens to one side: half its width per time."""
    backing = rate_towards(largest_rate, eccentricity(length_to_breadth), math.pi)
    return (largest_rate + backing) / (2.0 * length_to_breadth)


def heat_per_area_btu_ft2(bed: FuelBed) -> float:
    """Reaction intensity times residence time 384/σ (Anderson 1969)."""
    return bed.reaction_intensity_btu_ft2_min * 384.0 / bed.sav_1_ft


def fireline_intensity_kw_m(bed: FuelBed, rate_m_s: float | Floats) -> float | Floats:
    """Byram's intensity (Andrews 2018)."""
    rate_ft_s = np.asarray(rate_m_s) / M_PER_FT
    return heat_per_area_btu_ft2(bed) * rate_ft_s * KW_M_PER_BTU_FT_S


def flame_length_m(intensity_kw_m: float | Floats) -> float | Floats:
    """Byram 1959: 0.45 I^0.46 in feet and Btu/ft/s."""
    return 0.45 * np.power(np.asarray(intensity_kw_m) / KW_M_PER_BTU_FT_S, 0.46) * M_PER_FT


def fastest_spread(
    bed: FuelBed,
    midflame_wind_m_s: float,
    wind_toward_deg: float,
    slope_tan: Floats,
    upslope_deg: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Fastest spread with wind and slope from any two directions, added as vectors.

    Arrays of one shape; directions clockwise from north. Returns (rate m/s, direction deg,
    effective wind m/s). Andrews 2018.
    """
    by_wind = bed.no_wind_rate_ft_min * wind_factor(bed, midflame_wind_m_s * FT_MIN_PER_M_S)
    by_slope = bed.no_wind_rate_ft_min * slope_factor(bed, slope_tan)
    wind, up = math.radians(wind_toward_deg), np.deg2rad(upslope_deg)
    north = by_wind * math.cos(wind) + by_slope * np.cos(up)
    east = by_wind * math.sin(wind) + by_slope * np.sin(up)
    added = np.hypot(north, east)
    rate_m_s = (bed.no_wind_rate_ft_min + added) / FT_MIN_PER_M_S
    if bed.no_wind_rate_ft_min > 0.0:
        effective = effective_wind_m_s(bed, added / bed.no_wind_rate_ft_min)
    else:
        effective = np.zeros_like(added)
    return rate_m_s, np.rad2deg(np.arctan2(east, north)) % 360.0, np.asarray(effective)
