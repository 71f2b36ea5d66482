"""Observations correct a cellular fire, which continues from the corrected state."""

import numpy as np
import pytest
from numpy.typing import NDArray

from firemodel.assimilation.corrected_cells import (
    ArrivalRaster,
    corrected_arrival,
    warm_up,
)
from firemodel.assimilation.distance_weighting import PaperCorrected
from firemodel.assimilation.gaussian_process import GaussianCorrected
from firemodel.ellipses.point_observations import BURNED, BURNING, UNBURNED
from firemodel.errors import FireModelError
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival
from tests.firemodel.grids import CELL_M, landscape, steady

Floats = NDArray[np.float64]

LAND = landscape(shape=(81, 81))
LIT = [(40, 40, 0.0)]
MARKED_S, LATER_S = 1800.0, 2700.0


def burned(from_deg: float, until_s: float = 3 * LATER_S) -> AnyAngleFire:
    """Return a fire that spreads in the wind from this direction, advanced far enough."""
    fire = AnyAngleFire(LAND, steady(2.0, from_deg), LIT)
    fire.advance(until_s)
    return fire


MODEL, TRUTH = burned(250.0), burned(200.0)


def marks_on(fire: AnyAngleFire, at_s: float, count: int = 40) -> Floats:
    """Return noisy marks on the front."""
    rng = np.random.default_rng(1)
    (ring,) = fire.front(at_s).geoms
    along = rng.uniform(0.0, ring.exterior.length, count)
    xy = np.array([ring.exterior.interpolate(at).coords[0] for at in along])
    xy += 0.3 * CELL_M * rng.standard_normal(xy.shape)
    return np.column_stack([xy, np.full(count, at_s), np.full(count, BURNING)])


def off(found: AnyAngleFire, at_s: float) -> float:
    """Return the wrong area divided by the true area."""
    true = TRUTH.front(at_s)
    return float(found.front(at_s).symmetric_difference(true).area / true.area)


@pytest.mark.parametrize("method", ["gaussian", "paper"])
def test_a_fire_in_the_wrong_wind_is_nearer_to_the_truth_now_and_later(method: str) -> None:
    observations = marks_on(TRUTH, MARKED_S)
    if method == "gaussian":
        arrival_s = corrected_arrival(MODEL.arrival_time_s, LAND, observations)
    else:
        arrival_s = corrected_arrival(
            MODEL.arrival_time_s, LAND, observations, lambda f, m: PaperCorrected(f, m, 60.0)
        )
    burning = burning_from_arrival(arrival_s, LAND, MARKED_S)
    going_on = AnyAngleFire(LAND, MODEL.weather, [], burning)
    assert off(going_on, MARKED_S) < (0.25 if method == "gaussian" else 0.5) * off(MODEL, MARKED_S)
    going_on.advance(LATER_S)
    assert off(going_on, LATER_S) < (0.5 if method == "gaussian" else 0.7) * off(MODEL, LATER_S)


def test_times_of_a_raster_are_those_of_its_cells_and_between_them() -> None:
    raster = ArrivalRaster(MODEL.arrival_time_s, LAND)
    row, col = np.array([40, 45, 30]), np.array([40, 50, 41])
    centres = np.column_stack(LAND.xy_of(row, col))
    assert raster.ignition_time_s(centres) == pytest.approx(MODEL.arrival_time_s[row, col])
    between = raster.ignition_time_s(np.array([LAND.xy_of(45.0, 50.5)]))
    assert between == pytest.approx(MODEL.arrival_time_s[45, 50:52].mean())
    assert np.isinf(raster.ignition_time_s(np.array([LAND.xy_of(-2.0, 5.0)]))).all()
    assert raster.places() == pytest.approx(np.array([LAND.xy_of(40, 40)]))


def test_without_marks_nothing_changes_and_what_cannot_burn_never_does() -> None:
    arrival_s = MODEL.arrival_time_s.copy()
    arrival_s[20:25, 30:60] = np.inf
    same = corrected_arrival(arrival_s, LAND, np.empty((0, 4)))
    assert same == pytest.approx(arrival_s)
    corrected = corrected_arrival(arrival_s, LAND, marks_on(TRUTH, MARKED_S))
    assert np.array_equal(np.isinf(corrected), np.isinf(arrival_s))
    assert corrected.min() >= 0.0


def test_a_spot_where_fire_never_comes_burns_if_it_is_marked_so() -> None:
    arrival_s = np.where(MODEL.arrival_time_s < 1800.0, MODEL.arrival_time_s, np.inf)
    for state, burns in ((BURNED, True), (BURNING, True), (UNBURNED, False)):
        observations = np.array([[*LAND.xy_of(75.0, 5.0), 1700.0, state]])
        found = corrected_arrival(arrival_s, LAND, observations)
        assert (found[75, 5] == 1700.0) == burns


def test_a_raster_off_the_landscape_is_refused() -> None:
    with pytest.raises(FireModelError, match=r"arrival has the shape \(3, 3\)"):
        corrected_arrival(np.zeros((3, 3)), LAND, np.empty((0, 4)))


def test_a_correction_costs_what_burns_and_not_what_is_mapped() -> None:
    early = burned(250.0, MARKED_S).arrival_time_s
    come = np.isfinite(early)
    assert come.sum() < 0.5 * come.size
    asked = []

    class Counted(GaussianCorrected):
        def ignition_time_s(self, points_m: Floats) -> Floats:
            asked.append(len(points_m))
            return super().ignition_time_s(points_m)

    observations = marks_on(TRUTH, MARKED_S, 12)
    found = corrected_arrival(early, LAND, observations, Counted)
    assert asked == [come.sum()]
    # Bit for bit the result for all cells.
    row, col = np.indices(early.shape)
    centres = np.column_stack([axis.ravel() for axis in LAND.xy_of(row, col)])
    every = GaussianCorrected(ArrivalRaster(early, LAND), observations).ignition_time_s(centres)
    assert np.array_equal(found[come], every.reshape(early.shape)[come])
    assert np.isinf(every.reshape(early.shape)[~come]).all()


def test_the_kernels_of_corrections_can_be_compiled_ahead() -> None:
    warm_up()
