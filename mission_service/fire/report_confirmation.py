"""Find the part of a reported observation that changes the estimate. Pure.

A report that agrees with the estimate within the report's position error changes nothing. A place
whose reported state differs from the estimate changes the estimate at once if the source makes no
detection errors. Otherwise, the place changes the estimate only after a second report nearby, at
another time or from another source. A report of the opposite state at the place cancels the first
report. A few places near the estimated fire need no second report, because few false alarms lie in
this small area. A report of many places, or of burned and unburned places, needs a second report,
because some false alarms of such a report lie in this area.
"""

import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask, Place, widened, window_at
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN, Observation

WITHIN_SD = 2.0  # tolerance, in standard deviations of the position
CONFIRMED_WITHIN_S, APART_S = 1800.0, 10.0
BESIDE_M, FEW_CELLS = 300.0, 20  # distance from the estimated fire, and burned cells in one report
UNLIKELY = 0.5  # at this share of false alarms, places near the fire also need a second report


class Confirmation:
    """The last places reported by sources with detection errors, by their state."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """Begin without reports on a grid of this shape."""
        self._shape = shape
        self._last: dict[int, _LastReports] = {}  # by state
        self._numbers: dict[str, int] = {}  # of the sources

    def copy(self) -> "Confirmation":
        """Return an independent copy."""
        found = copy.copy(self)
        found._last = {
            state: _LastReports(each.at_s.copy(), each.source.copy())
            for state, each in self._last.items()
        }
        found._numbers = self._numbers.copy()
        return found

    def surprising(self, seen: Observation, burned: Mask, cell_m: float) -> "Surprising":
        """Return the part of an observation that changes the estimate.

        Args:
            seen: A reported observation.
            burned: (y, x) the grid cells that are burned in the estimate at the report's time.
            cell_m: The size of a cell.

        Returns:
            This part, and the number of cells that await a second report.
        """
        reach = int(WITHIN_SD * seen.position_sd_m / cell_m)
        state = seen.state.copy()
        state[(state == BURNED) & _near(burned, seen.where, reach)] = UNSEEN
        # An unburned place agrees if, within ``reach``, the estimate has unburned ground and the
        # report does not show only unburned ground: the front may lie just beyond the place.
        unsure = ~_surrounded(seen.state == UNBURNED, reach)
        state[(state == UNBURNED) & unsure & _near(~burned, seen.where, reach)] = UNSEEN
        differs = (state == BURNED) & ~burned[seen.where]
        differs |= (state == UNBURNED) & burned[seen.where]
        self._cancel(seen)
        is_few = np.count_nonzero(seen.state == BURNED) <= FEW_CELLS
        has_unburned = (seen.state == UNBURNED).any()
        for code, errors in ((BURNED, seen.false_alarms), (UNBURNED, seen.missed)):
            if errors and (seen.state == code).any():
                likely = self._confirmed(seen, code, reach + 1)
                if code == BURNED and errors < UNLIKELY and is_few and not has_unburned:
                    likely |= _near(burned, seen.where, int(BESIDE_M / cell_m))
                state[(state == code) & ~likely] = UNSEEN
        waiting = int(np.count_nonzero(differs & (state == UNSEEN)))
        return Surprising(seen._replace(state=state, missed=0.0, false_alarms=0.0), waiting)

    def _cancel(self, seen: Observation) -> None:
        """Remove the earlier reports of places that are now reported in the opposite state."""
        for code, opposite in ((BURNED, UNBURNED), (UNBURNED, BURNED)):
            if code in self._last:
                at_s = self._last[code].at_s[seen.where]
                at_s[(seen.state == opposite) & (at_s <= seen.at_s)] = -np.inf

    def _confirmed(self, seen: Observation, code: int, reach: int) -> Mask:
        """Return the window's cells (y, x) near another report, and store this report."""
        number = self._numbers.setdefault(seen.source, len(self._numbers))
        if code not in self._last:
            at_s, source = np.full(self._shape, -np.inf), np.full(self._shape, -1, dtype=np.int64)
            self._last[code] = _LastReports(at_s, source)
        last = self._last[code]
        apart_s = np.abs(last.at_s - seen.at_s)
        other = (last.source != number) | (apart_s >= APART_S)
        near = _near(other & (apart_s <= CONFIRMED_WITHIN_S), seen.where, reach)
        waits = ~other & (apart_s <= CONFIRMED_WITHIN_S)  # for a later report from this source
        new = (seen.state == code) & ~waits[seen.where]
        last.at_s[seen.where][new] = seen.at_s
        last.source[seen.where][new] = number
        return near


class Surprising(NamedTuple):
    """The part of a report that changes the estimate."""

    seen: Observation
    waiting: int  # cells of the report that await a second report


class _LastReports(NamedTuple):
    """Time and source number of the last report covering each cell (y, x)."""

    at_s: Floats
    source: NDArray[np.int64]


def _surrounded(cells: Mask, reach: int) -> Mask:
    """Return a window's cells (y, x) with only ``cells`` within ``reach`` rows and columns."""
    around = np.pad(~cells, reach, constant_values=True)
    inner = window_at(reach, reach, cells.shape)
    return ~widened(around, reach)[inner]


def _near(cells: Mask, where: Place, reach: int) -> Mask:
    """Return a window's cells (y, x) that are at most ``reach`` cells from one of ``cells``."""
    rows, cols = (slice(max(each.start - reach, 0), each.stop + reach) for each in where)
    part = widened(cells[rows, cols], reach)
    top, left = where[0].start - rows.start, where[1].start - cols.start
    shape = (where[0].stop - where[0].start, where[1].stop - where[1].start)
    return part[window_at(top, left, shape)]
