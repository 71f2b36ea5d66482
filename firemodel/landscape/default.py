"""Build the default landscape: real terrain from matplotlib, and fuel derived from the terrain."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape, bilinear, transformers

CRS = "EPSG:32616"  # UTM 16 north
CENTRE_LAT_DEG, CENTRE_LON_DEG = 36.35, -84.16
GRASS, BRUSH, HARDWOOD_LITTER = 2, 5, 9  # Anderson's fuel models
STEEP = 0.10  # rise over run


def jacksboro(rows: int = 200, cols: int = 200, cell_size_m: float = 30.0) -> Landscape:
    """Return terrain along the Jacksboro fault, Tennessee, on a UTM grid around 36.35 N, 84.16 W.

    The elevation (3 arc seconds) is resampled bilinearly and rounded to 0.1 m. The fuel is derived
    from the terrain. Ground with a slope under 10 % is timber grass (FM 2). On the dry side, where
    the aspect is 135 to 315 degrees (from south-east through south-west to north-west), steeper
    slopes are brush (FM 5). All other slopes are hardwood litter (FM 9).

    Args:
        rows: Number of cells from north to south.
        cols: Number of cells from west to east.
        cell_size_m: Side of a cell in metres.

    Returns:
        The landscape in UTM zone 16 north (EPSG:32616), with arrays (rows, cols).

    Raises:
        FireModelError: The grid reaches beyond the terrain, which ends 7 km from the centre.
    """
    west_m, north_m = _corner(rows, cols, cell_size_m)
    flat = Landscape(
        CRS,
        west_m,
        north_m,
        cell_size_m,
        np.ones((rows, cols), dtype=np.int16),
        _elevation(rows, cols, cell_size_m, west_m, north_m),
    )
    return replace(flat, fuel_model=_fuel(flat))


def _corner(rows: int, cols: int, cell_size_m: float) -> tuple[float, float]:
    """Return the north-west corner x, y in metres of a grid around the centre.

    x and y are multiples of the cell size.
    """
    x_m, y_m = transformers(CRS)[1].transform(CENTRE_LON_DEG, CENTRE_LAT_DEG)
    west = round(x_m / cell_size_m - cols / 2) * cell_size_m
    north = round(y_m / cell_size_m + rows / 2) * cell_size_m
    return float(west), float(north)


def _sample() -> Path:
    """Return the path of matplotlib's elevation file.

    The function does not import matplotlib, because the import is slow.
    """
    found = find_spec("matplotlib")
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).parent / "mpl-data" / "sample_data" / "jacksboro_fault_dem.npz"


def _elevation(
    rows: int, cols: int, cell_size_m: float, west_m: float, north_m: float
) -> NDArray[np.float32]:
    with np.load(_sample()) as grid:
        terrain = grid["elevation"].astype(np.float64)
        # Row 0 is the northernmost and lies at the file's ymax. The file's ymin is wrong, because
        # ymin was counted from ymax upwards instead of downwards. With this georeference the
        # highest cell (1076 m) is the top of Cross Mountain, 36.1983 N 84.2306 W.
        north_deg, west_deg, degrees = (float(grid[key]) for key in ("ymax", "xmin", "dx"))
    x_m, y_m = np.meshgrid(
        west_m + (np.arange(cols) + 0.5) * cell_size_m,
        north_m - (np.arange(rows) + 0.5) * cell_size_m,
    )
    lon, lat = transformers(CRS)[0].transform(x_m, y_m)
    places = np.stack([(north_deg - lat) / degrees - 0.5, (lon - west_deg) / degrees - 0.5])
    last = np.reshape(terrain.shape, (2, 1, 1)) - 0.5
    if ((places < -0.5) | (places > last)).any():
        raise FireModelError(
            f"jacksboro: {rows} x {cols} cells of {cell_size_m} m reach beyond the terrain that "
            "ships with matplotlib; use fewer or smaller cells (7 km from the centre at most)"
        )
    return np.asarray(np.round(bilinear(terrain, *places), 1), dtype=np.float32)


def _fuel(flat: Landscape) -> NDArray[np.int16]:
    """Return the fuel (rows, cols) as described in ``jacksboro``, from the terrain of ``flat``."""
    sunny = (flat.aspect_deg >= 135.0) & (flat.aspect_deg <= 315.0)
    on_slopes = np.where(sunny, BRUSH, HARDWOOD_LITTER)
    return np.where(flat.slope_tan >= STEEP, on_slopes, GRASS).astype(np.int16)
