"""Advice to a team's operators: possible revisit times, and the required number of vehicles."""

import numpy as np
import pytest

from mission_service.guidance.team import team_size
from mission_service.guidance.team.front_ring import Floats, FrontRing
from mission_service.guidance.team.team_size import (
    ADVISE_EVERY_S,
    CoverageTargets,
    Split,
    TeamSizeAdviser,
    best_split,
    team_size_advice,
    vehicles_needed,
)

# Example: a front of 5 km, 0.5 m/s, vehicles at 15 m/s.
RING = FrontRing(np.full(100, 50.0), np.full(100, 0.5), np.zeros(100))


def speeds(vehicles: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the speeds of the example."""
    return np.full(vehicles, 15.0)


def test_it_reports_what_the_team_can_do_and_what_a_target_requires() -> None:
    too_few, text = team_size_advice(
        RING, speeds(3), CoverageTargets(max_revisit_s=100.0, max_unseen_advance_m=50.0)
    )
    assert too_few
    assert text == (
        "front of 5.0 km, spread up to 30.0 m/min: 3 vehicles can see each part every 111 s; the "
        "maximum unseen advance is 56 m; every 100 s requires 4 vehicles; at most 50 m requires "
        "4 vehicles"
    )
    assert not team_size_advice(RING, speeds(4), CoverageTargets(100.0, 50.0))[0]
    assert not team_size_advice(RING, speeds(1), CoverageTargets())[0]


def test_a_hot_arc_is_reported_as_swept() -> None:
    rate = np.full(100, 0.1)
    rate[:10] = 0.6
    _, text = team_size_advice(
        FrontRing(RING.step_m, rate, RING.visited_at_s), speeds(4), CoverageTargets()
    )
    assert "2 of them sweeping the fastest part" in text


def test_it_announces_when_the_team_changes_or_no_longer_suffices() -> None:
    adviser = TeamSizeAdviser(CoverageTargets(max_revisit_s=100.0))
    assert adviser.is_due(4, 0.0)
    first = adviser.advise(RING, speeds(4), 0.0)
    assert first is not None
    assert not first[0]
    assert not adviser.is_due(4, ADVISE_EVERY_S - 1.0)
    assert adviser.is_due(3, 1.0)
    fewer = adviser.advise(RING, speeds(3), 1.0)
    assert fewer is not None
    assert fewer[0]
    assert adviser.advise(RING, speeds(3), 2.0 + ADVISE_EVERY_S) is None
    grown = FrontRing(2.0 * RING.step_m, RING.spread_rate_m_s, RING.visited_at_s)
    assert TeamSizeAdviser(CoverageTargets(100.0)).advise(grown, speeds(4), 0.0) is not None


def test_a_large_team_is_advised_from_few_splits(monkeypatch: pytest.MonkeyPatch) -> None:
    """A front of 25 km that spreads at 5 m/s needs thousands of vehicles for 1 m of advance."""
    numbers = []

    def counted(step_m: Floats, rate_m_s: Floats, vehicles: int, speed_m_s: float) -> Split:
        numbers.append(vehicles)
        return best_split(step_m, rate_m_s, vehicles, speed_m_s)

    monkeypatch.setattr(team_size, "best_split", counted)
    rates = np.full(360, 5.0)
    ring = FrontRing(np.full(360, 25000.0 / 360), rates, np.zeros(360))
    too_few, text = team_size_advice(ring, speeds(3), CoverageTargets(None, 1.0))
    assert too_few
    assert text.endswith("; at most 1 m requires more than 100 vehicles")
    _, text = team_size_advice(ring, speeds(3), CoverageTargets(None, 200.0))
    assert text.endswith("; at most 200 m requires 42 vehicles")
    assert max(numbers) <= 100
    assert len(numbers) < 12


def test_the_number_of_vehicles_needed_is_the_smallest() -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        step_m, rates = rng.uniform(20.0, 80.0, 90), rng.uniform(0.0, 0.4, 90) ** 3 * 20.0
        advance_m = float(rng.uniform(10.0, 100.0))
        needed = vehicles_needed(step_m, rates, 15.0, advance_m)
        assert needed is not None
        assert needed.worst_advance_m <= advance_m + 1e-6
        vehicles = needed.lapping + needed.sweeping
        for fewer in range(1, vehicles):
            assert best_split(step_m, rates, fewer, 15.0).worst_advance_m > advance_m
