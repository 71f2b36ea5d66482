"""Find cells that an estimated fire can have reached only across ground observed as unburned."""

import numpy as np

from firemodel.arrays import Floats, Mask, widened
from firemodel.compiled import compiled

MIN_CELLS = 4  # fewer removed cells may be errors of detection
STEP_CELLS = 0.5


def unfounded_cells(
    arrival_s: Floats, removed: Mask, confirmed: Mask, vectors_cells: Floats
) -> Mask:
    """Return the burned cells (y, x) that the fire can have reached only across removed cells.

    If an image shows unburned ground where the estimated fire had burned, the real fire has not
    crossed this ground, and has not reached cells behind it along a path across it. The result
    contains cells whose straight path from their source crosses removed cells or cells found
    earlier, and burned regions that adjoin removed cells and in which no fire was lit or observed.

    Args:
        arrival_s: (y, x) arrival times; infinity in unburned cells.
        removed: (y, x) cells that had burned in the estimate and were observed as unburned.
        confirmed: (y, x) cells that were observed as burned; these cells are never in the result.
        vectors_cells: (2, y, x) the vector from each cell's source to the cell, in cells north and
            east; 0 where the fire was lit (``Fire.arrival_vectors``).
    """
    found = removed.copy()
    if np.count_nonzero(removed) >= MIN_CELLS:
        burned = np.isfinite(arrival_s) & ~removed
        founded = confirmed | (burned & ~vectors_cells.any(axis=0))
        found |= _isolated(burned, removed, founded)
        since_s = float(arrival_s[removed].min())
        order = np.flatnonzero((arrival_s >= since_s) & np.isfinite(arrival_s))
        order = order[np.argsort(arrival_s.ravel()[order], kind="stable")]
        _spread(order, confirmed, vectors_cells, found)
    return found & ~removed


def _isolated(burned: Mask, removed: Mask, founded: Mask) -> Mask:
    """Return the burned regions next to removed cells that contain no cell of ``founded``."""
    from scipy.ndimage import label  # importing SciPy is slow

    labels, count = label(burned, structure=np.ones((3, 3)))
    isolated = np.zeros(count + 1, dtype=bool)
    isolated[np.unique(labels[widened(removed, 2)])] = True
    isolated[np.unique(labels[founded])] = False
    isolated[0] = False
    return isolated[labels]


@compiled
def _spread(order, confirmed, vectors, found):  # type: ignore[no-untyped-def]
    """Add the cells whose path crosses found cells to ``found`` (y, x), in order of arrival."""
    rows, cols = found.shape
    for place in order:
        row, col = place // cols, place % cols
        if confirmed[row, col] or found[row, col]:
            continue
        north, east = vectors[0, row, col], vectors[1, row, col]
        steps = int(np.ceil(np.sqrt(north * north + east * east) / STEP_CELLS))
        for step in range(1, steps + 1):
            at_row = round(row + north * step / steps)
            at_col = round(col - east * step / steps)
            if 0 <= at_row < rows and 0 <= at_col < cols and found[at_row, at_col]:
                found[row, col] = True
                break
