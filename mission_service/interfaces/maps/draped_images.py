"""Draws the images of sensors on the ground, as overlays for a map in Web Mercator."""

import io
import math
from collections import OrderedDict

import msgspec
import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service.fire.sensors import Scale, SensorImage
from mission_service.interfaces.maps.mercator import (
    NODES,
    Box,
    bounds_deg,
    grid_positions,
    mercator_of,
)

SIDE_PX = 512  # length of the longer side of an overlay
MAX_PICTURES = 48  # number in the cache, each of at most 1 MB
LonLat = tuple[float, float]


class MapImage(msgspec.Struct):
    """An image of a sensor on the map, and the error of the image's position.

    ``corners`` (NW, NE, SE, SW; lon, lat) are those of the overlay. The ellipse at ``lat_deg``,
    ``lon_deg`` has semi-axes of one standard deviation; ``major_from_deg`` is clockwise from true
    north. ``position_sd_m`` is the standard deviation of each axis, as in the observation.
    """

    source: str
    number: int
    at_us: int
    vehicle: str
    name: str
    lat_deg: float
    lon_deg: float
    position_sd_m: float
    major_m: float
    minor_m: float
    major_from_deg: float
    corners: tuple[LonLat, LonLat, LonLat, LonLat]
    width_px: int
    height_px: int
    scale: Scale  # values and their colours
    unit: str  # of the values


class ImagePictures:
    """The overlays of images, with a cache. Thread-safe."""

    def __init__(self, landscape: Landscape) -> None:
        self._landscape = landscape
        self._made: OrderedDict[tuple[str, int], bytes] = OrderedDict()

    def png(self, source: str, image: SensorImage) -> bytes:
        """Return the overlay of a sensor's image; each image of a sensor has a different number."""
        key = source, image.number
        found = self._made.get(key)
        if found is None:
            found = self._made[key] = image_png(image, self._landscape)
            if len(self._made) > MAX_PICTURES:
                self._made.popitem(last=False)
        return found


def image_png(image: SensorImage, landscape: Landscape) -> bytes:
    """Return an image as a PNG for the box of ``overlay_of``; unseen ground is transparent."""
    from PIL import Image

    box, width, height = overlay_of(image, landscape)
    row, col = grid_positions(landscape, box, width, height)
    colours = image.colours(np.column_stack([row.ravel(), col.ravel()]))
    file = io.BytesIO()
    Image.fromarray(colours.reshape(height, width, 4)).save(file, "PNG", compress_level=3)
    return file.getvalue()


def overlay_of(image: SensorImage, landscape: Landscape) -> tuple[Box, int, int]:
    """Return an overlay's box in Web Mercator metres, and its width and height in pixels.

    The box contains ``image.bounds``. Its longer side has ``SIDE_PX`` pixels.
    """
    top, left, bottom, right = image.bounds
    along = np.linspace(0.0, 1.0, NODES)
    row = np.concatenate([top + (bottom - top) * along] * 2 + [0 * along + top, 0 * along + bottom])
    col = np.concatenate(
        [0 * along + left, 0 * along + right] + [left + (right - left) * along] * 2
    )
    lat, lon = landscape.lat_lon_of(*landscape.xy_of(row, col))
    x_m, y_m = mercator_of(lon, lat)
    west, north = float(x_m.min()), float(y_m.max())
    wide_m, high_m = float(x_m.max()) - west, north - float(y_m.min())
    pixel_m = max(wide_m, high_m) / SIDE_PX
    width, height = (math.ceil(side / pixel_m - 1e-9) for side in (wide_m, high_m))
    return (west, north - height * pixel_m, west + width * pixel_m, north), width, height


def described(source: str, image: SensorImage, landscape: Landscape) -> MapImage:
    """Return a sensor's image for the map, with its position, position error and legend."""
    box, width, height = overlay_of(image, landscape)
    west, south, east, north = bounds_deg(box)
    lat_deg, lon_deg = landscape.lat_lon_of(*landscape.xy_of(*image.centre))
    return MapImage(
        source=source,
        number=image.number,
        at_us=image.at_us,
        vehicle=image.vehicle,
        name=image.name,
        lat_deg=round(float(lat_deg), 7),
        lon_deg=round(float(lon_deg), 7),
        position_sd_m=round(math.hypot(image.major_m, image.minor_m) / math.sqrt(2.0), 2),
        major_m=round(image.major_m, 2),
        minor_m=round(image.minor_m, 2),
        major_from_deg=round(float(landscape.true_deg(image.major_from_grid_north_deg)) % 180.0, 1),
        corners=((west, north), (east, north), (east, south), (west, south)),
        width_px=width,
        height_px=height,
        scale=image.scale,
        unit=image.unit,
    )
