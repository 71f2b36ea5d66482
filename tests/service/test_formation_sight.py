"""The cells in a camera's view, compared with a plain test for points in a turned rectangle."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mission_service.experiments.virtual_agents.camera_footprint import (
    cells_in_view,
    changed_cells,
    mark_seen,
)
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.settings import Settings

GRID = MapGrid(30, 45, 10.0, -100.0, 700.0)
X, Y = GRID.xy_of(*np.indices((30, 45)))

VIEWS = st.tuples(
    st.floats(-300.0, 600.0),
    st.floats(200.0, 900.0),
    st.one_of(st.floats(-7.0, 7.0), st.sampled_from([k * math.pi / 4 for k in range(-4, 9)])),
    st.floats(0.0, 160.0),
    st.floats(0.0, 160.0),
)


def in_view(view: tuple[float, float, float, float, float], slack_m: float = 0.0) -> np.ndarray:
    """Return the cells (y, x) with centres in the rectangle, extended by ``slack_m``."""
    x_m, y_m, course_rad, half_across_m, half_along_m = view
    along = (X - x_m) * math.cos(course_rad) + (Y - y_m) * math.sin(course_rad)
    across = -(X - x_m) * math.sin(course_rad) + (Y - y_m) * math.cos(course_rad)
    found: np.ndarray = (np.abs(along) <= half_along_m + slack_m) & (
        np.abs(across) <= half_across_m + slack_m
    )
    return found


@given(VIEWS)
def test_cells_in_view_are_those_with_centres_in_the_rectangle(
    view: tuple[float, float, float, float, float],
) -> None:
    found = np.zeros((30, 45), dtype=np.bool_)
    cells = cells_in_view(GRID, view)
    found.ravel()[cells] = True
    assert np.array_equal(cells, np.flatnonzero(found))  # ascending, without duplicates
    assert (found <= in_view(view, 1e-6)).all()
    assert (found >= in_view(view, -1e-6)).all()


def test_centres_on_an_edge_are_in_view() -> None:
    x_m, y_m = GRID.xy_of(10.0, 20.0)
    for quarter in range(8):
        across_m, along_m = (20.0, 50.0) if quarter % 2 else (50.0, 20.0)
        cells = cells_in_view(GRID, (x_m, y_m, quarter * math.pi / 2, across_m, along_m))
        rows, cols = np.divmod(cells, 45)
        assert (rows.min(), rows.max(), cols.min(), cols.max()) == (5, 15, 18, 22)
        assert len(cells) == 11 * 5


@given(VIEWS)
def test_an_observation_gives_the_differences_from_the_map(
    view: tuple[float, float, float, float, float],
) -> None:
    arrival_s = np.hypot(X - 100.0, Y - 550.0)
    arrival_s[:, 40:] = np.inf
    known_burning: np.ndarray = np.equal((X // 10 + Y // 20) % 3, 0)
    burning, unburned = changed_cells(GRID, view, arrival_s, 120.0, known_burning)
    seen = np.zeros(known_burning.shape, dtype=np.bool_)
    seen.ravel()[cells_in_view(GRID, view)] = True
    assert np.array_equal(burning, np.flatnonzero(seen & ~known_burning & (arrival_s <= 120.0)))
    assert np.array_equal(unburned, np.flatnonzero(seen & known_burning & (arrival_s > 120.0)))


def test_marking_keeps_when_each_cell_was_seen_last() -> None:
    seen_s = np.full((30, 45), -np.inf)
    first, second = (50.0, 550.0, 0.5, 60.0, 40.0), (80.0, 550.0, 1.5, 60.0, 40.0)
    mark_seen(GRID, first, seen_s, 10.0)
    mark_seen(GRID, second, seen_s, 20.0)
    expected = np.where(in_view(first), 10.0, -np.inf)
    expected[in_view(second)] = 20.0
    assert np.array_equal(seen_s, expected)
    assert {-np.inf, 10.0, 20.0} == set(seen_s.ravel())


def test_a_view_beyond_the_map_sees_nothing() -> None:
    for x_m, y_m in ((1e5, 500.0), (-1e5, 500.0), (0.0, 1e5), (0.0, -1e9)):
        assert len(cells_in_view(GRID, (x_m, y_m, 0.7, 150.0, 130.0))) == 0


def test_the_papers_camera_sees_about_800_cells_of_10_m() -> None:
    camera = Settings().camera
    wide = MapGrid(200, 200, 10.0, 0.0, 2000.0)
    width_m, length_m = 2.0 * camera.half_width_m(300.0), 2.0 * camera.half_length_m(300.0)
    cells = cells_in_view(wide, (1000.0, 1000.0, 0.4, width_m / 2.0, length_m / 2.0))
    assert abs(len(cells) - width_m * length_m / 100) < 30
