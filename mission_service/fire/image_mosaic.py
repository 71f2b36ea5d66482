"""Combine the images of all cameras in a period into one image. Pure."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Place, bounds_of
from firemodel.assimilation.observation import UNSEEN, Observation, despeckled
from mission_service.events import Observed
from mission_service.fire.observed_window import observation_in


class Mosaic(NamedTuple):
    """The last sighting of each cell in a window until ``at_s``."""

    at_s: float
    here: Place  # the window
    state: NDArray[np.uint8]  # (y, x) UNSEEN, UNBURNED or BURNED
    seen_s: Floats  # (y, x) the time of the sighting
    position_sd_m: float  # the largest of its images

    def observation(self) -> Observation:
        """Return the sightings as one observation at ``at_s``."""
        top, left = (int(each.start) for each in self.here)
        return Observation(self.at_s, top, left, self.state, self.position_sd_m)


class ImageMosaic:
    """The last sighting of each cell, since the last call of ``taken``.

    ``state`` (y, x) is UNSEEN, UNBURNED or BURNED; ``seen_s`` (y, x) is the time of the sighting.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        """Begin without images on a grid of this shape."""
        self.state = np.full(shape, UNSEEN, dtype=np.uint8)
        self.seen_s = np.full(shape, -np.inf)
        self._is_empty = True
        self._position_sd_m = 0.0

    def add(self, image: Observed) -> None:
        """Add an image."""
        seen = observation_in(image)
        state = despeckled(seen)
        self.add_sightings(seen.where, state, np.full(state.shape, seen.at_s))
        self._position_sd_m = max(self._position_sd_m, seen.position_sd_m)

    def add_sightings(self, here: Place, state: NDArray[np.uint8], seen_s: Floats) -> None:
        """Add states (y, x) of a window with their times; later sightings of a cell replace it."""
        new = (state != UNSEEN) & (self.seen_s[here] <= seen_s)
        self.state[here][new] = state[new]
        self.seen_s[here][new] = seen_s[new]
        self._is_empty = self._is_empty and not new.any()

    def taken(self, at_s: float) -> Mosaic | None:
        """Return the images since the last call as one image, or None if there were none."""
        if self._is_empty:
            return None
        here = bounds_of(self.state != UNSEEN)
        found = Mosaic(
            at_s, here, self.state[here].copy(), self.seen_s[here].copy(), self._position_sd_m
        )
        self.state[here], self.seen_s[here] = UNSEEN, -np.inf
        self._is_empty, self._position_sd_m = True, 0.0
        return found
