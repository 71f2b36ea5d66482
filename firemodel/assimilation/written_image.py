"""Change the arrival times of a fire so that they agree with a camera image."""

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask, Place, bounds_of, widened
from firemodel.assimilation.camera_window import signed_distance_m
from firemodel.assimilation.observation import BURNED, UNSEEN

# Assumed spread rate near an observed front until the fire advances. The value is the rate of slow
# parts of a front; a higher value would move the members of an ensemble too far, and the estimated
# rates would become too low.
WRITE_M_S = 0.05
WRITE_WITHIN_M = 60.0  # distance from the observed front up to which times are written


def with_image(
    arrival_s: Floats,
    here: Place,
    state: NDArray[np.uint8],
    seen_s: float | Floats,
    cell_m: float,
    unburnable: Mask,
) -> tuple[Floats, Mask] | None:
    """Return a fire's arrival times, corrected with an image, and the changed cells.

    The result is None if the fire agrees with the image.

    Only cells whose state differs from the observed state, and their neighbours, are changed. Other
    parts of the front keep their position within the cells.

    Args:
        arrival_s: (y, x) arrival times of the whole grid; infinity in unburned cells.
        here: The window of the image in the grid.
        state: (y, x) the observed states in the window: UNSEEN, UNBURNED or BURNED.
        seen_s: The time of the image, or the times (y, x) at which the window's cells were seen.
        cell_m: The size of a cell.
        unburnable: (y, x) the cells of the grid that cannot burn; in an image these cells are
            ignored.

    Returns:
        Arrival times and changed cells (y, x) of the whole grid.
    """
    seen = (state != UNSEEN) & ~unburnable[here]
    wrong = seen & ((state == BURNED) != (arrival_s[here] <= seen_s))
    if not wrong.any():
        return None
    part = bounds_of(widened(wrong, _margin_cells(cell_m)))
    times_s = np.broadcast_to(np.asarray(seen_s, dtype=np.float64), state.shape)[part]
    distance_m = signed_distance_m(np.where(seen, state, UNSEEN)[part], cell_m)
    near = widened(wrong[part], 1) & seen[part]
    change = wrong[part] | (near & (np.abs(distance_m) < WRITE_WITHIN_M))
    found, changed = arrival_s.copy(), np.zeros(arrival_s.shape, dtype=bool)
    found[here][part][change] = (times_s - distance_m / WRITE_M_S)[change]
    changed[here][part] = change
    return found, changed


def _margin_cells(cell_m: float) -> int:
    """Return the width in cells of the margin in which distances to an image's front are needed."""
    return int(np.ceil(WRITE_WITHIN_M / cell_m)) + 1
