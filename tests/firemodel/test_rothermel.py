"""Each equation against a value worked out by hand or published, and the whole against `behave`."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from firemodel import rothermel
from firemodel.fuels import FUEL_MODELS
from firemodel.rothermel import Moisture, fastest_spread, fuel_bed

REFERENCE = Path(__file__).parents[3] / "shared" / "data" / "behave_reference.csv"
M_S_PER_MPH = 0.44704
M_S_PER_CHAIN_H = 20.1168 / 3600.0
DRY = Moisture(0.06, 0.07, 0.08, 0.60, 0.90)


def spread(
    code: int, moisture: Moisture, midflame_mph: float, slope_tan: float
) -> dict[str, float]:
    """What `behave` reports, wind blowing upslope, in its units."""
    bed = fuel_bed(FUEL_MODELS[code], moisture)
    rates, _, winds = fastest_spread(
        bed, midflame_mph * M_S_PER_MPH, 0.0, np.array([slope_tan]), np.array([0.0])
    )
    rate, effective = float(rates[0]), float(winds[0])
    ratio = float(rothermel.length_to_breadth(effective))
    intensity = rothermel.fireline_intensity_kw_m(bed, rate)
    backing = rothermel.rate_towards(rate, rothermel.eccentricity(ratio), math.pi)
    return {
        "ros_ch_h": rate / M_S_PER_CHAIN_H,
        "fli_kW_m": float(intensity),
        "fl_ft": float(rothermel.flame_length_m(intensity)) / 0.3048,
        "HPA_btu_ft2": rothermel.heat_per_area_btu_ft2(bed),
        "RI_btu_ft2_min": bed.reaction_intensity_btu_ft2_min,
        "LW": ratio,
        "back_ch_h": float(backing) / M_S_PER_CHAIN_H,
        "flank_ch_h": float(rothermel.flanking_rate(rate, ratio)) / M_S_PER_CHAIN_H,
    }


def test_mineral_damping_is_the_published_constant() -> None:
    assert rothermel.mineral_damping() == pytest.approx(0.4174, abs=5e-5)


def test_moisture_damping_falls_from_one_to_nothing_at_extinction() -> None:
    assert rothermel.moisture_damping(0.0, 0.25) == 1.0
    assert rothermel.moisture_damping(0.125, 0.25) == pytest.approx(0.5425)  # 1-1.295+1.2775-0.44
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


def test_length_to_breadth_is_one_without_wind_and_unbounded_above() -> None:
    assert rothermel.length_to_breadth(0.0) == 1.0
    anderson = 0.936 * math.exp(0.2566 * 5) + 0.461 * math.exp(-0.1548 * 5) - 0.397
    assert rothermel.length_to_breadth(5.0) == pytest.approx(anderson, rel=1e-3)
    assert rothermel.length_to_breadth(12.0) > 8.0


def test_the_ellipse_has_its_length_and_width() -> None:
    """Head plus back over both flanks is length over breadth."""
    e = rothermel.eccentricity(2.5)
    head_and_back = 1.0 + rothermel.rate_towards(1.0, e, math.pi)
    assert rothermel.rate_towards(1.0, e, 0.0) == 1.0
    assert head_and_back / (2.0 * rothermel.flanking_rate(1.0, 2.5)) == pytest.approx(2.5)


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
    """Characteristic SAV as tabulated for Anderson's models; load / depth / 32 lb/ft³ by hand."""
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
    """INT-194: FM 4, midflame wind 4 mph, slope 30 %; rounded as printed."""
    found = spread(4, moisture, 4.0, 0.30)
    assert round(found["ros_ch_h"]) == rate_chains_h
    assert round(found["fl_ft"], 1) == flame_ft


def test_brush_uses_woody_and_grass_herbaceous_moisture() -> None:
    """Live fuel of FM 4, 5, 7, 10 is woody, that of FM 2 herbaceous."""
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


def test_every_anderson_row_of_behave_is_matched() -> None:
    """Computed with the Forest Service's own C++; see the header of the file for the units."""
    if not REFERENCE.exists():
        pytest.skip(f"no {REFERENCE}")
    with REFERENCE.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if int(row["fm"]) in FUEL_MODELS]
    assert {int(row["fm"]) for row in rows} == set(FUEL_MODELS)
    for row in rows:
        moisture = Moisture(*(float(row[key]) / 100 for key in ("m1", "m10", "m100", "mlh", "mlw")))
        found = spread(
            int(row["fm"]), moisture, float(row["mid_mph"]), float(row["slope_pct"]) / 100
        )
        expected = {key: float(row[key]) for key in found}
        assert found == pytest.approx(expected, rel=1e-5), row
