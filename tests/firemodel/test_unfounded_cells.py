"""Removing estimated fire that can have spread only through ground seen unburned."""

import numpy as np

from firemodel.assimilation.unfounded_cells import unfounded_cells
from tests.firemodel.fires_on_grids import even_fire

CELLS = 40


def seen_unburned(row_from: int) -> np.ndarray:
    """Return a strip of three rows across the grid."""
    removed = np.zeros((CELLS, CELLS), bool)
    removed[row_from : row_from + 3] = True
    return removed


def found(
    removed: np.ndarray, confirmed: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the unfounded cells of a fire from row 30, and its burned cells."""
    fire = even_fire(CELLS, (30, 20))
    burned = fire.burned()
    none = np.zeros_like(burned)
    vectors = fire.arrival_vectors() / fire.landscape.cell_size_m
    confirmed = none if confirmed is None else confirmed
    return unfounded_cells(fire.burned_arrival_s(), removed & burned, confirmed, vectors), burned


def test_fire_behind_a_strip_seen_unburned_is_removed() -> None:
    removed = seen_unburned(22)
    cells, burned = found(removed)
    behind = np.zeros_like(burned)
    behind[:22] = burned[:22]
    assert behind.any()
    np.testing.assert_array_equal(cells, behind)


def test_fire_that_was_seen_burned_stays_with_what_spread_from_it() -> None:
    confirmed = np.zeros((CELLS, CELLS), bool)
    confirmed[18:21, 18:23] = True
    cells, burned = found(seen_unburned(22), confirmed)
    assert not cells[confirmed].any()
    assert cells.any()
    assert (cells & burned).sum() < burned[:22].sum()


def test_a_few_wrong_pixels_remove_nothing_else() -> None:
    removed = np.zeros((CELLS, CELLS), bool)
    removed[24, 20] = removed[25, 20] = True
    assert not found(removed)[0].any()


def test_the_fire_itself_stays_if_nothing_of_it_was_seen() -> None:
    cells, burned = found(seen_unburned(22))
    assert not cells[25:].any()
    assert burned[25:].any()
