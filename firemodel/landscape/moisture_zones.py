"""Divide a landscape into zones of equal dead fuel moisture by elevation, slope, aspect, canopy.

A zone consists of the cells in the same elevation band, class of slope and aspect, and canopy cover
class, as in FARSITE's conditioning. A zone's values are the means over its cells.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats

BAND_M = 250.0  # height of an elevation band
SLOPES = (0.10, 0.40)  # rise over run: below the first, the aspect does not matter
ASPECTS = 8
COVERS = (0.1, 0.5)


class MoistureZones(NamedTuple):
    """The zones of a landscape, in a fixed order; k zones."""

    of_cell: NDArray[np.int16]  # (y, x) the zone of each cell
    elevation_m: Floats  # (k)
    rise_north: Floats  # (k) rise per metre towards grid north
    rise_east: Floats  # (k)
    cover: Floats  # (k) canopy cover, 0 to 1


def moisture_zones(
    elevation_m: NDArray[np.float32],
    gradient: NDArray[np.float32],
    canopy_cover: NDArray[np.float32] | None,
) -> MoistureZones:
    """Return the zones of cells (y, x); ``gradient`` (2, y, x) is the rise to north and east."""
    north, east = gradient
    slope = np.digitize(np.hypot(north, east), SLOPES)
    aspect = np.floor(np.arctan2(-east, -north) / (2.0 * np.pi) * ASPECTS + 0.5).astype(np.int64)
    face = np.where(slope > 0, 1 + (slope - 1) * ASPECTS + aspect % ASPECTS, 0)
    band = np.floor(elevation_m / BAND_M).astype(np.int64)
    cover = np.zeros(elevation_m.shape) if canopy_cover is None else canopy_cover
    faces = 1 + len(SLOPES) * ASPECTS
    shade = np.digitize(cover, COVERS)
    key = ((band - band.min()) * faces + face) * (len(COVERS) + 1) + shade
    _, place, count = np.unique(key, return_inverse=True, return_counts=True)
    place = place.ravel()

    def mean(layer: NDArray[np.floating]) -> Floats:
        return np.bincount(place, weights=layer.ravel()) / count

    zone = place.reshape(elevation_m.shape).astype(np.int16)
    return MoistureZones(zone, mean(elevation_m), mean(north), mean(east), mean(cover))
