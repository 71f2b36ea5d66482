"""Draws transparent images of the fire as overlays for a map in Web Mercator."""

import io
import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.interfaces.maps.mercator import (
    Box,
    bounds_deg,
    cell_mercator_m,
    grid_positions,
    mercator_box,
)

PIXELS_A_CELL = 2.0  # preserves the edges of cells in the warped image
MAX_PIXELS = 2048  # pixels along a side
OPAQUE = 185  # opacity, out of 255
COLOURS = 250
# Nine colours of matplotlib's inferno without its black end, which resembles a shadow.
INFERNO = (
    (30, 12, 69),
    (76, 12, 107),
    (117, 27, 110),
    (160, 42, 99),
    (199, 62, 76),
    (231, 94, 46),
    (249, 139, 11),
    (251, 188, 33),
    (241, 239, 117),
)

Colour = tuple[int, int, int]
Floats = NDArray[np.float64]


class _Frame(NamedTuple):
    box: Box
    width: int
    height: int
    cells: NDArray[np.int32]  # (height, width) flat index of a cell; outside: number of cells


def arrival_png(arrival_s: Floats, landscape: Landscape, from_s: float, until_s: float) -> bytes:
    """Return arrival times (y, x) as a transparent PNG in the landscape's ``overlay_frame``.

    Colours range from ``from_s`` (and earlier) to ``until_s``; cells that burn later or never are
    transparent. ``arrival_scale`` returns the legend.
    """
    share = (arrival_s - from_s) / max(until_s - from_s, 1e-9)
    colour = 1 + np.clip(share, 0.0, 1.0) * (COLOURS - 1)
    levels = np.where(arrival_s <= until_s, colour, 0.0).astype(np.uint8)
    return _png(levels, [_colour(n / (COLOURS - 1)) for n in range(COLOURS)], landscape)


def arrival_scale(from_s: float, until_s: float) -> list[dict[str, Any]]:
    """Return the legend of ``arrival_png``: times and colours, for linear interpolation."""
    last = len(INFERNO) - 1
    return [
        {"at_s": from_s + (until_s - from_s) * n / last, "colour": "#" + bytes(colour).hex()}
        for n, colour in enumerate(INFERNO)
    ]


def overlay_frame(landscape: Landscape) -> dict[str, Any]:
    """Return the bounds, the corners and the size in pixels of a landscape's overlays.

    The corners (NW, NE, SE, SW) are for MapLibre's image source. Positions are [lon, lat] in
    degrees.
    """
    frame = _frame(landscape)
    west, south, east, north = bounds_deg(frame.box)
    return {
        "corners": [[west, north], [east, north], [east, south], [west, south]],
        "bounds": [west, south, east, north],
        "width_px": frame.width,
        "height_px": frame.height,
    }


@lru_cache(maxsize=2)
def _frame(landscape: Landscape) -> _Frame:
    west, south, east, north = mercator_box(landscape)
    pixel_m = max(
        cell_mercator_m(landscape) / PIXELS_A_CELL, max(east - west, north - south) / MAX_PIXELS
    )
    # The number of pixels is rounded up to an integer, which extends the frame to the south and the
    # east.
    width, height = math.ceil((east - west) / pixel_m), math.ceil((north - south) / pixel_m)
    box = west, north - height * pixel_m, west + width * pixel_m, north
    row, col = np.rint(grid_positions(landscape, box, width, height)).astype(np.int32)
    rows, cols = landscape.shape
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    cells = np.where(inside, row * cols + col, rows * cols).astype(np.int32)
    return _Frame(box, width, height, cells)


def _png(levels: NDArray[np.uint8], colours: list[Colour], landscape: Landscape) -> bytes:
    """Return levels (y, x) as a PNG: 0 is transparent, 1 the first colour."""
    from PIL import Image

    pixels = np.append(levels.ravel(), np.uint8(0))[_frame(landscape).cells]
    image = Image.fromarray(pixels)
    image.putpalette(bytes([0, 0, 0]) + b"".join(bytes(colour) for colour in colours))
    file = io.BytesIO()
    clear = bytes([0]) + bytes([OPAQUE]) * len(colours)
    image.save(file, "PNG", transparency=clear, compress_level=3)
    return file.getvalue()


def _colour(share: float) -> Colour:
    """Return a colour from INFERNO, for a fraction from 0 to 1, interpolated linearly."""
    at = share * (len(INFERNO) - 1)
    low = min(int(at), len(INFERNO) - 2)
    pairs = zip(INFERNO[low], INFERNO[low + 1], strict=True)
    red, green, blue = (round(a + (b - a) * (at - low)) for a, b in pairs)
    return red, green, blue
