"""Define observations of a fire: burned, unburned and unseen cells at one time."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Place, window_at
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import mask_of

UNSEEN, UNBURNED, BURNED = 0, 1, 2
FILTER_CELLS = 3  # side of the window of the majority filter
MIN_SEEN = 6
# At this fraction of false alarms or above, single wrong cells often pass the filter. A burned cell
# then also needs burned cells in a window of 5 x 5, unless a clear majority of the cells in its own
# window is burned.
NOISY, CLEARLY, WIDER_CELLS, MIN_AROUND = 0.05, 7, 5, 5


class Observation(NamedTuple):
    """The states of the cells in a window of the landscape's grid at one time."""

    at_s: float
    top: int  # row and column of the window's north-west cell in the grid
    left: int
    state: NDArray[np.uint8]  # (y, x) UNSEEN, UNBURNED or BURNED
    position_sd_m: float = 10.0  # standard deviation of the position, common to the whole window
    missed: float = 0.0  # fraction of the burned cells that are reported as unburned
    false_alarms: float = 0.0  # fraction of unburned cells that are reported as burned
    source: str = ""
    area: Any = None  # the burned area of a mapped perimeter; shapely, in the landscape's CRS

    @property
    def where(self) -> Place:
        """The window as an index into arrays on the landscape's grid."""
        return window_at(self.top, self.left, self.state.shape)


def mapped_perimeter(
    area: Any, landscape: Landscape, at_s: float, position_sd_m: float = 10.0, source: str = ""
) -> Observation:
    """Return the observation of a whole fire with a mapped burned area.

    Args:
        area: The burned area, a shapely Polygon or MultiPolygon in the landscape's CRS.
        landscape: The landscape; all its cells outside the area are unburned.
        at_s: The time of the mapping in s.
        position_sd_m: The standard deviation of the error of the area's outline in m.
        source: The name of the source, for error messages.
    """
    state = np.full(landscape.shape, UNBURNED, dtype=np.uint8)
    state[mask_of([area], landscape)] = BURNED
    return Observation(at_s, 0, 0, state, position_sd_m, source=source, area=area)


def despeckled(observation: Observation) -> NDArray[np.uint8]:
    """Return the states (y, x); a majority filter is applied if the image may contain wrong cells.

    The filter sets each seen cell to the state of most of the seen cells in a window of 3 x 3. A
    cell with fewer than ``MIN_SEEN`` seen cells in its window becomes unseen, because at the edge
    of an image two or three wrong cells could be the majority. At a fraction of ``NOISY`` false
    alarms or above, a cell with fewer than ``CLEARLY`` burned cells in its window needs
    ``MIN_AROUND`` burned cells around this window to be burned.
    """
    state = observation.state
    if not (observation.missed or observation.false_alarms):
        return state
    from scipy.ndimage import uniform_filter  # importing SciPy is slow

    seen = state != UNSEEN
    count, burned = (
        uniform_filter(each.astype(np.float64), FILTER_CELLS, mode="constant")
        for each in (seen, state == BURNED)
    )
    is_burned = 2.0 * burned > count
    if observation.false_alarms >= NOISY:
        near = burned * FILTER_CELLS**2
        wide = uniform_filter((state == BURNED).astype(np.float64), WIDER_CELLS, mode="constant")
        around = wide * WIDER_CELLS**2 - near
        is_burned &= (near > CLEARLY - 0.5) | (around > MIN_AROUND - 0.5)
    found = np.where(is_burned, BURNED, UNBURNED).astype(np.uint8)
    found[~seen | (count * FILTER_CELLS**2 < MIN_SEEN - 0.5)] = UNSEEN
    return found
