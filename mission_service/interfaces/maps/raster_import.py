"""Reads uploaded GeoTIFFs of burned, unburned and unseen cells as ``raster`` requests."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN
from firemodel.errors import FireModelError
from firemodel.landscape.readers.formats import OFFLINE, TIFF
from mission_service.fire.observed_window import LETTERS, in_letters
from mission_service.requests import MAX_SIDE_CELLS

MAX_PIXELS = 16_000_000
UNSEEN_VALUE = 255  # in addition to the nodata value of the file
WGS84 = "EPSG:4326"
COARSER = 1.5  # above this ratio of cell sizes, a cell has the most frequent state of its pixels


def read_raster(
    data: bytes, file_name: str, bounds: tuple[float, float, float, float]
) -> dict[str, Any]:
    """Return the keys of a ``raster`` request for a GeoTIFF: its edges and rows.

    The pixels are 1 for burned and 0 for unburned ground; 255 and the nodata value of the file mark
    ground that was not seen. Because 255 often means fire in other files, a file that contains 255
    but not 1 must declare 255 as its nodata value. A raster in another CRS is resampled to latitude
    and longitude. Only the part within ``bounds`` (west, south, east, north, in degrees) is used,
    with at most ``MAX_SIDE_CELLS`` cells on each side.

    Raises FireModelError, with a one-line text, for an unusable file.
    """
    import rasterio
    from rasterio.errors import RasterioError
    from rasterio.io import MemoryFile

    if not data.startswith(TIFF):
        raise FireModelError(
            f"{file_name}: {'is not a GeoTIFF' if data else 'is empty'}; send a GeoTIFF with one "
            "band as the body, not as a form (curl --data-binary @FILE)"
        )
    try:
        with (
            rasterio.Env(**OFFLINE),
            MemoryFile(data) as memory,
            memory.open(driver="GTiff") as file,
        ):
            _check_header(file, file_name)
            states = _states(file.read(1), file.nodata, file_name)
            return _resampled(states, file, file_name, bounds)
    except FireModelError:
        raise
    except (RasterioError, ValueError) as error:  # ValueError: for example an unusable transform
        line = " ".join(str(error).split())
        raise FireModelError(f"{file_name}: cannot be read as a GeoTIFF ({line})") from None


def _check_header(file: Any, file_name: str) -> None:
    if file.count != 1:
        raise FireModelError(f"{file_name}: has {file.count} bands; send one band")
    if file.width * file.height > MAX_PIXELS:
        raise FireModelError(
            f"{file_name}: has {file.width} x {file.height} pixels; send at most "
            f"{MAX_PIXELS / 1e6:.0f} million"
        )
    if file.crs is None or file.transform.is_identity or file.transform.determinant == 0.0:
        raise FireModelError(f"{file_name}: has no CRS or no geotransform; georeference it")


def _states(pixels: NDArray[Any], nodata: float | None, file_name: str) -> NDArray[np.uint8]:
    """Return UNSEEN, UNBURNED or BURNED for each pixel (y, x)."""
    if pixels.dtype.kind not in "uif":
        raise FireModelError(
            f"{file_name}: its pixels are of type {pixels.dtype}; send real numbers (0, 1 and 255)"
        )
    states = np.full(pixels.shape, UNSEEN, dtype=np.uint8)
    states[pixels == 0] = UNBURNED
    states[pixels == 1] = BURNED
    unseen = pixels == UNSEEN_VALUE
    if unseen.any() and not (pixels == 1).any() and nodata != UNSEEN_VALUE:
        raise FireModelError(
            f"{file_name}: has {np.count_nonzero(unseen)} pixels of 255 (not seen) and none of 1 "
            "(burned); set burned pixels to 1, or declare 255 as the nodata value"
        )
    if nodata is not None:
        unseen |= np.isnan(pixels) if math.isnan(nodata) else pixels == nodata
    states[unseen] = UNSEEN
    odd = (states == UNSEEN) & ~unseen
    if odd.any():
        row, col = np.argwhere(odd)[0].tolist()
        raise FireModelError(
            f"{file_name}: the pixel in row {row}, column {col} has the value "
            f"{pixels[row, col]:g}; use 0 (unburned), 1 (burned), and 255 or the nodata value of "
            "the file (not seen)"
        )
    return states


def _resampled(
    states: NDArray[np.uint8],
    file: Any,
    file_name: str,
    bounds: tuple[float, float, float, float],
) -> dict[str, Any]:
    """Return the states on a grid of latitude and longitude, as the keys of a request."""
    from affine import Affine
    from rasterio.enums import Resampling
    from rasterio.warp import reproject, transform_bounds

    edges = transform_bounds(file.crs, WGS84, *file.bounds)
    west, south = (max(one, other) for one, other in zip(edges[:2], bounds[:2], strict=True))
    east, north = (min(one, other) for one, other in zip(edges[2:], bounds[2:], strict=True))
    if not (west < east and south < north):
        raise FireModelError(
            f"{file_name}: lies around lat {(edges[1] + edges[3]) / 2:.4f}, lon "
            f"{(edges[0] + edges[2]) / 2:.4f}, outside the landscape around lat "
            f"{(bounds[1] + bounds[3]) / 2:.4f}, lon {(bounds[0] + bounds[2]) / 2:.4f}; check its "
            "CRS and position"
        )
    height_deg, width_deg = edges[3] - edges[1], edges[2] - edges[0]
    shown = ((north - south) / height_deg * file.height, (east - west) / width_deg * file.width)
    rows, cols = (int(np.clip(math.ceil(each - 0.01), 1, MAX_SIDE_CELLS)) for each in shown)
    down_deg, right_deg = (south - north) / rows, (east - west) / cols
    is_coarser = max(shown[0] / rows, shown[1] / cols) > COARSER
    found = np.full((rows, cols), UNSEEN, dtype=np.uint8)
    reproject(
        states,
        found,
        src_transform=file.transform,
        src_crs=file.crs,
        src_nodata=UNSEEN,
        dst_transform=Affine(right_deg, 0.0, west, 0.0, down_deg, north),
        dst_crs=WGS84,
        dst_nodata=UNSEEN,
        resampling=Resampling.mode if is_coarser else Resampling.nearest,
    )
    edges_deg = {"south_deg": south, "west_deg": west, "north_deg": north, "east_deg": east}
    return {"do": "raster", **edges_deg, "rows": in_letters(LETTERS[found])}
