"""Read the two bands of a wind and resample them to the grid of a landscape."""

from functools import lru_cache

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from firemodel.arrays import Floats, Mask
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape, bilinear, crs_label, same_crs
from firemodel.landscape.readers.bands import MAX_CELLS, cells_with, opened
from firemodel.landscape.readers.wind_layers import WindLayer
from firemodel.physics.rothermel import M_S_PER_MPH
from firemodel.physics.weather import wind_20ft_from_10m

M_S = {"m_s": 1.0, "mph": M_S_PER_MPH, "kmh": 1.0 / 3.6, "kts": 1852.0 / 3600.0}
MAX_SPEED_M_S = 100.0
BEYOND_CELLS = 1.0  # a grid may end this many of its cells before the edge of the landscape
MIN_KNOWN = 0.5  # smallest weight of cells with a value in an interpolated value
CONTROL_POINTS = 17  # along each side of the landscape, at which the grid's north is computed
TRUE_CRS = "EPSG:4326"


def vectors_on(
    landscape: Landscape,
    one: WindLayer,
    other: WindLayer,
    scale: tuple[str, str],
    crs: str | None,
    north: str | None,
) -> Floats:
    """Return the wind on a landscape (2, y, x) in m/s at 20 ft, toward grid north and grid east.

    Args:
        landscape: The landscape.
        one: The band of the speed, or of u (toward east).
        other: The band of the direction from which the wind blows, or of v (toward north).
        scale: The unit and the height.
        crs: The CRS, if the file contains none.
        north: "grid" or "true", or None for the north that the file states, by default the grid's.

    Raises:
        FireModelError: The bands cannot be used; the message names band, cell and value.
    """
    crs = _crs_of(one, crs)
    if (one.shape, one.transform, one.crs) != (other.shape, other.transform, other.crs):
        raise FireModelError(
            f"{other.label}: differs from {one.label} in shape, place or CRS; bring both onto one "
            "grid"
        )
    to_north, to_east = _components(one, other, scale)
    rows, cols = _positions(landscape, one, crs)
    known = np.isfinite(to_north) & np.isfinite(to_east)
    weight = bilinear(known.astype(np.float64), rows, cols)
    missing: Mask = weight < MIN_KNOWN
    if missing.any():
        row, col = divmod(int(np.argmax(missing)), missing.shape[1])
        raise FireModelError(
            f"{one.label}: no wind at row {row}, column {col} of the landscape "
            f"({np.count_nonzero(missing)} such cells); fill the cells without data"
        )
    to_north = bilinear(np.where(known, to_north, 0.0), rows, cols) / weight
    to_east = bilinear(np.where(known, to_east, 0.0), rows, cols) / weight
    true_north = one.true_north if north is None else north == "true"
    if not true_north and same_crs(crs, landscape.crs):
        return np.stack([to_north, to_east])
    cos, sin = _north_of(landscape, TRUE_CRS if true_north else crs)
    return np.stack([to_north * cos - to_east * sin, to_east * cos + to_north * sin])


def _crs_of(layer: WindLayer, given: str | None) -> str:
    """Return the CRS of a band, which must be north-up."""
    for text in (layer.crs, given):
        try:
            CRS.from_user_input(text) if text else None
        except CRSError:
            raise FireModelError(
                f"{layer.path}: CRS {str(text)[:60]!r} is unknown; give one as EPSG:32611"
            ) from None
    if layer.crs is None and given is None:
        raise FireModelError(
            f"{layer.path}: has no CRS; add it to the file (an .asc grid has it in a .prj file of "
            "the same name), or give the crs"
        )
    if layer.crs is not None and given is not None and not same_crs(layer.crs, given):
        raise FireModelError(
            f"{layer.path}: CRS {crs_label(layer.crs)} differs from {crs_label(given)}, given as "
            "crs; leave crs out, or correct the CRS in the file"
        )
    if layer.transform.b or layer.transform.d or layer.transform.is_identity:
        raise FireModelError(
            f"{layer.path}: is not a north-up grid with a position; warp it to an unrotated grid"
        )
    return str(layer.crs or given)


def _values(layer: WindLayer) -> Floats:
    """Return the values (y, x) of a band, with NaN in cells without a value."""
    rows, cols = layer.shape
    if rows * cols > MAX_CELLS:
        raise FireModelError(f"{layer.path}: has {rows * cols:,} cells, more than {MAX_CELLS:,}")
    with opened(layer.path, layer.driver, layer.dataset) as file:
        read = file.read(layer.number, masked=True)
        scale, offset = file.scales[layer.number - 1], file.offsets[layer.number - 1]
    values: Floats = read.astype(np.float64).filled(np.nan)
    return np.asarray(values * scale + offset)


def _components(one: WindLayer, other: WindLayer, scale: tuple[str, str]) -> tuple[Floats, Floats]:
    """Return the components (y, x) toward the north and the east of the bands, in m/s at 20 ft."""
    unit, height = scale
    m_s = M_S[unit] if height == "20ft" else float(wind_20ft_from_10m(M_S[unit]))
    first, second = _values(one), _values(other)
    if one.kind == "u":
        _check(one, first, -MAX_SPEED_M_S / m_s, MAX_SPEED_M_S / m_s, unit)
        _check(other, second, -MAX_SPEED_M_S / m_s, MAX_SPEED_M_S / m_s, unit)
        return second * m_s, first * m_s
    _check(one, first, 0.0, MAX_SPEED_M_S / m_s, unit)
    _check(other, second, 0.0, 360.0, "degrees")
    from_rad = np.deg2rad(np.where(first == 0.0, 0.0, second))  # calm air needs no direction
    return -first * m_s * np.cos(from_rad), -first * m_s * np.sin(from_rad)


def _check(layer: WindLayer, values: Floats, low: float, high: float, unit: str) -> None:
    bad = (values < low) | (values > high)  # False for NaN
    if bad.any():
        raise FireModelError(
            f"{layer.label}: value {cells_with(bad, values)} must be from {low:.4g} to {high:.4g} "
            f"{unit}; check the unit, or declare the value as nodata"
        )


def _positions(landscape: Landscape, layer: WindLayer, crs: str) -> tuple[Floats, Floats]:
    """Return the positions (y, x) of a landscape's cells in a band, as float rows and columns."""
    row, col = np.indices(landscape.shape)
    x, y = landscape.xy_of(row, col)
    if not same_crs(crs, landscape.crs):
        x, y = _to(landscape.crs, crs).transform(x, y)
    rows, cols = layer.shape
    if CRS.from_user_input(crs).is_geographic:  # longitudes may be from 0 to 360
        middle = layer.transform.c + 0.5 * cols * layer.transform.a
        x = x + 360.0 * np.round((middle - x) / 360.0)
    found_col = (x - layer.transform.c) / layer.transform.a - 0.5
    found_row = (y - layer.transform.f) / layer.transform.e - 0.5
    low = -0.5 - BEYOND_CELLS
    inside = (found_row >= low) & (found_row <= rows - 1 - low)
    inside &= (found_col >= low) & (found_col <= cols - 1 - low)
    if not inside.all():
        raise FireModelError(
            f"{layer.path}: covers {np.count_nonzero(inside):,} of {inside.size:,} cells of the "
            "landscape; give grids that cover the landscape, or correct the CRS"
        )
    return found_row, found_col


def _north_of(landscape: Landscape, crs: str) -> tuple[Floats, Floats]:
    """Return cosine and sine (y, x) of the north of a CRS, clockwise from grid north."""
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
    return found.real / np.abs(found), found.imag / np.abs(found)


@lru_cache(maxsize=8)
def _to(crs: str, other: str) -> Transformer:
    return Transformer.from_crs(crs, other, always_xy=True)
