"""Convert a GeoTIFF of burned and unburned cells to cells of the landscape's grid."""

import math
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import bounds_of
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.bands import Band, bands_of, missing_in, values_of
from firemodel.landscape.readers.feature_times import time_in
from mission_service.fire.observed_window import LETTERS, in_letters
from mission_service.sensors.files.file_contents import FileCells, FileContents, FileSettings
from mission_service.sensors.files.file_names import time_in_name
from mission_service.sensors.one_line import one_line

MAX_CELLS = 25_000_000
MAX_WIDER = 2.0  # largest width of a raster cell, as a multiple of a landscape cell's width
TIME_TAGS = ("TIFFTAG_DATETIME", "ACQUISITIONDATETIME", "datetime")


def raster_contents(path: Path, landscape: Landscape, settings: FileSettings) -> FileContents:
    """Return the burned and unburned cells in the first band of a GeoTIFF.

    The settings give the values of burned and of unburned cells; cells with other values are
    unseen. A cell of the landscape that contains several cells of the raster has the most frequent
    state of the contained cells. Raises FireModelError, whose one-line text names the file, if the
    file cannot be used.
    """
    band = bands_of(path)[0]
    rows, cols = band.shape
    if rows * cols > MAX_CELLS:
        raise FireModelError(f"{path}: has {rows} x {cols} cells; the maximum is {MAX_CELLS:,}")
    if band.crs is None:
        raise FireModelError(
            f"{path}: is not georeferenced; copy images of thermal cameras to the folder of "
            "the sensor thermal_frames"
        )
    seen = _time(path, band, settings)
    cell_m = _cell_size_m(band, landscape)
    if cell_m > MAX_WIDER * landscape.cell_size_m:
        raise FireModelError(
            f"{path}: its cells are {cell_m:.0f} m wide, but those of the landscape are "
            f"{landscape.cell_size_m:g} m wide; send coarse detections as pixels (FIRMS CSV)"
        )
    state = _on_grid(band, _states(band, settings), cell_m, landscape)
    if not (state != UNSEEN).any():
        raise FireModelError(f"{path}: shows no burned or unburned cell of the landscape")
    here = bounds_of(state != UNSEEN)
    cells = FileCells(
        here[0].start,
        here[1].start,
        in_letters(LETTERS[state[here]]),
        seen.timestamp(),
        round(math.hypot(cell_m / math.sqrt(12.0), settings.position_sd_m), 2),
        one_line(path.stem),
    )
    return FileContents("raster", (cells,))


def _time(path: Path, band: Band, settings: FileSettings) -> datetime:
    for tag in TIME_TAGS:
        text = band.tags.get(tag, "").strip()
        if text[4:5] == text[7:8] == ":":  # TIFF format: 2026:07:04 19:37:11
            text = text[:10].replace(":", "-") + text[10:]
        with suppress(ValueError):
            found = time_in(text, settings.zone)
            if isinstance(found, datetime):
                return found
    named = time_in_name(path.name, settings.zone)
    if named is None:
        raise FireModelError(
            f"{path}: has no time; add TIFFTAG_DATETIME, or begin the file name with the time, "
            "for example 20260704_1937Z"
        )
    return named


def _states(band: Band, settings: FileSettings) -> NDArray[np.uint8]:
    values = values_of(band)
    found = np.full(values.shape, UNSEEN, dtype=np.uint8)
    found[np.isin(values, settings.unburned_values)] = UNBURNED
    found[np.isin(values, settings.burned_values)] = BURNED
    found[missing_in(band, values)] = UNSEEN
    if not (found != UNSEEN).any():
        raise FireModelError(
            f"{band.path}: has no cell with a value of burned_values or unburned_values; set them "
            "in [estimate.observation_files]"
        )
    return found


def _cell_size_m(band: Band, landscape: Landscape) -> float:
    """Return the longer side of a raster's central cell in the landscape's CRS."""
    from rasterio.warp import transform

    col, row = band.shape[1] / 2.0, band.shape[0] / 2.0
    corners = [band.transform @ place for place in ((col, row), (col + 1, row), (col, row + 1))]
    xs, ys = transform(band.crs, landscape.crs, *zip(*corners, strict=True))
    sides_m = [math.hypot(xs[k] - xs[0], ys[k] - ys[0]) for k in (1, 2)]
    if not all(map(math.isfinite, sides_m)) or min(sides_m) <= 0.0:
        raise FireModelError(f"{band.path}: cannot be projected onto the landscape")
    return max(sides_m)


def _on_grid(
    band: Band, state: NDArray[np.uint8], cell_m: float, landscape: Landscape
) -> NDArray[np.uint8]:
    """Resample the states of a raster's cells to the landscape's cells (y, x)."""
    from rasterio import Affine
    from rasterio.warp import Resampling, reproject

    found: NDArray[Any] = np.full(landscape.shape, UNSEEN, dtype=np.uint8)
    side_m = landscape.cell_size_m
    finer = cell_m < landscape.cell_size_m
    reproject(
        state,
        found,
        src_transform=band.transform,
        src_crs=band.crs,
        src_nodata=UNSEEN,
        dst_transform=Affine(side_m, 0.0, landscape.west_m, 0.0, -side_m, landscape.north_m),
        dst_crs=landscape.crs,
        dst_nodata=UNSEEN,
        resampling=Resampling.mode if finer else Resampling.nearest,
    )
    return found
