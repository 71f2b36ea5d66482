"""The estimate of a run learns from images how fast the fire spreads, and where it is not."""

from collections.abc import Iterator

import numpy as np
import pytest

from mission_service.config.fire_sections import Ignition, LandscapeSection, WeatherEntry
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.events import Observed, Telemetry, WindSet
from mission_service.fire.observed_window import in_letters
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import fire_of, landscape_of

CELLS, LAT_DEG, LON_DEG = 90, 36.0, -84.0
EVERY_S = 900.0
US = 1_000_000


def scenario(speed_m_s: float = 2.0, from_deg: float = 270.0) -> Scenario:
    """Return a fire in the middle of level short grass, in constant wind."""
    level = LandscapeSection(
        source="flat", rows=CELLS, cols=CELLS, cell_size_m=30.0, lat_deg=LAT_DEG, lon_deg=LON_DEG
    )
    wind = WeatherEntry(
        at_s=0.0,
        wind_speed_m_s=speed_m_s,
        wind_from_deg=from_deg,
        dead_1h_pct=5.0,
        dead_10h_pct=6.0,
        dead_100h_pct=7.0,
        live_herb_pct=60.0,
        live_woody_pct=90.0,
    )
    place = Ignition(lat_deg=LAT_DEG, lon_deg=LON_DEG)
    changed = {"landscape": level, "weather": (wind,), "ignition": (place,), "start_s": 0.0}
    return load_scenario("default").model_copy(update=changed)


def images(factor: float, count: int) -> Iterator[tuple[Observed, np.ndarray]]:
    """Yield images of the whole fire, and its burned cells; it spreads ``factor`` times as fast."""
    fire = fire_of(scenario(), landscape_of(scenario()))
    fire.perturb(1.0, 0.0, factor)
    for number in range(1, count + 1):
        at_s = EVERY_S * number
        fire.advance(at_s)
        codes = np.where(fire.burned(), b"b", b"u").view(np.uint8)
        yield Observed(round(at_s * US), "hawk", 0, 0, in_letters(codes)), fire.burned().copy()


def errors(estimate: RunEstimate, factor: float, count: int = 5) -> list[float]:
    """Return the share of the fire by which the estimate differs just before each image."""
    found = []
    for image, burned in images(factor, count):
        estimate.advance(image.at_us)
        wrong = np.count_nonzero(estimate.fire.burned() ^ burned)
        found.append(float(wrong / np.count_nonzero(burned)))
        estimate.on_event(image)
        estimate.advance(image.at_us + 60 * US)
    return found


@pytest.mark.parametrize("factor", [0.5, 1.7])
def test_a_wrong_rate_is_learned_from_images(factor: float) -> None:
    estimate = RunEstimate(scenario(), landscape_of(scenario()))
    found = errors(estimate, factor)
    assert found[0] > 0.3
    assert found[-1] < 0.3 * found[0]


def test_what_was_learned_of_the_rate_outlives_a_wind_report() -> None:
    estimate = RunEstimate(scenario(), landscape_of(scenario()))
    *_, (last, _) = images(1.7, 4)
    errors(estimate, 1.7, 4)
    at_us = last.at_us + 120 * US
    estimate.apply_report(WindSet(at_us, "service", "", 2.0, 270.0))
    found = []
    for image, burned in images(1.7, 6):
        if image.at_us > at_us:
            estimate.advance(image.at_us)
            found.append(np.count_nonzero(estimate.fire.burned() ^ burned) / burned.sum())
            break
    assert found[0] < 0.15


def test_equal_images_give_equal_estimates() -> None:
    one, other = (RunEstimate(scenario(), landscape_of(scenario())) for _ in range(2))
    assert errors(one, 1.7, 3) == errors(other, 1.7, 3)
    np.testing.assert_array_equal(one.fire.arrival_time_s, other.fire.arrival_time_s)


def test_fire_behind_ground_seen_unburned_is_removed() -> None:
    estimate = RunEstimate(scenario(), landscape_of(scenario()))
    at_us = round(3.0 * 3600.0 * US)
    estimate.advance(at_us)
    middle, burned = CELLS // 2, estimate.fire.burned()
    reach = int(np.nonzero(burned[middle])[0].max())
    assert reach > middle + 8
    # A strip across the head of the fire is unburned; the ground ahead of it is not in the image.
    rows = ("u" * 3,) * CELLS
    estimate.on_event(Observed(at_us, "hawk", 0, middle + 4, rows))
    estimate.on_event(Observed(at_us + 60 * US, "hawk", 0, 0, ("...",)))  # ends the period
    estimate.advance(at_us + 60 * US)
    assert not estimate.fire.burned()[middle, middle + 4 :].any()
    assert estimate.fire.burned()[middle, middle]


def for_fronts() -> RunEstimate:
    """Return the estimate of a run whose planners use fronts."""
    settings = scenario()
    planner = settings.planner.model_copy(update={"rule": "informative"})
    changed = settings.model_copy(update={"planner": planner})
    return RunEstimate(changed, landscape_of(settings))


def position(name: str, at_us: int) -> Telemetry:
    """Return a position over the middle of the fire."""
    return Telemetry(at_us, name, LAT_DEG, LON_DEG, 300.0, 150.0, 15.0, 0.0, 0.0)


def test_fronts_for_planners_follow_images_within_ten_seconds() -> None:
    """In this time, a vehicle flies about as far as its camera sees ahead."""
    estimate = for_fronts()
    begun_us = 3601 * US
    middle = CELLS // 2
    estimate.advance(begun_us)
    reach = int(np.nonzero(estimate.fire.burned()[middle])[0].max())
    estimate.on_event(Observed(begun_us, "hawk", middle - 2, reach, ("b" * 8 + "u" * 3,) * 5))
    found = estimate.fronts(position("hawk", begun_us + 10 * US))
    assert found is not None
    assert max(found.fronts[0].cols) == pytest.approx(reach + 7.5, abs=0.7)


def test_fronts_at_an_earlier_position_of_a_second_vehicle_do_not_depend_on_reads() -> None:
    found = []
    for reads in (False, True):
        estimate = for_fronts()
        estimate.on_event(position("kite", 3605 * US))
        if reads:
            estimate.advance(3605 * US)
        found.append(estimate.fronts(position("hawk", 3600 * US)))
    assert found[0] is not None
    assert found[0] == found[1]
