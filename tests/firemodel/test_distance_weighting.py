"""Observations correct a simulation by the paper's method."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from firemodel.assimilation import distance_weighting
from firemodel.assimilation.distance_weighting import PaperCorrected
from firemodel.ellipses.ellipse import EllipseFire, Spread
from firemodel.ellipses.point_observations import BURNED, BURNING, UNBURNED, errors_s
from firemodel.errors import FireModelError

Floats = NDArray[np.float64]
LENGTH_M = 20.0
FIRE = EllipseFire([Spread(0.0, 0.5, 0.1, 0.1, 0.0)], np.zeros((1, 3)))
PLACE = (50.0, 0.0)  # places that fire reaches after 100 s


def observations(*rows: tuple[float, float, float, int]) -> Floats:
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def moved_s(given: Floats, *places: tuple[float, float]) -> Floats:
    points = np.array(places)
    found = PaperCorrected(FIRE, given, LENGTH_M).ignition_time_s(points)
    return np.asarray(found - FIRE.ignition_time_s(points))


def test_a_mark_is_right_where_it_is_and_fades_with_distance() -> None:
    late = moved_s(
        observations((*PLACE, 160.0, BURNING)), PLACE, (50.0, LENGTH_M), (50.0 + 6.5 * LENGTH_M, 0)
    )
    assert late.tolist() == pytest.approx([60.0, 60.0 * math.exp(-0.5), 0.0], abs=1e-6)
    assert late[2] == 0.0


def test_marks_together_are_averaged_and_apart_they_do_not_add_up() -> None:
    two = observations((*PLACE, 160.0, BURNING), (*PLACE, 120.0, BURNING))
    assert moved_s(two, PLACE, (50.0, LENGTH_M)).tolist() == pytest.approx(
        [40.0, 80.0 * math.exp(-0.5) / (2.0 * math.exp(-0.5))]
    )
    assert moved_s(two, (50.0, 2.0 * LENGTH_M))[0] == pytest.approx(80.0 * math.exp(-2.0))


@pytest.mark.parametrize(
    ("at_s", "state", "late_s"),
    [
        (60.0, BURNED, -40.0),
        (160.0, BURNED, 0.0),
        (160.0, UNBURNED, 60.0),
        (60.0, UNBURNED, 0.0),
        (60.0, BURNING, -40.0),
    ],
)
def test_burned_and_unburned_cells_give_bounds_on_the_arrival_time(
    at_s: float, state: int, late_s: float
) -> None:
    assert moved_s(observations((*PLACE, at_s, state)), PLACE)[0] == pytest.approx(late_s)


def test_what_the_fire_agrees_with_does_not_weaken_the_others() -> None:
    agrees = [(50.0, float(y), 500.0, BURNED) for y in range(5)]
    assert moved_s(observations((*PLACE, 160.0, BURNING), *agrees), PLACE)[0] == pytest.approx(60.0)
    as_simulated = float(FIRE.ignition_time_s(np.array([PLACE]))[0])
    exact = (*PLACE, as_simulated, BURNING)  # fire was observed to arrive at this time
    assert moved_s(observations((*PLACE, 160.0, BURNING), exact), PLACE)[0] == pytest.approx(30.0)


def test_without_marks_nothing_is_moved() -> None:
    assert moved_s(np.empty((0, 4)), PLACE, (1e5, 1e5)).tolist() == [0.0, 0.0]


def test_where_fire_never_comes_a_mark_lights_its_neighbourhood() -> None:
    rain = (Spread(0.0, 0.5, 0.1, 0.1, 0.0), Spread(100.0, 0.0, 0.0, 0.0, 0.0))
    fire = EllipseFire(rain, np.zeros((1, 3)))
    given = observations(
        (115.0, 0.0, 800.0, BURNING), (100.0, 0.0, 900.0, BURNED), (200.0, 0.0, 700.0, UNBURNED)
    )
    corrected = PaperCorrected(fire, given, LENGTH_M)
    points = np.array([[25.0, 0.0], [100.0, 0.0], [90.0, 0.0], [130.0, 0.0], [200.0, 0.0]])
    found = corrected.ignition_time_s(points)
    assert found.tolist() == pytest.approx([50.0, 800.0, 900.0, 800.0, np.inf])
    none = EllipseFire(rain, np.empty((0, 3)))
    assert PaperCorrected(none, observations((*PLACE, 10.0, BURNED)), LENGTH_M).ignition_time_s(
        np.array([PLACE])
    ).tolist() == [10.0]


@pytest.mark.parametrize("length_m", [3.0, 40.0, 150.0, 1000.0])
@pytest.mark.parametrize(
    ("count", "wide_m", "high_m"),
    [(50, 500.0, 500.0), (8000, 500.0, 500.0), (8000, 40.0, 0.0), (2000, 0.0, 0.0)],
)
def test_tiles_and_polynomials_change_nothing(
    length_m: float, count: int, wide_m: float, high_m: float
) -> None:
    """The formula is evaluated for scattered points, for points on a line, and for one place."""
    random = np.random.default_rng(4)
    given = np.column_stack(
        [random.uniform(-20.0, 520.0, (150, 2)), random.uniform(0, 900, 150), np.zeros(150)]
    )
    points = random.uniform(0.0, 1.0, (count, 2)) * (wide_m, high_m) + 5.0
    apart = np.square(points[:, None] - given[None, :, :2]).sum(axis=2)
    k = np.exp(-apart / (2.0 * length_m**2))
    error_s = errors_s(FIRE, given)
    expected = (k @ error_s) / np.maximum(k.sum(axis=1), 1.0)
    found = PaperCorrected(FIRE, given, length_m).shift_s(points)
    np.testing.assert_allclose(found, expected, atol=5e-9 * np.abs(error_s).sum())


def test_times_computed_before_give_the_same() -> None:
    points = np.random.default_rng(6).uniform(-100.0, 100.0, (500, 2))
    corrected = PaperCorrected(FIRE, observations((*PLACE, 160.0, BURNING)), LENGTH_M)
    simulated_s = FIRE.ignition_time_s(points)
    again = corrected.corrected_s(points, simulated_s)
    assert again.tolist() == corrected.ignition_time_s(points).tolist()
    assert simulated_s.tolist() == FIRE.ignition_time_s(points).tolist()


def test_its_exponential_is_one() -> None:
    y = np.linspace(0.0, distance_weighting.MAX_EXPONENT * (1.0 - 1e-9), 5000)
    found = np.array([distance_weighting._squared_exponential(value) for value in y])
    np.testing.assert_allclose(found, np.exp(-y), rtol=1e-10)
    assert distance_weighting._squared_exponential(distance_weighting.MAX_EXPONENT + 1e-9) == 0.0


@pytest.mark.parametrize("length_m", [0.0, -1.0, math.inf, math.nan])
def test_a_length_that_cannot_be_is_refused(length_m: float) -> None:
    with pytest.raises(FireModelError, match="length_m"):
        PaperCorrected(FIRE, np.empty((0, 4)), length_m)


def test_marks_of_another_shape_are_refused() -> None:
    with pytest.raises(FireModelError, match=r"observations have the shape \(2, 3\)"):
        PaperCorrected(FIRE, np.zeros((2, 3)), LENGTH_M)
