"""Learning the errors of wind and spread rates from observed fronts."""

import math

import numpy as np
import pytest

from firemodel.assimilation.learned_inputs import (
    FIRST_FUEL,
    RATE,
    SPEED,
    TURN,
    FrontParts,
    LearnedInputs,
)
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream

CELLS, CELL_M = 64, 30.0
GRASS, LITTER = 1, 8


def landscape() -> Landscape:
    """Return level ground, grass in the west and litter in the east."""
    fuel = np.full((CELLS, CELLS), GRASS, np.int16)
    fuel[:, CELLS // 2 :] = LITTER
    return Landscape("EPSG:32611", 5e5, 4e6, CELL_M, fuel, np.zeros(fuel.shape, np.float32))


def weather(speed_m_s: float = 4.0, from_deg: float = 270.0) -> WeatherStream:
    """Return a constant dry wind."""
    return WeatherStream([Weather(0.0, speed_m_s, from_deg, 5.0, 6.0, 7.0, 60.0, 90.0)])


def ring(count: int = 48, radius: float = 16.0) -> FrontParts:
    """Return a front on a circle around the middle."""
    angle = np.arange(count) * math.tau / count
    north, east = np.cos(angle), np.sin(angle)
    rows = np.rint(CELLS / 2 - radius * north).astype(np.int64)
    cols = np.rint(CELLS / 2 + radius * east).astype(np.int64)
    return FrontParts(rows, cols, north, east)


def part_of(parts: FrontParts, own: np.ndarray | slice) -> FrontParts:
    """Return some of the parts of a front."""
    return FrontParts(parts.rows[own], parts.cols[own], parts.north[own], parts.east[own])


def learned_after(
    true_speeds: np.ndarray, inputs: LearnedInputs, parts: FrontParts, rounds: int = 8
) -> LearnedInputs:
    """Return inputs after observations of a front that moves at given speeds in m/s."""
    groups = np.arange(parts.rows.size) // 4
    for number in range(1, rounds + 1):
        at_s = 1800.0 * number
        estimated = inputs.speeds_m_s(parts, weather(), at_s)
        ahead = (true_speeds - estimated) * 1800.0 / CELL_M
        inputs.learn(parts, estimated * 1800.0 / CELL_M, ahead, groups, weather(), at_s)
    return inputs


def error(inputs: LearnedInputs, parts: FrontParts, true_speeds: np.ndarray) -> float:
    """Return the mean relative error of the learned speeds."""
    found = inputs.speeds_m_s(parts, weather(), 7200.0)
    return float(np.mean(np.abs(found / true_speeds - 1.0)))


def test_a_rate_of_all_fuels_is_learned_also_where_nothing_was_observed() -> None:
    parts = ring()
    inputs = LearnedInputs(landscape(), 0.0)
    true = 1.8 * inputs.speeds_m_s(parts, weather(), 0.0)
    west = part_of(parts, parts.cols < CELLS // 2)
    seen = learned_after(true[parts.cols < CELLS // 2], inputs, west)
    assert error(seen, west, true[parts.cols < CELLS // 2]) < 0.1
    east = part_of(parts, parts.cols >= CELLS // 2)
    assert error(seen, east, true[parts.cols >= CELLS // 2]) < 0.4  # 0.44 if nothing was learned


def test_a_turned_wind_is_distinguished_from_a_rate() -> None:
    parts = ring()
    inputs = LearnedInputs(landscape(), 0.0)
    other = LearnedInputs(landscape(), 0.0)
    true = other.speeds_m_s(parts, weather(from_deg=300.0), 0.0)
    unlearned = error(inputs, parts, true)
    found = learned_after(true, inputs, parts)
    # The blocks take a part of the difference.
    assert 8.0 < math.degrees(found.state[TURN]) < 40.0
    assert abs(found.state[RATE]) < 0.2
    assert error(found, parts, true) < 0.4 * unlearned


def test_a_block_is_learned_apart_from_its_fuel() -> None:
    parts = ring()
    inputs = LearnedInputs(landscape(), 0.0)
    true = inputs.speeds_m_s(parts, weather(), 0.0)
    slow = np.hypot(parts.rows - parts.rows[36], parts.cols - parts.cols[36]) < 6.0
    true[slow] *= 0.3
    here = part_of(parts, slow)
    unlearned = error(inputs, here, true[slow])
    found = learned_after(true, inputs, parts, rounds=12)
    assert error(found, here, true[slow]) < 0.4 * unlearned
    assert error(found, part_of(parts, ~slow), true[~slow]) < 0.15
    rates = found.cell_rates()
    assert rates[parts.rows[36], parts.cols[36]] < 0.7
    assert rates[parts.rows[12], parts.cols[12]] == pytest.approx(1.0, abs=0.2)


def test_the_stated_error_of_a_speed_falls_by_observations_and_grows_in_time() -> None:
    parts = ring()
    inputs = LearnedInputs(landscape(), 0.0)
    speeds = inputs.speeds_m_s(parts, weather(), 0.0)
    before = inputs.speed_sds_m_s(parts, speeds, weather(), 0.0)
    found = learned_after(speeds, inputs, parts)
    after = found.speed_sds_m_s(parts, speeds, weather(), 0.0)
    grass = parts.cols < CELLS // 2  # the litter hardly moves
    assert (after[grass] < 0.75 * before[grass]).all()
    assert (after <= 1.05 * before).all()
    none = part_of(parts, slice(0))
    empty = np.empty(0)
    found.learn(none, empty, empty, empty.astype(np.int64), weather(), 12.0 * 3600.0)
    assert (found.speed_sds_m_s(parts, speeds, weather(), 0.0) > after).all()


def test_a_front_in_view_without_advance_teaches_nothing() -> None:
    parts = ring()
    inputs = LearnedInputs(landscape(), 0.0)
    groups = np.arange(parts.rows.size)
    inputs.learn(
        parts, np.full(groups.size, 0.2), np.full(groups.size, 2.0), groups, weather(), 1.0
    )
    assert not inputs.state.any()


def test_one_wild_measurement_is_limited() -> None:
    parts = ring()
    inputs = LearnedInputs(landscape(), 0.0)
    groups = np.zeros(parts.rows.size, np.int64)
    size = groups.size
    inputs.learn(parts, np.full(size, 5.0), np.full(size, 500.0), groups, weather(), 60.0)
    assert np.exp(inputs.state[RATE]) < 4.0


def test_a_new_wind_report_discards_the_errors_of_the_old_wind_only() -> None:
    parts = ring()
    inputs = LearnedInputs(landscape(), 0.0)
    true = 1.5 * inputs.speeds_m_s(parts, weather(from_deg=290.0), 0.0)
    found = learned_after(true, inputs, parts)
    rate = found.state[RATE]
    assert rate
    found.forget_wind()
    assert found.state[SPEED] == found.state[TURN] == 0.0
    assert found.state[RATE] == rate
    assert np.all(np.linalg.eigvalsh(found.covariance) > -1e-9)


def test_copies_are_independent() -> None:
    parts = ring()
    inputs = LearnedInputs(landscape(), 0.0)
    copied = inputs.copy()
    learned_after(2.0 * inputs.speeds_m_s(parts, weather(), 0.0), inputs, parts, rounds=1)
    assert inputs.state[RATE] > 0.1
    assert not copied.state.any()


def test_a_large_grid_has_a_limited_number_of_blocks() -> None:
    small = landscape()
    fuel = np.tile(small.fuel_model, (16, 16))
    large = Landscape(small.crs, 5e5, 4e6, CELL_M, fuel, np.zeros(fuel.shape, np.float32))
    inputs = LearnedInputs(large, 0.0)
    assert inputs.state.size <= FIRST_FUEL + 2 + 20 * 20
    assert inputs.cell_rates().shape == large.shape
