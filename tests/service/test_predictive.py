"""The extrapolated front, and the planner that uses it."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from firemodel.assimilation.observation import BURNED, UNBURNED
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from mission_service.experiments.fires import BRUSH, Burn, burn, flat, of_one_fuel, wind
from mission_service.experiments.islam_hu.ideal_flight import fly
from mission_service.experiments.islam_hu.measured_wind import MeasuredWind
from mission_service.experiments.islam_hu.predictive_flight import (
    fly_predictive,
    predictive_planner,
)
from mission_service.experiments.islam_hu.scenarios import islam_hu_planner
from mission_service.guidance.fire_map import BEARINGS, EAST, NORTH
from mission_service.guidance.front.front_estimate import FrontEstimate
from mission_service.guidance.front.front_mixture import FrontMixture
from mission_service.guidance.front.front_path import PathSettings
from mission_service.guidance.front.front_shape import hull_of
from mission_service.guidance.front.predictive_planner import (
    PredictivePlanner,
    PredictiveSettings,
    model_of,
)
from mission_service.guidance.front.robust_front import robust_front
from mission_service.guidance.front.sweeps import NODES, PLANS, CoarseRing, costs_of, fill_ring
from mission_service.replay.distance_error import TrueShape
from tests.service.random_fires import mean_max_errors
from tests.service.wrong_models import mean_max_errors_wrong

Floats = NDArray[np.float64]
SHAPE = (200, 200)
END_S = 10800.0
CENTRE = (100.0, 100.0)
ROWS, COLS = np.indices(SHAPE).astype(float)


def burned_ellipse(rate: Floats, at_s: float) -> NDArray[np.uint8]:
    """Return a grid (y, x) with a fire that spreads with these rates (cells/s, 360)."""
    south, east = ROWS - CENTRE[0], COLS - CENTRE[1]
    bearing = np.rad2deg(np.arctan2(east, -south)) % 360.0
    reach = np.interp(bearing, np.arange(BEARINGS), rate, period=360.0) * at_s
    return np.where(np.hypot(south, east) <= reach, BURNED, UNBURNED).astype(np.uint8)


def ellipse_rate(head_cells_s: float, eccentricity: float) -> Floats:
    return head_cells_s * (1.0 - eccentricity) / (1.0 - eccentricity * EAST)


def brush_fire(*weather: tuple[float, float, float], scheme: str = "anyangle") -> Burn:
    """Return three hours of a fire in even brush under winds (at_s, speed, from)."""
    stream = WeatherStream([wind(*entry) for entry in weather])
    lit = (int(CENTRE[0]), int(CENTRE[1]))
    return burn("test", scheme, flat(of_one_fuel(BRUSH)), stream, lit, END_S, 2.0)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def turning() -> Burn:
    return brush_fire((0.0, 6.0, 180.0), (5400.0, 6.0, 60.0))


def estimated(fire: Burn, wind_given: bool = True) -> FrontEstimate:
    """Return the front estimated from the ignition on, with the exact wind or only the first."""
    model = model_of(fire.landscape, fire.weather.entries[0])
    estimate = FrontEstimate(SHAPE, CENTRE, model, np.full(BEARINGS, 0.5), 0.0)
    for at_s in range(0, int(END_S), 60):
        now = fire.weather.weather_at(at_s if wind_given else 0.0)
        estimate.add_wind(now.wind_speed_m_s, now.wind_from_deg, float(at_s))
        estimate.advance(at_s + 60.0)
    return estimate


def test_a_measured_ellipse_is_extrapolated_without_any_model() -> None:
    rate = ellipse_rate(0.012, 0.6)
    estimate = FrontEstimate(SHAPE, CENTRE, None, np.full(BEARINGS, 0.5), 0.0)
    for at_s in (1800.0, 3600.0):
        estimate.add_window(0, 0, burned_ellipse(rate, at_s), at_s)
    frozen = estimate.front.copy()
    estimate.advance(5400.0)
    off = np.abs(estimate.front - rate * 5400.0)
    assert off.max() < 2.0  # the error of the cells' corners
    assert off.mean() < 0.6
    assert np.abs(frozen - rate * 5400.0).max() > 15.0


def test_the_model_alone_grows_the_fire_that_burns() -> None:
    fire = brush_fire((0.0, 4.0, 225.0))
    true = TrueShape(fire.arrival_s, fire.ignition).distances_at(END_S)
    off = np.abs(estimated(fire).front - true)
    assert true.max() > 25.0
    assert off.max() < 3.0
    assert off.mean() < 1.0


def test_wind_that_turns_turns_the_belief(turning: Burn) -> None:
    true = TrueShape(turning.arrival_s, turning.ignition).distances_at(END_S)
    given, first_only = (estimated(turning, given).front for given in (True, False))
    assert np.abs(given - true).mean() < 1.5
    assert np.abs(first_only - true).mean() > 4.0 * np.abs(given - true).mean()


def test_two_looks_seconds_apart_teach_nothing() -> None:
    rate = ellipse_rate(0.01, 0.5)
    estimate = FrontEstimate(SHAPE, CENTRE, None, np.full(BEARINGS, 0.5), 0.0)
    for at_s in (1800.0, 3600.0):
        estimate.add_window(0, 0, burned_ellipse(rate, at_s), at_s)
    before = estimate.factors()
    estimate.add_window(
        0, 0, burned_ellipse(rate, 3660.0), 3605.0
    )  # a whole cell within five seconds
    assert np.abs(estimate.factors() - before).max() < 0.02
    estimate.add_window(0, 0, burned_ellipse(1.5 * rate, 5400.0), 5400.0)  # half an hour later
    assert (estimate.factors() > 1.2 * before)[60:120].all()


def test_a_front_that_moves_in_whole_cells_has_a_steady_speed() -> None:
    rate = np.full(BEARINGS, 0.005)
    estimate = FrontEstimate(SHAPE, CENTRE, None, np.full(BEARINGS, 0.5), 0.0)
    off, naive, before = [], [], 0.0
    for at_s in np.arange(3600.0, 9000.0, 150.0):
        window = burned_ellipse(rate, float(at_s))
        estimate.add_window(0, 0, window, float(at_s))
        off.append(estimate.speed_cells_s[90] / 0.005 - 1.0)
        cell = float(np.flatnonzero(window[100, 100:] == BURNED)[-1])
        naive.append((cell - before) / 150.0 / 0.005 - 1.0)
        before = cell
    assert np.abs(naive[10:]).max() > 0.3  # whole cells
    assert np.abs(off[10:]).max() < 0.15


def test_the_factor_adapts_to_a_fire_slower_than_the_model() -> None:
    fire = brush_fire((0.0, 7.0, 225.0), scheme="devs8")  # an octagon inside the model's ellipse
    true = TrueShape(fire.arrival_s, fire.ignition)
    estimate = FrontEstimate(
        SHAPE, CENTRE, model_of(fire.landscape, fire.weather.entries[0]), np.full(360, 0.5), 0
    )
    estimate.add_wind(7.0, 225.0, 0.0)
    for at_s in (1800.0, 3600.0, 5400.0, 7200.0):
        window = np.where(fire.burned(at_s), BURNED, UNBURNED).astype(np.uint8)
        estimate.add_window(0, 0, window, at_s)
    unadapted = FrontEstimate(SHAPE, CENTRE, estimate.model, estimate.front, 7200.0)
    unadapted.add_wind(7.0, 225.0, 7200.0)
    for one in (estimate, unadapted):
        one.advance(END_S)
    adapted_off, plain_off = (
        np.abs(one.front - true.distances_at(END_S)) for one in (estimate, unadapted)
    )
    assert adapted_off.mean() < 0.7 * plain_off.mean()
    assert adapted_off.max() < 4.0


def ring(hot: slice, growth: float = 10.0) -> CoarseRing:
    """Return a ring with a minute between nodes; the error of one arc grows faster."""
    values = CoarseRing(*(np.full(NODES, value) for value in (60.0, 60.0, 0.5, 1e-4, 0.5)))
    values.growth[hot] *= growth
    values.error[hot] += 3.0
    return values


def min_cost(values: CoarseRing, clockwise: bool, turn_s: float) -> float:
    found = np.empty(len(PLANS))
    delay_s = 0.0 if clockwise else turn_s
    costs_of(PLANS, values, 36, clockwise, delay_s, turn_s, 2 * NODES * 60.0, found)
    return float(found.min())


def test_it_turns_back_to_a_hot_arc_unless_turning_takes_too_long() -> None:
    behind = ring(slice(28, 34))
    assert min_cost(behind, False, 0.0) < 0.9 * min_cost(behind, True, 0.0)
    assert min_cost(behind, False, 7200.0) > min_cost(behind, True, 7200.0)
    ahead = ring(slice(38, 44))
    assert min_cost(ahead, True, 0.0) < 0.9 * min_cost(ahead, False, 0.0)


def test_an_even_front_is_circled() -> None:
    values = ring(slice(0, 0))
    values.error[:] = 0.5 + 1e-4 * 60.0 * ((36 - np.arange(NODES)) % NODES)  # flown clockwise
    assert min_cost(values, True, 0.0) < min_cost(values, False, 0.0)


def test_ground_speed_along_the_ring_is_that_of_the_wind_triangle() -> None:
    values, node_of = ring(slice(0, 0)), np.zeros(BEARINGS, np.int64)
    even, none = np.full(BEARINGS, 40.0), np.zeros(BEARINGS)
    length = fill_ring(even, none, none, none, 0.6, np.array([0.0, 0.2]), node_of, values)
    assert length == pytest.approx(2 * np.pi * 40.0, rel=1e-3)
    assert values.ahead_s[node_of[0]] / values.back_s[node_of[0]] == pytest.approx(
        (0.6 - 0.2) / (0.6 + 0.2), rel=0.05
    )
    west = int(node_of[270])  # in this part it flies across the wind
    assert values.ahead_s[west] / values.back_s[west] == pytest.approx(1.0, rel=0.05)
    assert values.ahead_s[west] > 1.03 * length / NODES / 0.6
    assert values.ahead_s.sum() > 1.05 * length / 0.6


def test_ring_times_use_the_wind_of_the_grid() -> None:
    """Grid north differs by 15 degrees from true north."""
    codes = np.full(SHAPE, 1, np.int16)
    land = Landscape("EPSG:5070", -2.0e6, 1.5e6, 30.0, codes, np.zeros(SHAPE, np.float32))
    settings = PredictiveSettings(True, True, 0.5, 2.0, True, 1.0, PathSettings(10.0, 2.0))
    model = model_of(land, wind(0.0, 0.0, 0.0))
    planner = PredictivePlanner(settings, SHAPE, CENTRE, 0.0, 30.0, model)
    planner.wind(10.0, land.true_deg(270.0) % 360.0, 0.0)
    planner._fill_ring()
    expected, none = ring(slice(0, 0)), np.zeros(BEARINGS)
    to_east = np.array([0.0, 10.0 / 30.0])
    fill_ring(planner.fronts.front, none, none, none, 0.5, to_east, planner._node_of, expected)
    assert abs(land.grid_convergence_deg) > 10.0
    np.testing.assert_allclose(planner._ring.ahead_s, expected.ahead_s, rtol=1e-9)
    np.testing.assert_allclose(planner._ring.back_s, expected.back_s, rtol=1e-9)


def test_a_vehicle_that_needs_room_turns_less(turning: Burn) -> None:
    turns = []
    for radius in (0.0, 40.0):
        planner = predictive_planner(turning, modelled=False)
        planner.settings = replace(planner.settings, turn_radius_cells=radius)
        fly(turning, planner, hull=False)
        turns.append(planner.reversals)
    assert turns[1] <= turns[0]
    assert turns[1] <= 2


def test_better_than_circling_worse_without_model_and_always_the_same(turning: Burn) -> None:
    circling = fly(turning, islam_hu_planner(turning, "circling")).max_error.mean()
    predictive = fly_predictive(turning)
    blind = fly(turning, predictive_planner(turning, modelled=False), hull=False)
    assert circling > 4.0
    assert predictive.max_error.mean() < 0.5 * circling
    assert predictive.max_error.mean() < blind.max_error.mean() < 0.9 * circling
    again = fly_predictive(turning)
    np.testing.assert_array_equal(predictive.track, again.track)
    np.testing.assert_array_equal(predictive.max_error, again.max_error)


def test_a_fire_whose_ignition_is_unknown(turning: Burn) -> None:
    with_ignition = predictive_planner(turning)
    unknown = PredictivePlanner(
        replace(with_ignition.settings, ignition_known=False),
        SHAPE,
        (CENTRE[0] - 4.0, CENTRE[1] + 3.0),
        0.0,
        turning.landscape.cell_size_m,
        with_ignition.estimate.model,
    )
    fly(turning, unknown, measured=MeasuredWind(turning.weather, 1))
    estimate = unknown.estimate
    rows, cols = (
        estimate.centre_row - estimate.front * NORTH,
        estimate.centre_col + estimate.front * EAST,
    )
    true = TrueShape(turning.arrival_s, (round(estimate.centre_row), round(estimate.centre_col)))
    assert np.hypot(estimate.centre_row - CENTRE[0], estimate.centre_col - CENTRE[1]) > 2.0
    assert np.isfinite(rows + cols).all()
    assert np.abs(estimate.front - true.distances_at(turning.end_s)).mean() < 2.0


def test_hull_is_that_of_geometry_and_a_smooth_front_is_not_hedged() -> None:
    rng = np.random.default_rng(4)
    for shape in (
        rng.uniform(1.0, 50.0, BEARINGS),
        20.0 + 10.0 * np.cos(np.deg2rad(np.arange(360))),
    ):
        corners = np.column_stack([shape * EAST, shape * NORTH])
        hull = shapely.MultiPoint(corners).convex_hull
        rays = shapely.linestrings(
            [[(0.0, 0.0), (99.0 * x, 99.0 * y)] for x, y in zip(EAST, NORTH, strict=True)]
        )
        expected = shapely.length(shapely.intersection(rays, hull))
        np.testing.assert_allclose(hull_of(shape), expected, rtol=1e-9)
    np.testing.assert_allclose(robust_front(np.full(BEARINGS, 30.0)), 30.0, atol=0.05)
    leap = np.where(np.arange(BEARINGS) < 180, 20.0, 40.0)
    assert robust_front(leap)[179] == pytest.approx(30.0, abs=6.0)


@pytest.mark.parametrize("seed", [12])
def test_no_worse_than_circling_on_fires_of_chance(seed: int) -> None:
    circling, predictive = mean_max_errors(seed)
    assert 7.0 <= circling <= 16.0
    assert predictive < 0.8 * circling


def test_a_wrong_model_is_no_worse_than_circling() -> None:
    """On fire 216, the front of the model alone is 0.9 times as wrong as circling."""
    circling, predictive, alone = mean_max_errors_wrong(216)
    assert predictive < 0.75 * circling
    assert predictive < 0.3 * alone


def test_the_mixture_follows_the_model_only_while_it_predicts_the_views() -> None:
    fire = brush_fire((0.0, 4.0, 225.0))
    model = model_of(fire.landscape, fire.weather.entries[0])
    shares = []
    for from_deg in (225.0, 45.0):
        fronts = FrontMixture(SHAPE, CENTRE, model, np.full(BEARINGS, 0.5), 0.0)
        fronts.add_wind(4.0, from_deg, 0.0)
        for at_s in (1800.0, 3600.0, 5400.0, 7200.0):
            fronts.add_window(
                0, 0, np.where(fire.burned(at_s), BURNED, UNBURNED).astype(np.uint8), at_s
            )
        shares.append(fronts.model_share)
        true = TrueShape(fire.arrival_s, fire.ignition).distances_at(at_s)
        assert np.abs(fronts.front - true).max() < 2.0
    assert shares[0] > 0.2
    assert shares[1] < 0.01


def test_a_mixture_without_a_model_is_the_measured_front() -> None:
    fronts = FrontMixture(SHAPE, CENTRE, None, np.full(BEARINGS, 0.5), 0.0)
    rate = ellipse_rate(0.012, 0.6)
    for at_s in (1800.0, 3600.0):
        fronts.add_window(0, 0, burned_ellipse(rate, at_s), at_s)
    fronts.advance(5400.0)
    np.testing.assert_array_equal(fronts.front, fronts.modelled.front)


def test_a_correction_moves_all_parts_of_the_mixture(turning: Burn) -> None:
    model = model_of(turning.landscape, turning.weather.entries[0])
    fronts = FrontMixture(SHAPE, CENTRE, model, np.full(BEARINGS, 0.5), 0.0)
    fronts.add_wind(6.0, 180.0, 0.0)
    fronts.add_window(0, 0, burned_ellipse(np.full(BEARINGS, 0.01), 3600.0), 3600.0)
    fronts.correct_window(0, 0, burned_ellipse(np.full(BEARINGS, 0.005), 3600.0), 3601.0)
    assert np.abs(fronts.front - 18.0).max() < 2.0
