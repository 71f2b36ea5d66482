"""Cameras and sensors correct a simulation automatically."""

import numpy as np

from firemodel.assimilation.camera_front import CameraFront
from firemodel.assimilation.gaussian_process import GaussianCorrected
from firemodel.ellipses.ellipse import EllipseFire, Spread
from firemodel.ellipses.point_observations import BURNED, BURNING, UNBURNED
from tests.firemodel.grids import CELL_M, landscape

LAND = landscape(shape=(60, 60))
NEVER = EllipseFire([Spread(0.0, 0.1, 0.1, 0.1, 0.0)], np.empty((0, 3)))
CENTRE = np.array(LAND.xy_of(30, 30))
MODEL, TRUTH = (
    EllipseFire([Spread(0.0, rate, rate / 4, rate / 2, 0.5)], np.array([[*CENTRE, 0.0]]))
    for rate in (0.2, 0.4)
)


def window(fire: EllipseFire, row: int, col: int, size: int, at_s: float) -> tuple[str, ...]:
    """Return the image of a fire in a window."""
    rows, cols = np.indices((size, size))
    x_m, y_m = LAND.xy_of(row + rows, col + cols)
    time_s = fire.ignition_time_s(np.column_stack([x_m.ravel(), y_m.ravel()]))
    burned = (time_s <= at_s).reshape(size, size)
    return tuple("".join("b" if cell else "u" for cell in line) for line in burned)


def test_a_window_gives_the_front_and_what_the_simulation_has_wrong() -> None:
    seen = CameraFront(LAND, apart_m=CELL_M)
    seen.fold(10, 20, ("bbu.", "bbuu", "....", "uu.b"), 50.0, NEVER)
    observations = seen.observations()
    x_m, y_m = LAND.xy_of(np.array([10.0, 11.0]), np.full(2, 21.5))
    burning = observations[observations[:, 3] == BURNING]
    assert sorted(map(tuple, burning[:, :2])) == sorted(zip(x_m, y_m, strict=True))
    assert (observations[:, 2] == 50.0).all()
    # With NEVER, no cell of the window has burned.
    assert np.count_nonzero(observations[:, 3] == BURNED) == 5
    assert not (observations[:, 3] == UNBURNED).any()
    seen = CameraFront(LAND, apart_m=CELL_M)
    seen.fold(28, 28, ("uuuuu",) * 5, 600.0, MODEL)
    assert (seen.observations()[:, 3] == UNBURNED).all()
    assert len(seen.observations()) > 3


def test_hours_of_windows_give_few_marks_and_the_newest() -> None:
    seen = CameraFront(LAND, apart_m=2.0 * CELL_M, every_s=120.0, most=150)
    for at_s in range(0, 7200, 4):
        place = 26 + at_s % 9
        seen.fold(place, place, window(TRUTH, place, place, 6, float(at_s)), float(at_s), MODEL)
    observations = seen.observations()
    assert 20 < len(observations) <= 150
    assert (np.diff(observations[:, 2]) >= 0.0).all()
    one = CameraFront(LAND, every_s=120.0)
    for time_s in (10.0, 60.0, 110.0):
        one.fold(10, 20, ("bu",), time_s, NEVER)
    assert one.observations()[:, 2].tolist() == [110.0, 110.0]


def test_a_camera_alone_corrects_the_simulation() -> None:
    seen = CameraFront(LAND)
    for at_s in range(600, 900, 20):
        row, col = 24 + at_s // 60 % 8, 28 + at_s // 20 % 8
        seen.fold(row, col, window(TRUTH, row, col, 8, at_s), float(at_s), MODEL)
    corrected = GaussianCorrected(MODEL, seen.observations())
    places = CENTRE + np.array([[200.0, 110.0], [0.0, 150.0], [250.0, 50.0]])
    true_s, model_s = TRUTH.ignition_time_s(places), MODEL.ignition_time_s(places)
    left_s = np.abs(corrected.ignition_time_s(places) - true_s)
    assert (left_s < 0.35 * np.abs(model_s - true_s)).all()


def test_an_empty_window_or_one_outside_is_nothing() -> None:
    seen = CameraFront(LAND)
    seen.fold(0, 0, (), 5.0, MODEL)
    seen.fold(0, 0, ("...", "..."), 5.0, MODEL)
    assert seen.observations().shape == (0, 4)
