"""Represent the true front of a fire as a growing ring of cells, as in Bent's experiments.

The ring of each time step is a list of cells in clockwise order. Each cell inherits the time of the
last visit from one cell of the previous ring. A new front cell inherits this time from the front
cell behind it, because importance measures unseen growth.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

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
DIRECTIONS = 72  # number of directions in which the maximum rate of spread is searched

# The rate of spread used in the importance of a cell: the speed of the front along its normal, or
# the maximum over all directions, as in Bent's thesis (2.3).
Spread = Literal["outward", "maximum"]


@dataclass(frozen=True)
class RingStep:
    """The front from ``at_s`` until the next step; its n cells are in clockwise order."""

    at_s: float
    cells: Integers  # (n, 2) row, column; no cell twice
    step_m: Floats  # (n) distance from each cell to the next one
    spread_rate_m_s: Floats  # (n) rate of spread used in the importance of each cell
    came_from: Integers  # (n) index of the cell in the previous ring whose visit is inherited
    place_of: Integers  # (m) new index of each cell of the previous ring, in order around the ring


def ring_history(
    burn: Burn, every_s: float = EVERY_S, spread: Spread = "outward"
) -> list[RingStep]:
    """Return the front every ``every_s``, from deployment to the end of a fire."""
    return list(_steps(burn, FrontRates(burn.landscape, burn.weather), every_s, spread))


def _steps(burn: Burn, rates: FrontRates, every_s: float, spread: Spread) -> Iterator[RingStep]:
    before: Integers | None = None
    for at_s in np.arange(burn.deploy_s, burn.end_s + every_s / 2, every_s):
        cells = outer_cells(burn.burned(at_s))
        if before is None:
            before = cells
        ahead = np.roll(cells, -1, axis=0) - cells
        if spread == "maximum":
            rate_m_s = max_spread_rate_m_s(rates, cells, float(at_s))
        else:
            rows, cols = cells.T
            north, east = facing(cells)
            rate_m_s = rates.speeds_m_s(rows, cols, north, east, float(at_s))
        yield RingStep(
            float(at_s),
            cells,
            burn.landscape.cell_size_m * np.hypot(*ahead.T),
            rate_m_s,
            np.asarray(cKDTree(before).query(cells)[1], dtype=np.int64),
            in_order(np.asarray(cKDTree(cells).query(before)[1], dtype=np.int64), len(cells)),
        )
        before = cells


def max_spread_rate_m_s(rates: FrontRates, cells: Integers, at_s: float) -> Floats:
    """Return the largest rate of spread (n) in any direction, in m/s, in cells (n, 2)."""
    angles = np.tile(2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS, len(cells))
    rows, cols = np.repeat(cells, DIRECTIONS, axis=0).T
    every = rates.speeds_m_s(rows, cols, np.cos(angles), np.sin(angles), at_s)
    highest: Floats = every.reshape(len(cells), DIRECTIONS).max(axis=1)
    return highest


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
    """Return places on a ring of ``count`` cells, adjusted to be monotonic within one lap."""
    onward = (np.diff(places, append=places[:1]) + count // 2) % count - count // 2
    lifted = places[0] + np.concatenate([[0], np.cumsum(onward[:-1])])
    rising = np.minimum(np.maximum.accumulate(lifted), places[0] + count - 1)
    found: Integers = np.maximum(rising, places[0]) % count
    return found
