"""Islam & Hu, eqs. 1 to 7, and the turning threshold of section V."""

import numpy as np
import pytest

from mission_service.guidance.front.cell_importance import (
    adjusted_spread_rate,
    cell_importance,
    ring_importance,
    time_to_cells_s,
    window_importance,
)


def test_importance_is_a_distance_in_rate_times_seconds() -> None:
    # Eq. 4: 0.5 m/s, unobserved for 100 s and 60 s away: 80 m of unobserved spread.
    found = cell_importance(np.array([0.5]), np.array([100.0]), np.array([60.0]))
    assert found == pytest.approx([80.0])


def test_cells_behind_are_reached_backwards_and_cells_ahead_forwards() -> None:
    # Eq. 3 on a ring of six cells, 30 m apart, at 15 m/s.
    found = time_to_cells_s(np.full(6, 30.0), 15.0)
    assert found == pytest.approx([0.0, 2.0, 4.0, 6.0, 4.0, 2.0])


def test_windows_are_the_two_halves_of_the_ring() -> None:
    assert window_importance(np.array([1.0, 2.0, 3.0, 10.0, 20.0, 30.0])) == (6.0, 60.0)


def test_alpha_zero_levels_all_rates_to_the_least() -> None:
    rate = np.array([0.1, 0.2, 0.6])
    assert adjusted_spread_rate(rate, 0.0) == pytest.approx([0.1, 0.1, 0.1])


def test_alpha_below_one_draws_all_rates_to_the_least() -> None:
    rate = np.array([0.1, 0.2, 0.6])
    assert adjusted_spread_rate(rate, 0.5) == pytest.approx([0.1, 0.15, 0.35])


def test_alpha_one_leaves_rates_alone() -> None:
    rate = np.array([0.1, 0.2, 0.6])
    assert adjusted_spread_rate(rate, 1.0) == pytest.approx(rate)


def test_alpha_above_one_raises_only_rates_above_the_mean() -> None:
    rate = np.array([0.1, 0.2, 0.6])  # mean 0.3
    assert adjusted_spread_rate(rate, 5.0) == pytest.approx([0.1, 0.2, 2.6])


def ring_at_location_4(half: int, ratio: float) -> np.ndarray:
    """Return the spread rates of the ring of fig. 6 seen from location 4, flown clockwise.

    Location 3 (fastest) is a quarter of the ring behind, location 1 (slowest) a quarter ahead.
    Index 0 is the vehicle's cell; the index increases against the direction of flight.
    """
    from_fastest = np.abs((np.arange(2 * half) - half // 2 + half) % (2 * half) - half)
    return 1.0 + (ratio - 1.0) * (1.0 - from_fastest / half)


def windows_by_direct_sum(rates: np.ndarray) -> tuple[float, float]:
    """Return the sum of eq. 4 over single cells for a vehicle that has been circling; c = s = 1."""
    count = len(rates)
    back = sum(rates[i] * i + rates[i] * i for i in range(count // 2))
    front = sum(rates[i] * i + rates[i] * (count - i) for i in range(count // 2, count))
    return back, front


@pytest.mark.parametrize(("ratio", "turns"), [(1.0, False), (4.8, False), (5.2, True), (9.0, True)])
def test_at_location_4_the_uas_turns_back_from_a_ratio_of_five(ratio: float, turns: bool) -> None:
    back, front = windows_by_direct_sum(ring_at_location_4(2000, ratio))
    assert (back > front) == turns


def test_the_threshold_at_location_4_is_five() -> None:
    low, high = 1.0, 20.0
    for _ in range(60):
        ratio = (low + high) / 2
        back, front = windows_by_direct_sum(ring_at_location_4(4000, ratio))
        low, high = (low, ratio) if back > front else (ratio, high)
    assert low == pytest.approx(5.0, abs=0.01)


def test_the_planner_sums_windows_as_the_direct_sum_does() -> None:
    rates = ring_at_location_4(100, 7.0)
    since_s = np.arange(200.0)
    found = window_importance(ring_importance(rates, since_s, np.ones(200), 1.0, alpha=1.0))
    assert found == pytest.approx(windows_by_direct_sum(rates))
