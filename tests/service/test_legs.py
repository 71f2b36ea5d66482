"""Legs between fronts, round burned ground."""

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.optimize import brentq
from shapely.geometry.base import BaseGeometry

from mission_service.guidance.front.informative.legs import leg, unburned_ground
from mission_service.visibility_graph import VisibilityGraph

Floats = NDArray[np.float64]


def loop_of(ground: shapely.Polygon) -> Floats:
    """Return an outline as rows and columns."""
    outline: Floats = shapely.get_coordinates(ground.exterior)[:-1, ::-1]
    return outline


def rectangle(north: float, south: float, west: float, east: float) -> Floats:
    return loop_of(shapely.box(west, north, east, south))


def length_of(path: Floats) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def over(loops: list[Floats], path: Floats) -> float:
    """Return the length of a path over ground inside an odd number of loops."""
    ground: BaseGeometry = shapely.Polygon()
    for loop in loops:
        ground = ground.symmetric_difference(shapely.Polygon(loop[:, ::-1]))
    return float(shapely.LineString(path[:, ::-1]).intersection(ground).length)


WEST, EAST = np.array([50.0, 0.0]), np.array([50.0, 200.0])


def wall(detour: float) -> Floats:
    """Return a narrow fire across the line from ``WEST`` to ``EAST``, and the way round it."""
    north = 100.0 * math.sqrt((1.0 + detour) ** 2 - 1.0)
    return rectangle(50.0 - north, 400.0, 99.5, 100.5)


def test_a_detour_of_ten_percent_is_taken_and_one_of_fifty_is_not() -> None:
    short = leg(WEST, EAST, unburned_ground([wall(0.1)]))
    assert length_of(short) == pytest.approx(200.0 * 1.1, rel=0.01)
    assert over([wall(0.1)], short) == 0.0
    assert np.array_equal(short[[0, -1]], [WEST, EAST])
    assert np.array_equal(leg(WEST, EAST, unburned_ground([wall(0.5)])), [WEST, EAST])
    allowed = leg(WEST, EAST, unburned_ground([wall(0.5)]), max_detour=0.6)
    assert length_of(allowed) == pytest.approx(200.0 * 1.5, rel=0.01)


@pytest.mark.parametrize(("detour", "taken"), [(0.18, True), (0.6, False)])
def test_the_distance_from_burned_ground_is_no_part_of_the_detour(
    detour: float, taken: bool
) -> None:
    """Around a small fire, this distance makes the leg clearly longer."""
    bearings, radius = np.linspace(0.0, math.tau, 48, endpoint=False), 8.0
    fire = radius * np.column_stack([np.sin(bearings), np.cos(bearings)])
    # The way along the edge is longer than the chord by the detour.
    half = brentq(lambda angle: angle / math.sin(angle) - 1.0 - detour, 0.1, 3.0)
    start, goal = (
        1.001 * radius * np.array([math.cos(half), side * math.sin(half)]) for side in (-1, 1)
    )
    flown = leg(start, goal, unburned_ground([fire]))
    assert (len(flown) > 2) == taken
    if taken:
        assert over([0.9 * fire], flown) == 0.0
        assert length_of(flown) > 1.25 * math.dist(start, goal)


def test_the_shorter_way_round_is_taken() -> None:
    ground = unburned_ground([rectangle(20.0, 65.0, 90.0, 110.0)])
    south = leg(WEST, EAST, ground)
    assert south[1:-1, 0].min() > 64.0
    back = leg(EAST, WEST, ground)
    assert back[::-1] == pytest.approx(south)


def test_a_leg_between_two_fires_touches_neither() -> None:
    fires = [rectangle(0.0, 45.0, 80.0, 120.0), rectangle(55.0, 100.0, 80.0, 120.0)]
    assert np.array_equal(leg(WEST, EAST, unburned_ground(fires)), [WEST, EAST])
    aslant = leg(np.array([20.0, 0.0]), np.array([80.0, 200.0]), unburned_ground(fires))
    assert len(aslant) > 2
    assert over(fires, aslant) == 0.0


def test_a_leg_inside_an_island_and_one_to_it() -> None:
    fire, island = rectangle(0.0, 100.0, 0.0, 100.0), rectangle(20.0, 80.0, 20.0, 80.0)
    # From the north, a finger of burned ground leads into the island.
    finger = [[20.0, 49.5], [30.0, 49.5], [30.0, 50.5], [20.0, 50.5]]
    ground = unburned_ground([fire, np.concatenate([island, finger])])
    inside = leg(np.array([28.0, 25.0]), np.array([28.0, 75.0]), ground)
    assert len(inside) > 2
    assert inside[1:-1, 0].min() > 29.5
    # No detour leads out of the island.
    out = leg(np.array([50.0, 25.0]), np.array([50.0, 150.0]), ground)
    assert len(out) == 2


def test_a_leg_along_the_front_counts_as_over_unburned_ground() -> None:
    fire = rectangle(0.0, 40.0, 0.0, 100.0)
    start, goal = np.array([39.8, 10.0]), np.array([39.8, 90.0])
    assert np.array_equal(leg(start, goal, unburned_ground([fire])), [start, goal])


def test_a_leg_that_begins_over_burned_ground_leaves_it_by_the_shortest_way() -> None:
    fire = rectangle(0.0, 60.0, 20.0, 180.0)
    begin = np.array([50.0, 100.0])
    flown = leg(begin, np.array([40.0, 250.0]), unburned_ground([fire]))
    assert flown[1] == pytest.approx([60.0, 100.0], abs=0.6)
    assert over([rectangle(0.0, 59.7, 20.0, 179.7)], flown) < 11.0


def test_legs_without_fire_are_straight() -> None:
    assert np.array_equal(leg(WEST, EAST, unburned_ground([])), [WEST, EAST])


def test_the_shortest_legs_are_found_among_random_fires() -> None:
    rng = np.random.default_rng(5)
    bearings = np.linspace(0.0, math.tau, 24, endpoint=False)
    round_ones = np.column_stack([np.sin(bearings), np.cos(bearings)])
    loops = [
        centre + round_ones * (12.0 + 4.0 * np.cos(3.0 * bearings + row))[:, None]
        for row, centre in enumerate(np.argwhere(np.ones((2, 3))) * 45.0 + rng.normal(0, 3, (6, 2)))
    ]
    ground = unburned_ground(loops)
    clear = VisibilityGraph(ground.area.buffer(-1.0), clear=0.1)  # not limited to tangents
    detours = 0
    for _ in range(20):
        start, goal = rng.uniform(-20, 110, (2, 2))
        if not all(clear.area.covers(shapely.Point(place[::-1])) for place in (start, goal)):
            continue
        flown = leg(start, goal, ground, max_detour=5.0)
        known = clear.shortest_path((start[1], start[0]), (goal[1], goal[0]))
        assert known is not None
        assert length_of(flown) <= shapely.LineString(known).length * 1.005
        assert over(loops, flown) < 1.0 * len(flown)  # only at the edge of fires
        detours += len(flown) > 2
    assert detours >= 5
