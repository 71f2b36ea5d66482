"""Compute the wind profile above vegetation: roughness, displacement, and the initial wind.

The wind grows with the logarithm of the height above a displaced ground. The displacement is 0.64
times and the roughness length 0.13 times the height of the vegetation, as in the wind adjustment
factor (Albini & Baughman 1979, INT-221; Andrews 2012, RMRS-GTR-266).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape
from firemodel.physics.rothermel import M_PER_FT
from firemodel.wind.flow_grid import FlowGrid

REFERENCE_M = 20.0 * M_PER_FT  # the height above the vegetation of the wind in weather entries
DISPLACED, ROUGH = 0.64, 0.13  # fractions of the height of the vegetation
MIN_COVER = 0.05  # with less canopy cover the height is that of the fuel bed, as in WindNinja
BLENDING_M = 60.0  # above it the profile is that of the mean roughness (Wieringa 1986)
BOUNDARY_LAYER_M = 1000.0  # above it the initial wind is constant
# Heights in metres of ground without fuel. The values are WindNinja's, adjusted to give the same
# roughness length with the fraction above.
OTHER_HEIGHT_M = {91: 3.8, 92: 6e-4, 93: 0.77, 98: 1.2e-3, 99: 1.8e-3}
MIN_HEIGHT_M = 6e-4


class Surface(NamedTuple):
    """Vegetation height, roughness length and displacement in metres; numbers or arrays (y, x)."""

    height_m: Floats
    roughness_m: Floats
    displacement_m: Floats


def surface_of_height(height_m: NDArray[np.floating]) -> Surface:
    """Return the surface of vegetation with a given height.

    Args:
        height_m: Heights in metres, of any shape; less than 0.6 mm counts as 0.6 mm.

    Returns:
        Height, roughness length and displacement, of the same shape.
    """
    height = np.maximum(np.asarray(height_m, dtype=np.float64), MIN_HEIGHT_M)
    return Surface(height, ROUGH * height, DISPLACED * height)


def surface_of(landscape: Landscape) -> Surface:
    """Return the surface of each cell.

    The height is that of the canopy where trees cover at least 5 %, else the depth of the fuel bed.

    Args:
        landscape: The landscape; canopy cover and height are optional.

    Returns:
        Height, roughness length and displacement (y, x) in metres.
    """
    heights = {code: fuel.depth_ft * M_PER_FT for code, fuel in landscape.fuels.items()}
    known = {**OTHER_HEIGHT_M, **heights}
    codes, places = np.unique(landscape.fuel_model, return_inverse=True)
    table = np.array([known.get(code, OTHER_HEIGHT_M[99]) for code in codes.tolist()])
    height = table[places].reshape(landscape.shape)
    if landscape.canopy_height_m is not None and landscape.canopy_cover is not None:
        trees = landscape.canopy_cover >= MIN_COVER
        height = np.where(trees, np.maximum(height, landscape.canopy_height_m), height)
    return surface_of_height(height)


def profile_at(
    above_m: Floats, surface: Surface, mean_roughness_m: float, reference_m: float
) -> Floats:
    """Return the initial speed at heights above the ground, relative to the reference wind.

    The reference wind is at ``reference_m`` above the vegetation, the same everywhere. Up to this
    height the profile is that of the cell, above 60 m that of the mean roughness, and in between a
    mixture.
    """
    lifted = np.minimum(above_m - surface.displacement_m, BOUNDARY_LAYER_M)
    base = reference_m + surface.height_m - surface.displacement_m
    own = _log(lifted, surface.roughness_m) / np.log(base / surface.roughness_m)
    common = _log(lifted, mean_roughness_m) / np.log(base / mean_roughness_m)
    return own + _share_of_common(lifted, base) * (common - own)


def profile_means(
    grid: FlowGrid, surface: Surface, reference_m: float = REFERENCE_M
) -> NDArray[np.float32]:
    """Return the mean initial speed (n, y, x) in the volumes around the levels of a grid.

    The surface is that of the grid, with its buffer. The speed is relative to the reference wind.
    """
    depth, bounds = grid.depth_m, grid.volume_bounds
    base = reference_m + surface.height_m - surface.displacement_m
    rough = mean_roughness_m(surface)
    own_scale = 1.0 / np.log(base / surface.roughness_m)
    common_scale = 1.0 / np.log(base / rough)
    means = np.empty((len(bounds) - 1, *depth.shape), dtype=np.float32)
    lower = bounds[0] * depth - surface.displacement_m
    for k, bound in enumerate(bounds[1:]):
        upper = bound * depth - surface.displacement_m
        own = own_scale * _log_mean(lower, upper, surface.roughness_m)
        common = common_scale * _log_mean(lower, upper, rough)
        share = _share_of_common(0.5 * (lower + upper), base)
        means[k] = own + share * (common - own)
        lower = upper
    return means


def mean_roughness_m(surface: Surface) -> float:
    """Return the geometric mean of the roughness lengths."""
    return float(np.exp(np.log(surface.roughness_m).mean()))


def _share_of_common(lifted_m: Floats, base_m: Floats) -> Floats:
    top = np.maximum(BLENDING_M, 2.0 * base_m)
    inner = np.log(np.maximum(lifted_m, base_m) / base_m)
    share: Floats = np.minimum(inner / np.log(top / base_m), 1.0)
    return share


def _log(lifted_m: Floats, roughness_m: Floats | float) -> Floats:
    found: Floats = np.log(np.maximum(lifted_m / roughness_m, 1.0))
    return found


def _log_mean(lower_m: Floats, upper_m: Floats, roughness_m: Floats | float) -> Floats:
    """Return the mean of the logarithmic profile between two heights above the displacement."""
    whole: Floats = _log_integral(upper_m, roughness_m) - _log_integral(lower_m, roughness_m)
    return whole / (upper_m - lower_m)


def _log_integral(lifted_m: Floats, roughness_m: Floats | float) -> Floats:
    within = np.clip(lifted_m, roughness_m, BOUNDARY_LAYER_M)
    beyond = np.maximum(lifted_m - BOUNDARY_LAYER_M, 0.0)
    found: Floats = within * (np.log(within / roughness_m) - 1.0) + roughness_m
    found += beyond * np.log(BOUNDARY_LAYER_M / roughness_m)
    return found
