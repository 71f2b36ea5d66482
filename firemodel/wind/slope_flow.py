"""Diurnal slope flow: wind up sunlit slopes by day and down cooling slopes at night.

The speeds are those of shallow layers on long slopes, with a balance of buoyancy, friction and
entrainment (Briggs 1979, NOAA ATDL 79/25, for upslope flow; Mahrt 1982, J. Atmos. Sci. 39, 2701,
for downslope flow; as functions of the heat flux in Scire et al. 2000, CALMET User's Guide). The
coefficients and the depth of the layer are WindNinja's (``cellDiurnal.cpp``).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.landscape.landscape import horn, turned
from firemodel.physics.sunlight import Sun, clear_sunlight_w_m2
from firemodel.wind.flow_grid import FlowGrid
from firemodel.wind.flow_solver import Stack, solve_potential
from firemodel.wind.slope_kernels import slope_lengths
from firemodel.wind.terrain_wind import MAX_DIVERGENCE, TerrainWind

GRAVITY_M_S2 = 9.81
AIR_J_M3_K = 1.2 * 1005.0  # heat capacity of air
FREEZING_K = 273.15
LAYER_DEPTH = 0.05  # depth of the layer as a fraction of the height difference
UPSLOPE_FRICTION = 0.2 + 0.2  # drag and entrainment coefficients
DOWNSLOPE_FRICTION = 0.0001 + 0.01
# Coefficients of Holtslag & van Ulden 1983 (J. Clim. Appl. Meteor. 22, 517).
STEFAN_BOLTZMANN = 5.67e-8
SKY_K6 = 5.31e-13
HEATING = 0.12
ALBEDO, BOWEN, INTO_GROUND = 0.25, 1.0, 0.15  # WindNinja's values for grassland


class SlopeFlow(NamedTuple):
    """The flow along slopes in each column of a grid, with its buffer."""

    north_m_s: Floats  # (y, x) towards north
    east_m_s: Floats
    depth_m: Floats  # (y, x) depth of the layer above the displaced ground


def heat_flux_w_m2(sunlight_w_m2: Floats, temperature_c: float) -> Floats:
    """Return the heat flux from the ground to the air under a clear sky, negative at night.

    The net radiation is that of Holtslag & van Ulden 1983 for sunlight on the ground. A fraction of
    it heats the ground, and the Bowen ratio divides the rest.
    """
    kelvin = temperature_c + FREEZING_K
    longwave = SKY_K6 * kelvin**6 - STEFAN_BOLTZMANN * kelvin**4
    net = ((1.0 - ALBEDO) * sunlight_w_m2 + longwave) / (1.0 + HEATING)
    flux: Floats = BOWEN / (1.0 + BOWEN) * (1.0 - INTO_GROUND) * net
    return flux


def sunlit_flux_w_m2(
    grid: FlowGrid, sun: Sun, convergence_deg: float, temperature_c: float
) -> Floats:
    """Return the heat flux from the ground to the air at one time, under a clear sky.

    Shading by ridges is not considered.

    Args:
        grid: The grid of the wind over terrain.
        sun: The sun at one time.
        convergence_deg: The direction of grid north, clockwise from true north.
        temperature_c: The temperature of the air.

    Returns:
        The flux (y, x) in W/m², with the buffer of the grid; negative at night.
    """
    north, east = horn(grid.elevation_m, grid.cell_m).astype(np.float64)
    true_rise = turned(north, east, convergence_deg)
    sunlight = clear_sunlight_w_m2(sun, grid.elevation_m, *true_rise)
    return heat_flux_w_m2(sunlight, temperature_c)


def slope_flow(grid: FlowGrid, flux_w_m2: Floats, temperature_c: float) -> SlopeFlow:
    """Return the slope flow for a heat flux.

    Upslope flow depends on the height above the foot of the slope, downslope flow on the distance
    and the height difference to the crest. The foot and the crest are found along the cell's
    direction of steepest rise.

    Args:
        grid: The grid of the wind over terrain.
        flux_w_m2: The heat flux (y, x) from the ground to the air, with the buffer of the grid.
        temperature_c: The temperature of the air.

    Returns:
        The flow in each column and the depth of its layer.
    """
    rise = horn(grid.elevation_m, grid.cell_m).astype(np.float64)
    slope = np.hypot(*rise)
    heated = flux_w_m2 > 0.0
    length, height = np.empty_like(slope), np.empty_like(slope)
    slope_lengths(grid.elevation_m, rise, ~heated, grid.cell_m, length, height)
    buoyancy = np.abs(flux_w_m2) * GRAVITY_M_S2 / (AIR_J_M3_K * (temperature_c + FREEZING_K))
    up = np.cbrt(buoyancy * height / UPSLOPE_FRICTION)
    depth = LAYER_DEPTH * height
    some = height > 0.0
    sine = np.minimum(height / np.where(some, length, 1.0), slope / np.hypot(1.0, slope))
    fetch = np.where(some, depth, 1.0) / DOWNSLOPE_FRICTION
    grown = np.cbrt(-np.expm1(-length / fetch))
    down = np.cbrt(buoyancy * length * sine / DOWNSLOPE_FRICTION) * grown
    speed = np.where(some, np.where(heated, up, -down), 0.0)
    flat = np.where(slope > 0.0, slope, 1.0)
    return SlopeFlow(speed * rise[0] / flat, speed * rise[1] / flat, depth)


def slope_wind(
    terrain: TerrainWind, flow: SlopeFlow, above_vegetation_m: float
) -> NDArray[np.float32]:
    """Return the wind of a slope flow for each cell of the landscape.

    The flow is made divergence-free like the wind over terrain. The two winds may be added, because
    the equations are linear.

    Args:
        terrain: The solutions for the landscape.
        flow: The flow on its grid.
        above_vegetation_m: The height of the wind above the vegetation.

    Returns:
        The wind (2, y, x) towards grid north and east in m/s.
    """
    grid, inner = terrain.grid, terrain.grid.inner
    bounds = grid.volume_bounds[:, None, None] * grid.depth_m
    displaced = np.pad(terrain.surface.displacement_m, grid.margins, mode="edge")
    within = np.clip(displaced + flow.depth_m - bounds[:-1], 0.0, np.diff(bounds, axis=0))
    shares = within / np.diff(bounds, axis=0)
    initial = _narrow(shares * flow.east_m_s), _narrow(shares * -flow.north_m_s)
    found = solve_potential(grid, initial, terrain.alpha_ratio, MAX_DIVERGENCE / grid.cell_m)
    above = terrain.surface.height_m + above_vegetation_m
    east, south = terrain.corrections(found.phi, above)
    inside = above - terrain.surface.displacement_m < flow.depth_m[inner]
    north = np.where(inside, flow.north_m_s[inner], 0.0) - south
    return terrain.refined(np.stack([north, np.where(inside, flow.east_m_s[inner], 0.0) + east]))


def _narrow(values: Floats) -> Stack:
    return values.astype(np.float32)
