"""The scan method and the ring of cells."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mission_service.guidance.fire_map import BEARINGS, EAST, NORTH
from mission_service.guidance.front.front_shape import close_gap, ring_of_cells, steps_between


def test_the_gap_ahead_is_closed_by_a_tangent() -> None:
    # New observations up to bearing 0 (radius 30), older ones ahead (radius 20); flown clockwise.
    outer = np.full(BEARINGS, 30.0)
    outer[1:180] = 20.0
    joined = close_gap(outer, foremost=0, clockwise=True)
    # The tangent from a point at 30 to a circle of 20 touches it at acos(20/30) = 48 degrees.
    assert joined[0] == 30.0
    assert joined[30] == pytest.approx(20.0 / np.cos(np.deg2rad(48.19 - 30.0)), rel=0.02)
    assert joined[60:180] == pytest.approx(20.0)
    assert joined[180:] == pytest.approx(30.0)


def test_anticlockwise_is_the_mirror_image() -> None:
    outer = np.full(BEARINGS, 30.0)
    outer[1:180] = 20.0
    mirrored = outer[(-np.arange(BEARINGS)) % BEARINGS]
    expected = close_gap(outer, 0, clockwise=True)[(-np.arange(BEARINGS)) % BEARINGS]
    assert close_gap(mirrored, 0, clockwise=False) == pytest.approx(expected)


def test_a_front_without_gap_stays_as_it_is() -> None:
    outer = np.full(BEARINGS, 25.0)
    assert close_gap(outer, 90, clockwise=True) == pytest.approx(outer)


fronts = arrays(np.float64, BEARINGS, elements=st.floats(2.0, 60.0))


@given(fronts, st.integers(0, 359), st.booleans())
def test_the_ring_is_closed_and_without_gaps(
    outer: np.ndarray, start: int, clockwise: bool
) -> None:
    north, east, bearing = ring_of_cells(outer, start, clockwise)
    steps = steps_between(north, east)
    assert steps.max() <= np.sqrt(2.0) + 1e-9
    assert steps.min() > 0.0
    assert bearing[0] == start or np.hypot(
        north[0] - outer[start] * NORTH[start], east[0] - outer[start] * EAST[start]
    ) <= np.sqrt(0.5)


@given(fronts, st.integers(0, 359), st.booleans())
def test_closing_the_gap_never_shrinks_the_fire(
    outer: np.ndarray, foremost: int, clockwise: bool
) -> None:
    joined = close_gap(outer, foremost, clockwise)
    assert (joined >= outer - 1e-9).all()
    assert np.isfinite(joined).all()
