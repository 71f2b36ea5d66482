"""Shapes that operators draw become observations."""

import numpy as np
import pytest
import shapely

from firemodel.assimilation.map_drawing import observations_of
from firemodel.ellipses.point_observations import BURNED, BURNING, UNBURNED
from firemodel.errors import FireModelError

CORNERS = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [0.0, 60.0]])


def test_a_point_is_one_mark() -> None:
    assert observations_of("point", CORNERS[1], 30.0, BURNED, 10.0).tolist() == [
        [100.0, 0.0, 30.0, -1.0]
    ]


def test_a_line_is_marked_at_its_corners_and_between() -> None:
    observations = observations_of("line", CORNERS[:3], 30.0, BURNING, 9.0)
    assert np.hypot(*np.diff(observations[:, :2], axis=0).T).max() <= 9.0
    assert len(observations) == 20  # divided into 12 and 7 parts
    assert {(0.0, 0.0), (100.0, 0.0), (100.0, 60.0)} <= {
        (x, y) for x, y, *_ in observations.tolist()
    }
    assert (observations[:, 2:] == (30.0, BURNING)).all()


def test_a_line_that_is_one_place_is_one_mark() -> None:
    for count in (2, 3):
        observations = observations_of("line", CORNERS[[1] * count], 30.0, BURNED, 10.0)
        assert observations.tolist() == [[100.0, 0.0, 30.0, -1.0]]


def test_a_polygon_that_burns_is_its_outline_another_is_all_of_it() -> None:
    outline = shapely.LinearRing(CORNERS)
    burning = observations_of("polygon", CORNERS, 30.0, BURNING, 10.0)
    assert len(burning) == len(np.unique(burning, axis=0)) == 32
    assert shapely.distance(outline, shapely.points(burning[:, :2])).max() < 1e-9
    for state in (BURNED, UNBURNED):
        whole = observations_of("polygon", CORNERS, 30.0, state, 10.0)
        inside = shapely.distance(outline, shapely.points(whole[:, :2])) > 1e-9
        assert np.array_equal(whole[~inside, :2], burning[:, :2])
        assert np.count_nonzero(inside) >= 4 * 8
        assert shapely.contains_xy(shapely.Polygon(CORNERS), *whole[inside, :2].T).all()
        assert (whole[:, 3] == state).all()


def test_what_cannot_be_is_refused() -> None:
    bow = CORNERS[[0, 2, 1, 3]]
    for shape, points, at_s, state, spacing_m, message in (
        ("line", CORNERS[:1], 0.0, 0, 5.0, "line of 1 points"),
        ("polygon", CORNERS[:2], 0.0, 0, 5.0, "polygon of 2 points"),
        ("circle", CORNERS, 0.0, 0, 5.0, "circle of 4 points"),
        ("polygon", bow, 0.0, 0, 5.0, "crosses itself"),
        ("point", CORNERS[:1] * np.nan, 0.0, 0, 5.0, "finite"),
        ("point", CORNERS[:1], 0.0, 2, 5.0, "state 2"),
        ("line", CORNERS, 0.0, 0, 0.0, "spacing_m = 0.0"),
    ):
        with pytest.raises(FireModelError, match=message):
            observations_of(shape, points, at_s, state, spacing_m)  # type: ignore[arg-type]
