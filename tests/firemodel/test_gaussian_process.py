"""Observations correct a simulation with wrong inputs, also ahead in time, with an uncertainty."""

import numpy as np
import pytest
from numpy.typing import NDArray

from firemodel.assimilation.gaussian_process import GaussianCorrected, _curvature, _log_likelihood
from firemodel.ellipses.ellipse import EllipseFire, Spread
from firemodel.ellipses.line_ignitions import line_sources
from firemodel.ellipses.point_observations import BURNED, BURNING, UNBURNED

Floats = NDArray[np.float64]

LIT = np.concatenate(
    [
        line_sources(np.array([[100.0, 100.0], [220.0, 130.0]]), 0.0, 5.0),
        line_sources(np.array([[150.0, 240.0], [160.0, 240.0]]), 900.0, 5.0),
    ]
)
MODEL = EllipseFire([Spread(0.0, 0.08, 0.02, 0.02, 0.3)], LIT)
TRUTH = EllipseFire([Spread(0.0, 0.14, 0.015, 0.035, 0.8)], LIT)
PLACES = np.stack(np.meshgrid(np.arange(20.0, 380.0, 12.0), np.arange(20.0, 380.0, 12.0)), -1)
GRID = PLACES.reshape(-1, 2)


def along_front(fire: EllipseFire, at_s: float, count: int, seed: int, sd_m: float = 4.0) -> Floats:
    """Return observations of burning at places that fire reaches within a quarter of a minute."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 400.0, (40_000, 2))
    near = places[np.abs(fire.ignition_time_s(places) - at_s) < 15.0][:count]
    near = near + sd_m * rng.standard_normal(near.shape)
    return np.column_stack([near, np.full(len(near), at_s), np.full(len(near), BURNING)])


def test_without_marks_it_is_the_fire_itself() -> None:
    none = GaussianCorrected(MODEL, np.empty((0, 4)))
    assert np.array_equal(none.ignition_time_s(GRID), MODEL.ignition_time_s(GRID))
    assert (none.sd_s(GRID)[MODEL.ignition_time_s(GRID) > 60.0] > 0.0).all()
    unlit = GaussianCorrected(EllipseFire(MODEL.spreads, np.empty((0, 3))), np.ones((2, 4)))
    assert np.isinf(unlit.ignition_time_s(GRID)).all()
    assert np.isinf(unlit.sd_s(GRID)).all()


def test_wrong_rates_and_wind_are_found_and_hold_for_later() -> None:
    observations = np.concatenate([along_front(TRUTH, at_s, 25, 1) for at_s in (600.0, 780.0)])
    found = GaussianCorrected(MODEL, observations)
    true_s = TRUTH.ignition_time_s(GRID)
    ahead = (true_s > 900.0) & (true_s < 1800.0)
    wrong_s = np.abs(MODEL.ignition_time_s(GRID) - true_s)[ahead].mean()
    left_s = np.abs(found.ignition_time_s(GRID) - true_s)[ahead].mean()
    assert left_s < 0.25 * wrong_s
    assert found.rates[3] == pytest.approx(0.5, abs=0.25)  # the turn of the wind


def test_fuel_that_burns_faster_in_one_place_is_corrected_there_only() -> None:
    def true_s(points: Floats) -> Floats:
        patch = np.exp(-0.5 * np.square((points - (150.0, 80.0)) / 40.0).sum(axis=1))
        found: Floats = MODEL.ignition_time_s(points) * (1.0 - 0.4 * patch)
        return found

    rng = np.random.default_rng(2)
    places = rng.uniform(60.0, 300.0, (60, 2))
    observations = np.column_stack([places, true_s(places), np.full(60, BURNING)])
    found = GaussianCorrected(MODEL, observations, place_sd_m=1.0)
    patch, apart = np.array([[150.0, 85.0]]), np.array([[230.0, 110.0]])
    for place, off in ((patch, 0.2), (apart, 0.15)):
        assert found.ignition_time_s(place) == pytest.approx(true_s(place), rel=off)
    assert found.ignition_time_s(patch)[0] < 0.8 * MODEL.ignition_time_s(patch)[0]


def test_burned_and_unburned_marks_hold_one_side_only() -> None:
    places = np.array([[240.0, 140.0], [250.0, 150.0], [245.0, 120.0]])
    simulated_s = MODEL.ignition_time_s(places)

    def at(part: float, state: int) -> Floats:
        observations = np.column_stack([places, part * simulated_s, np.full(3, state)])
        return GaussianCorrected(MODEL, observations).ignition_time_s(places) / simulated_s

    assert at(5.0, BURNED) == pytest.approx(1.0, abs=0.1)
    assert at(0.1, UNBURNED) == pytest.approx(1.0, abs=0.1)
    assert (at(0.4, BURNED) < 0.65).all()
    assert (at(2.5, UNBURNED) > 1.5).all()


def test_one_mark_among_many_that_is_far_off_does_little() -> None:
    observations = np.concatenate([along_front(TRUTH, at_s, 25, 3) for at_s in (600.0, 780.0)])
    wrong = np.array([[observations[10, 0] + 1.0, observations[10, 1], 6000.0, BURNING]])
    good = GaussianCorrected(MODEL, observations).ignition_time_s(observations[:, :2])
    also = GaussianCorrected(MODEL, np.concatenate([observations, wrong])).ignition_time_s(
        observations[:, :2]
    )
    assert np.median(np.abs(also - good)) < 60.0
    assert np.abs(also - good)[10] < 400.0  # out of five thousand places


def test_a_front_stays_sensible_whatever_is_marked() -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)
        observations = np.column_stack(
            [
                rng.uniform(50.0, 350.0, (40, 2)),
                rng.uniform(-300.0, 6000.0, 40),
                rng.choice([BURNED, BURNING, UNBURNED], 40),
            ]
        )
        found = GaussianCorrected(MODEL, observations)
        time_s = found.ignition_time_s(GRID)
        assert np.isfinite(time_s).all()
        assert (time_s >= 0.0).all()  # no place burns before the first ignition
        # Along a path from a source, arrival times increase, so there are no isolated burned areas.
        one = GaussianCorrected(EllipseFire(MODEL.spreads, LIT[:1]), observations)
        steps = np.linspace(0.0, 1.0, 60)[:, None]
        for goal in rng.uniform(0.0, 400.0, (10, 2)):
            along_s = one.ignition_time_s(LIT[0, :2] + steps * (goal - LIT[0, :2]))
            assert (np.diff(along_s) > -0.02 * along_s[-1]).all()


def test_what_is_stated_of_its_certainty_is_about_true() -> None:
    observations = np.concatenate([along_front(TRUTH, at_s, 15, 5) for at_s in (600.0, 780.0)])
    found = GaussianCorrected(MODEL, observations)
    true_s = TRUTH.ignition_time_s(GRID)
    asked = (true_s > 60.0) & (true_s < 2000.0)
    off = np.abs(found.ignition_time_s(GRID) - true_s)[asked] / found.sd_s(GRID)[asked]
    assert (off < 2.0).mean() > 0.85
    few = GaussianCorrected(MODEL, observations[:3]).sd_s(GRID)
    # Observations reduce the uncertainty.
    assert np.median(found.sd_s(GRID)[asked] / few[asked]) < 0.6
    near = GaussianCorrected(TRUTH, observations)
    assert (
        np.median(near.sd_s(observations[:, :2]) / near.ignition_time_s(observations[:, :2])) < 0.25
    )


def test_the_slope_of_a_marks_likelihood_is_that_of_its_likelihood() -> None:
    state = np.array([BURNED, BURNING, UNBURNED, BURNED, UNBURNED])
    y, sd, f = np.array([6.0, 6.1, 5.9, 6.5, 5.0]), np.full(5, 0.2), np.full(5, 6.05)
    w, b = _curvature(state, y, sd, f)
    for place in range(5):
        step = np.where(np.arange(5) == place, 1e-5, 0.0)
        up, down = (_log_likelihood(state, y, sd, f + way * step) for way in (1.0, -1.0))
        assert (up - down) / 2e-5 == pytest.approx(
            b[place] - w[place] * f[place], rel=1e-4, abs=1e-6
        )


def test_a_fit_that_begins_near_comes_out_nearly_as_one_from_nothing() -> None:
    observations = np.concatenate(
        [along_front(TRUTH, at_s, 25, 2) for at_s in (600.0, 780.0, 900.0)]
    )
    found = GaussianCorrected(MODEL, observations[:60])
    for count in range(61, 76):
        found = GaussianCorrected(MODEL, observations[:count], near=found)
    whole = GaussianCorrected(MODEL, observations)
    true_s = TRUTH.ignition_time_s(GRID)
    soon = true_s < 1500.0
    left_s, whole_s, wrong_s = (
        np.abs(fire.ignition_time_s(GRID) - true_s)[soon].mean() for fire in (found, whole, MODEL)
    )
    assert left_s < whole_s + 0.05 * wrong_s


def test_it_is_always_the_same() -> None:
    observations = np.concatenate([along_front(TRUTH, at_s, 50, 6) for at_s in (600.0, 900.0)])
    first = GaussianCorrected(MODEL, observations).ignition_time_s(GRID)
    again = GaussianCorrected(MODEL, observations).ignition_time_s(GRID)
    assert np.array_equal(first, again)
    some = GaussianCorrected(MODEL, observations).ignition_time_s(GRID[7:9])
    assert some == pytest.approx(first[7:9], abs=1e-6)
