"""A team flown ideally around a ring: ages known from theory, growth, leaving and joining."""

import numpy as np
import pytest

from mission_service.experiments.bent.ring_flight import (
    LAYER_M,
    equidistant,
    fly_team,
    min_separation_m,
)
from mission_service.experiments.bent.ring_history import RingStep
from mission_service.guidance.team.baselines import Bumper, Circling
from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing, Integers

CELL_M = 30.0
SPEED_M_S = 15.0


def still(cells: int, steps: int, rate: float = 1.0) -> list[RingStep]:
    """Return a constant square ring, read every 20 s; linear cost is then the mean age."""
    side = cells // 4
    along = np.arange(side)
    rows = np.concatenate([0 * along, along, 0 * along + side, side - along])
    cols = np.concatenate([along, 0 * along + side, side - along, 0 * along])
    same = np.arange(4 * side)
    place = np.column_stack([rows, cols])
    return [
        RingStep(
            20.0 * step, place, np.full(same.size, CELL_M), np.full(same.size, rate), same, same
        )
        for step in range(steps)
    ]


def settled(costs: np.ndarray) -> float:
    return float(costs[costs.size // 2 :].mean())


@pytest.mark.parametrize("uavs", [1, 2, 4, 5])
def test_circling_leaves_half_of_its_gap_as_mean_age(uavs: int) -> None:
    ring = still(400, 400)
    flight = fly_team(ring, Circling(), uavs, SPEED_M_S)
    length_m = 400 * CELL_M
    assert settled(flight.linear) == pytest.approx(length_m / (2 * uavs * SPEED_M_S), rel=0.02)
    assert settled(flight.worst_linear) == pytest.approx(length_m / (uavs * SPEED_M_S), rel=0.03)


@pytest.mark.parametrize("uavs", [2, 4, 6])
def test_bumper_leaves_two_thirds_of_its_share_as_mean_age(uavs: int) -> None:
    flight = fly_team(still(400, 600), Bumper(), uavs, SPEED_M_S)
    share_m = 400 * CELL_M / uavs
    assert settled(flight.linear) == pytest.approx(2 * share_m / (3 * SPEED_M_S), rel=0.03)


def test_vehicles_that_bump_never_pass_each_other() -> None:
    class Watched(Bumper):
        order_of: list[list[int]]

        def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
            around = np.argsort(fleet.cell, kind="stable")
            self.order_of.append(np.roll(around, -int(np.argmin(around))).tolist())
            return super().decide(ring, fleet, which, at_s)

    rule = Watched()
    rule.order_of = []
    fly_team(still(200, 200), rule, 4, SPEED_M_S)
    # Two vehicles in one cell at a meeting may be counted in either order.
    assert np.mean([order == [0, 1, 2, 3] for order in rule.order_of]) > 0.95
    assert rule.order_of[-1] == [0, 1, 2, 3]


def test_costs_are_those_of_the_thesis() -> None:
    flight = fly_team(still(40, 2, rate=0.5), Circling(), 1, 0.001)
    # No vehicle moves: all cells are 20 s old except the occupied one, which was visited at 0 s
    # too.
    assert flight.linear.tolist() == [0.0, 10.0]
    assert flight.exponential[1] == pytest.approx(20.0**1.5)
    assert flight.mean_std("linear") == (5.0, 5.0)
    assert flight.mean_std("exponential")[0] == pytest.approx(20.0**1.5 / 2)


def test_growth_takes_visits_and_vehicles_along() -> None:
    before, _ = still(40, 2)
    # Each cell becomes two, of which a vehicle occupies only one.
    twice = np.repeat(np.arange(40), 2)
    cells = 2 * before.cells[twice] + np.where(np.arange(80) % 2, 1, 0)[:, None]
    wide = RingStep(20.0, cells, np.full(80, CELL_M), np.ones(80), twice, 2 * np.arange(40))
    same = np.arange(80)
    later = RingStep(60.0, cells, wide.step_m, wide.spread_rate_m_s, same, same)
    places: list[Integers] = []

    class Noted(Circling):
        def on_ring_changed(self, place_of: Integers) -> None:
            places.append(place_of)

    flight = fly_team([before, wide, later], Noted(), 1, CELL_M / 8.0)
    visits_s = flight.tracks[0][:, 0]
    assert [place.size for place in places] == [40, 80]
    # Cells 0, 1 and 2 at 0, 8 and 16 s; 2 s before cell 3, which has become cell 6 farther out.
    assert visits_s[:3].tolist() == [0.0, 8.0, 16.0]
    ages = 20.0 - np.array([0.0, 0.0, 8.0, 8.0, 16.0, 16.0])
    assert flight.linear[1] == pytest.approx((ages.sum() + 74 * 20.0) / 80)
    row, col = flight.tracks[0][3, 1:]
    assert (row, col) == (0.0, 2.5)
    assert flight.tracks[0][4, 1:].tolist() == cells[6].tolist()
    assert flight.tracks[0][4, 0] == pytest.approx(20.0 + np.hypot(*(cells[6] - (0.0, 2.5))) * 8.0)


def test_losing_and_joining() -> None:
    ring = still(400, 1200)
    flight = fly_team(ring, Circling(), 4, SPEED_M_S, leaving=[(4000.0, 1)], joining=[(12000.0, 7)])
    assert sorted(flight.tracks) == [0, 1, 2, 3, 7]
    assert flight.tracks[1][-1, 0] == 4000.0
    assert flight.tracks[7][0, 0] == 12000.0
    lost = flight.linear[(flight.at_s > 8000.0) & (flight.at_s < 12000.0)].mean()
    # Gaps of 1/4, 1/4 and 1/2: the mean age is half the sum of their squares.
    assert lost == pytest.approx(0.375 * 400 * CELL_M / (2 * SPEED_M_S), rel=0.03)


def test_starts_are_at_equal_distances() -> None:
    assert equidistant(np.array([1.0, 1.0, 1.0, 3.0, 3.0, 3.0]), 2).tolist() == [0, 4]
    assert equidistant(np.ones(10), 3).tolist() == [0, 3, 7]


def test_separation_is_found_between_points_too() -> None:
    tracks = {
        0: np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 10.0]]),
        1: np.array([[0.0, 1.0, 10.0], [20.0, 1.0, -10.0]]),
        2: np.array([[30.0, 0.0, 0.0], [40.0, 0.0, 0.0]]),
    }
    assert min_separation_m(tracks, 30.0, 40.0) == pytest.approx(50.0)
    assert min_separation_m({0: tracks[0]}, 30.0, 40.0) == np.inf


def test_layers_keep_vehicles_apart_that_meet() -> None:
    flight = fly_team(still(80, 40), Bumper(), 4, SPEED_M_S)
    assert LAYER_M <= flight.min_separation_m < 2 * LAYER_M
