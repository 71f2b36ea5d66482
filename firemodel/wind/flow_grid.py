"""Build the terrain-following grid on which the wind is solved.

The levels are at the heights ``z = h + (top - h) s_k`` above a ground of elevation h, with s from 0
(the ground) to 1 (a flat top). The layer thickness grows upwards by a constant factor. The
landscape is surrounded by a buffer with the elevations of the landscape's edge.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from firemodel.arrays import Floats
from firemodel.errors import FireModelError

LAYERS = 20
MIN_BUFFER_CELLS = 8
BUFFER_MULTIPLE = 16  # divides the numbers of columns and rows, so that grids can be halved often
MIN_DEPTH_M = 1000.0
MIN_DEPTH_IN_RELIEFS = 2.0  # the flow above the highest ground is at least this deep
FIRST_LAYER_M = 2.0
MAX_ELEVATION_M = 9000.0


@dataclass(frozen=True, eq=False)
class FlowGrid:
    """Columns of square cells, and levels that follow the terrain.

    ``elevation_m`` (y, x) includes the buffer; ``buffer`` contains the numbers of rows and of
    columns before the landscape; ``shape`` is that of the landscape without the buffer. ``levels``
    (n + 1) are the shares s_k of the depth of the flow; ``depth_m`` (y, x) is the depth itself.
    """

    elevation_m: Floats
    cell_m: float
    levels: Floats
    top_m: float
    buffer: tuple[int, int]
    shape: tuple[int, int]

    @property
    def depth_m(self) -> Floats:
        """The depth (y, x) of the flow above the ground."""
        return self.top_m - self.elevation_m

    @property
    def centres(self) -> Floats:
        """The centres (n) of the volumes around the levels 0 to n - 1, as shares of the depth."""
        bounds = self.volume_bounds
        return 0.5 * (bounds[1:] + bounds[:-1])

    @property
    def volume_bounds(self) -> Floats:
        """The bounds (n + 1) of the volumes around the levels, as shares of the depth."""
        middles = 0.5 * (self.levels[1:] + self.levels[:-1])
        return np.concatenate([[0.0], middles])

    @property
    def margins(self) -> list[tuple[int, int]]:
        """The buffer cells before and after the landscape, for rows and columns."""
        wholes = self.elevation_m.shape
        return [
            (before, whole - before - size)
            for before, whole, size in zip(self.buffer, wholes, self.shape, strict=True)
        ]

    @property
    def inner(self) -> tuple[slice, slice]:
        """The window of the landscape in arrays with the buffer."""
        (row, col), (rows, cols) = self.buffer, self.shape
        return slice(row, row + rows), slice(col, col + cols)


def flow_grid(elevation_m: NDArray[np.floating], cell_m: float, layers: int = LAYERS) -> FlowGrid:
    """Return the grid for a landscape.

    Args:
        elevation_m: (y, x), row 0 in the north.
        cell_m: The size of the square cells in metres.
        layers: The number of layers of the flow.

    Raises:
        FireModelError: An elevation is missing or impossible, or the cell size is not positive.
    """
    if elevation_m.ndim != 2 or elevation_m.size == 0:
        raise FireModelError(
            f"wind over terrain: the elevation has the shape {elevation_m.shape}; it must be "
            "(rows, columns)"
        )
    if not (np.isfinite(cell_m) and cell_m > 0.0):
        raise FireModelError(f"wind over terrain: cell size {cell_m} m must be greater than 0")
    valid = np.abs(elevation_m) <= MAX_ELEVATION_M  # False for NaN
    if not valid.all():
        row, col = divmod(int(np.argmin(valid)), elevation_m.shape[1])
        raise FireModelError(
            f"wind over terrain: the elevation is {elevation_m[row, col]} at row {row}, column "
            f"{col}; fill missing elevations first"
        )
    sides = [_buffer(size) for size in elevation_m.shape]
    ground = np.pad(elevation_m.astype(np.float64), sides, mode="edge")
    lowest, highest = float(ground.min()), float(ground.max())
    above = max(MIN_DEPTH_M, MIN_DEPTH_IN_RELIEFS * (highest - lowest))
    deepest = highest - lowest + above
    return FlowGrid(
        ground,
        cell_m,
        growing_levels(layers, min(FIRST_LAYER_M, deepest / layers) / deepest),
        highest + above,
        (sides[0][0], sides[1][0]),
        (elevation_m.shape[0], elevation_m.shape[1]),
    )


def block_means(values: NDArray[np.floating], factor: int) -> Floats:
    """Return the means (y, x) of blocks of cells; the last rows and columns are repeated."""
    if factor == 1:
        return np.asarray(values, dtype=np.float64)
    pads = [(0, -size % factor) for size in values.shape]
    padded = np.pad(values.astype(np.float64), pads, mode="edge")
    rows, cols = (size // factor for size in padded.shape)
    means: Floats = padded.reshape(rows, factor, cols, factor).mean(axis=(1, 3))
    return means


def _buffer(cells: int) -> tuple[int, int]:
    """Return the number of buffer cells before and after a row or column of ``cells`` cells."""
    total = -(-(cells + 2 * MIN_BUFFER_CELLS) // BUFFER_MULTIPLE) * BUFFER_MULTIPLE
    before = (total - cells) // 2
    return before, total - cells - before


def growing_levels(layers: int, first: float) -> Floats:
    """Return levels (layers + 1) from 0 to 1; the spacing grows geometrically from ``first``."""
    if first * layers >= 1.0:
        return np.linspace(0.0, 1.0, layers + 1)

    def excess(growth: float) -> float:
        return first * float((growth ** np.arange(layers)).sum()) - 1.0

    growth = brentq(excess, 1.0, 10.0)
    levels: Floats = np.concatenate([[0.0], np.cumsum(first * growth ** np.arange(layers))])
    levels /= levels[-1]
    return levels
