"""Compute how far firebrands fly and whether they ignite fuel, with one function per equation.

Distances are maximum distances, over flat ground or between a ridge and a valley: from torching
trees (Albini 1979, INT-56), burning piles (Albini 1981, INT-309), surface fires without trees
(Albini 1983, INT-309; Morris 1987, INT-374) and active crown fires (Albini, Alexander & Cruz 2012,
Int. J. Wildland Fire 21, 609-627). Probabilities of ignition are computed for firebrands (Schroeder
1969) and for lightning (Latham & Schlieter 1989, INT-411). Where the publications allow
alternatives, this module follows the Forest Service's `behave`. The functions take SI units.
"""

import math
from typing import Literal, NamedTuple

from firemodel.compiled import kernel
from firemodel.physics.rothermel import M_PER_FT, M_S_PER_MPH

M_PER_MI = 5280.0 * M_PER_FT
CM_PER_IN = 2.54
LITTLE = 1e-7  # smaller numbers count as 0


class Species(NamedTuple):
    """Factor and exponent of a torching tree's flame height (ft) and duration, by diameter (in)."""

    height: tuple[float, float]
    duration: tuple[float, float]


_SPRUCE, _PONDEROSA, _FIR = (15.7, 0.451), (12.9, 0.453), (16.5, 0.515)
_SOUTHERN = (2.71, 1.000)
_LONG, _MIDDLE = (12.6, -0.256), (10.7, -0.278)
SPECIES = {
    "engelmann_spruce": Species(_SPRUCE, _LONG),
    "douglas_fir": Species(_SPRUCE, _MIDDLE),
    "subalpine_fir": Species(_SPRUCE, _MIDDLE),
    "western_hemlock": Species(_SPRUCE, (6.30, -0.249)),
    "ponderosa_pine": Species(_PONDEROSA, _LONG),
    "lodgepole_pine": Species(_PONDEROSA, _LONG),
    "western_white_pine": Species(_PONDEROSA, _MIDDLE),
    "grand_fir": Species(_FIR, _MIDDLE),
    "balsam_fir": Species(_FIR, _MIDDLE),
    "slash_pine": Species(_SOUTHERN, (11.9, -0.389)),
    "longleaf_pine": Species(_SOUTHERN, (11.9, -0.389)),
    "pond_pine": Species(_SOUTHERN, (7.91, -0.344)),
    "shortleaf_pine": Species(_SOUTHERN, (7.91, -0.344)),
    "loblolly_pine": Species(_SOUTHERN, (13.5, -0.544)),
}
# Factor and exponent of the flame duration in the ratio of firebrand height to flame height.
_TALL_TREES, _TREES, _SHORT, _STEADY = (4.24, 0.332), (3.64, 0.391), (2.78, 0.418), (4.70, 0.0)
# The index is the phase of the fire's location between ridge and valley, in quarter turns.
LOCATIONS = ("midslope_windward", "valley_bottom", "midslope_leeward", "ridge_top")


def cover_height_ft(firebrand_height_ft: float, cover_ft: float) -> float:
    """Return the height to use for the downwind cover: at least a minimum (Albini 1979)."""
    if firebrand_height_ft < LITTLE:
        return max(cover_ft, 0.0)
    return max(cover_ft, 2.2 * math.pow(firebrand_height_ft, 0.337) - 4.0)


def flat_distance_m(firebrand_height_m: float, cover_m: float, wind_20ft_m_s: float) -> float:
    """Return the distance over flat ground from the firebrand height (Albini 1979).

    ``cover_m`` is the height of the trees downwind; for open stands, give half of this height.
    """
    height_ft = firebrand_height_m / M_PER_FT
    cover_ft = cover_height_ft(height_ft, cover_m / M_PER_FT)
    if cover_ft < LITTLE or height_ft < LITTLE:
        return 0.0
    ratio = height_ft / cover_ft
    reach = 0.362 + math.sqrt(ratio) / 2.0 * math.log(ratio)
    found_mi = 0.000718 * wind_20ft_m_s / M_S_PER_MPH * math.sqrt(cover_ft) * reach
    return found_mi * M_PER_MI


def mountain_distance_m(
    flat_m: float, location: str, ridge_to_valley_m: float, relief_m: float
) -> float:
    """Return the distance over ridges and valleys from the distance over flat ground.

    Args:
        flat_m: The distance over flat ground.
        location: The location of the fire, one of ``LOCATIONS``.
        ridge_to_valley_m: Horizontal distance between ridge and valley.
        relief_m: Height of the ridge above the valley; 0 gives the distance over flat ground.

    The equation (Albini 1979) is solved with six fixed-point iterations, as in `behave`.
    """
    if relief_m < LITTLE or ridge_to_valley_m < LITTLE:
        return flat_m
    flat, phase = flat_m / ridge_to_valley_m, LOCATIONS.index(location) * math.pi / 2.0
    steepness = relief_m / M_PER_FT / (10.0 * math.pi) / 1000.0
    found = flat
    for _ in range(6):
        found = flat - steepness * (math.cos(math.pi * found - phase) - math.cos(phase))
    return found * ridge_to_valley_m


class Torching(NamedTuple):
    """The flame of trees that torch together (Albini 1979), and the height of its firebrands."""

    flame_height_m: float
    flame_duration: float  # dimensionless
    firebrand_height_m: float


def torching_trees(species: str, dbh_m: float, tree_height_m: float, trees: float) -> Torching:
    """Return the flame and the firebrand height of a number of ``trees`` that torch together.

    ``species`` is a key of ``SPECIES``; ``dbh_m`` is the diameter at breast height.
    """
    dbh_in = dbh_m * 100.0 / CM_PER_IN
    parameters = SPECIES[species]
    flame_ft = parameters.height[0] * dbh_in ** parameters.height[1] * trees**0.4
    duration = parameters.duration[0] * dbh_in ** parameters.duration[1] * trees**-0.2
    tree_ft = tree_height_m / M_PER_FT
    ratio = tree_ft / flame_ft
    if ratio >= 1.0:
        factor, exponent = _TALL_TREES
    elif ratio >= 0.5:
        factor, exponent = _TREES
    else:
        factor, exponent = _SHORT if duration < 3.5 else _STEADY
    height_ft = factor * duration**exponent * flame_ft + tree_ft / 2.0
    return Torching(flame_ft * M_PER_FT, duration, height_ft * M_PER_FT)


def pile_firebrand_height_m(flame_height_m: float) -> float:
    """Return the height of firebrands from a burning pile (Albini 1981)."""
    return 12.2 * flame_height_m


def surface_firebrand_height_m(flame_length_m: float, wind_20ft_m_s: float) -> float:
    """Return the height of firebrands from a surface fire in wind (Albini 1983; Morris 1987)."""
    if flame_length_m < LITTLE or wind_20ft_m_s < LITTLE:
        return 0.0
    intensity_btu_ft_s = math.pow(flame_length_m / M_PER_FT / 0.45, 1.0 / 0.46)
    thermal = 322.0 * math.pow(0.474 * wind_20ft_m_s / M_S_PER_MPH, -1.01)
    return 1.055 * math.sqrt(thermal * intensity_btu_ft_s) * M_PER_FT


def surface_distance_m(flame_length_m: float, cover_m: float, wind_20ft_m_s: float) -> float:
    """Return the distance over flat ground from a surface fire, including the drift."""
    height_m = surface_firebrand_height_m(flame_length_m, wind_20ft_m_s)
    if height_m < LITTLE:
        return 0.0
    drift_mi = 0.000278 * wind_20ft_m_s / M_S_PER_MPH * math.pow(height_m / M_PER_FT, 0.643)
    return flat_distance_m(height_m, cover_m, wind_20ft_m_s) + drift_mi * M_PER_MI


# Active crown fire -------------------------------------------------------------------------------

WIND_HEIGHT_M = 6.096
GRAVITY_M_S2 = 9.82
EMBER_MM = 0.5  # diameter of a firebrand when it lands
STEP = 0.2  # step along the plume's axis, in canopy heights
MAX_STEPS = 50_000
MIN_CROWN_KW_M = 1000.0


@kernel
def canopy_wind_m_s(canopy_m: float, wind_20ft_m_s: float) -> float:
    """Return the wind at the top of the canopy (Albini, Alexander & Cruz 2012, eq. 2)."""
    return wind_20ft_m_s / (1.0 + math.log(1.0 + 2.94 * WIND_HEIGHT_M / canopy_m))


@kernel
def crown_flame_height_m(canopy_m: float, wind_m_s: float, intensity_kw_m: float) -> float:
    """Return the height of the flames above the canopy, for the wind at the canopy top.

    The height follows from y ln y = c with y = 1 + 2.94 height/canopy, which is solved by bisection
    to within 1e-6, as in `behave`.
    """
    target = 7.791e-3 * intensity_kw_m / (canopy_m * wind_m_s)
    low, high = 1.0, math.exp(min(target, 500.0))
    for _ in range(2000):
        middle = 0.5 * (low + high)
        found = middle * math.log(middle)
        if abs(found - target) <= 1e-6:
            break
        low, high = (low, middle) if found >= target else (middle, high)
    return canopy_m * (middle - 1.0) / 2.94


class Plume(NamedTuple):
    """The bent plume above a flame, scaled by the canopy height and the wind at the canopy top."""

    wind: float  # as a Froude number
    flame_height: float
    mass_flux: float
    horizontal: float  # speed at the tip of the flame
    upward: float
    angle: float


@kernel
def crown_plume(canopy_m: float, wind_m_s: float, flame_height_m: float) -> Plume:
    """Return the plume at the tip of the flames."""
    height, wind = flame_height_m / canopy_m, wind_m_s / math.sqrt(GRAVITY_M_S2 * canopy_m)
    profile = 1.0 + 2.94 * height
    log_profile = math.log(profile)
    mass_flux = 0.468 * profile * log_profile
    horizontal = 1.3765 * (height + profile * log_profile**2) / mass_flux
    slant = profile - 1.0 + profile * log_profile**2
    tangent = 1.40 * height / (wind * math.sqrt(slant))
    return Plume(wind, height, mass_flux, horizontal, tangent * horizontal, math.atan(tangent))


@kernel
def crown_loft(plume: Plume, eta: float) -> tuple[float, float]:
    """Return how far and how high the plume carries a firebrand, in canopy heights.

    The firebrand leaves the plume where the plume's lift is too small. ``eta`` is the firebrand's
    diameter at the canopy top, divided by the diameter that burns away in a fall of one canopy
    height. The plume is followed in steps of ``STEP``, so that the height is a step function, as in
    `behave`.
    """
    sine, cosine = math.sin(plume.angle), math.cos(plume.angle)
    speed = math.hypot(plume.horizontal, plume.upward)
    half_width = 0.5 * plume.mass_flux / (0.6 * speed)
    x, z = plume.flame_height / math.tan(plume.angle), plume.flame_height
    lower, upper = (half_width * sine, 0.0), (x + half_width * sine, z - half_width * cosine)
    lift, momentum = 0.5 * 0.6 * plume.upward**2, plume.mass_flux * plume.upward
    profile = 1.0 + 2.94 * plume.flame_height
    entrained = 0.3765 * (plume.flame_height + profile * math.log(profile) ** 2)
    for _ in range(MAX_STEPS):
        if lift < 0.00838 / plume.wind**2 * (upper[1] + eta):
            return lower
        x, z = x + STEP * cosine, z + STEP * sine
        profile = 1.0 + 2.94 * z
        log_profile = math.log(profile)
        mass_flux = 0.34 * profile * log_profile + 0.2735 * plume.mass_flux
        horizontal = (z + 0.34 * profile * log_profile**2 + entrained) / mass_flux
        momentum += 2.0 * plume.mass_flux / (3.0 * plume.wind**2) / speed * STEP * sine
        upward = momentum / mass_flux
        speed = math.hypot(horizontal, upward)
        heat = 1.0 + 2.0 * plume.mass_flux / 3.0 / mass_flux
        sine, cosine = upward / speed, horizontal / speed
        half_width = 0.5 * mass_flux * heat / speed
        lift = 0.5 * upward**2 / heat
        lower, upper = upper, (x + half_width * sine, z - half_width * cosine)
    return 0.0, 0.0


@kernel
def crown_distance_m(canopy_m: float, intensity_kw_m: float, wind_20ft_m_s: float) -> float:
    """Return the distance over flat ground from an active crown fire.

    ``canopy_m`` is the height of the trees; for open stands downwind, give half of this height. The
    distance is 0 below ``MIN_CROWN_KW_M``.
    """
    if canopy_m <= 0.1 or wind_20ft_m_s <= 0.1 / 3.6 or intensity_kw_m < MIN_CROWN_KW_M:
        return 0.0
    wind_m_s = canopy_wind_m_s(canopy_m, wind_20ft_m_s)
    flame_m = crown_flame_height_m(canopy_m, wind_m_s, intensity_kw_m)
    plume = crown_plume(canopy_m, wind_m_s, flame_m)
    burns_mm = 0.064 * canopy_m
    eta = (EMBER_MM + burns_mm) / burns_mm
    away, height = crown_loft(plume, eta)
    below, above = math.sqrt(eta / (eta + height)), math.sqrt(eta / (eta - 0.34))
    ratio = above / below
    logs = math.log((ratio + 1.0) / (ratio - 1.0)) - math.log((above + 1.0) / (above - 1.0))
    drift = 1.0 + math.log(1.0 + 2.94 * height) - below + logs / ratio
    flight: float = away + 10.9 * drift * plume.wind * math.sqrt(height + eta)
    return canopy_m * flight


@kernel
def firebrand_flights(intensity_kw_m: float, wind_m_s: float) -> tuple[float, float]:
    """Return μ and σ of the log-normal distances (m) of firebrands (Sardoy et al. 2008).

    Sardoy et al., Combustion & Flame 154, 478-488, for the wind at the top of the canopy, with the
    Froude number of Perryman et al. (2013, Int. J. Wildland Fire 22, 350-358), which separates
    buoyancy-driven plumes from wind-driven plumes.
    """
    intensity_mw_m = intensity_kw_m / 1000.0
    length_m = (1000.0 * intensity_kw_m / (1.1 * 1121.0 * 300.0 * math.sqrt(9.8))) ** (2.0 / 3.0)
    if wind_m_s / math.sqrt(9.8 * length_m) <= 1.0:
        mu = 1.47 * intensity_mw_m**0.54 * wind_m_s**-0.55 + 1.14
        return mu, 0.86 * intensity_mw_m**-0.21 * wind_m_s**0.44 + 0.19
    mu = 1.32 * intensity_mw_m**0.26 * wind_m_s**0.11 - 0.02
    return mu, 4.95 * intensity_mw_m**-0.01 * wind_m_s**-0.02 - 3.48


# Ignition ----------------------------------------------------------------------------------------


def fuel_temperature_c(air_temperature_c: float, shade: float) -> float:
    """Return the temperature of fine fuel in sun and shade (fraction), as in `behave`."""
    return air_temperature_c + (25.0 - 20.0 * shade) / 1.8


def firebrand_ignition_probability(temperature_c: float, fine_moisture: float) -> float:
    """Return the probability that a firebrand ignites fine dead fuel (Schroeder 1969).

    ``temperature_c`` is the fuel temperature; the moisture is a fraction.
    """
    heat = 144.51 - 0.266 * temperature_c - 0.00058 * temperature_c**2
    heat += -temperature_c * fine_moisture + 640.0 * fine_moisture
    heat += 18.54 * (1.0 - math.exp(-15.1 * fine_moisture))
    return min(0.000048 * math.pow(max(0.1 * (400.0 - heat), 0.0), 4.3) / 50.0, 1.0)


class LightningFuel(NamedTuple):
    """How the probability of ignition by a continuing current depends on the fuel.

    The coefficients (a, b) are given for positive and for negative strokes. "exponential" and
    "linear" are functions of the 100-h moisture in percent, a exp(-b x) and a - b x; "logistic" is
    a function of the duff's depth in cm, 1 / (1 + exp(a - b x)).
    """

    form: Literal["exponential", "linear", "logistic"]
    positive: tuple[float, float]
    negative: tuple[float, float]

    def probability(self, positive: bool, hundred_hour_pct: float, duff_depth_cm: float) -> float:
        """Return the probability for a stroke of the given polarity."""
        form = self.form
        if not positive and self is HIGH_ALTITUDE:
            form = "linear"
        a, b = self.positive if positive else self.negative
        if form == "logistic":
            return 1.0 / (1.0 + math.exp(a - b * duff_depth_cm))
        if form == "linear":
            return a - b * hundred_hour_pct
        return a * math.exp(-b * hundred_hour_pct)


HIGH_ALTITUDE = LightningFuel("exponential", (0.62, 0.050), (0.80, 0.014))  # negative: linear
LIGHTNING = {
    "ponderosa_pine_litter": LightningFuel("exponential", (0.92, 0.087), (1.04, 0.054)),
    "punky_wood_rotten_chunky": LightningFuel("exponential", (0.44, 0.110), (0.59, 0.094)),
    "punky_wood_powder_deep": LightningFuel("exponential", (0.86, 0.060), (0.90, 0.056)),
    "punk_wood_powder_shallow": LightningFuel("linear", (0.60, 0.011), (0.73, 0.011)),
    "lodgepole_pine_duff": LightningFuel("logistic", (5.13, 0.68), (3.84, 0.60)),
    "douglas_fir_duff": LightningFuel("logistic", (6.69, 1.39), (5.48, 1.28)),
    "high_altitude_mixed": HIGH_ALTITUDE,
    "peat_moss": LightningFuel("exponential", (0.71, 0.070), (0.84, 0.060)),
}
POSITIVE_CONTINUES, NEGATIVE_CONTINUES = 0.9, 0.2  # share of strokes with a continuing current
POSITIVE_SHARE = 0.277  # of all strokes


def lightning_ignition_probability(
    fuel: str, hundred_hour_pct: float, duff_depth_cm: float, charge: str
) -> float:
    """Return the probability that a lightning stroke ignites the fuel (Latham & Schlieter 1989).

    Args:
        fuel: A key of ``LIGHTNING``.
        hundred_hour_pct: Moisture of the 100-h fuel; more than 40 % counts as 40 %.
        duff_depth_cm: Depth of the duff; more than 10 cm counts as 10 cm.
        charge: "negative", "positive" or "unknown".
    """
    wet_pct, depth_cm = min(hundred_hour_pct, 40.0), min(duff_depth_cm, 10.0)
    positive, negative = (
        share * LIGHTNING[fuel].probability(sign, wet_pct, depth_cm)
        for sign, share in ((True, POSITIVE_CONTINUES), (False, NEGATIVE_CONTINUES))
    )
    unknown = POSITIVE_SHARE * positive + (1.0 - POSITIVE_SHARE) * negative
    found = {"positive": positive, "negative": negative, "unknown": unknown}[charge]
    return min(max(found, 0.0), 1.0)
