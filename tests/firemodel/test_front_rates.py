"""Speeds of straight fronts, compared with the any-angle scheme's fire from a line."""

import numpy as np
import pytest

from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.front_rates import FrontRates

SIZE = 101
WEATHER = WeatherStream(
    [
        Weather(0.0, 5.0, 270.0, 5.0, 6.0, 7.0, 60.0, 90.0),
        Weather(7200.0, 2.0, 180.0, 5.0, 6.0, 7.0, 60.0, 90.0),
    ]
)


def hillside(rise_north: float, rise_east: float) -> Landscape:
    """Return a plane with one fuel; row 0 is in the north."""
    row, col = np.mgrid[:SIZE, :SIZE]
    height_m = 1000.0 - 30.0 * rise_north * row + 30.0 * rise_east * col
    fuel = np.full((SIZE, SIZE), 2, np.int16)
    return Landscape("EPSG:32611", 5e5, 4e6, 30.0, fuel, height_m.astype(np.float32))


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.3, 0.0), (0.2, -0.4)])
@pytest.mark.parametrize("side", ["north", "south", "east", "west"])
def test_a_burning_line_moves_at_the_computed_rate_of_the_front(
    slope: tuple[float, float], side: str
) -> None:
    land = hillside(*slope)
    line = {"north": (-1, None), "south": (0, None), "east": (None, 0), "west": (None, -1)}[side]
    along = np.arange(SIZE)
    cells = [
        (
            int(line[0] % SIZE if line[0] is not None else place),
            int(line[1] % SIZE if line[1] is not None else place),
            0.0,
        )
        for place in along
    ]
    fire = AnyAngleFire(land, WEATHER, cells)
    fire.advance(7000.0)
    facing = {"north": (1.0, 0.0), "south": (-1.0, 0.0), "east": (0.0, 1.0), "west": (0.0, -1.0)}
    north, east = (np.array([part]) for part in facing[side])
    centre = np.array([SIZE // 2])
    rate_m_s = FrontRates(land, WEATHER).speeds_m_s(centre, centre, north, east, 0.0)[0]
    profile = (
        fire.arrival_time_s[:, SIZE // 2] if line[1] is None else fire.arrival_time_s[SIZE // 2]
    )
    profile = profile if side in ("south", "east") else profile[::-1]
    reached = np.flatnonzero(profile <= 7000.0)[1:40]
    measured_m_s = 30.0 * reached[-1] / profile[reached[-1]]
    assert rate_m_s == pytest.approx(measured_m_s, rel=0.02)


def test_the_weather_is_the_one_of_the_time_or_the_wind_that_is_given() -> None:
    rates = FrontRates(hillside(0.0, 0.0), WEATHER)
    cells, north, east = np.array([5, 6]), np.array([0.0, 1.0]), np.array([1.0, 0.0])
    before, after = (rates.speeds_m_s(cells, cells, north, east, at_s) for at_s in (0.0, 7200.0))
    assert before[0] > 2.0 * before[1]  # wind from the west
    assert after[1] > after[0]  # from the south
    given = rates.under_wind(cells, cells, north, east, 0.0, (2.0, 180.0))
    np.testing.assert_allclose(given, after, rtol=1e-12)
