"""Compare an ensemble's fires with the burned cells in the window of a camera image."""

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats, Mask
from firemodel.assimilation.distance_kernels import distance_cells
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN

BLOCK_CELLS = 8  # side of the blocks in which burned areas are compared
MIN_BLOCK_CELLS = 32  # a block with fewer observed cells is not compared
MIN_FRONT_CELLS = 3  # a block with a shorter observed front gives no distance
MIN_BURNED_CELLS = 2  # a block without observed fire is used if a member burned more cells
MIN_SD_CELLS = 0.3  # blocks in which the members differ less give no information


def block_excess(state: NDArray[np.uint8], windows: Mask) -> tuple[Floats, Floats]:
    """Return each member's number of burned cells minus the observed number, in blocks of a window.

    Args:
        state: (y, x) the observed states.
        windows: (members, y, x) the burned cells of the members.

    Returns:
        The excess (members, blocks), and the length of the front in each block in cells. A block is
        left out if few of its cells were observed, if the members nearly agree in the block, or if
        the block contains neither an observed front nor a member's fire.
    """
    from scipy.ndimage import binary_dilation  # importing SciPy is slow

    rows, cols = state.shape
    across = -(-cols // BLOCK_CELLS)
    seen = state != UNSEEN
    row, col = np.nonzero(seen)
    block = row // BLOCK_CELLS * across + col // BLOCK_CELLS
    size = across * -(-rows // BLOCK_CELLS)
    burned = state == BURNED
    front = burned & binary_dilation(state == UNBURNED)

    def counts(mask: Mask) -> Floats:
        return np.bincount(block[mask[row, col]], minlength=size).astype(np.float64)

    count, observed, length = counts(seen), counts(burned), counts(front)
    excess = np.array([counts(window) for window in windows])
    alarming = (observed == 0.0) & (excess.max(axis=0) > MIN_BURNED_CELLS)
    used = (length >= MIN_FRONT_CELLS) | alarming
    used &= (count >= MIN_BLOCK_CELLS) & (excess.std(axis=0) > MIN_SD_CELLS)
    length = np.where(length >= MIN_FRONT_CELLS, length, BLOCK_CELLS)
    return (excess - observed)[:, used], length[used]


def signed_distance_m(state: NDArray[np.uint8], cell_m: float) -> Floats:
    """Return the distance (y, x) in m to the observed front, positive in burned cells.

    If the window does not contain both burned and unburned cells, the distance is the size of the
    window.
    """
    burned, unburned = state == BURNED, state == UNBURNED
    if not (burned.any() and unburned.any()):
        size_m = float(max(state.shape) * cell_m)
        return np.where(burned, size_m, -size_m).astype(np.float64)
    inside: Floats = distance_cells(unburned) - 0.5
    outside: Floats = distance_cells(burned) - 0.5
    return np.asarray(np.where(burned, inside, -outside) * cell_m, dtype=np.float64)
