"""Place the cells of a reported raster on the landscape's grid. Pure."""

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.assimilation.observation import UNSEEN, Observation, despeckled
from firemodel.landscape.landscape import Landscape
from mission_service.events import RasterObserved
from mission_service.fire.observed_window import states_in

# Spacing, in cells, of the positions that are projected exactly. Between these positions, latitude
# and longitude are interpolated. With 30 m cells, the error is less than 1 cm, and the computation
# takes a hundredth of the time.
EXACT_EVERY = 16
EDGE_POINTS = 9  # per edge of a raster, because its edges are curved on the grid


def raster_cells(event: RasterObserved, landscape: Landscape) -> tuple[int, int, NDArray[np.uint8]]:
    """Return the first row and column of a window, and the states (y, x) of its cells.

    Each grid cell has the state of the raster cell at its centre. A majority filter is applied to
    the raster if its sensor makes detection errors. The window is empty if the raster contains no
    grid cell's centre.
    """
    states = despeckled(
        Observation(
            *(0.0, 0, 0, states_in(event.rows)),
            missed=event.missed,
            false_alarms=event.false_alarms,
        )
    )
    top, below, left, right = _window(event, landscape)
    if top >= below or left >= right:
        return 0, 0, np.empty((0, 0), dtype=np.uint8)
    lat_deg, lon_deg = _places(landscape, np.arange(top, below), np.arange(left, right))
    rows, cols = states.shape
    row = np.floor((event.north_deg - lat_deg) / (event.north_deg - event.south_deg) * rows)
    from_west_deg = (lon_deg - event.west_deg) % 360.0
    col = np.floor(from_west_deg / (event.east_deg - event.west_deg) * cols)
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    found = np.full(inside.shape, UNSEEN, dtype=np.uint8)
    found[inside] = states[row[inside].astype(np.int64), col[inside].astype(np.int64)]
    return top, left, found


def _window(event: RasterObserved, landscape: Landscape) -> tuple[int, int, int, int]:
    """Return the grid rows and columns (first, end) that may lie in a raster."""
    share = np.linspace(0.0, 1.0, EDGE_POINTS)
    lat_deg = event.south_deg + share * (event.north_deg - event.south_deg)
    lon_deg = event.west_deg + share * (event.east_deg - event.west_deg)
    lat, lon = (each.ravel() for each in np.meshgrid(lat_deg, lon_deg))
    row, col = landscape.row_col_of(*landscape.xy_of_lat_lon(lat, lon))
    finite = np.isfinite(row) & np.isfinite(col)  # points far away cannot be projected
    if not finite.any():
        return 0, 0, 0, 0
    ends = []
    for each, count in zip((row[finite], col[finite]), landscape.shape, strict=True):
        ends += [
            int(np.clip(np.floor(each.min()) - 1, 0, count)),
            int(np.clip(np.ceil(each.max()) + 2, 0, count)),
        ]
    return ends[0], ends[1], ends[2], ends[3]


def _places(
    landscape: Landscape, rows: NDArray[np.int64], cols: NDArray[np.int64]
) -> tuple[Floats, Floats]:
    """Return the latitude and longitude in degrees (y, x) of a window's cell centres.

    Longitudes continue beyond 180 degrees across the antimeridian (``Landscape.unwrapped_deg``).
    """
    exact_rows, exact_cols = _exact(rows), _exact(cols)
    row, col = np.meshgrid(exact_rows, exact_cols, indexing="ij")
    lat, lon = landscape.lat_lon_of(*landscape.xy_of(row, col))
    down, across = _weights(rows, exact_rows), _weights(cols, exact_cols)
    return down @ lat @ across.T, down @ landscape.unwrapped_deg(lon) @ across.T


def _exact(indices: NDArray[np.int64]) -> Floats:
    """Return evenly spaced positions from the first to the last index."""
    count = 2 + len(indices) // EXACT_EVERY
    return np.linspace(float(indices[0]), float(indices[-1]) + 1.0, count)


def _weights(indices: NDArray[np.int64], exact: Floats) -> Floats:
    """Return the weights (indices, exact) for linear interpolation."""
    step = exact[1] - exact[0]
    return np.asarray(np.maximum(1.0 - np.abs(indices[:, None] - exact[None, :]) / step, 0.0))
