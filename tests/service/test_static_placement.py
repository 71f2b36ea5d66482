"""The best static placement, compared with the places that virtual agents find."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from mission_service.errors import MissionServiceError
from mission_service.experiments.virtual_agents.static_placement import (
    best_around,
    best_placement,
    coverage,
    weights_of,
)
from mission_service.guidance.formation.agent_maps import AgentMaps
from mission_service.guidance.formation.coverage import AgentMover, next_goal, velocity
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.settings import Settings

SETTINGS = Settings()
CELL_M = 20.0  # coarse, to save time
CELLS = 140
GRID = MapGrid(CELLS, CELLS, CELL_M, 0.0, CELLS * CELL_M)
MIDDLE_M = CELLS * CELL_M / 2.0
RADIUS_CELLS = SETTINGS.coverage_radius_m / CELL_M
ROW, COL = np.mgrid[:CELLS, :CELLS]
NO_CELLS = np.empty(0, dtype=np.int64)
STEP_S = 1.0

Floats = NDArray[np.float64]


def ellipse(along_m: float, across_m: float, turned_rad: float = 0.0) -> NDArray[np.bool_]:
    """Return the burned cells (y, x) around the middle."""
    x_m, y_m = GRID.xy_of(ROW, COL)
    x_m, y_m = x_m - MIDDLE_M, y_m - MIDDLE_M
    along = x_m * math.cos(turned_rad) + y_m * math.sin(turned_rad)
    across = y_m * math.cos(turned_rad) - x_m * math.sin(turned_rad)
    return np.asarray((along / along_m) ** 2 + (across / across_m) ** 2 <= 1.0)


def maps_of(fire: NDArray[np.bool_]) -> AgentMaps:
    maps = AgentMaps(
        GRID.shape,
        CELL_M,
        SETTINGS.augmentation_m(CELL_M),
        SETTINGS.agent_area_m,
        SETTINGS.monitoring_m,
    )
    maps.set(np.flatnonzero(fire), NO_CELLS)
    return maps


def over_fire_of(maps: AgentMaps) -> NDArray[np.bool_]:
    """Return the cells around which a UAV would fly over fire."""
    near = AgentMaps(GRID.shape, CELL_M, SETTINGS.loiter_radius_m, 0.0)
    near.set(np.flatnonzero(maps.fire), NO_CELLS)
    return np.asarray(near.augmentation > 0)


def places_of(agents_m: Floats) -> Floats:
    """Return (row, col) of agents (n, 2)."""
    return np.stack(GRID.row_col_of(agents_m[:, 0], agents_m[:, 1]), axis=1)  # type: ignore[arg-type]


class Team:
    """Agents that start from one side, each with the fire on its map, without vehicles."""

    def __init__(self, count: int, side_rad: float, away_m: float = 1050.0) -> None:
        along = 80.0 * (np.arange(count) - (count - 1) / 2.0)
        outwards = np.array([math.cos(side_rad), math.sin(side_rad)])
        self.agents_m = MIDDLE_M + away_m * outwards + np.outer(along, outwards[::-1] * [-1, 1])
        self.movers = [AgentMover(SETTINGS, GRID, number) for number in range(count)]
        self.time_s = 0.0

    def others(self, number: int) -> Floats:
        """Return x, y and the key (n, 3) of the other agents' goals, as in the messages."""
        places = [
            mover.goal_m or tuple(agent_m)
            for mover, agent_m in zip(self.movers, self.agents_m, strict=True)
        ]
        return np.delete(np.column_stack([places, np.arange(len(places))]), number, axis=0)

    def fly(self, maps: AgentMaps, duration_s: float) -> Iterator[Floats]:
        """Yield the distance that each agent moved, for each step."""
        end_s = self.time_s + duration_s
        while self.time_s < end_s:
            before_m = self.agents_m.copy()
            for i, mover in enumerate(self.movers):
                x_m, y_m = self.agents_m[i].tolist()
                moved = mover.velocity(self.time_s, x_m, y_m, self.others(i), maps, STEP_S)
                self.agents_m[i] += np.array(moved) * STEP_S
            self.time_s += STEP_S
            yield np.hypot(*(self.agents_m - before_m).T)


def test_coverage_is_the_share_of_weights_within_the_radius() -> None:
    weights = np.zeros((20, 20))
    weights[5, 5], weights[5, 9], weights[15, 15] = 1.0, 0.2, 0.8
    assert coverage(weights, np.array([[5.0, 7.0]]), 2.0) == pytest.approx(0.6)
    assert coverage(weights, np.array([[5.0, 7.0], [5.0, 6.5]]), 2.0) == pytest.approx(0.6)
    assert coverage(weights, np.array([[5.0, 7.1]]), 2.0) == pytest.approx(0.1)
    assert coverage(weights, np.empty((0, 2)), 2.0) == 0.0
    assert coverage(np.zeros((3, 3)), np.empty((0, 2)), 2.0) == 1.0


def test_the_best_places_of_few_discs_are_found_exactly() -> None:
    """The result is compared with all pairs of cells on a small map."""
    rng = np.random.default_rng(4)
    weights = rng.random((9, 9))
    allowed = rng.random((9, 9)) < 0.5
    cells = np.argwhere(allowed).astype(float)
    best = max(
        coverage(weights, np.stack([one, two]), 2.0)
        for k, one in enumerate(cells)
        for two in cells[k + 1 :]
    )
    found = best_placement(weights, allowed, 2, 2.0, seed=1)
    assert found.coverage >= best - 1e-12
    assert found.coverage == pytest.approx(coverage(weights, found.places, 2.0))
    assert all(allowed[round(row), round(col)] for row, col in found.places)


def test_four_discs_around_a_round_fire_stand_in_a_square() -> None:
    maps = maps_of(ellipse(160.0, 160.0))
    weights, allowed = weights_of(maps), maps.augmentation == 0
    found = best_placement(weights, allowed, 4, RADIUS_CELLS, seed=3)
    again = best_around(maps.fire, GRID, SETTINGS, 4, seed=3)
    assert np.array_equal(found.places, again.places)
    places = found.places - (CELLS - 1) / 2.0
    bearings = np.sort(np.degrees(np.arctan2(places[:, 0], places[:, 1])))
    assert np.abs(np.diff(bearings) - 90.0).max() < 8.0
    square = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]) * 345.0 / CELL_M
    by_hand = coverage(weights, square + (CELLS - 1) / 2.0, RADIUS_CELLS)
    assert found.coverage >= by_hand - 1e-9


def test_discs_that_cannot_be_placed_are_named() -> None:
    with pytest.raises(MissionServiceError, match="0 allowed cells"):
        best_placement(np.ones((4, 4)), np.zeros((4, 4), dtype=bool), 2, 1.0)


@pytest.mark.parametrize(
    ("count", "along_m", "across_m", "side_rad"),
    [(2, 160.0, 160.0, 0.3), (3, 330.0, 330.0, 2.0), (4, 330.0, 330.0, 4.0),
     (4, 500.0, 150.0, 1.0), (6, 330.0, 330.0, 0.0), (8, 330.0, 330.0, 5.0),
     (8, 600.0, 120.0, 0.5), (16, 330.0, 330.0, 3.0),
     pytest.param(32, 330.0, 330.0, 3.0, marks=pytest.mark.long)],
)  # fmt: skip
def test_agents_come_within_four_percent_of_the_best_placement_and_then_stand_still(
    count: int, along_m: float, across_m: float, side_rad: float
) -> None:
    maps = maps_of(ellipse(along_m, across_m, 0.4))
    weights, allowed = weights_of(maps), maps.augmentation == 0
    team = Team(count, side_rad)
    over_fire = over_fire_of(maps)
    for _ in team.fly(maps, 400.0):
        rows, cols = np.floor(places_of(team.agents_m).T + 0.5).astype(int)
        assert not over_fire[rows, cols].any()
    found = coverage(weights, places_of(team.agents_m), RADIUS_CELLS)
    best = best_placement(weights, allowed, count, RADIUS_CELLS, starts=3, kicks=4)
    assert found >= 0.96 * best.coverage
    assert max(moved.max() for moved in team.fly(maps, 200.0)) == 0.0
    apart = np.hypot(*(team.agents_m[:, None] - team.agents_m).T) + 1e9 * np.eye(count)
    assert apart.min() > 100.0


def ring(inner_m: float, outer_m: float) -> NDArray[np.bool_]:
    return ellipse(outer_m, outer_m) & ~ellipse(inner_m, inner_m)


def two_fires(distance_m: float) -> NDArray[np.bool_]:
    """Return two round fires of different sizes, in the northeast and in the southwest."""
    away = round(distance_m / CELL_M / 2.0 * math.sqrt(0.5))
    one, other = ellipse(200.0, 200.0), ellipse(120.0, 120.0)
    return np.roll(one, (away, away), (0, 1)) | np.roll(other, (-away, -away), (0, 1))


def flown(fire: NDArray[np.bool_], count: int) -> tuple[Floats, NDArray[np.bool_], float]:
    """Return the final places of agents, which of them flew over fire, and their coverage.

    The coverage is a share of the coverage of the best places.
    """
    maps, team = maps_of(fire), Team(count, 4.0)
    over_fire, crossed = over_fire_of(maps), np.zeros(count, dtype=np.bool_)
    for _ in team.fly(maps, 400.0):
        rows, cols = np.floor(places_of(team.agents_m).T + 0.5).astype(int)
        crossed |= over_fire[rows, cols]
    weights, allowed = weights_of(maps), maps.augmentation == 0
    best = best_placement(weights, allowed, count, RADIUS_CELLS, starts=3, kicks=4)
    share = coverage(weights, places_of(team.agents_m), RADIUS_CELLS) / best.coverage
    return team.agents_m, crossed, share


def test_agents_cross_a_ring_of_fire_only_to_its_island() -> None:
    agents_m, crossed, share = flown(ellipse(480.0, 480.0) & ~ellipse(340.0, 340.0), 9)
    on_island = np.hypot(*(agents_m - MIDDLE_M).T) < 340.0
    assert on_island.any()
    assert crossed.tolist() == on_island.tolist()
    assert share >= 0.97


def test_agents_distribute_themselves_over_two_fires() -> None:
    away = round(0.5 * 1500.0 / CELL_M * math.sqrt(0.5))
    large = np.roll(ellipse(200.0, 200.0), (away, away), (0, 1))
    small = np.roll(ellipse(120.0, 120.0), (-away, -away), (0, 1))
    _, crossed, share = flown(large | small, 8)
    assert not crossed.any()
    assert share >= 0.97


def test_of_agents_with_the_same_goal_one_keeps_it() -> None:
    maps = maps_of(ellipse(330.0, 330.0))
    movers = [AgentMover(SETTINGS, GRID, key) for key in (1, 2, 3)]
    goals = []
    for tick in range(6):  # all decide at the same time
        places = [mover.goal_m for mover in movers]
        for number, mover in enumerate(movers):
            others = [(*p, k + 1) for k, p in enumerate(places) if p and k != number]
            keyed = np.array(others, dtype=np.float64).reshape(-1, 3)
            mover.velocity(2.0 * tick, MIDDLE_M - 700.0, MIDDLE_M, keyed, maps, STEP_S)
        goals.append([mover.goal_m for mover in movers])
    assert len(set(goals[1])) == 1
    assert len(set(goals[-1])) == 3
    assert goals[-1][0] == goals[1][0]


def test_agents_settle_again_when_the_fire_has_grown() -> None:
    maps = maps_of(ellipse(160.0, 160.0))
    team = Team(4, 1.0)
    moving = 0
    for metres in range(160, 300, 4):  # 24 m a minute
        maps.set(np.flatnonzero(ellipse(metres, metres)), NO_CELLS)
        moving += sum(bool(moved.any()) for moved in team.fly(maps, 10.0))
    rows, cols = np.floor(places_of(team.agents_m).T + 0.5).astype(int)
    assert (maps.augmentation[rows, cols] == 0).all()
    assert moving * STEP_S < 200.0  # the last part of 350 s
    for _ in team.fly(maps, 200.0):
        pass
    weights, allowed = weights_of(maps), maps.augmentation == 0
    best = best_placement(weights, allowed, 4, RADIUS_CELLS, starts=3, kicks=4)
    assert coverage(weights, places_of(team.agents_m), RADIUS_CELLS) >= 0.96 * best.coverage


def test_a_settled_agent_does_not_move_for_a_cell_of_fire() -> None:
    fire = ellipse(330.0, 330.0)
    maps = maps_of(fire)
    team = Team(4, 0.0)
    for _ in team.fly(maps, 400.0):
        pass
    rim = np.flatnonzero(ellipse(330.0 + CELL_M, 330.0) & ~fire)
    maps.set(rim[:1], NO_CELLS)
    assert sum(float(moved.max()) for moved in team.fly(maps, 60.0)) <= 2.0 * CELL_M


def test_an_agent_goes_round_the_fire_never_through_it() -> None:
    """Its only useful place is behind the fire; other agents cover the rest."""
    maps = maps_of(ellipse(100.0, 500.0))
    over_fire = over_fire_of(maps)
    x_m, y_m = MIDDLE_M - 450.0, MIDDLE_M
    others_m = MIDDLE_M + np.array(
        [[-400.0, 500.0], [-400.0, 0.0], [-400.0, -500.0], [0.0, 750.0], [0.0, -750.0]]
    )
    goal, flown_m = None, 0.0
    for tick in range(200):
        if tick % 2 == 0:
            goal = next_goal(tick * STEP_S, x_m, y_m, goal, others_m, maps, GRID, SETTINGS)
        assert goal is not None
        east_m_s, north_m_s = velocity(x_m, y_m, goal, 25.0, STEP_S)
        x_m, y_m = x_m + east_m_s * STEP_S, y_m + north_m_s * STEP_S
        flown_m += math.hypot(east_m_s, north_m_s) * STEP_S
        row, col = GRID.row_col_of(x_m, y_m)
        assert not over_fire[round(row), round(col)]
    assert x_m > MIDDLE_M + 200.0
    assert flown_m > 1200.0


def test_only_outside_the_map_the_rule_leaves_an_agent_to_the_forces() -> None:
    maps = maps_of(ellipse(700.0, 700.0))
    no_others = np.empty((0, 3))

    def asked(x_m: float, y_m: float) -> object:
        place_m = (MIDDLE_M + x_m, MIDDLE_M + y_m)
        return next_goal(0.0, *place_m, None, np.empty((0, 2)), maps, GRID, SETTINGS)

    assert asked(-1390.0, 1390.0) is not None
    assert asked(0.0, 0.0) is not None
    assert asked(0.0, 99999.0) is None
    assert asked(-600.0, 0.0) is not None  # in the fire, near its edge
    assert asked(-1000.0, 0.0) is not None
    mover = AgentMover(SETTINGS, GRID, 0)
    assert mover.velocity(0.0, -50.0, 50.0, no_others, maps, STEP_S)[0] > 1.0
    assert mover.goal is None
    nothing = maps_of(np.zeros(GRID.shape, dtype=bool))
    assert mover.velocity(1.0, 50.0, 50.0, no_others, nothing, STEP_S) == (0.0, 0.0)


def test_a_standing_vehicle_does_not_give_way_to_one_that_passes() -> None:
    maps = maps_of(ellipse(330.0, 330.0))
    team = Team(4, 0.0)
    for _ in team.fly(maps, 400.0):
        pass
    mover, (x_m, y_m) = team.movers[0], team.agents_m[0]
    stays = mover.goal
    assert stays is not None
    goals = set()
    for tick in range(40):  # 25 m/s, 20 m beside it
        passing = np.vstack([team.others(0), [x_m - 500.0 + 25.0 * tick, y_m + 20.0, 9.0]])
        at_s = team.time_s + tick
        mover.velocity(at_s, x_m, y_m, passing, maps, STEP_S)
        goals.add((mover.goal.x_m, mover.goal.y_m))  # type: ignore[union-attr]
    assert goals == {(stays.x_m, stays.y_m)}
