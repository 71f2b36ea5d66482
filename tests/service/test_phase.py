"""Phases (eqs. 16 to 18): a vehicle that is ahead slows down until all phases are equal."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from mission_service.guidance.formation import orbit_phase_kernels as phase
from mission_service.guidance.formation import peer_table as peers
from mission_service.guidance.formation.settings import Airframe
from tests.service.formation_worlds import orbit_step

FRAME = Airframe()
LIMITS = (FRAME.min_airspeed_m_s, FRAME.max_airspeed_m_s)


def row(
    angle_rad: float,
    x_m: float = 0.0,
    y_m: float = 0.0,
    key: int = 1,
    age_s: float = 0.0,
    at_m: float = 150.0,
) -> NDArray[np.float64]:
    """Return one row: a peer on (or off) an anticlockwise orbit around a place, at 15 m/s."""
    numbers = np.zeros(peers.COLUMNS)
    numbers[[peers.X, peers.Y]] = x_m + at_m * math.cos(angle_rad), y_m + at_m * math.sin(angle_rad)
    numbers[[peers.VX, peers.VY]] = -15.0 * math.sin(angle_rad), 15.0 * math.cos(angle_rad)
    numbers[[peers.ORBIT_X, peers.ORBIT_Y]] = x_m, y_m
    numbers[[peers.RADIUS, peers.AGE_S, peers.KEY]] = -150.0, age_s, key
    return numbers


def ahead(angle_rad: float, *others: NDArray[np.float64], key: int = 5) -> float:
    x_m, y_m = 150.0 * math.cos(angle_rad), 150.0 * math.sin(angle_rad)
    found: float = phase.ahead_of_others_rad(
        x_m, y_m, 0.0, 0.0, -150.0, key, np.array(others).reshape(-1, peers.COLUMNS), 2000.0
    )
    return found


def test_thrust_is_07_in_phase_and_within_its_bounds() -> None:
    assert phase.thrust_share(0.0) == pytest.approx(0.7)
    assert phase.thrust_share(1.0) == pytest.approx(0.7 + 0.6 * (1 / (1 + math.exp(2.3)) - 0.5))
    assert 0.4 <= phase.thrust_share(math.pi) < 0.41
    assert 0.99 < phase.thrust_share(-math.pi) <= 1.0


def test_shares_of_thrust_are_airspeeds_of_the_airframe() -> None:
    assert phase.airspeed_of_share_m_s(0.7, *LIMITS, 0.0) == pytest.approx(FRAME.cruise_m_s)
    assert phase.airspeed_of_share_m_s(0.4, *LIMITS, 0.0) == pytest.approx(10.0)
    assert phase.airspeed_of_share_m_s(1.0, *LIMITS, 0.0) == pytest.approx(25.0)
    assert phase.airspeed_of_share_m_s(0.4, 14.0, 25.0, 0.0) == pytest.approx(14.0)
    # In wind no vehicle is blown backwards, within the limits of the airframe.
    assert phase.airspeed_of_share_m_s(0.4, *LIMITS, 12.0) == pytest.approx(14.0)
    assert phase.airspeed_of_share_m_s(0.4, *LIMITS, 40.0) == pytest.approx(25.0)


def test_the_mean_is_taken_on_the_circle() -> None:
    assert ahead(0.1, row(-0.2), row(0.2, 400.0)) == pytest.approx(0.1)
    assert ahead(3.1, row(-3.1), row(3.0, 400.0)) == pytest.approx(3.1 - (math.pi - 0.05), abs=0.02)
    assert ahead(0.3) == 0.0


def test_phases_without_a_mean_go_by_the_lowest_key() -> None:
    """Otherwise rounding would decide which vehicle is ahead of a mean that lies opposite."""
    quarter = math.pi / 2.0
    others = [row(number * quarter, 300.0 * number, key=3 + number) for number in (1, 2, 3)]
    assert ahead(0.0, *others, key=9) == pytest.approx(-quarter)
    assert ahead(0.0, *others, key=1) == pytest.approx(0.0)


def test_states_are_extrapolated_and_a_vehicle_off_its_orbit_does_not_count() -> None:
    assert ahead(0.0, row(0.0, age_s=2.0)) == pytest.approx(-0.2)
    assert ahead(0.0, row(1.0, at_m=500.0), row(0.5, 300.0)) == pytest.approx(-0.5)
    assert ahead(0.0, row(1.0, 5000.0), row(0.5, 300.0)) == pytest.approx(-0.5)  # out of range
    off = phase.ahead_of_others_rad(400.0, 0.0, 0.0, 0.0, -150.0, 5, row(1.0)[None], 2000.0)
    assert off == 0.0


def test_clockwise_the_one_ahead_has_the_smaller_angle() -> None:
    other = row(0.0)
    other[peers.RADIUS] = 150.0
    found = phase.ahead_of_others_rad(
        150.0 * math.cos(-0.3), 150.0 * math.sin(-0.3), 0.0, 0.0, 150.0, 5, other[None], 2000.0
    )
    assert found == pytest.approx(0.3)


def synchronised_rad(
    angles: NDArray[np.float64],
    range_m: float,
    wind: tuple[float, float] = (0.0, 0.0),
    until_s: float = 240.0,
) -> float:
    """Return the largest final distance from the mean phase, for vehicles on a ring of orbits."""
    count = len(angles)
    turn = 2.0 * np.pi * np.arange(count) / count
    size_m = 300.0 / (2.0 * math.sin(math.pi / count))
    middles = np.stack([size_m * np.cos(turn), size_m * np.sin(turn)], axis=1)
    states = [
        (mx + 150.0 * math.cos(a), my + 150.0 * math.sin(a), a + math.pi / 2.0, 17.5)
        for (mx, my), a in zip(middles, angles, strict=True)
    ]
    for _ in range(int(until_s / 0.5)):
        rows = np.array(
            [
                row(0.0, middle[0], middle[1], number + 1)
                for number, middle in enumerate(middles)
            ]
        )  # fmt: skip
        for number, (x_m, y_m, heading_rad, airspeed_m_s) in enumerate(states):
            rows[number, [peers.X, peers.Y]] = x_m, y_m
            rows[number, peers.VX] = airspeed_m_s * math.cos(heading_rad) + wind[0]
            rows[number, peers.VY] = airspeed_m_s * math.sin(heading_rad) + wind[1]
        for number, state in enumerate(states):
            airspeed_m_s = phase.airspeed_in_phase_m_s(
                state[0], state[1], *middles[number], -150.0, number + 1,
                np.delete(rows, number, axis=0), range_m, *LIMITS, math.hypot(*wind),
            )  # fmt: skip
            assert math.hypot(*wind) < airspeed_m_s <= FRAME.max_airspeed_m_s
            for _ in range(2):
                state = orbit_step(
                    *state, *middles[number], -150.0, airspeed_m_s, *wind, 0.25, FRAME.bank_rad
                )
            states[number] = state
    places = np.array(states)[:, :2] - middles
    unit = np.exp(1j * np.arctan2(places[:, 1], places[:, 0]))
    return float(np.max(np.abs(np.angle(unit / unit.mean()))))


FIVE_DEGREES = math.radians(5.0)


def test_eight_from_anywhere_come_into_phase() -> None:
    angles = np.random.default_rng(3).uniform(-np.pi, np.pi, 8)
    assert synchronised_rad(angles, 2000.0) < FIVE_DEGREES


@pytest.mark.parametrize("wound", [1, 2, 3])
def test_phases_wound_round_a_ring_come_undone(wound: int) -> None:
    angles = wound * 2.0 * np.pi * np.arange(8) / 8
    assert synchronised_rad(angles, 2000.0) < FIVE_DEGREES


def test_phases_wound_once_stay_so_if_all_look_at_the_next_ones_only() -> None:
    """This is the effect of the paper's rule, and the reason to use every vehicle in range."""
    angles = 2.0 * np.pi * np.arange(8) / 8
    assert synchronised_rad(angles, 420.0) > math.radians(90.0)


def test_two_opposite_each_other_come_into_phase_and_so_do_all_in_wind() -> None:
    assert synchronised_rad(np.array([0.0, np.pi]), 2000.0) < FIVE_DEGREES
    angles = np.random.default_rng(4).uniform(-np.pi, np.pi, 8)
    assert synchronised_rad(angles, 2000.0, (6.0, -5.0)) < FIVE_DEGREES
