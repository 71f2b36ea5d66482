"""Simulated cameras with errors of position and detection, smoke, and the filter."""

import numpy as np
import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.events import Observed, Telemetry
from mission_service.fire.observed_window import states_in, without_speckles
from mission_service.fire.scenario_fire import landscape_of
from mission_service.fire.simulated_cameras import SimulatedCameras, cameras_of

AT_S = 7200.0
HIGH_M = 800.0


def scenario_with(*changes: str) -> Scenario:
    return load_scenario("default", tuple(f"simulation.camera.{each}" for each in changes))


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


def cameras(land: Landscape, *changes: str) -> SimulatedCameras:
    found = cameras_of(scenario_with(*changes), land)
    assert found is not None
    return found


def fix_at(land: Landscape, seconds: int = 0) -> Telemetry:
    """Return a position high above the ignition."""
    place = load_scenario("default").ignition[0]
    lat, lon = place.lat_deg, place.lon_deg
    assert lat is not None
    assert lon is not None
    altitude_m = float(land.elevation_at(*land.xy_of_lat_lon(lat, lon))) + HIGH_M
    at_us = round((AT_S + seconds) * 1e6)
    return Telemetry(at_us, "hawk", lat, lon, altitude_m, HIGH_M, 17.0, 0.0, 0.0)


def taken(found: SimulatedCameras, fix: Telemetry) -> Observed:
    image = found.seen_from(fix)
    assert image is not None
    return image


def test_the_same_image_has_the_same_errors_and_another_has_others(land: Landscape) -> None:
    one, other = (cameras(land, "kind=thermal", "missed=0.2") for _ in range(2))
    first = taken(one, fix_at(land))
    taken(other, fix_at(land, -5))
    assert taken(other, fix_at(land)) == first
    assert taken(one, fix_at(land, 1)).cells != first.cells


def test_rates_of_wrong_cells_are_as_configured_and_reported(land: Landscape) -> None:
    keys = ("kind=thermal", "missed=0.2", "false_alarms=0.1", "gps_sd_m=0", "gimbal_sd_deg=0")
    image = taken(cameras(land, *keys), fix_at(land))
    true = states_in(taken(cameras(land, "kind=ideal"), fix_at(land)).cells)
    seen = states_in(image.cells)
    assert np.mean(seen[true == 2] == 1) == pytest.approx(0.2, abs=0.05)
    assert np.mean(seen[true == 1] == 2) == pytest.approx(0.1, abs=0.03)
    assert (image.missed, image.false_alarms, image.position_sd_m) == (0.2, 0.1, 0.0)


def test_the_error_of_position_moves_the_whole_image(land: Landscape) -> None:
    keys = ("kind=thermal", "missed=0", "false_alarms=0", "gps_sd_m=0", "gimbal_sd_deg=10")
    found = cameras(land, *keys)
    moved = [states_in(taken(found, fix_at(land, at)).cells) == 2 for at in range(20)]
    middles = np.array([np.argwhere(each).mean(axis=0) for each in moved]) * land.cell_size_m
    expected_m = HIGH_M * np.tan(np.radians(10.0))
    assert taken(found, fix_at(land)).position_sd_m == pytest.approx(expected_m, abs=1.0)
    assert 0.5 * expected_m < middles.std(axis=0).mean() < 1.5 * expected_m


def test_smoke_hides_the_ground_downwind_from_a_visible_camera_only(land: Landscape) -> None:
    exact = ("missed=0", "false_alarms=0", "gps_sd_m=0", "gimbal_sd_deg=0")
    ideal = states_in(taken(cameras(land, "kind=ideal"), fix_at(land)).cells)
    thermal = states_in(taken(cameras(land, "kind=thermal", *exact), fix_at(land)).cells)
    visible = states_in(taken(cameras(land, "kind=visible", *exact), fix_at(land)).cells)
    np.testing.assert_array_equal(thermal, ideal)
    hidden = (visible == 0) & (ideal != 0)
    assert 20 < hidden.sum() < (ideal != 0).sum() / 2
    np.testing.assert_array_equal(visible[~hidden], ideal[~hidden])
    from_deg = load_scenario("default").weather[0].wind_from_deg
    towards = np.radians(from_deg + 180.0)
    downwind = np.argwhere(hidden).mean(axis=0) - np.argwhere(ideal == 2).mean(axis=0)
    assert downwind @ np.array([-np.cos(towards), np.sin(towards)]) > 0.0


def test_planners_receive_images_without_single_wrong_cells(land: Landscape) -> None:
    keys = ("kind=thermal", "missed=0.05", "false_alarms=0.02", "gps_sd_m=0", "gimbal_sd_deg=0")
    found, ideal = cameras(land, *keys), cameras(land, "kind=ideal")
    wrong = wrong_raw = 0
    for at in range(10):
        image, true = taken(found, fix_at(land, at)), taken(ideal, fix_at(land, at))
        states, clean = states_in(true.cells), states_in(without_speckles(image).cells)
        wrong += int(np.count_nonzero((clean != 0) & (clean != states)))
        wrong_raw += int(np.count_nonzero(states_in(image.cells) != states))
    assert wrong < 0.25 * wrong_raw
    assert without_speckles(true) is true
