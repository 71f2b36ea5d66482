"""Dead fuel moisture: drying by day, humid nights and rain."""

import math

import numpy as np
import pytest

from firemodel.physics.moisture import (
    after_time_lag,
    dead_moistures_pct,
    equilibrium_moisture_pct,
    rain_hours,
    rain_moisture_pct,
)

HOUR_S = 3600.0
INITIAL = (6.0, 7.0, 8.0)


def conditioned(
    hours: float, step_h: float = 1.0, humidity_pct: float = 25.0, rain_mm: float = 0.0
) -> list[float]:
    """Return the three moistures after some hours of constant weather at 70 °F."""
    at_s = np.arange(0.0, hours * HOUR_S + 1.0, step_h * HOUR_S)
    same = np.ones(at_s.size)
    temperature_c = same * (70.0 - 32.0) / 1.8
    found = dead_moistures_pct(at_s, temperature_c, humidity_pct * same, rain_mm * same, INITIAL)
    assert found.shape == (at_s.size, 3)
    assert tuple(found[0]) == INITIAL
    return [float(x) for x in found[-1]]


@pytest.mark.parametrize(
    ("temperature_f", "humidity_pct", "moisture_pct"),
    [
        (70, 5, 0.03229 + 1.405365 - 0.2023),
        (80, 10, 2.22749 + 1.60107 - 1.18272),
        (80, 20, 2.22749 + 3.20214 - 1.18272),
        (60, 50, 21.0606 + 13.9125 - 1.05 - 24.15995),
        (60, 80, 21.0606 + 35.616 - 1.68 - 38.65592),
    ],
)
def test_equilibrium_has_three_pieces_by_humidity(
    temperature_f: float, humidity_pct: float, moisture_pct: float
) -> None:
    """Compare with Simard's three formulas, computed by hand."""
    found = equilibrium_moisture_pct((temperature_f - 32.0) / 1.8, humidity_pct)
    assert found == pytest.approx(moisture_pct, rel=1e-9)


def test_equilibrium_is_near_that_measured_on_wood() -> None:
    """The values are from the Wood Handbook at 70 °F (Simpson 1998), which uses another formula."""
    found = equilibrium_moisture_pct(21.11, np.array([25.0, 60.0, 84.0]))
    assert found == pytest.approx(np.array([5.3, 11.1, 17.6]), abs=0.5)


def test_after_one_time_lag_a_part_of_one_over_e_is_left() -> None:
    found = after_time_lag(np.array([20.0]), np.array([5.0]), 10.0, np.array([10.0]))
    assert found == pytest.approx(5.0 + 15.0 / math.e)


def test_fine_fuel_follows_at_once_and_coarse_fuel_slowly() -> None:
    equilibrium = float(equilibrium_moisture_pct((70.0 - 32.0) / 1.8, 25.0))
    fine, middling, coarse = conditioned(10.0)
    assert fine == pytest.approx(equilibrium, abs=1e-3)
    assert middling == pytest.approx(equilibrium + (7.0 - equilibrium) / math.e)
    assert coarse == pytest.approx(equilibrium + (8.0 - equilibrium) * math.exp(-0.1))


def test_records_more_often_of_the_same_weather_change_nothing() -> None:
    assert conditioned(12.0, 0.25) == pytest.approx(conditioned(12.0, 3.0))


def test_a_record_holds_until_the_next() -> None:
    """Humidity or rain in the second hour changes the moisture only at the third record."""
    at_s, dry, humidity_pct = (
        np.array([0.0, 3600.0, 7200.0]),
        np.zeros(3),
        np.array([25.0, 90.0, 25.0]),
    )
    temperature_c, rain_mm = dry + 21.0, np.array([0.0, 1.0, 0.0])
    damp = dead_moistures_pct(at_s, temperature_c, humidity_pct, dry, INITIAL)
    rainy = dead_moistures_pct(at_s, temperature_c, dry + 25.0, rain_mm, INITIAL)
    for found in (damp, rainy):
        assert found[1, 0] < found[0, 0] < found[2, 0]


def test_rain_soaks_the_fine_fuel_beyond_burning_and_the_coarse_a_little() -> None:
    fine, middling, coarse = conditioned(3.0, rain_mm=0.2)
    assert fine == pytest.approx(35.0 - (35.0 - 6.0) * math.exp(-3.0))
    assert middling == pytest.approx(35.0 - (35.0 - 7.0) * math.exp(-0.3))
    assert 8.0 + 3 * 0.33 < coarse < 8.0 + 3 * 0.36  # a hundredth of 33.5 to 34.5 in an hour
    assert conditioned(3.0, rain_mm=5.0) == pytest.approx([fine, middling, coarse])


def test_long_rain_wets_the_coarse_fuel_more() -> None:
    assert rain_moisture_pct(0.0).tolist() == [35.0, 35.0, 41.0]
    assert rain_moisture_pct(6.0).tolist() == [35.0, 35.0, 44.0]


def test_hours_of_rain_are_those_of_the_last_day() -> None:
    at_s = np.array([0.0, 2.0, 5.0, 25.0, 26.0, 31.0]) * HOUR_S
    rain_mm = np.array([0.1, 0.0, 4.0, 0.0, 1.0, 9.0])
    # Rain in hours 0-2, 5-25 and 26-31; the last 24 h at 26 h do not include the first period.
    assert rain_hours(at_s, rain_mm).tolist() == pytest.approx([2.0, 2.0, 21.0, 20.0, 23.0])
