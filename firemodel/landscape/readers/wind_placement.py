"""Read the two bands of a wind and resample them to a landscape's grid."""

from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from firemodel.arrays import Floats, Mask
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape, bilinear, crs_label, same_crs
from firemodel.landscape.readers.bands import MAX_CELLS, cells_with, opened
from firemodel.landscape.readers.wind_layers import WindLayer
from firemodel.physics.rothermel import M_S_PER_MPH
from firemodel.physics.weather import wind_20ft_from_10m

M_S_PER_UNIT = {"m_s": 1.0, "mph": M_S_PER_MPH, "kmh": 1.0 / 3.6, "kts": 1852.0 / 3600.0}
MAX_SPEED_M_S = 100.0
BEYOND_CELLS = 1.0  # a grid may end this many of its cells short of the landscape's edge
MIN_WEIGHT = 0.5  # smallest total weight of cells with a value in an interpolation
CONTROL_POINTS = 17  # per side of the landscape, at which the grid's north is computed
TRUE_CRS = "EPSG:4326"


class WindGrid(NamedTuple):
    """The grid of a wind's bands."""

    crs: str
    transform: Any  # affine.Affine from (column, row) of cell corners to x, y
    shape: tuple[int, int]
    true_north: bool  # True if directions are relative to true north


class Placement(NamedTuple):
    """The positions (y, x) of a landscape's cells in a grid, and the grid's north."""

    rows: Floats
    cols: Floats
    north: NDArray[np.complex128] | complex  # cosine + i sine, clockwise from the landscape's north


def grid_of_wind(layer: WindLayer, crs: str | None, north: str | None) -> WindGrid:
    """Return a band's grid.

    Args:
        layer: The band.
        crs: The CRS, if the file contains none.
        north: "grid" or "true", or None for the north that the file states, by default the grid's.

    Raises:
        FireModelError: The CRS is missing or contradicts the file, or the grid is not north-up.
    """
    true_north = layer.true_north if north is None else north == "true"
    return WindGrid(_crs_of(layer, crs), layer.transform, layer.shape, true_north)


def placement_of(landscape: Landscape, grid: WindGrid, path: Path) -> Placement:
    """Return the placement of a landscape in a grid.

    Raises FireModelError if the grid does not cover the landscape; the message names the file
    ``path``.
    """
    positions = _positions(landscape, grid, path)
    if not grid.true_north and same_crs(grid.crs, landscape.crs):
        return Placement(*positions, 1.0 + 0.0j)
    return Placement(*positions, _north_of(landscape, TRUE_CRS if grid.true_north else grid.crs))


def vectors_at(
    place: Placement, one: WindLayer, other: WindLayer, scale: tuple[str, str]
) -> NDArray[np.complex128]:
    """Return the wind (y, x) in m/s at 20 ft: toward the landscape's north + i toward its east.

    Args:
        place: The placement of the landscape in the bands' grid.
        one: The band of the speed, or of u (toward east).
        other: The band of the direction from which the wind blows, or of v (toward north).
        scale: The unit and the height.

    Raises:
        FireModelError: The bands cannot be used; the message names band, cell and value.
    """
    if (one.shape, one.transform, one.crs) != (other.shape, other.transform, other.crs):
        raise FireModelError(
            f"{other.label}: differs from {one.label} in shape, position or CRS; resample both to "
            "one grid"
        )
    wind = _components(one, other, scale)
    known = np.isfinite(wind)
    if known.all():
        return np.asarray(bilinear(wind, place.rows, place.cols) * place.north)
    weight = bilinear(known.astype(np.float64), place.rows, place.cols)
    missing: Mask = weight < MIN_WEIGHT
    if missing.any():
        row, col = divmod(int(np.argmax(missing)), missing.shape[1])
        raise FireModelError(
            f"{one.label}: no wind at row {row}, column {col} of the landscape "
            f"({np.count_nonzero(missing)} such cells); fill the cells without data"
        )
    found = bilinear(np.where(known, wind, 0.0), place.rows, place.cols) / weight
    return np.asarray(found * place.north)


def _crs_of(layer: WindLayer, given: str | None) -> str:
    """Return a band's CRS; the band must be north-up."""
    for text in (layer.crs, given):
        try:
            CRS.from_user_input(text) if text else None
        except CRSError:
            raise FireModelError(
                f"{layer.path}: CRS {str(text)[:60]!r} is unknown; specify it as in EPSG:32611"
            ) from None
    if layer.crs is None and given is None:
        raise FireModelError(
            f"{layer.path}: has no CRS; add it to the file (an .asc grid has it in a .prj file of "
            "the same name), or specify it as `crs`"
        )
    if layer.crs is not None and given is not None and not same_crs(layer.crs, given):
        raise FireModelError(
            f"{layer.path}: CRS {crs_label(layer.crs)} differs from {crs_label(given)}, specified "
            "as `crs`; omit `crs`, or correct the CRS in the file"
        )
    if layer.transform.b or layer.transform.d or layer.transform.is_identity:
        raise FireModelError(
            f"{layer.path}: is not a georeferenced north-up grid; warp it to an unrotated grid"
        )
    return str(layer.crs or given)


def _values(layer: WindLayer) -> Floats:
    """Return a band's values (y, x), with NaN in cells without a value."""
    rows, cols = layer.shape
    if rows * cols > MAX_CELLS:
        raise FireModelError(f"{layer.path}: has {rows * cols:,} cells, more than {MAX_CELLS:,}")
    with opened(layer.path, layer.driver, layer.dataset) as file:
        read = file.read(layer.number, masked=True)
        scale, offset = file.scales[layer.number - 1], file.offsets[layer.number - 1]
    values: Floats = read.astype(np.float64).filled(np.nan)
    return np.asarray(values * scale + offset)


def _components(one: WindLayer, other: WindLayer, scale: tuple[str, str]) -> NDArray[np.complex128]:
    """Return the wind (y, x) of two bands in m/s at 20 ft: toward their north + i toward east."""
    unit, height = scale
    m_s = M_S_PER_UNIT[unit] if height == "20ft" else float(wind_20ft_from_10m(M_S_PER_UNIT[unit]))
    first, second = _values(one), _values(other)
    if one.kind == "u":
        _check(one, first, -MAX_SPEED_M_S / m_s, MAX_SPEED_M_S / m_s, unit)
        _check(other, second, -MAX_SPEED_M_S / m_s, MAX_SPEED_M_S / m_s, unit)
        return np.asarray(m_s * (second + 1j * first))
    _check(one, first, 0.0, MAX_SPEED_M_S / m_s, unit)
    _check(other, second, 0.0, 360.0, "degrees")
    from_rad = np.deg2rad(np.where(first == 0.0, 0.0, second))  # calm air needs no direction
    return np.asarray(-m_s * first * np.exp(1j * from_rad))


def _check(layer: WindLayer, values: Floats, low: float, high: float, unit: str) -> None:
    bad = (values < low) | (values > high)  # False for NaN
    if bad.any():
        raise FireModelError(
            f"{layer.label}: value {cells_with(bad, values)} must be from {low:.4g} to {high:.4g} "
            f"{unit}; check the unit, or declare the value as nodata"
        )


def _positions(landscape: Landscape, grid: WindGrid, path: Path) -> tuple[Floats, Floats]:
    """Return the positions (y, x) of a landscape's cells in a grid, as float rows and columns."""
    row, col = np.indices(landscape.shape)
    x, y = landscape.xy_of(row, col)
    if not same_crs(grid.crs, landscape.crs):
        x, y = _to(landscape.crs, grid.crs).transform(x, y)
    (rows, cols), transform = grid.shape, grid.transform
    if CRS.from_user_input(grid.crs).is_geographic:  # longitudes may be from 0 to 360
        middle = transform.c + 0.5 * cols * transform.a
        x = x + 360.0 * np.round((middle - x) / 360.0)
    found_col = (x - transform.c) / transform.a - 0.5
    found_row = (y - transform.f) / transform.e - 0.5
    low = -0.5 - BEYOND_CELLS
    inside = (found_row >= low) & (found_row <= rows - 1 - low)
    inside &= (found_col >= low) & (found_col <= cols - 1 - low)
    if not inside.all():
        raise FireModelError(
            f"{path}: covers {np.count_nonzero(inside):,} of {inside.size:,} cells of the "
            "landscape; use grids that cover the landscape, or correct the CRS"
        )
    return found_row, found_col


def _north_of(landscape: Landscape, crs: str) -> NDArray[np.complex128]:
    """Return the north (y, x) of a CRS: cosine + i sine, clockwise from the landscape's north."""
    rows, cols = landscape.shape
    row, col = np.meshgrid(
        *(np.linspace(0.0, count - 1, CONTROL_POINTS) for count in (rows, cols)), indexing="ij"
    )
    x_m, y_m = landscape.xy_of(row, col)
    x, y = _to(landscape.crs, crs).transform(x_m, y_m)
    step = 1e-4 if CRS.from_user_input(crs).is_geographic else 10.0
    north_x_m, north_y_m = _to(crs, landscape.crs).transform(x, y + step)
    vector = (north_y_m - y_m) + 1j * (north_x_m - x_m)
    vector /= np.abs(vector)
    last = CONTROL_POINTS - 1
    at = np.meshgrid(
        *(np.arange(count) * (last / max(count - 1, 1)) for count in (rows, cols)), indexing="ij"
    )
    found = bilinear(vector, *at)
    return np.asarray(found / np.abs(found))


@lru_cache(maxsize=8)
def _to(crs: str, other: str) -> Transformer:
    return Transformer.from_crs(crs, other, always_xy=True)
