"""Draws map tiles of a georeferenced raster with GDAL, using the overviews of a COG."""

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mission_service.errors import MissionServiceError
from mission_service.interfaces.maps.mercator import WORLD_M
from mission_service.interfaces.maps.terrain import TILE, tile_box

QUALITY = 80
SAMPLE = 512  # pixels along each side of the sample that sets the contrast of values above 8 bits
CONTRAST_PCT = (2.0, 98.0)  # these percentiles become black and white
HIGHEST_ZOOM = 22
WIDTH_ZOOMS = 3  # at the lowest zoom the raster fills at least 1/2**3 of the width of a tile


class RasterTiles:
    """The tiles of one raster; each read opens the file, so that threads can read concurrently."""

    def __init__(self, path: Path) -> None:
        """Read the extent, the resolution and the range of values. Raises MissionServiceError."""
        import rasterio
        from rasterio.errors import RasterioError
        from rasterio.warp import transform_bounds

        self._path = path
        try:
            with rasterio.open(path) as source:
                if source.crs is None:
                    raise MissionServiceError(f"{path}: has no coordinate reference system")
                west, south, east, north = transform_bounds(source.crs, "EPSG:3857", *source.bounds)
                pixel_m = min((east - west) / source.width, (north - south) / source.height)
                self.bounds_deg: tuple[float, float, float, float] = transform_bounds(
                    source.crs, "EPSG:4326", *source.bounds
                )
                self._stretch = self._range_of(source)
        except RasterioError as error:
            raise MissionServiceError(f"{path}: not a readable raster: {error}") from None
        finest = math.ceil(math.log2(WORLD_M / TILE / pixel_m))
        highest = min(max(finest, 0), HIGHEST_ZOOM)
        width_deg = self.bounds_deg[2] - self.bounds_deg[0]
        lowest = math.floor(math.log2(360.0 / max(width_deg, 1e-6))) - WIDTH_ZOOMS
        self.zooms = (min(max(lowest, 0), highest), highest)

    @staticmethod
    def _range_of(source: Any) -> tuple[float, float] | None:
        """Return the values that become black and white; None for 8-bit values."""
        if all(each == "uint8" for each in source.dtypes):
            return None
        shape = (source.count, min(source.height, SAMPLE), min(source.width, SAMPLE))
        values = source.read(out_shape=shape, masked=True).compressed()
        values = values[np.isfinite(values)]
        if not values.size:
            return None
        low, high = np.percentile(values, CONTRAST_PCT)
        return float(low), float(max(high, low + 1e-9))

    def draw(self, z: int, x: int, y: int) -> bytes | None:
        """Return a tile as WebP, or None if the raster has no values there."""
        import rasterio
        from affine import Affine
        from PIL import Image
        from rasterio.enums import Resampling
        from rasterio.vrt import WarpedVRT

        west, _, east, north = tile_box(z, x, y)
        pixel_m = (east - west) / TILE
        place = Affine(pixel_m, 0.0, west, 0.0, -pixel_m, north)
        with (
            rasterio.open(self._path) as source,
            WarpedVRT(
                source,
                crs="EPSG:3857",
                transform=place,
                width=TILE,
                height=TILE,
                resampling=Resampling.nearest if _palette(source) else Resampling.bilinear,
                add_alpha=not _has_alpha(source),
            ) as warped,
        ):
            mask = warped.dataset_mask()
            if not mask.any():
                return None
            pixels = self._colours(source, warped)
        file = io.BytesIO()
        rgba = np.dstack([*pixels, mask])
        Image.fromarray(rgba).save(file, "WEBP", quality=QUALITY, method=2)
        return file.getvalue()

    def _colours(self, source: Any, warped: Any) -> NDArray[np.uint8]:
        """Return red, green and blue (3, y, x) of a warped raster."""
        palette = _palette(source)
        if palette:
            table = np.zeros((256, 3), np.uint8)
            for value, colour in palette.items():
                table[value] = colour[:3]
            return np.moveaxis(table[warped.read(1)], 2, 0)
        colours = 3 if source.count >= 3 else 1
        values = warped.read(list(range(1, colours + 1)))
        if self._stretch is not None:
            low, high = self._stretch
            scaled = np.nan_to_num((values.astype(np.float64) - low) / (high - low))
            values = np.rint(255.0 * np.clip(scaled, 0.0, 1.0))
        found: NDArray[np.uint8] = np.broadcast_to(values, (3, TILE, TILE)).astype(np.uint8)
        return found


def _palette(source: Any) -> dict[int, tuple[int, ...]]:
    """Return the colours of the values of the first band; empty without a colour table."""
    try:
        found: dict[int, tuple[int, ...]] = source.colormap(1)
    except ValueError:
        return {}
    return found if source.count == 1 and source.dtypes[0] == "uint8" else {}


def _has_alpha(source: Any) -> bool:
    from rasterio.enums import ColorInterp

    return ColorInterp.alpha in source.colorinterp
