"""Geometries are converted to the right cells, and no fire crosses a line of cells."""

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry import GeometryCollection, LineString, MultiPoint, Point, Polygon

from firemodel.errors import FireModelError
from firemodel.landscape.rasterise import cells_of, with_barriers
from firemodel.spread.devs8 import Devs8Fire
from tests.firemodel.grids import CELL_M, NORTH_M, WEST_M, landscape, steady

LAND = landscape(shape=(40, 50))
SIDES, CORNERS = (ndimage.generate_binary_structure(2, joined) for joined in (1, 2))


def at(*col_row: tuple[float, float]) -> list[tuple[float, float]]:
    """Return projected coordinates of positions counted in cells from the grid's corner."""
    return [(WEST_M + CELL_M * col, NORTH_M - CELL_M * row) for col, row in col_row]


def grid(cells: NDArray[np.int32]) -> NDArray[np.bool_]:
    found = np.zeros(LAND.shape, dtype=np.bool_)
    found[tuple(cells.T)] = True
    return found


def test_points_touch_the_cell_they_lie_in() -> None:
    points = MultiPoint(at((0.1, 0.1), (49.9, 39.9), (3.0, 2.0), (-0.1, 5.0), (5.0, 40.0)))
    assert cells_of([points], LAND).tolist() == [[0, 0], [2, 3], [39, 49]]


def test_a_line_touches_each_cell_it_crosses() -> None:
    steep = LineString(at((0.5, 0.5), (1.5, 2.9)))
    assert cells_of([steep], LAND).tolist() == [[0, 0], [1, 0], [1, 1], [2, 1]]
    level = LineString(at((-3.0, 7.2), (2.5, 7.2)))
    assert cells_of([level], LAND).tolist() == [[7, 0], [7, 1], [7, 2]]
    assert cells_of([LineString(at((-9, -9), (-2, 45)))], LAND).size == 0


def crossings() -> list[LineString]:
    """Yield lines across the grid: random ones, ones along edges and through corners, zigzags."""
    rng = np.random.default_rng(3)
    ways = [((-1, 0), (51, 40)), ((0, 0), (40, 40)), ((-1, 20), (51, 20)), ((-1, 20.5), (51, 20.5))]
    lines = [LineString(at(*way)) for way in ways]
    for _ in range(100):
        cols = np.sort(np.concatenate([[-1.0, 51.0], rng.uniform(0, 50, 6)]))
        rows = rng.uniform(1, 39, 8)
        if rng.random() < 0.5:
            cols, rows = np.round(cols), np.round(rows)  # vertices at corners of cells
        lines.append(LineString(at(*zip(cols, rows, strict=True))))
    return lines


def test_lines_are_chains_joined_by_sides_and_hold_all_that_is_crossed() -> None:
    """Other cells are included only to join two cells that meet at a corner."""
    rows, cols = (index.ravel() for index in np.indices(LAND.shape))
    x_m, y_m = LAND.xy_of(rows, cols)
    insides, outsides = (
        shapely.box(x_m - half, y_m - half, x_m + half, y_m + half)
        for half in (CELL_M / 2 - 1e-3, CELL_M / 2 + 1e-3)
    )
    for line in crossings()[:40]:
        touched = grid(cells_of([line], LAND))
        assert ndimage.label(touched, SIDES)[1] == 1
        shapely.prepare(line)
        assert touched[shapely.intersects(line, insides).reshape(LAND.shape)].all()
        near = shapely.intersects(line, outsides).reshape(LAND.shape)
        assert ndimage.binary_dilation(near, SIDES)[touched].all()
        assert np.count_nonzero(touched & ~near) <= len(line.coords) + 40


def test_no_fire_slips_through_a_line() -> None:
    """The parts north and south of a line are not connected, even if the line is given in parts."""
    for line in crossings()[2:]:
        pieces = [
            LineString(line.coords[start : start + 2]) for start in range(len(line.coords) - 1)
        ]
        for shapes in ([line], pieces):
            free = with_barriers(LAND, shapes).fuel_model == 1
            labels, _ = ndimage.label(free, CORNERS)
            assert not set(labels[0][free[0]]) & set(labels[-1][free[-1]])


def test_a_fire_inside_a_ring_stays_there() -> None:
    ring = shapely.Point(at((25.3, 20.1))[0]).buffer(8.4 * CELL_M).exterior
    land = with_barriers(LAND, [ring])
    assert set(np.unique(land.fuel_model)) == {1, 99}
    np.testing.assert_array_equal(LAND.fuel_model, 1)
    fire = Devs8Fire(land, steady(5.0, 240.0), [(20, 25, 0.0)])
    fire.advance(86400.0)
    rows, cols = np.nonzero(fire.burned())
    assert rows.size > 150
    assert np.hypot(rows + 0.5 - 20.1, cols + 0.5 - 25.3).max() < 8.4


def test_a_line_without_length_touches_its_cell() -> None:
    line = LineString([at((3.2, 5.7))[0]] * 2)
    assert cells_of([line], LAND).tolist() == cells_of([Point(line.coords[0])], LAND).tolist() != []


def test_polygons_touch_the_cells_whose_centre_is_inside() -> None:
    rng = np.random.default_rng(5)
    rows, cols = np.indices(LAND.shape)
    x_m, y_m = LAND.xy_of(rows, cols)
    for _ in range(20):
        angles = np.sort(rng.uniform(0, 2 * np.pi, 12))
        far = rng.uniform(3, 30, 12)
        star = Polygon(at(*zip(25 + far * np.cos(angles), 20 + far * np.sin(angles), strict=True)))
        star = star.difference(Point(at((25, 20))[0]).buffer(60.0)).buffer(0)
        np.testing.assert_array_equal(
            grid(cells_of([star], LAND)), shapely.contains_xy(star, x_m, y_m)
        )


def test_a_polygon_without_a_centre_still_touches_a_cell() -> None:
    tiny = Polygon(at((3.1, 5.1), (3.3, 5.1), (3.2, 5.3)))
    assert cells_of([tiny], LAND).tolist() == [[5, 3]]
    assert cells_of([GeometryCollection([tiny, Point(at((7.5, 1.5))[0])])], LAND).tolist() == [
        [1, 7],
        [5, 3],
    ]
    off = Polygon(at((-3, 5), (-2, 5), (-2, 8)))
    assert cells_of([off], LAND).size == 0


def test_a_river_narrower_than_a_cell_holds() -> None:
    river = LineString(at((-1, 10.2), (20, 25.7), (51, 13.1))).buffer(4.0)
    free = with_barriers(LAND, [river], code=98).fuel_model == 1
    assert ndimage.label(free, CORNERS)[1] == 2


def test_a_barrier_that_burns_is_refused() -> None:
    with pytest.raises(FireModelError, match="fuel code 4 burns; use one of 91"):
        with_barriers(LAND, [], code=4)
