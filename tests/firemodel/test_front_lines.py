"""The fronts of the estimated fire, with speed and time since observation."""

import math

import numpy as np
import pytest

from firemodel.assimilation.front_lines import Behind, FrontLine, behind, front_lines, last_seen_s
from firemodel.assimilation.learned_inputs import LearnedInputs
from firemodel.spread.anyangle import AnyAngleFire
from tests.firemodel.fires_on_grids import CELL_M, even_fire

CELLS = 80
MIDDLE = 40


def fronts(fire, seen_s=None) -> list[FrontLine]:  # type: ignore[no-untyped-def]
    """Return the fronts of a fire, of which nothing was seen by default."""
    seen_s = np.full((CELLS, CELLS), -np.inf) if seen_s is None else seen_s
    return front_lines(fire, seen_s, LearnedInputs(fire.landscape, 0.0))


def turned_deg(front: FrontLine) -> float:
    """Return the angle by which the front turns around the middle, positive clockwise."""
    bearing = np.arctan2(front.col - MIDDLE, MIDDLE - front.row)
    return float(np.degrees(np.diff(np.unwrap(np.append(bearing, bearing[0]))).sum()))


def fire_around_a_lake(burned_row: int) -> AnyAngleFire:
    """Return a fire that burns around a lake until the middle of a row north of the lake burns."""
    rows, cols = np.mgrid[:CELLS, :CELLS]
    lake = np.hypot(rows - 30, cols - MIDDLE) <= 3.0
    fire = even_fire(CELLS, (MIDDLE, MIDDLE), unburnable=lake, until_s=0.0)
    while not fire.burned()[burned_row, MIDDLE]:
        fire.advance(fire.time_s + 600.0)
    return fire


def test_an_even_fire_has_one_clockwise_front_that_moves_outwards() -> None:
    (front,) = fronts(even_fire(CELLS, (MIDDLE, MIDDLE)))
    assert not front.inner
    assert turned_deg(front) == pytest.approx(360.0)
    outward = (MIDDLE - front.row) * front.ahead.north + (front.col - MIDDLE) * front.ahead.east
    assert (outward > 0.0).all()
    assert front.speed_m_s == pytest.approx(np.full(front.row.size, front.speed_m_s[0]), rel=1e-6)
    assert front.speed_m_s[0] > 0.0
    radius = np.hypot(front.row - MIDDLE, front.col - MIDDLE)
    assert radius == pytest.approx(np.full(radius.size, radius.mean()), abs=1.0)


def test_an_island_has_an_inner_front_that_moves_inwards() -> None:
    fire = fire_around_a_lake(burned_row=20)
    outer, inner = fronts(fire)
    assert (outer.inner, inner.inner) == (False, True)
    inward = (inner.row - 30) * inner.ahead.north + (MIDDLE - inner.col) * inner.ahead.east
    assert np.median(inward) > 0.0
    assert inner.speed_m_s == pytest.approx(np.zeros(inner.row.size), abs=1e-6)


def test_two_fires_have_two_fronts_the_longest_first() -> None:
    fire = even_fire(CELLS, (MIDDLE, 20), until_s=7200.0)
    fire.light(MIDDLE, 60, 7200.0)
    while not fire.burned()[MIDDLE - 3, 60]:
        fire.advance(fire.time_s + 600.0)
    first, second = fronts(fire)
    assert first.col.mean() < 30.0 < second.col.mean()


def test_the_time_since_observation_is_that_of_the_earlier_place_of_the_front() -> None:
    fire = even_fire(CELLS, (MIDDLE, MIDDLE), until_s=0.0)
    seen_at_s = fire.time_s - 1800.0
    arrival_s = fire.arrival_time_s
    then = np.abs(arrival_s - seen_at_s) * 13 * CELL_M / fire.time_s < 1.5 * CELL_M
    seen_s = np.where(then, seen_at_s, -np.inf)  # the ring of the front half an hour ago
    seen_s[:, :MIDDLE] = -np.inf  # only its eastern half
    (front,) = fronts(fire, seen_s)
    east, west = front.col > MIDDLE + 3, front.col < MIDDLE - 3
    assert front.unseen_s[east] == pytest.approx(np.full(east.sum(), 1800.0))
    assert (front.unseen_s[west] > 0.9 * fire.time_s).all()  # since the beginning


def test_a_sighting_behind_the_front_long_after_it_passed_does_not_show_the_front() -> None:
    fire = even_fire(CELLS, (MIDDLE, MIDDLE), until_s=0.0)
    seen_s = np.full((CELLS, CELLS), -np.inf)
    seen_s[MIDDLE - 3 : MIDDLE + 4, MIDDLE - 3 : MIDDLE + 4] = fire.time_s - 60.0
    (front,) = fronts(fire, seen_s)
    assert (front.unseen_s > 0.9 * fire.time_s).all()


def test_a_front_that_stands_still_is_seen_where_it_is() -> None:
    (front,) = fronts(even_fire(CELLS, (MIDDLE, MIDDLE), until_s=0.0))
    arrival_s = np.full((CELLS, CELLS), 100.0)
    seen_s = np.full((CELLS, CELLS), 5000.0)
    found = last_seen_s(behind(arrival_s, seen_s, front.row, front.col, front.ahead))
    assert (found == 5000.0).all()
    assert math.isfinite(found[0])


def test_an_image_of_the_outer_front_does_not_show_an_island_that_stands_still() -> None:
    fire = fire_around_a_lake(burned_row=18)
    seen_s = np.full((CELLS, CELLS), -np.inf)
    outer, inner = fronts(fire)
    for row, col in zip(outer.row, outer.col, strict=True):
        seen_s[round(row) - 2 : round(row) + 3, round(col) - 2 : round(col) + 3] = fire.time_s
    outer, inner = fronts(fire, seen_s)
    assert (outer.unseen_s == 0.0).all()
    assert (inner.unseen_s > 0.9 * fire.time_s).all()


def test_two_parts_between_observed_parts_were_observed_but_not_three() -> None:
    fire = even_fire(CELLS, (MIDDLE, MIDDLE), until_s=0.0)
    (front,) = fronts(fire)
    count = front.row.size
    ground = Behind(np.full((61, count), 0.0), np.full((61, count), -np.inf))
    seen = np.isin(np.arange(count), [3, 6, 10])
    ground.seen_s[:, seen] = 60.0
    assert np.flatnonzero(last_seen_s(ground) == 60.0).tolist() == [3, 4, 5, 6, 10]


def test_a_front_beside_an_unburned_cell_is_seen() -> None:
    """Behind the front there may be islands of one cell, which have no front of their own."""
    fire = even_fire(CELLS, (MIDDLE, MIDDLE), until_s=0.0)
    (front,) = fronts(fire)
    now_s = fire.time_s
    arrival_s = np.where(fire.arrival_time_s <= now_s, fire.arrival_time_s, np.inf)
    seen_s = np.full((CELLS, CELLS), now_s - 1.0)
    for back in (0.0, 1.0):  # behind the first point
        row = round(float(front.row[0] + back * front.ahead.north[0]))
        col = round(float(front.col[0] - back * front.ahead.east[0]))
        arrival_s[row, col] = np.inf
    found = last_seen_s(behind(arrival_s, seen_s, front.row, front.col, front.ahead))
    assert found[0] == now_s - 1.0


def test_a_front_is_not_seen_by_an_earlier_sighting_of_ground_ahead_of_it() -> None:
    fire = even_fire(CELLS, (MIDDLE, MIDDLE), until_s=0.0)
    seen_s = np.where(fire.burned(), -np.inf, 0.5 * fire.time_s)
    (front,) = fronts(fire, seen_s)
    assert (front.unseen_s > 0.9 * fire.time_s).all()
