"""Convert reported observations of the fire to observed cells, and check them. Pure.

A report that the estimate explains within its error of position changes nothing. A burned place
elsewhere counts at once if its source makes no false alarms, otherwise only after a second report
of another time or source nearby.
"""

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from shapely.geometry.base import BaseGeometry

from firemodel.arrays import Floats, Mask, bounds_of
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN, Observation
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import cells_of
from mission_service.events import FireObserved

MAX_AGE_S = 6 * 3600.0
MAX_CONTRADICTED = 0.5  # share of the burned cells that cameras saw
SHORTLY_S, SEVERAL_CELLS = 120.0, 5
WITHIN_SD = 2.0  # standard deviations of the position
CONFIRMED_WITHIN_S, APART_S = 1800.0, 10.0
SQUARE = np.ones((3, 3), dtype=bool)


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
    cells = cells_of([_shape_of(event, landscape)], landscape)
    if not len(cells):
        raise FireModelError("observe: contains no cell of the landscape; check its place")
    mask = np.zeros(landscape.shape, dtype=bool)
    mask[tuple(cells.T)] = True
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
    """Raise FireModelError for burned cells that cameras saw as unburned at a later time.

    Sightings shortly before also count against a report of several cells.

    Args:
        seen: The reported observation.
        state: (y, x) the last sighting of each cell of the grid.
        seen_s: (y, x) the times of these sightings.
    """
    burned = seen.state == BURNED
    count = np.count_nonzero(burned)
    since_s = seen.at_s - (SHORTLY_S if count >= SEVERAL_CELLS else 0.0)
    unburned = (state[seen.where] == UNBURNED) & (seen_s[seen.where] > since_s)
    wrong = np.count_nonzero(burned & unburned)
    agreed = np.count_nonzero(burned & (state[seen.where] == BURNED))
    if wrong > MAX_CONTRADICTED * (wrong + agreed):
        raise FireModelError(
            f"observe: of its {count} burned cells cameras saw {wrong} unburned then or later, and "
            f"{agreed} burned; check its place and age"
        )


class Confirmation:
    """The last burned places that sources with false alarms have reported."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """Begin without reports on a grid of this shape."""
        self._at_s = np.full(shape, -np.inf)  # (y, x)
        self._source = np.full(shape, -1, dtype=np.int64)  # (y, x) numbers of the sources
        self._numbers: dict[str, int] = {}

    def surprising(self, seen: Observation, burned: Mask, cell_m: float) -> Observation:
        """Return the part of an observation that changes the estimate.

        Args:
            seen: A reported observation.
            burned: (y, x) the cells of the grid that the estimate has as burned at its time.
            cell_m: The size of a cell.
        """
        reach = int(WITHIN_SD * seen.position_sd_m / cell_m)
        state = seen.state.copy()
        state[(state == BURNED) & _widened(burned, reach)[seen.where]] = UNSEEN
        state[(state == UNBURNED) & _widened(~burned, reach)[seen.where]] = UNSEEN
        if seen.false_alarms:
            state[(state == BURNED) & ~self._confirmed(seen, reach + 1)] = UNSEEN
        return seen._replace(state=state)

    def _confirmed(self, seen: Observation, reach: int) -> Mask:
        """Return the window's cells (y, x) near another report, and store this report."""
        number = self._numbers.setdefault(seen.source, len(self._numbers))
        apart_s = np.abs(self._at_s - seen.at_s)
        other = (self._source != number) | (apart_s >= APART_S)
        near = _widened(other & (apart_s <= CONFIRMED_WITHIN_S), reach)[seen.where]
        burned = seen.state == BURNED
        self._at_s[seen.where][burned] = seen.at_s
        self._source[seen.where][burned] = number
        return near


def _widened(cells: Mask, reach: int) -> Mask:
    return np.asarray(binary_dilation(cells, SQUARE, iterations=reach)) if reach else cells


def _shape_of(event: FireObserved, landscape: Landscape) -> BaseGeometry:
    places_m = landscape.xy_of_places(event.points)
    match event.shape:
        case "points":
            return shapely.MultiPoint(places_m)
        case "line":
            return shapely.LineString(places_m)
        case _:
            return shapely.Polygon(places_m)
