"""The paper's virtual forces (eqs. 5 to 13), each alone and all together."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from mission_service.experiments.virtual_agents.rollout_kernels import unroll
from mission_service.guidance.formation.settings import Constants, Settings
from mission_service.guidance.formation.virtual_forces_kernels import (
    NAMES,
    constants_array,
    in_local_minimum,
    is_set,
    tie_rad,
    velocity_of_forces,
)

CELLS, CELL_M = 200, 10.0
MIDDLE_M = CELLS * CELL_M / 2.0
PLAIN = Constants(c1=2.0, c2=15.0, c3=1.0, c4=18.0, c5=5.0, e3=1.0, t1=1.0, t2=8.0)
SPACING_M = Settings().spacing_m
ROW, COL = np.mgrid[:CELLS, :CELLS]
AWAY_M = CELL_M * np.hypot(ROW - CELLS / 2 + 0.5, COL - CELLS / 2 + 0.5)
AUGMENTATION = (AWAY_M <= 200.0).astype(np.uint8)
AREA = (AWAY_M <= 700.0).astype(np.uint8)


def velocity(
    x_m: float,
    y_m: float,
    others_m: list[tuple[float, float]] | None = None,
    constants: Constants = PLAIN,
    tie: float = 0.5,
) -> tuple[float, float]:
    """Return the velocity of an agent at a place from the centre of a round fire, among others."""
    others = MIDDLE_M + np.array(others_m or [], dtype=np.float64).reshape(-1, 2)
    found = velocity_of_forces(
        MIDDLE_M + x_m, MIDDLE_M + y_m, others[:, 0].copy(), others[:, 1].copy(),
        MIDDLE_M, MIDDLE_M, AUGMENTATION, AREA, 0.0, CELLS * CELL_M, CELL_M,
        constants_array(constants), SPACING_M, 25.0, tie,
    )  # fmt: skip
    return float(found[0]), float(found[1])


def test_constants_go_to_an_array_in_their_order() -> None:
    constants = Constants(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
    assert [getattr(constants, name) for name in NAMES] == constants_array(constants).tolist()


def test_a_far_agent_is_drawn_to_the_centre_with_c2_and_one_in_the_area_with_c1() -> None:
    assert velocity(-800.0, 0.0) == pytest.approx((15.0, 0.0))  # eq. 5
    assert velocity(0.0, 500.0) == pytest.approx((0.0, -2.0))
    # Places off the map are not in the area.
    assert velocity(-5000.0, 0.0) == pytest.approx((15.0, 0.0))


def test_in_the_augmentation_it_is_pushed_out_with_c4() -> None:
    assert velocity(100.0, 0.0) == pytest.approx((16.0, 0.0))  # eq. 9: 18 cells outside, 2 inside


def test_others_push_with_the_power_of_the_overlap_in_cells_of_ten_metres() -> None:
    near_m = SPACING_M - 30.0  # three of the paper's cells too near
    cubic = Constants(c1=2.0, c2=15.0, c3=0.5, c4=18.0, c5=5.0, e3=2.0, t1=1.0, t2=8.0)
    east, north = velocity(0.0, 500.0, [(near_m, 500.0)], cubic)
    assert (east, north) == pytest.approx((-0.5 * 3.0**2, -2.0))  # eqs. 6, 7
    assert velocity(0.0, 500.0, [(SPACING_M, 500.0)], cubic) == pytest.approx((0.0, -2.0))
    # The square root of a negative overlap would be NaN.
    root = Constants(c1=2.0, c3=1.0, e3=0.5, t1=0.0)
    assert velocity(0.0, 500.0, [(near_m, 500.0)], root)[0] == pytest.approx(-math.sqrt(3.0))


def test_the_velocity_is_capped_and_keeps_its_direction() -> None:
    east, north = velocity(-300.0, 500.0, [(-310.0, 500.0)])
    assert math.hypot(east, north) == pytest.approx(25.0)
    assert east > 24.0
    assert north < 0.0


def test_weak_forces_are_ignored() -> None:
    weak = Constants(c1=0.9, t1=1.0)
    assert velocity(0.0, 500.0, constants=weak) == (0.0, 0.0)
    assert velocity(0.0, 500.0, constants=Constants(c1=1.1, t1=1.0)) != (0.0, 0.0)


def test_out_of_a_local_minimum_it_goes_anticlockwise_around_the_fire() -> None:
    # An agent between it and the fire repels with 12 cells, and the fire attracts equally.
    stuck = Constants(c1=12.0, c3=1.0, e3=1.0, c5=5.0, t1=1.0, t2=8.0)
    other = (300.0 - SPACING_M + 120.0, 0.0)
    assert velocity(300.0, 0.0, [other], stuck) == pytest.approx((0.0, 5.0))  # eq. 13
    other_west = (-other[0], 0.0)
    assert velocity(-300.0, 0.0, [other_west], stuck) == pytest.approx((0.0, -5.0))
    patient = Constants(c1=12.0, c3=1.0, e3=1.0, c5=5.0, t1=1.0, t2=13.0)
    assert velocity(300.0, 0.0, [other], patient) == (0.0, 0.0)
    assert in_local_minimum(0.5, 9.0, constants_array(PLAIN))
    assert not in_local_minimum(1.5, 9.0, constants_array(PLAIN))


def test_two_at_one_place_and_one_at_the_centre_get_away() -> None:
    fix = (300.0, 300.0)
    first = velocity(*fix, [fix], tie=tie_rad(0))
    second = velocity(*fix, [fix], tie=tie_rad(1))
    assert np.isfinite([*first, *second]).all()
    assert math.dist(first, second) > 10.0
    out = velocity(0.0, 0.0, tie=math.pi / 2.0)
    assert out == pytest.approx((0.0, 16.0), abs=1e-9)


def test_ties_differ() -> None:
    ties = np.sort([tie_rad(number) for number in range(64)])
    assert np.diff(ties).min() > 0.03


def test_maps_are_looked_up_by_cell_with_row_0_in_the_north() -> None:
    bitmap = np.zeros((3, 4), dtype=np.uint16)
    bitmap[0, 3] = 7
    assert is_set(bitmap, 135.0, 525.0, 100.0, 530.0, 10.0)
    for x_m, y_m in ((125.0, 525.0), (135.0, 515.0), (141.0, 525.0), (135.0, 531.0)):
        assert not is_set(bitmap, x_m, y_m, 100.0, 530.0, 10.0)


def unrolled(agents_m: NDArray[np.float64], steps: int) -> int:
    danger = (AWAY_M <= 100.0).astype(np.uint8)
    n = agents_m.shape[1]
    return int(
        unroll(
            agents_m, np.empty_like(agents_m), steps, 1.0,
            np.array([tie_rad(k) for k in range(n)]), MIDDLE_M, MIDDLE_M,
            AUGMENTATION, AREA, danger, 0.0, CELLS * CELL_M, CELL_M,
            constants_array(PLAIN), SPACING_M, 25.0,
        )
    )  # fmt: skip


def test_a_team_comes_and_spreads_and_none_goes_where_it_burns() -> None:
    agents_m = np.array([[100.0, 100.0, 100.0, 100.0], [800.0, 900.0, 1000.0, 1100.0]])
    assert unrolled(agents_m, 600) == 0
    away = np.hypot(agents_m[0] - MIDDLE_M, agents_m[1] - MIDDLE_M)
    assert (away > 170.0).all()
    assert (away < 600.0).all()
    apart = np.hypot(*(agents_m[:, :, None] - agents_m[:, None, :])) + 1e9 * np.eye(4)
    assert apart.min() > 250.0


def test_steps_too_near_to_the_fire_are_counted() -> None:
    agents_m = np.array([[MIDDLE_M, 100.0], [MIDDLE_M + 10.0, 800.0]])
    assert unrolled(agents_m.copy(), 20) == 5  # 16 m/s at a distance from 10 m to more than 100 m
    assert unrolled(agents_m, 3) == 3
