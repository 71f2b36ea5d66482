"""The on-board map: the effect of a camera window on outer and inner cells."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN
from mission_service.fire.observed_window import states_in
from mission_service.guidance.fire_map import (
    FireMap,
    circular_mean,
    fill_circular,
    front_in_window,
)
from mission_service.guidance.front.first_lap import recentred_map


def disc(radius: float, size: int = 61) -> np.ndarray:
    """Return a whole image of a round fire in the middle of a square landscape."""
    rows, cols = np.indices((size, size)) - size // 2
    return np.where(np.hypot(rows, cols) <= radius, BURNED, UNBURNED).astype(np.uint8)


def fresh_map(baseline_s: float = 300.0) -> FireMap:
    return FireMap((61, 61), 30.0, 30.0, ignited_at_s=0.0, baseline_s=baseline_s)


def test_observation_strings_become_codes() -> None:
    found = states_in((".ub", "bu."))
    assert found.tolist() == [[UNSEEN, UNBURNED, BURNED], [BURNED, UNBURNED, UNSEEN]]


def test_burned_ground_at_the_edge_of_the_view_is_not_front() -> None:
    window = states_in(("bbb.", "bbb.", "bbu."))
    assert front_in_window(window).tolist() == [
        [False, False, False, False],
        [False, False, True, False],
        [False, True, False, False],
    ]


def test_a_round_fire_seen_whole_is_a_round_map() -> None:
    seen = fresh_map()
    in_view = seen.add_window(0, 0, disc(15.0), 600.0)
    assert in_view.all()
    assert seen.complete
    assert np.abs(seen.outer - 15.0).max() < 1.1
    # Eq. 1 with the ignition as the inner cell: 15 cells in 600 s.
    assert seen.spread_rate_cells_s(10).mean() == pytest.approx(15.0 / 600.0, rel=0.05)


def test_spread_rate_is_measured_between_visits() -> None:
    seen = fresh_map()
    seen.add_window(0, 0, disc(10.0), 1000.0)
    seen.add_window(0, 0, disc(20.0), 2000.0)
    assert seen.inner_at_s == pytest.approx(1000.0)
    assert seen.spread_rate_cells_s(10).mean() == pytest.approx(0.01, rel=0.05)


def test_the_damped_map_does_not_measure_between_looks_seconds_apart() -> None:
    seen = fresh_map(baseline_s=300.0)
    seen.add_window(0, 0, disc(10.0), 1000.0)
    seen.add_window(0, 0, disc(11.0), 1010.0)
    assert seen.inner_at_s == pytest.approx(0.0)
    assert (seen.outer_at_s - seen.inner_at_s >= 300.0).all()


def test_the_literal_map_does() -> None:
    seen = fresh_map(baseline_s=0.0)
    seen.add_window(0, 0, disc(10.0), 1000.0)
    seen.add_window(0, 0, disc(11.0), 1010.0)
    moved = seen.inner_at_s == 1000.0
    assert moved.mean() > 0.8
    assert seen.spread_rate_cells_s()[moved].mean() == pytest.approx(0.1, rel=0.3)


def test_an_unburned_island_behind_the_front_is_not_the_perimeter() -> None:
    window = disc(15.0)
    window[20:23, 30] = UNBURNED  # seven to ten cells north of the centre
    seen = fresh_map()
    seen.add_window(0, 0, window, 600.0)
    assert seen.outer[0] == pytest.approx(15.0, abs=1.0)
    # A later image of the island only, without the front.
    in_view = seen.add_window(18, 27, window[18:26, 27:34], 700.0)
    assert not in_view.any()
    assert seen.outer[0] == pytest.approx(15.0, abs=1.0)


def test_only_what_is_in_the_window_is_learnt() -> None:
    seen = fresh_map()
    world = disc(15.0)
    # An image of the northern edge.
    in_view = seen.add_window(10, 25, world[10:20, 25:36], 600.0)
    assert in_view[0]
    assert not in_view[90:270].any()
    assert np.isnan(seen.outer[90:270]).all()


def test_holes_on_the_circle_are_interpolated() -> None:
    values = np.full(8, np.nan)
    values[[0, 4]] = [2.0, 6.0]
    assert fill_circular(values) == pytest.approx([2, 3, 4, 5, 6, 5, 4, 3])


@given(st.lists(st.floats(0, 1e3), min_size=9, max_size=40), st.integers(0, 4))
def test_smoothing_keeps_the_mean(values: list[float], half_width: int) -> None:
    found = circular_mean(np.array(values), half_width)
    assert found.mean() == pytest.approx(np.mean(values), rel=1e-9, abs=1e-9)


def test_a_flank_that_runs_outwards_is_no_island() -> None:
    """A strip extends to the north; its flank passes many cells on one bearing.

    Found in flight: a cell counted as burned on its neighbours' bearings, but as front only on its
    own. The map of such a flank was not updated, and a team's planner flew back and forth.
    """
    cells = np.full((60, 60), UNBURNED, np.uint8)
    cells[10:51, 28:33] = BURNED
    strip = FireMap((60, 60), 50.0, 30.0, 0.0, 600.0)
    assert strip.add_window(0, 0, cells, 100.0)[:12].all()
    assert (np.diff(strip.outer[3:12]) <= 0.0).all()


def test_a_correction_before_the_first_view_shows_no_front() -> None:
    seen = fresh_map()
    seen.correct_window(25, 25, np.full((11, 11), UNBURNED, np.uint8), 100.0)
    assert np.isnan(seen.outer).all()
    assert np.isnan(seen.outer_at_s).all()
    assert not seen.burned.any()
    seen.add_window(0, 0, disc(15.0), 600.0)
    assert seen.complete


def test_a_map_around_a_single_burned_cell_keeps_its_centre() -> None:
    views = [(0, 0, disc(0.5), 600.0 + second) for second in range(3)]
    seen = fresh_map()
    for view in views:
        seen.add_window(*view)
    renewed, in_view = recentred_map(seen, views)
    assert (renewed.centre_row, renewed.centre_col) == (30.0, 30.0)
    assert in_view.any()


def test_a_map_has_a_finite_centre() -> None:
    with pytest.raises(ValueError, match="centre"):
        FireMap((61, 61), float("nan"), 30.0, 0.0, 300.0)
