"""What a fire over cells must do: physics one can reason about, and the same result however cut."""

import itertools

import numpy as np
import pytest

from firemodel.cellular import CellularFire, spread_fields
from firemodel.default_landscape import jacksboro
from firemodel.errors import FireModelError
from firemodel.weather import WeatherStream
from tests.firemodel.grids import CELL_M, landscape, steady, weather

MIDDLE = (20, 20, 0.0)


def arrivals(fire: CellularFire, to_time_s: float) -> np.ndarray:
    fire.advance(to_time_s)
    return fire.arrival_time_s


def test_without_wind_and_slope_the_fire_is_a_regular_octagon() -> None:
    land = landscape()
    found = arrivals(CellularFire(land, steady(), [MIDDLE]), 15_000.0)
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
        (270.0, (20, 24), (20, 16)),  # from the west: eastwards, towards higher columns
        (0.0, (24, 20), (16, 20)),  # from the north: southwards, towards higher rows
        (45.0, (24, 16), (16, 24)),  # from the north-east: south-westwards
    ],
)
def test_wind_drives_the_fire_downwind(
    wind_from_deg: float, ahead: tuple[int, int], behind: tuple[int, int]
) -> None:
    fire = CellularFire(landscape(2), steady(4.0, wind_from_deg), [MIDDLE])
    found = arrivals(fire, 7200.0)
    assert found[ahead] < 0.4 * found[behind]


def test_head_back_and_flank_run_at_the_rates_of_the_ellipse() -> None:
    land = landscape(2)
    found = arrivals(CellularFire(land, steady(4.0, 270.0), [MIDDLE]), 20_000.0)
    rate, heading, e = (float(field[0, 0]) for field in spread_fields(land, weather(4.0, 270.0)))
    assert heading == pytest.approx(np.pi / 2)
    assert found[20, 21] == pytest.approx(CELL_M / rate)
    assert found[20, 19] == pytest.approx(CELL_M / (rate * (1 - e) / (1 + e)))
    # The cell to the north is reached from the ignition itself, or round over its neighbours.
    assert found[19, 20] <= CELL_M / (rate * (1 - e)) * (1 + 1e-9)


def test_fire_runs_uphill() -> None:
    east_is_up = np.tile(np.arange(41) * 9.0, (41, 1))
    found = arrivals(CellularFire(landscape(1, east_is_up), steady(), [MIDDLE]), 3600.0)
    assert found[20, 24] < 0.5 * found[20, 16]
    assert found[16, 20] == found[24, 20]


def test_rates_are_projected_to_the_map() -> None:
    """Up a slope of 3 in 4 the way is 5/4 as long as on the map; the slope also drives it."""
    east_is_up = np.tile(np.arange(41) * 0.75 * CELL_M, (41, 1))
    land = landscape(1, east_is_up)
    found = arrivals(CellularFire(land, steady(), [MIDDLE]), 600.0)
    along_slope = spread_fields(land, weather())[0][20, 20]
    assert found[20, 21] == pytest.approx(CELL_M / (along_slope * 4 / 5), rel=1e-6)


def test_a_river_holds_the_fire_even_at_its_corners() -> None:
    fuel = np.ones((41, 41), dtype=np.int16)
    fuel[:, 25] = 98
    found = arrivals(CellularFire(landscape(fuel), steady(6.0, 270.0), [MIDDLE]), 86_400.0)
    assert np.isfinite(found[:, :25]).all()
    assert np.isinf(found[:, 25:]).all()


def test_every_fuel_burns_and_no_bare_ground_does() -> None:
    land = landscape(np.array([[*range(1, 14), 91, 92, 93, 98, 99]]))
    rate, _, e = spread_fields(land, weather(3.0))
    assert (rate[0, :13] > 0.0).all()
    assert (rate[0, 13:] == 0.0).all()
    assert ((e >= 0.0) & (e < 1.0)).all()


def test_a_change_of_weather_keeps_the_way_already_made() -> None:
    """Half of a cell at the calm rate, the other half at the windy one."""
    land = landscape(2)
    calm, windy = (float(spread_fields(land, weather(speed, 270.0))[0][0, 0]) for speed in (0, 5))
    change_s = 0.5 * CELL_M / calm
    stream = WeatherStream([weather(0.0, 270.0), weather(5.0, 270.0, at_s=change_s)])
    found = arrivals(CellularFire(land, stream, [MIDDLE]), change_s + 3600.0)
    assert found[20, 21] == pytest.approx(change_s + 0.5 * CELL_M / windy)


def test_a_change_to_the_same_weather_changes_nothing() -> None:
    land = landscape(2)
    once = arrivals(CellularFire(land, steady(3.0, 200.0), [MIDDLE]), 5400.0)
    stream = WeatherStream([weather(3.0, 200.0, at_s=at) for at in (0.0, 700.0, 1900.0)])
    again = arrivals(CellularFire(land, stream, [MIDDLE]), 5400.0)
    np.testing.assert_allclose(again, once, rtol=1e-9)


def test_rain_stops_the_fire_and_dry_weather_lets_it_go_on() -> None:
    wet = WeatherStream(
        [
            weather(3.0, 270.0),
            type(weather())(1800.0, 3.0, 270.0, 40.0, 40.0, 40.0, 300.0, 300.0),
            weather(3.0, 270.0, at_s=5400.0),
        ]
    )
    fire = CellularFire(landscape(1), wet, [MIDDLE])
    fire.advance(1800.0)
    before = fire.burned().sum()
    fire.advance(5400.0)
    assert fire.burned().sum() == before
    fire.advance(7200.0)
    assert fire.burned().sum() > before


def test_one_advance_and_many_give_the_same_bits() -> None:
    land = jacksboro(80, 80)
    stream = WeatherStream([weather(2.0, 40.0), weather(6.0, 50.0, 3600.0), weather(4.0, 9.0, 7e3)])
    ignitions = [(40, 40, 0.0), (20, 60, 1000.0)]
    whole = CellularFire(land, stream, ignitions)
    whole.advance(10_000.0)
    cut = CellularFire(land, stream, ignitions)
    for time_s in sorted({*np.linspace(0.0, 10_000.0, 277), 3600.0, 7e3, 7e3 + 1e-9}):
        cut.advance(float(time_s))
    assert whole.burned().sum() > 300
    assert np.array_equal(whole.arrival_time_s, cut.arrival_time_s)


def test_now_and_the_future_are_kept_apart() -> None:
    fire = CellularFire(landscape(), steady(3.0), [MIDDLE, (2, 2, 900.0)])
    assert fire.burned().sum() == 1  # an ignition at 0 s burns at once
    fire.advance(899.0)
    assert not fire.burned()[2, 2]
    assert np.nanmax(np.where(fire.burned(), fire.arrival_time_s, np.nan)) <= fire.time_s == 899.0
    fire.advance(900.0)
    assert fire.burned()[2, 2]


def test_a_later_ignition_in_burned_ground_does_nothing() -> None:
    once = arrivals(CellularFire(landscape(), steady(3.0), [MIDDLE]), 3600.0)
    fire = CellularFire(landscape(), steady(3.0), [MIDDLE, (20, 20, 1800.0)])
    assert np.array_equal(arrivals(fire, 3600.0), once)


def test_arrivals_only_come_from_neighbours_and_later() -> None:
    """Each burned cell but the ignition has an 8-neighbour that burned before it."""
    found = arrivals(CellularFire(jacksboro(80, 80), steady(4.0, 45.0), [(40, 40, 0.0)]), 7200.0)
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
        CellularFire(landscape(fuel), steady(), [ignition])


@pytest.mark.parametrize("time_s", [99.0, float("nan"), float("inf")])
def test_time_only_goes_forward(time_s: float) -> None:
    fire = CellularFire(landscape(), steady(), [MIDDLE])
    fire.advance(100.0)
    with pytest.raises(FireModelError, match=r"is at 100.0 s and cannot go to"):
        fire.advance(time_s)
