"""Requirements of the any-angle scheme, compared with exact solutions if there are any."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival, burning_from_perimeter
from tests.firemodel.grids import CELL_M, landscape, steady, weather
from tests.firemodel.spread_fields import spread_fields

Floats = NDArray[np.float64]


def offsets_m(land: Landscape, row: float, col: float) -> tuple[Floats, Floats]:
    """Return the offsets north and east of a position for every cell, in m."""
    rows, cols = np.indices(land.shape)
    return np.asarray((row - rows) * CELL_M), np.asarray((cols - col) * CELL_M)


def ellipse_s(land: Landscape, entry: Weather, row: int, col: int) -> Floats:
    """Return the arrival times of the exact ellipse on flat ground with one fuel."""
    rate, heading, e = (float(field[0, 0]) for field in spread_fields(land, entry))
    north, east = offsets_m(land, row, col)
    along = north * math.cos(heading) + east * math.sin(heading)
    return np.asarray((np.hypot(north, east) - e * along) / (rate * (1.0 - e)))


def first_near(times_s: Floats) -> Floats:
    """Return the earliest time within three cells of each cell, without the cell itself."""
    padded = np.pad(times_s, 3, constant_values=np.inf)
    rows, cols = times_s.shape
    steps = [(row, col) for row in range(7) for col in range(7) if (row, col) != (3, 3)]
    around = [padded[row : row + rows, col : col + cols] for row, col in steps]
    return np.asarray(np.min(around, axis=0))


def wind_for(length_to_width: float) -> float:
    """Return the wind on fuel 1 for an ellipse of this length-to-width ratio, by bisection."""
    low, high = 0.0, 60.0
    e = math.sqrt(1.0 - length_to_width**-2)
    for _ in range(60):
        middle = (low + high) / 2.0
        thinness = spread_fields(landscape(1, shape=(2, 2)), weather(middle))[2][0, 0]
        low, high = (middle, high) if thinness < e else (low, middle)
    return low


def ellipse_200_cells_long(land: Landscape, entry: Weather) -> tuple[Floats, float]:
    """Return exact arrival times, and the time at which the ellipse is 200 cells long."""
    exact_s = ellipse_s(land, entry, *(size // 2 for size in land.shape))
    rate, _, e = (float(field[0, 0]) for field in spread_fields(land, entry))
    return exact_s, 200 * CELL_M / (rate + rate * (1.0 - e) / (1.0 + e))


@pytest.mark.parametrize("wind_from_deg", [0.0, 20.0, 45.0])
@pytest.mark.parametrize("length_to_width", [1.2, 2.3, 4.1])
def test_on_even_ground_it_is_the_exact_ellipse(
    length_to_width: float, wind_from_deg: float
) -> None:
    land, entry = landscape(1, shape=(441, 441)), weather(wind_for(length_to_width), wind_from_deg)
    exact_s, time_s = ellipse_200_cells_long(land, entry)
    fire = AnyAngleFire(land, WeatherStream([entry]), [(220, 220, 0.0)])
    fire.advance(time_s)
    burned = exact_s <= time_s
    assert burned.sum() > 3000
    assert np.array_equal(fire.burned(), burned)
    np.testing.assert_allclose(fire.arrival_time_s[burned], exact_s[burned], rtol=1e-9)
    assert fire.front(time_s).area == pytest.approx(burned.sum() * CELL_M**2, rel=0.01)


@pytest.mark.parametrize(("length_to_width", "worst"), [(1.2, 0.001), (2.3, 0.01), (4.1, 0.04)])
@pytest.mark.parametrize("wind_from_deg", [0.0, 20.0, 45.0])
def test_where_no_two_cells_are_alike_it_is_nearly_that_ellipse(
    length_to_width: float, worst: float, wind_from_deg: float
) -> None:
    # Tiny differences in height have no effect, except that lines are followed cell by cell.
    heights = np.random.default_rng(1).uniform(0.0, 1e-3, (441, 441))
    land, entry = landscape(1, heights), weather(wind_for(length_to_width), wind_from_deg)
    exact_s, time_s = ellipse_200_cells_long(landscape(1, shape=(441, 441)), entry)
    fire = AnyAngleFire(land, WeatherStream([entry]), [(220, 220, 0.0)])
    fire.advance(time_s)
    burned = exact_s <= time_s
    assert (fire.burned() ^ burned).sum() / burned.sum() <= worst


def test_on_a_plane_in_the_slope_it_is_the_ellipse_in_that_plane() -> None:
    rows, cols = np.indices((121, 121))
    land = landscape(1, 12.0 * (120 - rows) + 6.0 * cols)  # rises 0.4 to the north, 0.2 to the east
    fire = AnyAngleFire(land, steady(3.0, 300.0), [(60, 60, 0.0)])
    rate, heading, e = (field[60, 60] for field in spread_fields(land, weather(3.0, 300.0)))
    north, east = offsets_m(land, 60, 60)
    up = 0.4 * north + 0.2 * east
    head = np.array([math.cos(heading), math.sin(heading)])
    head_up = 0.4 * head[0] + 0.2 * head[1]
    along = (north * head[0] + east * head[1] + up * head_up) / math.sqrt(1.0 + head_up**2)
    exact_s = (np.sqrt(north**2 + east**2 + up**2) - e * along) / (rate * (1.0 - e))
    fire.advance(float(np.quantile(exact_s, 0.3)))
    inner = np.s_[2:-2, 2:-2]  # cells at the edge have another slope
    found = fire.arrival_time_s[inner]
    burned = np.isfinite(found)
    np.testing.assert_allclose(found[burned], exact_s[inner][burned], rtol=1e-5)


def test_fire_is_bent_at_the_border_of_two_fuels() -> None:
    codes = np.full((81, 81), 1, dtype=np.int16)
    codes[:, 41:] = 4  # the border is half a cell east of column 40
    land = landscape(codes)
    slow, fast = (float(spread_fields(land, weather())[0][0, col]) for col in (0, 80))
    fire = AnyAngleFire(land, steady(), [(40, 20, 0.0)])
    fire.advance(1e6)
    for row, col in [(40, 60), (20, 60), (5, 45), (75, 50)]:
        # Point at which the path crosses the border (Fermat).
        south_m = (np.linspace(-0.5, 80.5, 20_001) - 40) * CELL_M
        first = np.hypot(20.5 * CELL_M, south_m) / slow
        then = np.hypot((col - 40.5) * CELL_M, (row - 40) * CELL_M - south_m) / fast
        assert fire.arrival_time_s[row, col] == pytest.approx((first + then).min(), rel=0.01)


def test_fire_goes_round_the_end_of_a_barrier() -> None:
    codes = np.full((61, 61), 1, dtype=np.int16)
    codes[10:, 30] = 98
    fire = AnyAngleFire(landscape(codes), steady(), [(40, 20, 0.0)])
    fire.advance(1e6)
    still = float(spread_fields(landscape(1), weather())[0][0, 0])
    round_the_corner_m = CELL_M * (math.hypot(30.5, 10.5) + math.hypot(30.5, 9.5))
    assert fire.arrival_time_s[40, 40] == pytest.approx(round_the_corner_m / still, rel=0.02)
    assert np.isinf(fire.arrival_time_s[20, 30])


def test_a_barrier_of_cells_that_touch_by_corners_holds() -> None:
    codes = np.full((40, 40), 1, dtype=np.int16)
    np.fill_diagonal(codes, 98)
    heights = np.random.default_rng(2).uniform(0.0, 3.0, codes.shape)
    changes = [weather(4.0, 60.0 * number % 360.0, 600.0 * number) for number in range(20)]
    fire = AnyAngleFire(landscape(codes, heights), WeatherStream(changes), [(30, 5, 0.0)])
    fire.advance(1e6)
    below = np.tri(40, k=-1, dtype=bool)
    assert np.array_equal(fire.burned(), below)


def minkowski_s(entries: list[Weather], end_s: float, land: Landscape) -> NDArray[np.bool_]:
    """Return the exact burned area of a fire on even ground: the Minkowski sum of the ellipses."""
    angle = np.linspace(0.0, 2.0 * np.pi, 1440, endpoint=False)
    support_m = np.zeros_like(angle)
    for entry, until_s in zip(entries, [*(e.at_s for e in entries[1:]), np.inf], strict=True):
        lasts_s = min(until_s, end_s) - entry.at_s
        if lasts_s > 0.0:
            rate, heading, e = (float(field[0, 0]) for field in spread_fields(land, entry))
            half = rate / (1.0 + e)  # direction of the long axis
            off = np.cos(angle - heading)
            wide = np.sqrt((half * off) ** 2 + half**2 * (1.0 - e * e) * (1.0 - off**2))
            support_m += lasts_s * (half * e * off + wide)
    north, east = offsets_m(land, *(size // 2 for size in land.shape))
    inside = np.ones(land.shape, dtype=bool)
    for direction, distance_m in zip(angle, support_m, strict=True):
        inside &= north * math.cos(direction) + east * math.sin(direction) <= distance_m
    return inside


@pytest.mark.parametrize(
    ("every_s", "worst"), [(900.0, 0.003), (1800.0, 0.002), (3600.0, 0.001), (14_400.0, 0.001)]
)
def test_when_the_wind_turns_it_is_the_sum_of_the_ellipses(every_s: float, worst: float) -> None:
    generator = np.random.default_rng(3)
    entries = [
        weather(2.0 + 2.0 * generator.random(), 360.0 * generator.random(), every_s * number)
        for number in range(60)
    ]
    land = landscape(1, shape=(241, 241))
    fire = AnyAngleFire(land, WeatherStream(entries), [(120, 120, 0.0)])
    while not (fire.burned()[[20, -20]].any() or fire.burned()[:, [20, -20]].any()):
        fire.advance(fire.time_s + 900.0)
    exact = minkowski_s(entries, fire.time_s, land)
    assert exact.sum() > 10_000
    assert (fire.burned() ^ exact).sum() / exact.sum() <= worst


@pytest.mark.parametrize("cells_per_change", [10.0, 3.0, 1.0, 0.3])
def test_changes_that_hardly_are_any_change_little(cells_per_change: float) -> None:
    land = landscape(1, shape=(161, 161))
    rate = float(spread_fields(land, weather(3.0, 20.0))[0][0, 0])
    end_s = 70 * CELL_M / rate
    times_s = np.arange(0.0, end_s, cells_per_change * CELL_M / rate)
    same = WeatherStream(
        [weather(3.0 + 1e-9 * (n % 2), 20.0, float(at_s)) for n, at_s in enumerate(times_s)]
    )
    found, expected = (
        AnyAngleFire(land, stream, [(80, 80, 0.0)]) for stream in (same, steady(3.0, 20.0))
    )
    found.advance(end_s)
    expected.advance(end_s)
    differs = (found.burned() ^ expected.burned()).sum() / expected.burned().sum()
    # The difference would be 10 to 90 % if progress were lost at each change.
    assert differs <= 0.025


def mixed(seed: int, size: int = 40) -> Landscape:
    generator = np.random.default_rng(seed)
    codes = generator.choice([1, 2, 4, 8, 10, 102, 98], size=(size, size)).astype(np.int16)
    codes[size // 2, size // 2] = 1
    heights = 30.0 * generator.random((size, size))
    return landscape(codes, heights)


@settings(max_examples=25)
@given(
    st.integers(0, 1000),
    st.lists(st.floats(1.0, 40_000.0), max_size=8),
    st.lists(st.tuples(st.floats(0.0, 8.0), st.floats(0.0, 360.0)), min_size=1, max_size=5),
)
def test_however_it_is_cut_the_fire_is_the_same(
    seed: int, stops_s: list[float], winds: list[tuple[float, float]]
) -> None:
    land = mixed(seed)
    stream = WeatherStream(
        [weather(speed, from_deg, 3600.0 * hour) for hour, (speed, from_deg) in enumerate(winds)]
    )
    lit = [(20, 20, 0.0), *((row, 3, 5000.0) for row in range(40) if land.fuel_model[row, 3] < 98)]
    whole, cut = AnyAngleFire(land, stream, lit), AnyAngleFire(land, stream, lit)
    for stop_s in sorted(stops_s):
        cut.advance(stop_s)
    for fire in (whole, cut):
        fire.advance(50_000.0)
    assert np.array_equal(whole.arrival_time_s, cut.arrival_time_s)
    # Fire reaches each cell from a nearby cell that burned earlier, or from the ignition.
    around = first_near(whole.arrival_time_s)
    burned = whole.burned()
    for row, col, _ in lit:
        burned[row, col] = False
    assert (around[burned] <= whole.arrival_time_s[burned]).all()


def test_what_was_too_wet_burns_on_when_it_is_dry() -> None:
    wet = Weather(3600.0, 3.0, 270.0, 40.0, 40.0, 40.0, 60.0, 90.0)
    dry = [weather(3.0, 270.0), wet, weather(3.0, 270.0, 36_000.0)]
    land = mixed(5)
    found = AnyAngleFire(land, WeatherStream(dry), [(20, 20, 0.0)])
    expected = AnyAngleFire(land, steady(3.0, 270.0), [(20, 20, 0.0)])
    for time_s, same_s in ((3600.0, 3600.0), (36_000.0, 3600.0), (50_000.0, 17_600.0)):
        found.advance(time_s)
        if same_s > expected.time_s:
            expected.advance(same_s)
        differs = (found.burned() ^ expected.burned()).sum() / expected.burned().sum()
        assert differs <= 0.01
    assert expected.burned().sum() > 500


def test_what_is_lit_in_the_wet_burns_when_it_is_dry() -> None:
    wet = Weather(0.0, 3.0, 270.0, 40.0, 40.0, 40.0, 60.0, 90.0)
    land = mixed(5)
    later = WeatherStream([wet, weather(3.0, 270.0, 7200.0)])
    found = AnyAngleFire(land, later, [(20, 20, 0.0)])
    expected = AnyAngleFire(land, steady(3.0, 270.0), [(20, 20, 0.0)])
    found.advance(7200.0)
    assert found.burned().sum() == 1
    found.advance(20_000.0)
    expected.advance(12_800.0)
    assert expected.burned().sum() > 200
    differs = (found.burned() ^ expected.burned()).sum() / expected.burned().sum()
    assert differs <= 0.01


def test_a_way_that_is_not_the_best_loses_nothing_either() -> None:
    codes = np.full((3, 9), 98, dtype=np.int16)
    codes[1, 3:6] = 8  # fire from both ends reaches the middle
    entries = [weather(4.0, 270.0), weather(4.0, 90.0, 1800.0), weather(4.0, 270.0, 3600.0)]
    land = landscape(codes)
    fire = AnyAngleFire(land, WeatherStream(entries), [(1, 3, 0.0), (1, 5, 0.0)])
    ahead, back = (
        float(ellipse_s(landscape(8, shape=(1, 3)), weather(4.0, from_deg), 0, 1)[0, 2])
        for from_deg in (270.0, 90.0)
    )
    assert ahead < back
    # Fire runs eastwards in the first half hour and from the second hour on, and westwards in
    # between; the distance in each direction is the sum of its periods.
    eastwards = westwards = 0.0
    time_s, step_s = 0.0, 0.5
    while max(eastwards, westwards) < 1.0:
        from_west = not 1800.0 <= time_s < 3600.0
        eastwards += step_s / (ahead if from_west else back)
        westwards += step_s / (back if from_west else ahead)
        time_s += step_s
    assert time_s > 1800.0
    fire.advance(1e5)
    assert fire.arrival_time_s[1, 4] == pytest.approx(time_s, abs=1.0)


def test_a_gale_does_not_change_the_past() -> None:
    land = mixed(3, 80)
    gales = WeatherStream([weather(30.0, 25.0), weather(30.0, 205.0, 900.0)])
    fire = AnyAngleFire(land, gales, [(40, 40, 0.0)])
    while fire.time_s < 3000.0:
        burned, since_s = fire.burned(), fire.time_s
        fire.advance(since_s + 7.0)
        assert (fire.arrival_time_s[~burned] > since_s).all()
    assert fire.burned().sum() > 200


def test_a_cell_lit_later_burns_from_then_on() -> None:
    stream = WeatherStream([weather(), weather(2.0, 90.0, 1000.0), weather(0.0, 0.0, 2000.0)])
    lit = [(5, 5, 0.0), (30, 30, 1000.0), (5, 30, 1500.0)]
    fire = AnyAngleFire(landscape(1), stream, lit)
    fire.advance(999.0)
    assert not fire.burned()[25:, 25:].any()
    fire.advance(3000.0)
    assert [fire.arrival_time_s[row, col] for row, col, _ in lit] == [0.0, 1000.0, 1500.0]
    assert np.isfinite(fire.arrival_time_s[30, 29])


@pytest.mark.parametrize("take_over", ["perimeter", "arrival"])
def test_a_fire_taken_over_goes_on_as_it_would_have(take_over: str) -> None:
    land = landscape(1, shape=(161, 161))
    stream = WeatherStream([weather(3.0, 20.0), weather(2.0, 100.0, 20_000.0)])
    fire = AnyAngleFire(land, stream, [(80, 80, 0.0)])
    fire.advance(9000.0)
    early = fire.arrival_time_s.copy()
    if take_over == "perimeter":
        burning = burning_from_perimeter(fire.front(9000.0).geoms, land, 9000.0)
    else:
        burning = burning_from_arrival(early, land, 9000.0)
    other = AnyAngleFire(land, stream, [], burning)
    assert other.time_s == 9000.0
    assert np.array_equal(other.burned(), np.isfinite(early))
    assert other.front(9000.0).area == pytest.approx(fire.front(9000.0).area, rel=0.01)
    fire.advance(30_000.0)
    other.advance(30_000.0)
    assert fire.burned().sum() > 4 * np.isfinite(early).sum()
    # The position of a front in an arrival raster is known only to half a cell.
    worst = 0.01 if take_over == "perimeter" else 0.03
    assert (fire.burned() ^ other.burned()).sum() / fire.burned().sum() <= worst


def test_the_state_of_each_cell_at_a_time() -> None:
    codes = np.full((21, 21), 1, dtype=np.int16)
    codes[10, 12] = 98
    fire = AnyAngleFire(landscape(codes), steady(), [(10, 10, 0.0)])
    fire.advance(5000.0)
    state = fire.state_at(float(fire.arrival_time_s[10, 9]))
    assert state[10, 12] == 3
    assert state[10, 10] == 1  # fire continues from the neighbours at its corners
    assert state[10, 9] == 1
    assert state[0, 0] == 0
    assert fire.state_at(5000.0)[10, 10] == 2
    with pytest.raises(FireModelError, match="is not computed yet"):
        fire.state_at(5000.1)


@pytest.mark.parametrize(
    ("lit", "message"),
    [
        ((-1, 3, 0.0), "outside the landscape"),
        ((3, 41, 0.0), "outside the landscape"),
        ((3, 3, -1.0), "must be 0 or later"),
        ((3, 3, math.nan), "must be 0 or later"),
        ((5, 5, 0.0), "fuel code 98 does not burn"),
    ],
)
def test_nothing_is_lit_where_or_when_it_cannot_be(
    lit: tuple[int, int, float], message: str
) -> None:
    codes = np.full((41, 41), 1, dtype=np.int16)
    codes[5, 5] = 98
    with pytest.raises(FireModelError, match=message):
        AnyAngleFire(landscape(codes), steady(), [lit])


@pytest.mark.parametrize("to_s", [5.0, math.inf, math.nan])
def test_time_only_goes_forward(to_s: float) -> None:
    fire = AnyAngleFire(landscape(1), steady(), [(20, 20, 0.0)])
    fire.advance(10.0)
    with pytest.raises(FireModelError, match="use a later, finite time"):
        fire.advance(to_s)
