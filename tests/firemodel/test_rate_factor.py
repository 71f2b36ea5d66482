"""A factor of each cell's spread rate, in effect from a time on."""

import numpy as np

from firemodel.spread.anyangle import AnyAngleFire
from tests.firemodel.fires_on_grids import calm, grass

CELLS, MIDDLE = 60, 30
CHANGED_S, END_S = 3600.0, 14_400.0


def burned(*changes: tuple[float, np.ndarray | None]) -> AnyAngleFire:
    """Return a fire after changes of the rate at ``CHANGED_S``, each a factor and its cells."""
    fire = AnyAngleFire(grass(CELLS), calm(), [(MIDDLE, MIDDLE, 0.0)])
    fire.advance(CHANGED_S)
    for factor, cells in changes:
        fire.perturb(1.0, 0.0, factor, cells)
    fire.advance(END_S)
    return fire


def test_the_same_factor_in_all_cells_is_a_factor_of_the_spread() -> None:
    doubled = np.full((CELLS, CELLS), 2.0)
    by_cell, by_fuel = burned((1.0, doubled)), burned((2.0, None))
    np.testing.assert_allclose(by_cell.arrival_time_s, by_fuel.arrival_time_s, rtol=1e-6)


def test_only_cells_with_a_factor_spread_at_another_rate() -> None:
    factor = np.ones((CELLS, CELLS))
    factor[:, MIDDLE + 8 :] = 0.25
    changed, plain = burned((1.0, factor)), burned()
    west = np.s_[:, : MIDDLE - 8]
    np.testing.assert_allclose(changed.arrival_time_s[west], plain.arrival_time_s[west], rtol=1e-3)
    east = np.s_[:, MIDDLE + 10 :]
    reached = plain.arrival_time_s[east] <= END_S
    assert reached.any()
    assert (changed.arrival_time_s[east][reached] > plain.arrival_time_s[east][reached]).all()


def test_a_later_factor_replaces_the_earlier_one() -> None:
    half, whole = np.full((CELLS, CELLS), 0.5), np.ones((CELLS, CELLS))
    changed, plain = burned((1.0, half), (1.0, whole)), burned()
    np.testing.assert_allclose(changed.arrival_time_s, plain.arrival_time_s, rtol=1e-3)


def test_ground_burned_before_the_change_keeps_its_times_and_copies_are_independent() -> None:
    fire = AnyAngleFire(grass(CELLS), calm(), [(MIDDLE, MIDDLE, 0.0)])
    fire.advance(CHANGED_S)
    before, copied = fire.arrival_time_s.copy(), fire.copy()
    fire.perturb(1.0, 0.0, 1.0, np.full((CELLS, CELLS), 3.0))
    for each in (fire, copied):
        each.advance(END_S)
        known = before <= CHANGED_S
        np.testing.assert_array_equal(each.arrival_time_s[known], before[known])
    assert fire.burned().sum() > 2 * copied.burned().sum()
