"""Circling around a virtual agent (eqs. 14, 15): the ideal fixed wing and its predicted path."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from mission_service.guidance.formation import loiter_kernels as loiter
from tests.service.formation_worlds import orbit_step

BANK = 0.7
STEP_S = 0.25


def fly(
    state: tuple[float, float, float, float],
    orbit: tuple[float, float, float, float],
    wind: tuple[float, float],
    seconds: float,
    step_s: float = STEP_S,
) -> NDArray[np.float64]:
    """Return the states (n, 4), from the first one on."""
    states = [state]
    for _ in range(round(seconds / step_s)):
        states.append(orbit_step(*states[-1], *orbit, *wind, step_s, BANK))
    return np.array(states)


def wanted_course_rad(x_m: float, y_m: float, *orbit: float) -> float:
    """Return the course of eq. 15 without wind."""
    aim_x, aim_y = loiter._aim(x_m, y_m, 1.0, 0.0, 17.5, *orbit, 0.0, 0.0, 0.0)
    return math.atan2(aim_y, aim_x)


def test_the_law_points_at_the_agent_from_afar_and_along_the_circle_on_it() -> None:
    east = (1e7, 0.0, 0.0, 0.0)  # position of the agent
    assert wanted_course_rad(*east, -150.0) == pytest.approx(math.pi, abs=1e-3)
    assert wanted_course_rad(150.0, 0.0, 0.0, 0.0, -150.0) == pytest.approx(math.pi / 2)
    assert wanted_course_rad(150.0, 0.0, 0.0, 0.0, 150.0) == pytest.approx(-math.pi / 2)
    assert wanted_course_rad(0.0, -150.0, 0.0, 0.0, -150.0) == pytest.approx(0.0)
    assert wanted_course_rad(1e-6, 0.0, 0.0, 0.0, -150.0) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("radius_m", [-150.0, 150.0, -100.0])
@pytest.mark.parametrize("wind", [(0.0, 0.0), (8.75, 0.0), (-5.0, 7.0)])
@pytest.mark.parametrize("airspeed_m_s", [17.5, 10.5])
def test_the_circle_flown_has_the_radius_asked_for(
    radius_m: float, wind: tuple[float, float], airspeed_m_s: float
) -> None:
    wind = (wind[0] * airspeed_m_s / 17.5, wind[1] * airspeed_m_s / 17.5)
    states = fly(
        (500.0, -300.0, 1.0, airspeed_m_s), (20.0, 10.0, radius_m, airspeed_m_s), wind, 400.0
    )
    x, y = states[800:, 0] - 20.0, states[800:, 1] - 10.0
    assert np.hypot(x, y) == pytest.approx(abs(radius_m), rel=0.01)
    turned = np.diff(np.unwrap(np.arctan2(y, x)))
    assert np.all(turned * radius_m < 0.0)  # negative means anticlockwise everywhere
    assert states[:, 3] == pytest.approx(airspeed_m_s)


def test_no_turn_is_tighter_than_the_bank_allows() -> None:
    states = fly((400.0, 50.0, 0.3, 17.5), (0.0, 0.0, -150.0, 17.5), (6.0, -6.0), 120.0)
    turned = np.abs(np.angle(np.exp(1j * np.diff(states[:, 2]))))
    most = 9.80665 * math.tan(BANK) / 17.5 * STEP_S
    assert turned.max() == pytest.approx(most)
    ground = np.hypot(*np.diff(states[:, :2], axis=0).T) / STEP_S
    assert ground.max() < 17.5 + math.hypot(6.0, 6.0) + 1e-6


def test_speed_changes_take_time() -> None:
    states = fly((150.0, 0.0, 1.57, 17.5), (0.0, 0.0, -150.0, 25.0), (0.0, 0.0), 10.0)
    assert states[4, 3] == pytest.approx(17.5 + loiter.ACCELERATION_M_S2)
    assert states[-1, 3] == pytest.approx(25.0)


def test_an_agent_inside_the_turning_circle_is_not_circled_the_wrong_way_for_ever() -> None:
    """By eq. 14 it would be circled in the wrong direction: 30 m to the right, turn radius 37 m."""
    states = fly((0.0, 0.0, 0.0, 17.5), (0.0, -30.0, -150.0, 17.5), (0.0, 0.0), 60.0)
    assert math.hypot(states[-1, 0], states[-1, 1] + 30.0) == pytest.approx(150.0, rel=0.02)


def test_a_vehicle_that_must_turn_about_turns_the_way_of_the_orbit() -> None:
    # The law gives a course of about 0, which leads outwards.
    for heading_rad in (math.pi - 0.2, math.pi + 0.2):
        state = (10.0, 0.0, heading_rad, 17.5)
        anticlockwise = orbit_step(*state, 0.0, 0.0, -150.0, 17.5, 0.0, 0.0, STEP_S, BANK)
        clockwise = orbit_step(*state, 0.0, 0.0, 150.0, 17.5, 0.0, 0.0, STEP_S, BANK)
        assert math.sin(anticlockwise[2] - heading_rad) > 0.1
        assert math.sin(clockwise[2] - heading_rad) < -0.1


@pytest.mark.parametrize(
    "orbit", [(0.0, 0.0, -150.0, 17.5), (-300.0, 200.0, 60.0, 12.0), (500.0, 0.0, -150.0, 25.0)]
)
@pytest.mark.parametrize("wind", [(0.0, 0.0), (5.0, -5.0)])
def test_the_path_ahead_is_the_one_flown(
    orbit: tuple[float, float, float, float], wind: tuple[float, float]
) -> None:
    state = (300.0, 50.0, 2.5, 17.5)
    flown = fly(state, orbit, wind, 50.0)
    path_m = np.empty((200, 2))
    loiter.predict_path(*state, *orbit, *wind, BANK, STEP_S, STEP_S, path_m)
    assert path_m == pytest.approx(flown[1:, :2], abs=0.2)
    coarse_m = np.empty((50, 2))  # the prediction that avoidance uses
    loiter.predict_path(*state, *orbit, *wind, BANK, 0.0, 1.0, coarse_m)
    assert np.hypot(*(coarse_m - flown[:200:4, :2]).T).max() < 6.0


def test_an_old_state_is_extrapolated_to_now() -> None:
    state, orbit, wind = (300.0, 50.0, 2.5, 17.5), (0.0, 0.0, -150.0, 14.0), (3.0, 0.0)
    now = fly(state, orbit, wind, 1.5)[-1]
    late_m, fresh_m = np.empty((40, 2)), np.empty((40, 2))
    loiter.predict_path(*state, *orbit, *wind, BANK, 1.5, 1.0, late_m)
    loiter.predict_path(*now, *orbit, *wind, BANK, 0.0, 1.0, fresh_m)
    assert late_m == pytest.approx(fresh_m, abs=3.0)
    assert np.hypot(*(fresh_m[0] - now[:2])) == 0.0


def test_near_ties_between_left_and_right_are_detected() -> None:
    orbit = (0.0, 0.0, -150.0, 0.0, 0.0)
    course_rad = wanted_course_rad(20.0, 0.0, *orbit[:3])
    about_rad = math.acos(loiter.ABOUT)
    assert loiter.at_fork(20.0, 0.0, course_rad + about_rad, 17.5, *orbit)
    # The turn is to the left in any case.
    assert not loiter.at_fork(20.0, 0.0, course_rad - about_rad, 17.5, *orbit)
    assert not loiter.at_fork(20.0, 0.0, course_rad + math.pi, 17.5, *orbit)
    assert not loiter.at_fork(20.0, 0.0, course_rad + 1.0, 17.5, *orbit)
