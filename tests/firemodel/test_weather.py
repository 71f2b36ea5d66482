"""Weather streams and the wind at midflame height."""

import math
from dataclasses import replace

import pytest

from firemodel.errors import FireModelError
from firemodel.weather import Weather, WeatherStream, wind_adjustment_factor
from tests.firemodel.grids import weather


def test_each_entry_holds_until_the_next() -> None:
    calm, gale = weather(1.0), weather(9.0, at_s=3600.0)
    stream = WeatherStream([calm, gale])
    assert stream.at(0.0) is calm
    assert stream.at(3599.9) is calm
    assert stream.at(3600.0) is gale
    assert stream.at(1e9) is gale
    assert stream.change_times() == (3600.0,)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ([], "no entries"),
        ([weather(-1.0)], "entry 0: wind_speed_m_s = -1.0 must not be negative"),
        ([weather(math.nan)], "entry 0: wind_speed_m_s = nan is not a number"),
        ([weather(1.0, 400.0)], "entry 0: wind_from_deg = 400.0 must be 0 to 360"),
        ([replace(weather(), live_woody_pct=-5.0)], "entry 0: live_woody_pct = -5.0"),
        ([weather(at_s=60.0)], "entry 0: at_s = 60.0, so the weather before it is unknown"),
        ([weather(), weather(at_s=9.0), weather(at_s=9.0)], "entry 2: at_s = 9.0 is not later"),
    ],
)
def test_impossible_weather_is_refused(entries: list[Weather], message: str) -> None:
    with pytest.raises(FireModelError, match=message):
        WeatherStream(entries)


def test_wind_adjustment_factors_are_the_published_unsheltered_ones() -> None:
    """The usual table, to one decimal (Andrews 2012): chaparral 0.6, tall grass 0.4, litter 0.3."""
    for depth_ft, factor in ((6.0, 0.55), (2.5, 0.44), (1.0, 0.36), (0.2, 0.27)):
        assert wind_adjustment_factor(depth_ft) == pytest.approx(factor, abs=0.006)
