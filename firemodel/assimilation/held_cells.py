"""Find the cells at which a fire is held, for example by crews or by an unmapped barrier."""

import copy

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, distance_transform_edt, uniform_filter

from firemodel.arrays import Floats, Mask, Place, widened
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN

HELD_S = 400.0  # a cell with at least this evidence counts as held in forecasts
MAX_GAP_S = 1200.0  # a longer time between two sightings counts as this long
LIKELY = 0.15  # members agree with an unburned cell if a smaller fraction of them burned it
FORGOTTEN_S = 600.0  # time in which evidence falls to 1/e while the members agree
CLOSING_CELLS = 2  # gaps of up to twice this width in a held line are closed
FRONT_CELLS = 21  # side of the window in which half of the front must be held
BEHIND_CELLS = 60.0  # depth of the ground behind a held front that also counts as held
SQUARE = np.ones((3, 3), dtype=bool)


class HeldCells:
    """The times for which cells stayed unburned although fire reached them in most members."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._evidence_s = np.zeros(shape)
        self._seen_s = np.full(shape, np.nan)  # time of the last sighting
        self._burned = np.zeros(shape, dtype=bool)

    def copy(self) -> "HeldCells":
        """Return an independent copy."""
        return copy.deepcopy(self)

    def add_observation(
        self, here: Place, state: NDArray[np.uint8], at_s: float, share: Floats
    ) -> None:
        """Process an observation.

        Args:
            here: The window of the observation.
            state: (y, x) the states of the window's cells.
            at_s: The time of the observation in s.
            share: (y, x) the share of the members in which each cell has burned by ``at_s``.
        """
        evidence_s, seen_s, burned = self._evidence_s[here], self._seen_s[here], self._burned[here]
        burned |= state == BURNED
        evidence_s[burned] = 0.0
        stays = (state == UNBURNED) & ~burned
        gap_s = np.minimum(np.nan_to_num(at_s - seen_s), MAX_GAP_S)
        evidence_s[stays] += (share * gap_s)[stays]
        calm = stays & (share < LIKELY)
        evidence_s[calm] *= np.exp(-gap_s[calm] / FORGOTTEN_S)
        seen_s[state != UNSEEN] = at_s

    def held(self) -> Mask:
        """Return the mask (y, x) of the held cells and of the ground behind a held front."""
        cells = self._evidence_s > HELD_S
        closed = binary_closing(cells, SQUARE, iterations=CLOSING_CELLS)
        held = (closed | cells) & ~self._burned
        front = widened(self._burned, 1) & ~self._burned & ~np.isnan(self._seen_s)
        return np.asarray(held | (ground_behind(held, front) & ~self._burned), dtype=bool)


def ground_behind(held: Mask, front: Mask) -> Mask:
    """Return the ground (y, x) that fire could reach only by going around a held part of the front.

    If this ground did not count as held, a forecast fire would spread around the ends of a line of
    held cells and burn the ground that the line protects. A single held cell may be a slow patch of
    fuel and therefore protects no ground.

    Args:
        held: (y, x) held cells.
        front: (y, x) unburned cells that touch burned cells.

    Returns:
        The cells (y, x) within ``BEHIND_CELLS`` of a part of the front in which most cells are
        held. Each cell is assigned to the nearest cell of the front.
    """
    if not (held & front).any():
        return np.zeros(held.shape, dtype=bool)
    around, held_around = (
        uniform_filter(cells.astype(np.float64), FRONT_CELLS, mode="constant")
        for cells in (front, held & front)
    )
    mostly = front & (held_around >= 0.5 * around)
    distance, nearest = distance_transform_edt(~front, return_indices=True)
    return np.asarray(mostly[tuple(nearest)] & (distance <= BEHIND_CELLS), dtype=bool)
