"""The progress of a vehicle along its path."""

import numpy as np
import pytest

from mission_service.guidance.burn.approved_plan import PathProgress

# The path leads up 15 m, 100 m east, up to 60 m, and 100 m back west over the same ground.
POINTS = np.array([(0, 0, 0), (0, 0, 15), (100, 0, 15), (100, 0, 60), (0, 0, 60)], dtype=float)
AFTER = np.array([0.0, 5.0, 25.0, 40.0, 60.0])


def test_it_follows_a_vehicle_along_its_path() -> None:
    table = PathProgress(POINTS, AFTER)
    for x_m in np.arange(0.0, 101.0, 2.5):
        off_m = table.update(np.array([x_m, 1.0, 15.0]))
    assert off_m == pytest.approx(1.0)
    assert table.progress_m == pytest.approx(115.0)
    assert table.after_s == pytest.approx(25.0)


def test_ground_flown_over_twice_is_distinguished_by_height() -> None:
    table = PathProgress(POINTS, AFTER)
    way = [
        *((x, 0.0, 15.0) for x in range(0, 101, 5)),
        *((100.0, 0.0, z) for z in range(15, 61, 5)),
    ]
    way += [(x, 0.0, 60.0) for x in range(100, 49, -5)]
    for place in way:
        table.update(np.array(place, dtype=float))
    assert table.progress_m == pytest.approx(15 + 100 + 45 + 50)
    assert table.remaining_m == pytest.approx(50.0)


def test_it_never_goes_back() -> None:
    table = PathProgress(POINTS, AFTER)
    for x_m in (10.0, 30.0, 50.0, 45.0, 40.0):
        table.update(np.array([x_m, 0.0, 15.0]))
    assert table.progress_m == pytest.approx(65.0)


def test_a_vehicle_that_is_somewhere_else_is_off_its_path() -> None:
    table = PathProgress(POINTS, AFTER)
    assert table.update(np.array([0.0, 40.0, 15.0])) == pytest.approx(40.0)


def test_what_is_ahead_is_as_late_as_the_vehicle_is() -> None:
    table = PathProgress(POINTS, AFTER)
    for x_m in range(0, 51, 5):
        table.update(np.array([float(x_m), 0.0, 15.0]))
    ahead = table.ahead(115.0)  # by its path it should be there 15 s after the start
    assert ahead[0].tolist() == pytest.approx([50.0, 0.0, 15.0, 115.0])
    assert ahead[1].tolist() == pytest.approx([100.0, 0.0, 15.0, 125.0])
    assert ahead[-1].tolist() == pytest.approx([0.0, 0.0, 60.0, 160.0])
