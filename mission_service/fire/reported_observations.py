"""Convert reported observations of the fire to observed cells, and check them. Pure.

A report that the estimate explains within its error of position changes nothing. A burned place
elsewhere counts at once if its source makes no false alarms, otherwise only after a second report
of another time or source nearby.
"""

import copy

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask, Place, bounds_of, widened, window_at
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN, Observation
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import mask_of
from mission_service.events import FireObserved
from mission_service.fire.correction_log import drawn_shape

MAX_AGE_S = 6 * 3600.0
MAX_CONTRADICTED = 0.5  # share of the cells that images or other reports show
SHORTLY_S, SEVERAL_CELLS = 120.0, 5
WITHIN_SD = 2.0  # standard deviations of the position
CONFIRMED_WITHIN_S, APART_S = 1800.0, 10.0


def observation_of(event: FireObserved, landscape: Landscape) -> Observation:
    """Return the cells that a report contains, in the state that it states.

    Raises FireModelError if the report is too old or contains no cell of the landscape.
    """
    at_s = event.seen_at_us / 1e6
    age_s = (event.at_us - event.seen_at_us) / 1e6
    if age_s > MAX_AGE_S:
        raise FireModelError(
            f"observe: age_s = {age_s:g}: observations older than {MAX_AGE_S:g} s are not used"
        )
    mask = mask_of([drawn_shape(event, landscape)], landscape)
    if not mask.any():
        raise FireModelError("observe: contains no cell of the landscape; check its place")
    here = bounds_of(mask)
    code = UNBURNED if event.state == "unburned" else BURNED
    state = np.where(mask[here], code, UNSEEN).astype(np.uint8)
    top, left = (int(each.start) for each in here)
    return Observation(
        at_s,
        top,
        left,
        state,
        event.position_sd_m,
        false_alarms=event.false_alarms,
        source=event.source or f"{event.by} at {event.station}",
    )


def refuse_contradicted(seen: Observation, state: NDArray[np.uint8], seen_s: Floats) -> None:
    """Raise FireModelError for a report that contradicts most of the sightings of its cells.

    Burned cells must not have been seen as unburned at a later time; for several cells, sightings
    shortly before count too. Unburned cells must not have been seen as burned before.

    Args:
        seen: The reported observation.
        state: (y, x) the last sighting of each cell of the grid.
        seen_s: (y, x) the times of these sightings.
    """
    state, seen_s = state[seen.where], seen_s[seen.where]
    burned, unburned = seen.state == BURNED, seen.state == UNBURNED
    since_s = seen.at_s - (SHORTLY_S if np.count_nonzero(burned) >= SEVERAL_CELLS else 0.0)
    wrong = burned & (state == UNBURNED) & (seen_s > since_s)
    wrong |= unburned & (state == BURNED) & (seen_s <= seen.at_s)
    agreed = (burned & (state == BURNED)) | (unburned & (state == UNBURNED))
    contradict, agree = np.count_nonzero(wrong), np.count_nonzero(agreed)
    if contradict > MAX_CONTRADICTED * (contradict + agree):
        raise FireModelError(
            f"observe: images or other reports contradict it in {contradict} of "
            f"{contradict + agree} cells that they show; check its place and age, or use correct"
        )


class Confirmation:
    """The last burned places that sources with false alarms have reported."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """Begin without reports on a grid of this shape."""
        self._at_s = np.full(shape, -np.inf)  # (y, x)
        self._source = np.full(shape, -1, dtype=np.int64)  # (y, x) numbers of the sources
        self._numbers: dict[str, int] = {}

    def copy(self) -> "Confirmation":
        """Return an independent copy."""
        found = copy.copy(self)
        found._at_s, found._source = self._at_s.copy(), self._source.copy()
        found._numbers = self._numbers.copy()
        return found

    def surprising(self, seen: Observation, burned: Mask, cell_m: float) -> Observation:
        """Return the part of an observation that changes the estimate.

        Args:
            seen: A reported observation.
            burned: (y, x) the cells of the grid that the estimate has as burned at its time.
            cell_m: The size of a cell.
        """
        reach = int(WITHIN_SD * seen.position_sd_m / cell_m)
        state = seen.state.copy()
        state[(state == BURNED) & _near(burned, seen.where, reach)] = UNSEEN
        state[(state == UNBURNED) & _near(~burned, seen.where, reach)] = UNSEEN
        if seen.false_alarms:
            state[(state == BURNED) & ~self._confirmed(seen, reach + 1)] = UNSEEN
        return seen._replace(state=state, missed=0.0, false_alarms=0.0)

    def _confirmed(self, seen: Observation, reach: int) -> Mask:
        """Return the window's cells (y, x) near another report, and store this report."""
        number = self._numbers.setdefault(seen.source, len(self._numbers))
        apart_s = np.abs(self._at_s - seen.at_s)
        other = (self._source != number) | (apart_s >= APART_S)
        near = _near(other & (apart_s <= CONFIRMED_WITHIN_S), seen.where, reach)
        waits = ~other & (apart_s <= CONFIRMED_WITHIN_S)  # for a later report of this source
        new = (seen.state == BURNED) & ~waits[seen.where]
        self._at_s[seen.where][new] = seen.at_s
        self._source[seen.where][new] = number
        return near


def _near(cells: Mask, where: Place, reach: int) -> Mask:
    """Return the cells (y, x) of a window that have one of ``cells`` within some cells."""
    rows, cols = (slice(max(each.start - reach, 0), each.stop + reach) for each in where)
    part = widened(cells[rows, cols], reach)
    top, left = where[0].start - rows.start, where[1].start - cols.start
    shape = (where[0].stop - where[0].start, where[1].stop - where[1].start)
    return part[window_at(top, left, shape)]
