"""The on-board fire map of Islam & Hu (table 1), which stores the fire as observed by a camera.

The map has 360 whole-degree bearings, clockwise from north, around a centre (the ignition cell or
the fire's centre). For each bearing the map stores the outer cell (the front at the last view), the
inner cell (the front at an earlier view), and the times of both views. Observations are the only
input; the map does not read the simulated fire.

Distances are in cells and times in seconds of mission time.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.assimilation.observation import BURNED, UNBURNED
from firemodel.compiled import compiled

BEARINGS = 360

LARGEST_GAP_CELLS = 3.0  # maximum distance between neighbours on the front
# A front cell is at the edge of an unburned island if burned ground on its bearing extends more
# than this distance beyond the cell.
ISLAND_CELLS = 1.0

_RADIANS = np.deg2rad(np.arange(BEARINGS))
NORTH = np.cos(_RADIANS)
EAST = np.sin(_RADIANS)

Floats = NDArray[np.float64]


def polar(
    rows: Floats, cols: Floats, centre_row: float, centre_col: float
) -> tuple[NDArray[np.int64], Floats]:
    """Return the whole-degree bearing and the distance (in cells) of each cell from the centre."""
    north = centre_row - rows
    east = cols - centre_col
    bearing = np.rint(np.rad2deg(np.arctan2(east, north))).astype(np.int64) % BEARINGS
    return bearing, np.hypot(north, east)


@lru_cache(maxsize=2)
def _grid_around(
    shape: tuple[int, int], centre_row: float, centre_col: float
) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
    """Return arrays (y, x): bearing, distance and half the angular span of each cell.

    Angles are in whole degrees and distances in cells. A cell near the centre spans many bearings.
    Maps with the same centre share these arrays.
    """
    rows, cols = np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij")
    bearing, distance = polar(rows.astype(float), cols.astype(float), centre_row, centre_col)
    spans = np.rad2deg(0.5 / np.maximum(distance, 1.0)).astype(np.int64)
    return bearing, distance, spans


@compiled
def front_in_window(window):  # type: ignore[no-untyped-def]
    """Return a mask (y, x) of the burned cells that have an unburned 4-neighbour in the window."""
    rows, cols = window.shape
    front = np.zeros((rows, cols), dtype=np.bool_)
    for row in range(rows):
        for col in range(cols):
            front[row, col] = window[row, col] == BURNED and (
                (row > 0 and window[row - 1, col] == UNBURNED)
                or (row < rows - 1 and window[row + 1, col] == UNBURNED)
                or (col > 0 and window[row, col - 1] == UNBURNED)
                or (col < cols - 1 and window[row, col + 1] == UNBURNED)
            )
    return front


class FireMap:
    """A fire map that stores the outer and inner cells observed on each bearing.

    ``baseline_s`` is the minimum time between the two visits from which a spread rate is computed.
    If ``baseline_s`` is 0, the map works as in the paper: whenever a new front cell is seen on a
    bearing, the previous outer cell becomes the inner cell, whatever the age of the previous view.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        centre_row: float,
        centre_col: float,
        ignited_at_s: float,
        baseline_s: float,
    ) -> None:
        if not np.isfinite([centre_row, centre_col]).all():
            raise ValueError(f"a fire map needs a finite centre, not {centre_row}, {centre_col}")
        self.shape = shape
        self.centre_row = centre_row
        self.centre_col = centre_col
        self.ignited_at_s = ignited_at_s
        self.baseline_s = baseline_s
        self._grid = _grid_around(shape, centre_row, centre_col)
        self.outer = np.full(BEARINGS, np.nan)
        self.outer_at_s = np.full(BEARINGS, np.nan)
        # Listing 2, iii: initially, the ignition point is the inner cell.
        self.inner = np.zeros(BEARINGS)
        self.inner_at_s = np.full(BEARINGS, float(ignited_at_s))
        self._next_inner = self.inner.copy()
        self._next_inner_at_s = self.inner_at_s.copy()
        # The farthest cell seen burned so far; the front is never nearer than this.
        self.burned = np.zeros(BEARINGS)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the large arrays that depend only on the centre."""
        return {name: value for name, value in vars(self).items() if name != "_grid"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._grid = _grid_around(self.shape, self.centre_row, self.centre_col)

    @property
    def complete(self) -> bool:
        """Whether the front has been seen on every bearing."""
        return not bool(np.isnan(self.outer).any())

    def add_window(
        self, row: int, col: int, window: NDArray[np.uint8], at_s: float
    ) -> NDArray[np.bool_]:
        """Update the map from one camera window; return a mask (360) of the bearings in view."""
        region = np.s_[row : row + window.shape[0], col : col + window.shape[1]]
        seen, in_view = _seen(window, *(each[region] for each in self._grid), self.burned)
        self._visit(seen, in_view, at_s)
        return np.asarray(in_view)

    def correct_window(self, row: int, col: int, window: NDArray[np.uint8], at_s: float) -> None:
        """Apply an operator's correction: a window that may reset burned ground to unburned."""
        not_burned, still_burned = taken_back(
            row, col, window, (self.centre_row, self.centre_col), self.burned
        )
        self.burned[not_burned] = still_burned[not_burned]
        for front in (self.outer, self.inner, self._next_inner):
            # A front that has not been seen (NaN) stays unseen.
            front[not_burned] = np.minimum(front[not_burned], still_burned[not_burned])
        self.add_window(row, col, window, at_s)

    def _visit(self, seen: Floats, in_view: NDArray[np.bool_], at_s: float) -> None:
        if self.baseline_s <= 0.0:
            first = in_view & np.isnan(self.outer)
            moved = in_view & ~first & (np.abs(seen - self.outer) >= 0.5)
            self.inner[moved] = self.outer[moved]
            self.inner_at_s[moved] = self.outer_at_s[moved]
        else:
            due = in_view & (at_s - self._next_inner_at_s >= self.baseline_s)
            self.inner[due] = self._next_inner[due]
            self.inner_at_s[due] = self._next_inner_at_s[due]
            self._next_inner[due] = seen[due]
            self._next_inner_at_s[due] = at_s
        self.outer[in_view] = seen[in_view]
        self.outer_at_s[in_view] = at_s

    def spread_rate_cells_s(self, smoothing_deg: int = 0) -> Floats:
        """Return the spread rate (eq. 1, >= 0) on each bearing, averaged over ± ``smoothing_deg``.

        A value of 0 means no averaging.
        """
        rate = _rate(self.outer, self.outer_at_s, self.inner, self.inner_at_s)
        return circular_mean(rate, smoothing_deg)

    def filled_outer(self) -> tuple[Floats, Floats]:
        """Return the outer cells' distances and times, interpolated on bearings not yet seen."""
        return fill_circular(self.outer), fill_circular(self.outer_at_s)


def taken_back(
    row: int, col: int, window: NDArray[np.uint8], centre: tuple[float, float], burned: Floats
) -> tuple[NDArray[np.bool_], Floats]:
    """Return the bearings on which a window shows less burned ground, and the reduced distances.

    ``burned`` (360) is the distance in cells from ``centre`` (row, col) to the outermost burned
    ground on each bearing. The first result is true where the window shows this ground to be
    unburned. The second result is ``burned`` with reduced distances on those bearings.
    """

    return _taken_back(row, col, window, *centre, burned, NORTH, EAST)  # type: ignore[no-any-return]


def circular_mean(values: Floats, half_width: int) -> Floats:
    """Return the circular moving mean of values, over ``half_width`` neighbours on each side."""
    if half_width <= 0:
        return values
    padded = np.concatenate([values[-half_width:], values, values[:half_width]])
    sums = np.concatenate([[0.0], np.cumsum(padded)])
    width = 2 * half_width + 1
    means: Floats = (sums[width:] - sums[:-width]) / width
    return means


def fill_circular(values: Floats) -> Floats:
    """Return the values with each NaN interpolated linearly around the circle.

    If all values are NaN, they stay NaN.
    """
    if not np.isnan(values).any():
        return values
    finite = np.flatnonzero(~np.isnan(values))
    if not finite.size:
        return values
    return np.interp(np.arange(values.size), finite, values[finite], period=values.size)


@compiled
def _seen(window, bearings, distances, spans, burned):  # type: ignore[no-untyped-def]
    """Return the front's distance and visibility on each bearing; update ``burned``."""
    front = front_in_window(window)
    seen = np.full(BEARINGS, -np.inf)
    spanned = np.full(BEARINGS, -np.inf)  # like ``seen``, for all bearings that a cell spans
    for row in range(window.shape[0]):
        for col in range(window.shape[1]):
            if window[row, col] != BURNED:
                continue
            bearing, distance = bearings[row, col], distances[row, col]
            for offset in range(-spans[row, col], spans[row, col] + 1):
                place = (bearing + offset) % BEARINGS
                burned[place] = max(burned[place], distance)
                if front[row, col]:
                    spanned[place] = max(spanned[place], distance)
            if front[row, col]:
                seen[bearing] = max(seen[bearing], distance)
    # On a flank that runs outwards, the front cell of a bearing may be nearer than a front cell of
    # a neighbouring bearing that spans this bearing too. The nearer cell is not on an island.
    flank = (seen > -np.inf) & (seen < burned - ISLAND_CELLS)
    seen = np.where(flank, spanned, seen)
    in_view = (seen > -np.inf) & (seen >= burned - ISLAND_CELLS)
    _fill_gaps(seen, in_view)
    return seen, in_view


@compiled
def _taken_back(row, col, window, centre_row, centre_col, burned, north, east):  # type: ignore[no-untyped-def]
    unburned, still_burned = np.zeros(BEARINGS, np.bool_), burned.copy()
    for bearing in range(BEARINGS):
        out = burned[bearing]
        # Search inwards for the first cell that is not unburned in the window.
        while out > -0.5:
            y = int(np.rint(centre_row - out * north[bearing])) - row
            x = int(np.rint(centre_col + out * east[bearing])) - col
            inside = 0 <= y < window.shape[0] and 0 <= x < window.shape[1]
            if not inside or window[y, x] != UNBURNED:
                break
            unburned[bearing] = True
            out -= 0.5
        still_burned[bearing] = out if out > -0.5 else 0.0
    return unburned, still_burned


@compiled
def _rate(outer, outer_at_s, inner, inner_at_s):  # type: ignore[no-untyped-def]
    found = np.zeros(BEARINGS)
    for bearing in range(BEARINGS):
        elapsed_s = outer_at_s[bearing] - inner_at_s[bearing]
        moved = outer[bearing] - inner[bearing]
        if elapsed_s > 0.0 and moved > 0.0:  # NaN (front not yet seen) fails both tests
            found[bearing] = moved / elapsed_s
    return found


@compiled
def _fill_gaps(seen, in_view):  # type: ignore[no-untyped-def]
    """Interpolate the distances on the bearings between two neighbouring front cells."""
    seen_at = np.flatnonzero(in_view)
    for place in range(seen_at.size if seen_at.size > 1 else 0):
        start, end = seen_at[place], seen_at[(place + 1) % seen_at.size]
        steps = (end - start) % BEARINGS
        if steps < 2 or steps >= BEARINGS // 2:
            continue
        chord = np.hypot(
            seen[start] * NORTH[start] - seen[end] * NORTH[end],
            seen[start] * EAST[start] - seen[end] * EAST[end],
        )
        if chord > LARGEST_GAP_CELLS:
            continue
        for step in range(1, steps):
            share = step / steps
            seen[(start + step) % BEARINGS] = seen[start] * (1 - share) + seen[end] * share
            in_view[(start + step) % BEARINGS] = True
