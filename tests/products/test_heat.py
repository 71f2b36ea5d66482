"""Categories of observed heat."""

import numpy as np
import pytest

from firemodel.landscape.flat import flat_landscape
from firemodel.landscape.landscape import Landscape
from mission_service.events import FireObserved, Observed
from mission_service.products.heat import ObservedHeat, classified

NOWHERE = np.empty((0, 2))


def _land() -> Landscape:
    return flat_landscape(40, 40, 30.0, 36.0, -84.0)


def test_a_group_of_cells_is_intense_and_single_cells_are_isolated() -> None:
    land = _land()
    hot = np.zeros(land.shape, dtype=bool)
    hot[10:14, 10:14] = True
    hot[30, 30] = True
    found = classified(hot, NOWHERE, land)
    assert [area.area for area in found.intense] == [pytest.approx(16 * 900.0)]
    assert not found.scattered
    assert [point.coords[0] for point in found.isolated] == [land.xy_of(30, 30)]
    assert not found.is_empty


def test_separate_cells_near_each_other_are_scattered_heat() -> None:
    land = _land()
    hot = np.zeros(land.shape, dtype=bool)
    for place in ((5, 5), (5, 9), (8, 7)):
        hot[place] = True
    found = classified(hot, NOWHERE, land)
    assert not found.intense
    assert not found.isolated
    (area,) = found.scattered
    assert area.area > 3 * 900.0


def test_only_ground_seen_soon_after_the_fire_arrived_is_hot() -> None:
    land = _land()
    arrival_s = np.full(land.shape, np.inf)
    arrival_s[:, :20], arrival_s[:, 20:30] = 0.0, 7000.0
    seen = ObservedHeat(land)
    seen.apply(Observed(7200_000_000, "hawk", 0, 0, ("b" * 30 + "u" * 10,) * 40))
    (area,) = seen.heat(arrival_s, 7300.0).intense
    west, _, east, _ = area.bounds
    assert (west - land.west_m, east - land.west_m) == (600.0, 900.0)
    assert seen.heat(arrival_s, 7200.0 + 3700.0).is_empty  # the image is older than an hour
    seen.apply(Observed(7400_000_000, "hawk", 0, 0, ("u" * 40,) * 40))
    assert seen.heat(arrival_s, 7500.0).is_empty


def test_windows_of_the_estimate_are_no_heat() -> None:
    land = _land()
    window = (0, "hawk", 0, 0, ("b" * 40,) * 40)
    for event in (
        Observed(*window, estimated=True),
        Observed(*window, corrects=True),
        Observed(*window, distrusted=True),
    ):
        seen = ObservedHeat(land)
        seen.apply(event)
        assert seen.heat(np.zeros(land.shape), 10.0).is_empty
        assert seen.first_s is None


def test_a_point_that_a_detector_reports_as_hot_is_an_isolated_source() -> None:
    land = _land()
    lat, lon = land.lat_lon_of(*land.xy_of(20, 20))
    seen = ObservedHeat(land)
    seen.apply(
        FireObserved(
            at_us=5_000_000,
            by="camera",
            station="",
            state="hot",
            shape="points",
            points=((float(lat), float(lon)),),
            seen_at_us=4_000_000,
            position_sd_m=20.0,
            false_alarms=0.0,
            source="camera",
        )
    )
    found = seen.heat(np.full(land.shape, np.inf), 10.0)
    (point,) = found.isolated
    assert point.coords[0] == pytest.approx(land.xy_of(20, 20), abs=0.5)
    assert seen.heat(np.full(land.shape, np.inf), 3700.0).is_empty
