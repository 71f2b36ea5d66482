"""Find where a fire first reaches the edge of the landscape, beyond which fire is not simulated."""

from datetime import timedelta
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.spread.fire_scheme import Fire

BEYOND_EDGE = "fire beyond the edge is not simulated; use a larger landscape"


class AtEdge(NamedTuple):
    """The first arrival of a fire at the edge: the time in s and the position in WGS84 degrees."""

    at_s: float
    lat_deg: float
    lon_deg: float

    def __str__(self) -> str:
        sign = "-" if round(self.at_s) < 0 else ""  # a corrected estimate may begin before 0 s
        clock = timedelta(seconds=abs(round(self.at_s)))
        return (
            f"the fire reached the edge of the landscape at {sign}{clock} (lat {self.lat_deg:.5f}, "
            f"lon {self.lon_deg:.5f}); {BEYOND_EDGE}"
        )


def reaches_edge(cells: NDArray[np.bool_]) -> bool:
    """Return True if a mask (y, x) has a cell in the outermost rows or columns."""
    return bool(np.concatenate([cells[0], cells[-1], cells[:, 0], cells[:, -1]]).any())


def at_edge(fire: Fire) -> AtEdge | None:
    """Return the first burned cell of the outermost rows and columns, or None if there is none.

    The computing time is proportional to the number of cells in these rows and columns.
    """
    arrival_s = fire.arrival_time_s
    rows, cols = arrival_s.shape
    sides = (arrival_s[0], arrival_s[-1], arrival_s[:, 0], arrival_s[:, -1])
    first_s = [float(side.min()) for side in sides]
    number = int(np.argmin(first_s))
    if not first_s[number] <= fire.time_s:
        return None
    along = int(np.argmin(sides[number]))
    row, col = ((0, along), (rows - 1, along), (along, 0), (along, cols - 1))[number]
    land = fire.landscape
    lat, lon = land.lat_lon_of(*land.xy_of(row, col))
    return AtEdge(first_s[number], float(lat), float(lon))
