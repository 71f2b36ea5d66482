"""An estimate is corrected by observations from cameras and mapped perimeters."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from shapely.affinity import translate

from firemodel.assimilation.fire_estimate import EstimateSettings, FireEstimate
from firemodel.assimilation.held_cells import HELD_S, HeldCells, ground_behind
from firemodel.assimilation.observation import (
    BURNED,
    UNBURNED,
    UNSEEN,
    Observation,
    despeckled,
    mapped_perimeter,
)
from firemodel.assimilation.scores import overlap
from firemodel.ensemble.draws import latin_draws
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.errors import FireModelError
from firemodel.landscape.flat import flat_landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival, burning_from_perimeter

CELLS, CELL_M = 80, 30.0
LAND = flat_landscape(CELLS, CELLS, CELL_M, 37.0, -120.0, 100.0, 2)
WIND = WeatherStream([Weather(0.0, 3.0, 270.0, 6.0, 7.0, 8.0, 60.0, 90.0)])
MIDDLE = (CELLS // 2, CELLS // 3)
STEP_S = 900.0
SETTINGS = EstimateSettings(20, 5, Uncertainty(spread_log_sd=0.5, wind_turn_sd_deg=5.0))


def true_fire(rate: float) -> AnyAngleFire:
    """Return a fire that spreads ``rate`` times as fast as the model, until 3 h."""
    fire = AnyAngleFire(LAND, WIND, [(*MIDDLE, 0.0)])
    fire.perturb(1.0, 0.0, rate)
    fire.advance(10_800.0)
    return fire


def perimeter_at(fire: AnyAngleFire, at_s: float) -> Observation:
    return mapped_perimeter(fire.front(at_s), LAND, at_s, source=f"map at {at_s:g} s")


def after_perimeters(fire: AnyAngleFire, count: int) -> FireEstimate:
    estimate = FireEstimate(LAND, WIND, settings=SETTINGS)
    for number in range(1, count + 1):
        estimate.assimilate(perimeter_at(fire, 1800.0 + number * STEP_S))
    return estimate


@pytest.mark.parametrize("rate", [0.35, 2.0])
def test_rates_of_mapped_perimeters_improve_the_forecast(rate: float) -> None:
    fire = true_fire(rate)
    estimate = after_perimeters(fire, 3)
    later_s = estimate.time_s + STEP_S
    true = fire.arrival_time_s <= later_s
    alone = AnyAngleFire(LAND, WIND, []).restarted(
        burning_from_perimeter([fire.front(estimate.time_s)], LAND, estimate.time_s)
    )
    alone.advance(later_s)
    found = estimate.forecast(later_s).likely_burned(later_s)
    assert overlap(found, true) > overlap(alone.burned(), true)
    assert overlap(found, true) > overlap(fire.arrival_time_s <= estimate.time_s, true)


def test_a_side_that_is_held_stays_in_the_forecast() -> None:
    fire = true_fire(1.0)
    estimate = FireEstimate(LAND, WIND, settings=SETTINGS)
    line = MIDDLE[1] + 8
    west = np.arange(CELLS)[None, :] < line
    for number in range(1, 6):
        at_s = 1800.0 + number * STEP_S
        burned = np.where((fire.arrival_time_s <= at_s) & west, 0.0, np.inf)
        area = burning_from_arrival(burned, LAND, 0.0).area
        estimate.assimilate(mapped_perimeter(area, LAND, at_s))
    later_s = estimate.time_s + STEP_S
    probability = estimate.forecast(later_s).burn_probability(later_s)
    held = probability[MIDDLE[0] - 3 : MIDDLE[0] + 4, line + 1]
    flank = probability[:, MIDDLE[1] - 2]
    moving = flank[(flank > 0.0) & (flank < 1.0)].max()
    assert held.max() < 0.5 < moving


def in_winds(*winds_m_s: float) -> WeatherStream:
    """Return westerly winds that change every half hour."""
    entry = WIND.entries[0]
    return WeatherStream(
        [
            replace(entry, at_s=1800.0 * number, wind_speed_m_s=speed_m_s)
            for number, speed_m_s in enumerate(winds_m_s)
        ]
    )


def test_a_lull_does_not_raise_the_later_winds_of_members() -> None:
    later_s = 5400.0
    areas = []
    for winds_m_s in ((6.0, 6.0, 6.0), (6.0, 0.3, 6.0), (6.0, 0.0, 6.0)):
        estimate = FireEstimate(LAND, in_winds(*winds_m_s), [(*MIDDLE, 0.0)], EstimateSettings(20))
        estimate.advance(2400.0)
        areas.append(float(estimate.forecast(later_s).burn_probability(later_s).sum()))
    steady, lull, calm = areas
    assert lull < 0.8 * steady
    assert calm == pytest.approx(lull, rel=0.1)


def test_members_have_the_drawn_winds_in_each_later_entry_and_differ_in_calm() -> None:
    stream = in_winds(0.0, 6.0, 12.0)
    settings = EstimateSettings(20, 3)
    estimate = FireEstimate(LAND, stream, [(*MIDDLE, 0.0)], settings)
    fuels = len(LAND.burnable_codes)
    calm_m_s = []
    for number, draw in enumerate(latin_draws(settings.uncertainty, 3, 20, fuels)):
        reported = estimate.model.weather.entries
        factors, turns_deg = estimate.members.wind_changes(number, reported)
        assert factors[1] == pytest.approx(draw.wind_factor)
        assert math.cos(math.radians(turns_deg[1] - draw.turn_deg)) == pytest.approx(1.0)
        calm_m_s.append(factors[0] * reported[0].wind_speed_m_s)
        if factors[1] < 2.0:  # larger errors of strong winds are limited
            assert factors[2] == pytest.approx(draw.wind_factor)
            assert turns_deg[2] == pytest.approx(turns_deg[1])
    assert 0.5 < np.median(calm_m_s) < 2.5
    assert max(calm_m_s) < 6.0


def test_threads_do_not_change_the_estimate() -> None:
    fire = true_fire(0.7)
    one = after_perimeters(fire, 2).forecast(6000.0).burn_probability(6000.0)
    with ThreadPoolExecutor(3) as pool:
        estimate = FireEstimate(LAND, WIND, settings=SETTINGS)
        for number in (1, 2):
            estimate.assimilate(perimeter_at(fire, 1800.0 + number * STEP_S), pool.map)
        many = estimate.forecast(6000.0, pool.map).burn_probability(6000.0)
    np.testing.assert_array_equal(one, many)


def test_a_forecast_is_a_probability_that_rises_with_time() -> None:
    estimate = after_perimeters(true_fire(1.0), 2)
    forecast = estimate.forecast(estimate.time_s + 3600.0)
    times_s = estimate.time_s + np.linspace(0.0, 3600.0, 5)
    found = [forecast.burn_probability(float(at_s)) for at_s in times_s]
    assert all(((each >= 0.0) & (each <= 1.0)).all() for each in found)
    expected = [each.sum() for each in found]
    assert expected == sorted(expected)
    with pytest.raises(FireModelError, match="is outside"):
        forecast.burn_probability(estimate.time_s + 3601.0)


def test_the_likely_area_has_the_largest_expected_overlap() -> None:
    estimate = after_perimeters(true_fire(1.0), 1)
    later_s = estimate.time_s + 1800.0
    forecast = estimate.forecast(later_s)
    probability = forecast.burn_probability(later_s)

    def expected(area: np.ndarray) -> float:
        return float(probability[area].sum() / (area.sum() + probability[~area].sum()))

    best = expected(forecast.likely_burned(later_s))
    assert all(best >= expected(probability >= limit) for limit in (0.2, 0.35, 0.5, 0.65, 0.8))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda seen: seen._replace(at_s=100.0), "not later than that of the last observation"),
        (
            lambda seen: mapped_perimeter(translate(seen.area, 900.0, 600.0), LAND, seen.at_s),
            "of the area that had burned",
        ),
    ],
)
def test_an_implausible_perimeter_is_refused_and_changes_nothing(change, words) -> None:  # type: ignore[no-untyped-def]
    fire = true_fire(1.0)
    one, other = after_perimeters(fire, 2), after_perimeters(fire, 2)
    with pytest.raises(FireModelError, match=words):
        one.assimilate(change(perimeter_at(fire, 5000.0)))
    later_s = one.time_s + 1800.0
    np.testing.assert_array_equal(
        one.forecast(later_s).burn_probability(later_s),
        other.forecast(later_s).burn_probability(later_s),
    )


def image(arrival_s: np.ndarray, at_s: float, row: int, col: int, radius: int = 10) -> Observation:
    """Return a perfect image of a fire around a cell."""
    top, left = max(row - radius, 0), max(col - radius, 0)
    window = arrival_s[top : row + radius + 1, left : col + radius + 1]
    return Observation(at_s, top, left, np.where(window <= at_s, BURNED, UNBURNED).astype(np.uint8))


def watched(rate: float) -> tuple[FireEstimate, AnyAngleFire]:
    """Return an estimate after an hour of images of a fire with another rate."""
    fire = true_fire(rate)
    estimate = FireEstimate(LAND, WIND, [(*MIDDLE, 0.0)], SETTINGS)
    for at_s in np.arange(600.0, 4201.0, 300.0):
        rows, cols = np.nonzero(fire.arrival_time_s <= at_s)
        for place in (int(np.argmax(cols)), int(np.argmin(cols)), int(np.argmax(rows))):
            estimate.assimilate(
                image(fire.arrival_time_s, float(at_s), int(rows[place]), int(cols[place]))
            )
    return estimate, fire


@pytest.mark.parametrize("rate", [0.5, 1.8])
def test_images_correct_rates_and_the_fire(rate: float) -> None:
    estimate, fire = watched(rate)
    mean = float(estimate.members.log_rate.mean())
    assert (mean < -0.05) if rate < 1.0 else (mean > 0.2)
    now = overlap(estimate.burned(), fire.arrival_time_s <= estimate.time_s)
    later_s = estimate.time_s + 1800.0
    model = AnyAngleFire(LAND, WIND, [(*MIDDLE, 0.0)])
    model.advance(later_s)
    true = fire.arrival_time_s <= later_s
    found = estimate.forecast(later_s).likely_burned(later_s)
    assert now > 0.85
    assert overlap(found, true) > overlap(model.burned(), true) + 0.1


def test_an_image_sets_the_cells_that_it_shows() -> None:
    fire = true_fire(1.0)
    estimate = FireEstimate(LAND, WIND, [(*MIDDLE, 0.0)], SETTINGS)
    estimate.advance(3600.0)
    seen = image(fire.arrival_time_s, 3600.0, *MIDDLE, radius=20)
    estimate.assimilate(seen)
    np.testing.assert_array_equal(estimate.burned()[seen.where], seen.state == BURNED)


def test_an_image_before_any_fire_is_refused() -> None:
    with pytest.raises(FireModelError, match="there is no fire yet"):
        FireEstimate(LAND, WIND).assimilate(image(np.full(LAND.shape, np.inf), 10.0, 40, 40))


def test_a_single_wrong_cell_is_filtered() -> None:
    state = np.full((9, 9), UNBURNED, dtype=np.uint8)
    state[4, 4], state[:, 0] = BURNED, UNSEEN
    found = despeckled(Observation(0.0, 0, 0, state, false_alarms=0.01))
    corners = np.zeros_like(state, dtype=bool)  # too few cells are in view
    corners[[0, 0, -1, -1], [1, -1, 1, -1]] = True
    assert (found[:, 1:][~corners[:, 1:]] == UNBURNED).all()
    assert (found[corners] == UNSEEN).all()
    assert (found[:, 0] == UNSEEN).all()
    np.testing.assert_array_equal(despeckled(Observation(0.0, 0, 0, state)), state)


def test_cells_count_as_held_after_a_time_and_not_once_burned() -> None:
    held = HeldCells((20, 20))
    here = np.s_[5:15, 5:15]
    state = np.full((10, 10), UNBURNED, dtype=np.uint8)
    share = np.zeros((10, 10))
    share[4:6] = 0.9
    times_s = np.arange(0.0, 2.0 * HELD_S, 100.0)
    for at_s in times_s:
        held.add_observation(here, state, float(at_s), share)
    assert held.held()[9:11, 5:15].all()
    assert not held.held()[5:8].any()
    state[4] = BURNED
    held.add_observation(here, state, float(times_s[-1] + 100.0), share)
    assert not held.held()[9, 5:15].any()


def test_ground_behind_a_held_front_is_held_but_not_behind_one_slow_patch() -> None:
    front = np.zeros((60, 60), dtype=bool)
    front[30] = True
    held = np.zeros_like(front)
    held[30, :30] = True
    behind = ground_behind(held, front)
    assert behind[31:, :20].all()
    assert not behind[31:, 40:].any()
    held[30, 4:] = False
    assert not ground_behind(held, front)[31:, 20:].any()
    held[:] = False
    held[30, 28:32] = True
    assert not ground_behind(held, front).any()


def test_a_restarted_fire_equals_a_new_fire_from_the_same_state() -> None:
    fire = true_fire(1.0)
    burning = burning_from_arrival(fire.arrival_time_s, LAND, 3000.0)
    fresh = AnyAngleFire(LAND, WIND.since(3000.0), [], burning)
    again = AnyAngleFire(LAND, WIND, []).restarted(burning)
    for each in (fresh, again):
        each.advance(7000.0)
    np.testing.assert_array_equal(fresh.arrival_time_s, again.arrival_time_s)
    twice = AnyAngleFire(LAND, WIND, []).restarted(burning, spread_factor=2.0)
    twice.advance(5000.0)
    np.testing.assert_allclose(twice.burned_ha, again.burned_ha, rtol=0.02)


@pytest.mark.parametrize("count", [1, 3])
def test_the_arrival_at_single_cells_is_that_of_the_whole_forecast(count: int) -> None:
    """For members alone (one perimeter) and with learned rates (three perimeters)."""
    forecast = after_perimeters(true_fire(1.3), count).forecast(8000.0)
    cells = np.arange(0, CELLS * CELLS, 37)
    times_s = np.linspace(forecast.at_s, forecast.until_s, 60).tolist()
    whole = forecast.arrival_quantiles_s((0.1, 0.5, 0.9), times_s).reshape(3, -1)[:, cells]
    at_cells = forecast.at_places([np.array([cell]) for cell in cells])
    np.testing.assert_array_equal(
        at_cells.arrival_quantiles_s((0.1, 0.5, 0.9), times_s)[:, 0], whole
    )
    for share, reached_s in zip((0.1, 0.5, 0.9), whole, strict=True):
        for at_s in (times_s[0], times_s[20]):
            burned = forecast.burn_probability(at_s).flat[cells] >= share
            np.testing.assert_array_equal(reached_s <= at_s, burned)
    assert (np.diff(np.where(np.isinf(whole), 1e9, whole), axis=0) >= 0.0).all()


def test_fire_reaches_a_place_at_its_first_cell() -> None:
    forecast = after_perimeters(true_fire(1.0), 1).forecast(12_000.0)
    row = MIDDLE[0] * CELLS
    ahead = np.arange(row + 42, row + 55)
    times_s = np.linspace(forecast.at_s, forecast.until_s, 60).tolist()
    places = [ahead, ahead[:1], ahead[::-1][:1]]
    together_s, first_s, last_s = forecast.at_places(places).arrival_quantiles_s((0.1,), times_s)[
        0, 0
    ]
    assert together_s == first_s < last_s
    assert forecast.at_places([]).arrival_quantiles_s((0.1,), times_s).shape == (1, 1, 0)
