"""Converts between Web Mercator (EPSG:3857), which browser maps use, and a landscape's grid."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape

RADIUS_M = 6378137.0  # radius of the sphere of EPSG:3857
WORLD_M = 2.0 * math.pi * RADIUS_M
# Number of points along each side at which the projections are computed. Between these points the
# projections are interpolated linearly. Over 100 km the error is 2 m, less than a thousandth of a
# tile.
NODES = 33

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]  # west, south, east, north


def mercator_of(lon_deg: Any, lat_deg: Any) -> tuple[Any, Any]:
    """Return the position x, y in Web Mercator metres."""
    y_m = RADIUS_M * np.arctanh(np.sin(np.deg2rad(lat_deg)))
    return RADIUS_M * np.deg2rad(lon_deg), y_m


def lon_lat_of(x_m: Any, y_m: Any) -> tuple[Any, Any]:
    """Return the longitude and latitude in degrees of a position in Web Mercator."""
    lat_deg = np.rad2deg(np.arcsin(np.tanh(np.asarray(y_m) / RADIUS_M)))
    return np.rad2deg(np.asarray(x_m) / RADIUS_M), lat_deg


def outline_of(landscape: Landscape) -> Floats:
    """Return (n, 2) longitudes and latitudes along a landscape's edge, clockwise from the NW.

    Across the antimeridian, the longitudes continue beyond -180 or 180 degrees.
    """
    rows, cols = landscape.shape
    along = np.linspace(0.0, 1.0, NODES)[:-1]
    row = np.concatenate([along * 0, along, along * 0 + 1, 1 - along]) * rows - 0.5
    col = np.concatenate([along, along * 0 + 1, 1 - along, along * 0]) * cols - 0.5
    lat, lon = landscape.lat_lon_of(*landscape.xy_of(row, col))
    return np.stack([landscape.unwrapped_deg(lon), lat], axis=1)


def mercator_box(landscape: Landscape) -> Box:
    """Return the extent of the landscape in Web Mercator metres."""
    x_m, y_m = mercator_of(*outline_of(landscape).T)
    return float(x_m.min()), float(y_m.min()), float(x_m.max()), float(y_m.max())


def bounds_deg(box: Box) -> list[float]:
    """Return a box in Web Mercator metres as west, south, east, north in degrees."""
    lon, lat = lon_lat_of(box[0::2], box[1::2])
    return [float(lon[0]), float(lat[0]), float(lon[1]), float(lat[1])]


def cell_mercator_m(landscape: Landscape) -> float:
    """Return a cell's side length in Web Mercator metres at the centre of the landscape."""
    rows, cols = landscape.shape
    lat, _ = landscape.lat_lon_of(*landscape.xy_of(rows / 2, cols / 2))
    return landscape.cell_size_m / math.cos(math.radians(lat))


def grid_positions(
    landscape: Landscape, box: Box, width: int, height: int
) -> tuple[Floats, Floats]:
    """Return the positions of pixels in a landscape's grid: float rows, columns (height, width).

    The positions are the centres of the pixels of ``box``; the first row is the northernmost.
    """
    west, south, east, north = box
    x_m = np.linspace(west, east, NODES)
    y_m = np.linspace(north, south, NODES)
    lon, lat = lon_lat_of(*np.meshgrid(x_m, y_m))
    row, col = landscape.row_col_of(*landscape.xy_of_lat_lon(lat, lon))
    found = [_between(_between(values, height).T, width).T for values in (row, col)]
    return np.ascontiguousarray(found[0]), np.ascontiguousarray(found[1])


def _between(values: Floats, pixels: int) -> Floats:
    """Interpolate values at NODES along the first axis to the centres of ``pixels`` pixels."""
    at = (np.arange(pixels) + 0.5) / pixels * (NODES - 1)
    low = np.minimum(at.astype(np.int64), NODES - 2)
    share = (at - low)[:, None]
    found: Floats = values[low] * (1.0 - share) + values[low + 1] * share
    return found
