"""The perimeter as a loop of cells, and the front between the centres of cells."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy import ndimage

from firemodel.spread.front import front_polygons, largest_region, perimeter
from tests.firemodel.grids import CELL_M, landscape

Mask = NDArray[np.bool_]


def drawn(drawing: str) -> Mask:
    """Return a mask from a drawing; # means burned."""
    return np.array([[sign == "#" for sign in line] for line in drawing.split()])


def signed_area(loop: NDArray[np.int32]) -> float:
    """Return twice the area, positive if anticlockwise on a north-up map (x = column, y = -row)."""
    x, y = loop[:, 1], -loop[:, 0]
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def outer_boundary(burned: Mask) -> set[tuple[int, int]]:
    """Return the cells of the largest region with a side on ground connected to the outside."""
    region = np.pad(largest_region(burned), 1)
    outside = ndimage.label(~region)[0] == 1  # the corner of the padding is labelled first
    touches = region & ndimage.binary_dilation(outside)
    return {(int(row) - 1, int(col) - 1) for row, col in np.argwhere(touches)}


def test_a_square_is_walked_anticlockwise() -> None:
    loop = perimeter(np.ones((3, 3), dtype=bool))
    assert loop.dtype == np.int32
    assert len(loop) == 8
    assert signed_area(loop) == 8.0


def test_a_tail_is_walked_both_ways() -> None:
    loop = perimeter(drawn("##... ##### ##..."))
    cells = [tuple(cell) for cell in loop.tolist()]
    assert cells.count((1, 3)) == 2
    assert cells.count((1, 4)) == 1


@pytest.mark.parametrize(("drawing", "length"), [("#", 1), ("##", 2), ("###", 4), ("#. .#", 2)])
def test_the_smallest_fires(drawing: str, length: int) -> None:
    assert len(perimeter(drawn(drawing))) == length


def test_nothing_burned_has_no_perimeter() -> None:
    assert perimeter(np.zeros((3, 4), dtype=bool)).shape == (0, 2)


def test_holes_and_smaller_fires_are_left_out() -> None:
    burned = drawn("#####.. #...#.. #...#.# #####..")
    assert {tuple(cell) for cell in perimeter(burned).tolist()} == outer_boundary(burned)
    assert len(perimeter(burned)) == 14


@given(arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_every_perimeter_is_a_closed_loop_of_exactly_the_outer_boundary(burned: Mask) -> None:
    loop = perimeter(burned)
    if not burned.any():
        assert len(loop) == 0
        return
    assert {tuple(cell) for cell in loop.tolist()} == outer_boundary(burned)
    if len(loop) > 1:
        steps = np.abs(loop - np.roll(loop, -1, axis=0)).max(axis=1)
        assert (steps == 1).all()
    assert signed_area(loop) >= 0.0


def test_a_front_lies_where_the_fire_was_at_that_time() -> None:
    rows, cols = np.indices((41, 41))
    arrival_s = 10.0 * np.hypot(rows - 20.0, cols - 20.0)  # one cell in ten seconds
    land = landscape()
    area = front_polygons(arrival_s, 123.0, land)
    assert area.area == pytest.approx(np.pi * (12.3 * CELL_M) ** 2, rel=0.01)
    assert np.ravel(area.centroid.coords) == pytest.approx(land.xy_of(20, 20))


def test_a_front_ends_at_what_does_not_burn_and_keeps_its_holes() -> None:
    never = np.inf
    arrival_s = np.array(
        [
            [5.0, 3.0, 5.0, never, 90.0],
            [3.0, never, 3.0, never, 90.0],
            [5.0, 3.0, 0.0, never, 90.0],
        ]
    )
    land = landscape(shape=(3, 5))
    area = front_polygons(arrival_s, 5.0, land)
    (polygon,) = area.geoms
    assert len(polygon.interiors) == 1
    left, bottom, right, top = polygon.bounds
    x_m, y_m = land.xy_of(np.array([0, 2]), np.array([0, 2]))
    assert left >= x_m[0] - CELL_M / 2
    assert right <= x_m[1] + CELL_M
    assert (bottom, top) == pytest.approx(
        (y_m[1] - CELL_M / 2, y_m[0] + CELL_M / 2), abs=CELL_M / 2
    )
    assert not front_polygons(arrival_s, -1.0, land).geoms


def test_fires_apart_have_fronts_apart() -> None:
    arrival_s = np.full((5, 9), np.inf)
    arrival_s[2, 1] = arrival_s[2, 7] = 0.0
    assert len(front_polygons(arrival_s, 10.0, landscape(shape=(5, 9))).geoms) == 2
