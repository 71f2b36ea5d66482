"""Requirements of cellular fires from physics; results do not depend on the steps of advance."""

import itertools
import math

import numpy as np
import pytest

from firemodel.errors import FireModelError
from firemodel.landscape.default import jacksboro
from firemodel.physics.fuels import FUEL_MODELS
from firemodel.physics.rothermel import fastest_spread, fireline_intensity_kw_m, fuel_bed
from firemodel.physics.weather import WeatherStream, wind_adjustment_factor
from firemodel.spread.devs8 import Devs8Fire
from firemodel.spread.fire_scheme import BURNED, BURNING, CANNOT_BURN, UNBURNED, Burning
from firemodel.spread.front import neighbours_of
from tests.firemodel.grids import CELL_M, landscape, steady, weather
from tests.firemodel.spread_fields import spread_fields

MIDDLE = (20, 20, 0.0)


def arrivals(fire: Devs8Fire, to_time_s: float) -> np.ndarray:
    fire.advance(to_time_s)
    return fire.arrival_time_s


def test_without_wind_and_slope_the_fire_is_a_regular_octagon() -> None:
    land = landscape()
    found = arrivals(Devs8Fire(land, steady(), [MIDDLE]), 15_000.0)
    still = spread_fields(land, weather())[0][0, 0]
    rows, cols = np.indices(land.shape)
    across, along = np.sort([abs(rows - 20), abs(cols - 20)], axis=0)
    distance_m = CELL_M * (along - across + np.sqrt(2.0) * across)
    expected = np.where(distance_m / still <= 15_000.0, distance_m / still, np.inf)
    assert 300 < np.isfinite(found).sum() < land.fuel_model.size
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert np.array_equal(found, found.T)
    assert np.array_equal(found, found[::-1, ::-1])


@pytest.mark.parametrize(
    ("wind_from_deg", "ahead", "behind"),
    [
        # Wind from the west: fire moves eastwards, towards higher columns.
        (270.0, (20, 24), (20, 16)),
        # Wind from the north: fire moves southwards, towards higher rows.
        (0.0, (24, 20), (16, 20)),
        (45.0, (24, 16), (16, 24)),  # wind from the north-east: fire moves south-westwards
    ],
)
def test_wind_drives_the_fire_downwind(
    wind_from_deg: float, ahead: tuple[int, int], behind: tuple[int, int]
) -> None:
    fire = Devs8Fire(landscape(2), steady(4.0, wind_from_deg), [MIDDLE])
    found = arrivals(fire, 7200.0)
    assert found[ahead] < 0.4 * found[behind]


def test_head_back_and_flank_run_at_the_rates_of_the_ellipse() -> None:
    land = landscape(2)
    found = arrivals(Devs8Fire(land, steady(4.0, 270.0), [MIDDLE]), 20_000.0)
    rate, heading, e = (float(field[0, 0]) for field in spread_fields(land, weather(4.0, 270.0)))
    assert heading == pytest.approx(np.pi / 2, abs=1e-3)
    assert found[20, 21] == pytest.approx(CELL_M / rate)
    assert found[20, 19] == pytest.approx(CELL_M / (rate * (1 - e) / (1 + e)))
    # Fire reaches the cell to the north from the ignition itself, or by way of its neighbours.
    assert found[19, 20] <= CELL_M / (rate * (1 - e)) * (1 + 1e-9)


def test_fire_runs_uphill() -> None:
    east_is_up = np.tile(np.arange(41) * 9.0, (41, 1))
    found = arrivals(Devs8Fire(landscape(1, east_is_up), steady(), [MIDDLE]), 3600.0)
    assert found[20, 24] < 0.5 * found[20, 16]
    assert found[16, 20] == found[24, 20]


def test_rates_are_projected_to_the_map() -> None:
    """Up a slope of 3 in 4 a path is 5/4 as long as on the map; the slope raises the rate."""
    east_is_up = np.tile(np.arange(41) * 0.75 * CELL_M, (41, 1))
    land = landscape(1, east_is_up)
    found = arrivals(Devs8Fire(land, steady(), [MIDDLE]), 600.0)
    along_slope = spread_fields(land, weather())[0][20, 20]
    assert found[20, 21] == pytest.approx(CELL_M / (along_slope * 4 / 5), rel=1e-6)


def test_a_river_holds_the_fire_even_at_its_corners() -> None:
    fuel = np.ones((41, 41), dtype=np.int16)
    fuel[:, 25] = 98
    found = arrivals(Devs8Fire(landscape(fuel), steady(6.0, 270.0), [MIDDLE]), 86_400.0)
    assert np.isfinite(found[:, :25]).all()
    assert np.isinf(found[:, 25:]).all()


def test_every_fuel_burns_and_no_bare_ground_does() -> None:
    land = landscape(np.array([[*range(1, 14), 91, 92, 93, 98, 99]]))
    rate, _, e = spread_fields(land, weather(3.0))
    assert (rate[0, :13] > 0.0).all()
    assert (rate[0, 13:] == 0.0).all()
    assert ((e >= 0.0) & (e < 1.0)).all()


def test_a_change_of_weather_keeps_the_way_already_made() -> None:
    """Fire covers half of a cell at the rate without wind, the other half at the rate with wind."""
    land = landscape(2)
    calm, windy = (float(spread_fields(land, weather(speed, 270.0))[0][0, 0]) for speed in (0, 5))
    change_s = 0.5 * CELL_M / calm
    stream = WeatherStream([weather(0.0, 270.0), weather(5.0, 270.0, at_s=change_s)])
    found = arrivals(Devs8Fire(land, stream, [MIDDLE]), change_s + 3600.0)
    assert found[20, 21] == pytest.approx(change_s + 0.5 * CELL_M / windy)


def test_a_change_to_the_same_weather_changes_nothing() -> None:
    land = landscape(2)
    once = arrivals(Devs8Fire(land, steady(3.0, 200.0), [MIDDLE]), 5400.0)
    stream = WeatherStream([weather(3.0, 200.0, at_s=at) for at in (0.0, 700.0, 1900.0)])
    again = arrivals(Devs8Fire(land, stream, [MIDDLE]), 5400.0)
    np.testing.assert_allclose(again, once, rtol=1e-9)


def test_rain_stops_the_fire_and_dry_weather_lets_it_go_on() -> None:
    wet = WeatherStream(
        [
            weather(3.0, 270.0),
            type(weather())(1800.0, 3.0, 270.0, 40.0, 40.0, 40.0, 300.0, 300.0),
            weather(3.0, 270.0, at_s=5400.0),
        ]
    )
    fire = Devs8Fire(landscape(1), wet, [MIDDLE])
    fire.advance(1800.0)
    before = fire.burned().sum()
    fire.advance(5400.0)
    assert fire.burned().sum() == before
    fire.advance(7200.0)
    assert fire.burned().sum() > before


def test_one_advance_and_many_give_the_same_bits() -> None:
    land = jacksboro(80, 80)
    stream = WeatherStream([weather(2.0, 40.0), weather(6.0, 50.0, 3600.0), weather(4.0, 9.0, 7e3)])
    ignitions = [(20, 60, 1000.0), (40, 40, 0.0), (70, 60, 3600.0), (5, 5, 8000.0)]
    whole = Devs8Fire(land, stream, ignitions)
    whole.advance(10_000.0)
    cut = Devs8Fire(land, stream, ignitions)
    for time_s in sorted({*np.linspace(0.0, 10_000.0, 277), 3600.0, 7e3, 7e3 + 1e-9}):
        cut.advance(float(time_s))
    assert whole.burned().sum() > 300
    assert [whole.arrival_time_s[row, col] for row, col, _ in ignitions] == [1000, 0, 3600, 8000]
    assert np.array_equal(whole.arrival_time_s, cut.arrival_time_s)


def test_now_and_the_future_are_kept_apart() -> None:
    fire = Devs8Fire(landscape(), steady(3.0), [MIDDLE, (2, 2, 900.0)])
    assert fire.burned().sum() == 1  # an ignition at 0 s burns at once
    fire.advance(899.0)
    assert not fire.burned()[2, 2]
    assert np.nanmax(np.where(fire.burned(), fire.arrival_time_s, np.nan)) <= fire.time_s == 899.0
    fire.advance(900.0)
    assert fire.burned()[2, 2]


def test_a_later_ignition_in_burned_ground_does_nothing() -> None:
    once = arrivals(Devs8Fire(landscape(), steady(3.0), [MIDDLE]), 3600.0)
    fire = Devs8Fire(landscape(), steady(3.0), [MIDDLE, (20, 20, 1800.0)])
    assert np.array_equal(arrivals(fire, 3600.0), once)


def test_arrivals_only_come_from_neighbours_and_later() -> None:
    """Each burned cell except the ignition has one of eight neighbours that burned before it."""
    found = arrivals(Devs8Fire(jacksboro(80, 80), steady(4.0, 45.0), [(40, 40, 0.0)]), 7200.0)
    padded = np.pad(found, 1, constant_values=np.inf)
    steps = [step for step in itertools.product((0, 1, 2), repeat=2) if step != (1, 1)]
    earliest = np.min([padded[r : r + 80, c : c + 80] for r, c in steps], axis=0)
    burned = np.isfinite(found)
    burned[40, 40] = False
    assert burned.sum() > 100
    assert (earliest[burned] < found[burned]).all()


@pytest.mark.parametrize(
    ("ignition", "message"),
    [
        ((41, 0, 0.0), "row 41, column 0: outside the landscape"),
        ((0, -1, 0.0), "row 0, column -1: outside the landscape"),
        ((0, 0, 0.0), "row 0, column 0: fuel code 98 does not burn"),
        ((1, 1, -5.0), "time -5.0 s must be 0 or later"),
    ],
)
def test_impossible_ignitions_are_refused(ignition: tuple[int, int, float], message: str) -> None:
    fuel = np.ones((41, 41), dtype=np.int16)
    fuel[0, 0] = 98
    with pytest.raises(FireModelError, match=message):
        Devs8Fire(landscape(fuel), steady(), [ignition])


def wind_for(length_to_width: float) -> float:
    """Return the wind in m/s that gives short grass this ellipse."""
    slow, fast = 0.0, 30.0
    for _ in range(60):
        wind = 0.5 * (slow + fast)
        e = float(spread_fields(landscape(1, shape=(1, 1)), weather(wind))[2][0, 0])
        slow, fast = (
            (wind, fast) if length_to_width * math.sqrt(1.0 - e * e) > 1.0 else (slow, wind)
        )
    return wind


@pytest.mark.parametrize(
    ("length_to_width", "wind_from_deg", "share"),
    [
        (1.43, 270.0, 0.78),  # DEVS-FIRE's two results, along a side and along a diagonal
        (1.43, 45.0, 0.78),
        (2.21, 270.0, 0.60),
        (2.21, 45.0, 0.60),
        (2.21, 22.5, 0.55),  # between two of the eight directions
    ],
)
def test_eight_directions_burn_as_much_of_the_ellipse_as_devs_fire(
    length_to_width: float, wind_from_deg: float, share: float
) -> None:
    wind = wind_for(length_to_width)
    land = landscape(1, shape=(161, 161))
    rate, _, e = (float(f[0, 0]) for f in spread_fields(land, weather(wind, wind_from_deg)))
    half_long_m_s = rate / (1.0 + e)
    time_s = 60.0 * CELL_M / rate
    fire = Devs8Fire(land, steady(wind, wind_from_deg), [(80, 80, 0.0)])
    fire.advance(time_s)
    ellipse_m2 = math.pi * (half_long_m_s * time_s) ** 2 / length_to_width
    assert fire.front(time_s).area / ellipse_m2 == pytest.approx(share, abs=0.01)


def test_states_are_available_for_the_past_only() -> None:
    fuel = np.ones((41, 41), dtype=np.int16)
    fuel[20, 24] = 98
    fire = Devs8Fire(landscape(fuel), steady(), [MIDDLE, (2, 2, 4000.0)])
    fire.advance(5000.0)
    later = fire.state_at(5000.0)
    assert [later[at] for at in ((20, 20), (20, 24), (2, 2), (38, 2))] == [
        BURNED,
        CANNOT_BURN,
        BURNING,
        UNBURNED,
    ]
    earlier = fire.state_at(0.0)
    assert earlier[20, 20] == BURNING
    assert (earlier == UNBURNED).sum() == 41 * 41 - 2
    assert np.array_equal(later == BURNED, fire.burned() & ~neighbours_of(later == UNBURNED))
    with pytest.raises(FireModelError, match=r"its state at 5000.1 s is not computed"):
        fire.state_at(5000.1)


def test_the_front_lies_where_the_fire_was_at_that_time() -> None:
    """The front may lie between two cells, on incomplete paths; later events have no effect."""
    still = float(spread_fields(landscape(), weather())[0][0, 0])
    fire = Devs8Fire(landscape(), steady(), [MIDDLE, (2, 2, 9.75 * CELL_M / still)])
    fire.advance(6.75 * CELL_M / still)
    now = fire.front(fire.time_s)
    x_m, y_m = (float(value) for value in landscape().xy_of(20.0, 20.0))
    assert now.bounds == pytest.approx(
        [x_m - 6.75 * CELL_M, y_m - 6.75 * CELL_M, x_m + 6.75 * CELL_M, y_m + 6.75 * CELL_M]
    )
    at_s = fire.time_s
    fire.advance(15.0 * CELL_M / still)
    assert fire.front(at_s).equals_exact(now, 1e-6)
    with pytest.raises(FireModelError, match="is not computed yet"):
        fire.front(fire.time_s + 1.0)


def test_the_front_does_not_depend_on_later_ignitions() -> None:
    still = float(spread_fields(landscape(), weather())[0][0, 0])
    alone, with_one_ahead = (
        Devs8Fire(landscape(), steady(), [MIDDLE, *more])
        for more in ([], [(20, 27, 6.8 * CELL_M / still)])
    )
    for fire in (alone, with_one_ahead):
        fire.advance(6.75 * CELL_M / still)
    assert with_one_ahead.front(alone.time_s).equals(alone.front(alone.time_s))


def test_a_fire_already_there_goes_on_from_its_outermost_cells() -> None:
    land = landscape(2)
    arrival_s = np.full(land.shape, np.inf)
    arrival_s[18:23, 18:23] = np.arange(25.0).reshape(5, 5)
    stream = WeatherStream([weather(9.0, 0.0), weather(0.0, 0.0, 500.0), weather(3.0, 90.0, 9e3)])
    fire = Devs8Fire(land, stream, [(5, 5, 1200.0)], Burning(1000.0, arrival_s, np.empty((0, 2))))
    assert fire.time_s == 1000.0
    assert np.array_equal(fire.arrival_time_s, arrival_s)
    assert (fire.state_at(1000.0) == BURNING).sum() == 16
    fire.advance(20_000.0)
    still = float(spread_fields(land, weather())[0][0, 0])
    assert fire.arrival_time_s[20, 23] == pytest.approx(1000.0 + CELL_M / still)
    assert fire.arrival_time_s[23, 23] == pytest.approx(1000.0 + math.sqrt(2.0) * CELL_M / still)
    assert fire.arrival_time_s[5, 5] == 1200.0
    assert np.array_equal(fire.arrival_time_s[18:23, 18:23], arrival_s[18:23, 18:23])


def test_unburnable_cells_do_not_spread_even_if_given_as_burned() -> None:
    fuel = np.ones((41, 41), dtype=np.int16)
    fuel[20, 20] = 98
    arrival_s = np.where(fuel == 98, 0.0, np.inf)
    fire = Devs8Fire(landscape(fuel), steady(), [], Burning(0.0, arrival_s, np.empty((0, 2))))
    fire.advance(86_400.0)
    assert fire.burned().sum() == 1


def intensity(fuel: int, wind_speed_m_s: float) -> float:
    rate = float(spread_fields(landscape(fuel), weather(wind_speed_m_s))[0][0, 0])
    bed = fuel_bed(FUEL_MODELS[fuel], weather().moisture)
    return float(fireline_intensity_kw_m(bed, rate))


def test_a_cell_ignites_only_if_its_intensity_passes_the_threshold() -> None:
    fuel = np.ones((41, 41), dtype=np.int16)
    fuel[:, 23:] = 8
    threshold = intensity(8, 3.0) * 1.01
    assert intensity(8, 0.0) < threshold < intensity(1, 0.0)
    stream = WeatherStream([weather(), weather(3.0, 270.0, 1e4), weather(4.0, 270.0, 2e4)])

    def burned(threshold_kw_m: float, until_s: float) -> np.ndarray:
        fire = Devs8Fire(landscape(fuel), stream, [MIDDLE], ignition_intensity_kw_m=threshold_kw_m)
        return arrivals(fire, until_s)

    assert np.isfinite(burned(0.0, 1e4)[:, 23]).any()
    found = burned(threshold, 3e4)
    assert np.isfinite(found[:, :23]).all()
    assert (found[10:31, 23] == 2e4).all()  # at this cell fire waited for a stronger wind
    assert found[:, 23:].min() == 2e4
    assert np.isfinite(found[20, 24])


def test_nothing_too_wet_ignites_until_it_is_dry() -> None:
    """Tall grass burns at a moisture of 15 %, short grass does not."""
    fuel = np.full((41, 41), 3, dtype=np.int16)
    fuel[:, 23:] = 1
    damp = type(weather())(0.0, 3.0, 270.0, 15.0, 15.0, 15.0, 60.0, 90.0)
    stream = WeatherStream([damp, weather(3.0, 270.0, 7200.0)])
    fire = Devs8Fire(landscape(fuel), stream, [MIDDLE, (20, 39, 60.0)])
    fire.advance(7199.0)
    assert fire.burned()[10:31, 22].all()
    assert np.argwhere(fire.burned()[:, 23:]).tolist() == [[20, 16]]  # the lit cell does not spread
    fire.advance(10_800.0)
    assert (fire.arrival_time_s[10:31, 23] == 7200.0).all()
    dry = float(spread_fields(landscape(1), weather(3.0, 270.0))[0][0, 0])
    assert fire.arrival_time_s[20, 40] == pytest.approx(7200.0 + CELL_M / dry)


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_an_impossible_threshold_is_refused(value: float) -> None:
    with pytest.raises(FireModelError, match=r"ignition_intensity_kw_m = .* must be 0 or more"):
        Devs8Fire(landscape(), steady(), [MIDDLE], ignition_intensity_kw_m=value)


def test_the_wind_limit_can_be_turned_on() -> None:
    bed = fuel_bed(FUEL_MODELS[8], weather().moisture)
    midflame = 25.0 * float(wind_adjustment_factor(FUEL_MODELS[8].depth_ft))
    rates = []
    for limit in (False, True):
        fire = Devs8Fire(landscape(8), steady(25.0, 270.0), [MIDDLE], wind_limit=limit)
        rate = float(fastest_spread(bed, midflame, 90.0, np.zeros(1), np.zeros(1), limit)[0][0])
        assert arrivals(fire, 86_400.0)[20, 21] == pytest.approx(CELL_M / rate, rel=1e-6)
        rates.append(rate)
    assert rates[1] < 0.9 * rates[0]


@pytest.mark.parametrize("time_s", [99.0, float("nan"), float("inf")])
def test_time_only_goes_forward(time_s: float) -> None:
    fire = Devs8Fire(landscape(), steady(), [MIDDLE])
    fire.advance(100.0)
    with pytest.raises(FireModelError, match=r"is at 100.0 s and cannot advance to"):
        fire.advance(time_s)
