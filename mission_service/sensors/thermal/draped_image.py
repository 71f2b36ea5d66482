"""Drape a thermal image over the ground, for maps. Pure.

Each position on the ground has the colour of the pixel that shows this position. The pixel is found
by the projection that also places the pixels on the ground, so that the picture fits the observed
cells.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from mission_service.config.fire_sections import ThermalCameraSection
from mission_service.fire.sensors import Bounds, Scale
from mission_service.sensors.thermal.frame_cells import FrameCells, celsius_of
from mission_service.sensors.thermal.ground_projections import CornerProjection, PoseProjection
from mission_service.sensors.thermal.thermal_image import ThermalImage

# Cool ground is dark; temperatures at or above the default ``hot_c`` have flame colours.
CELSIUS: Scale = (
    (0.0, "#000010"),
    (30.0, "#1a0a52"),
    (60.0, "#4b0d7a"),
    (120.0, "#a0217a"),
    (200.0, "#e0452f"),
    (400.0, "#fb9a06"),
    (600.0, "#fff2a8"),
)
GREYS, FLAMES = ("#000000", "#c8c8c8"), ("#e0452f", "#fff2a8")  # below ``hot_level``; at or above
MAX_LEVEL = 255.0
COLOURS = 255


class DrapedImage(NamedTuple):
    """The colours of an image, and the projection from ground positions to the image's pixels."""

    projection: PoseProjection | CornerProjection
    step: int  # pixels of the image along each side of a block
    blocks: NDArray[np.uint8]  # (y, x) index of a colour; 0: not seen
    palette: NDArray[np.uint8]  # (256, 4) red, green, blue, opacity; the first one is transparent
    scale: Scale
    unit: str
    bounds: Bounds  # extent of the seen ground

    def colours(self, places: Floats) -> NDArray[np.uint8]:
        """Return red, green, blue and opacity (n, 4) of grid positions (n, 2), row and column.

        Positions that the image does not show are transparent.
        """
        col, row = ((each + 0.5) / self.step for each in self.projection.pixels(places))
        rows, cols = self.blocks.shape
        inside = (row >= 0.0) & (row < rows) & (col >= 0.0) & (col < cols)  # False for NaN
        found = np.zeros(places.shape[0], dtype=np.uint8)
        found[inside] = self.blocks[row[inside].astype(np.int64), col[inside].astype(np.int64)]
        return self.palette[found]


def draped_image(
    image: ThermalImage, found: FrameCells, settings: ThermalCameraSection
) -> DrapedImage:
    """Return the colours of an image on the ground where ``frame_cells`` found observed pixels.

    In a large image, each block of ``found.step`` x ``found.step`` pixels has the colour of its
    hottest pixel, so that no small fire is left out.
    """
    if image.kind == "levels":
        hot_level = settings.hot_level
        assert hot_level is not None  # ``frame_cells`` has checked it
        below, highest = max(hot_level - 1.0, hot_level / 2.0), max(MAX_LEVEL, hot_level + 1.0)
        limits = (0.0, below, hot_level, highest)
        scale: Scale = tuple(zip(limits, (*GREYS, *FLAMES), strict=True))
        values, unit = image.values, "grey level"
    else:
        values, unit, scale = celsius_of(image, settings), "°C", CELSIUS
    share = np.interp(
        _hottest(values, found.step), [value for value, _ in scale], np.linspace(0, 1, len(scale))
    )
    blocks = (1.5 + share * (COLOURS - 1)).astype(np.uint8)
    blocks[~found.seen] = 0
    window = found.window
    top, left = window.row - 0.5, window.col - 0.5
    bounds = (top, left, top + len(window.cells), left + len(window.cells[0]))
    return DrapedImage(found.projection, found.step, blocks, _palette(scale), scale, unit, bounds)


def _hottest(values: NDArray[Any], step: int) -> NDArray[Any]:
    """Return the largest value of each block of ``step`` x ``step`` values (y, x)."""
    if step == 1:
        return values
    short = [-size % step for size in values.shape]
    padded = np.pad(values, [(0, each) for each in short], mode="edge")
    rows, cols = (size // step for size in padded.shape)
    found: NDArray[Any] = padded.reshape(rows, step, cols, step).max(axis=(1, 3))
    return found


def _palette(scale: Scale) -> NDArray[np.uint8]:
    """Return the palette of ``blocks``; the colours of the scale are equally spaced in it."""
    rgb = np.array([list(bytes.fromhex(colour[1:])) for _, colour in scale], dtype=float)
    at = np.linspace(0, len(scale) - 1, COLOURS)
    found = np.zeros((COLOURS + 1, 4), dtype=np.uint8)
    for part in range(3):
        found[1:, part] = np.rint(np.interp(at, np.arange(len(scale)), rgb[:, part]))
    found[1:, 3] = 255
    return found
