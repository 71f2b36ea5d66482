"""Local maps of a UAV and the monitoring area: incremental updates equal new computations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from mission_service.errors import MissionServiceError
from mission_service.experiments.virtual_agents.camera_footprint import mark_seen
from mission_service.experiments.virtual_agents.monitoring import MonitoringArea, inaccuracy_cells
from mission_service.guidance.formation.agent_maps import AgentMaps, disc, no_counts
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.settings import Settings

ROWS, COLS = 40, 55
GRID = MapGrid(ROWS, COLS, 10.0, 1000.0, 5000.0)
NONE = np.empty(0, dtype=np.int64)
CELLS = st.lists(st.integers(0, ROWS * COLS - 1), max_size=8).map(
    lambda cells: np.array(cells, dtype=np.int64)
)


def distance_m(fire: np.ndarray, cell_m: float) -> np.ndarray:
    """Return the distance from each cell to the nearest burning cell; infinity without fire."""
    if not fire.any():
        return np.full(fire.shape, np.inf)
    far: np.ndarray = distance_transform_edt(~fire) * cell_m
    return far


@given(
    st.lists(st.tuples(CELLS, CELLS), max_size=8),
    st.sampled_from([(10.0, 160.0, 652.8), (30.0, 160.0, 300.0), (7.0, 0.0, 63.0)]),
)
def test_maps_kept_step_by_step_are_those_from_scratch(
    steps: list[tuple[np.ndarray, np.ndarray]], lengths: tuple[float, float, float]
) -> None:
    cell_m, near_m, far_m = lengths
    maps = AgentMaps((ROWS, COLS), cell_m, near_m, far_m)
    fire = np.zeros((ROWS, COLS), dtype=np.bool_)
    for on, off in steps:
        maps.set(on, off)
        fire.ravel()[on] = True
        fire.ravel()[off] = False
    assert np.array_equal(maps.fire, fire)
    away_m = distance_m(fire, cell_m)
    assert np.array_equal(maps.augmentation > 0, away_m <= near_m + 1e-6)
    assert np.array_equal(maps.area > 0, away_m <= far_m + 1e-6)
    assert maps.sums[0] == fire.sum()
    if fire.any():
        assert maps.centre_row_col == pytest.approx(np.argwhere(fire).mean(axis=0))
    else:
        assert maps.centre_row_col is None


def test_counts_are_of_all_cells_in_reach_and_there_is_room_for_them() -> None:
    middle = np.hypot(*(np.indices((60, 60)) - 30))
    maps = AgentMaps((60, 60), 1.0, 2.0, 25.0)
    maps.set(np.arange(3600), NONE)
    assert maps.area[30, 30] == (middle <= 25.0).sum()
    assert maps.augmentation[30, 30] == 13
    maps.set(NONE, np.arange(30 * 60))
    assert maps.area[30, 30] == (middle <= 25.0)[30:].sum()
    for reach in (16.0, 144.0, 145.0, 300.0):
        half_widths = disc(reach)
        most = (2 * half_widths + 1).sum()
        assert most == pytest.approx(np.pi * reach * reach, rel=0.02)
        assert np.iinfo(no_counts((3, 3), half_widths).dtype).max >= most


def test_a_cell_off_the_map_is_an_error_that_names_it_and_changes_nothing() -> None:
    maps = AgentMaps((ROWS, COLS), 10.0, 160.0, 300.0)
    for cell in (ROWS * COLS, -1):
        with pytest.raises(MissionServiceError, match=f"cell {cell} is not on a map of 40 x 55"):
            maps.set(np.array([3, cell]), NONE)
    assert not maps.fire.any()


def growing(seed: int) -> np.ndarray:
    """Return the arrival times in s (y, x) of a fire that grows from the middle."""
    rows, cols = np.indices((ROWS, COLS))
    noise = np.random.default_rng(seed).random((ROWS, COLS))
    arrival: np.ndarray = np.hypot(rows - 18, cols - 30) * 10.0 + 20.0 * noise
    return arrival


def test_priorities_follow_the_fire_as_it_grows() -> None:
    arrival_s = growing(1)
    area = MonitoringArea(GRID, 50.0, 120.0)
    assert not area.priority.any()
    for at_s in (15.0, 30.0, 31.0, 80.0, 160.0):
        area.burn(arrival_s, at_s)
        fire = arrival_s <= at_s
        away_m = distance_m(fire, 10.0)
        expected = np.where(away_m <= 50.0, 1.0, np.where(away_m <= 120.0, 0.2, 0.0))
        expected[fire] = 0.0
        assert np.array_equal(area.priority, expected)
        assert np.array_equal(area.cells, np.flatnonzero(expected))
        assert np.array_equal(area.priorities, expected[expected > 0.0])


def test_agent_coverage_is_the_share_of_priorities_in_reach_of_any_agent() -> None:
    area = MonitoringArea(GRID, 50.0, 120.0)
    area.burn(growing(2), 40.0)
    agents_m = np.array([GRID.xy_of(10.0, 30.0), GRID.xy_of(12.5, 31.0), GRID.xy_of(500.0, 0.0)])
    rows, cols = np.indices((ROWS, COLS))
    in_reach = np.zeros((ROWS, COLS), dtype=np.bool_)
    for x_m, y_m in agents_m:
        row, col = GRID.row_col_of(x_m, y_m)
        in_reach |= np.hypot(rows - row, cols - col) * 10.0 <= 90.0
    expected = area.priority[in_reach].sum() / area.priority.sum()
    assert 0.1 < expected < 0.9
    assert area.agent_coverage(agents_m, 90.0) == pytest.approx(expected)
    assert area.agent_coverage(agents_m, 1e4) == pytest.approx(1.0)
    assert MonitoringArea(GRID, 50.0, 120.0).agent_coverage(agents_m, 90.0) == 0.0


def test_what_was_seen_counts_for_a_minute() -> None:
    area = MonitoringArea(GRID, 50.0, 120.0)
    area.burn(growing(3), 40.0)
    seen_s = np.full((ROWS, COLS), -np.inf)
    x_m, y_m = GRID.xy_of(12.0, 30.0)
    mark_seen(GRID, (x_m, y_m, 0.0, 50.0, 80.0), seen_s, 100.0)
    expected = area.priority[7:18, 22:39].sum() / area.priority.sum()
    assert 0.1 < expected < 0.9
    assert area.seen_coverage(seen_s, 130.0) == pytest.approx(expected)
    assert area.seen_coverage(seen_s, 160.0) == pytest.approx(expected)
    assert area.seen_coverage(seen_s, 160.5) == 0.0


def test_efficiency_is_the_union_of_what_is_seen_over_the_sum() -> None:
    area = MonitoringArea(GRID, 50.0, 120.0)
    assert area.efficiency([]) == 1.0
    area.burn(growing(4), 40.0)
    fix = (*GRID.xy_of(12.0, 30.0), 0.3, 50.0, 80.0)
    far = (*GRID.xy_of(-100.0, 30.0), 0.3, 50.0, 80.0)
    aside = (*GRID.xy_of(28.0, 30.0), 0.3, 50.0, 80.0)
    assert area.efficiency([far]) == 1.0
    assert area.efficiency([fix, far]) == 1.0
    assert area.efficiency([fix, fix, fix, fix]) == pytest.approx(0.25)
    assert area.efficiency([fix, aside]) == 1.0
    one = (*GRID.xy_of(12.0, 26.0), 0.0, 50.0, 50.0)  # rows 7-17, columns 21-31
    other = (*GRID.xy_of(14.0, 30.0), 0.0, 50.0, 50.0)  # rows 9-19, columns 25-35
    total = area.priority[7:18, 21:32].sum() + area.priority[9:20, 25:36].sum()
    assert area.efficiency([one, other]) == pytest.approx(
        1.0 - area.priority[9:18, 25:32].sum() / total
    )


def test_inaccuracy_is_the_mean_of_wrong_cells() -> None:
    fire = growing(5) < 50.0
    wrong = fire.copy()
    wrong[0, :3] = True
    wrong[18, 30] = False
    assert inaccuracy_cells(fire, [fire, wrong]) == 2.0


def test_defaults_of_the_paper_give_its_reaches() -> None:
    paper = Settings()
    maps = AgentMaps((200, 200), 10.0, paper.augmentation_m(10.0), paper.agent_area_m)
    maps.set(np.array([100 * 200 + 100]), NONE)
    assert np.flatnonzero(maps.augmentation[100]).tolist() == list(range(84, 117))
    assert np.flatnonzero(maps.area[:, 100]).tolist() == list(range(33, 168))  # 673.2 m
