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
KW_M_PER_BTU_FT_S = 3.46414586
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
    """η_s (Andrews 2018, p. 24)."""
    return min(0.174 * SILICA_FREE_MINERAL_CONTENT**-0.19, 1.0)


def moisture_damping(moisture: float, extinction: float) -> float:
    """η_M of one category (Rothermel 1972, eq. 29)."""
    ratio = min(moisture / extinction, 1.0) if extinction > 0 else 1.0
    return max(0.0, 1.0 - 2.59 * ratio + 5.11 * ratio**2 - 3.52 * ratio**3)


def optimum_packing_ratio(sav_1_ft: float) -> float:
    """β_op (Rothermel 1972, eq. 37)."""
    return 3.348 * sav_1_ft**-0.8189


def optimum_reaction_velocity_1_min(sav_1_ft: float, relative_packing: float) -> float:
    """Γ' (Rothermel 1972, eqs. 36, 38; A by Albini 1976)."""
    largest = sav_1_ft**1.5 / (495.0 + 0.0594 * sav_1_ft**1.5)
    a = 133.0 * sav_1_ft**-0.7913
    return largest * relative_packing**a * math.exp(a * (1.0 - relative_packing))


def propagating_flux_ratio(sav_1_ft: float, packing: float) -> float:
    """ξ (Rothermel 1972, eq. 42)."""
    return math.exp((0.792 + 0.681 * math.sqrt(sav_1_ft)) * (packing + 0.1)) / (
        192.0 + 0.2595 * sav_1_ft
    )


def heat_of_preignition_btu_lb(moisture: float) -> float:
    """Q_ig (Rothermel 1972, eq. 12)."""
    return 250.0 + 1116.0 * moisture


def effective_heating_number(sav_1_ft: float) -> float:
    """ε (Rothermel 1972, eq. 14)."""
    return math.exp(-138.0 / sav_1_ft)


def wind_coefficients(sav_1_ft: float, relative_packing: float) -> tuple[float, float]:
    """(B, C·(β/β_op)^-E) of the wind factor (Rothermel 1972, eqs. 47-50)."""
    c = 7.47 * math.exp(-0.133 * sav_1_ft**0.55)
    b = 0.02526 * sav_1_ft**0.54
    e = 0.715 * math.exp(-3.59e-4 * sav_1_ft)
    return b, c * relative_packing**-e


def slope_coefficient(packing: float) -> float:
    """5.275 β^-0.3 of the slope factor (Rothermel 1972, eq. 51)."""
    return 5.275 * packing**-0.3


def live_extinction_moisture(fuel: FuelModel, moisture: Moisture) -> float:
    """M_x of the live fuel (Albini 1976, p. 16; Andrews 2018, p. 28)."""
    loads, savs = fuel.loads_lb_ft2, fuel.savs_1_ft
    dead = [load * math.exp(-138.0 / sav) for load, sav in zip(loads[:3], savs[:3], strict=True)]
    live = [load * math.exp(-500.0 / sav) for load, sav in zip(loads[3:], savs[3:], strict=True)]
    if sum(live) == 0.0:
        return fuel.extinction_moisture
    fine_moisture = (
        sum(weight * wet for weight, wet in zip(dead, moisture.classes[:3], strict=True))
        / sum(dead)
    )
    ratio = sum(dead) / sum(live)
    found = 2.9 * ratio * (1.0 - fine_moisture / fuel.extinction_moisture) - 0.226
    return max(found, fuel.extinction_moisture)


def net_load_weights(areas: Floats, savs: tuple[float, ...]) -> Floats:
    """g_ij: a class counts with the area of all classes of its size (Albini 1976, p. 15)."""
    sizes = np.array([sum(sav < bound for bound in SIZE_CLASS_SAV_1_FT) for sav in savs])
    return np.array([areas[sizes == size].sum() if size < 5 else 0.0 for size in sizes])


def fuel_bed(fuel: FuelModel, moisture: Moisture) -> FuelBed:
    """The spread equations' terms for one fuel model at one moisture."""
    loads = np.array(fuel.loads_lb_ft2)
    savs = np.array(fuel.savs_1_ft)
    wet = np.array(moisture.classes)
    area = savs * loads / PARTICLE_DENSITY_LB_FT3
    dead, live = np.s_[:3], np.s_[3:]
    extinction = (fuel.extinction_moisture, live_extinction_moisture(fuel, moisture))
    total_area = area.sum()
    sav = net_reaction = heat_sink = 0.0
    for part, limit in zip((dead, live), extinction, strict=True):
        part_area = area[part].sum()
        if part_area == 0.0:
            continue
        share = area[part] / part_area
        weight = part_area / total_area
        sav += weight * float((share * savs[part]).sum())
        net_weights = net_load_weights(share, tuple(savs[part]))
        net_load = float((net_weights * loads[part]).sum()) * (1.0 - MINERAL_CONTENT)
        damping = moisture_damping(float((share * wet[part]).sum()), limit)
        net_reaction += net_load * HEAT_CONTENT_BTU_LB * damping * mineral_damping()
        heat_sink += weight * sum(
            part_share * effective_heating_number(size) * heat_of_preignition_btu_lb(water)
            for part_share, size, water in zip(share, savs[part], wet[part], strict=True)
        )
    bulk_density = float(loads.sum()) / fuel.depth_ft
    packing = bulk_density / PARTICLE_DENSITY_LB_FT3
    relative_packing = packing / optimum_packing_ratio(sav)
    reaction = optimum_reaction_velocity_1_min(sav, relative_packing) * net_reaction
    rate = reaction * propagating_flux_ratio(sav, packing) / (bulk_density * heat_sink)
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


def wind_adjustment_factor(depth_ft: float) -> float:
    """Midflame wind over 20-ft wind, fuel not sheltered (Andrews 2012, RMRS-GTR-266, eq. 6)."""
    return 1.83 / math.log((20.0 + 0.36 * depth_ft) / (0.13 * depth_ft))


def length_to_breadth(effective_wind_m_s: float | Floats) -> float | Floats:
    """Length over width of the ellipse (Anderson 1983, INT-305)."""
    return np.maximum(
        0.936 * np.exp(0.2566 * effective_wind_m_s)
        + 0.461 * np.exp(-0.1548 * effective_wind_m_s)
        - 0.397,
        1.0,
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
    """Byram's intensity (Andrews 2018, p. 38)."""
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
    effective wind m/s). Andrews 2018, p. 33.
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
