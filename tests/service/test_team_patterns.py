"""Patterns of team.balanced on rings with a hot arc: their costs, and flights that use them."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.team_arcs import (
    CELL_M,
    FINE,
    ArcCase,
    best_pattern_cost,
    hot_rates,
    pattern_cost,
    still_ring,
)
from mission_service.experiments.bent.ring_flight import fly_team
from mission_service.guidance.team.balanced import Balanced
from mission_service.guidance.team.baselines import Circling
from mission_service.guidance.team.front_ring import (
    ActiveFleet,
    Floats,
    FrontRing,
    Integers,
    TeamRule,
)
from mission_service.guidance.team.lookahead import Nodes
from mission_service.guidance.team.patterns import (
    LAPS,
    Pattern,
    PlanState,
    best_pattern,
    on_new_ring,
    plan_on_arc,
    settled_cost,
)

SPEED_M_S = 20.0


def arc(uavs: int, length: int = 3, factor: float = 50.0, turn_s: float = 0.0) -> ArcCase:
    return ArcCase(61, 37, length, factor, uavs, SPEED_M_S, turn_s)


def nodes(case: ArcCase) -> Nodes:
    rates = hot_rates(case)
    same = np.ones(case.cells)
    return Nodes(CELL_M * same, rates / 2.0, 2.0 * same, True, 0.0 * same, 1)


def late_cost(case: ArcCase, rule: TeamRule) -> float:
    """Return the mean cost of a flight after its first half."""
    ring = still_ring(case, hot_rates(case))
    flight = fly_team(ring, rule, case.uavs, SPEED_M_S, cell_m=CELL_M / FINE, turn_s=case.turn_s)
    return float(flight.linear[flight.linear.size // 2 :].mean())


@pytest.mark.parametrize("turn_s", [0.0, 4.0])
@pytest.mark.parametrize(
    ("uavs", "length", "sweeping", "returns"),
    [(2, 6, 1, 0), (5, 8, 3, 0), (3, 10, 0, 1), (4, 5, 0, 4), (4, 0, 0, 0)],
)
def test_settled_costs_are_those_of_all_visits(
    uavs: int, length: int, sweeping: int, returns: int, turn_s: float
) -> None:
    case = arc(uavs, turn_s=turn_s)
    if length:
        visits = pattern_cost(case, (36, 36 + length), sweeping, returns)
        # The visits contain the ends of the arc once, the formula also at the end of the turn.
        tolerance = 0.02 if turn_s else 0.01
    else:
        gap_s = case.cells * CELL_M / SPEED_M_S / uavs
        visits, tolerance = float(hot_rates(case).mean()) * gap_s / 2.0, 1e-9
    pattern = Pattern(36, length, sweeping, returns) if length else LAPS
    settled = settled_cost(pattern, nodes(case), uavs, SPEED_M_S, turn_s)
    assert settled / case.cells == pytest.approx(visits, rel=tolerance)


@pytest.mark.parametrize(("uavs", "limit"), [(2, 0.8), (7, 0.65), (8, 0.65)])
def test_a_hot_arc_costs_less_than_circling_and_as_much_as_the_best_pattern(
    uavs: int, limit: float
) -> None:
    case = arc(uavs)
    ours = late_cost(case, Balanced())
    assert ours < limit * late_cost(case, Circling())
    if uavs < 8:
        assert ours < 1.05 * best_pattern_cost(case)[0]


def test_on_a_long_ring_the_pattern_ends_with_the_arc() -> None:
    """Roll-outs divide this ring into nodes of two cells; all cells of the arc are served."""
    case = ArcCase(280, 154, 38, 51.5, 7, SPEED_M_S, 0.0)
    rule = Balanced()
    fleet = ActiveFleet(np.arange(7), np.arange(0, 280, 40), np.ones(7, bool), np.full(7, 20.0))
    rule.decide(FrontRing(np.full(280, CELL_M), hot_rates(case), np.zeros(280)), fleet, 0, 0.0)
    assert rule.nodes == 140
    assert rule._pattern == Pattern(154, 37, 4, 0)


def test_on_an_even_ring_all_lap() -> None:
    case = arc(5, factor=1.0)
    lapping = settled_cost(LAPS, nodes(case), 5, SPEED_M_S, 0.0)
    assert best_pattern(nodes(case), 5, SPEED_M_S, 0.0).cost >= lapping
    assert late_cost(case, Balanced()) == pytest.approx(late_cost(case, Circling()), rel=1e-3)


def test_turns_that_cost_more_than_a_sweep_gains_are_not_flown() -> None:
    case = arc(2, turn_s=60.0)
    assert best_pattern(nodes(case), 2, SPEED_M_S, 60.0).cost > settled_cost(
        LAPS, nodes(case), 2, SPEED_M_S, 60.0
    )
    assert late_cost(case, Balanced(turn_s=60.0)) < 1.02 * late_cost(case, Circling())


class Misinformed:
    """A team rule that receives wrong rates of spread."""

    def __init__(self, rule: TeamRule, factors: Floats) -> None:
        self._rule = rule
        self._factors = factors
        self._rings: tuple[FrontRing, FrontRing] | None = None

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Return the rule's decision on the ring with wrong rates."""
        if self._rings is None or self._rings[0] is not ring:
            wrong = ring.spread_rate_m_s * self._factors
            self._rings = ring, replace(ring, spread_rate_m_s=wrong)
        return self._rule.decide(self._rings[1], fleet, which, at_s)

    def on_ring_changed(self, place_of: Integers) -> None:
        """Pass the change on."""
        self._rule.on_ring_changed(place_of)


def test_wrong_rates_of_spread_change_the_flight_and_cost_more() -> None:
    case = arc(3, factor=15.0)
    right = late_cost(case, Balanced())
    even = late_cost(case, Misinformed(Balanced(), 1.0 / hot_rates(case)))
    elsewhere = late_cost(case, Misinformed(Balanced(), np.roll(hot_rates(case), 25) ** 2))
    noise = np.exp(0.5 * np.random.default_rng(5).standard_normal(case.cells))
    noisy = late_cost(case, Misinformed(Balanced(), noise))
    assert right < 0.95 * even
    assert right < 0.8 * elsewhere
    assert noisy != right


def test_plans_return_on_the_arc_and_then_lap() -> None:
    twice = Pattern(90, 20, 0, 2)
    legs = plan_on_arc(twice, PlanState(80, 1, 0), 100)
    assert legs[:9].tolist() == [30, 20, 20, 20, 120, 20, 20, 20, 120]
    # Heading back, after one return.
    assert plan_on_arc(twice, PlanState(95, -1, 1), 100)[:4].tolist() == [5, 120, 20, 20]
    sweep = plan_on_arc(Pattern(90, 20, 1, 0), PlanState(80, 1, 0), 100)
    assert sweep[:4].tolist() == [30, 20, 20, 20]


def test_an_arc_moves_with_its_cells() -> None:
    onward = np.arange(0, 200, 2) + 10  # each cell becomes two
    assert on_new_ring(Pattern(90, 20, 2, 0), onward, 200) == Pattern(190, 40, 2, 0)
    assert on_new_ring(LAPS, onward, 200) == LAPS


@pytest.mark.parametrize(
    ("lengths", "laps"),
    [
        ([(1.0, 0.0), (1.0, 1.0)], False),
        ([(1.0, 0.0), (1.02, 1.0)], False),
        ([(1.0, 0.0), (1.3, 1.0)], True),
        # Growth of 13 % in a lap is between the limits: what was flown before is flown on.
        ([(1.0, 0.0), (1.3, 2.7)], False),
        ([(1.0, 0.0), (1.3, 1.0), (1.3, 2.7)], True),
        ([(1.0, 0.0), (1.3, 1.0), (1.3, 3.8)], False),  # 9 %
    ],
)
def test_no_arc_is_served_on_a_ring_that_grows_fast(
    lengths: list[tuple[float, float]], laps: bool
) -> None:
    """``lengths`` are lengths of the ring as factors, and times in laps of the first ring."""
    case = arc(4)
    same, rule, lap_s = np.ones(case.cells), Balanced(), case.cells * CELL_M / SPEED_M_S
    fleet = ActiveFleet(np.arange(4), np.arange(0, 60, 15), np.ones(4, bool), np.full(4, SPEED_M_S))
    for grown, at_laps in lengths:
        ring = FrontRing(grown * CELL_M * same, hot_rates(case), 0.0 * same)
        rule.decide(ring, fleet, 0, at_laps * lap_s)
    assert (rule._pattern == LAPS) == laps
