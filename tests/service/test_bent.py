"""Bent's planners and negotiations, each alone and flown around a ring."""

from itertools import pairwise

import numpy as np
import pytest

from mission_service.experiments.bent.ring_flight import fly_team
from mission_service.experiments.bent.ring_history import RingStep
from mission_service.guidance.team.bent_region import Course, Region, course_back, lifted
from mission_service.guidance.team.bent_rules import (
    LATER_NEGOTIATIONS,
    LATER_PLANNERS,
    NEGOTIATIONS,
    PLANNERS,
    bent_rule,
)
from mission_service.guidance.team.bent_steering import (
    back_and_forth,
    highest_dynamic,
    highest_static,
    predictive,
    predictive_kept,
)
from mission_service.guidance.team.bent_team import RegionTeam
from mission_service.guidance.team.front_ring import Floats, FrontRing
from mission_service.guidance.team.negotiation import (
    Party,
    offers,
    on_arrival,
    on_centre,
    on_importance,
    reserved_cells,
)
from mission_service.guidance.team.regions import ledger, owners
from tests.service.test_ring_flight import CELL_M, SPEED_M_S, settled, still

NOW_S = 1000.0


def ring_of(rate: list[float], age_s: list[float]) -> FrontRing:
    rates = np.array(rate)
    return FrontRing(np.full(rates.size, CELL_M), rates, NOW_S - np.array(age_s))


def region_of(
    rate: list[float], age_s: list[float], fix: int, begin: int = 0, end: int | None = None
) -> Region:
    stop = begin + len(rate) if end is None else end
    return Region(ring_of(rate, age_s), begin, stop, fix, NOW_S, SPEED_M_S, False)


def random_ring(seed: int, cells: int = 40) -> FrontRing:
    random = np.random.default_rng(seed)
    rate = random.uniform(0.01, 0.6, cells)
    return FrontRing(random.uniform(30, 43, cells), rate, NOW_S - random.uniform(0, 900, cells))


def importance(ring: FrontRing, place: int, at_s: float, exponential: bool) -> float:
    age_s, rate = at_s - ring.visited_at_s[place], ring.spread_rate_m_s[place]
    return float(age_s ** (1 + rate) if exponential else rate * age_s)


def test_back_and_forth_turns_at_the_ends() -> None:
    flown = [
        back_and_forth(region_of([1.0] * 6, [0.0] * 6, fix, 2, 5), Course(clockwise)).clockwise
        for fix, clockwise in ((2, False), (3, True), (3, False), (4, True))
    ]
    assert flown == [True, True, False, False]


def test_highest_dynamic_flies_to_the_highest_cell_that_is_not_its_own() -> None:
    rate, age_s = [1.0, 1.0, 2.0, 1.0, 1.0], [9.0, 1.0, 0.0, 5.0, 6.0]
    assert highest_dynamic(region_of(rate, age_s, 2), Course()) == Course(False, 0)
    assert highest_dynamic(region_of(rate, age_s, 0), Course()) == Course(True, 4)
    # Across the end of the ring: cells 3 to 6 are 3, 4, 0 and 1.
    assert highest_dynamic(region_of(rate, age_s, 4, 3, 7), Course()) == Course(True, 5)
    # All cells are equal: the nearest is chosen, clockwise first.
    assert highest_dynamic(region_of([1.0] * 5, [0.0] * 5, 2), Course()) == Course(True, 3)


def test_importances_prefer_different_cells() -> None:
    rate, age_s = [0.05, 0.5, 0.1], [900.0, 100.0, 0.0]
    region = region_of(rate, age_s, 2)
    assert highest_dynamic(region, Course()).target == 1
    exponential = Region(region.ring, 0, 3, 2, NOW_S, SPEED_M_S, True)
    assert highest_dynamic(exponential, Course()).target == 0  # 900 ** 1.05 > 100 ** 1.5


def test_highest_static_keeps_its_target_until_it_is_there() -> None:
    rate, age_s = [1.0] * 5, [9.0, 1.0, 0.0, 5.0, 6.0]
    assert highest_static(region_of(rate, age_s, 2), Course(True, 4)) == Course(True, 4)
    assert highest_static(region_of(rate, age_s, 4), Course(True, 4)) == Course(False, 0)
    # The vehicle has flown past its target.
    assert highest_static(region_of(rate, age_s, 4), Course(True, 3)) == Course(False, 0)
    assert highest_static(region_of(rate, age_s, 2), Course(False, 3)) == Course(False, 0)
    # The target now belongs to a neighbour.
    assert highest_static(region_of(rate, age_s, 2, 0, 4), Course(True, 4)) == Course(False, 0)


def slow_best_path(region: Region) -> int:
    """Implement Bent 4.1.4 literally: the mean importance of a path's cells when reached."""
    ring, cells, means = region.ring, region.ring.step_m.size, {}
    for goal in range(region.begin, region.end):
        way = 1 if goal > region.own_cell else -1
        path = list(range(region.own_cell, goal + way, way)) if goal != region.own_cell else []
        at_s, worth = region.at_s, []
        for before, cell in pairwise(path):
            at_s += ring.step_m[min(before, cell) % cells] / region.speed_m_s
            worth.append(importance(ring, cell % cells, at_s, region.exponential))
        if worth:
            means[goal] = np.mean(worth)
    return max(means, key=lambda goal: means[goal])


@pytest.mark.parametrize("exponential", [False, True])
def test_predictive_finds_the_best_path(exponential: bool) -> None:
    targets = []
    for seed in range(30):
        region = Region(random_ring(seed), 25, 55, 25 + seed, NOW_S, SPEED_M_S / 10.0, exponential)
        course = predictive(region, Course())
        assert course == Course(slow_best_path(region) > region.own_cell, slow_best_path(region))
        targets.append(course.target)
    assert len(set(targets)) > 10


def test_predictive_goes_on_to_its_target_if_nothing_is_better() -> None:
    region = region_of([0.0] * 7, [100.0] * 7, 3)
    assert predictive(region, Course(False, 1)) == Course(False, 1)
    assert predictive(region, Course()).target == 4


def test_predictive_kept_flies_its_path_to_the_end() -> None:
    region = Region(random_ring(5), 0, 30, 12, NOW_S, SPEED_M_S, False)
    best = predictive(region, Course()).target
    assert best is not None
    kept = best - 3 if best > 15 else best + 3
    course = Course(kept > 12, kept)
    assert predictive_kept(region, course) == course
    assert predictive_kept(region, Course(True, 12)).target == best
    assert predictive_kept(region, Course(True, 35)).target == best


def test_back_into_the_region_the_shorter_way() -> None:
    assert course_back(region_of([1.0] * 20, [0.0] * 20, 12, 0, 10)).clockwise is False
    assert course_back(region_of([1.0] * 20, [0.0] * 20, 18, 0, 10)).clockwise is True
    assert lifted(3, 25, 40) == 43


def test_offers_leave_as_much_as_the_higher_neighbour_has_then() -> None:
    to_left, to_right = offers(10.0, 4.0, 1.0, alone=False)
    assert (to_left, to_right) == pytest.approx((12 / 7, 18 / 7))
    assert 10.0 - to_left - to_right == pytest.approx(4.0 + to_left)
    assert offers(10.0, 12.0, 4.0, alone=False) == (0.0, 3.0)
    assert offers(10.0, 12.0, 10.0, alone=False) == (0.0, 0.0)
    # With one other vehicle, the regions are equal afterwards.
    assert offers(10.0, 2.0, 2.0, alone=True) == (2.0, 2.0)


def part(begin: int, end: int, *held: int) -> Party:
    return Party(begin, end, held[0], reserved_cells(begin, end, held))


def test_chunks_are_worth_no_more_than_the_offer_and_hold_nothing_of_the_vehicle() -> None:
    ring = ring_of([1.0] * 30, [10.0] * 30)
    left, own, right = part(0, 5, 2), part(5, 25, 15), part(25, 30, 27)
    # 200 compared with 50 and 50: a third of each 150, which is five cells.
    assert on_importance(ring, left, own, right, NOW_S, False) == (5, 5)
    assert on_importance(ring, left, part(5, 25, 7, 8, 22), right, NOW_S, False) == (2, 2)
    assert on_importance(ring, left, part(5, 25, 5, 6, 24), right, NOW_S, False) == (0, 0)
    assert on_importance(ring, own, left, right, NOW_S, False) == (0, 0)
    almost = FrontRing(ring.step_m, np.full(30, 1.01), ring.visited_at_s)
    almost.spread_rate_m_s[5] = 1.2
    assert on_importance(almost, left, own, right, NOW_S, False)[0] == 4


def slow_most_centred(
    ring: FrontRing, own: Party, most: tuple[int, int], exponential: bool
) -> float:
    least = np.inf
    for first in range(most[0] + 1):
        for last in range(most[1] + 1):
            least = min(least, off_centre(ring, own.begin + first, own.end - last, exponential))
    return least


def off_centre(ring: FrontRing, begin: int, end: int, exponential: bool) -> float:
    cells = np.arange(begin, end)
    places = cells % ring.step_m.size
    worth = np.array([importance(ring, int(place), NOW_S, exponential) for place in places])
    return abs(float((worth * cells).sum() / worth.sum()) - (begin + end - 1) / 2)


@pytest.mark.parametrize("exponential", [False, True])
def test_centre_of_importance_is_as_central_as_the_offers_allow(exponential: bool) -> None:
    moved = 0
    for seed in range(30):
        ring = random_ring(seed)
        left, own, right = part(38, 43, 40), part(43, 70, 50 + seed % 12), part(70, 78, 75)
        most = on_importance(ring, left, own, right, NOW_S, exponential)
        first, last = on_centre(ring, left, own, right, NOW_S, exponential)
        assert first <= most[0]
        assert last <= most[1]
        found = off_centre(ring, own.begin + first, own.end - last, exponential)
        assert found == pytest.approx(slow_most_centred(ring, own, most, exponential), abs=1e-6)
        moved += (first, last) not in ((0, 0), most)
    assert moved > 10


def test_the_first_uav_there_gets_the_cells() -> None:
    ring = ring_of([1.0] * 30, [10.0] * 30)
    # Vehicles at 6, 16 and 24: cells 10 (11 is equally near to both) and 21 to 22.
    gift = on_arrival(ring, part(0, 10, 6), part(10, 23, 16), part(23, 30, 24), NOW_S, False)
    assert gift == (1, 2)
    gift = on_arrival(ring, part(0, 10, 0), part(10, 23, 12), part(23, 30, 29), NOW_S, False)
    assert gift == (0, 2)


@pytest.mark.parametrize("uavs", [1, 3, 5])
def test_back_and_forth_leaves_two_thirds_of_a_sweep_as_mean_age(uavs: int) -> None:
    rule = RegionTeam(back_and_forth, lambda *_: (0, 0), exponential=False)
    flight = fly_team(still(400, 900), rule, uavs, SPEED_M_S)
    sweep_m = 400 * CELL_M / uavs
    assert settled(flight.linear) == pytest.approx(2 * sweep_m / (3 * SPEED_M_S), rel=0.03)


def hot_and_cold() -> list[RingStep]:
    """Return a ring of which a quarter spreads ten times as fast."""
    history = still(200, 200, rate=0.05)
    for step in history:
        step.spread_rate_m_s[:50] = 0.5
    return history


@pytest.mark.parametrize("negotiation", [*NEGOTIATIONS])
def test_negotiation_gives_the_hot_part_smaller_regions(negotiation: str) -> None:
    rule = bent_rule("back-and-forth", negotiation, "linear")
    assert isinstance(rule, RegionTeam)
    fly_team(hot_and_cold(), rule, 4, 3.0)
    assert rule.regions is not None
    owner = owners(rule.regions)
    share = np.bincount(owner) / owner.size
    assert np.unique(owner[:50]).size >= 2
    assert share[owner[25]] < 0.2 < share.max()


def grow_and_shrink() -> list[RingStep]:
    """Return a ring of 24 to 72 cells in which cells appear and disappear everywhere."""
    random, history, sizes = np.random.default_rng(4), [], [24]
    for number in range(120):
        cells = sizes[-1]
        turn = np.linspace(0.0, 2.0 * np.pi, cells, endpoint=False)
        places = np.column_stack([-np.cos(turn), np.sin(turn)]) * cells
        before = sizes[-2] if number else cells
        history.append(
            RingStep(
                20.0 * number,
                np.rint(places).astype(np.int64),
                np.full(cells, CELL_M),
                random.uniform(0.0, 0.4, cells),
                np.arange(cells) * before // cells,
                np.arange(before) * cells // before,
            )
        )
        sizes.append(int(np.clip(cells + random.integers(-3, 5), 24, 72)))
    return history


@pytest.mark.parametrize("negotiation", [*NEGOTIATIONS, *LATER_NEGOTIATIONS])
@pytest.mark.parametrize("planner", [*PLANNERS, *LATER_PLANNERS])
def test_teams_keep_the_perimeter_whoever_comes_and_goes(planner: str, negotiation: str) -> None:
    made = bent_rule(planner, negotiation, "exponential")
    assert isinstance(made, RegionTeam)
    lengths: list[int] = []

    class Watched(RegionTeam):
        def decide(self, ring: FrontRing, fleet, which: int, at_s: float) -> bool:  # type: ignore[no-untyped-def]
            clockwise = super().decide(ring, fleet, which, at_s)
            assert self.regions is not None
            assert self.regions.cells == ring.step_m.size
            assert sorted(self.regions.members) == fleet.member.tolist()
            begins = ledger(self.regions)
            sizes = np.diff([*begins, begins[0] + ring.step_m.size])
            assert (sizes >= 0).all()
            assert (owners(self.regions) >= 0).all()
            lengths.append(int(sizes.max()))
            return clockwise

    made.__class__ = Watched
    flight = fly_team(
        grow_and_shrink(),
        made,
        4,
        SPEED_M_S,
        leaving=[(400.0, 1), (900.0, 0), (900.0, 2), (1400.0, 3), (2000.0, 6)],
        joining=[(700.0, 5), (1400.0, 6), (1800.0, 1)],
    )
    assert sorted(flight.tracks) == [0, 1, 2, 3, 5, 6]
    assert max(lengths) > 24
    assert flight.min_separation_m >= 25.0
    assert settled(flight.linear) < 60.0


def test_flights_are_the_same_every_time() -> None:
    def costs() -> Floats:
        return fly_team(
            grow_and_shrink(), bent_rule("predictive", "centre", "exponential"), 5, 6.0
        ).exponential

    assert costs().tolist() == costs().tolist()
