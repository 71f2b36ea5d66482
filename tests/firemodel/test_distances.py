"""Distances, widened masks and joined fronts equal SciPy's, which these modules do not import."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt, maximum_filter
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from firemodel.arrays import widened
from firemodel.assimilation.distance_kernels import distance_cells
from firemodel.spread.labels import join_fronts


@pytest.mark.parametrize("share", [0.01, 0.3, 0.97, 1.0])
@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (30, 1), (40, 25), (25, 40)])
def test_distances_equal_those_of_scipy(shape: tuple[int, int], share: float) -> None:
    cells = np.random.default_rng(1).random(shape) < share
    cells[-1, 0] = True
    found = distance_cells(cells)
    np.testing.assert_array_equal(found, distance_transform_edt(~cells))
    assert found.dtype == np.float64


def test_distance_to_an_empty_mask_is_infinite() -> None:
    assert np.isinf(distance_cells(np.zeros((3, 4), dtype=bool))).all()


@pytest.mark.parametrize("reach", [1, 2, 7])
@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (40, 25), (0, 5)])
def test_widened_equals_a_maximum_filter(shape: tuple[int, int], reach: int) -> None:
    cells = np.random.default_rng(2).random(shape) < 0.05
    found = widened(cells, reach)
    assert found.dtype == np.bool_
    if cells.size:
        expected = maximum_filter(cells, 2 * reach + 1, mode="constant")
        np.testing.assert_array_equal(found, expected)
    else:
        assert found.shape == shape


def test_a_mask_widened_by_nothing_is_unchanged() -> None:
    cells = np.eye(4, dtype=bool)
    np.testing.assert_array_equal(widened(cells, 0), cells)


@pytest.mark.parametrize("count", [0, 1, 2, 300])
def test_joined_fronts_are_connected_components(count: int) -> None:
    rng = np.random.default_rng(3)
    order, beside = rng.permutation(count), np.full((count, 2), -1, dtype=np.int32)
    linked = np.flatnonzero(rng.random(max(count - 1, 0)) < 0.9)
    beside[order[linked], 1] = order[linked + 1]
    front_of = np.arange(count, dtype=np.int32)
    join_fronts(beside, front_of)
    links = coo_array(
        (np.ones(linked.size), (order[linked], order[linked + 1])), shape=(count, count)
    )
    number_of = connected_components(links, directed=False)[1] if count else np.empty(0, int)
    for number in np.unique(number_of):
        of_front = np.flatnonzero(number_of == number)
        assert (front_of[of_front] == of_front.min()).all()
