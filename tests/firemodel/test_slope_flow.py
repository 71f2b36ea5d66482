"""Slope flow by day and by night."""

from datetime import UTC, datetime

import numpy as np
import pytest

from firemodel.arrays import Floats
from firemodel.physics.sunlight import sun_at
from firemodel.wind import (
    REFERENCE_M,
    TerrainWind,
    slope_flow,
    slope_wind,
    sunlit_flux_w_m2,
    surface_of_height,
    terrain_wind,
)
from firemodel.wind.flow_grid import flow_grid
from firemodel.wind.slope_flow import heat_flux_w_m2
from firemodel.wind.slope_kernels import slope_lengths

CELL_M, RISE = 50.0, 0.3


def valley() -> Floats:
    """Return a valley that runs north, 600 m deep, between ridges in the west and the east."""
    col = np.indices((30, 81))[1]
    return np.asarray(RISE * CELL_M * np.abs(col - 40.0))


@pytest.fixture(scope="module")
def terrain() -> TerrainWind:
    ground = valley()
    return terrain_wind(ground, CELL_M, surface_of_height(np.full(ground.shape, 0.3)))


def test_slopes_are_followed_to_their_foot_and_to_their_crest() -> None:
    ground = valley()
    rise = np.zeros((2, *ground.shape))
    rise[1] = np.sign(np.arange(81) - 40.0) * RISE
    length, height = np.empty(ground.shape), np.empty(ground.shape)
    for upward, steps in ((False, 10), (True, 30)):
        slope_lengths(ground, rise, np.full(ground.shape, upward), CELL_M, length, height)
        assert height[15, 50] == pytest.approx(steps * CELL_M * RISE)
        assert length[15, 50] == pytest.approx(steps * CELL_M * np.hypot(1.0, RISE))
    assert height[15, 40] == 0.0  # level


def test_speeds_are_those_of_the_equations(terrain: TerrainWind) -> None:
    grid, flux = terrain.grid, 150.0
    place = (grid.inner[0].start + 15, grid.inner[1].start + 60)  # 20 cells above the foot
    up = slope_flow(grid, np.full(grid.elevation_m.shape, flux), 20.0)
    height_m = 20 * CELL_M * RISE
    expected = (flux * 9.81 * height_m / (0.4 * 1.2 * 1005.0 * 293.15)) ** (1.0 / 3.0)
    assert up.east_m_s[place] == pytest.approx(expected, rel=1e-3)
    assert up.depth_m[place] == pytest.approx(0.05 * height_m)
    down = slope_flow(grid, np.full(grid.elevation_m.shape, -40.0), 20.0)
    length_m = 20 * CELL_M * np.hypot(1.0, RISE)
    sine, friction = RISE / np.hypot(1.0, RISE), 0.0101
    equal = 40.0 * 9.81 * length_m * sine / (1.2 * 1005.0 * 293.15 * friction)
    grown = 1.0 - np.exp(-length_m * friction / (0.05 * height_m))
    assert down.east_m_s[place] == pytest.approx(-((equal * grown) ** (1.0 / 3.0)), rel=1e-3)


def test_the_flow_is_up_by_day_and_down_by_night(terrain: TerrainWind) -> None:
    begin = datetime(2024, 7, 1, 0, 0, tzinfo=UTC)
    winds = {}
    for hour in (0.0, 12.0):
        sun = sun_at(40.0, 0.0, begin, np.array([hour * 3600.0]))
        flux = sunlit_flux_w_m2(terrain.grid, sun, 0.0, 20.0)
        flow = slope_flow(terrain.grid, flux, 20.0)
        winds[hour] = slope_wind(terrain, flow, REFERENCE_M)
    east, west = 75, 5  # high on both slopes, where the layer is deeper than 20 ft
    noon, midnight = winds[12.0][1, 15], winds[0.0][1, 15]
    assert noon[east] > 0.5
    assert noon[west] < -0.5
    lower = (slice(14, 17), 45)
    assert winds[0.0][1][lower].max() < -0.5
    assert midnight[35] > 0.5
    assert all(np.isfinite(wind).all() for wind in winds.values())


def test_the_sunlit_slope_has_the_stronger_flow(terrain: TerrainWind) -> None:
    sun = sun_at(40.0, 0.0, datetime(2024, 7, 1, tzinfo=UTC), np.array([8.0 * 3600.0]))
    flux = sunlit_flux_w_m2(terrain.grid, sun, 0.0, 20.0)[15]
    first = terrain.grid.inner[1].start
    assert flux[first + 10] > 1.2 * flux[first + 70]  # the western slope faces the morning sun
    turned = sunlit_flux_w_m2(terrain.grid, sun, 180.0, 20.0)[15]
    assert turned[first + 10] == pytest.approx(flux[first + 70], rel=1e-6)


def test_the_sunlight_depends_on_true_north() -> None:
    """A landscape and its copy on a grid with north in the east have the same sunlight."""
    row, col = np.indices((30, 81))
    ground = valley() + 60.0 * np.sin(row / 4.0 + col / 9.0)
    sun = sun_at(40.0, 0.0, datetime(2024, 7, 1, tzinfo=UTC), np.array([9.0 * 3600.0]))
    fluxes = []
    for each, convergence_deg in ((ground, 0.0), (np.rot90(ground), 90.0)):
        grid = flow_grid(each, CELL_M)
        fluxes.append(sunlit_flux_w_m2(grid, sun, convergence_deg, 20.0)[grid.inner])
    assert np.allclose(fluxes[1], np.rot90(fluxes[0]), rtol=1e-5)


def test_heat_flux_is_negative_at_night_and_grows_with_sunlight() -> None:
    flux = heat_flux_w_m2(np.array([0.0, 200.0, 800.0]), 20.0)
    assert -60.0 < flux[0] < -20.0
    assert flux[0] < flux[1] < flux[2] < 300.0


def test_level_ground_has_no_slope_flow() -> None:
    terrain = terrain_wind(np.zeros((12, 12)), 30.0, surface_of_height(np.full((12, 12), 0.3)))
    flow = slope_flow(terrain.grid, np.full(terrain.grid.elevation_m.shape, 100.0), 20.0)
    assert not slope_wind(terrain, flow, REFERENCE_M).any()


def test_the_flow_turns_with_the_landscape() -> None:
    flows = []
    for ground in (valley(), np.rot90(valley())):
        terrain = terrain_wind(ground, CELL_M, surface_of_height(np.full(ground.shape, 0.3)))
        flow = slope_flow(terrain.grid, np.full(terrain.grid.elevation_m.shape, 100.0), 20.0)
        flows.append(slope_wind(terrain, flow, REFERENCE_M))
    # What was towards east is towards north after an anticlockwise turn.
    assert np.allclose(flows[1][0], np.rot90(flows[0][1]), atol=1e-3)
    assert np.abs(flows[1][0]).max() > 0.5
