"""Weather streams and the wind at midflame height."""

import math
from dataclasses import replace

import numpy as np
import pytest

from firemodel.errors import FireModelError
from firemodel.physics.weather import (
    Weather,
    WeatherStream,
    crown_ratio_from_base,
    wind_20ft_from_10m,
    wind_adjustment_factor,
)
from tests.firemodel.grids import weather


def test_each_entry_holds_until_the_next() -> None:
    calm, gale = weather(1.0), weather(9.0, at_s=3600.0)
    stream = WeatherStream([calm, gale])
    assert stream.weather_at(0.0) is calm
    assert stream.weather_at(3599.9) is calm
    assert stream.weather_at(3600.0) is gale
    assert stream.weather_at(1e9) is gale
    assert stream.change_times() == (3600.0,)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ([], "no entries"),
        ([weather(-1.0)], "entry 0: wind_speed_m_s = -1.0 must not be negative"),
        ([weather(math.nan)], "entry 0: wind_speed_m_s = nan is not a number"),
        ([weather(1.0, 400.0)], "entry 0: wind_from_deg = 400.0 must be 0 to 360"),
        ([replace(weather(), live_woody_pct=-5.0)], "entry 0: live_woody_pct = -5.0"),
        ([weather(at_s=60.0)], "entry 0: at_s = 60.0, so the weather before it is missing"),
        ([weather(), weather(at_s=9.0), weather(at_s=9.0)], "entry 2: at_s = 9.0 is not later"),
    ],
)
def test_impossible_weather_is_refused(entries: list[Weather], message: str) -> None:
    with pytest.raises(FireModelError, match=message):
        WeatherStream(entries)


def test_wind_adjustment_factors_are_the_published_unsheltered_ones() -> None:
    """The usual table has one decimal (Andrews 2012): chaparral 0.6, tall grass 0.4, litter 0.3."""
    for depth_ft, factor in ((6.0, 0.55), (2.5, 0.44), (1.0, 0.36), (0.2, 0.27)):
        assert wind_adjustment_factor(depth_ft) == pytest.approx(factor, abs=0.006)


@pytest.mark.parametrize(
    ("depth_ft", "cover", "height_ft", "ratio", "factor"),
    [
        (1.0, 0.5, 60.0, 0.5, 0.1482718278),
        (1.0, 0.6, 60.0, 0.4, 0.1513293006),
        (6.0, 0.7, 20.0, 0.9, 0.1153518902),
        (0.3, 1.0, 120.0, 1.0, 0.06272416791),
        (1.0, 0.3, 60.0, 0.4, 0.3621042636),  # crowns fill only 4 %
        (1.0, 0.375, 40.0, 0.4, 0.2077086333),  # exactly 5 %
        (1.0, 0.9, 5.9, 1.0, 0.3621042636),  # the canopy is too low
    ],
)
def test_trees_shelter_the_fuel_as_in_behave(
    depth_ft: float, cover: float, height_ft: float, ratio: float, factor: float
) -> None:
    """The values are from the Forest Service's `behave` (firelab/behave, commit d963287)."""
    found = wind_adjustment_factor(depth_ft, cover, height_ft * 0.3048, ratio)
    assert found == pytest.approx(factor, rel=1e-9)


def test_wind_adjustment_of_a_grid_is_that_of_its_cells() -> None:
    depth_ft = np.array([[1.0, 6.0], [0.2, 0.0]])
    cover = np.array([[0.625, 0.0], [0.125, 0.0]], dtype=np.float32)
    height_m = np.array([[18.0, 0.0], [18.0, 0.0]], dtype=np.float32)
    ratio = crown_ratio_from_base(height_m, np.array([[9.0, 0.0], [4.5, 0.0]]))
    assert ratio.tolist() == [[0.5, 0.0], [0.75, 0.0]]
    found = wind_adjustment_factor(depth_ft, cover, height_m, ratio)
    assert np.shape(found) == (2, 2)
    one_by_one = [
        wind_adjustment_factor(*(float(x) for x in cell))
        for cell in zip(depth_ft.flat, cover.flat, height_m.flat, ratio.flat, strict=True)
    ]
    assert np.ravel(found).tolist() == pytest.approx(one_by_one, rel=1e-6)
    assert one_by_one[0] < 0.2 < one_by_one[2]
    assert one_by_one[3] == 0.0  # no fuel


def test_canopies_in_percent_are_refused() -> None:
    with pytest.raises(FireModelError, match=r"^canopy_cover = 60.0: must be a fraction"):
        wind_adjustment_factor(1.0, np.array([0.5, 60.0]), 18.0, 0.5)
    with pytest.raises(FireModelError, match=r"^crown_ratio = nan: must be a fraction"):
        wind_adjustment_factor(1.0, 0.5, 18.0, math.nan)


def test_wind_at_20_feet_is_less_than_at_10_metres() -> None:
    assert wind_20ft_from_10m(11.5) == pytest.approx(10.0)


def test_entries_like_the_one_before_are_no_changes() -> None:
    entries = [weather(3.0, 10.0, 600.0 * number) for number in range(4)]
    entries[2] = weather(3.5, 10.0, 1200.0)
    found = WeatherStream(entries).changes()
    assert [entry.at_s for entry in found] == [0.0, 1200.0, 1800.0]
