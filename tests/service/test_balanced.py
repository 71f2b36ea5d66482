"""team.balanced: better than the rules of the thesis, with changing fleets, and the fleet size."""

import numpy as np
import pytest

from firemodel.physics.weather import WeatherStream
from mission_service.experiments.bent.ring_flight import TeamFlight, fly_team
from mission_service.experiments.bent.ring_history import RingStep, ring_history
from mission_service.experiments.fires import SHORT_GRASS, burn, flat, of_one_fuel, wind
from mission_service.guidance.team.balanced import Balanced
from mission_service.guidance.team.bent_rules import NEGOTIATIONS, PLANNERS, bent_rule
from mission_service.guidance.team.dead_reckoning import ReportedPosition, dead_reckoned_fleet
from mission_service.guidance.team.front_ring import ActiveFleet, Floats, FrontRing, TeamRule
from mission_service.guidance.team.team_size import (
    best_split,
    vehicles_for_advance,
    vehicles_for_age,
    vehicles_needed,
)

SPEED_M_S = 20.0


@pytest.fixture(scope="module")
def history() -> list[RingStep]:
    """Return fifty minutes of a grass fire; the wind turns half-way."""
    weather = WeatherStream((wind(0.0, 3.0, 0.0), wind(7800.0, 3.0, 180.0)))
    land = flat(of_one_fuel(SHORT_GRASS))
    fire = burn("short", "anyangle", land, weather, (85, 100), 9300.0, SPEED_M_S, 6300.0)
    return ring_history(fire)


def still(cells: int, rate: Floats | float = 0.1, steps: int = 100) -> list[RingStep]:
    """Return a ring that does not grow."""
    same = np.arange(cells)
    places = np.column_stack([same, np.zeros(cells, np.int64)])
    rates = np.broadcast_to(np.asarray(rate, float), (cells,)).copy()
    return [
        RingStep(20.0 * step, places, np.full(cells, 30.0), rates, same, same)
        for step in range(steps)
    ]


def flown(history: list[RingStep], rule: TeamRule, uavs: int, **options: object) -> TeamFlight:
    return fly_team(history, rule, uavs, SPEED_M_S, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("importance", "uavs"), [("linear", 5), ("exponential", 3)])
def test_costs_less_than_the_benchmarks_and_the_thesis(
    history: list[RingStep], importance: str, uavs: int
) -> None:
    ours = flown(history, Balanced(importance), uavs)  # type: ignore[arg-type]
    mean, std = ours.mean_std(importance)
    others: list[tuple[str, str | None]] = [("circling", None), ("bumper", None)]
    others += [(name, negotiation) for name in PLANNERS for negotiation in NEGOTIATIONS]
    found = [flown(history, bent_rule(*names, importance), uavs) for names in others]
    means = {names: one.mean_std(importance)[0] for names, one in zip(others, found, strict=True)}
    assert mean < min(means.values()), means
    assert std < 1.1 * min(one.mean_std(importance)[1] for one in found)
    assert ours.min_separation_m >= 25.0


def test_the_same_on_every_run(history: list[RingStep]) -> None:
    one, other = (flown(history[:60], Balanced(), 4) for _ in range(2))
    assert np.array_equal(one.linear, other.linear)
    for member, track in one.tracks.items():
        assert np.array_equal(track, other.tracks[member])


class Spied(Balanced):
    """A planner that counts the changes of plans for each team."""

    def gaps(self, size: int) -> list[int]:
        return sorted(np.diff(np.append(np.sort(self._goal), self._goal.min() + size)).tolist())


def test_the_others_close_the_gap_when_one_is_lost() -> None:
    ring = still(160)
    kept = Spied()
    three = flown(ring, Balanced(), 3).linear[60:].mean()
    lost = flown(ring, kept, 4, leaving=((100.0, 2),))
    # Unchanged, gaps of 1/4, 1/4 and 1/2 would cost an eighth more than even gaps.
    assert lost.linear[60:].mean() < 1.03 * three
    assert max(kept.gaps(160)) < 1.2 * 160 / 3


def test_the_plan_changes_at_the_first_decision_without_the_lost_one() -> None:
    cells = 160
    seen_s = -1.5 * (np.arange(cells) % 40).astype(np.float64)
    ring = FrontRing(np.full(cells, 30.0), np.full(cells, 0.1), seen_s)
    rule = Balanced()
    four = ActiveFleet(
        np.arange(4), np.array([0, 40, 80, 120]), np.ones(4, bool), np.full(4, SPEED_M_S)
    )
    for which in range(4):
        assert rule.decide(ring, four, which, 0.0)
    # The vehicle behind the gap is early: it turns back to cells that its successor would reach
    # late.
    three = ActiveFleet(
        four.member[[0, 1, 3]], np.array([1, 41, 121]), np.ones(3, bool), four.speed_m_s[:3]
    )
    turned = [not rule.decide(ring, three, which, 1.5) for which in range(3)]
    assert any(turned)


def test_a_joining_vehicle_is_planned_for(history: list[RingStep]) -> None:
    joined = flown(history[:120], Balanced(), 3, joining=((7000.0, 7),))
    three = flown(history[:120], Balanced(), 3)
    assert joined.linear[70:].mean() < 0.85 * three.linear[70:].mean()


def test_an_arc_many_times_hotter_is_passed_more_often() -> None:
    rates = np.full(160, 0.02)
    rates[40:56] = 0.6
    ring = still(160, rates, 120)
    ours = flown(ring, Balanced(), 3)
    circling = flown(ring, bent_rule("circling", None, "linear"), 3)
    assert ours.linear[60:].mean() < 0.8 * circling.linear[60:].mean()


def rollouts(cells: int) -> tuple[int, int]:
    """Return the number of plans simulated in one decision, and of nodes in each."""
    ring = FrontRing(np.full(cells, 30.0), np.full(cells, 0.1), np.zeros(cells))
    fleet = ActiveFleet(
        np.arange(2), np.array([0, cells // 2]), np.ones(2, bool), np.full(2, SPEED_M_S)
    )
    rule = Balanced()
    rule.decide(ring, fleet, 0, 0.0)
    before = rule.rollouts
    rule.decide(ring, fleet, 0, 60.0)
    return rule.rollouts - before, rule.nodes


def test_a_decision_does_not_grow_with_the_ring() -> None:
    (few, few_nodes), (many, many_nodes) = rollouts(200), rollouts(2000)
    assert many <= few
    assert few_nodes == 200
    assert many_nodes <= 256


def test_how_many_are_needed() -> None:
    # Example: 0.5 m/s, 5 km, 15 m/s, 50 m.
    assert vehicles_for_advance(0.5, 5000.0, 15.0, 50.0) == 4
    assert vehicles_for_advance(0.3, 5000.0, 15.0, 50.0) == 2  # exactly
    assert vehicles_for_age(5000.0, 15.0, 100.0) == 4
    assert vehicles_for_age(100.0, 15.0, 100.0) == 1


@pytest.mark.parametrize(
    ("share", "weight", "mixed", "lapping"),
    [(0.1, 6.0, 0.60, 1.50), (0.2, 4.0, 0.80, 1.00), (0.3, 2.0, 0.60, 0.50)],
)
def test_the_split_of_four(share: float, weight: float, mixed: float, lapping: float) -> None:
    """The test compares the worst weighted ages in L/v if one to three of four vehicles sweep."""
    sweeps = [max(2.0 * weight * share / k, 1.0 / (4 - k)) for k in range(1, 4)]
    assert [min(sweeps), weight / 4] == pytest.approx([mixed, lapping])
    # The arc is found from the spread along a ring of 64 x 10 cells.
    hot = round(640 * share)
    rates = np.full(640, 0.1)
    rates[100 : 100 + hot] = 0.1 * weight
    split = best_split(np.full(640, 30.0), rates, 4, SPEED_M_S)
    unit_m = 0.1 * 640 * 30.0 / SPEED_M_S
    assert split.worst_advance_m / unit_m == pytest.approx(min(mixed, lapping), rel=0.2)
    assert (split.sweeping > 0) == (mixed < lapping)
    needed = vehicles_needed(np.full(640, 30.0), rates, SPEED_M_S, split.worst_advance_m)
    assert needed is not None
    assert needed.lapping + needed.sweeping <= 4


def test_a_silent_vehicle_is_reckoned_along_the_ring_and_then_lost() -> None:
    ring = FrontRing(np.full(100, 30.0), np.full(100, 0.1), np.zeros(100))
    positions = [
        ReportedPosition(3, 10, False, 20.0, 0.0),
        ReportedPosition(1, 95, True, 20.0, 6.0),
    ]
    fleet = dead_reckoned_fleet(positions, ring, 18.0, lost_after_s=30.0)
    assert fleet.member.tolist() == [1, 3]
    # 12 s are 8 cells beyond the end of the ring, 18 s are 12 cells back beyond its beginning.
    assert fleet.cell.tolist() == [3, 98]
    assert dead_reckoned_fleet(positions, ring, 31.0, lost_after_s=30.0).member.tolist() == [1]


def test_a_silent_vehicle_is_planned_around_where_it_is_reckoned() -> None:
    ring = FrontRing(np.full(100, 30.0), np.full(100, 0.1), np.zeros(100))
    rule = Balanced()
    fleet = ActiveFleet(np.arange(2), np.array([0, 50]), np.ones(2, bool), np.full(2, SPEED_M_S))
    rule.decide(ring, fleet, 0, 0.0)
    rule.decide(ring, fleet, 1, 0.0)
    fleet.cell[:] = 20, 70
    rule.decide(ring, fleet, 0, 30.0)
    assert rule._goal[rule._members.index(1)] == 70


@pytest.mark.parametrize("uavs", [1, 2, 3, 4])
def test_on_a_front_within_one_cell_all_lap(uavs: int) -> None:
    """Such a front has no length, and costs are not defined; the search for a pattern must end."""
    zeros, member = np.zeros(360), np.arange(uavs)
    ring, cells = FrontRing(zeros, zeros, zeros), member * 80
    rule = Balanced("linear", 10.0)
    for at_s in np.arange(100.0, 300.0, 5.0).tolist():
        for which in range(uavs):
            clockwise = np.ones(uavs, np.bool_)
            fleet = ActiveFleet(member, cells, clockwise, np.full(uavs, SPEED_M_S))
            assert rule.decide(ring, fleet, which, at_s)
        cells = (cells + 1) % 360
    assert not rule.turns
