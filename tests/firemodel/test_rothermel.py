"""Each equation is compared with a published or hand-computed value, and all with `behave`."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firemodel.arrays import Floats
from firemodel.physics import rothermel
from firemodel.physics.fuels import FUEL_MODELS, NON_BURNABLE, check_codes
from firemodel.physics.rothermel import Moisture, fastest_spread, fuel_bed
from tests.firemodel.shared import shared_file

M_S_PER_MPH = 0.44704
M_S_PER_CHAIN_H = 20.1168 / 3600.0
DRY = Moisture(0.06, 0.07, 0.08, 0.60, 0.90)


def rate_towards(
    largest_rate: float | Floats, eccentricity: float | Floats, off_heading_rad: float
) -> float | Floats:
    """Return R(γ) = R_max (1 - e)/(1 - e cos γ); γ is the angle from the fastest spread."""
    return largest_rate * (1.0 - eccentricity) / (1.0 - eccentricity * math.cos(off_heading_rad))


def flanking_rate(largest_rate: float, length_to_breadth: float) -> float:
    """Return the speed at which the ellipse widens to one side: half its width per time."""
    backing = rate_towards(largest_rate, rothermel.eccentricity(length_to_breadth), math.pi)
    return float((largest_rate + backing) / (2.0 * length_to_breadth))


def spread(
    code: int,
    moisture: Moisture,
    midflame_mph: float,
    slope_tan: float,
    wind_off_upslope_deg: float = 0.0,
) -> dict[str, float]:
    """Return the results of `behave` in its units; directions are clockwise from upslope."""
    bed = fuel_bed(FUEL_MODELS[code], moisture)
    wind_m_s = midflame_mph * M_S_PER_MPH
    rates, towards_deg, winds = fastest_spread(
        bed, wind_m_s, wind_off_upslope_deg, np.array([slope_tan]), np.array([0.0])
    )
    rate, effective = float(rates[0]), float(winds[0])
    ratio = float(rothermel.length_to_breadth(effective))
    intensity = rothermel.fireline_intensity_kw_m(bed, rate)
    backing = rate_towards(rate, rothermel.eccentricity(ratio), math.pi)
    return {
        "ros_ch_h": rate / M_S_PER_CHAIN_H,
        "fli_kW_m": float(intensity),
        "fl_ft": float(rothermel.flame_length_m(intensity)) / 0.3048,
        "HPA_btu_ft2": rothermel.heat_per_area_btu_ft2(bed),
        "RI_btu_ft2_min": bed.reaction_intensity_btu_ft2_min,
        "LW": ratio,
        "back_ch_h": float(backing) / M_S_PER_CHAIN_H,
        "flank_ch_h": float(flanking_rate(rate, ratio)) / M_S_PER_CHAIN_H,
        "towards_deg": float(towards_deg[0]),
    }


def test_mineral_damping_is_the_published_constant() -> None:
    assert rothermel.mineral_damping() == pytest.approx(0.4174, abs=5e-5)


def test_moisture_damping_falls_from_one_to_nothing_at_extinction() -> None:
    assert rothermel.moisture_damping(0.0, 0.25) == 1.0
    assert rothermel.moisture_damping(0.125, 0.25) == pytest.approx(0.5425)  # = 1-1.295+1.2775-0.44
    assert rothermel.moisture_damping(0.2499, 0.25) == pytest.approx(0.0, abs=2e-3)
    assert rothermel.moisture_damping(0.25, 0.25) == 0.0
    assert rothermel.moisture_damping(0.60, 0.25) == 0.0


def test_heat_of_preignition_is_in_btu_per_pound() -> None:
    assert rothermel.heat_of_preignition_btu_lb(0.10) == pytest.approx(361.6)


def test_effective_heating_number_tends_to_one_for_fine_fuel() -> None:
    assert rothermel.effective_heating_number(138.0) == pytest.approx(math.exp(-1.0))
    assert rothermel.effective_heating_number(3500.0) == pytest.approx(0.9613, abs=5e-5)


def test_propagating_flux_ratio_of_short_grass() -> None:
    # exp((0.792 + 0.681 * 59.161) * 0.10106) / (192 + 908.25)
    assert rothermel.propagating_flux_ratio(3500.0, 0.0010625) == pytest.approx(0.05776, rel=1e-3)


def test_reaction_velocity_peaks_at_the_optimum_packing() -> None:
    at_optimum = rothermel.optimum_reaction_velocity_1_min(3500.0, 1.0)
    assert at_optimum == pytest.approx(16.183, rel=1e-3)  # per minute
    for relative_packing in (0.5, 2.0):
        assert rothermel.optimum_reaction_velocity_1_min(3500.0, relative_packing) < at_optimum


def test_wind_coefficients_of_short_grass() -> None:
    b, c = rothermel.wind_coefficients(3500.0, 1.0)
    assert b == pytest.approx(2.0712, rel=1e-3)
    assert c == pytest.approx(7.47 * math.exp(-0.133 * 3500.0**0.55), rel=1e-12)
    assert rothermel.wind_coefficients(3500.0, 0.25)[1] > c


def test_slope_factor_grows_with_the_square_of_the_slope() -> None:
    bed = fuel_bed(FUEL_MODELS[1], DRY)
    assert rothermel.slope_coefficient(1.0) == 5.275
    assert rothermel.slope_factor(bed, 0.4) == pytest.approx(4 * rothermel.slope_factor(bed, 0.2))


def test_live_extinction_moisture_falls_with_wet_dead_fuel_but_not_below_that_of_the_dead() -> None:
    fuel = FUEL_MODELS[4]
    dry = rothermel.live_extinction_moisture(fuel, Moisture(0.03, 0.04, 0.05, 0.7, 0.7))
    damp = rothermel.live_extinction_moisture(fuel, Moisture(0.12, 0.13, 0.14, 0.7, 0.7))
    wet = rothermel.live_extinction_moisture(fuel, Moisture(0.30, 0.30, 0.30, 0.7, 0.7))
    assert dry > damp > wet == fuel.extinction_moisture


def test_length_to_breadth_is_one_without_wind_and_at_most_eight() -> None:
    assert rothermel.length_to_breadth(0.0) == 1.0
    anderson = 0.936 * math.exp(0.2566 * 5) + 0.461 * math.exp(-0.1548 * 5) - 0.397
    assert rothermel.length_to_breadth(5.0) == pytest.approx(anderson, rel=1e-3)
    assert 7.5 < rothermel.length_to_breadth(8.3) < 8.0
    assert rothermel.length_to_breadth(12.0) == 8.0


def test_the_ellipse_has_its_length_and_width() -> None:
    """Head plus back, divided by both flanks, is the length-to-breadth ratio."""
    e = rothermel.eccentricity(2.5)
    head_and_back = 1.0 + rate_towards(1.0, e, math.pi)
    assert rate_towards(1.0, e, 0.0) == 1.0
    assert head_and_back / (2.0 * flanking_rate(1.0, 2.5)) == pytest.approx(2.5)


def test_flame_length_of_a_thousand_btu_per_foot_and_second() -> None:
    assert rothermel.flame_length_m(1000 * 3.46414) == pytest.approx(0.45 * 1000**0.46 * 0.3048)


@pytest.mark.parametrize(
    ("code", "sav_1_ft", "packing_ratio"),
    [
        *[(1, 3500, 0.00106), (2, 2784, 0.00575), (3, 1500, 0.00172), (4, 1739, 0.00383)],
        *[(5, 1683, 0.00252), (6, 1564, 0.00345), (7, 1552, 0.00280), (8, 1889, 0.03594)],
        *[(9, 2484, 0.02500), (10, 1764, 0.01725), (11, 1182, 0.01653), (12, 1145, 0.02156)],
        (13, 1159, 0.02779),
    ],
)
def test_fuel_beds_have_the_published_size_and_packing(
    code: int, sav_1_ft: float, packing_ratio: float
) -> None:
    """SAVs are tabulated for Anderson's models; load / depth / 32 lb/ft³ is computed by hand."""
    fuel = FUEL_MODELS[code]
    assert fuel_bed(fuel, DRY).sav_1_ft == pytest.approx(sav_1_ft, abs=0.6)
    packing = sum(fuel.loads_lb_ft2) / fuel.depth_ft / rothermel.PARTICLE_DENSITY_LB_FT3
    assert packing == pytest.approx(packing_ratio, abs=1e-5)


@pytest.mark.parametrize(
    ("moisture", "rate_chains_h", "flame_ft"),
    [
        (Moisture(0.03, 0.04, 0.05, 0.70, 0.70), 100, 24.1),
        (Moisture(0.12, 0.13, 0.14, 1.70, 1.70), 20, 7.4),
    ],
)
def test_chaparral_spreads_as_andrews_1986_published(
    moisture: Moisture, rate_chains_h: float, flame_ft: float
) -> None:
    """The values are from INT-194: FM 4, midflame wind 4 mph, slope 30 %, rounded as printed."""
    found = spread(4, moisture, 4.0, 0.30)
    assert round(found["ros_ch_h"]) == rate_chains_h
    assert round(found["fl_ft"], 1) == flame_ft


def test_brush_uses_woody_and_grass_herbaceous_moisture() -> None:
    """The live fuel of FM 4, 5, 7 and 10 is woody, that of FM 2 herbaceous."""
    for code in (4, 5, 7, 10, 2):
        rates = {
            which: spread(code, Moisture(0.06, 0.07, 0.08, *live), 5.0, 0.0)["ros_ch_h"]
            for which, live in (
                ("dry", (0.6, 0.6)),
                ("wet herb", (1.5, 0.6)),
                ("wet wood", (0.6, 1.5)),
            )
        }
        matters, not_at_all = ("wet herb", "wet wood") if code == 2 else ("wet wood", "wet herb")
        assert rates[matters] < rates["dry"] == rates[not_at_all]


def test_the_fuel_models_are_the_53_published_ones() -> None:
    scott_burgan = [*range(101, 110), *range(121, 125), *range(141, 150), *range(161, 166)]
    scott_burgan += [*range(181, 190), *range(201, 205)]
    assert list(FUEL_MODELS) == [*range(1, 14), *scott_burgan]
    dynamic = [code for code, fuel in FUEL_MODELS.items() if fuel.dynamic]
    assert dynamic == [*range(101, 110), *range(121, 125), 141, 149, 161, 163]
    assert [code for code, fuel in FUEL_MODELS.items() if fuel.heat_btu_lb != 8000.0] == [106]
    assert FUEL_MODELS[106].heat_btu_lb == 9000.0


def test_codes_91_to_99_are_known_not_to_burn_and_no_others() -> None:
    assert list(NON_BURNABLE) == list(range(91, 100))
    assert NON_BURNABLE[98] == "water"
    assert NON_BURNABLE[95] == "non-burnable"
    check_codes(np.array([[*FUEL_MODELS, *NON_BURNABLE]]), "codes")
    with pytest.raises(
        ValueError, match=r"codes: unknown fuel code 110 at row 1, column 0 \(1 such"
    ):
        check_codes(np.array([[1], [110]]), "codes")


@pytest.mark.parametrize(
    ("code", "sav_1_ft", "packing_ratio"),
    [
        *[(101, 2054, 0.00143), (104, 1826, 0.00154), (108, 1302, 0.00316)],
        *[(122, 1827, 0.00249), (123, 1614, 0.00259), (141, 1674, 0.00280)],
        *[(145, 1252, 0.00206), (149, 1378, 0.00505), (161, 1606, 0.00885)],
        *[(165, 1224, 0.02009), (184, 1568, 0.02224), (187, 1229, 0.03515)],
        *[(201, 1653, 0.02224), (204, 1907, 0.00744)],
    ],
)
def test_scott_burgan_beds_have_the_published_size_and_packing(
    code: int, sav_1_ft: float, packing_ratio: float
) -> None:
    """The values are printed with each model in RMRS-GTR-153, for uncured herbaceous fuel."""
    fuel = FUEL_MODELS[code]
    assert fuel_bed(fuel, replace(DRY, live_herb=2.0)).sav_1_ft == pytest.approx(sav_1_ft, abs=0.6)
    packing = sum(fuel.loads_lb_ft2) / fuel.depth_ft / rothermel.PARTICLE_DENSITY_LB_FT3
    assert packing == pytest.approx(packing_ratio, abs=1e-5)


def test_herbaceous_fuel_cures_between_120_and_30_percent() -> None:
    assert rothermel.cured_fraction(0.10) == rothermel.cured_fraction(0.2999) == 1.0
    assert rothermel.cured_fraction(0.30) == pytest.approx(1.0)
    assert rothermel.cured_fraction(0.75) == pytest.approx(0.5, abs=1e-3)
    assert rothermel.cured_fraction(1.20) == pytest.approx(0.001)  # the rounded line of `behave`
    assert rothermel.cured_fraction(1.2001) == rothermel.cured_fraction(3.0) == 0.0


def test_cured_fuel_is_as_fine_as_the_live_and_as_wet_as_the_dead() -> None:
    fuel, moisture = FUEL_MODELS[121], Moisture(0.05, 0.06, 0.07, 0.75, 0.90)
    loads, savs, moistures = rothermel.size_classes(fuel, moisture)
    assert loads.sum() == pytest.approx(sum(fuel.loads_lb_ft2))
    assert loads[3] == pytest.approx(fuel.load_herb * (1.333 - 1.11 * 0.75))
    assert loads[4] == pytest.approx(fuel.load_herb - loads[3])
    assert savs[3] == savs[4] == 1800.0
    assert moistures.tolist() == [0.05, 0.06, 0.07, 0.05, 0.75, 0.90]


def test_grass_of_a_static_model_never_cures() -> None:
    loads, _, _ = rothermel.size_classes(FUEL_MODELS[2], replace(DRY, live_herb=0.3))
    assert loads[3] == 0.0
    assert loads[4] == FUEL_MODELS[2].load_herb


def test_green_grass_hardly_spreads_and_cured_grass_races() -> None:
    rates = [
        spread(104, replace(DRY, live_herb=wet), 5.0, 0.0)["ros_ch_h"]
        for wet in (0.3, 0.6, 0.9, 1.2)
    ]
    assert rates == sorted(rates, reverse=True)
    assert rates[0] > 20.0 * rates[-1]


def test_the_wind_limit_stops_the_effective_wind_and_the_rate_with_it() -> None:
    bed = fuel_bed(FUEL_MODELS[8], DRY)
    limit_m_s = 0.9 * bed.reaction_intensity_btu_ft2_min / rothermel.FT_MIN_PER_M_S
    flat, up = np.zeros(1), np.zeros(1)
    free = [fastest_spread(bed, wind, 0.0, flat, up) for wind in (limit_m_s, 2.0 * limit_m_s)]
    held = [fastest_spread(bed, wind, 0.0, flat, up, True) for wind in (limit_m_s, 40.0)]
    assert free[1][0] > 2.0 * free[0][0]
    for rate, towards, effective in held:
        assert rate == pytest.approx(free[0][0])
        assert effective == pytest.approx(limit_m_s)
        assert towards == 0.0
    below = fastest_spread(bed, 0.9 * limit_m_s, 0.0, flat, up, True)
    assert below[2] == pytest.approx(0.9 * limit_m_s)


def test_the_slope_factor_is_never_above_the_wind_limit_when_hardly_anything_burns() -> None:
    """`behave` has the same limit; GR1 has a moisture of 14.9 %, near its extinction moisture."""
    wet = Moisture(0.149, 0.149, 0.149, 0.3, 0.9)
    bed = fuel_bed(FUEL_MODELS[101], wet)
    limit = rothermel.wind_limit_ft_min(bed.reaction_intensity_btu_ft2_min)
    assert 0.0 < limit < bed.slope_k
    assert rothermel.slope_factor(bed, 1.0) == limit
    assert rothermel.slope_factor(bed, 0.01) == pytest.approx(bed.slope_k * 1e-4)


codes = st.sampled_from(sorted(FUEL_MODELS))
moistures = st.builds(
    Moisture,
    *[st.floats(0.01, 0.5)] * 3,
    *[st.floats(0.2, 3.0)] * 2,
)


@given(codes, moistures)
def test_more_wind_and_steeper_slopes_never_slow_any_fuel(code: int, moisture: Moisture) -> None:
    bed = fuel_bed(FUEL_MODELS[code], moisture)
    winds, slopes = np.linspace(0.0, 15.0, 16), np.linspace(0.0, 1.2, 16)
    up = np.zeros(16)
    for wind_limit in (False, True):
        by_wind, _, effective = fastest_spread(bed, winds, 0.0, np.zeros(16), up, wind_limit)
        by_slope, _, _ = fastest_spread(bed, 0.0, 0.0, slopes, up, wind_limit)
        for values in (by_wind, by_slope, effective):
            assert np.isfinite(values).all()
            assert (np.diff(values) >= 0.0).all()


@given(codes, moistures)
def test_wetter_dead_fuel_never_burns_hotter(code: int, moisture: Moisture) -> None:
    fuel = FUEL_MODELS[code]
    wetter = replace(
        moisture,
        dead_1h=moisture.dead_1h + 0.02,
        dead_10h=moisture.dead_10h + 0.02,
        dead_100h=moisture.dead_100h + 0.02,
    )
    before, after = fuel_bed(fuel, moisture), fuel_bed(fuel, wetter)
    assert after.reaction_intensity_btu_ft2_min <= before.reaction_intensity_btu_ft2_min
    assert after.no_wind_rate_ft_min <= before.no_wind_rate_ft_min


@given(codes, moistures, st.floats(0, 15), st.floats(0, 1.2), st.floats(0, 360), st.floats(0, 360))
def test_turning_wind_and_slope_together_turns_the_spread(
    code: int, moisture: Moisture, wind: float, slope: float, wind_deg: float, turn_deg: float
) -> None:
    bed = fuel_bed(FUEL_MODELS[code], moisture)
    tan = np.array([slope])
    first = fastest_spread(bed, wind, wind_deg, tan, np.array([0.0]))
    turned = fastest_spread(bed, wind, wind_deg + turn_deg, tan, np.array([turn_deg]))
    assert turned[0] == pytest.approx(first[0], rel=1e-9)
    if wind > 0.1 and abs(wind_deg - 180.0) > 1.0:
        off = (turned[1] - first[1] - turn_deg + 180.0) % 360.0 - 180.0
        assert off == pytest.approx(0.0, abs=1e-6)


def test_too_wet_fuel_does_not_spread() -> None:
    assert spread(1, Moisture(0.3, 0.3, 0.3, 1.0, 1.0), 10.0, 0.3)["ros_ch_h"] == 0.0


def test_wind_and_slope_add_as_vectors() -> None:
    bed = fuel_bed(FUEL_MODELS[1], DRY)
    wind_m_s, slope = 2.0, np.array([0.5])
    by_wind = float(rothermel.wind_factor(bed, wind_m_s * rothermel.FT_MIN_PER_M_S))
    by_slope = float(rothermel.slope_factor(bed, 0.5))
    still = bed.no_wind_rate_ft_min / rothermel.FT_MIN_PER_M_S
    together, towards, _ = fastest_spread(bed, wind_m_s, 90.0, slope, np.array([90.0]))
    assert together[0] == pytest.approx(still * (1 + by_wind + by_slope))
    assert towards[0] == pytest.approx(90.0)
    against, _, _ = fastest_spread(bed, wind_m_s, 90.0, slope, np.array([270.0]))
    assert against[0] == pytest.approx(still * (1 + abs(by_wind - by_slope)))
    across, towards, _ = fastest_spread(bed, wind_m_s, 90.0, slope, np.array([0.0]))
    assert across[0] == pytest.approx(still * (1 + math.hypot(by_wind, by_slope)))
    assert towards[0] == pytest.approx(math.degrees(math.atan2(by_wind, by_slope)))


def test_every_row_of_behave_is_matched() -> None:
    """The rows were computed with the Forest Service's C++ program; column names contain units."""
    with shared_file("behave_reference.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 82
    for row in rows:
        moisture = Moisture(*(float(row[key]) / 100 for key in ("m1", "m10", "m100", "mlh", "mlw")))
        found = spread(
            int(row["fm"]), moisture, float(row["mid_mph"]), float(row["slope_pct"]) / 100
        )
        expected = {key: float(row[key]) for key in found if key != "towards_deg"}
        assert len(expected) == 8
        assert found == pytest.approx(expected | {"towards_deg": 0.0}, rel=1e-6), row


# Columns: fuel; moistures in percent, midflame wind in mph, its direction from upslope in degrees,
# and slope in percent; results in ch/h, kW/m, ft, Btu/ft², Btu/ft²/min, length to width, back and
# flank in ch/h, and degrees.
BEHAVE_RUNS = """
  2  8  9 10  75  90  7   0 20 65.7607 1943.82 8.27524 465.429 3374.38 2.00692 4.68390 17.5504 0
  7  5  6  7  90 110  3   0  0 15.1745 524.530 4.52994 544.276 2199.95 1.29801 3.35868 7.13907 0
  9  4  5  6 100 120 10 135 45 30.3542 802.131 5.50746 416.092 2691.36 2.65068 1.16451 5.94541 130.481
 10  9 10 12 100  85  6  90 60 11.8957 909.106 5.83393 1203.34 5528.89 1.86958 .999869 3.44878 63.1159
106 10 11 12  80  90  6  45 25 51.3323 3014.21 10.1256 924.585 4830.64 1.81306 4.64193 15.4364 42.0024
108 12 13 14  30  90 15   0  0 391.947 53736.8 38.0999 2158.78 7319.32 4.99600 4.00641 39.6270 0
124  7  8  9 120 100  9  60 50 9.04544 376.821 3.89064 655.947 2786.28 2.68758 .336823 1.74548 51.3490
149 11 12 13 110 140 20 180 40 59.0217 5616.67 13.4821 1498.41 5377.10 8.00000 .232372 3.70338 180
165  5  6  7 100 100  0   0 70 8.56555 1427.14 7.17881 2623.45 8359.06 1.54066 1.16401 3.15759 0
188  9 10 11 100 100 11 100 15 13.9357 555.113 4.64958 627.216 2891.43 3.11714 .378284 2.29600 99.1980
204  7  8  9 100 100  8   0  0 96.1011 8427.70 16.2489 1380.84 6855.82 2.21108 5.49199 22.9736 0
"""  # noqa: E501


@pytest.mark.parametrize("run", BEHAVE_RUNS.strip().splitlines())
def test_eleven_runs_of_behave_are_matched(run: str) -> None:
    """The results of `behave` (firelab/behave, commit d963287) were printed to 6 digits.

    The wind limit is off and the midflame wind is given. Some winds blow across or down the slope.
    """
    code, *numbers = run.split()
    inputs, expected = [float(x) for x in numbers[:8]], [float(x) for x in numbers[8:]]
    moisture = Moisture(*(percent / 100 for percent in inputs[:5]))
    midflame_mph, off_deg, slope_pct = inputs[5:]
    found = spread(int(code), moisture, midflame_mph, slope_pct / 100, off_deg)
    assert list(found.values()) == pytest.approx(expected, rel=1e-5, abs=1e-9)
