"""Warm air above a fire, compared with the published equations in their own units."""

import math

import numpy as np
import pytest

from firemodel.physics.plume import updraught_m_s, warm_height_m, warming_k


def scorch_height_ft(intensity_btu_ft_s: float, wind_mph: float, air_f: float) -> float:
    """Return Van Wagner's scorch height in the units of Albini 1976 (INT-30) and `behave`."""
    numerator = 63.0 * math.pow(intensity_btu_ft_s, 7 / 6)
    return numerator / (math.sqrt(intensity_btu_ft_s + math.pow(wind_mph, 3)) * (140.0 - air_f))


@pytest.mark.parametrize("intensity_kw_m", [70.0, 500.0, 20_000.0])
@pytest.mark.parametrize("wind_m_s", [0.0, 2.0, 8.0])
def test_needles_die_at_60_degrees_at_the_scorch_height(
    intensity_kw_m: float, wind_m_s: float
) -> None:
    height_m = float(warm_height_m(intensity_kw_m, wind_m_s, 60.0 - 25.0))
    expected_ft = scorch_height_ft(intensity_kw_m / 3.4592, wind_m_s / 0.44704, 77.0)
    assert height_m == pytest.approx(0.3048 * expected_ft, rel=0.015)  # rounded constants
    assert warming_k(intensity_kw_m, wind_m_s, height_m) == pytest.approx(35.0)


def test_van_wagners_equation_in_its_own_units() -> None:
    """3.94 I^(7/6) / ((0.107 I + U³)^½ (60 - T)), with I in kcal/s/m and U in m/s."""
    kcal, wind_m_s = 200.0, 3.0
    height_m = 3.94 * kcal ** (7 / 6) / (math.sqrt(0.107 * kcal + wind_m_s**3) * 40.0)
    assert warm_height_m(4.1868 * kcal, wind_m_s, 40.0) == pytest.approx(height_m, rel=1e-3)


def test_the_warming_falls_with_height_and_wind_and_there_is_none_without_fire() -> None:
    heights_m = np.array([10.0, 20.0, 80.0])
    found_k = warming_k(4000.0, 0.0, heights_m)
    assert found_k * heights_m == pytest.approx(found_k[0] * 10.0)
    assert found_k[0] == pytest.approx(0.1 * 0.74183 / math.sqrt(0.025574) * 4000.0 ** (2 / 3))
    assert (warming_k(4000.0, 6.0, heights_m) < found_k).all()
    assert warming_k(0.0, 0.0, 10.0) == warming_k(0.0, 3.0, 10.0) == 0.0
    assert np.isnan(warm_height_m(np.array([np.nan]), 0.0, 20.0)).all()


def test_the_updraught_grows_with_the_cube_root_of_the_intensity() -> None:
    assert updraught_m_s(8000.0) == pytest.approx(2.0 * updraught_m_s(1000.0))
    buoyancy_m3_s3 = 9.81 * 1000.0 / (1.2 * 1.005 * 293.0)
    assert updraught_m_s(1000.0) == pytest.approx(1.80 * buoyancy_m3_s3 ** (1 / 3))
    assert updraught_m_s(0.0) == 0.0
