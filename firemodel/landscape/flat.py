"""A landscape without a map: level ground and one fuel around a place."""

import numpy as np

from firemodel.landscape.landscape import Landscape, transformers

UTM_NORTH, UTM_SOUTH = 32600, 32700  # EPSG codes, without the zone


def flat(
    rows: int,
    cols: int,
    cell_size_m: float,
    lat_deg: float,
    lon_deg: float,
    elevation_m: float = 0.0,
    fuel_model: int = 1,
) -> Landscape:
    """Level ground of one fuel, its middle at a place, on the grid of the place's UTM zone.

    Raises FireModelError for a fuel that is not known.
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
