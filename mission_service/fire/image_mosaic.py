"""Combine the images of all cameras in a period into one image. Pure."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Place, bounds_of, window_at
from firemodel.assimilation.observation import UNSEEN
from mission_service.events import Observed
from mission_service.fire.observed_window import states_in


class Mosaic(NamedTuple):
    """The last sighting of each cell in a window until ``at_s``."""

    at_s: float
    here: Place  # the window
    state: NDArray[np.uint8]  # (y, x) UNSEEN, UNBURNED or BURNED
    seen_s: Floats  # (y, x) the time of the sighting


class ImageMosaic:
    """The images of the present period."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """Begin without images on a grid of this shape."""
        self._state = np.full(shape, UNSEEN, dtype=np.uint8)
        self._seen_s = np.zeros(shape)
        self._is_empty = True

    def add(self, image: Observed) -> None:
        """Add an image; of a cell that was seen before, the later sighting counts."""
        state, at_s = states_in(image.cells), image.at_us / 1e6
        here = window_at(image.row, image.col, state.shape)
        new = (state != UNSEEN) & (self._seen_s[here] <= at_s)
        self._state[here][new] = state[new]
        self._seen_s[here][new] = at_s
        self._is_empty = self._is_empty and not new.any()

    def taken(self, at_s: float) -> Mosaic | None:
        """Return the images since the last call as one image, or None if there were none."""
        if self._is_empty:
            return None
        here = bounds_of(self._state != UNSEEN)
        found = Mosaic(at_s, here, self._state[here].copy(), self._seen_s[here].copy())
        self._state[here], self._seen_s[here], self._is_empty = UNSEEN, 0.0, True
        return found
