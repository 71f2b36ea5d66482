"""Compare slope and aspect with the same landscape's elevation."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import horn

STEEP = 0.1  # only ground steeper than this is compared (rise over run)
MAX_SLOPE_RATIO = 1.5  # a ratio above this value or below its inverse results in a note
OPPOSITE_DEG = 135.0


def ground_notes(
    name: str,
    slope_tan: NDArray[np.float32],
    aspect_deg: NDArray[np.floating],
    elevation_m: NDArray[np.floating],
    cell_size_m: float,
) -> Iterator[str]:
    """Yield a note if slope or aspect (y, x) contradict the elevation.

    ``slope_tan`` is rise over run. ``aspect_deg`` is the direction in which the ground falls,
    clockwise from north; a negative value means an unknown aspect. The notes begin with ``name``.
    """
    north, east = horn(elevation_m, cell_size_m)
    rise = np.hypot(north, east)
    steep = (rise > STEEP) & (aspect_deg >= 0.0) & (slope_tan > 0.0)
    if not steep.any():
        return
    ratio = float(np.median(slope_tan[steep] / rise[steep]))
    if not 1.0 / MAX_SLOPE_RATIO < ratio < MAX_SLOPE_RATIO:
        yield (
            f"{name}: slopes are {ratio:.2g} times those computed from the elevation; check the "
            "unit of slope (percent or degrees)"
        )
    falls = np.rad2deg(np.arctan2(-east[steep], -north[steep]))
    off = np.deg2rad(aspect_deg[steep] - falls)
    turned_deg = float(np.rad2deg(np.arctan2(np.sin(off).mean(), np.cos(off).mean())))
    if abs(turned_deg) > OPPOSITE_DEG:
        yield (
            f"{name}: aspect points uphill, but must be the direction in which the ground falls; "
            "omit both slope and aspect to compute them from the elevation"
        )
