"""Keep the last sighting of each cell of the landscape's grid. Pure."""

import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Place, bounds_of
from firemodel.assimilation.observation import UNSEEN, Observation


class Mosaic(NamedTuple):
    """The last sighting of each cell in a window, up to ``at_s``."""

    at_s: float
    here: Place  # the window
    state: NDArray[np.uint8]  # (y, x) UNSEEN, UNBURNED or BURNED
    seen_s: Floats  # (y, x) the time of the sighting
    position_sd_m: float  # the largest among its observations

    def observation(self) -> Observation:
        """Return the sightings as one observation at ``at_s``."""
        top, left = (int(each.start) for each in self.here)
        return Observation(self.at_s, top, left, self.state, self.position_sd_m)


class Sightings:
    """The last sighting of each cell since the last call of ``taken``.

    ``state`` (y, x) is UNSEEN, UNBURNED or BURNED; ``seen_s`` (y, x) is the time of the sighting,
    -infinity in unseen cells.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        """Begin without sightings on a grid of this shape."""
        self.state = np.full(shape, UNSEEN, dtype=np.uint8)
        self.seen_s = np.full(shape, -np.inf)
        self._is_empty = True
        self.position_sd_m = 0.0  # the largest among the observations

    def copy(self) -> "Sightings":
        """Return an independent copy."""
        found = copy.copy(self)
        found.state, found.seen_s = self.state.copy(), self.seen_s.copy()
        return found

    def add(self, seen: Observation) -> None:
        """Add an observation without detection errors (``observation_in``)."""
        self._add_cells(seen.where, seen.state, np.full(seen.state.shape, seen.at_s))
        self.position_sd_m = max(self.position_sd_m, seen.position_sd_m)

    def add_mosaic(self, seen: Mosaic) -> None:
        """Add the sightings of a window."""
        self._add_cells(seen.here, seen.state, seen.seen_s)
        self.position_sd_m = max(self.position_sd_m, seen.position_sd_m)

    def _add_cells(self, here: Place, state: NDArray[np.uint8], seen_s: Floats) -> None:
        """Add the states (y, x) of a window; the later of two sightings of a cell is kept."""
        new = (state != UNSEEN) & (self.seen_s[here] <= seen_s)
        self.state[here][new] = state[new]
        self.seen_s[here][new] = seen_s[new]
        self._is_empty = self._is_empty and not new.any()

    def taken(self, at_s: float) -> Mosaic | None:
        """Return the sightings since the last call as one mosaic, or None if there were none."""
        if self._is_empty:
            return None
        here = bounds_of(self.state != UNSEEN)
        found = Mosaic(
            at_s, here, self.state[here].copy(), self.seen_s[here].copy(), self.position_sd_m
        )
        self.state[here], self.seen_s[here] = UNSEEN, -np.inf
        self._is_empty, self.position_sd_m = True, 0.0
        return found
