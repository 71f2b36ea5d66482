"""A fire from a perimeter or from arrival times continues like an uninterrupted fire."""

import math

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, Point

from firemodel.errors import FireModelError
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival, burning_from_perimeter
from firemodel.spread.devs8 import Devs8Fire
from firemodel.spread.fire_scheme import check_burning
from tests.firemodel.grids import CELL_M, NORTH_M, WEST_M, landscape, steady, weather
from tests.firemodel.spread_fields import spread_fields

LAND = landscape(shape=(81, 81))
MIDDLE = Point(WEST_M + 40.5 * CELL_M, NORTH_M - 40.5 * CELL_M)
RATE_M_S = float(spread_fields(LAND, weather())[0][0, 0])


def test_cells_inside_a_perimeter_have_burned_and_its_outline_is_the_front() -> None:
    circle = MIDDLE.buffer(310.0, 64)
    burning = burning_from_perimeter([circle], LAND, 60.0)
    row, col = np.indices(LAND.shape)
    inside = shapely.contains_xy(circle, *LAND.xy_of(row, col))
    assert np.array_equal(burning.arrival_s == 60.0, inside)
    assert np.isinf(burning.arrival_s[~inside]).all()
    away_m = CELL_M * np.hypot(*(burning.front - 40.0).T)
    assert away_m == pytest.approx(310.0, abs=1.0)
    square = burning_from_perimeter([circle.envelope], LAND, 60.0)
    assert np.hypot(*np.diff(square.front, axis=0).T).max() <= 0.5


def test_a_circle_grows_from_its_outline() -> None:
    fire = AnyAngleFire(LAND, steady(), [], burning_from_perimeter([MIDDLE.buffer(200)], LAND, 0.0))
    fire.advance(500.0 / RATE_M_S)
    assert fire.front(fire.time_s).area == pytest.approx(math.pi * 700.0**2, rel=0.01)


def test_an_island_burns_in_from_its_own_outline() -> None:
    ring = MIDDLE.buffer(900.0).difference(MIDDLE.buffer(600.0))
    fire = AnyAngleFire(LAND, steady(), [], burning_from_perimeter([ring], LAND, 0.0))
    assert fire.arrival_time_s[40, 40] == np.inf
    fire.advance(700.0 / RATE_M_S)
    assert fire.arrival_time_s[40, 40] == pytest.approx(600.0 / RATE_M_S, rel=0.02)


def test_no_front_between_polygons_that_meet_nor_off_the_grid() -> None:
    west, south, east, north = box = (WEST_M - 300, NORTH_M - 900, WEST_M + 600, NORTH_M + 300)
    middle = WEST_M + 200.0
    halves = [shapely.box(west, south, middle, north), shapely.box(middle, south, east, north)]
    burning = burning_from_perimeter(halves, LAND, 0.0)
    whole = burning_from_perimeter([shapely.box(*box)], LAND, 0.0)
    assert np.array_equal(burning.arrival_s, whole.arrival_s)
    assert (burning.arrival_s[:30, :20] == 0.0).all()
    outline = LineString([(-0.5, 29.5), (19.5, 29.5), (19.5, -0.5)])  # column, row
    assert (shapely.distance(shapely.points(burning.front[:, ::-1]), outline) < 1e-9).all()
    assert (burning.front > -0.5).all()


def test_a_fire_taken_over_half_way_ends_as_the_one_that_went_on() -> None:
    wind = steady(3.0, 250.0)
    whole = AnyAngleFire(LAND, wind, [(45, 20, 0.0)])
    whole.advance(7200.0)
    burning = burning_from_arrival(whole.arrival_time_s, LAND, 3000.0)
    rest = AnyAngleFire(LAND, wind, [], burning)
    before = whole.arrival_time_s <= 3000.0
    assert np.array_equal(rest.arrival_time_s[before], whole.arrival_time_s[before])
    assert np.isinf(rest.arrival_time_s[~before]).all()
    rest.advance(7200.0)
    expected, found = whole.front(7200.0), rest.front(7200.0)
    assert expected.symmetric_difference(found).area / expected.area < 0.01


def test_what_cannot_be_taken_over_is_refused() -> None:
    with pytest.raises(FireModelError, match="no outline of the perimeter is on the landscape"):
        burning_from_perimeter([Point(0.0, 0.0).buffer(100.0)], LAND, 0.0)
    arrival_s = np.full(LAND.shape, np.inf)
    arrival_s[3, 4] = 60.0
    with pytest.raises(FireModelError, match=r"the first is at 60.0 s"):
        burning_from_arrival(arrival_s, LAND, 59.0)
    with pytest.raises(FireModelError, match=r"every cell has an arrival by 59.0 s"):
        burning_from_arrival(np.zeros(LAND.shape), LAND, 59.0)
    with pytest.raises(
        FireModelError, match=r"arrival has the shape \(81, 80\), but the landscape \(81, 81"
    ):
        burning_from_arrival(arrival_s[:, 1:], LAND, 60.0)


def test_a_perimeter_smaller_than_a_cell_burns_on_by_every_scheme() -> None:
    corner = Point(WEST_M + 40.0 * CELL_M, NORTH_M - 40.0 * CELL_M)  # half of four cells
    both = burning_from_perimeter([corner.buffer(3.0), MIDDLE.buffer(100.0)], LAND, 0.0)
    tiny = burning_from_perimeter([corner.buffer(3.0)], LAND, 0.0)
    assert np.count_nonzero(tiny.arrival_s == 0.0) == 1
    assert np.count_nonzero(both.arrival_s == 0.0) > 30
    for scheme in (AnyAngleFire, Devs8Fire):
        fire = scheme(LAND, steady(), [], tiny)
        fire.advance(300.0 / RATE_M_S)
        assert np.count_nonzero(fire.burned()) > 80


def test_a_fire_can_be_taken_over_at_the_very_moment_it_was_lit() -> None:
    whole = AnyAngleFire(LAND, steady(), [(40, 40, 0.0)])
    whole.advance(1000.0)
    rest = AnyAngleFire(LAND, steady(), [], burning_from_arrival(whole.arrival_time_s, LAND, 0.0))
    rest.advance(1000.0)
    assert rest.arrival_time_s == pytest.approx(whole.arrival_time_s, rel=0.02)
    assert rest.front(0.0).area == 0.0


def test_what_is_burning_has_to_fit_the_landscape_and_its_time() -> None:
    good = burning_from_perimeter([MIDDLE.buffer(310.0)], LAND, 60.0)
    check_burning(good, LAND)
    later, lost = good.arrival_s.copy(), good.arrival_s.copy()
    later[40, 41], lost[3, 4] = 61.0, np.nan
    for changed, message in (
        ({"arrival_s": good.arrival_s[1:]}, r"arrival has the shape \(80, 81\), but the landscape"),
        ({"arrival_s": later}, r"61.0 at row 40, column 41 \(1 such cells\); .* at_s = 60.0"),
        ({"arrival_s": lost}, r"nan at row 3, column 4"),
        ({"at_s": math.nan}, r"at_s = nan"),
        ({"front": good.front.T}, r"front has the shape \(2, "),
        ({"front": np.array([[3.0, 4.0], [3.0, 80.6]])}, r"row 3, column 80.6, off the landscape"),
    ):
        with pytest.raises(FireModelError, match=message):
            check_burning(good._replace(**changed), LAND)
