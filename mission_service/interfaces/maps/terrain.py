"""Encodes elevation as tiles for a map's hillshade (MapLibre's raster-dem, Terrarium format)."""

import io
import math
import zlib
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.interfaces.maps.mercator import (
    WORLD_M,
    Box,
    bounds_deg,
    cell_mercator_m,
    grid_positions,
    mercator_box,
)

TILE = 256  # side of a tile in pixels
MAX_BYTES = 24_000_000  # size of all cached tiles, each counted with its maximum size
LARGEST_TILE_BYTES = 3 * TILE * TILE + 4096
SMALLEST_SHARE = 1 / 4  # minimum fraction of a tile that the landscape fills, at the lowest zoom
HIGHEST_ZOOM = 22
SOON_CELLS = 1.0  # distance beyond the edge from which means of 2 x 2 cells are used, then of 4 x 4
TERRARIUM_ZERO_M = 32768

Heights = NDArray[np.float32]


class TerrainTiles:
    """The tiles of a landscape's elevation (``/terrain/z/x/y.png``); y is counted from the north.

    Tiles are cached; the least recently used are dropped first. Thread-safe.
    """

    def __init__(self, landscape: Landscape) -> None:
        self._landscape = landscape
        self._box = mercator_box(landscape)
        self._halved = [] if landscape.elevation_m is None else halved(landscape.elevation_m)
        west, south, east, north = self._box
        # The world is this many times as wide as the landscape.
        across = WORLD_M / max(east - west, north - south)
        cells = WORLD_M / cell_mercator_m(landscape)
        self._maxzoom = min(max(math.ceil(math.log2(cells / TILE)), 0), HIGHEST_ZOOM)
        self._minzoom = min(max(math.floor(math.log2(across * SMALLEST_SHARE)), 0), self._maxzoom)
        self._made = lru_cache(maxsize=MAX_BYTES // LARGEST_TILE_BYTES)(self._make)

    def tile(self, z: int, x: int, y: int) -> bytes | None:
        """Return a PNG (256 x 256), or None outside the landscape or the range of zoom levels.

        Elevation is 256 R + G + B / 256 - 32768 m. Beyond the landscape, a tile continues the
        heights at the landscape's edge. These heights are smoothed more with increasing distance,
        so that the hillshade shows no ridges there.
        """
        if not (self._halved and self._minzoom <= z <= self._maxzoom and self._meets(z, x, y)):
            return None
        return self._made(z, x, y)

    def describe(self) -> dict[str, Any]:
        """Return the TileJSON. ``tiles`` is relative to /api/v1/, and empty without elevation."""
        return {
            "tilejson": "3.0.0",
            "tiles": ["terrain/{z}/{x}/{y}.png"] if self._halved else [],
            "tileSize": TILE,
            "encoding": "terrarium",
            "minzoom": self._minzoom,
            "maxzoom": self._maxzoom,
            "bounds": bounds_deg(self._box),
        }

    def _meets(self, z: int, x: int, y: int) -> bool:
        west, south, east, north = tile_box(z, x, y)
        own = self._box
        return west < own[2] and own[0] < east and south < own[3] and own[1] < north

    def _make(self, z: int, x: int, y: int) -> bytes:
        box = tile_box(z, x, y)
        row, col = grid_positions(self._landscape, box, TILE, TILE)
        cells_a_pixel = (box[2] - box[0]) / TILE / cell_mercator_m(self._landscape)
        times = min(max(math.floor(math.log2(cells_a_pixel)), 0), len(self._halved) - 1)
        heights = halved_at(self._halved, times, row, col)
        off_cells = cells_off(row, col, self._landscape.shape)
        off = off_cells > 0.0
        if off.any():
            level = times + np.log2(1.0 + off_cells[off] / (SOON_CELLS * 2.0**times))
            heights[off] = blurred(self._halved, level, row[off], col[off])
        return terrarium_png(heights)


def tile_box(z: int, x: int, y: int) -> Box:
    """Return the edges of a tile in Web Mercator metres."""
    side = WORLD_M / 2.0**z
    west, north = x * side - WORLD_M / 2.0, WORLD_M / 2.0 - y * side
    return west, north - side, west + side, north


def halved(heights: Heights) -> list[Heights]:
    """Return heights (y, x) and their means over 2 x 2, 4 x 4, ... cells for lower zoom levels."""
    found = [heights]
    while min(found[-1].shape) > 2:
        rows, cols = found[-1].shape
        even = np.pad(found[-1], ((0, rows % 2), (0, cols % 2)), mode="edge")
        found.append(0.25 * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]))
    return found


def cells_off(
    row: NDArray[np.float64], col: NDArray[np.float64], shape: tuple[int, int]
) -> NDArray[np.float64]:
    """Return the distance of positions from the outermost cell centres, in cells; 0 inside."""
    rows, cols = shape
    down = np.maximum(np.maximum(-row, row - (rows - 1)), 0.0)
    across = np.maximum(np.maximum(-col, col - (cols - 1)), 0.0)
    found: NDArray[np.float64] = np.hypot(down, across)
    return found


def halved_at(
    levels: list[Heights], level: int, row: NDArray[np.float64], col: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return heights from a level of ``halved`` at positions in the first level's grid."""
    part = 0.5**level
    return between(levels[level], (row + 0.5) * part - 0.5, (col + 0.5) * part - 0.5)


def blurred(
    levels: list[Heights],
    level: NDArray[np.float64],
    row: NDArray[np.float64],
    col: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return heights at positions, interpolated linearly between two levels of ``halved``."""
    level = np.minimum(level, len(levels) - 1.0)
    low = np.minimum(level.astype(np.int32), max(len(levels) - 2, 0))
    found = np.empty(level.shape)
    for each in np.unique(low):
        at = low == each
        share = level[at] - each
        finer = halved_at(levels, each, row[at], col[at])
        coarser = halved_at(levels, min(each + 1, len(levels) - 1), row[at], col[at])
        found[at] = finer * (1.0 - share) + coarser * share
    return found


def between(
    heights: Heights, row: NDArray[np.float64], col: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return heights at float rows and columns (bilinear); off the grid, heights at the edge."""
    rows, cols = heights.shape
    row, col = np.clip(row, 0.0, rows - 1.0), np.clip(col, 0.0, cols - 1.0)
    top = np.minimum(row.astype(np.int32), max(rows - 2, 0))
    left = np.minimum(col.astype(np.int32), max(cols - 2, 0))
    down, right = row - top, col - left
    at, flat = top * cols + left, heights.ravel()
    next_row, next_col = cols if rows > 1 else 0, 1 if cols > 1 else 0
    north = flat[at] * (1 - right) + flat[at + next_col] * right
    south = flat[at + next_row] * (1 - right) + flat[at + next_row + next_col] * right
    found: NDArray[np.float64] = north * (1 - down) + south * down
    return found


def terrarium_png(heights: NDArray[np.floating]) -> bytes:
    """Return heights (y, x) in m as a Terrarium PNG, with a resolution of 1/256 m."""
    from PIL import Image

    value = np.rint((heights + TERRARIUM_ZERO_M) * 256.0).astype(np.uint32)
    pixels = np.stack([value >> 16, value >> 8 & 255, value & 255], axis=-1).astype(np.uint8)
    file = io.BytesIO()
    # The lowest bits are noise, so a search for long matches would take time without benefit.
    Image.fromarray(pixels).save(file, "PNG", compress_type=zlib.Z_HUFFMAN_ONLY)
    return file.getvalue()
