"""The geometry of algorithm 1, and paths around obstacles."""

import math

import numpy as np
import pytest
import shapely
from shapely.geometry.base import BaseGeometry

from mission_service.guidance.burn.lines.ignition_lines import (
    alignment_m,
    drop_points,
    extent_across,
    line_across,
    upwind_of,
)
from mission_service.visibility_graph import VisibilityGraph

SOUTH = -math.pi / 2
BOX = shapely.box(0.0, 0.0, 100.0, 80.0)


def test_the_line_is_upwind_of_the_most_downwind_vertex_and_across_the_wind() -> None:
    line = line_across(BOX, SOUTH, 20.0)
    assert line.places_at(np.array([0.0, 10.0]))[:, 1] == pytest.approx([20.0, 20.0])
    tilted = line_across(BOX, -math.pi / 4, 20.0)  # towards the south-east: vertex (100, 0)
    places = tilted.places_at(np.array([-30.0, 30.0]))
    assert (places[1] - places[0]) @ tilted.downwind == pytest.approx(0.0)
    assert tilted.along_m == pytest.approx(100.0 / math.sqrt(2.0) - 20.0)


def test_left_is_to_the_left_when_facing_downwind() -> None:
    assert line_across(BOX, SOUTH, 20.0).left_unit == pytest.approx([1.0, 0.0])


def test_cut_off_until_nothing_is_left() -> None:
    area: BaseGeometry = BOX
    cuts = 0
    while not area.is_empty:
        left = upwind_of(area, line_across(area, SOUTH, 30.0))
        assert left.area < area.area
        area, cuts = left, cuts + 1
    assert cuts == 3


def test_of_an_area_in_parts_with_holes() -> None:
    parts = shapely.MultiPolygon([shapely.box(0, 0, 10, 5), shapely.box(40, 30, 90, 80)])
    holed = parts.difference(shapely.box(60, 40, 70, 60))
    line = line_across(holed, SOUTH, 20.0)
    assert extent_across(holed, line) is None  # between the two parts
    left = upwind_of(holed, line)
    assert left.area == pytest.approx(50 * 50 - 10 * 20)
    ends = extent_across(left, line_across(left, SOUTH, 20.0))
    assert ends == pytest.approx((40.0, 90.0))


def test_drops_are_aligned_with_the_earlier_one_closest_to_the_centre() -> None:
    line = line_across(BOX, SOUTH, 40.0)
    area = upwind_of(BOX, line_across(BOX, SOUTH, 20.0))
    earlier = np.array([[7.0, 20.0], [46.0, 20.0], [61.0, 20.0], [50.0, -3.0]])
    ends = extent_across(area, line)
    assert ends is not None
    # (50, -3) is nearer to the centre, but not at the remaining area.
    through = alignment_m(line, ends, earlier, area, 10.0)
    assert through == pytest.approx(46.0)
    points = drop_points(line, ends, through, 15.0)
    assert points[:, 0] == pytest.approx([1.0, 16.0, 31.0, 46.0, 61.0, 76.0, 91.0])
    assert points[:, 1] == pytest.approx(np.full(7, 40.0))
    assert alignment_m(line, ends, earlier[:0], area, 10.0) == pytest.approx(50.0)
    # If no place is at the area, as after an interrupted line, the nearest places are used.
    assert alignment_m(line, ends, earlier[3:], area, 10.0) == pytest.approx(50.0)
    farther = np.array([[7.0, 0.0], [50.0, -15.0]])
    assert alignment_m(line, ends, farther, area, 10.0) == pytest.approx(7.0)


def test_ways_bend_around_what_is_not_inside() -> None:
    ring = shapely.box(0, 0, 100, 100).difference(shapely.box(40, 20, 60, 80))
    ways = VisibilityGraph(ring)
    assert ways.shortest_path((5.0, 5.0), (95.0, 5.0)) == [(5.0, 5.0), (95.0, 5.0)]
    way = ways.shortest_path((5.0, 45.0), (95.0, 45.0))
    assert way is not None
    assert len(way) == 4
    assert ring.covers(shapely.LineString(way))
    length = shapely.LineString(way).length
    shortest = 2 * math.hypot(35.0, 25.0) + 20.0
    assert shortest <= length < shortest + 4.0
    apart = shapely.MultiPolygon([shapely.box(0, 0, 10, 10), shapely.box(20, 0, 30, 10)])
    assert VisibilityGraph(apart).shortest_path((5.0, 5.0), (25.0, 5.0)) is None
    bent = shapely.Polygon([(0, 0), (10, 0), (10, 90), (50, 90), (50, 100), (0, 100)])
    both = shapely.MultiPolygon([bent, shapely.box(200, 0, 210, 10)])
    assert VisibilityGraph(both).shortest_path((5.0, 5.0), (205.0, 5.0)) is None
    found = VisibilityGraph(both).shortest_path((5.0, 5.0), (45.0, 95.0))
    assert found is not None
    assert both.covers(shapely.LineString(found))
