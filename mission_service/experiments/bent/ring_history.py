"""Represent the true front of a fire as a growing ring of cells, as in Bent's experiments.

The ring of each time step lists its cells in clockwise order. The ring also lists, for each of its
cells, the cell of the previous ring whose last visit this cell inherits. A new front cell inherits
the age of the front cell behind it, because importance measures unseen growth.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firemodel.spread.front import perimeter
from firemodel.spread.front_rates import FrontRates
from mission_service.experiments.fires import Burn

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

EVERY_S = 20.0
TANGENT_CELLS = 3


@dataclass(frozen=True)
class RingStep:
    """The front from ``at_s`` until the next step; arrays are over its n cells, clockwise."""

    at_s: float
    cells: Integers  # (n, 2) row, column; no cell twice
    step_m: Floats  # (n) distance from each cell to the next one
    spread_rate_m_s: Floats  # (n) rate of spread outwards
    came_from: Integers  # (n) index of the cell in the previous ring whose visit each cell inherits
    place_of: Integers  # (m) new index of each cell of the previous ring, in order around the ring


def ring_history(burn: Burn, every_s: float = EVERY_S) -> list[RingStep]:
    """Return the front every ``every_s``, from deployment to the end of a fire."""
    return list(_steps(burn, FrontRates(burn.landscape, burn.weather), every_s))


def _steps(burn: Burn, rates: FrontRates, every_s: float) -> Iterator[RingStep]:
    before: Integers | None = None
    for at_s in np.arange(burn.deploy_s, burn.end_s + every_s / 2, every_s):
        cells = outer_cells(burn.burned(at_s))
        if before is None:
            before = cells
        ahead = np.roll(cells, -1, axis=0) - cells
        north, east = facing(cells)
        yield RingStep(
            float(at_s),
            cells,
            burn.landscape.cell_size_m * np.hypot(*ahead.T),
            rates.speeds_m_s(cells[:, 0], cells[:, 1], north, east, float(at_s)),
            np.asarray(cKDTree(before).query(cells)[1], dtype=np.int64),
            in_order(np.asarray(cKDTree(cells).query(before)[1], dtype=np.int64), len(cells)),
        )
        before = cells


def outer_cells(burned: NDArray[np.bool_]) -> Integers:
    """Return the front (n, 2) of a burned area (y, x): row, column, clockwise, no cell twice.

    Where the burned area is only one cell wide, a walk along the edge passes each cell twice. These
    cells are counted only on the first pass.
    """
    loop = perimeter(burned)[::-1].astype(np.int64)
    _, first = np.unique(loop, axis=0, return_index=True)
    return loop[np.sort(first)]


def facing(cells: Integers) -> tuple[Floats, Floats]:
    """Return the outward unit vectors of a clockwise ring (n, 2), as north (n) and east (n)."""
    along = np.roll(cells, -TANGENT_CELLS, axis=0) - np.roll(cells, TANGENT_CELLS, axis=0)
    length = np.maximum(np.hypot(*along.T), 1e-9)
    # Along a clockwise ring on a north-up map, the outside is on the left.
    return along[:, 1] / length, along[:, 0] / length


def in_order(places: Integers, count: int) -> Integers:
    """Return places on a ring of ``count`` cells, made monotonic and limited to one lap."""
    onward = (np.diff(places, append=places[:1]) + count // 2) % count - count // 2
    lifted = places[0] + np.concatenate([[0], np.cumsum(onward[:-1])])
    rising = np.minimum(np.maximum.accumulate(lifted), places[0] + count - 1)
    found: Integers = np.maximum(rising, places[0]) % count
    return found
