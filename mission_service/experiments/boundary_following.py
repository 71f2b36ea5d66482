"""Fly along the true front of a burn from cell to cell, as Islam & Hu assume.

"We assume that the UAS has the capability of boundary following and always flies on top of the fire
perimeter" (section III). A planner decides the direction; this module finds the next cell.
"""

import heapq

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# Neighbours clockwise from north, as (row, col) steps.
AROUND = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))


def enclosed_s(arrival_s: Floats) -> Floats:
    """Return the time (y, x) at which each cell burns or is cut off from the outside.

    Holes and closed inlets are not part of the front around the fire. A cell is cut off when fire
    closes its last path to the outside across cell sides. Dijkstra's algorithm finds for each cell
    the path that stays free of fire for the longest time.
    """
    rows, cols = arrival_s.shape
    found = np.full((rows + 2, cols + 2), -np.inf)
    found[[0, -1]], found[:, [0, -1]] = np.inf, np.inf
    found = found.tolist()
    arrival = np.pad(arrival_s, 1, constant_values=np.inf).tolist()
    edge = [(-np.inf, row, col) for row in range(rows + 2) for col in (0, cols + 1)]
    edge += [(-np.inf, row, col) for row in (0, rows + 1) for col in range(1, cols + 1)]
    while edge:
        minus, row, col = heapq.heappop(edge)
        for step_row, step_col in AROUND[::2]:
            to_row, to_col = row + step_row, col + step_col
            if not (0 < to_row <= rows and 0 < to_col <= cols):
                continue
            until = min(-minus, arrival[to_row][to_col])
            if until > found[to_row][to_col]:
                found[to_row][to_col] = until
                heapq.heappush(edge, (-until, to_row, to_col))
    return np.array(found)[1:-1, 1:-1]


class BoundaryFollower:
    """A vehicle on the front of a growing fire: its cell, and the direction to the outside."""

    def __init__(self, fire_s: Floats, at_s: float) -> None:
        """Start at the northernmost cell of the filled fire (``enclosed_s``)."""
        self._enclosed_s = np.pad(fire_s, 1, constant_values=np.inf)
        row, col = np.argwhere(self._enclosed_s <= at_s)[0]
        self._row, self._col = int(row), int(col)
        self._outside = 0

    @property
    def cell(self) -> tuple[int, int]:
        """The row and the column of the vehicle's cell."""
        return self._row - 1, self._col - 1

    def onwards(self, clockwise: bool, at_s: float) -> None:
        """Move to the next cell of the current front (one step of Moore-neighbour tracing).

        If the fire has spread past the vehicle, the vehicle first moves outwards to the front.
        """
        fire = self._enclosed_s
        step_row, step_col = AROUND[self._outside]
        while fire[self._row + step_row, self._col + step_col] <= at_s:
            self._row, self._col = self._row + step_row, self._col + step_col
        turn = 1 if clockwise else -1
        for side in range(self._outside + turn, self._outside + 8 * turn, turn):
            step_row, step_col = AROUND[side % 8]
            row, col = self._row + step_row, self._col + step_col
            if fire[row, col] <= at_s:
                break
        else:
            return  # the fire is a single cell
        before_row, before_col = AROUND[(side - turn) % 8]
        empty = (before_row - step_row, before_col - step_col)
        self._outside = AROUND.index(empty)
        self._row, self._col = row, col
