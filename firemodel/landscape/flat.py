"""Build a landscape without map data: level ground with one fuel around a position."""

import numpy as np

from firemodel.landscape.landscape import Landscape, transformers

UTM_NORTH, UTM_SOUTH = 32600, 32700  # EPSG codes of the UTM zones, without the zone number


def flat_landscape(
    rows: int,
    cols: int,
    cell_size_m: float,
    lat_deg: float,
    lon_deg: float,
    elevation_m: float = 0.0,
    fuel_model: int = 1,
) -> Landscape:
    """Return level ground with one fuel around a position, on the grid of the position's UTM zone.

    Args:
        rows: Number of cells from north to south.
        cols: Number of cells from west to east.
        cell_size_m: Side of a cell in metres.
        lat_deg: Latitude of the centre in WGS84 degrees.
        lon_deg: Longitude of the centre in WGS84 degrees.
        elevation_m: Height of the ground above sea level in metres.
        fuel_model: Fuel code, a key of ``FUEL_MODELS``.

    Returns:
        The landscape, with arrays (rows, cols).

    Raises:
        FireModelError: The fuel code is unknown.
    """
    zone = min(int((lon_deg + 180.0) // 6.0), 59) + 1
    crs = f"EPSG:{(UTM_NORTH if lat_deg >= 0.0 else UTM_SOUTH) + zone}"
    x_m, y_m = transformers(crs)[1].transform(lon_deg, lat_deg)
    return Landscape(
        crs,
        float(x_m) - cols * cell_size_m / 2.0,
        float(y_m) + rows * cell_size_m / 2.0,
        cell_size_m,
        np.full((rows, cols), fuel_model, dtype=np.int16),
        np.full((rows, cols), elevation_m, dtype=np.float32),
    )
