"""Paths along closed fronts at a vehicle's turn radius."""

import math
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from firemodel.arrays import lengths_along
from mission_service.guidance.front.informative.loop_path import path_on_loop

Floats = NDArray[np.float64]

BODY = shapely.box(0, 0, 40, 30)
FINGER = BODY.union(shapely.box(19, -25, 20, 1))  # a cell wide, 25 cells long, to the north
NARROW_BAY = BODY.difference(shapely.box(18, -1, 22, 20))  # four cells wide
ISLAND = shapely.box(0, 0, 30, 30)
TOLERANCE = 1.03  # of the curvature, for the rounding of arcs to points


def front_of(ground: BaseGeometry) -> Floats:
    """Return an outline as rows and columns at distances of a cell, clockwise on the map."""
    (outline,) = shapely.get_rings(ground)
    ring = outline if shapely.is_ccw(outline) else shapely.reverse(outline)
    count = math.ceil(ring.length)
    places = shapely.line_interpolate_point(ring, np.arange(count) * ring.length / count)
    return shapely.get_coordinates(places)[:, ::-1]


def wiggly_front(seed: int, cells: int) -> Floats:
    """Return a random front with bays and tips, with points about one cell apart."""
    rng = np.random.default_rng(seed)
    bearing = np.linspace(0.0, math.tau, 4 * cells, endpoint=False)
    reach = np.ones(len(bearing))
    for wave in range(2, 12):
        phase = rng.uniform(0.0, math.tau)
        reach += rng.normal() * 0.35 / wave * np.cos(wave * bearing + phase)
    ring = np.column_stack([np.sin(bearing), -np.cos(bearing)]) * reach[:, None]
    return front_of(shapely.Polygon(ring * cells / shapely.LinearRing(ring).length))


def length_of(path: Floats) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def lap(front: Floats, radius: float, clockwise: bool = True, inner: bool = False) -> Floats:
    """Return a little more than one lap from the first point of a front."""
    long = path_on_loop(front, 0, clockwise, 4.0 * len(front), radius, inner)
    back = np.hypot(*(long - long[0]).T)
    along = lengths_along(long)
    again = int(np.argmax((back < 0.5) & (along > 2.0 * radius)))
    return long[: again + 8]


def curvature(path: Floats, radius: float) -> Floats:
    """Return the curvature (right turns positive) over lengths of half a turn radius."""
    steps = np.diff(path, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 0], steps[:, 1]))
    lengths = np.hypot(*steps.T)
    middle = np.cumsum(lengths) - lengths / 2.0
    begin = np.arange(middle[0], middle[-1] - radius / 2.0, 0.1)
    turned = np.interp(begin + radius / 2.0, middle, heading) - np.interp(begin, middle, heading)
    return turned / (radius / 2.0)


def points_of(path: Floats) -> Any:
    return shapely.points(path[:, ::-1])


def away_from(front: Floats, path: Floats) -> Floats:
    """Return the distance of each place of a path from a front."""
    found: Floats = shapely.distance(shapely.LinearRing(front[:, ::-1]), points_of(path))
    return found


def into(ground: BaseGeometry, path: Floats) -> float:
    """Return how far a path leads into a ground."""
    inside = path[shapely.covers(ground, points_of(path))]
    return float(away_from(front_of(ground), inside).max(initial=0.0))


def test_a_path_on_a_circle() -> None:
    front = front_of(shapely.Point(50, 40).buffer(30, quad_segs=64))
    path = path_on_loop(front, 20, True, 80.0, 5.0)
    assert away_from(front, path).max() < 0.3
    assert np.hypot(*(path[0] - front[20])) < 0.5
    assert length_of(path) == pytest.approx(80.0, rel=1e-3)
    # Clockwise as seen on the map: at the northernmost place to the east.
    north = path_on_loop(front, int(np.argmin(front[:, 0])), True, 5.0, 5.0)
    assert north[-1, 1] > north[0, 1] + 4.0
    back = path_on_loop(front, int(np.argmin(front[:, 0])), False, 5.0, 5.0)
    assert back[-1, 1] < back[0, 1] - 4.0


def test_a_path_wraps_round_the_start_and_laps_if_it_is_long() -> None:
    front = front_of(shapely.Point(50, 40).buffer(30, quad_segs=64))
    path = path_on_loop(front, len(front) - 5, True, 20.0, 5.0)
    assert np.hypot(*(path[-1] - front[15])) < 1.0
    round_cells = 60.0 * math.pi
    twice = path_on_loop(front, 0, True, 2.0 * round_cells + 10.0, 5.0)
    assert length_of(twice) == pytest.approx(2.0 * round_cells + 10.0, rel=2e-3)
    assert np.hypot(*(twice[-1] - front[10])) < 2.0


def test_corners_of_a_square_are_flown_round_outside() -> None:
    front = front_of(shapely.box(0, 0, 30, 30))
    path = lap(front, 5.0)
    assert into(shapely.box(0, 0, 30, 30), path) < 0.1
    assert np.abs(curvature(path, 5.0)).max() * 5.0 < TOLERANCE
    # A circle that touches the corner exceeds the sides by (1 - cos 45 deg) of its radius.
    assert away_from(front, path).max() == pytest.approx(5.0 * (1.0 - math.sqrt(0.5)), abs=0.1)
    for corner in ((0, 0), (0, 30), (30, 0), (30, 30)):
        assert np.hypot(*(path - corner).T).min() < 0.3
    assert (away_from(front, path) < 0.1).mean() > 0.35  # on the sides


@pytest.mark.parametrize("clockwise", [True, False])
def test_the_tip_of_a_narrow_finger_is_flown_round(clockwise: bool) -> None:
    front = front_of(FINGER)
    path = lap(front, 5.0, clockwise)
    assert np.abs(curvature(path, 5.0)).max() * 5.0 < TOLERANCE
    assert into(FINGER, path) < 0.15
    assert -25.6 < path[:, 0].min() < -24.9  # as far as the tip, and no farther
    # A turn circle touches the tip; arcs of the same radius join this circle with both sides,
    # which the path leaves sqrt(3) + 1 radii before the tip.
    beside = path[(path[:, 0] > -25.0 + 2.8 * 5.0) & (path[:, 0] < -6.0)]
    assert len(beside) > 10
    assert {round(col) for col in beside[:, 1]} == {19, 20}
    assert away_from(front, path).max() < 5.0


def test_a_narrow_bay_is_bridged_and_a_wide_one_is_followed() -> None:
    front = front_of(NARROW_BAY)
    path = lap(front, 5.0)
    assert np.abs(curvature(path, 5.0)).max() * 5.0 < TOLERANCE
    assert shapely.Polygon(path[:, ::-1]).buffer(0).contains(shapely.Point(20, 5))
    followed = lap(front, 1.5)
    assert not shapely.Polygon(followed[:, ::-1]).buffer(0).contains(shapely.Point(20, 5))
    assert away_from(front, followed).max() < 1.0


def test_two_narrow_corners_are_flown_round_by_one_circle() -> None:
    wide = BODY.union(shapely.box(17, -25, 22, 1))
    path = lap(front_of(wide), 5.0)
    assert into(wide, path) < 0.1
    # Both corners are on one circle of five cells, with its centre 4.33 cells behind their middle.
    assert path[:, 0].min() == pytest.approx(-25.0 + math.sqrt(5.0**2 - 2.5**2) - 5.0, abs=0.1)


def test_the_path_follows_its_own_side_of_a_very_narrow_finger() -> None:
    front = front_of(BODY.union(shapely.box(19.96, -25, 20.04, 1)))
    for place, towards_tip in (((-10.0, 19.96), True), ((-10.0, 20.04), False)):
        start = int(np.argmin(np.hypot(*(front - place).T)))
        for clockwise in (True, False):
            path = path_on_loop(front, start, clockwise, 3.0, 2.0)
            assert (path[-1, 0] < path[0, 0]) == (towards_tip == clockwise)


def test_a_front_that_crosses_itself() -> None:
    front = wiggly_front(4, cells=600)
    rough = front + np.random.default_rng(4).normal(0.0, 0.4, front.shape)
    assert not shapely.Polygon(rough).is_valid
    assert away_from(front, lap(rough, 5.0)).max() < 2.0


def test_a_small_fire_is_circled_at_the_turn_radius() -> None:
    front = front_of(shapely.box(10, 10, 13, 12))
    path = path_on_loop(front, 0, True, 40.0, 5.0)
    assert np.hypot(*(path - (11.0, 11.5)).T) == pytest.approx(5.0, abs=0.05)
    assert curvature(path, 5.0).mean() == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize("clockwise", [True, False])
def test_a_path_inside_an_island(clockwise: bool) -> None:
    front = front_of(ISLAND)
    path = lap(front, 5.0, clockwise, inner=True)
    assert shapely.covers(ISLAND.buffer(0.1), points_of(path)).all()
    assert np.abs(curvature(path, 5.0)).max() * 5.0 < TOLERANCE
    turned = np.sign(np.median(curvature(path, 5.0)[np.abs(curvature(path, 5.0)) > 0.15]))
    assert turned == (1.0 if clockwise else -1.0)
    # Only the corners are farther than a tenth of a cell away.
    sides = (np.abs(path - 15.0).max(axis=1) > 14.8) & (np.abs(path - 15.0).min(axis=1) < 10.0)
    assert sides.mean() > 0.6


def test_a_burned_finger_in_an_island_is_flown_round_on_unburned_ground() -> None:
    island = shapely.box(0, 0, 50, 40).difference(shapely.box(20, -1, 22, 20))
    path = lap(front_of(island), 5.0, inner=True)
    assert shapely.covers(island.buffer(0.15), points_of(path)).all()
    assert np.abs(curvature(path, 5.0)).max() * 5.0 < TOLERANCE
    assert np.hypot(*(path - (20.0, 21.0)).T).min() < 0.3


def test_each_lobe_of_an_island_has_its_own_path() -> None:
    neck = shapely.box(19, 8, 31, 12)
    island = shapely.union_all([shapely.box(0, 0, 20, 20), neck, shapely.box(30, 0, 50, 20)])
    front = front_of(island)
    for col in (0.0, 50.0):
        start = int(np.argmin(np.hypot(*(front - (10.0, col)).T)))
        path = path_on_loop(front, start, True, 60.0, 5.0, inner=True)
        assert (np.abs(path[:, 1] - col) < 20.5).all()


def test_an_island_too_small_for_a_turn_is_circled_around_its_centre() -> None:
    path = path_on_loop(front_of(shapely.box(0, 0, 8, 8)), 0, False, 40.0, 5.0, inner=True)
    assert np.hypot(*(path - 4.0).T) == pytest.approx(5.0, abs=0.05)
    assert curvature(path, 5.0).mean() == pytest.approx(-0.2, rel=0.02)


def sharp_places(ground: BaseGeometry, front: Floats, radius: float) -> Floats:
    """Return the places of a front at which a turn circle cannot touch it on both sides."""
    bridged = ground.buffer(radius, quad_segs=32).buffer(-radius, quad_segs=32)
    cut_off = ground.buffer(-radius, quad_segs=32).buffer(radius, quad_segs=32)
    outside = shapely.distance(bridged.boundary, points_of(front))
    inside = shapely.distance(cut_off.boundary, points_of(front))
    sharp: Floats = front[np.maximum(outside, inside) > 0.1]
    return sharp


@pytest.mark.parametrize("radius_m", [60.0, 150.0])
def test_the_path_keeps_within_30_m_of_random_fronts(radius_m: float) -> None:
    """Away from places that a turn circle cannot touch, by no more than the arcs around a tip."""
    radius = radius_m / 30.0
    followed = []
    for seed in range(10):
        front = wiggly_front(seed, cells=400)
        ground = shapely.Polygon(front[:, ::-1])
        path = lap(front, radius, clockwise=bool(seed % 2))
        assert np.abs(curvature(path, radius)).max() * radius < TOLERANCE, seed
        assert into(ground, path) < 0.3, seed
        sharp = sharp_places(ground, front, radius)
        reach = (1.0 + math.sqrt(3.0)) * radius
        for places, distance in (
            (path, away_from(front, path)),
            (front, shapely.distance(shapely.LineString(path[:, ::-1]), points_of(front))),
        ):
            far = places[distance > 1.0]
            if len(far):
                to_sharp = shapely.distance(shapely.MultiPoint(sharp[:, ::-1]), points_of(far))
                assert to_sharp.max() < reach, seed
            followed.append(1.0 - len(far) / len(places))
    assert min(followed) > 0.9
