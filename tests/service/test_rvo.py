"""Reciprocal velocity obstacles: the paper's avoidance."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from mission_service.experiments.virtual_agents import rvo_kernels as rvo
from mission_service.guidance.formation import peer_table as peers

APART_M, NEIGHBOURHOOD_M = 60.0, 500.0


def row(x_m: float, y_m: float, vx: float, vy: float, age_s: float = 0.0) -> NDArray[np.float64]:
    numbers = np.zeros(peers.COLUMNS)
    numbers[[peers.X, peers.Y, peers.VX, peers.VY, peers.AGE_S]] = x_m, y_m, vx, vy, age_s
    return numbers


def conflict(velocity: tuple[float, float], *others: NDArray[np.float64]) -> bool:
    """Return the conflict of a vehicle at the origin that flies east at 20 m/s."""
    found: bool = rvo.in_conflict(
        0.0, 0.0, 20.0, 0.0, *velocity, np.array(others), APART_M, NEIGHBOURHOOD_M
    )
    return found


def test_when_two_meet() -> None:
    assert rvo.meets_after_s(300.0, 0.0, 30.0, 0.0, 60.0) == pytest.approx(8.0)
    assert rvo.meets_after_s(300.0, 59.0, 30.0, 0.0, 60.0) < 10.0
    assert rvo.meets_after_s(300.0, 61.0, 30.0, 0.0, 60.0) == np.inf
    assert rvo.meets_after_s(300.0, 0.0, -30.0, 0.0, 60.0) == np.inf
    assert rvo.meets_after_s(50.0, 0.0, 30.0, 0.0, 60.0) == 0.0  # too near, and approaching
    assert rvo.meets_after_s(50.0, 0.0, -30.0, 0.0, 60.0) == np.inf


def test_conflicts() -> None:
    assert conflict((20.0, 0.0), row(300.0, 0.0, -20.0, 0.0))
    assert not conflict((20.0, 0.0), row(300.0, 0.0, 25.0, 0.0))  # faster, ahead
    assert not conflict((20.0, 0.0), row(600.0, 0.0, -20.0, 0.0))  # no neighbour
    assert conflict((20.0, 0.0), row(540.0, 0.0, -20.0, 0.0, 3.0))  # it is now a neighbour


def test_each_takes_half_of_the_way_out() -> None:
    """Head-on at 300 m: the relative velocity must turn by asin(60 / 300) = 11.5 degrees.

    2 v' - v_A - v_B is (40 cos a, 40 sin a) here; a vehicle that turns alone must turn by twice as
    much.
    """
    other = row(300.0, 0.0, -20.0, 0.0)
    heading_rad, was = rvo.clear_heading_rad(
        0.0, 0.0, 20.0, 0.0, 0.0, 20.0, 0.0, 0.0, other[None], APART_M, NEIGHBOURHOOD_M
    )
    assert was
    assert abs(heading_rad) == pytest.approx(math.asin(0.2), abs=rvo.YAW_STEP_RAD)
    alone_rad = 2.0 * math.asin(0.2)
    assert rvo.meets_after_s(
        300.0, 0.0, 20.0 * math.cos(alone_rad) + 20.0, 20.0 * math.sin(alone_rad), APART_M
    ) == np.inf  # fmt: skip
    assert not conflict((20.0 * math.cos(heading_rad), 20.0 * math.sin(heading_rad)), other)
    # 7° for the own velocity, but 14° if the other vehicle turns equally.
    assert rvo.meets_after_s(300.0, 0.0, 20.0 + 20.0, 5.0, APART_M) < np.inf
    assert not conflict((20.0, 5.0), other)
    assert conflict((20.0, 3.0), other)


def test_a_clear_heading_is_left_alone_and_the_nearest_is_taken() -> None:
    other = row(300.0, 100.0, -20.0, 0.0)
    same, was = rvo.clear_heading_rad(
        0.0, 0.0, 20.0, 0.0, 2.0, 20.0, 0.0, 0.0, other[None], APART_M, NEIGHBOURHOOD_M
    )
    assert (same, was) == (2.0, False)
    away, was = rvo.clear_heading_rad(
        0.0, 0.0, 20.0, 0.0, 0.15, 20.0, 0.0, 0.0, other[None], APART_M, NEIGHBOURHOOD_M
    )
    assert was
    assert away < 0.15  # the other is on the left


def test_surrounded_it_takes_what_meets_last() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    others = np.array(
        [
            row(d * math.cos(a), d * math.sin(a), -20.0 * math.cos(a), -20.0 * math.sin(a))
            for a in angles
            for d in (400.0 if abs(a - np.pi) < 0.1 else 100.0,)
        ]
    )
    heading_rad, was = rvo.clear_heading_rad(
        0.0, 0.0, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0, others, APART_M, NEIGHBOURHOOD_M
    )
    assert was
    assert abs(abs(heading_rad) - math.pi) < 0.3


def test_in_wind_velocities_are_over_the_ground() -> None:
    """Both have the same crab angle: a conflict in still air is a conflict in moving air."""
    other = row(300.0, 0.0, -20.0, 8.0)
    heading_rad, was = rvo.clear_heading_rad(
        0.0, 0.0, 20.0, 8.0, 0.0, 20.0, 0.0, 8.0, other[None], APART_M, NEIGHBOURHOOD_M
    )
    assert was
    assert abs(heading_rad) == pytest.approx(math.asin(0.2), abs=rvo.YAW_STEP_RAD)
